"""The local model of a least-torque problem: loads, index, and Newton's equations with exact second derivatives."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planners.compiled.calls import private
from planners.lagrange.torque_derivatives import add_torque_curvature_single, torque_jacobian_single, torques_single
from planners.lagrange.transcription import Transcription
from planners.typing import Array


class TorqueTask(NamedTuple):
    """The index to minimise and the limits.

    Attributes:
        coupling, weight: constants of the arm's dynamics.
        orders, joints: order of derivative (-1 for torque) and joint that each limit bounds, ``(limits,)``.
        middle: value from which each limit is measured, 0 but for angles, ``(limits,)``, rad.
        inverse_limits: 1 / limit at every instant, 0 where it is not applied, ``(points, limits)``.
        power, unit: power of |tau| in the integrand, 1 or 2, and torque that counts as 1, N m.
    """

    coupling: Array
    weight: Array
    orders: NDArray[np.int64]
    joints: NDArray[np.int64]
    middle: Array
    inverse_limits: Array
    power: int
    unit: float


class Point(NamedTuple):
    """A motion at the instants: link angles with derivatives ``(points, 4, n)``, joint torques in units ``(points,
    n)``, and the signed value / limit of every limit at every instant, ``(points * limits,)``.
    """

    links: Array
    tau: Array
    load: Array


class Model(NamedTuple):
    """Newton's equations: the Hessian as rows of a banded matrix (:mod:`planners.lagrange.banded`); gradients
    ``(size,)`` of the index with the barrier and of the index alone; derivatives of the torques in units, ``(points,
    n, 3, n)``.
    """

    hessian: Array
    gradient: Array
    index_gradient: Array
    jacobians: Array


@private
def displace(tr: Transcription, x: Array) -> Array:
    """Change of the links' motion by a change ``x`` ``(unknowns, n)`` of the unknowns, ``(points, 4, n)``."""
    points, orders, support = tr.functions.shape
    n = x.shape[1]
    links = np.zeros((points, orders, n))
    for k in range(points):
        for d in range(orders):
            for i in range(support):
                for j in range(n):
                    links[k, d, j] += tr.functions[k, d, i] * x[tr.first[k] + i, j]
    return links


@njit(cache=True, nogil=True, error_model="numpy")
def evaluate(tr: Transcription, task: TorqueTask, x: Array) -> Point:
    """Motion, torques and loads for unknowns ``x`` ``(unknowns, n)``."""
    links = displace(tr, x)
    points, orders, n = links.shape
    tau = np.empty((points, n))
    for k in range(points):
        for d in range(orders):
            for j in range(n):
                links[k, d, j] += tr.base[k, d, j]
        torques_single(task.coupling, task.weight, links[k], tau[k])
    load = bounded(task, links, tau, 1.0, task.middle)
    for k in range(points):
        for j in range(n):
            tau[k, j] /= task.unit
    return Point(links, tau, load)


@njit(cache=True, nogil=True)
def bounded(task: TorqueTask, links: Array, tau: Array, unit: float, middle: Array) -> Array:
    """Every limited value, less its ``middle``, over its limit, from the links' motion and the torques in units (N m):
    ``(points * limits,)``.
    """
    limits = task.orders.shape[0]
    load = np.empty(links.shape[0] * limits)
    for c in range(limits):
        order, joint = task.orders[c], task.joints[c]
        for k in range(links.shape[0]):
            if order < 0:
                value = tau[k, joint] * unit
            else:
                value = links[k, order, joint]
                if joint > 0:
                    value -= links[k, order, joint - 1]
            load[k * limits + c] = (value - middle[c]) * task.inverse_limits[k, c]
    return load


@njit(cache=True, nogil=True)
def index(weights: Array, tau: Array, power: int, eps: float) -> float:
    """Integral of ``sum (tau^2 + eps^2)^(1/2)`` (power 1) or ``sum tau^2`` (power 2)."""
    total = 0.0
    for k in range(tau.shape[0]):
        for j in range(tau.shape[1]):
            square = tau[k, j] ** 2
            total += weights[k] * (np.sqrt(square + eps * eps) if power == 1 else square)
    return total


