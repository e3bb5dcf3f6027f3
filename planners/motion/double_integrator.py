"""Time-optimal motions of one joint with limited velocity and acceleration, in closed form.

Every motion here accelerates to a speed, cruises, and brakes to rest. A double integrator's time-optimal motion to rest
has this shape: L. Biagiotti and C. Melchiorri, *Trajectory Planning for Automatic Machines and Robots*, 2008, ch. 3.
"""

from __future__ import annotations

import math

from numba import njit

from planners.compiled.calls import private
from planners.typing import Array

RISE, CRUISE, BRAKE, SPEED = range(4)
"""Columns of a profile: duration of each phase, s, and the velocity of the cruise, rad/s."""

BISECTIONS = 48


@njit(cache=True, nogil=True)
def rest_time(distance: float, v: float, top: float, a: float) -> float:
    """Least time to rest, s.

    Args:
        distance: signed, to where the joint comes to rest, rad.
        v: velocity at the start, rad/s.
        top, a: largest velocity and acceleration, rad/s and rad/s^2.
    """
    peak = _peak(distance, v, top, a)
    if peak == 0.0:
        return abs(v) / a
    return _phases(distance, v, peak, a)


@private
def entry_time(q: float, v: float, low: float, high: float, top: float, a: float) -> float:
    """Least time, s, after which a joint can stay in ``[low, high]``, not necessarily at rest.

    Args:
        q, v: angle and velocity at the start, rad and rad/s.
        low, high: the interval, rad.
        top, a: largest velocity and acceleration, rad/s and rad/s^2.
    """
    stop = q + 0.5 * v * abs(v) / a
    if low <= q <= high and low <= stop <= high:
        return 0.0
    if stop > high or (q > high and stop >= low):  # from above: mirror
        q, v, low, high = -q, -v, -high, -low
    room = math.sqrt(2.0 * a * (high - low))  # largest speed to brake from inside
    arrival = math.sqrt(max(0.0, v * v + 2.0 * a * (low - q)))
    if arrival <= min(room, top):
        return (arrival - v) / a
    if top <= room:
        rising = (top * top - v * v) / (2.0 * a)
        return (top - v) / a + (low - q - rising) / top
    return rest_time(high - q, v, top, a) - room / a


@njit(cache=True, nogil=True)
def fill_profile(distance: float, v: float, top: float, a: float, duration: float, profile: Array) -> None:
    """A motion to rest ``distance`` away that takes ``duration``, s, or the least time if that is longer.

    Written to ``profile``, ``(4,)``: see `RISE`. The least time if no motion of this shape takes ``duration``.
    """
    quickest = rest_time(distance, v, top, a)
    speed = _peak(distance, v, top, a)
    profile[RISE], profile[BRAKE], profile[SPEED] = abs(speed - v) / a, abs(speed) / a, speed
    profile[CRUISE] = max(0.0, quickest - profile[RISE] - profile[BRAKE])
    if duration <= quickest:
        return
    low, high = max(-top, 0.5 * (v - a * duration)), min(top, 0.5 * (v + a * duration))
    if not _covered(low, v, a, duration) <= distance <= _covered(high, v, a, duration):
        return
    for _ in range(BISECTIONS):  # the distance grows with the speed
        speed = 0.5 * (low + high)
        if _covered(speed, v, a, duration) < distance:
            low = speed
        else:
            high = speed
    profile[RISE], profile[BRAKE], profile[SPEED] = abs(speed - v) / a, abs(speed) / a, speed
    profile[CRUISE] = max(0.0, duration - profile[RISE] - profile[BRAKE])


@njit(cache=True, nogil=True)
def along_profile(profile: Array, v: float, a: float, t: float) -> tuple[float, float, float]:
    """Distance (rad), velocity and acceleration at time ``t`` (s) of a profile that starts with velocity ``v``."""
    rise, cruise, brake, speed = profile
    if t < rise:
        acceleration = math.copysign(a, speed - v)
        return t * (v + 0.5 * acceleration * t), v + acceleration * t, acceleration
    way = 0.5 * rise * (v + speed)
    t -= rise
    if t < cruise:
        return way + speed * t, speed, 0.0
    way += speed * cruise
    t -= cruise
    if t < brake:
        acceleration = -math.copysign(a, speed)
        return way + t * (speed + 0.5 * acceleration * t), speed + acceleration * t, acceleration
    return way + 0.5 * speed * brake, 0.0, 0.0


@private
def _peak(distance: float, v: float, top: float, a: float) -> float:
    """Signed cruise (or peak) velocity of the fastest motion to rest."""
    beyond = distance - 0.5 * v * abs(v) / a  # of where braking at once ends
    if beyond == 0.0:
        return v
    square = a * math.copysign(1.0, beyond) * distance + 0.5 * v * v
    return math.copysign(min(top, math.sqrt(max(0.0, square))), beyond)


@private
def _phases(distance: float, v: float, speed: float, a: float) -> float:
    """Duration of a motion that cruises with ``speed`` (not 0)."""
    rise, brake = abs(speed - v) / a, abs(speed) / a
    cruise = (distance - 0.5 * rise * (v + speed) - 0.5 * brake * speed) / speed
    return rise + max(0.0, cruise) + brake


@private
def _covered(speed: float, v: float, a: float, duration: float) -> float:
    """Distance of a motion that cruises with ``speed`` and comes to rest after ``duration``."""
    rise, brake = abs(speed - v) / a, abs(speed) / a
    return 0.5 * rise * (v + speed) + speed * (duration - rise - brake) + 0.5 * brake * speed
