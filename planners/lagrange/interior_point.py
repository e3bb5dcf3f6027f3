"""Compiled primal-dual interior point method for least torque within limits.

It minimises the integral of ``sum |tau|`` or ``sum tau^2`` over the unknowns of a transcription. Limits hold at the
instants of the transcription: each is met with a slack on either side that stays positive while a logarithmic barrier
vanishes (J. Nocedal and S. J. Wright, "Numerical Optimization", chapter 19), so a start may break them. ``|tau|`` is
smoothed to ``sqrt(tau^2 + eps^2)``, ``eps`` following the barrier down; its curvature is taken at a dual variable, as
T. F. Chan, G. H. Golub and P. Mulet do in "A Nonlinear Primal-Dual Method for Total Variation-Based Image Restoration",
SIAM J. Sci. Comput. 20 (1999), which keeps Newton's method fast where the kink is sharp.

:mod:`planners.dpct.interior_point` is another primal-dual method; it says why there are two.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from planners.lagrange.banded import factorise, substitute
from planners.lagrange.newton import Model, Point, TorqueTask, bounded, displace, evaluate, index, newton_model
from planners.lagrange.transcription import Transcription
from planners.typing import Array

LAST_BARRIER = 1e-6
SMOOTHING, LEAST_SMOOTHING = 10.0, 1e-3
"""Width of the smoothed |tau| per barrier parameter, and its least, units of torque."""
TO_BOUNDARY = 0.99
"""Largest step, as a share of the step to the boundary."""

HALVINGS = 10


@njit(cache=True, nogil=True)
def solve(
    tr: Transcription, task: TorqueTask, start: Array, barrier: float, tolerance: float, most: int
) -> tuple[Array, float]:
    """Local minimum from ``start``: the unknowns, ``(unknowns, n)``, and the worst |value| / limit at the instants.

    ``barrier`` is the first barrier parameter, ``tolerance`` that of the index, ``most`` the number of iterations.
    """
    weights = tr.weights / tr.weights.sum()
    x, point = start.copy(), evaluate(tr, task, start)
    rooms = _rooms(point.load)
    slacks = np.maximum(rooms, min(0.1, 10.0 * barrier))
    duals = barrier / slacks
    eps = max(LEAST_SMOOTHING, SMOOTHING * barrier)
    sign = np.zeros_like(point.tau)
    _turn_signs(sign, point.tau, sign, eps, 1.0)
    shift, penalty = 0.0, 1.0
    for _ in range(most):
        # force and stiffness of the barrier at every limit, and its present multiplier
        forces, stiffnesses = (barrier + duals * (slacks - rooms)) / slacks, duals / slacks
        force, multiplier, stiffness = forces[0] - forces[1], duals[0] - duals[1], stiffnesses[0] + stiffnesses[1]

        # Newton's step of unknowns, torques, loads, slacks and duals
        model = newton_model(tr, task, weights, point, sign, eps, force, multiplier, stiffness)
        step, shift = _regularised_step(model, shift, x.shape[0])
        links_step = displace(tr, step.reshape(x.shape))
        tau_step = _torque_step(model, links_step)
        load_step = bounded(task, links_step, tau_step * task.unit, np.zeros_like(task.middle))
        slacks_step = rooms - slacks
        slacks_step[0] -= load_step
        slacks_step[1] += load_step
        duals_step = (barrier - duals * slacks_step) / slacks - duals
        reach = _longest(slacks, slacks_step)

        # merit function: index, barrier and penalty on broken limits
        decrement = -dot(model.gradient, step)
        slope = dot(model.index_gradient, step) - barrier * np.sum(slacks_step / slacks)
        infeasibility = np.sum(np.abs(slacks - rooms))
        if infeasibility > 1e-9:
            penalty = max(penalty, 1.5 * (slope + 0.5 * max(decrement, 0.0)) / infeasibility)
        slope -= penalty * infeasibility
        merit = _merit(weights, task, point, slacks, rooms, barrier, eps, penalty)

        # line search
        length, accepted = reach, False
        for _halving in range(HALVINGS):
            trial = x + length * step.reshape(x.shape)
            new_point = evaluate(tr, task, trial)
            new_rooms = _rooms(new_point.load)
            new_slacks = _advance(slacks, rooms, slacks_step, length, new_rooms)
            new = _merit(weights, task, new_point, new_slacks, new_rooms, barrier, eps, penalty)
            if new <= merit + 1e-4 * length * slope + 1e-12 * abs(merit):
                accepted = True
                break
            length *= 0.5
        if not accepted:
            if shift > 1e6:
                break
            shift = max(1e-2, 10.0 * shift)
            continue
        _turn_signs(sign, point.tau, tau_step, eps, length)
        duals += _longest(duals, duals_step) * duals_step
        x, point, rooms, slacks = trial, new_point, new_rooms, new_slacks
        central = barrier / slacks
        duals = np.minimum(np.maximum(duals, 1e-8 * central), 1e8 * central)

        # less or more regularisation, and a smaller barrier once the present one is solved
        if length < 0.4 * reach:
            shift = max(1e-3, 4.0 * shift)
        elif length > 0.9 * reach:
            shift = 0.25 * shift if shift > 1e-4 else 0.0
        if (
            length > 0.4 * reach
            and decrement < max(10.0 * barrier, tolerance)
            and np.all(np.abs(slacks - rooms) < 1e-6)
        ):
            if barrier <= LAST_BARRIER and decrement < tolerance:
                break
            barrier = max(LAST_BARRIER, 0.15 * barrier)
            eps = max(LEAST_SMOOTHING, SMOOTHING * barrier)
            penalty = 1.0
    return x, np.max(np.abs(point.load)) if point.load.size > 0 else 0.0


@njit(cache=True, nogil=True)
def dot(a: Array, b: Array) -> float:
    """Scalar product, summed in order."""
    total = 0.0
    for i in range(a.shape[0]):
        total += a[i] * b[i]
    return total


@njit(cache=True, nogil=True)
def _rooms(load: Array) -> Array:
    """Distances of the loads to the upper and to the lower side of their limits, ``(2, points, limits)``."""
    return np.stack((1.0 - load, 1.0 + load))


@njit(cache=True, nogil=True)
def _turn_signs(sign: Array, tau: Array, tau_step: Array, eps: float, length: float) -> None:
    """Move the duals of |tau| towards the smoothed sign after a full step, within [-1, 1]."""
    root = np.sqrt(tau * tau + eps * eps)
    smoothed = tau / root
    smoothed += (1.0 - sign * smoothed) / root * tau_step
    sign[:] = np.minimum(1.0, np.maximum(-1.0, sign + length * (smoothed - sign)))


@njit(cache=True, nogil=True)
def _regularised_step(model: Model, shift: float, unknowns: int) -> tuple[Array, float]:
    """Newton's step, with a shift of the diagonal that makes the matrix positive definite, and that shift."""
    step, factor = np.zeros_like(model.gradient), np.empty_like(model.hessian)
    while shift < 1e12:
        factor[:] = model.hessian
        factor[:, -1] += shift / unknowns
        if factorise(factor):
            step[:] = -model.gradient
            substitute(factor, step)
            break
        shift = max(1e-3, 4.0 * shift)
    return step, shift


