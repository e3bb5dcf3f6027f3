"""A field in joint space that brings the joints to rest at the goal in a given time.

The potential steepens as time runs out. With the error ``e = goal - q`` and the remaining time ``tau``

    q'' = 6 e / tau^2 - 4 q' / tau,

the force of the potential ``U = 3 e^2 / tau^2`` and a damping of ``4 / tau``, moves every joint along the cubic that
reaches rest at the goal in time with the least integral of ``q''^2``. A motion with the least sum of absolute torques
accelerates at once, coasts, and brakes late, so the potential is only used for braking. Before, the joints are driven
to the velocity ``v = e / (tau - t_b / 3)`` and coast until the braking time ``t_b`` is left. Then ``e = 2/3 v tau``,
where the force is zero; from there it grows linearly to ``2 v / t_b`` at the goal, as large as the torques in the
goal's posture allow. This is the velocity servo of O. Khatib, "Real-time obstacle avoidance for manipulators and mobile
robots" (1986), eq 15 to 17, with a largest velocity that follows from the remaining time.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from planners.checks import float_rows
from planners.compiled.calls import private
from planners.control.joint_limits import VELOCITY_SHARE, scale_into_torque
from planners.robot.arm import Arm
from planners.robot.dynamics import inverse_dynamics_single
from planners.typing import Array

BRAKING_SHARE = 0.9
"""Share of the torque and acceleration limits for braking; the rest is for centrifugal torques and disturbances."""

TORQUE_SHARE = 0.999
"""Share of the torque limits that is used: held torques half a period ahead are a prediction."""

_LEAST_BRAKING = 4.0
"""Least number of periods for braking."""

_PASSES = 4

_LEAST_ROOM = 0.1
"""Least share of a torque limit for braking, however much of it gravity takes."""


def reach(arm: Arm, q: Array, qd: Array, goal: Array, time_left: ArrayLike, period: float) -> Array:
    """Joint accelerations of the field.

    Args:
        arm: with any number of links. Moves from rest keep its joint ranges as long as the torque limits do not bend
            their straight lines in joint space.
        q, qd: joint angles and velocities, ``(batch, n)``.
        goal: joint angles to reach, ``(batch, n)``, rad.
        time_left: a number or ``(batch,)``, s; rounded to whole periods.
        period: control period, s.

    Returns:
        Mean joint accelerations over the next period, ``(batch, n)``, rad/s^2, scaled down row by row where they, their
        velocities or their torques would exceed the limits.

    Raises:
        ValueError: if the period is not positive, or a shape does not fit.
    """
    if not period > 0.0:
        raise ValueError(f"period {period} s must be positive")
    q, qd, goal = float_rows(arm.n_joints, q=q, qd=qd, goal=goal)
    periods = np.maximum(1.0, np.rint(np.broadcast_to(np.asarray(time_left, dtype=float), len(q)) / period))
    out = np.empty_like(q)
    torque, velocity, acceleration = (arm.limits.array(kind) for kind in ("torque", "velocity", "acceleration"))
    _reach(*arm.chain_constants, torque, VELOCITY_SHARE * velocity, acceleration, q, qd, goal, periods, period, out)
    return out


@private
def least_acceleration(error: float, speed: float, periods: float, period: float) -> float:
    """Braking acceleration of one joint, held for the next period, in its exact form for sampled motions.

    Of all sequences of accelerations, each held for a period T, that bring a joint to rest at the goal in N periods,
    the one with the least sum of squares begins with ``6 e / (N (N + 1) T^2) - (4 N + 1) qd / (N (N + 1) T)``, with the
    ``error`` e, rad, and the ``speed`` qd, rad/s. With a single period left the joint can only stop.
    """
    if periods < 1.5:
        return -speed / period
    steps = periods * (periods + 1.0) * period
    return (6.0 * error / period - (4.0 * periods + 1.0) * speed) / steps


@njit(cache=True, nogil=True)
def _reach(
    coupling: Array,
    weight: Array,
    torque: Array,
    velocity: Array,
    acceleration: Array,
    q: Array,
    qd: Array,
    goal: Array,
    periods: Array,
    period: float,
    out: Array,
) -> None:
    tau = np.empty(q.shape[1])
    for row in range(q.shape[0]):
        left = periods[row] * period
        braking = _braking_time(coupling, weight, torque, acceleration, q[row], goal[row], left)
        braking = max(braking, _LEAST_BRAKING * period)
        slower = 1.0
        for i in range(q.shape[1]):
            speed = abs(goal[row, i] - q[row, i]) / (left - braking / 3.0)
            if speed > velocity[i]:
                slower = min(slower, velocity[i] / speed)
        share = 1.0
        for i in range(q.shape[1]):
            error = goal[row, i] - q[row, i]
            if left <= braking:
                out[row, i] = least_acceleration(error, qd[row, i], periods[row], period)
            else:
                out[row, i] = (slower * error / (left - braking / 3.0) - qd[row, i]) / period
            if abs(out[row, i]) > acceleration[i]:
                share = min(share, acceleration[i] / abs(out[row, i]))
        if share < 1.0:
            for i in range(q.shape[1]):
                out[row, i] *= share
        scale_into_torque(coupling, weight, q[row], qd[row], period, torque, TORQUE_SHARE, _PASSES, out[row], tau)


@private
def _braking_time(
    coupling: Array, weight: Array, torque: Array, acceleration: Array, q: Array, goal: Array, left: float
) -> float:
    """Braking time t_b, s, for which the torques at the goal use all of the limits that gravity leaves.

    The last deceleration is ``2 v / t_b`` with ``v = e / (tau - t_b / 3)``, so ``t_b^2 / 3 - tau t_b + 2 k = 0`` with
    the least k, s^2, for which ``e / k`` and its torques are within the limits. Infinite if there is no solution.
    """
    n = q.shape[0]
    still, held, inertial = np.zeros(n), np.empty(n), np.empty(n)
    inverse_dynamics_single(coupling, weight, goal, still, still, held)
    inverse_dynamics_single(coupling, weight, goal, still, goal - q, inertial)
    least = 0.0
    for i in range(n):
        room = max(BRAKING_SHARE * torque[i] - abs(held[i]), _LEAST_ROOM * torque[i])
        least = max(least, abs(inertial[i] - held[i]) / room, abs(goal[i] - q[i]) / (BRAKING_SHARE * acceleration[i]))
    square = left * left - 8.0 / 3.0 * least
    return 1.5 * (left - math.sqrt(square)) if square >= 0.0 else math.inf
