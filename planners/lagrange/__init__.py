"""Least joint torque by Lagrange interpolation.

After L.-P. Luo, S.-W. Hwang and C.-S. Han, "Trajectory Planning for Torque Minimization of Robot Manipulators Using the
Lagrange Interpolation Method".

- ``variant="optimal"`` (:mod:`planners.lagrange.optimal`), the default: from start to target exactly, least torque
  within every limit, checked on a dense grid.
- ``variant="via"`` (:mod:`planners.lagrange.via.planner`): past moving obstacles, as soon as possible, by via-nodes.
- ``variant="paper"`` (:mod:`planners.lagrange.paper`): the grid searches of the paper.
"""

from __future__ import annotations

from typing import Any, Literal

from planners.capabilities import plan_variant
from planners.lagrange.optimal import plan_optimal
from planners.lagrange.paper import plan_paper
from planners.lagrange.via.planner import plan_via
from planners.problem import MotionProblem
from planners.trajectory import Trajectory

Variant = Literal["optimal", "via", "paper"]
"""Names of the algorithms: least torque, past discs, as published."""


def plan(problem: MotionProblem, variant: Variant = "optimal", **options: Any) -> Trajectory:
    """Plan a motion; options are those of :func:`plan_optimal`, :func:`plan_via` or :func:`plan_paper`.

    Raises:
        Infeasible: if no motion solves the problem, with the reason.
        ValueError: if the variant or an option is unknown, or an option is out of range.
    """
    return plan_variant("lagrange", variant, problem, options)


__all__ = ["Variant", "plan", "plan_optimal", "plan_paper", "plan_via"]
