"""One episode of a policy in a single environment, observed step by step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np

from agents.policies.policy import Actor, Policy, PolicyMaker

Info = dict[str, Any]


def play(
    env: gym.Env[Any, Any],
    policy: Policy | PolicyMaker | str,
    seed: int,
    reset_options: Info,
    observe: Callable[[int, bool], None] = lambda steps, ended: None,
) -> Info:
    """Run one episode of a policy in a single environment; its last info, with ``return`` and ``length``.

    ``observe`` is called after the reset and after every step with the steps so far and whether the episode has ended.
    """
    actor = Actor(
        policy, env, policy if isinstance(policy, str) else getattr(policy, "__name__", type(policy).__name__)
    )
    observation, info = env.reset(seed=seed, options=reset_options)
    state, begins, steps, total, ended = None, np.ones(1, dtype=bool), 0, 0.0, False
    observe(steps, ended)
    while not ended:
        actions, state = actor.act(observation[None], state, begins)
        observation, reward, terminated, truncated, info = env.step(actions[0])
        begins, steps, total = np.zeros(1, dtype=bool), steps + 1, total + float(reward)
        ended = terminated or truncated
        observe(steps, ended)
    return {"return": total, "length": steps, **info}
