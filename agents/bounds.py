"""The best that is possible: optima that are computed without any policy, for the leaderboard's own row."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing, suppress
from typing import Any

import gymnasium as gym
import numpy as np

from agents.evaluation import Progress
from planners import Infeasible, dpct
from planners.typing import Array


def has_bound(env_id: str) -> bool:
    """Whether the optimum of an environment is known."""
    return env_id == "ConveyorTrack-v0"


def settling_bounds(
    env_id: str,
    seeds: Sequence[int],
    *,
    env_config: Mapping[str, Any],
    options: Mapping[str, Any],
    progress: Progress,
) -> Array:
    """Least settling time (s) that is known to be possible from each seed's start, ``(episodes,)``; inf if none is.

    The limits may be exceeded, and the hand may miss the part, by as much as the environment tolerates.
    """
    with closing(gym.make_vec(env_id, num_envs=len(seeds), **env_config)) as env:
        batch: Any = env.unwrapped
        batch.reset(seed=list(seeds), options=dict(options))
        config = batch.task.config
        bounds = np.full(len(seeds), np.inf)
        for lane in range(len(seeds)):
            with suppress(Infeasible):
                bounds[lane] = dpct.settling_bound(
                    batch.motion_problem(lane),
                    position_tolerance=config.position_tolerance,
                    velocity_tolerance=config.velocity_tolerance,
                    limit_tolerance=config.limit_tolerance,
                )
            progress(1)
    return bounds
