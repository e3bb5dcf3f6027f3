"""What a spectator may change of MinTorqueMove while it runs: the posture to reach, by the place of its hand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from envs.card import Control
from envs.min_torque_move.moves import Move
from planners import FixedHand, FixedJoints, Infeasible, MotionProblem, quintic
from planners.goals import goal_postures
from planners.typing import Array

RISES = 1.15
"""Factor between the durations that are tried for a move."""


def _move_goal(task: Any, record: Any, point: Array, index: int = 0) -> bool:
    """Begin a move from where the arm is, once it rests, to the nearest posture with its hand at the point."""
    if float(np.abs(record["qd"]).max()) > task.config.velocity_tolerance:
        return False
    limits = task.arm.limits
    start = np.clip(record["q"], limits.angle_lower, limits.angle_upper)
    hand = FixedHand(point)
    try:
        goal = goal_postures(MotionProblem(task.arm, start, hand, task.config.horizon), hand, "best")[0]
    except Infeasible as error:
        raise ValueError(f"the hand cannot be at ({point[0]:.2f}, {point[1]:.2f}) m: {error}") from None
    task.begin(record, Move(start, goal, _duration(task, start, goal)))
    return True


def _duration(task: Any, start: Array, goal: Array) -> float:
    """A time in which the quintic keeps all limits, in whole control periods, s."""
    period, longest = float(task.config.control_period), float(task.config.horizon)
    duration = 0.2
    while duration < longest:
        try:
            quintic.plan(MotionProblem(task.arm, start, FixedJoints(goal), duration))
            break
        except Infeasible:
            duration *= RISES
    return min(longest, math.ceil(1.3 * duration / period) * period)


CONTROLS = (
    Control(
        "goal", "goal of the hand", lambda task, record: task.arm.forward_kinematics(record["goal"])[None], _move_goal
    ),
)
"""The controls of MinTorqueMove-v0."""
