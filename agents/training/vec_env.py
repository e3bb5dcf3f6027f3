"""planarm's vector environments as Stable-Baselines3 wants them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.vec_env.base_vec_env import VecEnv, VecEnvIndices, VecEnvObs, VecEnvStepReturn


class NativeVecEnv(VecEnv):  # type: ignore[misc]
    """A vector environment of Gymnasium that begins the next episode in the step that ends the last, for SB3.

    Infos are empty but for environments whose episode has just ended. Those hold the episode's last info, ``episode``
    (return
    and length, as Monitor writes them), ``terminal_observation``, and ``TimeLimit.truncated``, by which SB3 tells that
    the value of what would have come must be added.

    Args:
        env: any of planarm's vector environments.

    Raises:
        ValueError: if the environment resets its environments in another way.
    """

    def __init__(self, env: gym.vector.VectorEnv[Any, Any, Any]) -> None:
        if env.metadata.get("autoreset_mode") != AutoresetMode.SAME_STEP:
            raise ValueError(f"{env} does not reset an environment in the step that ends its episode (SAME_STEP)")
        self.env = env
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)
        self._first_seed: int | None = None
        self._actions: NDArray[np.float32] = np.zeros(0, dtype=np.float32)
        self._returns = np.zeros(self.num_envs)
        self._lengths = np.zeros(self.num_envs, dtype=np.int64)

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Let the next reset begin from this seed: environment i with seed + i."""
        self._first_seed = seed
        return [None if seed is None else seed + env_index for env_index in range(self.num_envs)]

    def reset(self) -> VecEnvObs:
        """Begin an episode in every environment."""
        observations: VecEnvObs
        observations, _ = self.env.reset(seed=self._first_seed)
        self._first_seed = None
        self._returns[:] = 0.0
        self._lengths[:] = 0
        return observations

    def step_async(self, actions: NDArray[np.float32]) -> None:
        """Take the actions of the next step."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """One control period in every environment."""
        observations, rewards, terminated, truncated, infos = self.env.step(self._actions)
        self._returns += rewards
        self._lengths += 1
        ended = terminated | truncated
        told: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for env_index in np.flatnonzero(ended).tolist():
            told[env_index] = {
                **_of_env(infos["final_info"], env_index),
                "episode": {"r": float(self._returns[env_index]), "l": int(self._lengths[env_index]), "t": 0.0},
                "terminal_observation": infos["final_obs"][env_index],
                "TimeLimit.truncated": bool(truncated[env_index] and not terminated[env_index]),
            }
        self._returns[ended] = 0.0
        self._lengths[ended] = 0
        return observations, rewards.astype(np.float32), ended, told

    def close(self) -> None:
        """Let the environment go."""
        self.env.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """An attribute of the environment, once an environment asked for."""
        value = getattr(self.env.unwrapped, attr_name, None)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Refused: the environments share their attributes."""
        raise NotImplementedError(
            "environments share their attributes; make the environment with other settings instead"
        )

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Refused: the environments are no objects of their own."""
        raise NotImplementedError("environments have no methods of their own; call those of the vector environment")

    def env_is_wrapped(
        self, wrapper_class: type[gym.Wrapper[Any, Any, Any, Any]], indices: VecEnvIndices = None
    ) -> list[bool]:
        """No environment is wrapped."""
        return [False for _ in self._get_indices(indices)]


def _of_env(infos: dict[str, Any], env_index: int) -> dict[str, Any]:
    """What Gymnasium's vector infos tell of one environment."""
    return {
        key: _of_env(values, env_index) if isinstance(values, dict) else values[env_index]
        for key, values in infos.items()
        if not key.startswith("_")
    }
