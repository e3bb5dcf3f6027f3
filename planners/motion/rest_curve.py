"""Curves from rest to rest: the quintic, bent by Chebyshev polynomials that leave both of its ends alone.

With ``s = t / T`` each joint follows ``q0 + (qf - q0) (10 s^3 - 15 s^4 + 6 s^5) + sum_k c_k w(s) T_k(2 s - 1)`` with
the window ``w(s) = 16 s^2 (1 - s)^2``, which is 1 half way and, like its slope, 0 at both ends. So a vector of
coefficients ``c`` is a motion, whatever its numbers: what an optimiser, or a network, wants to choose from.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from planners.typing import Array

SHAPES = 14
"""Chebyshev polynomials T_0 ... T_13 of each joint."""

_WINDOW = np.polynomial.Polynomial([0.0, 0.0, 16.0, -32.0, 16.0])


def shape_functions(s: Array) -> Array:
    """The window times each Chebyshev polynomial.

    Args:
        s: shares of the duration, ``(samples,)``.

    Returns:
        Values, slopes and curvatures by s, ``(3, SHAPES, samples)``.
    """
    window = np.stack([part(s) for part in (_WINDOW, _WINDOW.deriv(), _WINDOW.deriv(2))])
    rows = np.empty((3, SHAPES, len(s)))
    for k in range(SHAPES):
        chebyshev = np.polynomial.Chebyshev.basis(k, domain=[0.0, 1.0])
        value, slope, curvature = chebyshev(s), chebyshev.deriv()(s), chebyshev.deriv(2)(s)
        rows[0, k] = window[0] * value
        rows[1, k] = window[1] * value + window[0] * slope
        rows[2, k] = window[2] * value + 2.0 * window[1] * slope + window[0] * curvature
    return rows


@njit(cache=True, nogil=True)
def rest_curve_single(
    coefficients: Array, start: Array, goal: Array, duration: float, t: float, q: Array, qd: Array
) -> None:
    """Joint angles (rad) and velocities (rad/s) at a time, written to ``q`` and ``qd``.

    Args:
        coefficients: ``(n, SHAPES)``, rad.
        start, goal: joint angles at rest, ``(n,)``, rad.
        duration: of the motion, s.
        t: time since its start, s; later than its end, the arm rests at the goal.
        q, qd: filled, ``(n,)``.
    """
    s = min(1.0, t / duration)
    x, left = 2.0 * s - 1.0, 1.0 - s
    way, way_slope = s * s * s * (10.0 + s * (-15.0 + 6.0 * s)), 30.0 * s * s * left * left
    window, window_slope = 16.0 * s * s * left * left, 32.0 * s * left * (left - s)
    for i in range(start.shape[0]):
        bend = slope = 0.0
        before, now = 0.0, 1.0  # T_{k-1} and T_k at x
        slope_before, slope_now = 0.0, 0.0
        for k in range(coefficients.shape[1]):
            bend += coefficients[i, k] * now
            slope += coefficients[i, k] * slope_now
            doubled = 1.0 if k == 0 else 2.0
            following = doubled * x * now - before
            slope_following = doubled * (now + x * slope_now) - slope_before
            before, slope_before = (now, slope_now)
            now, slope_now = following, slope_following
        change = goal[i] - start[i]
        q[i] = start[i] + change * way + window * bend
        qd[i] = (change * way_slope + window_slope * bend + 2.0 * window * slope) / duration
