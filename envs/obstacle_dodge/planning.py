"""What the planners are asked among moving discs, again and again as the prediction changes."""

from __future__ import annotations

from dataclasses import replace

from envs.obstacle_dodge.paths import NEAREST
from planners import MotionProblem, Trajectory, dpct, lagrange

REPLAN_EVERY = 5
"""Control periods after which discs are predicted, and motions planned, anew."""

ACCELERATION_SHARE, VELOCITY_SHARE = 0.88, 0.96
"""Of the arm's limits; what is left is for tracking."""


def time_along_line(problem: MotionProblem) -> Trajectory:
    """DPCT: straight lines in joint space, timed so that the discs have passed or have not come yet.

    Where no timing avoids a disc, the motion that delays the contact.
    """
    return dpct.plan(_with_full_limits(problem), variant="timing", contact="delay")


def pass_via_nodes(problem: MotionProblem) -> Trajectory:
    """Lagrange: an interpolant whose inner nodes are moved aside of where the discs will be."""
    return lagrange.plan(_with_full_limits(problem), variant="via", keep_out=NEAREST)


def _with_full_limits(problem: MotionProblem) -> MotionProblem:
    """To evade, more than the half of the acceleration is needed that the problem leaves for an undisturbed move."""
    limits = problem.arm.limits
    acceleration = tuple(ACCELERATION_SHARE * value for value in limits.acceleration)
    velocity = tuple(VELOCITY_SHARE * value for value in limits.velocity)
    return replace(problem, limits=replace(limits, acceleration=acceleration, velocity=velocity))
