"""Scripted experts: a planner and a tracking controller behind the `predict` of a Stable-Baselines3 policy.

An expert reads the observation, as an agent does, and returns an action in the environment's control mode. Its memory
is the `state` that `predict` takes and returns; without one an expert continues from its own last call.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym

from envs.card import env_ids, task_card
from envs.experts.base import Expert, Planner
from envs.experts.planning import PlanningExpert
from envs.experts.reactive import FollowerExpert, JointFieldExpert, MovingTargetExpert, RandomExpert
from envs.settings import refuse_unknown
from envs.task import Task
from planners import Infeasible, MotionProblem, Trajectory
from planners.capabilities import own_planners

__all__ = [
    "ADAPTIVE",
    "Expert",
    "FollowerExpert",
    "JointFieldExpert",
    "MovingTargetExpert",
    "PlanningExpert",
    "RandomExpert",
    "expert_names",
    "is_expert",
    "make_expert",
]

ADAPTIVE = "+adaptive"
"""Suffix of the name of an expert that estimates the payload and adapts to it: ``"dpct+adaptive"``."""


def _experts(env_id: str) -> dict[str, Callable[[Any], Expert]]:
    """How each expert is made from a task: the user's own planners, those of its card, and the random one."""
    card = task_card(env_id)

    def tracking(planner: Planner) -> Callable[[Any], Expert]:
        return lambda task: PlanningExpert(task, planner, card.replan_every)

    def named(name: str, planner: Planner) -> Planner:
        def plan(problem: MotionProblem) -> Trajectory:
            try:
                return planner(problem)
            except ValueError as error:
                if isinstance(error, Infeasible):
                    raise
                raise ValueError(f"the planner {name} cannot act in {env_id}: {error}") from error

        return plan

    own = {name: tracking(named(name, planner)) for name, planner in own_planners().items()}
    return {**own, **card.experts, "random": RandomExpert}


def expert_names(env_id: str) -> list[str]:
    """Names of the experts that can act in an environment."""
    return list(_experts(env_id))


def is_expert(name: str) -> bool:
    """Whether an expert of any registered task has this name, with `ADAPTIVE` or without."""
    return any(name.removesuffix(ADAPTIVE) in _experts(env_id) for env_id in env_ids())


def make_expert(
    name: str, env: gym.Env[Any, Any] | gym.vector.VectorEnv[Any, Any, Any], *, adaptive: bool = False
) -> Expert:
    """A scripted expert for an environment.

    Args:
        name: one of `expert_names`; ``"dpct+adaptive"`` is ``"dpct"`` that is adaptive.
        env: the environment, single or vector, wrapped or not.
        adaptive: estimate the payload on the hand, and adapt to it; see `Expert.adapt`.

    Raises:
        ValueError: if the task has no such expert, the environment is no task of planarm's kind, a wrapper transforms
            its observations or actions, or the observations do not show an adaptive expert the effect of its torques.
    """
    task = getattr(getattr(env, "unwrapped", None), "task", None)
    if not isinstance(task, Task):
        raise ValueError(f"{env!r:.80} is not one of planarm's environments; experts need one")
    refuse_transformed(env, f"expert {name}")
    experts, plain = _experts(task.env_id), str(name).removesuffix(ADAPTIVE)
    refuse_unknown([plain], experts, f"{task.env_id} expert")
    expert = experts[plain](task)
    return expert.adapt() if adaptive or plain != name else expert


def refuse_transformed(env: gym.Env[Any, Any] | gym.vector.VectorEnv[Any, Any, Any], who: str) -> None:
    """Raise a ValueError if a wrapper transforms the observations or actions of one of planarm's environments.

    ``who`` reads the observations as the task gives them, and is named in the message.
    """
    task: Any = getattr(env.unwrapped, "task", None)
    layer: Any = env
    while isinstance(layer, (gym.Wrapper, gym.vector.VectorWrapper)):
        if _transforms_observations(layer):
            raise ValueError(
                f"{who} reads the observations as {task.env_id} gives them, and {type(layer).__name__} transforms "
                "them: make it for the environment inside, and give it that one's observations"
            )
        if _transforms_actions(layer):
            raise ValueError(
                f"{who} gives actions as {task.env_id} takes them, and {type(layer).__name__} transforms them: leave "
                "the wrapper out"
            )
        layer = layer.env
    actions = env.single_action_space if isinstance(env, gym.vector.VectorEnv) else env.action_space
    if isinstance(task, Task) and actions != task.action_space():
        raise ValueError(
            f"{who} gives actions in {task.action_space()}, and a wrapper makes them {actions}: leave the wrapper out"
        )


def _transforms_observations(layer: Any) -> bool:
    """Whether the observations of a wrapper are others than those of the environment inside, or at other times."""
    skips = gym.wrappers.MaxAndSkipObservation, getattr(gym.wrappers, "RepeatAction", ())  # new in Gymnasium 1.3
    kinds = gym.ObservationWrapper, gym.vector.VectorObservationWrapper, skips
    same_space = layer.observation_space == layer.env.observation_space
    return isinstance(layer, kinds) or not same_space


def _transforms_actions(layer: Any) -> bool:
    """Whether a wrapper replaces actions by others of the same space."""
    kinds = gym.ActionWrapper, gym.vector.VectorActionWrapper
    return isinstance(layer, kinds) and bool(layer.action_space == layer.env.action_space)
