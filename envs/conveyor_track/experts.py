"""DPCT as an expert of ConveyorTrack-v0."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial

from envs.experts.base import Planner
from envs.task import Task
from planners import Infeasible, MotionProblem, Trajectory, dpct, lagrange

TOLERANCE_SHARE = 0.95
"""Share of the task's tolerances that a plan uses; the rest is for tracking."""

LIMIT_SHARE = 1.0 - 1e-3
"""Share of the limits that a plan uses; the environment measures jerk between control periods, tracking included."""


def settle_early(task: Task) -> Planner:
    """A planner of the earliest settling within the task's tolerances, on the part's line or off it.

    Where DPCT finds none, as from states in the middle of a motion at the limits, the part is met by `lagrange`.
    """
    config = task.config
    tolerances = {
        name: TOLERANCE_SHARE * getattr(config, name) for name in ("position_tolerance", "velocity_tolerance")
    }

    return partial(_settle_early, tolerances)


def _settle_early(tolerances: Mapping[str, float], problem: MotionProblem) -> Trajectory:
    """The motion that settles earliest, within `LIMIT_SHARE` of the limits if there is one."""
    careful = replace(problem, limits=problem.joint_limits.scaled(LIMIT_SHARE))
    for attempt in (careful, problem):  # the start may need the rest of the limits
        with suppress(Infeasible):
            return dpct.plan(attempt, variant="free", **tolerances)
    return lagrange.plan(problem)
