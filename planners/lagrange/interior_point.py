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

from planners.compiled.calls import private
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


@njit(cache=True, nogil=True, error_model="numpy")
def solve(
    tr: Transcription, task: TorqueTask, start: Array, barrier: float, tolerance: float, most: int
) -> tuple[Array, Array]:
    """Local minimum from ``start``: the unknowns, ``(unknowns, n)``, and value / limit at the instants.

    ``barrier`` is the first barrier parameter, ``tolerance`` that of the index, ``most`` the number of iterations.
    Loops in place of array expressions take a tenth of the time to compile.
    """
    total = 0.0
    for k in range(tr.weights.shape[0]):
        total += tr.weights[k]
    weights = np.empty(tr.weights.shape[0])
    for k in range(tr.weights.shape[0]):
        weights[k] = tr.weights[k] / total
    unknowns, n = start.shape
    x, point = start.copy(), evaluate(tr, task, start)
    limits = point.load.shape[0]
    rooms, slacks, duals = np.empty((2, limits)), np.empty((2, limits)), np.empty((2, limits))
    slacks_step, duals_step = np.empty((2, limits)), np.empty((2, limits))
    force, multiplier, stiffness = np.empty(limits), np.empty(limits), np.empty(limits)
    _set_rooms(point.load, rooms)
    least = min(0.1, 10.0 * barrier)
    for side in range(2):
        for i in range(limits):
            slacks[side, i] = least if rooms[side, i] < least else rooms[side, i]
            duals[side, i] = barrier / slacks[side, i]
    eps = max(LEAST_SMOOTHING, SMOOTHING * barrier)
    sign = np.zeros(point.tau.shape)
    _turn_signs(sign, point.tau, sign, eps, 1.0)
    shift, penalty = 0.0, 1.0
    move, trial, no_middle = np.empty((unknowns, n)), np.empty((unknowns, n)), np.zeros(task.middle.shape[0])
    new_rooms, new_slacks = np.empty((2, limits)), np.empty((2, limits))
    for _ in range(most):
        # force and stiffness of the barrier at every limit, and its present multiplier
        for i in range(limits):
            upper = (barrier + duals[0, i] * (slacks[0, i] - rooms[0, i])) / slacks[0, i]
            lower = (barrier + duals[1, i] * (slacks[1, i] - rooms[1, i])) / slacks[1, i]
            force[i], multiplier[i] = upper - lower, duals[0, i] - duals[1, i]
            stiffness[i] = duals[0, i] / slacks[0, i] + duals[1, i] / slacks[1, i]

        # Newton's step of unknowns, torques, loads, slacks and duals
        model = newton_model(tr, task, weights, point, sign, eps, force, multiplier, stiffness)
        step, shift = _regularised_step(model, shift, unknowns)
        for i in range(unknowns):
            for j in range(n):
                move[i, j] = step[i * n + j]
        links_step = displace(tr, move)
        tau_step = _torque_step(model, links_step)
        load_step = bounded(task, links_step, tau_step, task.unit, no_middle)
        bending = infeasibility = 0.0
        for side in range(2):
            for i in range(limits):
                slack, room = slacks[side, i], rooms[side, i]
                change = room - slack - load_step[i] if side == 0 else room - slack + load_step[i]
                slacks_step[side, i] = change
                duals_step[side, i] = (barrier - duals[side, i] * change) / slack - duals[side, i]
                bending += change / slack
                infeasibility += abs(slack - room)
        reach = _longest(slacks, slacks_step)

        # merit function: index, barrier and penalty on broken limits
        decrement = -dot(model.gradient, step)
        slope = dot(model.index_gradient, step) - barrier * bending
        if infeasibility > 1e-9:
            penalty = max(penalty, 1.5 * (slope + 0.5 * max(decrement, 0.0)) / infeasibility)
        slope -= penalty * infeasibility
        merit = _merit(weights, task, point, slacks, rooms, barrier, eps, penalty)

        # line search
        length, accepted = reach, False
        for _halving in range(HALVINGS):
            for i in range(unknowns):
                for j in range(n):
                    trial[i, j] = x[i, j] + length * move[i, j]
            new_point = evaluate(tr, task, trial)
            _set_rooms(new_point.load, new_rooms)
            _advance(slacks, rooms, slacks_step, length, new_rooms, new_slacks)
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
        dual_length, central = _longest(duals, duals_step), True
        for side in range(2):
            for i in range(limits):
                middle = barrier / new_slacks[side, i]
                dual = max(duals[side, i] + dual_length * duals_step[side, i], 1e-8 * middle)
                duals[side, i] = min(dual, 1e8 * middle)
                central = central and abs(new_slacks[side, i] - new_rooms[side, i]) < 1e-6
        x, trial, point = trial, x, new_point
        rooms, new_rooms, slacks, new_slacks = new_rooms, rooms, new_slacks, slacks

        # less or more regularisation, and a smaller barrier once the present one is solved
        if length < 0.4 * reach:
            shift = max(1e-3, 4.0 * shift)
        elif length > 0.9 * reach:
            shift = 0.25 * shift if shift > 1e-4 else 0.0
        if length > 0.4 * reach and decrement < max(10.0 * barrier, tolerance) and central:
            if barrier <= LAST_BARRIER and decrement < tolerance:
                break
            barrier = max(LAST_BARRIER, 0.15 * barrier)
            eps = max(LEAST_SMOOTHING, SMOOTHING * barrier)
            penalty = 1.0
    return x, point.load