@njit(cache=True, nogil=True, error_model="numpy")
def newton_model(
    tr: Transcription, task: TorqueTask, weights: Array, point: Point, sign: Array, eps: float,
    force: Array, multiplier: Array, stiffness: Array,
) -> Model:  # fmt: skip
    """Newton's equations at a point.

    Args:
        tr, task: the motion as a linear map of the unknowns; index and limits.
        weights: of the instants in the index, ``(points,)``.
        point: of `evaluate`.
        sign, eps: dual variable of every torque, in [-1, 1], ``(points, n)``, and width of the smoothed |tau|, units.
        force, multiplier, stiffness: derivative of the barrier by every load, present multiplier and second
            derivative of the barrier, ``(points * limits,)`` each.
    """
    points, n = point.tau.shape
    support = tr.functions.shape[2]
    size, limits = 0, task.orders.shape[0]
    for first in tr.first:
        size = max(size, (first + support) * n)
    hessian = np.zeros((size, support * n))
    gradient, index_gradient = np.zeros(size), np.zeros(size)
    jacobians = np.empty((points, n, 3, n))
    highest = 2
    for order in task.orders:
        highest = max(highest, order)
    curvature = np.empty((4, n, 4, n))
    links_gradient, index_links_gradient = np.empty((4, n)), np.empty((4, n))
    slopes, bends, factors = np.empty(n), np.empty(n), np.empty(n)
    for k in range(points):
        for d in range(4):
            for j in range(n):
                index_links_gradient[d, j] = 0.0
                for e in range(4):
                    for a in range(n):
                        curvature[d, j, e, a] = 0.0
        for j in range(n):
            tau = point.tau[k, j]
            if task.power == 1:
                root = np.sqrt(tau * tau + eps * eps)
                slopes[j] = weights[k] * tau / root
                bends[j] = weights[k] * (1.0 - sign[k, j] * tau / root) / root
            else:
                slopes[j], bends[j] = 2.0 * weights[k] * tau, 2.0 * weights[k]
            factors[j] = slopes[j] / task.unit
        torque_jacobian_single(task.coupling, task.weight, point.links[k], jacobians[k])
        jacobian = jacobians[k]
        for j in range(n):
            for d in range(3):
                for a in range(n):
                    jacobian[j, d, a] /= task.unit
        _add_torques(slopes, bends, jacobian, index_links_gradient, curvature)
        for j in range(n):
            slopes[j] = bends[j] = 0.0
            for d in range(4):
                links_gradient[d, j] = index_links_gradient[d, j]
        for c in range(limits):
            order, j, inverse = task.orders[c], task.joints[c], task.inverse_limits[k, c]
            slope, bend = force[k * limits + c] * inverse, stiffness[k * limits + c] * inverse * inverse
            if order < 0:
                slopes[j], bends[j] = slope * task.unit, bend * task.unit**2
                factors[j] += multiplier[k * limits + c] * inverse
                continue
            links_gradient[order, j] += slope
            curvature[order, j, order, j] += bend
            if j > 0:
                links_gradient[order, j - 1] -= slope
                curvature[order, j - 1, order, j - 1] += bend
                curvature[order, j - 1, order, j] -= bend
                curvature[order, j, order, j - 1] -= bend
        _add_torques(slopes, bends, jacobian, links_gradient, curvature)
        add_torque_curvature_single(task.coupling, task.weight, point.links[k], factors, curvature)
        _condense(tr.functions[k], tr.first[k], highest + 1, curvature, hessian)
        for i in range(support):
            for a in range(n):
                here = (tr.first[k] + i) * n + a
                for d in range(highest + 1):
                    gradient[here] += tr.functions[k, d, i] * links_gradient[d, a]
                    index_gradient[here] += tr.functions[k, d, i] * index_links_gradient[d, a]
    return Model(hessian, gradient, index_gradient, jacobians)


@private
def _add_torques(slopes: Array, bends: Array, jacobian: Array, links_gradient: Array, curvature: Array) -> None:
    """Add first and (without the torques' own curvature) second derivatives of a function of the torques."""
    n = slopes.shape[0]
    for j in range(n):
        if slopes[j] == 0.0 and bends[j] == 0.0:
            continue
        for d in range(3):
            for a in range(n):
                links_gradient[d, a] += slopes[j] * jacobian[j, d, a]
                scaled = bends[j] * jacobian[j, d, a]
                for e in range(3):
                    for b in range(n):
                        curvature[d, a, e, b] += scaled * jacobian[j, e, b]


@private
def _condense(functions: Array, first: int, orders: int, curvature: Array, hessian: Array) -> None:
    """Add one instant's second derivatives, by the unknowns, to the banded matrix."""
    support, n = functions.shape[1], curvature.shape[1]
    band = hessian.shape[1] - 1
    row = np.empty((orders, n))
    for i in range(support):
        for a in range(n):
            here = (first + i) * n + a
            for e in range(orders):
                for b in range(n):
                    total = 0.0
                    for d in range(orders):
                        total += functions[d, i] * curvature[d, a, e, b]
                    row[e, b] = total
            for other in range(i + 1):
                column = (first + other) * n - here + band
                for b in range(n if other < i else a + 1):
                    total = 0.0
                    for e in range(orders):
                        total += row[e, b] * functions[e, other]
                    hessian[here, column + b] += total
