"""Goal postures of a fixed target: its joint angles, or the inverse kinematics of its hand position."""

from __future__ import annotations

from contextlib import suppress
from typing import Literal

import numpy as np

from planners.problem import FixedHand, FixedJoints, Infeasible, MotionProblem
from planners.promises import require_range
from planners.robot import redundant
from planners.robot.kinematics import UnreachableTarget, wrap
from planners.robot.limits import JointLimits
from planners.typing import Array

Elbow = Literal["best", "start", "+", "-"]

ORIENTATIONS = 8
"""Number of orientations of a third link that are tried where the target leaves it open."""

LONG_WAY = 0.5 * np.pi
"""Turn of the first joint from which the other way round is tried too, rad."""

MOST_GOALS = 6


def goal_postures(problem: MotionProblem, target: FixedJoints | FixedHand, elbow: Elbow) -> list[Array]:
    """Goal joint angles within the joint ranges, ``(n,)`` each: at most `MOST_GOALS`, closest to the start first.

    Raises:
        Infeasible: with reason ``unreachable`` if a hand position is out of reach within the joint ranges, or not on
            the elbow branch; ``limits`` if a target in joint angles leaves the ranges.
        ValueError: if an elbow branch is given for a target in joint angles or for a single link.
    """
    if isinstance(target, FixedJoints):
        if elbow not in ("best", "start"):
            raise ValueError("a target in joint angles fixes the elbow; use elbow='best'")
        require_range(problem, target.q)
        return [target.q]
    if problem.arm.n_joints == 1 and elbow in ("+", "-"):
        raise ValueError(f"{problem.arm.name} has one link and no elbow; use elbow='best'")
    x, y = target.position
    try:
        branches = _inverse(problem, target)
        postures = [branch for branch in branches if on_branch(branch, problem.q, elbow)]
        goals = [goal for posture in postures for goal in whole_turns(posture, problem)]
        if not goals and problem.arm.n_joints == 3 and target.orientation is None:
            postures = [branch for branch in _search(problem, target) if on_branch(branch, problem.q, elbow)]
            goals = [goal for posture in postures for goal in whole_turns(posture, problem)]
    except UnreachableTarget as error:
        raise Infeasible("unreachable", str(error)) from None
    if not postures:
        message = f"no posture with the hand at ({x:.4g}, {y:.4g}) m has its elbow on branch '{elbow}'; use 'best'"
        raise Infeasible("unreachable", message)
    if not goals:
        ranges = problem.joint_limits.angle_text
        message = f"every posture with the hand at ({x:.4g}, {y:.4g}) m leaves a joint's range, {ranges}"
        raise Infeasible("unreachable", message)
    return sorted(goals, key=lambda goal: float(np.abs(goal - problem.q).sum()))[:MOST_GOALS]


def on_branch(posture: Array, start: Array, elbow: Elbow) -> bool:
    """Whether a posture is on an elbow branch; a straight or folded elbow and a single link are on both."""
    if elbow == "best" or len(posture) == 1:
        return True
    positive, bend = np.sin(start[1]) >= 0.0 if elbow == "start" else elbow == "+", np.sin(posture[1])
    return bool(bend == 0.0 or (bend > 0.0) == positive)


def whole_turns(posture: Array, problem: MotionProblem) -> list[Array]:
    """The posture within the joint ranges, in whole turns closest to the start; the first joint both ways round."""
    limits, start = problem.joint_limits, problem.q
    closest = nearest_turns(posture, start, limits)
    first = float(start[0] + wrap(posture[0] - start[0]))
    turn = first - start[0]
    inside = limits.angle_lower[0] <= first <= limits.angle_upper[0]
    around = [] if inside and abs(turn) < LONG_WAY else [first - np.copysign(2.0 * np.pi, turn)]
    firsts = {closest[0]: None, **dict.fromkeys(around)}
    both = [np.array([angle, *closest[1:]], dtype=float) for angle in firsts]
    return [goal for goal in both if limits.within(goal)]


def nearest_turns(posture: Array, near: Array, limits: JointLimits) -> Array:
    """The same posture in the whole turns of its joints that are closest to ``near`` within the joint ranges.

    Args:
        posture, near: joint angles, ``(..., n)``, rad.
        limits: of the joints, of which the ranges are kept.

    Returns:
        ``(..., n)``, rad; NaN for a joint that no turn brings into its range.
    """
    turn = 2.0 * np.pi
    lower, upper = limits.angle_lower, limits.angle_upper
    angles = near + wrap(posture - near)
    above, below = np.maximum(angles - upper, 0.0), np.maximum(lower - angles, 0.0)
    angles = angles + turn * (np.ceil(below / turn) - np.ceil(above / turn))
    closest: Array = np.where((angles >= lower) & (angles <= upper), angles, np.nan)
    return closest


def _inverse(problem: MotionProblem, target: FixedHand) -> Array:
    """Postures with the hand at the target, ``(k, n)``, rad; for an open third link those of `ORIENTATIONS`."""
    arm = problem.arm
    if arm.n_joints > 3:
        return _search(problem, target)
    if arm.n_joints < 3 or target.orientation is not None:
        return arm.inverse_kinematics(target.position, target.orientation)
    postures = []
    for turn in np.arange(ORIENTATIONS) * 2.0 * np.pi / ORIENTATIONS:
        with suppress(UnreachableTarget):
            postures.append(arm.inverse_kinematics(target.position, float(problem.q.sum() + turn)))
    return np.concatenate(postures) if postures else np.empty((0, 3))


def _search(problem: MotionProblem, target: FixedHand) -> Array:
    """Postures with the hand at the target within the joint ranges, ``(k, n)``, rad, found numerically."""
    arm, limits = problem.arm, problem.joint_limits
    place = arm.length_array, arm.base_array, target.position, target.orientation
    return redundant.postures(*place, limits, problem.q)
