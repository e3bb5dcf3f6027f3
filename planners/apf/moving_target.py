"""Attraction of the hand to a moving target within all limits of the joints.

The hand is described relative to the target, along the target's path and across it, so that the target's velocity and
acceleration are feed-forward. A third link keeps its orientation. In both directions the field is
`planners.apf.attraction`: across the path within a share of what the limits of the joints allow, and along it within
what is left for the next period.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from planners.apf.attraction import attraction
from planners.apf.hand_response import (
    ArmModel,
    Pair,
    Response,
    Target,
    braking_limits,
    fit_torque,
    interval,
    links_at_end,
    response_at_meeting,
    response_in,
    velocity_changes,
)
from planners.checks import float_rows, require_shape
from planners.compiled.calls import private
from planners.control.joint_limits import smooth_bounds
from planners.robot.arm import Arm, JointLimits
from planners.robot.kinematics import hand_state_single
from planners.typing import Array

BANDWIDTH = 0.24
"""Natural frequency of the linear field times the control period."""

TORQUE_SHARE = 0.999
"""Share of the torque limits that is used: the dynamics half a period ahead are a prediction."""

_ACROSS = 0.8
"""Share of the limits that the field across the path uses; along the path it has what is left."""


def approach(
    arm: Arm,
    q: Array,
    qd: Array,
    qdd: Array,
    target: tuple[Array, Array, Array],
    period: float,
    bandwidth: float | None = None,
    limits: JointLimits | None = None,
) -> Array:
    """Joint accelerations of the field.

    Args:
        arm: with two or three links.
        q, qd: joint angles and velocities, ``(batch, n)``.
        qdd: mean joint accelerations of the last control period, ``(batch, n)``, for the jerk: commanded ones, since
            with an unknown payload the measured ones are too small for the field to build up its force.
        target: position, velocity and acceleration of the target, each ``(batch, 2)``, m, m/s, m/s^2.
        period: control period, s.
        bandwidth: natural frequency of the field close to the target, rad/s; `BANDWIDTH` / period by default.
        limits: of the joints, except for their ranges; the arm's own by default.

    Returns:
        Mean joint accelerations over the next period, ``(batch, n)``, rad/s^2, within `smooth_bounds` (velocity,
        acceleration and jerk), and within the torque limits as far as these allow.

    Raises:
        ValueError: if the arm does not have two or three links, or period or bandwidth are not positive, or a
            shape does not fit.
    """
    if arm.n_joints not in (2, 3):
        raise ValueError(f"{arm.name} has {arm.n_joints} links; the field of the hand is for arms with two or three")
    bandwidth = BANDWIDTH / period if bandwidth is None and period > 0.0 else bandwidth
    if not (period > 0.0 and bandwidth is not None and bandwidth > 0.0):
        raise ValueError(f"period {period} s and bandwidth {bandwidth} rad/s must be positive")
    limits = (limits or arm.limits).for_joints(arm.n_joints, arm.name)
    torque, *others = (np.array(getattr(limits, kind)) for kind in ("torque", "velocity", "acceleration", "jerk"))
    model = ArmModel(*arm.chain_constants, arm.length_array, TORQUE_SHARE * torque, *others)
    q, qd, qdd = float_rows(arm.n_joints, q=q, qd=qd, qdd=qdd)
    motion = float_rows(2, position=target[0] - arm.base_array, velocity=target[1], acceleration=target[2])
    require_shape("position", motion[0], (len(q), 2))
    out = np.empty_like(q)
    _approach(model, q, qd, qdd, Target(*motion), period, bandwidth, out)
    return out


@njit(cache=True, nogil=True)
def _approach(
    model: ArmModel, q: Array, qd: Array, qdd: Array, targets: Target, period: float, bandwidth: float, out: Array
) -> None:
    n = q.shape[1]
    lower, upper = np.empty(n), np.empty(n)
    for row in range(q.shape[0]):
        # bounds of the joint accelerations
        for i in range(n):
            lower[i], upper[i] = smooth_bounds(
                qd[row, i], qdd[row, i], period, model.velocity[i], model.acceleration[i], model.jerk[i]
            )
        target = Target(targets.position[row], targets.velocity[row], targets.acceleration[row])
        along = _direction(target)
        across = -along[1], along[0]
        x, v, y, vy = _relative_to_target(model, q[row], qd[row], target, along)
        # across the path: the attraction within a share of the limits
        links = links_at_end(model, q[row], qd[row], qdd[row], period)
        still, slope = velocity_changes(links, qd[row], target, along, (v, vy), across, period)
        now = response_in(model, q[row] + 0.5 * period * qd[row], qd[row] + 0.5 * period * qdd[row], still, slope)
        braking, jerk = braking_limits(model, now, now)
        braking, jerk = (_ACROSS * braking[0], _ACROSS * braking[1]), _ACROSS * jerk
        a = _acceleration(model, q[row], qd[row], qdd[row], target, across)
        possible = (
            max(braking[0], min(a, braking[1]) - jerk * period),
            min(braking[1], max(a, braking[0]) + jerk * period),
        )
        vy += period * attraction(y, vy, possible, braking, jerk, period, bandwidth)
        # along it: the attraction within the limits of the present and of the meeting posture
        still, slope = velocity_changes(links, qd[row], target, along, (v, vy), along, period)
        now = Response(still, slope, now.mass, now.bias)
        lowest, highest = interval(now, lower, upper, model.torque)
        if lowest > highest:
            lowest = highest = 0.5 * (lowest + highest)
        braking, jerk = braking_limits(model, now, response_at_meeting(model, q[row], target, along, x, v))
        s = attraction(x, v, (lowest, highest), braking, jerk, period, bandwidth)
        for i in range(n):
            out[row, i] = min(upper[i], max(lower[i], now.still[i] + now.slope[i] * s))
        fit_torque(now, model.torque, lower, upper, out[row])


@njit(cache=True, nogil=True)
def _direction(target: Target) -> Pair:
    """Unit vector along the target's path; an arbitrary one for a target at rest."""
    speed = math.hypot(target.velocity[0], target.velocity[1])
    if speed < 1e-9:
        return 1.0, 0.0
    return target.velocity[0] / speed, target.velocity[1] / speed


@private
def _relative_to_target(
    model: ArmModel, q: Array, qd: Array, target: Target, along: Pair
) -> tuple[float, float, float, float]:
    """The hand relative to the target: position and velocity along its path, then both across it."""
    hand, velocity = np.empty(2), np.empty(2)
    hand_state_single(model.lengths, np.zeros(2), q, qd, hand, velocity)
    x, y = hand[0] - target.position[0], hand[1] - target.position[1]
    vx, vy = velocity[0] - target.velocity[0], velocity[1] - target.velocity[1]
    ux, uy = along
    return ux * x + uy * y, ux * vx + uy * vy, ux * y - uy * x, ux * vy - uy * vx


@private
def _acceleration(model: ArmModel, q: Array, qd: Array, qdd: Array, target: Target, way: Pair) -> float:
    """The hand's acceleration relative to the target, along a unit vector, m/s^2."""
    angle = speed = change = 0.0
    x, y = -target.acceleration[0], -target.acceleration[1]
    for i in range(q.shape[0]):
        angle, speed, change = angle + q[i], speed + qd[i], change + qdd[i]
        c, s = model.lengths[i] * math.cos(angle), model.lengths[i] * math.sin(angle)
        x -= s * change + c * speed * speed
        y += c * change - s * speed * speed
    along: float = way[0] * x + way[1] * y
    return along
