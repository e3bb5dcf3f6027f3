"""What a joint's velocity, acceleration and jerk limits leave for its acceleration in the next control period."""

from __future__ import annotations

import math

from numba import njit


@njit(cache=True, nogil=True)
def smooth_bounds(
    speed: float, acceleration: float, period: float, speed_limit: float, acceleration_limit: float, jerk_limit: float
) -> tuple[float, float]:
    """The accelerations of one joint for the next period from which all its smoothness limits can still be kept.

    Args:
        speed: now, rad/s.
        acceleration: mean over the last period, rad/s^2.
        period: control period, s.
        speed_limit, acceleration_limit, jerk_limit: may be infinite; rad/s, rad/s^2, rad/s^3.

    Returns:
        Lowest and highest, rad/s^2. Where no acceleration keeps all limits, velocity gives way first, jerk last.
    """
    step = jerk_limit * period
    lowest = max(-acceleration_limit, acceleration - step)
    highest = min(acceleration_limit, acceleration + step)
    upper = _largest_safe_acceleration(speed_limit - speed, period, jerk_limit)
    lower = -_largest_safe_acceleration(speed_limit + speed, period, jerk_limit)
    return min(highest, max(lowest, lower)), max(lowest, min(highest, upper))


@njit(cache=True, nogil=True)
def _largest_safe_acceleration(speed_left: float, period: float, jerk_limit: float) -> float:
    """The largest acceleration that can be shed at full jerk J before it has used up the speed that is left.

    Going from an acceleration a to zero in steps of one period T adds at most a^2 / (2 J) + a T / 2 + J T^2 / 8 to the
    speed, this period included, and a T if one step is enough.
    """
    if math.isinf(speed_left):
        return speed_left
    step = jerk_limit * period
    if speed_left <= step * period:
        return speed_left / period
    return math.sqrt(2.0 * jerk_limit * speed_left) - 0.5 * step
