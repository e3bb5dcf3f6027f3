"""APF: artificial potential fields. The goal attracts, obstacles repel, and the arm follows the sum.

After O. Khatib, "Real-time obstacle avoidance for manipulators and mobile robots" (1986), and T. H. Kim, M. S. Park,
S. Y. Song and S. K. Hong, "Collision-free trajectory planning for SCARA robot".

- ``variant="field"``, the default (:mod:`planners.apf.prediction`), simulates the fields of the experts: around the
  whole arm among moving discs (:mod:`planners.apf.dodge`), relative to a moving target
  (:mod:`planners.apf.moving_target`), or in joint space to rest in a given time (:mod:`planners.apf.joint_field`).
- ``variant="paper"`` (:mod:`planners.apf.paper`): Khatib's field on the hand, with the paper's distance function.

A controller evaluates a field at every instant. `plan` gives the motion if every obstacle keeps its velocity.
"""

from __future__ import annotations

from typing import Any, Literal

from planners.apf.dodge import DodgeGains, dodge_accelerations, new_memory, tuned_gains
from planners.apf.paper import plan_paper
from planners.apf.prediction import plan_field
from planners.capabilities import plan_variant
from planners.problem import MotionProblem
from planners.trajectory import Trajectory

Variant = Literal["field", "paper"]
"""Names of the fields: those of the experts, and the one as published."""


def plan(problem: MotionProblem, variant: Variant = "field", **options: Any) -> Trajectory:
    """Plan a motion; options are those of :func:`plan_field` or :func:`plan_paper`.

    Raises:
        Infeasible: if the motion does not reach the target, with the reason.
        ValueError: if the variant or an option is unknown, or an option is out of range.
    """
    return plan_variant("apf", variant, problem, options)


__all__ = [
    "DodgeGains",
    "Variant",
    "dodge_accelerations",
    "new_memory",
    "plan",
    "plan_field",
    "plan_paper",
    "tuned_gains",
]
