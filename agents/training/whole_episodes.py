"""Vector environments whose step is a whole episode, for policies that decide once."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.vector import VectorWrapper
from numpy.typing import NDArray

from envs.observation import Observation
from planners.typing import Array

Info = dict[str, Any]


class WholeEpisodes(VectorWrapper):
    """Holds an action to the end of the episode, in every environment, and then begins new episodes in all of them.

    The reward of a step is the episode's return, so that every step ends an episode.
    """

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[Observation, Array, NDArray[np.bool_], NDArray[np.bool_], Info]:
        """One episode in every environment."""
        returns = np.zeros(self.num_envs)
        terminated, truncated = np.zeros((2, self.num_envs), dtype=bool)
        running = np.ones(self.num_envs, dtype=bool)
        last: Info = {}
        while running.any():
            _, rewards, terminates, truncates, infos = self.env.step(actions)
            returns[running] += rewards[running]
            ended = running & (terminates | truncates)
            if ended.any():
                terminated |= ended & terminates
                truncated |= ended & truncates
                told = {name: infos[name] for name in ("final_obs", "final_info")}
                last = _where(ended, told, last) if last else told
                running &= ~ended
        observations, infos = self.env.reset()
        return observations, returns, terminated, truncated, {**infos, **last}


def _where(where: NDArray[np.bool_], new: Info, old: Info) -> Info:
    """Infos of Gymnasium's vector form, with those of some environments replaced."""
    merged: Info = {}
    for name, values in new.items():
        if isinstance(values, dict):
            merged[name] = _where(where, values, old.get(name, {}))
        elif name in old:
            chosen = where.reshape(-1, *[1] * (values.ndim - 1))
            merged[name] = np.where(chosen, values, old[name])
        else:
            merged[name] = values
    return merged
