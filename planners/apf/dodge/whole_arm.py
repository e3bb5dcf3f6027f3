"""The two-link arm for compiled code: attraction and repulsion of the whole arm, and the limits of its joints.

* Attraction: a conic well around a posture, with limited force, and velocity that can be braked on the remaining
  distance (O. Khatib, "Real-Time Obstacle Avoidance for Manipulators and Mobile Robots", 1986).
* Repulsion: away from a disc at the point of the arm that is closest to it, mapped to the joints by the transposed
  Jacobian of that point (Khatib's FIRAS applied to every link).
* Circulation, at right angles to the repulsion (L. Singh, H. Stephanou, J. Wen, "Real-time robot motion control with
  circulatory fields", 1996), is made from it in `planners.apf.dodge.proposals`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from planners.compiled.calls import private
from planners.control.joint_limits import TORQUE_SHARE, VELOCITY_SHARE, share_within, stoppable_velocities
from planners.robot.arm import Arm
from planners.robot.kinematics import two_link_branch
from planners.typing import Array

BRAKING_SHARE = 0.85
"""Share of the strength of a well that is used for braking."""

APPROACH = 0.8
"""Share of the remaining distance that a joint covers in a period close to the bottom of a well."""

CRUISE_SHARE = 0.5
"""Share of the acceleration limits for the motion to the goal: the other half is for evading."""

BODY = [
    ("lengths", "f8", (2,)),
    ("link_radius", "f8"),
    ("middle", "f8", (2,)),
    ("ranges", "f8", (2,)),
    ("top", "f8", (2,)),
    ("cruise", "f8", (2,)),
    ("hardest", "f8", (2,)),
    ("torque", "f8", (2,)),
    ("coupling", "f8", (2, 2)),
    ("weight", "f8", (2,)),
]
"""The arm: its links, m; middle of the joint ranges and half of their width, rad; largest velocities, rad/s;
accelerations towards the goal and largest ones, rad/s^2; largest torques, N m; and its dynamics, see
:mod:`planners.robot.dynamics`."""


def make_body(arm: Arm) -> Any:
    """The arm as a record of `BODY`.

    Raises:
        ValueError: if it does not have two links, or lacks a limit that the field needs.
    """
    if arm.n_joints != 2:
        raise ValueError(f"the whole-arm field is made for two links; {arm.name} has {arm.n_joints}")
    limits = arm.limits
    for name in ("velocity", "acceleration"):
        if not np.isfinite(getattr(limits, name)).all():
            raise ValueError(f"the whole-arm field needs {name} limits; {arm.name} has {getattr(limits, name)}")
    body = np.zeros(1, BODY)[0]
    body["lengths"], body["link_radius"] = arm.lengths, arm.link_radius
    body["middle"], body["ranges"] = limits.angle_middle, limits.angle_half
    body["top"] = limits.velocity
    body["hardest"], body["torque"] = limits.acceleration, limits.torque
    body["cruise"] = CRUISE_SHARE * body["hardest"]
    body["coupling"], body["weight"] = arm.chain_constants
    return body


@njit(cache=True, nogil=True, inline="always")
def clip(value: float, low: float, high: float) -> float:
    """The nearest number within bounds; faster than min and max, which handle NaN."""
    return low if value < low else (high if value > high else value)


@njit(cache=True, nogil=True, inline="always")
def joint_attraction(error: float, v: float, strength: float, top: float, rate: float) -> float:
    """Acceleration of one joint in a conic well ``error`` away, braked in time; ``rate``: periods per second."""
    distance = abs(error)
    braked, approach = math.sqrt(2.0 * BRAKING_SHARE * strength * distance), APPROACH * rate * distance
    speed = clip(braked, 0.0, approach if approach < top else top)
    return clip(rate * (math.copysign(speed, error) - v), -strength, strength)


@private
def time_to(body: Any, q1: float, q2: float, v1: float, v2: float, posture: Array) -> float:
    """Least time to come to rest in a posture, s; the joints are independent double integrators."""
    first = _rest_time(posture[0] - q1, v1, body.top[0], body.cruise[0])
    return max(first, _rest_time(posture[1] - q2, v2, body.top[1], body.cruise[1]))


@njit(cache=True, nogil=True, inline="always")
def _rest_time(error: float, v: float, top: float, a: float) -> float:
    """Least time of one joint, s: that of the motion from rest that passes through this state, less its run-up."""
    if error < 0.0:
        error, v = -error, -v
    per_a = 1.0 / a
    run_up = 0.5 * v * v * per_a
    if v > 0.0 and error < run_up:  # it overshoots, and returns from where it stops
        error, run_up, v = run_up - error, 0.0, -v
    distance = error + run_up
    cruising = distance * a > top * top
    return (distance / top + top * per_a if cruising else 2.0 * math.sqrt(distance * per_a)) - v * per_a


@njit(cache=True, nogil=True)
def goal_postures(body: Any, q: Array, x: float, y: float, postures: Array) -> None:
    """Both elbow postures with the hand at ``(x, y)`` m from the base, ``(2, 2)``, in the whole turns closest to the
    joint angles ``q``, ``(2,)``, within the joint ranges; NaN where there is none.
    """
    for branch in range(2):
        q1, q2 = two_link_branch(body.lengths[0], body.lengths[1], x, y, 1.0 - 2.0 * branch)
        if not math.isnan(q1):
            q1 = _closest_turn(body.middle[0], body.ranges[0], q[0], q1)
            q2 = _closest_turn(body.middle[1], body.ranges[1], q[1], q2)
        if math.isnan(q1) or math.isnan(q2):
            q1 = q2 = np.nan
        postures[branch, 0], postures[branch, 1] = q1, q2


@private
def _closest_turn(middle: float, reach: float, q: float, angle: float) -> float:
    """The angle in the whole turn closest to ``q`` within ``reach`` of the middle of a range; NaN if there is none."""
    turns = round((q - angle) / (2.0 * math.pi))
    side = 1 if angle + 2.0 * math.pi * turns < middle else -1
    for _ in range(3):
        found = angle + 2.0 * math.pi * turns
        if abs(found - middle) < reach:
            return found
        turns += side
    return math.nan


@njit(cache=True, nogil=True, inline="always")
def gap(l1: float, l2: float, c1: float, s1: float, c2: float, s2: float, x: float, y: float) -> float:
    """Distance of a point from the axes of both links, whose directions are ``(c1, s1)`` and ``(c2, s2)``, m."""
    along = clip(x * c1 + y * s1, 0.0, l1)
    dx, dy = x - along * c1, y - along * s1
    upper = dx * dx + dy * dy
    dx, dy = x - l1 * c1, y - l1 * s1
    along = clip(dx * c2 + dy * s2, 0.0, l2)
    dx, dy = dx - along * c2, dy - along * s2
    fore = dx * dx + dy * dy
    return math.sqrt(fore if fore < upper else upper)


@njit(cache=True, nogil=True)
def repulsion(body: Any, q1: float, q2: float, x: float, y: float) -> tuple[float, float, float]:
    """Distance of the arm from a point, m, and its gradient by both joint angles, m."""
    l1, l2 = body.lengths[0], body.lengths[1]
    c1, s1, c2, s2 = math.cos(q1), math.sin(q1), math.cos(q1 + q2), math.sin(q1 + q2)
    # The closest point of each link, and the closer of the two.
    along = min(l1, max(0.0, x * c1 + y * s1))
    near_x, near_y, outer = along * c1, along * s1, 0.0
    upper = math.hypot(x - near_x, y - near_y)
    beyond = min(l2, max(0.0, (x - l1 * c1) * c2 + (y - l1 * s1) * s2))
    fore_x, fore_y = l1 * c1 + beyond * c2, l1 * s1 + beyond * s2
    distance = math.hypot(x - fore_x, y - fore_y)
    if distance < upper:
        near_x, near_y, outer = fore_x, fore_y, beyond
    # The transposed Jacobian of that point times the unit vector towards it.
    away = max(min(distance, upper), 1e-9)
    nx, ny = (near_x - x) / away, (near_y - y) / away
    return away, ny * near_x - nx * near_y, outer * (ny * c2 - nx * s2)


@private
def held_torques(body: Any, q: Array, qd: Array, qdd1: float, qdd2: float, period: float) -> tuple[float, float]:
    """Torques, N m, that give mean accelerations when held for a period: inverse dynamics half a period ahead.

    Written out for two links: with `planners.control.joint_limits.scale_into_torque` an action takes a fifth longer.
    """
    half = 0.5 * period
    inner = q[0] + half * (qd[0] + 0.5 * half * qdd1)
    elbow = q[1] + half * (qd[1] + 0.5 * half * qdd2)
    w1 = qd[0] + half * qdd1
    w2 = w1 + qd[1] + half * qdd2
    c, s, coupling = math.cos(elbow), math.sin(elbow), body.coupling
    upper = coupling[0, 0] * qdd1 + coupling[0, 1] * (c * (qdd1 + qdd2) - s * w2 * w2)
    fore = coupling[1, 1] * (qdd1 + qdd2) + coupling[0, 1] * (c * qdd1 + s * w1 * w1)
    upper += body.weight[0] * math.cos(inner)
    fore += body.weight[1] * math.cos(inner + elbow)
    return upper + fore, fore


@private
def keep_limits(body: Any, q: Array, qd: Array, period: float, qdd: Array) -> None:
    """Change the accelerations of one row, ``(2,)``, so that they keep the limits of velocity, range and torque.

    A joint brakes before its end stop with half of its largest acceleration, which leaves torque for the other joint.
    Torques are brought within their limits by scaling both accelerations.
    """
    for i in range(2):
        hardest, top = body.hardest[i], VELOCITY_SHARE * body.top[i]
        from_middle = q[i] - body.middle[i]
        slowest, fastest = stoppable_velocities(from_middle, qd[i], body.ranges[i], 0.5 * hardest, period)
        slowest, fastest = max(-top, slowest), min(top, fastest)
        qdd[i] = min((fastest - qd[i]) / period, max((slowest - qd[i]) / period, qdd[i]))
        qdd[i] = min(hardest, max(-hardest, qdd[i]))
    _keep_torque(body, q, qd, period, qdd)


@private
def _keep_torque(body: Any, q: Array, qd: Array, period: float, qdd: Array) -> None:
    limit1, limit2 = TORQUE_SHARE * body.torque[0], TORQUE_SHARE * body.torque[1]
    tau1, tau2 = held_torques(body, q, qd, qdd[0], qdd[1], period)
    if abs(tau1) <= limit1 and abs(tau2) <= limit2:
        return
    still1, still2 = held_torques(body, q, qd, 0.0, 0.0, period)
    scale = min(share_within(still1, tau1, limit1), share_within(still2, tau2, limit2))
    qdd[0] *= scale
    qdd[1] *= scale
