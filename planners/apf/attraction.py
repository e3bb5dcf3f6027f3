"""Attraction along one direction within limits of acceleration and jerk, without overshoot.

O. Khatib, "Real-time obstacle avoidance for manipulators and mobile robots" (1986), attracts by the parabolic potential
``U = w^2 x^2 / 2``, damped by the velocity (eq 13, 14), and limits the velocity (eq 15 to 17). Here the limit is the
velocity that can be braked before the goal with limited acceleration and jerk. With unlimited jerk and the acceleration
limit A the potential saturates to a conic one, ``U = A |x|``, with ``v^2 / 2 <= A |x|``.

With the damping ratio 1 / sqrt 2 the line ``w^2 x + sqrt 2 w v = A`` is tangent to the curve ``v^2 / 2 = A |x|``, so
that the force does not jump between the two; more damping brakes earlier than needed. The linear field alone overshoots
by 4 %, with the velocity limit by less than half of that.
"""

from __future__ import annotations

import math

from numba import njit

from planners.compiled.calls import private

DAMPING_RATIO = math.sqrt(0.5)
"""Of the linear field."""

_BISECTIONS = 12


@njit(cache=True, nogil=True)
def attraction(
    x: float,
    v: float,
    possible: tuple[float, float],
    braking: tuple[float, float],
    jerk: float,
    period: float,
    bandwidth: float,
) -> float:
    """Acceleration of the field along one direction for the next period, m/s^2 (or all in radians).

    Args:
        x, v: position and velocity relative to the goal, m, m/s.
        possible: lowest and highest acceleration in the next period, m/s^2.
        braking: lowest and highest acceleration after that, negative and positive, m/s^2.
        jerk: largest jerk after that, m/s^3.
        period: control period, s.
        bandwidth: natural frequency w of the linear field, rad/s.

    Returns:
        That of `linear_field` if it is possible and the motion can still stop before the goal; otherwise the nearest
        acceleration with that property, or else the strongest braking.
    """
    s = min(possible[1], max(possible[0], linear_field(x, v, period, bandwidth)))
    beyond = -1.0 if x > 0.0 else 1.0  # sign of the positions beyond the goal
    if beyond * _rest(x, v, s, braking, jerk, period) <= 0.0:
        return s
    enough = abs(s) + 2.0 * abs(v) / period  # reverses the motion within the period
    hardest = max(possible[0], -enough) if beyond > 0.0 else min(possible[1], enough)
    if beyond * _rest(x, v, hardest, braking, jerk, period) >= 0.0:
        return hardest
    for _ in range(_BISECTIONS):
        middle = 0.5 * (s + hardest)
        if beyond * _rest(x, v, middle, braking, jerk, period) > 0.0:
            s = middle
        else:
            hardest = middle
    return hardest


@private
def linear_field(x: float, v: float, period: float, bandwidth: float) -> float:
    """Acceleration of ``x'' = -w^2 x - 2 zeta w x'`` in its exact form for a sampled motion.

    Held for a period T each, it puts the poles of the samples at ``exp(w T (-zeta +- i sqrt(1 - zeta^2)))``, those of
    the continuous motion, for any ``period`` T, s. Position ``x`` and velocity ``v`` are relative to the goal;
    ``bandwidth`` is the natural frequency w, rad/s.
    """
    shrink = math.exp(-DAMPING_RATIO * bandwidth * period)
    turn = math.sqrt(1.0 - DAMPING_RATIO**2) * bandwidth * period
    total, product = 2.0 * shrink * math.cos(turn), shrink * shrink
    stiffness = (1.0 - total + product) / period**2
    damping = (3.0 - total - product) / (2.0 * period)
    return -stiffness * x - damping * v


@private
def braking_distance(v: float, a: float, braking: tuple[float, float], jerk: float) -> float:
    """Signed distance of the stop in least time, m; it grows with ``v`` and with ``a``.

    The acceleration goes at full jerk to ``-p``, stays there, and goes back to zero together with the velocity;
    without a limit of the acceleration ``p^2 = jerk v + a^2 / 2``. ``v`` and ``a`` are velocity and acceleration at the
    start, ``braking`` and ``jerk`` (may be infinite) as in `attraction`.
    """
    if math.isinf(jerk):
        return 0.5 * v * abs(v) / (-braking[0] if v > 0.0 else braking[1])
    sign = 1.0 if v + 0.5 * a * abs(a) / jerk >= 0.0 else -1.0
    v, a = sign * v, sign * a
    strongest = max(-braking[0] if sign > 0.0 else braking[1], -a)
    p, held = math.sqrt(max(0.0, jerk * v + 0.5 * a * a)), 0.0
    if p > strongest:
        held = (p * p / strongest - strongest) / jerk
        p = strongest
    turning = (a + p) / jerk
    v_held = v + turning * (a - 0.5 * jerk * turning)
    distance = turning * (v + turning * (0.5 * a - jerk * turning / 6.0))
    distance += held * (v_held - 0.5 * p * held)
    return sign * (distance + p**3 / (6.0 * jerk * jerk))


@private
def _rest(x: float, v: float, s: float, braking: tuple[float, float], jerk: float, period: float) -> float:
    """Position of the earliest stop after one period of acceleration ``s``."""
    return x + (v + 0.5 * s * period) * period + braking_distance(v + s * period, s, braking, jerk)
