"""Accelerations for the next control period that keep the limits of every joint.

Bounds follow from velocity, acceleration and jerk limits (`smooth_bounds`) and from the joint's range
(`stoppable_velocities`). Torque limits are kept by scaling (`within_torque`, `scale_into_torque`) or by projection
(`worst_excess`, `project_off_limit`).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from planners.checks import float_rows
from planners.compiled.calls import private
from planners.control.tracking import held_torque, held_torque_single
from planners.robot.arm import Arm
from planners.typing import Array

TORQUE_SHARE, VELOCITY_SHARE = 0.98, 0.998
"""Shares of the torque and velocity limits that are used: at a constant acceleration the torque varies in a period."""

MOST_PASSES = 20
"""Most times that accelerations are scaled until their torques fit: each leaves a small share of the excess."""

RANGE_MARGIN = 0.01
"""Distance from the ends of its range at which a joint stops, rad."""

TORQUE_SLACK = 1e-5
"""Share of a torque limit by which a projection may exceed it."""

LIGHTEST = 1e-140
"""Inertia, kg m^2, down to which squares are computed as they are, and up to its inverse."""


@private
def smooth_bounds(
    speed: float, acceleration: float, period: float, speed_limit: float, acceleration_limit: float, jerk_limit: float
) -> tuple[float, float]:
    """Accelerations of one joint for the next period that let it keep velocity, acceleration and jerk limits after it.

    ``acceleration`` is the mean over the last period; limits may be infinite. Lowest and highest, rad/s^2. If no
    acceleration keeps all limits, velocity is violated first, jerk last.
    """
    step = jerk_limit * period
    lowest = max(-acceleration_limit, acceleration - step)
    highest = min(acceleration_limit, acceleration + step)
    upper = _largest_safe_acceleration(speed_limit - speed, period, jerk_limit)
    lower = -_largest_safe_acceleration(speed_limit + speed, period, jerk_limit)
    return min(highest, max(lowest, lower)), max(lowest, min(highest, upper))


@private
def _largest_safe_acceleration(speed_left: float, period: float, jerk_limit: float) -> float:
    """The largest acceleration that full jerk J brings to zero before the remaining speed is used up.

    Going from an acceleration a to zero in steps of one period T adds at most a^2 / (2 J) + a T / 2 + J T^2 / 8 to the
    speed, this period included, and a T if one step is enough.
    """
    if math.isinf(speed_left):
        return speed_left
    step = jerk_limit * period
    if speed_left <= step * period:
        return speed_left / period
    return math.sqrt(2.0 * jerk_limit * speed_left) - 0.5 * step


@private
def stoppable_velocities(q: float, qd: float, end: float, braking: float, period: float) -> tuple[float, float]:
    """Lowest and highest velocity of one joint at the end of a period from which it can still stop within its range.

    ``q, qd`` are angle, from the middle of its range, and velocity at its start. The joint stops `RANGE_MARGIN` before
    either end, ``end`` rad from the middle, by a deceleration of ``braking`` rad/s^2.
    """
    end = end - RANGE_MARGIN
    return -_braked_in_time(end + q, -qd, braking, period), _braked_in_time(end - q, qd, braking, period)


@private
def _braked_in_time(room: float, v: float, a: float, period: float) -> float:
    """The largest velocity w at the end of a period, begun with velocity v, from which a joint stops within its room.

    It solves ``(v + w) T / 2 + w^2 / (2 a) = room``.
    """
    left = room - 0.5 * v * period
    half = 0.5 * a * period
    return math.sqrt(half * half + 2.0 * a * left) - half if left > 0.0 else -v


@private
def share_within(still: float, wanted: float, limit: float) -> float:
    """Largest share of an acceleration whose torque keeps the limit of one joint; 0 where even zero exceeds it.

    ``still`` and ``wanted`` are the torques with zero and with the full acceleration, N m.
    """
    if abs(wanted) <= limit:
        return 1.0
    limit = math.copysign(limit, wanted)
    return max(0.0, (limit - still) / (wanted - still)) if wanted != still else 0.0


@njit(cache=True, nogil=True)
def _share_of_all(still: Array, wanted: Array, limit: Array, used: float) -> float:
    """`share_within` of all joints, ``(n,)`` each, for a share ``used`` of their limits; at most 1."""
    share = 1.0
    for i in range(still.shape[0]):
        share = min(share, share_within(still[i], wanted[i], used * limit[i]))
    return share


def within_torque(arm: Arm, q: Array, qd: Array, qdd: Array, period: float) -> Array:
    """Accelerations scaled down, row by row, until the torques held for a period fit the arm's limits.

    ``qdd`` are the desired mean accelerations over the period, ``(batch, n)``, rad/s^2. Where even zero acceleration
    exceeds a limit, they are scaled until they exceed none by more than zero does: to zero, if they add to what is too
    much. A shape that does not fit is a ValueError.
    """
    q, qd, qdd = float_rows(arm.n_joints, q=q, qd=qd, qdd=qdd)
    limit = np.array(arm.limits.torque)
    still, fitting = held_torque(arm, q, qd, np.zeros_like(qdd), period), qdd.copy()
    for _ in range(MOST_PASSES):  # centrifugal torques half a period ahead are quadratic in the accelerations
        wanted = held_torque(arm, q, qd, fitting, period)
        shares = [_share_of_all(*torques, limit, 1.0) for torques in zip(still, wanted, strict=True)]
        if min(shares, default=1.0) == 1.0:
            break
        fitting *= np.array(shares)[:, None]
    return fitting


@private
def scale_into_torque(
    coupling: Array, weight: Array, q: Array, qd: Array, period: float,
    limit: Array, used: float, passes: int, qdd: Array, tau: Array,
) -> None:  # fmt: skip
    """Scale one row of desired mean accelerations ``qdd`` in place until the torques held for a period fit.

    Centrifugal torques half a period ahead are quadratic in the accelerations: hence several ``passes``. ``used`` is
    the share of the limits that is used. ``qdd`` becomes zero where even zero exceeds a limit; ``tau`` is filled with
    the torques of the scaled accelerations.
    """
    held_torque_single(coupling, weight, q, qd, qdd, period, tau)
    if _share_of_all(tau, tau, limit, used) == 1.0:  # the common case, without the torques at rest
        return
    still = np.empty(q.shape[0])
    held_torque_single(coupling, weight, q, qd, np.zeros(q.shape[0]), period, still)
    for _ in range(passes):
        share = _share_of_all(still, tau, limit, used)
        if share == 1.0:
            return
        for i in range(q.shape[0]):
            qdd[i] *= share
        held_torque_single(coupling, weight, q, qd, qdd, period, tau)


@private
def worst_excess(tau: Array, limit: Array) -> tuple[int, float]:
    """The joint whose torque is furthest beyond its limit and by how much, N m (signed); 0 within `TORQUE_SLACK`."""
    worst, excess = 0, 0.0
    for i in range(tau.shape[0]):
        beyond = tau[i] - min(limit[i], max(-limit[i], tau[i]))
        if abs(beyond) > abs(excess):
            worst, excess = i, beyond
    return worst, 0.0 if abs(excess) <= TORQUE_SLACK * limit[worst] else excess


@private
def project_off_limit(row: Array, excess: float, lower: Array, upper: Array, qdd: Array) -> None:
    """Remove a joint's excess torque (N m) by the least change of the accelerations ``qdd``, in place within bounds.

    ``row`` is the joint's row of the mass matrix, kg m^2; ``lower`` and ``upper`` bound ``qdd``, all ``(n,)``.
    """
    largest = 0.0
    for i in range(row.shape[0]):
        largest = max(largest, abs(row[i]))
    if largest == 0.0:  # no acceleration changes the torque
        return
    unit = 1.0 if LIGHTEST < largest < 1.0 / LIGHTEST else largest
    scale = 0.0
    for i in range(row.shape[0]):
        scale += (row[i] / unit) ** 2
    for i in range(row.shape[0]):
        qdd[i] = min(upper[i], max(lower[i], qdd[i] - row[i] / unit * (excess / unit) / scale))
