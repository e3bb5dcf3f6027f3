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

from envs.experts.base import Expert
from envs.experts.dodging import REPLAN_EVERY, pass_via_nodes, time_along_line
from envs.experts.follower import FollowerExpert
from envs.experts.planning import PlanningExpert
from envs.experts.potential_field import DodgingExpert, JointFieldExpert, MovingTargetExpert
from envs.experts.uniform import RandomExpert
from envs.min_torque_move import MinTorqueMove
from envs.obstacle_dodge import ObstacleDodge
from envs.settings import refuse_unknown
from envs.task import Task
from planners import dpct, lagrange, quintic, trapezoid

__all__ = [
    "EXPERTS",
    "DodgingExpert",
    "Expert",
    "FollowerExpert",
    "JointFieldExpert",
    "MovingTargetExpert",
    "PlanningExpert",
    "RandomExpert",
    "make_expert",
]


def _dpct(task: Task) -> Expert:
    if isinstance(task, ObstacleDodge):
        return PlanningExpert(task, time_along_line, REPLAN_EVERY)
    if isinstance(task, MinTorqueMove):
        return PlanningExpert(task, partial(dpct.plan, variant="torque"))
    return PlanningExpert(task, partial(dpct.plan, allow_reverse=True, explain=False))


def _lagrange(task: Task) -> Expert:
    if isinstance(task, ObstacleDodge):
        return PlanningExpert(task, pass_via_nodes, REPLAN_EVERY)
    return PlanningExpert(task, lagrange.plan)


def _apf(task: Task) -> Expert:
    if isinstance(task, ObstacleDodge):
        return DodgingExpert(task)
    return JointFieldExpert(task) if isinstance(task, MinTorqueMove) else MovingTargetExpert(task)


def _follower(task: Task) -> Expert:
    """Without planning: straight to the goal, by a quintic in joint space where the time for it is given."""
    if isinstance(task, ObstacleDodge):
        return PlanningExpert(task, trapezoid.plan)
    return PlanningExpert(task, quintic.plan) if isinstance(task, MinTorqueMove) else FollowerExpert(task)


EXPERTS: dict[str, Callable[[Task], Expert]] = {
    "dpct": _dpct,
    "lagrange": _lagrange,
    "apf": _apf,
    "follower": _follower,
    "random": RandomExpert,
}
"""How each expert is made from a task."""


def make_expert(name: str, env: gym.Env[Any, Any] | gym.vector.VectorEnv[Any, Any, Any]) -> Expert:
    """A scripted expert for an environment.

    Args:
        name: one of `EXPERTS`.
        env: the environment, single or vector, wrapped or not.

    Raises:
        ValueError: if there is no such expert, or the environment is not one of planarm's.
    """
    refuse_unknown([name], EXPERTS, "expert")
    task = getattr(env.unwrapped, "task", None)
    if not isinstance(task, Task):
        raise ValueError(f"{env} is not one of planarm's environments; experts need one, such as ConveyorTrack-v0")
    return EXPERTS[name](task)
