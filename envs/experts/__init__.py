"""Scripted experts: a planner and a tracking controller behind the `predict` of a Stable-Baselines3 policy.

An expert sees what an agent sees, the observation, and gives what an agent gives, an action in the environment's
control mode. What it must remember between steps travels in the `state` that `predict` takes and returns; without
one an expert goes on from its own last call.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import gymnasium as gym

from envs.conveyor_track.planning import meet_on_line
from envs.excavator_payload.controllers import PayloadExpert
from envs.excavator_payload.env import ExcavatorPayload
from envs.excavator_payload.waypoint_experts import FieldWayExpert, PlannedWayExpert, unhurried
from envs.experts.base import Expert
from envs.experts.follower import FollowerExpert
from envs.experts.planning import PlanningExpert
from envs.experts.potential_field import DodgingExpert, JointFieldExpert, MovingTargetExpert
from envs.experts.random_policy import RandomExpert
from envs.min_torque_move.env import MinTorqueMove
from envs.obstacle_dodge.env import ObstacleDodge
from envs.obstacle_dodge.planning import REPLAN_EVERY, pass_via_nodes, time_along_line
from envs.settings import refuse_unknown
from envs.task import Task
from planners import dpct, lagrange, quintic, trapezoid

__all__ = [
    "ADAPTIVE",
    "EXPERTS",
    "DodgingExpert",
    "Expert",
    "FieldWayExpert",
    "FollowerExpert",
    "JointFieldExpert",
    "MovingTargetExpert",
    "PayloadExpert",
    "PlannedWayExpert",
    "PlanningExpert",
    "RandomExpert",
    "expert_names",
    "is_expert",
    "make_expert",
]


def _dpct(task: Task) -> Expert:
    if isinstance(task, ObstacleDodge):
        return PlanningExpert(task, time_along_line, REPLAN_EVERY)
    if isinstance(task, ExcavatorPayload):
        return PlannedWayExpert(task, partial(dpct.plan, variant="torque"))
    if isinstance(task, MinTorqueMove):
        return PlanningExpert(task, partial(dpct.plan, variant="torque"))
    return PlanningExpert(task, meet_on_line)


def _lagrange(task: Task) -> Expert:
    if isinstance(task, ObstacleDodge):
        return PlanningExpert(task, pass_via_nodes, REPLAN_EVERY)
    if isinstance(task, ExcavatorPayload):
        return PlannedWayExpert(task, unhurried)
    return PlanningExpert(task, lagrange.plan)


def _apf(task: Task) -> Expert:
    if isinstance(task, ObstacleDodge):
        return DodgingExpert(task)
    if isinstance(task, ExcavatorPayload):
        return FieldWayExpert(task)
    return JointFieldExpert(task) if isinstance(task, MinTorqueMove) else MovingTargetExpert(task)


def _follower(task: Task) -> Expert:
    """Without planning: straight to the goal, by a quintic in joint space where the time for it is given."""
    if isinstance(task, ObstacleDodge):
        return PlanningExpert(task, trapezoid.plan)
    if isinstance(task, ExcavatorPayload):
        return PlannedWayExpert(task, quintic.plan)
    return PlanningExpert(task, quintic.plan) if isinstance(task, MinTorqueMove) else FollowerExpert(task)


def _controlled(name: str, task: Task) -> Expert:
    """A controller on the reference that the environment gives."""
    if not isinstance(task, ExcavatorPayload):
        raise ValueError(
            f'expert "{name}" tracks the reference of {ExcavatorPayload.env_id}; {task.env_id} gives none: '
            f"choose one of {', '.join(expert_names(task.env_id))}"
        )
    return _CONTROLLED[name](task)


_CONTROLLED: dict[str, Callable[[ExcavatorPayload], Expert]] = {
    "adaptive": PayloadExpert,
    "adaptive_computed_torque": partial(PayloadExpert, controller="adaptive-computed-torque", moments=False),
    "integral_computed_torque": partial(PayloadExpert, controller="integral-computed-torque"),
    "computed_torque": partial(PayloadExpert, controller="computed-torque"),
}
"""Experts that are a controller and no more."""

EXPERTS: dict[str, Callable[[Task], Expert]] = {
    "dpct": _dpct,
    "lagrange": _lagrange,
    "apf": _apf,
    "follower": _follower,
    "random": RandomExpert,
    **{name: partial(_controlled, name) for name in _CONTROLLED},
}
"""How each expert is made from a task."""


def expert_names(env_id: str) -> list[str]:
    """Names of the experts that can act in an environment."""
    return [name for name in EXPERTS if name not in _CONTROLLED or env_id == ExcavatorPayload.env_id]


ADAPTIVE = "+adaptive"
"""What follows the name of an expert that estimates the payload and adapts to it: ``"dpct+adaptive"``."""


def is_expert(name: str) -> bool:
    """Whether an expert has this name, with `ADAPTIVE` or without."""
    return name.removesuffix(ADAPTIVE) in EXPERTS


def make_expert(
    name: str, env: gym.Env[Any, Any] | gym.vector.VectorEnv[Any, Any, Any], *, adaptive: bool = False
) -> Expert:
    """A scripted expert for an environment.

    Args:
        name: one of `EXPERTS`; ``"dpct+adaptive"`` is ``"dpct"`` that is adaptive.
        env: the environment, single or vector, wrapped or not.
        adaptive: estimate the payload on the hand, and adapt to it; see `Expert.adapt`.

    Raises:
        ValueError: if there is no such expert, the environment is not one of planarm's, or nothing tells an adaptive
            expert what its torques have done.
    """
    plain = name.removesuffix(ADAPTIVE)
    refuse_unknown([plain], EXPERTS, "expert")
    task = getattr(env.unwrapped, "task", None)
    if not isinstance(task, Task):
        raise ValueError(f"{env} is not one of planarm's environments; experts need one, such as ConveyorTrack-v0")
    expert = EXPERTS[plain](task)
    return expert.adapt() if adaptive or plain != name else expert
