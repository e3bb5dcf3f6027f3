"""Goal postures of a fixed target: its joint angles, or the inverse kinematics of its hand position."""

from __future__ import annotations

from typing import Literal

import numpy as np

from planners.problem import FixedHand, FixedJoints, Infeasible, MotionProblem
from planners.robot.kinematics import UnreachableTarget, wrap
from planners.typing import Array

Elbow = Literal["best", "start", "+", "-"]

ORIENTATIONS = 8
"""Number of orientations of a third link that are tried where the target leaves it open."""

LONG_WAY = 0.5 * np.pi
"""Turn of the first joint from which the other way round is tried too, rad."""

MOST_GOALS = 6


def goal_postures(problem: MotionProblem, target: FixedJoints | FixedHand, elbow: Elbow) -> list[Array]:
    """Goal joint angles, ``(n,)`` each: at most `MOST_GOALS`, closest to the start first.

    Raises:
        Infeasible: with reason ``unreachable`` if the target is out of reach within the joint ranges.
        ValueError: if an elbow branch is given for a target in joint angles.
    """
    if isinstance(target, FixedJoints):
        if elbow not in ("best", "start"):
            raise ValueError("a target in joint angles fixes the elbow; use elbow='best'")
        return [target.q]
    n = problem.arm.n_joints
    orientations: list[float | None] = [target.orientation]
    if n == 3 and target.orientation is None:
        turns = np.arange(ORIENTATIONS) * 2.0 * np.pi / ORIENTATIONS
        orientations = [float(problem.q.sum() + turn) for turn in turns]
    postures = []
    for orientation in orientations:
        try:
            branches = problem.arm.inverse_kinematics(target.position, orientation)
        except UnreachableTarget as error:
            unreachable = error
            continue
        postures += [branch for branch in branches if on_branch(branch, problem.q, elbow)]
    if not postures:
        raise Infeasible("unreachable", str(unreachable))
    goals = [goal for posture in postures for goal in whole_turns(posture, problem)]
    if not goals:
        x, y = target.position
        raise Infeasible("unreachable", f"every posture with the hand at ({x:.4g}, {y:.4g}) m leaves a joint's range")
    return sorted(goals, key=lambda goal: float(np.abs(goal - problem.q).sum()))[:MOST_GOALS]


def on_branch(posture: Array, start: Array, elbow: Elbow) -> bool:
    """Whether a posture is on an elbow branch."""
    if elbow == "best":
        return True
    positive = np.sin(start[1]) >= 0.0 if elbow == "start" else elbow == "+"
    return bool((np.sin(posture[1]) >= 0.0) == positive)


def whole_turns(posture: Array, problem: MotionProblem) -> list[Array]:
    """The posture within the joint ranges, in whole turns closest to the start; the first joint both ways round."""
    nearest = problem.q + wrap(posture - problem.q)
    ranges = np.array(problem.joint_limits.angle)
    turn = nearest[0] - problem.q[0]
    short = abs(turn) < LONG_WAY and abs(nearest[0]) <= ranges[0]
    firsts = [nearest[0]] if short else [nearest[0], nearest[0] - np.copysign(2.0 * np.pi, turn)]
    outer = [(angle, angle - 2.0 * np.pi, angle + 2.0 * np.pi) for angle in nearest[1:]]
    found = []
    for first in firsts:
        # The first angle within the range is the closest.
        rest = [next((a for a in angles if abs(a) <= r), None) for angles, r in zip(outer, ranges[1:], strict=True)]
        if abs(first) <= ranges[0] and None not in rest:
            found.append(np.array([first, *rest], dtype=float))
    return found
