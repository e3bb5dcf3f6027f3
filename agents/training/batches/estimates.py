"""A belt with declared uncertainty as a network acts on it: by estimates, with jerks of the estimated arm."""

from __future__ import annotations

from contextlib import closing
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import VectorEnv, VectorWrapper
from numpy.typing import NDArray

from agents.environments import make_batch
from agents.training.batches.levels import Info, Step
from agents.training.recipe import PPOConfig
from envs.conveyor_track.env import ConveyorTrack
from envs.conveyor_track.filtered import FilteredPolicy, whole_observations
from envs.experts.robust import RobustState, RobustTracking
from envs.observation import Observation
from envs.uncertainty.draw import DRAWN
from planners.control import Estimate

Conditions = list[tuple[dict[str, Any], dict[str, Any]]]


def acts_on_estimates(env: VectorEnv[Any, Any, Any]) -> bool:
    """Whether a network that was trained without uncertainty acts on estimates in a vector environment."""
    return FilteredPolicy.wanted(getattr(env.unwrapped, "task", None))


def certain_conditions(config: PPOConfig) -> Conditions:
    """Settings and reset options at which the network of a recipe that acts on estimates learns from an expert.

    Those of the levels without declared uncertainty; if there is none, of the task without it.
    """
    plain = {name: value for name, value in config.env_config.items() if name not in (*DRAWN, "mass_error")}
    return _certain(config) or [(plain, {})]


def _certain(config: PPOConfig) -> Conditions:
    """Settings and reset options at the levels at which a network does not act on estimates."""
    certain = []
    for settings, options in config.conditions:
        with closing(make_batch(config.env_id, 1, settings)) as env:
            if not acts_on_estimates(env):
                certain.append((settings, options))
    return certain


def check_estimates(config: PPOConfig) -> None:
    """Raise a ValueError for a recipe without a level at which a network acts on estimates, or with a dataset."""
    if len(_certain(config)) == len(config.conditions):
        raise ValueError(
            "estimates are of ConveyorTrack-v0 with control_mode jerk and declared uncertainty: give a level such as "
            "noise, or leave estimates out"
        )
    if config.warm_start is not None and config.warm_start.dataset is not None:
        raise ValueError(
            "a dataset holds no estimates: with estimates, give warm_start an expert, or leave warm_start out"
        )


class OnEstimates(VectorWrapper):
    """What a network observes and does within `FilteredPolicy`, as a vector environment to train it in.

    Args:
        env: a batch of the belt, for which `FilteredPolicy.wanted` holds, that resets in the step that ends an episode.
    """

    def __init__(self, env: VectorEnv[Any, Any, Any]) -> None:
        super().__init__(env)
        self._task: ConveyorTrack = env.unwrapped.task  # type: ignore[attr-defined]
        self._robust = RobustTracking(self._task)
        self._state: RobustState | None = None
        self._estimate: Estimate | None = None

    def reset(self, *, seed: Any = None, options: Info | None = None) -> tuple[Observation, Info]:
        """Begin an episode in every environment."""
        observations, infos = self.env.reset(seed=seed, options=options)
        return self._estimated(observations, None, np.ones(self.num_envs, dtype=np.bool_)), infos

    def step(self, actions: NDArray[np.float32]) -> Step:
        """One control period in every environment."""
        if self._state is None or self._estimate is None:
            raise gym.error.ResetNeeded("no episode has begun: call reset() first")
        shares = np.clip(actions, -1.0, 1.0).astype(np.float32)
        commands, state = self._robust.act(self._state, self._estimate, shares, ())
        observations, rewards, terminated, truncated, infos = self.env.step(commands)
        ended = terminated | truncated
        if ended.any():
            chosen, last = np.flatnonzero(ended).tolist(), observations.copy()
            for index in chosen:
                last[index] = infos["final_obs"][index]
            seen = whole_observations(self._task, self._robust.update(last, state, np.zeros_like(ended))[0])
            final = np.full(self.num_envs, None, dtype=object)
            for index in chosen:
                final[index] = seen[index]
            infos = {**infos, "final_obs": final}
        return self._estimated(observations, state, ended), rewards, terminated, truncated, infos

    def _estimated(
        self, observations: Observation, before: RobustState | None, begins: NDArray[np.bool_]
    ) -> Observation:
        """What the network observes; keeps the estimate that its action will be turned into a command by."""
        expected, self._estimate, self._state, _ = self._robust.update(observations, before, begins)
        return whole_observations(self._task, expected)
