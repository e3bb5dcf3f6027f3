"""A vector environment whose actions are forecasts of a disc, on which the expert apf acts."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from agents.training.batches.levels import Info, Step
from agents.training.whole_episodes import replaced_where
from envs.observation import Observation
from envs.obstacle_dodge.forecasts import INPUTS, OUTPUTS, PACE, ForecastingExpert
from planners.typing import Array

DECISION = 2
"""Control periods for which a decision of the field holds."""

_MOST = np.float32(10.0)  # an input: a time, a length or a velocity, in SI units


class Forecasting(VectorWrapper):
    """A step is a forecast, a decision of the field with it, and the control periods for which that holds.

    Its reward is the sum of theirs. Where an episode ends in the first of them, the next one begins with a straight
    forecast, and its rewards until the next step are left out.

    Args:
        env: ObstacleDodge-v0 with one disc, a vector environment that resets in the step that ends an episode.
    """

    def __init__(self, env: VectorEnv[Any, Any, Any]) -> None:
        super().__init__(env)
        self._task = env.unwrapped.task  # type: ignore[attr-defined]
        self._expert = ForecastingExpert(self._task, _straight)
        self._rows = np.arange(self.num_envs)
        self._seen: dict[str, Array] = {}
        self._track: Any = None
        self._inputs: Observation = np.zeros((0, INPUTS), np.float32)
        self.single_observation_space = gym.spaces.Box(-_MOST, _MOST, (INPUTS,), np.float32)
        self.single_action_space = gym.spaces.Box(-1.0, 1.0, (OUTPUTS,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)

    def reset(self, *, seed: Any = None, options: Info | None = None) -> tuple[Observation, Info]:
        """Begin an episode in every environment."""
        observations, infos = self.env.reset(seed=seed, options=options)
        return self._follow(observations, None, np.ones(self.num_envs, dtype=bool)), infos

    def step(self, actions: NDArray[np.float32]) -> Step:
        """One forecast in every environment, ``(num_envs, OUTPUTS)``."""
        rewards = np.zeros(self.num_envs)
        terminated, truncated = np.zeros((2, self.num_envs), dtype=bool)
        final: NDArray[Any] = np.full(self.num_envs, None, dtype=object)
        last: Info = {}
        forecasts = np.asarray(actions, dtype=float)
        for _ in range(DECISION):
            running = ~(terminated | truncated)
            torques, track = self._expert.act(self._seen, self._track, self._rows, forecasts[:, None])
            bounded = np.clip(torques, -1.0, 1.0).astype(np.float32)
            observations, earned, terminates, truncates, infos = self.env.step(bounded)
            rewards[running] += earned[running]
            ended = terminates | truncates
            new = ended & running
            if new.any():
                last = replaced_where(new, infos["final_info"], last) if last else infos["final_info"]
                for index in np.flatnonzero(new).tolist():
                    final[index] = self._inputs[index].copy()  # one period before the end
                terminated |= new & terminates
                truncated |= new & truncates
            self._inputs = self._follow(observations, track, ended)
            forecasts = _straight(self._inputs).astype(float)  # for episodes that have just begun
        self._track.field["decided"] = False
        return self._inputs, rewards, terminated, truncated, {"final_obs": final, "final_info": last} if last else {}

    def _follow(self, observations: Observation, track: Any, begins: NDArray[np.bool_]) -> Observation:
        self._seen = self._task.layout.parse(observations)
        self._track = self._expert.followed(self._seen, track, begins)
        self._inputs = self._expert.inputs(self._seen, self._track, self._rows, 0)
        return self._inputs


def _straight(inputs: Observation) -> NDArray[np.float32]:
    """Forecasts that a disc keeps its velocity, ``(num_envs, OUTPUTS)``."""
    forecasts = np.zeros((len(inputs), OUTPUTS), np.float32)
    forecasts[:, 0::2] = inputs[:, 2:3] / PACE
    return forecasts
