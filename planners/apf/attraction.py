"""Attraction along one direction: as strong as acceleration and jerk allow, no stronger than can be braked.

O. Khatib, "Real-time obstacle avoidance for manipulators and mobile robots" (1986), attracts by the force of a
parabolic well, here ``U = w^2 x^2 / 2``, damped by the velocity (eq 13, 14), and caps the velocity that the well may
build up (eq 15 to 17). So does this field, but its cap is not a constant. It is the velocity that can be shed before
the goal, with a limited acceleration and jerk. Were jerk free, and A the limit of the acceleration, the field would
saturate to a conic well, ``U = A |x|``, whose whole depth is kept for braking: ``v^2 / 2 <= A |x|``.

The damping ratio is 1 / sqrt 2, because then ``w^2 x + sqrt 2 w v`` takes the value A on the curve
``v^2 / 2 = A |x|`` and at one point of it, to which it is tangent: the conic well hands over to the parabolic one
without a step of the force. With more damping the linear field would brake earlier than needed. Of the 4 % of its way
by which the linear field alone would overshoot, the cap leaves less than half.
"""

from __future__ import annotations

import math

from numba import njit

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
    """Acceleration of the field along one direction for the next period, m/s^2 (or in radians, as everything here).

    Args:
        x, v: position and velocity as seen from the goal, m, m/s.
        possible: lowest and highest acceleration in the next period, m/s^2.
        braking: lowest and highest acceleration later on, negative and positive, m/s^2.
        jerk: largest jerk later on, m/s^3.
        period: control period, s.
        bandwidth: natural frequency w of the linear field, rad/s.

    Returns:
        That of `linear_field` if it is possible and the motion can be brought to rest before the goal;
        otherwise the nearest of which that is true, or else the strongest braking.
    """
    s = min(possible[1], max(possible[0], linear_field(x, v, period, bandwidth)))
    beyond = -1.0 if x > 0.0 else 1.0  # direction of the side that must not be reached
    if beyond * _rest(x, v, s, braking, jerk, period) <= 0.0:
        return s
    enough = abs(s) + 2.0 * abs(v) / period  # turns the motion round within the period
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


@njit(cache=True, nogil=True)
def linear_field(x: float, v: float, period: float, bandwidth: float) -> float:
    """Acceleration of ``x'' = -w^2 x - 2 zeta w x'``, with the gains of a motion that is sampled.

    Held for every next period, it puts the poles of the samples at ``exp(w T (-zeta +- i sqrt(1 - zeta^2)))``, where
    samples of the continuous motion have them, however long the period is.

    Args:
        x, v: position and velocity as seen from the goal, m, m/s.
        period: control period T, s.
        bandwidth: natural frequency w, rad/s.
    """
    shrink = math.exp(-DAMPING_RATIO * bandwidth * period)
    turn = math.sqrt(1.0 - DAMPING_RATIO**2) * bandwidth * period
    total, product = 2.0 * shrink * math.cos(turn), shrink * shrink
    stiffness = (1.0 - total + product) / period**2
    damping = (3.0 - total - product) / (2.0 * period)
    return -stiffness * x - damping * v


@njit(cache=True, nogil=True)
def braking_distance(v: float, a: float, braking: tuple[float, float], jerk: float) -> float:
    """Signed way to rest in least time.

    The acceleration goes at full jerk to ``-p``, stays there, and goes back to zero as the velocity does;
    without a limit of the acceleration ``p^2 = jerk v + a^2 / 2``.

    Args:
        v, a: velocity and acceleration at the start, m/s and m/s^2.
        braking: lowest and highest acceleration, negative and positive, m/s^2.
        jerk: largest jerk; may be infinite, m/s^3.

    Returns:
        Metres; grows with ``v`` and with ``a``.
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
    way = turning * (v + turning * (0.5 * a - jerk * turning / 6.0))
    way += held * (v_held - 0.5 * p * held)
    return sign * (way + p**3 / (6.0 * jerk * jerk))


@njit(cache=True, nogil=True)
def _rest(x: float, v: float, s: float, braking: tuple[float, float], jerk: float, period: float) -> float:
    """Where rest can be reached at the earliest after one period of acceleration ``s``."""
    return x + (v + 0.5 * s * period) * period + braking_distance(v + s * period, s, braking, jerk)
