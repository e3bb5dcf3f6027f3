"""Attraction of the hand to a moving target within all limits of the joints.

The hand is described relative to the target, along the target's path and across it, so that the target's velocity and
acceleration are feed-forward. A third link keeps its orientation. Across the path the field is linear. Along it the
field is `planners.apf.attraction` within the accelerations ``s`` that the joints allow: joint accelerations and torques
are affine in ``s``, so that each of their limits is an interval of ``s``.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from planners.apf.attraction import attraction, linear_field
from planners.compiled.calls import private
from planners.control.joint_limits import project_off_limit, smooth_bounds, worst_excess
from planners.robot.arm import Arm, JointLimits
from planners.robot.dynamics import inverse_dynamics_single, mass_matrix_single
from planners.robot.kinematics import hand_state_single, two_link_branch
from planners.typing import Array

BANDWIDTH = 0.24
"""Natural frequency of the linear field times the control period."""

RESERVE = 0.95
"""Share of acceleration and jerk for braking: the posture changes during it."""

TORQUE_SHARE = 0.999
"""Share of the torque limits that is used: the dynamics half a period ahead are a prediction."""

LOOK_AHEAD = 1.0
"""Longest prediction of the meeting point, s."""

_WEAKEST = 1e-3
"""Least acceleration for braking, also where the limits do not allow to follow the target, m/s^2."""

_PROJECTIONS = 40

_Pair = tuple[float, float]


class _ArmModel(NamedTuple):
    """The arm for compiled code; ``torque`` to ``jerk`` are limits, ``(n,)``."""

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
    """Joint accelerations ``still + slope s``, and the torques ``bias + mass (still + slope s)`` that they need."""

    still: Array
    slope: Array
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
        ValueError: if the arm does not have two or three links, or period or bandwidth are not positive.
    """
    if arm.n_joints not in (2, 3):
        raise ValueError(f"{arm.name} has {arm.n_joints} links; the field of the hand is for arms with two or three")
    bandwidth = BANDWIDTH / period if bandwidth is None and period > 0.0 else bandwidth
    if not (period > 0.0 and bandwidth is not None and bandwidth > 0.0):
        raise ValueError(f"period {period} s and bandwidth {bandwidth} rad/s must be positive")
    limits = (limits or arm.limits).for_joints(arm.n_joints, arm.name)
    torque, *others = (np.array(getattr(limits, kind)) for kind in ("torque", "velocity", "acceleration", "jerk"))
    model = _ArmModel(*arm.chain_constants, arm.length_array, TORQUE_SHARE * torque, *others)
    q, qd, qdd, *motion = (
        np.ascontiguousarray(array, dtype=float) for array in (q, qd, qdd, target[0] - arm.base_array, *target[1:])
    )
    out = np.empty_like(q)
    _approach(model, q, qd, qdd, _Target(*motion), period, bandwidth, out)
    return out


@njit(cache=True, nogil=True)
def _approach(
    model: _ArmModel, q: Array, qd: Array, qdd: Array, targets: _Target, period: float, bandwidth: float, out: Array
) -> None:
    n = q.shape[1]
    lower, upper = np.empty(n), np.empty(n)
    for row in range(q.shape[0]):
        # bounds of the joint accelerations
        for i in range(n):
            lower[i], upper[i] = smooth_bounds(
                qd[row, i], qdd[row, i], period, model.velocity[i], model.acceleration[i], model.jerk[i]
            )
        # across the path: the linear field
        target = _Target(targets.position[row], targets.velocity[row], targets.acceleration[row])
        along = _direction(target)
        x, v, y, vy = _relative_to_target(model, q[row], qd[row], target, along)
        vy += period * linear_field(y, vy, period, bandwidth)
        # along it: the attraction within the limits of the present and of the meeting posture
        now = _response_now(model, q[row], qd[row], qdd[row], target, along, v, vy, period)
        lowest, highest = _interval(now, lower, upper, model.torque)
        if lowest > highest:
            lowest = highest = 0.5 * (lowest + highest)
        braking, jerk = _braking(model, now, _response_at_meeting(model, q[row], target, along, x, v))
        s = attraction(x, v, (lowest, highest), braking, jerk, period, bandwidth)
        for i in range(n):
            out[row, i] = min(upper[i], max(lower[i], now.still[i] + now.slope[i] * s))
        _fit_torque(now, model.torque, lower, upper, out[row])


