"""The local model of a least-torque problem: loads, index, and Newton's equations with exact second derivatives."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planners.compiled.calls import dividing, private
from planners.lagrange.torque_derivatives import (
    add_torque_curvature_single,
    torque_jacobian_single,
    torques_single,
    turn_couplings,
)
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


@dividing
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
    width = (highest + 1) * n
    curvature, row = np.empty((width, width)), np.empty(width)
    links_gradient, index_links_gradient = np.empty(width), np.empty(width)
    bends, factors, forces = np.empty(n), np.empty(n), np.empty(n)
    cosine, sine = np.empty((n, n)), np.empty((n, n))
    for k in range(points):
        links, jacobian = point.links[k], jacobians[k]
        for r in range(width):
            links_gradient[r] = index_links_gradient[r] = 0.0
            for c in range(width):
                curvature[r, c] = 0.0
        for j in range(n):
            tau = point.tau[k, j]
            if task.power == 1:
                root = np.sqrt(tau * tau + eps * eps)
                factors[j] = weights[k] * tau / root / task.unit
                bends[j] = weights[k] * (1.0 - sign[k, j] * tau / root) / (root * task.unit * task.unit)
            else:
                factors[j] = 2.0 * weights[k] * tau / task.unit
                bends[j] = 2.0 * weights[k] / (task.unit * task.unit)
            forces[j] = 0.0
        turn_couplings(task.coupling, links, cosine, sine)
        torque_jacobian_single(task.weight, links, cosine, sine, jacobian)
        for j in range(n):
            for d in range(3):
                for a in range(n):
                    index_links_gradient[d * n + a] += factors[j] * jacobian[j, d, a]
        for limit in range(limits):
            order, j, inverse = task.orders[limit], task.joints[limit], task.inverse_limits[k, limit]
            at = k * limits + limit
            slope, bend = force[at] * inverse, stiffness[at] * inverse * inverse
            if order < 0:
                forces[j] = slope
                bends[j] += bend
                factors[j] += multiplier[at] * inverse
                continue
            r = order * n + j
            links_gradient[r] += slope
            curvature[r, r] += bend
            if j > 0:
                links_gradient[r - 1] -= slope
                curvature[r - 1, r - 1] += bend
                curvature[r - 1, r] -= bend
                curvature[r, r - 1] -= bend
        for j in range(n):
            for d in range(3):
                for a in range(n):
                    r, slope = d * n + a, jacobian[j, d, a]
                    links_gradient[r] += forces[j] * slope
                    scaled = bends[j] * slope
                    for e in range(3):
                        for b in range(n):
                            curvature[r, e * n + b] += scaled * jacobian[j, e, b]
        add_torque_curvature_single(task.weight, links, cosine, sine, factors, curvature)
        for r in range(width):
            links_gradient[r] += index_links_gradient[r]
        _condense(tr.functions[k], tr.first[k], curvature, row, hessian)
        for i in range(support):
            for d in range(highest + 1):
                share = tr.functions[k, d, i]
                for a in range(n):
                    here = (tr.first[k] + i) * n + a
                    gradient[here] += share * links_gradient[d * n + a]
                    index_gradient[here] += share * index_links_gradient[d * n + a]
        for j in range(n):
            for d in range(3):
                for a in range(n):
                    jacobian[j, d, a] /= task.unit
    return Model(hessian, gradient, index_gradient, jacobians)


@private
def _condense(functions: Array, first: int, curvature: Array, row: Array, hessian: Array) -> None:
    """Add one instant's second derivatives, by the unknowns, to the banded matrix; ``row`` is scratch."""
    support, band, width = functions.shape[1], hessian.shape[1] - 1, curvature.shape[0]
    n = hessian.shape[1] // support
    orders = width // n
    for i in range(support):
        for a in range(n):
            here = (first + i) * n + a
            for c in range(width):
                row[c] = functions[0, i] * curvature[a, c]
            for d in range(1, orders):
                for c in range(width):
                    row[c] += functions[d, i] * curvature[d * n + a, c]
            for other in range(i + 1):
                column = band - (i - other) * n - a
                for b in range(n if other < i else a + 1):
                    total = 0.0
                    for e in range(orders):
                        total += row[e * n + b] * functions[e, other]
                    hessian[here, column + b] += total
