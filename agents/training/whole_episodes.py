"""Vector environments whose step is a whole episode, for policies that act once an episode."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.vector import VectorWrapper
from numpy.typing import NDArray

from envs.observation import Observation
from planners.typing import Array

Info = dict[str, Any]


class WholeEpisodes(VectorWrapper):
    """Repeats an action to the end of the episode in every environment, then begins new episodes in all of them.

    Every step ends an episode; its reward is the episode's return.
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
                final = {name: infos[name] for name in ("final_obs", "final_info")}
                last = replaced_where(ended, final, last) if last else final
                running &= ~ended
        observations, infos = self.env.reset()
        return observations, returns, terminated, truncated, {**infos, **last}


def replaced_where(where: NDArray[np.bool_], new: Info, old: Info) -> Info:
    """Gymnasium's vector infos, with those of some environments replaced."""
    merged: Info = {}
    for name, values in new.items():
        if isinstance(values, dict):
            merged[name] = replaced_where(where, values, old.get(name, {}))
        elif name in old:
            chosen = where.reshape(-1, *[1] * (values.ndim - 1))
            merged[name] = np.where(chosen, values, old[name])
        else:
            merged[name] = values
    return merged
