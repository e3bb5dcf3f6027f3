"""Vector environments at difficulty levels: with options in every reset, and several levels side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from envs.observation import Observation
from planners.typing import Array

Info = dict[str, Any]
Step = tuple[Observation, Array, NDArray[np.bool_], NDArray[np.bool_], Info]


class SameOptions(VectorWrapper):
    """Resets with the same options whenever an episode ends; as with ``SAME_STEP``, in the step that ends it.

    Args:
        env: a vector environment of planarm with ``autoreset_mode=AutoresetMode.DISABLED``.
        options: of every reset.
    """

    def __init__(self, env: VectorEnv[Any, Any, Any], options: Mapping[str, Any]) -> None:
        super().__init__(env)
        self._options = dict(options)
        self.metadata = {**env.metadata, "autoreset_mode": AutoresetMode.SAME_STEP}

    def reset(self, *, seed: Any = None, options: Info | None = None) -> tuple[Observation, Info]:
        """Begin an episode in every environment; ``options`` go before those of the wrapper."""
        return self.env.reset(seed=seed, options={**self._options, **(options or {})})

    def step(self, actions: NDArray[np.float32]) -> Step:
        """One control period in every environment."""
        observations, rewards, terminated, truncated, infos = self.env.step(actions)
        ended = terminated | truncated
        if ended.any():
            final = np.full(self.num_envs, None, dtype=object)
            for index in np.flatnonzero(ended).tolist():
                final[index] = observations[index].copy()
            observations, begun = self.env.reset(options={**self._options, "reset_mask": ended})
            infos = {**begun, "final_obs": final, "_final_obs": ended, "final_info": infos, "_final_info": ended}
        return observations, rewards, terminated, truncated, infos


class SideBySide(VectorEnv[Observation, NDArray[np.float32], Any]):
    """Several batches as one: environments in the order of the batches.

    Infos are those of the episodes that end, ``final_obs`` and ``final_info``.

    Args:
        batches: vector environments with the same spaces, which reset in the step that ends an episode.

    Raises:
        ValueError: if their observations or actions differ.
    """

    metadata: ClassVar[Info] = {"autoreset_mode": AutoresetMode.SAME_STEP}  # type: ignore[misc]

    def __init__(self, batches: Sequence[VectorEnv[Any, Any, Any]]) -> None:
        self.batches = tuple(batches)
        first = self.batches[0]
        for batch in self.batches:
            for name in ("single_observation_space", "single_action_space"):
                if getattr(batch, name) != getattr(first, name):
                    raise ValueError(
                        f"levels differ in their {name.removeprefix('single_').replace('_', ' ')}: "
                        f"{getattr(batch, name).shape} and {getattr(first, name).shape}; give all the same room, such "
                        "as env_config.observed_discs=4 of ObstacleDodge-v0"
                    )
        self.num_envs = sum(batch.num_envs for batch in self.batches)
        self.single_observation_space, self.single_action_space = (
            first.single_observation_space,
            first.single_action_space,
        )
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._ends = np.cumsum([batch.num_envs for batch in self.batches])

    def reset(self, *, seed: int | None = None, options: Info | None = None) -> tuple[Observation, Info]:
        """Begin an episode in every environment; environment i with ``seed`` + i."""
        firsts = self._ends - [batch.num_envs for batch in self.batches]
        begun = [
            batch.reset(seed=None if seed is None else seed + int(first), options=options)
            for batch, first in zip(self.batches, firsts, strict=True)
        ]
        return np.concatenate([observations for observations, _ in begun]), {}

    def step(self, actions: NDArray[np.float32]) -> Step:
        """One step of every batch."""
        parts = zip(self.batches, np.split(actions, self._ends[:-1]), strict=True)
        steps = [batch.step(part) for batch, part in parts]
        observations, rewards, terminated, truncated = (
            np.concatenate(column) for column in list(zip(*(step[:4] for step in steps), strict=True))
        )
        sizes = [batch.num_envs for batch in self.batches]
        ended: list[Info] = [
            {name: step[4][name] for name in ("final_obs", "final_info") if name in step[4]} for step in steps
        ]
        return observations, rewards, terminated, truncated, _joined(ended, sizes)

    def close_extras(self, **kwargs: Any) -> None:
        """Close every batch."""
        for batch in self.batches:
            batch.close()


def _joined(infos: Sequence[Info], sizes: Sequence[int]) -> Info:
    """Infos of batches as those of one; zeros, or None among objects, where a batch has no such info."""
    joined: Info = {}
    for name in dict.fromkeys(name for info in infos for name in info):
        present = [info.get(name) for info in infos]
        if any(isinstance(values, dict) for values in present):
            joined[name] = _joined([values or {} for values in present], sizes)
        else:
            like = next(np.asarray(values) for values in present if values is not None)
            empty = None if like.dtype == object else 0
            joined[name] = np.concatenate(
                [
                    np.full((size, *like.shape[1:]), empty, like.dtype) if values is None else np.asarray(values)
                    for values, size in zip(present, sizes, strict=True)
                ]
            )
    return joined
