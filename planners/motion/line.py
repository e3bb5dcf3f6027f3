"""Reduction of a motion problem to its line: target motion and hand start as scalars along a path."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from planners.goals import nearest_turns
from planners.motion.path import HandLine, JointLine, Path
from planners.problem import FixedHand, FixedJoints, Infeasible, MotionProblem, MovingHand
from planners.robot.arm import Arm, JointLimits
from planners.robot.kinematics import UnreachableTarget
from planners.typing import Array

OFF_LINE = 1e-4
"""Tolerance of hand and target off a common line (m, m/s): float32 rounding and tracking errors."""

Branch = Literal["start", "+", "-"]


@dataclass(frozen=True)
class Line:
    """A motion problem along its path.

    Attributes:
        problem: the problem.
        arm: with the payload.
        path: ``r -> q``; the start is at ``r = 0``, the target moves to greater ``r``.
        target: position, velocity and acceleration of the target in ``r`` at time 0, ``(3,)``.
        start: position, velocity and acceleration of the hand in ``r`` at time 0, ``(3,)``.
        unit: the ``r`` of the paper's ``r = 1`` (eq 7): where the target is at the horizon.
        low, high: interval of the path within the joint ranges.
    """

    problem: MotionProblem
    arm: Arm
    path: Path
    target: Array
    start: Array
    unit: float
    low: float
    high: float

    @property
    def moving(self) -> bool:
        """Whether the target moves."""
        return isinstance(self.problem.target, MovingHand)

    def target_at(self, t: Array) -> tuple[Array, Array, Array]:
        """Position, velocity and acceleration of the target in ``r``, eq 17, at times ``t``."""
        position, velocity, acceleration = self.target
        return (
            position + t * (velocity + 0.5 * t * acceleration),
            velocity + t * acceleration,
            np.full_like(t, acceleration),
        )


def reduce_to_line(problem: MotionProblem, branch: Branch = "start") -> Line:
    """The problem along its line, with the start posture on the given elbow branch.

    Raises:
        Infeasible: ``start`` if the hand is not on the target's line or moves across it, ``unreachable`` if the target
            is out of reach or moves on a curve.
        ValueError: if an elbow branch is given for a target in joint angles.
    """
    target = problem.target
    if isinstance(target, FixedJoints):
        if branch != "start":
            raise ValueError("a target in joint angles fixes the elbow; use elbow='start'")
        return _joint_line(problem, target.q)
    if isinstance(target, FixedHand):
        return _fixed_hand(problem, target, branch)
    return _moving_hand(problem, target, branch)


def _joint_line(problem: MotionProblem, goal: Array) -> Line:
    """Straight in joint space; ``r = 1`` is the goal."""
    q, qd, qdd = problem.start
    direction = goal - q
    length = float(np.linalg.norm(direction))
    if length < 1e-12:  # already there: any direction
        direction = np.eye(len(q))[0]
        goal_r = 0.0
    else:
        goal_r = 1.0
    scale = float(direction @ direction)
    speed, acceleration = float(qd @ direction) / scale, float(qdd @ direction) / scale
    across = float(np.abs(qd - speed * direction).max())
    if across > OFF_LINE:
        raise Infeasible(
            "start",
            f"the joints move at up to {across:.3g} rad/s across the straight joint path; start at rest",
            across=across,
        )
    path = JointLine(q, direction)
    return _line(problem, path, np.array([goal_r, 0.0, 0.0]), np.array([0.0, speed, acceleration]), goal_r or 1.0)


def _fixed_hand(problem: MotionProblem, target: FixedHand, branch: Branch) -> Line:
    """Straight hand path to a fixed point; straight in joint space if the hand's orientation changes."""
    posture = _posture(problem, branch)
    turn = 0.0 if target.orientation is None else target.orientation - float(posture.sum())
    if len(posture) == 3 and abs((turn + np.pi) % (2.0 * np.pi) - np.pi) > 1e-9:
        branches = _inverse(problem.arm, target.position, target.orientation)
        goal = nearest_turns(branches[0 if np.sin(posture[1]) >= 0.0 else 1], posture, problem.joint_limits)
        if np.isnan(goal).any():
            ranges = problem.joint_limits.angle_text
            raise Infeasible("unreachable", f"the posture at the target leaves a joint's range, {ranges}")
        return _joint_line(problem, goal)
    hand = problem.arm.forward_kinematics(problem.q)
    displacement = target.position - hand
    distance = float(np.linalg.norm(displacement))
    direction = displacement / distance if distance > 1e-12 else np.array([1.0, 0.0])
    path = HandLine(problem.arm, hand, direction, posture)
    start = _hand_start(problem, direction, hand)
    if distance > path.span[1]:
        raise Infeasible(
            "unreachable",
            f"the straight hand path to ({target.position[0]:.4g}, {target.position[1]:.4g}) m leaves the reach of "
            f"{problem.arm.name} after {path.span[1]:.4g} of {distance:.4g} m",
            span=path.span,
        )
    return _line(problem, path, np.array([distance, 0.0, 0.0]), start, distance or 1.0)