@njit(cache=True, nogil=True)
def _torque_step(model: Model, links_step: Array) -> Array:
    """First-order change of the torques, units."""
    points, n = model.jacobians.shape[:2]
    change = np.zeros((points, n))
    for k in range(points):
        for j in range(n):
            for d in range(3):
                for a in range(n):
                    change[k, j] += model.jacobians[k, j, d, a] * links_step[k, d, a]
    return change


@njit(cache=True, nogil=True)
def _longest(values: Array, steps: Array) -> float:
    """Largest share of the steps that keeps positive values positive, at most 1."""
    values, steps, reach = values.ravel(), steps.ravel(), 1.0
    for i in range(values.shape[0]):
        if steps[i] < 0.0:
            reach = min(reach, -TO_BOUNDARY * values[i] / steps[i])
    return reach


@njit(cache=True, nogil=True)
def _advance(slacks: Array, rooms: Array, steps: Array, length: float, new_rooms: Array) -> Array:
    """Slacks after a step: the room itself where the limit was or is kept, those of Newton's step elsewhere.

    Negative, so that the step is refused, where it breaks a limit that was kept.
    """
    kept = np.where(new_rooms > 0.5 * (1.0 - TO_BOUNDARY) * slacks, new_rooms, -1.0)
    return np.where(slacks == rooms, kept, np.maximum(new_rooms, slacks + length * steps))


@njit(cache=True, nogil=True)
def _merit(
    weights: Array,
    task: TorqueTask,
    point: Point,
    slacks: Array,
    rooms: Array,
    barrier: float,
    eps: float,
    penalty: float,
) -> float:
    """Smoothed index with the barrier of the slacks and an l1 penalty on broken limits; inf outside the barrier."""
    if not np.all(slacks > 0.0):
        return np.inf
    smooth = index(weights, point.tau, task.power, eps)
    return float(smooth - barrier * np.sum(np.log(slacks)) + penalty * np.sum(np.abs(slacks - rooms)))
