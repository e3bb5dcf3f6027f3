"""What the limits of an arm allow its hand along one direction.

Joint accelerations and torques are affine in the acceleration ``s`` of the hand along a direction, so that each of
their limits is an interval of ``s``.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from planners.compiled.calls import private
from planners.control.joint_limits import project_off_limit, worst_excess
from planners.robot.dynamics import inverse_dynamics_single, mass_matrix_single
from planners.robot.kinematics import two_link_branch
from planners.typing import Array

RESERVE = 0.95
"""Share of acceleration and jerk for braking: the posture changes during it."""

LOOK_AHEAD = 1.0
"""Longest prediction of the meeting point, s."""

_WEAKEST = 1e-3
"""Least acceleration for braking, also where the limits do not allow to follow the target, m/s^2."""

_PROJECTIONS = 40

Pair = tuple[float, float]


class ArmModel(NamedTuple):
    """The arm for compiled code; ``torque`` to ``jerk`` are limits, ``(n,)``."""

    coupling: Array
    weight: Array
    lengths: Array
    torque: Array
    velocity: Array
    acceleration: Array
    jerk: Array


class Target(NamedTuple):
    """Position (from the arm's base), velocity and acceleration of the target, ``(2,)``."""

    position: Array
    velocity: Array
    acceleration: Array


class Response(NamedTuple):
    """Joint accelerations ``still + slope s``, and the torques ``bias + mass (still + slope s)`` that they need."""

    still: Array
    slope: Array
    mass: Array
    bias: Array


@private
def links_at_end(model: ArmModel, q: Array, qd: Array, qdd: Array, period: float) -> tuple[float, float, float, float]:
    """Both links as vectors in the posture predicted for the end of the period: without that the hand drifts."""
    end1 = q[0] + period * (qd[0] + 0.5 * period * qdd[0])
    end2 = q[1] + period * (qd[1] + 0.5 * period * qdd[1])
    return _links(model.lengths, end1, end2)


@private
def velocity_changes(
    links: tuple[float, float, float, float],
    qd: Array,
    target: Target,
    along: Pair,
    v: Pair,
    way: Pair,
    period: float,
) -> tuple[Array, Array]:
    """Joint accelerations of the next period, ``(n,)`` each, rad/s^2: ``still`` for velocities ``v`` (m/s) of the hand,
    along and across the path, at its end; ``slope`` for an acceleration of 1 m/s^2 along ``way``.
    """
    ux, uy = along
    n = qd.shape[0]
    still = _of_all_joints(
        n,
        _joint_velocities(
            links,
            target.velocity[0] + period * target.acceleration[0] + ux * v[0] - uy * v[1],
            target.velocity[1] + period * target.acceleration[1] + uy * v[0] + ux * v[1],
        ),
    )
    for i in range(n):
        still[i] = (still[i] - qd[i]) / period
    return still, _of_all_joints(n, _joint_velocities(links, way[0], way[1]))


@private
def response_at_meeting(model: ArmModel, q: Array, target: Target, along: Pair, x: float, v: float) -> Response:
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
    return response_in(model, meeting, _of_all_joints(n, speeds), _of_all_joints(n, still), _of_all_joints(n, slope))


@private
def _of_all_joints(n: int, first: Pair) -> Array:
    """Values of two joints, and for a third the one with which the last link does not turn, ``(n,)``."""
    values = np.empty(n)
    values[0], values[1] = first
    if n == 3:
        values[2] = -(first[0] + first[1])
    return values


@private
def response_in(model: ArmModel, q: Array, qd: Array, still: Array, slope: Array) -> Response:
    """Joint accelerations ``still + slope s``, rad/s^2, with the torques that they need in a state ``q``, ``qd``."""
    n = q.shape[0]
    mass, bias = np.empty((n, n)), np.empty(n)
    mass_matrix_single(model.coupling, q, mass)
    inverse_dynamics_single(model.coupling, model.weight, q, qd, np.zeros(n), bias)
    return Response(still, slope, mass, bias)


@private
def braking_limits(model: ArmModel, now: Response, later: Response) -> tuple[Pair, float]:
    """Lowest and highest acceleration, m/s^2, and jerk, m/s^3, that braking can use in both postures."""
    lowest, highest, jerk = -math.inf, math.inf, math.inf
    for response in (now, later):
        low, high = interval(response, -model.acceleration, model.acceleration, model.torque)
        lowest, highest = max(lowest, low), min(highest, high)
        for i in range(response.slope.shape[0]):
            if response.slope[i] != 0.0:
                jerk = min(jerk, model.jerk[i] / abs(response.slope[i]))
    return (min(-_WEAKEST, RESERVE * lowest), max(_WEAKEST, RESERVE * highest)), RESERVE * jerk


@private
def interval(response: Response, lower: Array, upper: Array, torque: Array) -> Pair:
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
def _narrowed(lowest: float, highest: float, offset: float, slope: float, low: float, high: float) -> Pair:
    """The part of an interval of s in which ``low <= offset + slope s <= high``."""
    if abs(slope) < 1e-12:
        return lowest, highest
    first, second = (low - offset) / slope, (high - offset) / slope
    return max(lowest, min(first, second)), min(highest, max(first, second))


@private
def fit_torque(response: Response, torque: Array, lower: Array, upper: Array, qdd: Array) -> None:
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
def _joint_velocities(links: tuple[float, float, float, float], vx: float, vy: float) -> Pair:
    """Joint velocities for a velocity of the hand, bounded close to a stretched or folded arm."""
    x1, y1, x2, y2 = links
    area = x1 * y2 - y1 * x2
    area = math.copysign(max(abs(area), 1e-3 * math.sqrt((x1 * x1 + y1 * y1) * (x2 * x2 + y2 * y2))), area)
    return (x2 * vx + y2 * vy) / area, (-(x1 + x2) * vx - (y1 + y2) * vy) / area
