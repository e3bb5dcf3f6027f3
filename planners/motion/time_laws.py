"""Time laws from rest to rest: the quintic, the quintic bent by Chebyshev polynomials, and the trapezoid of speed.

The bent quintic is, with ``s = t / T``,

    q(s) = q0 + (qf - q0) (10 s^3 - 15 s^4 + 6 s^5) + sum_k c_k w(s) T_k(2 s - 1)

with the window ``w(s) = 16 s^2 (1 - s)^2``, which is 1 half way and, like its slope, 0 at both ends: every vector of
coefficients ``c`` is a motion from rest to rest.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numba.extending import register_jitable

from planners.compiled.calls import private
from planners.typing import Array

SHAPES = 14
"""Chebyshev polynomials T_0 ... T_13 of each joint."""

_WINDOW = np.polynomial.Polynomial([0.0, 0.0, 16.0, -32.0, 16.0])


@register_jitable
def quintic(s: Any) -> tuple[Any, Any, Any]:
    """The quintic ``10 s^3 - 15 s^4 + 6 s^5`` of a share of the duration, with its first two derivatives by s.

    Velocity and acceleration vanish at both ends. Works on numbers and arrays, in compiled code too.
    """
    left = 1.0 - s
    return s * s * s * (10.0 + s * (-15.0 + 6.0 * s)), 30.0 * s * s * left * left, 60.0 * s * left * (1.0 - 2.0 * s)


@register_jitable
def quintic_motion(start: Any, change: Any, duration: Any, s: Any) -> tuple[Any, Any, Any]:
    """Angle (rad), velocity (rad/s) and acceleration (rad/s^2) along a quintic from rest to rest.

    Works on numbers and on arrays that broadcast, in compiled code too.

    Args:
        start: angle at the start, rad.
        change: of the angle over the motion, rad.
        duration: s.
        s: share of the duration.
    """
    q = start + change * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    qd = change / duration * 30.0 * s**2 * (1.0 - s) ** 2
    qdd = change / duration**2 * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s)
    return q, qd, qdd


def stop_motion(velocity: Array, acceleration: Array, duration: float, s: Array) -> tuple[Array, Array, Array]:
    """Angle (rad), velocity (rad/s) and acceleration (rad/s^2) that bring a moving start to rest where it began.

    The quintic of each joint with a given velocity and acceleration at the start and none at the end, ``(samples, n)``.
    Added to a motion from rest to rest, it makes one from the moving start to the same end.

    Args:
        velocity, acceleration: at the start, ``(n,)``, rad/s and rad/s^2.
        duration: s.
        s: shares of the duration, ``(samples, 1)``.
    """
    left = 1.0 - s
    launch = (
        s * left**3 * (1.0 + 3.0 * s),
        left**2 * (1.0 - 3.0 * s) * (1.0 + 5.0 * s),
        -12.0 * s * left * (3.0 - 5.0 * s),
    )
    push = 0.5 * s**2 * left**3, 0.5 * s * left**2 * (2.0 - 5.0 * s), left * (1.0 - 8.0 * s + 10.0 * s**2)
    v, a = duration * velocity, duration**2 * acceleration
    q, qd, qdd = (v * one + a * other for one, other in zip(launch, push, strict=True))
    return q, qd / duration, qdd / duration**2


def shape_functions(s: Array) -> Array:
    """The window times each Chebyshev polynomial, at shares of the duration.

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


@private
def rest_curve_single(
    coefficients: Array, start: Array, goal: Array, duration: float, t: float, q: Array, qd: Array
) -> None:
    """Joint angles (rad) and velocities (rad/s) at a time, written to ``q`` and ``qd``.

    Args:
        coefficients: ``(n, SHAPES)``, rad.
        start, goal: joint angles at rest, ``(n,)``, rad.
        duration: of the motion, s.
        t: time since its start, s; after its end the arm rests at the goal.
        q, qd: filled, ``(n,)``.
    """
    s = min(1.0, t / duration)
    x, left = 2.0 * s - 1.0, 1.0 - s
    share, share_slope, _ = quintic(s)
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
        q[i] = start[i] + change * share + window * bend
        qd[i] = (change * share_slope + window_slope * bend + 2.0 * window * slope) / duration


@njit(cache=True, nogil=True)
def trapezoid(change: Array, velocity: Array, acceleration: Array) -> tuple[float, float]:
    """Fastest straight move in joint space: top speed of its share (1/s) and duration of the ramp to that speed (s).

    The share of the move goes from 0 to 1 in ``1 / top + ramp`` seconds.

    Args:
        change: of each joint over the move, ``(n,)``, rad.
        velocity, acceleration: limits of each joint, ``(n,)``.
    """
    top = rise = 1e9  # nothing moves: at once
    for i in range(change.shape[0]):
        if change[i] != 0.0:
            top = min(top, velocity[i] / abs(change[i]))
            rise = min(rise, acceleration[i] / abs(change[i]))
    top = min(top, math.sqrt(rise))
    return top, top / rise


@njit(cache=True, nogil=True)
def trapezoid_share(top: float, ramp: float, t: float) -> float:
    """Share of a `trapezoid` move done at time ``t``, s."""
    duration = 1.0 / top + ramp
    if t >= duration:
        return 1.0
    if t < ramp:
        return 0.5 * top / ramp * t * t
    if t > duration - ramp:
        left = duration - t
        return 1.0 - 0.5 * top / ramp * (left * left)
    return top * (t - 0.5 * ramp)
