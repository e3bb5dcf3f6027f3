"""Best known optima per episode, for the bound row of the leaderboard."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing, suppress
from typing import Any

import gymnasium as gym
import numpy as np

from agents.evaluation.evaluate import Progress
from envs.card import Bound
from planners import Infeasible
from planners.typing import Array


def best_known(
    env_id: str,
    bound: Bound,
    seeds: Sequence[int],
    *,
    env_config: Mapping[str, Any],
    options: Mapping[str, Any],
    progress: Progress,
) -> Array:
    """The best known value of the bounded metric for each seed's start, ``(episodes,)``; inf if none is known."""
    with closing(gym.make_vec(env_id, num_envs=len(seeds), **env_config)) as env:
        batch: Any = env.unwrapped
        batch.reset(seed=list(seeds), options=dict(options))
        values = np.full(len(seeds), np.inf)
        for env_index, seed in enumerate(seeds):
            with suppress(Infeasible):
                values[env_index] = bound.optimum(batch, env_index, seed)
            progress(1)
    return values
