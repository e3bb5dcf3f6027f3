"""The best that is possible: optima that are computed without any policy, for the leaderboard's own row."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np

from envs.obstacle_dodge import bound as dodge_bound
from planners import Infeasible, dpct, lagrange, quintic
from planners.typing import Array

Progress = Callable[[int], object]


@dataclass(frozen=True)
class Bound:
    """The best known value of one number of an episode's info.

    Attributes:
        metric: which number; the less, the better.
        meaning: for the caption of the leaderboard.
        optimum: the best known value for a seed, given a vector environment that is at its start in some environment.
    """

    metric: str
    meaning: str
    optimum: Callable[[Any, int, int], float]


def _settling_time(env: Any, env_index: int, seed: int) -> float:
    """Least settling time, s; limits and part may be missed by as much as the environment tolerates."""
    config = env.task.config
    return dpct.settling_bound(
        env.motion_problem(env_index),
        position_tolerance=config.position_tolerance,
        velocity_tolerance=config.velocity_tolerance,
        limit_tolerance=config.limit_tolerance,
    )


def _quintic_ratio(env: Any, env_index: int, seed: int) -> float:
    """Least torque, as a share of the quintic's, by dense transcription from the Lagrange planner's solution."""
    problem = env.motion_problem(env_index)
    return lagrange.plan(problem, polish=True).cost / quintic.plan(problem).cost


def _time_to_goal(env: Any, env_index: int, seed: int) -> float:
    """Least time to the goal, s, found by a search that knows the whole paths of the discs; inf if there is none.

    Looked up where the episode is one of those stored, searched for otherwise.
    """
    return dodge_bound.time_to_goal(env, env_index, seed)


BOUNDS: dict[str, Bound] = {
    "ConveyorTrack-v0": Bound(
        "settling_time", "settling time of the best known optimum within the same tolerances", _settling_time
    ),
    "MinTorqueMove-v0": Bound(
        "quintic_ratio", "torque of the best known motion, a dense transcription, over the quintic's", _quintic_ratio
    ),
    "ObstacleDodge-v0": Bound(
        "time_to_goal", "a search that knows the whole paths of the discs (half of the acceleration)", _time_to_goal
    ),
}
"""What is known, by environment."""


def best_known(
    env_id: str,
    seeds: Sequence[int],
    *,
    env_config: Mapping[str, Any],
    options: Mapping[str, Any],
    progress: Progress,
) -> Array:
    """The best known value of the bounded number for each seed's start, ``(episodes,)``; inf if none is known."""
    with closing(gym.make_vec(env_id, num_envs=len(seeds), **env_config)) as env:
        batch: Any = env.unwrapped
        batch.reset(seed=list(seeds), options=dict(options))
        values = np.full(len(seeds), np.inf)
        for env_index, seed in enumerate(seeds):
            with suppress(Infeasible):
                values[env_index] = BOUNDS[env_id].optimum(batch, env_index, seed)
            progress(1)
    return values
