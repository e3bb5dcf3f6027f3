"""The curve of the dodging planner: joint angles as polynomials of degree 5 in time, shaped by two via-nodes.

It is the Lagrange interpolant on six Chebyshev-Lobatto nodes: the end nodes are the start and the end, their neighbours
follow from the velocities at the ends, and the two in the middle, the via-nodes, are free. They are given relative to
the cubic with the same ends.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from planners.compiled.calls import private
from planners.lagrange.interpolation import lobatto_nodes
from planners.typing import Array

DEGREE = 5
VIA_TIMES = lobatto_nodes(DEGREE)[2:4]
"""Times of the via-nodes, as shares of the duration."""


def _coefficients_from_nodes() -> Array:
    """Matrix from angle and rate at 0, angle and rate at 1, and the via-nodes to coefficients by rising power."""
    power = np.arange(DEGREE + 1)
    angles = [s**power for s in (0.0, 1.0, *VIA_TIMES)]
    rates = [power * s ** np.maximum(power - 1, 0) for s in (0.0, 1.0)]
    inverse: Array = np.linalg.inv(np.array([angles[0], rates[0], angles[1], rates[1], *angles[2:]]))
    return inverse


_COEFFICIENTS = _coefficients_from_nodes()
_CUBIC = np.array([[(1 - s) ** 2 * (1 + 2 * s), s * (1 - s) ** 2, s**2 * (3 - 2 * s)] for s in VIA_TIMES])
"""The cubic's angles at the via-nodes, from angle and rate at 0 and the angle at 1."""


@njit(cache=True, nogil=True)
def interpolate(q: Array, qd: Array, end: Array, via: Array, duration: float, c: Array) -> None:
    """Fill in the coefficients of the interpolant in ``s = t / duration``.

    Args:
        q, qd: start, ``(n,)``, rad and rad/s.
        end: posture of rest, ``(n,)``, rad.
        via: displacements of the via-nodes from the cubic with the same ends, ``(2, n)``, rad.
        duration: s.
        c: coefficients by rising power, ``(n, 6)``, rad.
    """
    for i in range(q.shape[0]):
        r = qd[i] * duration
        first = via[0, i] + _CUBIC[0, 0] * q[i] + _CUBIC[0, 1] * r + _CUBIC[0, 2] * end[i]
        second = via[1, i] + _CUBIC[1, 0] * q[i] + _CUBIC[1, 1] * r + _CUBIC[1, 2] * end[i]
        for k in range(DEGREE + 1):
            row = _COEFFICIENTS[k]
            c[i, k] = row[0] * q[i] + row[1] * r + row[2] * end[i] + row[4] * first + row[5] * second


@njit(cache=True, nogil=True)
def derivative(c: Array, order: int, s: float) -> float:
    """A derivative of the polynomial with coefficients ``c``, ``(6,)``, at ``s``."""
    value = 0.0
    for k in range(DEGREE, order - 1, -1):
        factor = 1.0
        for j in range(order):
            factor *= k - j
        value = value * s + factor * c[k]
    return value


@private
def angle_at(c: Array, s: float) -> float:
    """The polynomial with coefficients ``c``, ``(6,)``, at ``s``, rad."""
    return float(c[0] + s * (c[1] + s * (c[2] + s * (c[3] + s * (c[4] + s * c[5])))))