def _moving_hand(problem: MotionProblem, target: MovingHand, branch: Branch) -> Line:
    """Along the target's own line, from the foot of the hand's start on it."""
    posture = _posture(problem, branch)
    hand = problem.arm.forward_kinematics(problem.q)
    direction = _direction(target, hand)
    normal = np.array([-direction[1], direction[0]])
    curve = abs(float(target.acceleration @ normal))
    if curve > OFF_LINE:
        raise Infeasible(
            "unreachable",
            f"the target accelerates by {curve:.3g} m/s^2 across its velocity; only straight motions can be followed",
            across=curve,
        )
    across = float((hand - target.position) @ normal)
    if abs(across) > OFF_LINE:
        raise Infeasible(
            "start",
            f"the hand is {abs(across):.4g} m beside the target's line; move it there first (at most {OFF_LINE} m)",
            distance=abs(across),
        )
    origin = hand - across * normal
    path = HandLine(problem.arm, origin, direction, posture)
    along = np.array(
        [(target.position - origin) @ direction, target.velocity @ direction, target.acceleration @ direction]
    )
    start = _hand_start(problem, direction, hand)
    position, velocity, acceleration = along
    horizon = problem.horizon
    unit = float(position + horizon * (velocity + 0.5 * horizon * acceleration))
    return _line(problem, path, along, start, unit if abs(unit) > 1e-6 else 1.0)


def _direction(target: MovingHand, hand: Array) -> Array:
    """Unit vector of the target's motion, or from the hand to a target that stands still."""
    for vector in (target.velocity, target.acceleration, target.position - hand):
        length = float(np.linalg.norm(vector))
        if length > 1e-9:
            unit: Array = vector / length
            return unit
    return np.array([1.0, 0.0])


def _posture(problem: MotionProblem, branch: Branch) -> Array:
    """The start posture, or its twin on the other elbow branch."""
    q = problem.q
    wanted = {"start": np.sin(q[1]) >= 0.0, "+": True, "-": False}[branch] if len(q) > 1 else True
    if branch == "start" or wanted == (np.sin(q[1]) >= 0.0):
        return q
    orientation = float(q.sum()) if len(q) == 3 else None
    both = _inverse(problem.arm, problem.arm.forward_kinematics(q), orientation)
    moved: Array = both[0 if wanted else 1]
    return moved


def _inverse(arm: Arm, hand: Array, orientation: float | None) -> Array:
    """Both branches of the inverse kinematics."""
    try:
        return arm.inverse_kinematics(hand, orientation)
    except UnreachableTarget as error:
        raise Infeasible("unreachable", str(error)) from error


def _hand_start(problem: MotionProblem, direction: Array, hand: Array) -> Array:
    """Position, velocity and acceleration of the hand along the line; a velocity across it is refused.

    The acceleration across the line is ignored.
    """
    q, qd, qdd = problem.start
    jacobian = problem.arm.jacobian(q)
    velocity = jacobian @ qd
    across = abs(float(velocity[0] * direction[1] - velocity[1] * direction[0]))
    if across > OFF_LINE:
        raise Infeasible(
            "start",
            f"the hand moves at {across:.4g} m/s across the line; start at rest or along it (at most {OFF_LINE} m/s)",
            across=across,
        )
    turning = np.cumsum(qd) ** 2  # centripetal acceleration: every link pulls its end towards its start
    links = np.diff(problem.arm.joint_positions(q), axis=0)
    acceleration = jacobian @ qdd - turning @ links
    return np.array([0.0, velocity @ direction, acceleration @ direction])


def _line(problem: MotionProblem, path: Path, target: Array, start: Array, unit: float) -> Line:
    """The line, cut to the joint ranges."""
    low, high = path.span
    limits = problem.joint_limits
    if np.isfinite(limits.angle_half).any():
        low, high = _within_angles(path, limits, max(low, -1.0), min(high, 2.0))
    return Line(problem, problem.loaded_arm, path, target, start, unit, low, high)


def _within_angles(path: Path, limits: JointLimits, low: float, high: float) -> tuple[float, float]:
    """The part of ``[low, high]`` around 0 in which no joint leaves its range."""
    r = np.sort(np.append(np.linspace(low, high, 801), 0.0))
    outside = np.flatnonzero(~limits.within(path.derivatives(r)[:, 0]))
    start = int(np.searchsorted(r, 0.0))
    before, after = outside[outside <= start], outside[outside >= start]
    if start in outside:
        raise Infeasible("start", "a joint starts outside its range of angles")
    return (
        float(r[before[-1] + 1]) if len(before) else low,
        float(r[after[0] - 1]) if len(after) else high,
    )