@njit(cache=True, nogil=True)
def _direction(target: _Target) -> _Pair:
    """Unit vector along the target's path; an arbitrary one for a target at rest."""
    speed = math.hypot(target.velocity[0], target.velocity[1])
    if speed < 1e-9:
        return 1.0, 0.0
    return target.velocity[0] / speed, target.velocity[1] / speed


@private
def _relative_to_target(
    model: _ArmModel, q: Array, qd: Array, target: _Target, along: _Pair
) -> tuple[float, float, float, float]:
    """The hand relative to the target: position and velocity along its path, then both across it."""
    hand, velocity = np.empty(2), np.empty(2)
    hand_state_single(model.lengths, np.zeros(2), q, qd, hand, velocity)
    x, y = hand[0] - target.position[0], hand[1] - target.position[1]
    vx, vy = velocity[0] - target.velocity[0], velocity[1] - target.velocity[1]
    ux, uy = along
    return ux * x + uy * y, ux * vx + uy * vy, ux * y - uy * x, ux * vy - uy * vx


@private
def _response_now(
    model: _ArmModel, q: Array, qd: Array, qdd: Array, target: _Target, along: _Pair, v: float, vy: float, period: float
) -> _Response:
    """The next period: for s = 0 the hand has the velocity ``v`` along the path and ``vy`` across it at its end.

    Velocities are converted in the posture predicted for the end of the period, which avoids drift; torques are those
    half a period ahead.
    """
    ux, uy = along
    n = q.shape[0]
    half, end = np.empty(n), np.empty(n)
    for i in range(n):
        half[i] = q[i] + 0.5 * period * qd[i]
        end[i] = q[i] + period * (qd[i] + 0.5 * period * qdd[i])
    links = _links(model.lengths, end[0], end[1])
    still = _of_all_joints(
        n,
        _joint_velocities(
            links,
            target.velocity[0] + period * target.acceleration[0] + ux * v - uy * vy,
            target.velocity[1] + period * target.acceleration[1] + uy * v + ux * vy,
        ),
    )
    for i in range(n):
        still[i] = (still[i] - qd[i]) / period
    slope = _of_all_joints(n, _joint_velocities(links, ux, uy))
    return _response(model, half, qd + 0.5 * period * qdd, still, slope)


@private
def _response_at_meeting(model: _ArmModel, q: Array, target: _Target, along: _Pair, x: float, v: float) -> _Response:
    """Following the target from the point where the hand comes to rest relative to it."""
    # braking evenly to rest takes twice as long as the same distance at the present velocity
    t = min(LOOK_AHEAD, -2.0 * x / v) if x * v < 0.0 else 0.0
    px = target.position[0] + t * (target.velocity[0] + 0.5 * t * target.acceleration[0])
    py = target.position[1] + t * (target.velocity[1] + 0.5 * t * target.acceleration[1])
    n, orientation = q.shape[0], q[0] + q[1]
    if n == 3:
        orientation += q[2]
        px -= model.lengths[2] * math.cos(orientation)
        py -= model.lengths[2] * math.sin(orientation)
    q1, q2 = two_link_branch(model.lengths[0], model.lengths[1], px, py, q[1])
    if math.isnan(q1):
        q1, q2 = q[0], q[1]
    # Joint velocities, and accelerations with the centripetal ones of both links.
    links = _links(model.lengths, q1, q2)
    w1, w2 = speeds = _joint_velocities(
        links, target.velocity[0] + t * target.acceleration[0], target.velocity[1] + t * target.acceleration[1]
    )
    still = _joint_velocities(
        links,
        target.acceleration[0] + links[0] * w1**2 + links[2] * (w1 + w2) ** 2,
        target.acceleration[1] + links[1] * w1**2 + links[3] * (w1 + w2) ** 2,
    )
    slope = _joint_velocities(links, along[0], along[1])
    meeting = _of_all_joints(n, (q1, q2))
    if n == 3:
        meeting[2] += orientation
    return _response(model, meeting, _of_all_joints(n, speeds), _of_all_joints(n, still), _of_all_joints(n, slope))


