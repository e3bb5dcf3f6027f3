"""DPCT: dynamic programming for conveyor tracking.

A hand meets a part on a moving conveyor and rides with it, within limits of joint torque, velocity, acceleration and
jerk. After T. H. Park, B. H. Lee and M. S. Ko, "Motion Planning of a Robot Manipulator for Conveyor Tracking".

- ``variant="optimal"`` (:mod:`planners.dpct.optimal`), the default: earliest rendezvous, then least tracking index,
  exact in time and checked on a dense grid.
- ``variant="free"`` (:mod:`planners.dpct.free.planner`): the earliest meeting of a moving target off its line too, from
  any start; with tolerances the earliest time within them.
- ``variant="paper"`` (:mod:`planners.dpct.paper`): the search of the paper in the phase plane, with its own clock.
- ``variant="torque"`` (:mod:`planners.dpct.torque.planner`): to rest at a fixed target exactly at the horizon, with the
  least torque on the straight path there; limits of jerk are not kept.
- ``variant="timing"`` (:mod:`planners.dpct.timing.planner`): to rest at a fixed target past moving discs, by the
  timing of a straight path; limits of jerk are not kept.
"""

from __future__ import annotations

from typing import Any, Literal

from planners.capabilities import plan_variant
from planners.dpct.free.planner import plan_free
from planners.dpct.optimal import plan_optimal
from planners.dpct.paper import plan_paper
from planners.dpct.settling import settling_bound
from planners.dpct.timing.planner import plan_timing
from planners.dpct.torque.planner import plan_torque
from planners.problem import MotionProblem
from planners.trajectory import Trajectory

Variant = Literal["optimal", "free", "paper", "torque", "timing"]
"""Names of the algorithms: earliest meeting on the line, off it, as published, least torque, timing past discs."""


def plan(problem: MotionProblem, variant: Variant = "optimal", **options: Any) -> Trajectory:
    """Plan a motion; options are those of :func:`plan_optimal`, :func:`plan_free`, :func:`plan_paper`,
    :func:`plan_torque` or :func:`plan_timing`.

    Raises:
        Infeasible: if no motion solves the problem, with the reason.
        ValueError: if the variant or an option is unknown, or an option is out of range.
    """
    return plan_variant("dpct", variant, problem, options)


__all__ = ["Variant", "plan", "plan_free", "plan_optimal", "plan_paper", "plan_timing", "plan_torque", "settling_bound"]
