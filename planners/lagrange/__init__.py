"""Least joint torque by Lagrange interpolation.

After L.-P. Luo, S.-W. Hwang and C.-S. Han, "Trajectory Planning for Torque Minimization of Robot Manipulators Using the
Lagrange Interpolation Method".

- ``variant="optimal"`` (:mod:`planners.lagrange.optimal`), the default: from start to target exactly, least torque
  within every limit, checked on a dense grid.
- ``variant="paper"`` (:mod:`planners.lagrange.paper`): the grid searches of the paper.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any, Literal, get_args

from planners.lagrange.optimal import plan_optimal
from planners.lagrange.paper import plan_paper
from planners.problem import MotionProblem, Trajectory

Variant = Literal["optimal", "paper"]

_PLANNERS: dict[Variant, Callable[..., Trajectory]] = {"optimal": plan_optimal, "paper": plan_paper}


def plan(problem: MotionProblem, variant: Variant = "optimal", **options: Any) -> Trajectory:
    """Plan a motion; options are those of :func:`plan_optimal` or :func:`planners.lagrange.paper.plan_paper`.

    Raises:
        Infeasible: if no motion solves the problem, with the reason.
        ValueError: if the variant or an option is unknown, or an option is out of range.
    """
    if variant not in _PLANNERS:
        raise ValueError(f"variant {variant!r} must be one of {', '.join(map(repr, get_args(Variant)))}")
    planner = _PLANNERS[variant]
    allowed = [name for name in inspect.signature(planner).parameters if name != "problem"]
    unknown = sorted(set(options) - set(allowed))
    if unknown:
        raise ValueError(f"variant {variant!r} has no option {', '.join(unknown)}; it has {', '.join(allowed)}")
    return planner(problem, **options)


__all__ = ["Variant", "plan", "plan_optimal", "plan_paper"]