@private
def _of_all_joints(n: int, first: _Pair) -> Array:
    """Values of two joints, and for a third the one with which the last link does not turn, ``(n,)``."""
    values = np.empty(n)
    values[0], values[1] = first
    if n == 3:
        values[2] = -(first[0] + first[1])
    return values


@private
def _response(model: _ArmModel, q: Array, qd: Array, still: Array, slope: Array) -> _Response:
    n = q.shape[0]
    mass, bias = np.empty((n, n)), np.empty(n)
    mass_matrix_single(model.coupling, q, mass)
    inverse_dynamics_single(model.coupling, model.weight, q, qd, np.zeros(n), bias)
    return _Response(still, slope, mass, bias)


@njit(cache=True, nogil=True)
def _braking(model: _ArmModel, now: _Response, later: _Response) -> tuple[_Pair, float]:
    """Lowest and highest acceleration along the path, and jerk, that braking can use in both postures."""
    lowest, highest, jerk = -math.inf, math.inf, math.inf
    for response in (now, later):
        low, high = _interval(response, -model.acceleration, model.acceleration, model.torque)
        lowest, highest = max(lowest, low), min(highest, high)
        for i in range(response.slope.shape[0]):
            if response.slope[i] != 0.0:
                jerk = min(jerk, model.jerk[i] / abs(response.slope[i]))
    return (min(-_WEAKEST, RESERVE * lowest), max(_WEAKEST, RESERVE * highest)), RESERVE * jerk


@private
def _interval(response: _Response, lower: Array, upper: Array, torque: Array) -> _Pair:
    """The interval of s within bounds of joint accelerations and torques; empty if its ends are in reverse."""
    lowest, highest = -math.inf, math.inf
    for i in range(lower.shape[0]):
        force, slope = response.bias[i], 0.0
        for j in range(lower.shape[0]):
            force += response.mass[i, j] * response.still[j]
            slope += response.mass[i, j] * response.slope[j]
        lowest, highest = _narrowed(lowest, highest, response.still[i], response.slope[i], lower[i], upper[i])
        lowest, highest = _narrowed(lowest, highest, force, slope, -torque[i], torque[i])
    return lowest, highest


@private
def _narrowed(lowest: float, highest: float, offset: float, slope: float, low: float, high: float) -> _Pair:
    """The part of an interval of s in which ``low <= offset + slope s <= high``."""
    if abs(slope) < 1e-12:
        return lowest, highest
    first, second = (low - offset) / slope, (high - offset) / slope
    return max(lowest, min(first, second)), min(highest, max(first, second))


@private
def _fit_torque(response: _Response, torque: Array, lower: Array, upper: Array, qdd: Array) -> None:
    """Move accelerations towards the torque limits, and back into their bounds, by projections in turn."""
    n = qdd.shape[0]
    tau = np.empty(n)
    for _ in range(_PROJECTIONS):
        for i in range(n):
            tau[i] = response.bias[i]
            for j in range(n):
                tau[i] += response.mass[i, j] * qdd[j]
        worst, excess = worst_excess(tau, torque)
        if excess == 0.0:
            return
        project_off_limit(response.mass[worst], excess, lower, upper, qdd)


@private
def _links(lengths: Array, q1: float, q2: float) -> tuple[float, float, float, float]:
    """Both links as vectors: x and y of the first, x and y of the second, m."""
    x1, y1 = lengths[0] * math.cos(q1), lengths[0] * math.sin(q1)
    return x1, y1, lengths[1] * math.cos(q1 + q2), lengths[1] * math.sin(q1 + q2)


@private
def _joint_velocities(links: tuple[float, float, float, float], vx: float, vy: float) -> _Pair:
    """Joint velocities for a velocity of the hand, bounded close to a stretched or folded arm."""
    x1, y1, x2, y2 = links
    area = x1 * y2 - y1 * x2
    area = math.copysign(max(abs(area), 1e-3 * math.sqrt((x1 * x1 + y1 * y1) * (x2 * x2 + y2 * y2))), area)
    return (x2 * vx + y2 * vy) / area, (-(x1 + x2) * vx - (y1 + y2) * vy) / area
