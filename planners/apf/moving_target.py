"""Attraction of the hand to a moving target, within everything that the joints may do.

The hand is seen from the target, along the target's way and across it, so that the target's velocity and acceleration
are feed-forward. Across, the field is linear; along the way it is `planners.apf.attraction`, within the accelerations
``s`` that the joints allow: joint accelerations and torques are affine in ``s``, so every limit of theirs is an
interval of ``s``.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from planners.apf.attraction import attraction, linear_field
from planners.control.joint_limits import project_off_limit, smooth_bounds, worst_excess
from planners.robot.arm import Arm, JointLimits
from planners.robot.dynamics import inverse_dynamics_single, mass_matrix_single
from planners.robot.kinematics import two_link_branch
from planners.typing import Array

BANDWIDTH = 0.24
"""Natural frequency of the linear field times the control period."""

RESERVE = 0.95
"""Share of acceleration and jerk that braking counts on: the posture changes on the way."""

TORQUE_SHARE = 0.999
"""Share of the torque limits that is used: the dynamics half a period ahead are a prediction."""

LOOK_AHEAD = 1.0
"""How far ahead the place of the meeting is predicted at most, s."""

_PROJECTIONS = 40


_Pair = tuple[float, float]
_Links = tuple[float, float, float, float]
"""Both links as vectors: x and y of the first, x and y of the second, m."""


class _Model(NamedTuple):
    """The arm for compiled code; ``torque`` to ``jerk`` are limits, ``(2,)``."""

    coupling: Array
    weight: Array
    lengths: Array
    torque: Array
    velocity: Array
    acceleration: Array
    jerk: Array


class _Target(NamedTuple):
    """Position (from the arm's base), velocity and acceleration of the target, ``(2,)``."""

    position: Array
    velocity: Array
    acceleration: Array


class _Response(NamedTuple):
    """Joint accelerations ``still + slope s``, and the torques ``bias + mass (still + slope s)`` they need."""

    still: _Pair
    slope: _Pair
    mass: Array
    bias: Array


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
    """Joint accelerations that the field asks for.

    Args:
        arm: with two links.
        q, qd: joint angles and velocities, ``(batch, 2)``.
        qdd: mean joint accelerations of the last control period, ``(batch, 2)``: what jerk is counted from. Better
            those that were asked for than those that were measured: with an unknown payload the two differ, and counted
            from what has fallen short the field cannot build up its force.
        target: position, velocity and acceleration of the target, each ``(batch, 2)``, m, m/s, m/s^2.
        period: control period, s.
        bandwidth: natural frequency of the field close to the target, rad/s; `BANDWIDTH` / period by default.
        limits: what the joints may do; the arm's own by default. Joint ranges are not looked at.

    Returns:
        Mean joint accelerations over the next period, ``(batch, 2)``, rad/s^2. They are always within `smooth_bounds`,
        which keep the limits of velocity, acceleration and jerk; and within those of torque as far as these allow.

    Raises:
        ValueError: if the arm does not have two links, or period or bandwidth are not positive.
    """
    if arm.n_joints != 2:
        raise ValueError(f"{arm.name} has {arm.n_joints} links; the hand's field is written for arms with two")
    bandwidth = BANDWIDTH / period if bandwidth is None and period > 0.0 else bandwidth
    if not (period > 0.0 and bandwidth is not None and bandwidth > 0.0):
        raise ValueError(f"period {period} s and bandwidth {bandwidth} rad/s must be positive")
    allowed = limits or arm.limits
    model = _Model(
        *arm.chain_constants,
        arm.length_array,
        TORQUE_SHARE * np.array(allowed.torque),
        np.array(allowed.velocity),
        np.array(allowed.acceleration),
        np.array(allowed.jerk),
    )
    q, qd, qdd, position, velocity, acceleration = (
        np.ascontiguousarray(array, dtype=float) for array in (q, qd, qdd, target[0] - arm.base_array, *target[1:])
    )
    out = np.empty_like(q)
    _approach(model, q, qd, qdd, _Target(position, velocity, acceleration), period, bandwidth, out)
    return out


@njit(cache=True, nogil=True)
def _approach(
    model: _Model, q: Array, qd: Array, qdd: Array, target: _Target, period: float, bandwidth: float, out: Array
) -> None:
    for row in range(q.shape[0]):
        seen = _Target(target.position[row], target.velocity[row], target.acceleration[row])
        _approach_single(model, q[row], qd[row], qdd[row], seen, period, bandwidth, out[row])


@njit(cache=True, nogil=True)
def _approach_single(
    model: _Model, q: Array, qd: Array, qdd: Array, target: _Target, period: float, bandwidth: float, out: Array
) -> None:
    lower, upper = np.empty(2), np.empty(2)
    for i in range(2):
        lower[i], upper[i] = smooth_bounds(
            qd[i], qdd[i], period, model.velocity[i], model.acceleration[i], model.jerk[i]
        )
    way = _direction(target)
    x, v, y, vy = _seen_from_target(model, q, qd, target, way)
    vy += period * linear_field(y, vy, period, bandwidth)
    now = _response_now(model, q, qd, qdd, target, way, v, vy, period)
    lowest, highest = _room(now, lower, upper, model.torque)
    if lowest > highest:
        lowest = highest = 0.5 * (lowest + highest)
    later = _response_at_meeting(model, q, target, way, x, v)
    braking, jerk = _braking(model, now, later)
    s = attraction(x, v, (lowest, highest), braking, jerk, period, bandwidth)
    for i in range(2):
        out[i] = min(upper[i], max(lower[i], now.still[i] + now.slope[i] * s))
    _fit_torque(now, model.torque, lower, upper, out)


@njit(cache=True, nogil=True)
def _direction(target: _Target) -> _Pair:
    """Unit vector of the target's way; any will do for a target at rest."""
    speed = math.hypot(target.velocity[0], target.velocity[1])
    if speed < 1e-9:
        return 1.0, 0.0
    return target.velocity[0] / speed, target.velocity[1] / speed


@njit(cache=True, nogil=True)
def _seen_from_target(
    model: _Model, q: Array, qd: Array, target: _Target, way: _Pair
) -> tuple[float, float, float, float]:
    """The hand relative to the target: position and velocity along its way, then both across it."""
    links = _links(model.lengths, q[0], q[1])
    vx, vy = _hand_velocity(links, qd[0], qd[1])
    vx, vy = vx - target.velocity[0], vy - target.velocity[1]
    x, y = links[0] + links[2] - target.position[0], links[1] + links[3] - target.position[1]
    ux, uy = way
    return ux * x + uy * y, ux * vx + uy * vy, ux * y - uy * x, ux * vy - uy * vx


@njit(cache=True, nogil=True)
def _response_now(
    model: _Model, q: Array, qd: Array, qdd: Array, target: _Target, way: _Pair, v: float, vy: float, period: float
) -> _Response:
    """The next period, for a hand that has the velocity ``v`` along the way and ``vy`` across it at its end if s = 0.

    Velocities are met in the posture predicted for the end of the period, and so without drift.
    """
    ux, uy = way
    half, then = np.empty(2), np.empty(2)
    for i in range(2):
        half[i] = q[i] + 0.5 * period * qd[i]
        then[i] = q[i] + period * (qd[i] + 0.5 * period * qdd[i])
    links = _links(model.lengths, then[0], then[1])
    w1, w2 = _joint_velocities(
        links,
        target.velocity[0] + period * target.acceleration[0] + ux * v - uy * vy,
        target.velocity[1] + period * target.acceleration[1] + uy * v + ux * vy,
    )
    still = (w1 - qd[0]) / period, (w2 - qd[1]) / period
    return _response(model, half, qd + 0.5 * period * qdd, still, _joint_velocities(links, ux, uy))


@njit(cache=True, nogil=True)
def _response_at_meeting(model: _Model, q: Array, target: _Target, way: _Pair, x: float, v: float) -> _Response:
    """Riding with the target, where the hand will come to rest relative to it."""
    # Braking evenly to rest takes twice as long as the way does at the present velocity.
    t = min(LOOK_AHEAD, -2.0 * x / v) if x * v < 0.0 else 0.0
    px = target.position[0] + t * (target.velocity[0] + 0.5 * t * target.acceleration[0])
    py = target.position[1] + t * (target.velocity[1] + 0.5 * t * target.acceleration[1])
    q1, q2 = two_link_branch(model.lengths[0], model.lengths[1], px, py, q[1])
    if math.isnan(q1):
        q1, q2 = q[0], q[1]
    links = _links(model.lengths, q1, q2)
    w1, w2 = _joint_velocities(
        links, target.velocity[0] + t * target.acceleration[0], target.velocity[1] + t * target.acceleration[1]
    )
    still = _joint_velocities(
        links,
        target.acceleration[0] + links[0] * w1**2 + links[2] * (w1 + w2) ** 2,
        target.acceleration[1] + links[1] * w1**2 + links[3] * (w1 + w2) ** 2,
    )
    slope = _joint_velocities(links, way[0], way[1])
    return _response(model, np.array([q1, q2]), np.array([w1, w2]), still, slope)


@njit(cache=True, nogil=True)
def _response(model: _Model, q: Array, qd: Array, still: _Pair, slope: _Pair) -> _Response:
    mass, bias = np.empty((2, 2)), np.empty(2)
    mass_matrix_single(model.coupling, q, mass)
    inverse_dynamics_single(model.coupling, model.weight, q, qd, np.zeros(2), bias)
    return _Response(still, slope, mass, bias)


@njit(cache=True, nogil=True)
def _braking(model: _Model, now: _Response, later: _Response) -> tuple[_Pair, float]:
    """What braking can count on in both postures: lowest and highest acceleration along the way, and jerk."""
    lowest, highest, jerk = -math.inf, math.inf, math.inf
    for response in (now, later):
        low, high = _room(response, -model.acceleration, model.acceleration, model.torque)
        lowest, highest = max(lowest, low), min(highest, high)
        for i in range(2):
            if response.slope[i] != 0.0:
                jerk = min(jerk, model.jerk[i] / abs(response.slope[i]))
    weakest = 1e-3  # m/s^2: where the limits do not even allow to ride along, let there be a field all the same
    return (min(-weakest, RESERVE * lowest), max(weakest, RESERVE * highest)), RESERVE * jerk


@njit(cache=True, nogil=True)
def _room(response: _Response, lower: Array, upper: Array, torque: Array) -> _Pair:
    """The interval of s that bounds of joint accelerations and torques leave; empty if its ends are in reverse."""
    lowest, highest = -math.inf, math.inf
    for i in range(2):
        row = response.mass[i]
        force = response.bias[i] + row[0] * response.still[0] + row[1] * response.still[1]
        slope = row[0] * response.slope[0] + row[1] * response.slope[1]
        lowest, highest = _narrowed(lowest, highest, response.still[i], response.slope[i], lower[i], upper[i])
        lowest, highest = _narrowed(lowest, highest, force, slope, -torque[i], torque[i])
    return lowest, highest


@njit(cache=True, nogil=True)
def _narrowed(lowest: float, highest: float, offset: float, slope: float, low: float, high: float) -> _Pair:
    """The part of an interval of s in which ``low <= offset + slope s <= high``."""
    if abs(slope) < 1e-12:
        return lowest, highest
    first, second = (low - offset) / slope, (high - offset) / slope
    return max(lowest, min(first, second)), min(highest, max(first, second))


@njit(cache=True, nogil=True)
def _fit_torque(response: _Response, torque: Array, lower: Array, upper: Array, qdd: Array) -> None:
    """Move accelerations towards the torque limits, and back into their bounds, by projections in turn."""
    tau = np.empty(2)
    for _ in range(_PROJECTIONS):
        for i in range(2):
            tau[i] = response.bias[i] + response.mass[i, 0] * qdd[0] + response.mass[i, 1] * qdd[1]
        worst, excess = worst_excess(tau, torque)
        if excess == 0.0:
            return
        project_off_limit(response.mass[worst], excess, lower, upper, qdd)


@njit(cache=True, nogil=True)
def _links(lengths: Array, q1: float, q2: float) -> _Links:
    return (
        lengths[0] * math.cos(q1),
        lengths[0] * math.sin(q1),
        lengths[1] * math.cos(q1 + q2),
        lengths[1] * math.sin(q1 + q2),
    )


@njit(cache=True, nogil=True)
def _hand_velocity(links: _Links, w1: float, w2: float) -> _Pair:
    x1, y1, x2, y2 = links
    return -y1 * w1 - y2 * (w1 + w2), x1 * w1 + x2 * (w1 + w2)


@njit(cache=True, nogil=True)
def _joint_velocities(links: _Links, vx: float, vy: float) -> _Pair:
    """The inverse of `_hand_velocity`, bounded close to a stretched or folded arm."""
    x1, y1, x2, y2 = links
    area = x1 * y2 - y1 * x2
    area = math.copysign(max(abs(area), 1e-3 * math.sqrt((x1 * x1 + y1 * y1) * (x2 * x2 + y2 * y2))), area)
    return (x2 * vx + y2 * vy) / area, (-(x1 + x2) * vx - (y1 + y2) * vy) / area