@njit(cache=True, nogil=True)
def dot(a: Array, b: Array) -> float:
    """Scalar product, summed in order."""
    total = 0.0
    for i in range(a.shape[0]):
        total += a[i] * b[i]
    return total


@private
def _set_rooms(load: Array, rooms: Array) -> None:
    """Distances of the loads to the upper and to the lower side of their limits, to ``rooms`` ``(2, loads)``."""
    for i in range(load.shape[0]):
        rooms[0, i], rooms[1, i] = 1.0 - load[i], 1.0 + load[i]


@private
def _turn_signs(sign: Array, tau: Array, tau_step: Array, eps: float, length: float) -> None:
    """Move the duals of |tau| towards the smoothed sign after a full step, within [-1, 1]."""
    for k in range(sign.shape[0]):
        for j in range(sign.shape[1]):
            root = np.sqrt(tau[k, j] * tau[k, j] + eps * eps)
            smoothed = tau[k, j] / root
            smoothed += (1.0 - sign[k, j] * smoothed) / root * tau_step[k, j]
            sign[k, j] = min(1.0, max(-1.0, sign[k, j] + length * (smoothed - sign[k, j])))


@private
def _regularised_step(model: Model, shift: float, unknowns: int) -> tuple[Array, float]:
    """Newton's step, with a shift of the diagonal that makes the matrix positive definite, and that shift."""
    size, width = model.hessian.shape
    step, factor = np.zeros(size), np.empty((size, width))
    while shift < 1e12:
        for i in range(size):
            for j in range(width):
                factor[i, j] = model.hessian[i, j]
            factor[i, width - 1] += shift / unknowns
        if factorise(factor):
            for i in range(size):
                step[i] = -model.gradient[i]
            substitute(factor, step)
            break
        shift = max(1e-3, 4.0 * shift)
    return step, shift


@private
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


@private
def _longest(values: Array, steps: Array) -> float:
    """Largest share of the steps that keeps positive values positive, at most 1."""
    reach = 1.0
    for side in range(values.shape[0]):
        for i in range(values.shape[1]):
            if steps[side, i] < 0.0:
                reach = min(reach, -TO_BOUNDARY * values[side, i] / steps[side, i])
    return reach


@njit(cache=True, nogil=True)
def _advance(slacks: Array, rooms: Array, steps: Array, length: float, new_rooms: Array, new_slacks: Array) -> None:
    """Slacks after a step: the room itself where the limit was or is kept, those of Newton's step elsewhere.

    Negative, so that the step is refused, where it breaks a limit that was kept.
    """
    for side in range(slacks.shape[0]):
        for i in range(slacks.shape[1]):
            slack, room = slacks[side, i], new_rooms[side, i]
            if slack != rooms[side, i]:
                stepped = slack + length * steps[side, i]
                new_slacks[side, i] = stepped if room < stepped else room
            else:
                new_slacks[side, i] = room if room > 0.5 * (1.0 - TO_BOUNDARY) * slack else -1.0


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
    logarithms = infeasibility = 0.0
    for side in range(slacks.shape[0]):
        for i in range(slacks.shape[1]):
            if not slacks[side, i] > 0.0:
                return np.inf
            logarithms += np.log(slacks[side, i])
            infeasibility += abs(slacks[side, i] - rooms[side, i])
    return index(weights, point.tau, task.power, eps) - barrier * logarithms + penalty * infeasibility
