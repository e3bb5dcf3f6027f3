"""The joint angles and their derivatives at given instants, linear in the unknowns of the search.

In the Lagrange basis the unknowns (angles at interior nodes) act at all instants; in the basis of cubic B-splines they
act on four stages each, so that its matrices are banded. Both meet start and end exactly for any unknowns.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.lagrange.banded import factorise, substitute
from planners.lagrange.interpolation import (
    differentiation_matrices,
    evaluation_matrix,
    lobatto_nodes,
    lobatto_quadrature,
)
from planners.typing import Array

ORDERS = 4
"""Joint angle, velocity, acceleration and jerk."""


class Basis(NamedTuple):
    """A scalar motion over the unit of time and its derivatives, as a linear map of unknowns and values at both ends.

    Attributes:
        s, weights: instants in [0, 1] and their quadrature weights, ``(points,)``.
        first: index of the first unknown that acts at each instant, ``(points,)``.
        functions: derivatives of the motion by the unknowns that act there, ``(points, 4, support)``.
        ends: the same by angle, velocity and acceleration at the start and at the end, ``(points, 4, 6)``.
        fitting: least-squares inverse: from angles at the instants to the unknowns, ``(unknowns, points)``.
    """

    s: Array
    weights: Array
    first: NDArray[np.int64]
    functions: Array
    ends: Array
    fitting: Array


class Transcription(NamedTuple):
    """A basis applied to one problem: absolute link angles in radians, time in seconds.

    ``weights`` ``(points,)`` are those of the basis times the duration, ``base`` ``(points, 4, n)`` is the motion
    with all unknowns zero; the rest is as in `Basis`.
    """

    weights: Array
    first: NDArray[np.int64]
    functions: Array
    base: Array


class Ends(NamedTuple):
    """Joint angles, velocities and accelerations at the start and the end of a motion, ``(3, n)`` each, SI units."""

    start: Array
    end: Array


@lru_cache(maxsize=64)
def lagrange_basis(degree: int, clamp_acceleration: bool, points: int, *, uniform: bool = False) -> Basis:
    """Lagrange polynomials of a degree on Chebyshev-Lobatto nodes, at ``points`` instants.

    The instants are Chebyshev-Lobatto points too, or equally spaced. The angles at the ends are given; those at the one
    or two nodes next to them follow from the velocities and, if it is clamped, the acceleration there. All others are
    the unknowns.
    """
    s = np.linspace(0.0, 1.0, points) if uniform else lobatto_nodes(points - 1)
    weights = _trapezoid(points) if uniform else lobatto_quadrature(points - 1)
    matrices = differentiation_matrices(degree, ORDERS - 1)
    values = np.stack([_product(evaluation_matrix(degree, s), matrix) for matrix in matrices], axis=1)
    return _clamp(values, s, weights, degree + 1, clamp_acceleration)


@lru_cache(maxsize=32)
def spline_basis(stages: int, clamp_acceleration: bool, points_per_stage: int) -> Basis:
    """Cubic B-splines (acceleration linear on every stage) at equally spaced instants, stage borders included."""
    knots = np.concatenate([np.zeros(3), np.linspace(0.0, 1.0, stages + 1), np.ones(3)])
    s = np.linspace(0.0, 1.0, stages * points_per_stage + 1)
    from scipy.interpolate import BSpline  # slow to import

    spline = BSpline(knots, np.eye(stages + 3), 3)
    values = np.stack([spline.derivative(order)(s) if order else spline(s) for order in range(ORDERS)], axis=1)
    return _clamp(values, s, _trapezoid(len(s)), stages + 3, clamp_acceleration)


def transcribe(basis: Basis, ends: Ends, duration: float) -> Transcription:
    """A basis applied to a motion between two joint states in a given time (s)."""
    powers = duration ** np.arange(ORDERS)
    given = np.concatenate([ends.start * powers[:3, None], ends.end * powers[:3, None]]).cumsum(axis=1)
    return Transcription(
        basis.weights * duration,
        basis.first,
        basis.functions / powers[:, None],
        np.ascontiguousarray(basis.ends @ given / powers[:, None]),
    )


def motion(transcription: Transcription, unknowns: Array) -> Array:
    """Joint angles, velocities, accelerations and jerks at the instants, ``(4, points, n)``, SI units, of absolute link
    angles ``unknowns`` ``(unknowns, n)``, rad.
    """
    support = transcription.functions.shape[2]
    acting = unknowns[transcription.first[:, None] + np.arange(support)]
    links = transcription.base + transcription.functions @ acting
    return np.ascontiguousarray(np.diff(links, axis=2, prepend=0.0).transpose(1, 0, 2))


def fit(basis: Basis, transcription: Transcription, q: Array) -> Array:
    """Unknowns whose motion is closest to joint angles ``q`` ``(points, n)`` at the instants, by least squares."""
    remainder = np.cumsum(q, axis=1) - transcription.base[:, 0]
    return _product(basis.fitting, remainder)


def _trapezoid(points: int) -> Array:
    """Trapezoidal weights of equally spaced instants."""
    weights = np.full(points, 1.0 / (points - 1))
    weights[[0, -1]] /= 2.0
    return weights


def _clamp(values: Array, s: Array, weights: Array, count: int, clamp_acceleration: bool) -> Basis:
    """Eliminate the outermost of ``count`` coefficients by the values at the ends; the others are the unknowns.

    ``values`` ``(points, 4, count)`` are the functions and their derivatives at ``s``, from the start to the end.
    """
    orders = 3 if clamp_acceleration else 2
    dependent = np.r_[0:orders, count - orders : count]
    free = np.arange(orders, count - orders)
    given = np.r_[0:orders, 3 : 3 + orders]
    conditions = np.concatenate([values[0, :orders], values[-1, :orders]])
    inverse = np.linalg.inv(conditions[:, dependent])
    functions = values[:, :, free] - _product(values[:, :, dependent], _product(inverse, conditions[:, free]))
    ends = np.zeros((len(s), ORDERS, 6))
    ends[:, :, given] = _product(values[:, :, dependent], inverse)
    return Basis(s, weights, *_localise(functions), ends, _least_squares_inverse(functions[:, 0]))


def _product(left: Array, right: Array) -> Array:
    """``left @ right`` without BLAS, whose rounding depends on the number of its threads."""
    product: Array = np.einsum("...ij,jk->...ik", left, right)
    return product


def _least_squares_inverse(functions: Array) -> Array:
    """The inverse ``(count, points)`` of functions ``(points, count)``, by their normal equations; see `_product`."""
    count = functions.shape[1]
    normal, factor = _product(functions.T, functions), np.zeros((count, count))
    for i in range(count):
        factor[i, count - 1 - i :] = normal[i, : i + 1]  # the diagonal last, as `factorise` reads it
    factorise(factor)
    columns = np.ascontiguousarray(functions)
    for column in columns:
        substitute(factor, column)
    return np.ascontiguousarray(columns.T)


def _localise(functions: Array) -> tuple[NDArray[np.int64], Array]:
    """First function that is not 0 at each instant, and the values of as many as are not 0 at any one instant."""
    acting = np.abs(functions).max(axis=1) > 1e-12 * np.abs(functions).max(axis=(0, 1))
    count = functions.shape[2]
    firsts = np.where(acting.any(axis=1), acting.argmax(axis=1), count)
    lasts = np.where(acting.any(axis=1), count - acting[:, ::-1].argmax(axis=1), 0)
    support = int((lasts - firsts).max())
    first = np.minimum(firsts, count - support).astype(np.int64)
    return first, np.take_along_axis(functions, (first[:, None] + np.arange(support))[:, None, :], axis=2)
