"""planarm's vector environments in the form that Stable-Baselines3 expects."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

try:
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env.base_vec_env import VecEnv, VecEnvIndices, VecEnvObs, VecEnvStepReturn
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(f'NativeVecEnv needs pip install "planarm[rl]" ({error})') from None

_METHODS = ("joint_state", "motion_problem", "render")  # that `env_method` calls for each environment


class NativeVecEnv(VecEnv):  # type: ignore[misc]
    """A Gymnasium vector environment with same-step autoreset, for Stable-Baselines3: one step for the whole batch.

    Infos are empty except for environments whose episode has just ended. Those hold the episode's last info,
    ``episode`` (return and length, as Monitor writes them), ``terminal_observation``, and ``TimeLimit.truncated``,
    which makes SB3 bootstrap from the value. Wrappers of SB3, such as VecNormalize and VecVideoRecorder, apply.

    Args:
        env: from ``gym.make_vec(..., autoreset_mode=AutoresetMode.SAME_STEP)``; with ``render_mode="rgb_array"`` its
            pictures are what ``render`` shows.

    Raises:
        ValueError: for another autoreset mode.
    """

    def __init__(self, env: gym.vector.VectorEnv[Any, Any, Any]) -> None:
        if env.metadata.get("autoreset_mode") != AutoresetMode.SAME_STEP:
            raise ValueError(
                f"{env} does not reset an environment in the step that ends its episode, as Stable-Baselines3 expects: "
                "make it with autoreset_mode=AutoresetMode.SAME_STEP"
            )
        self.env = env
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)
        modes = ["rgb_array", "human"] if self.render_mode == "rgb_array" else []  # SB3 shows frames by OpenCV
        self.metadata = {"render_modes": modes, "render_fps": env.metadata.get("render_fps", 30)}
        self._first_seed: int | None = None
        self._actions: NDArray[np.float32] = np.zeros(0, dtype=np.float32)
        self._returns = np.zeros(self.num_envs)
        self._lengths = np.zeros(self.num_envs, dtype=np.int64)

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Seed the next reset: environment i with seed + i."""
        self._first_seed = seed
        return [None if seed is None else seed + env_index for env_index in range(self.num_envs)]

    def reset(self) -> VecEnvObs:
        """Begin an episode in every environment, with the seed and the options that were set, if any.

        Raises:
            ValueError: for options that differ between environments.
        """
        if any(options != self._options[0] for options in self._options):
            raise ValueError("options differ between environments: a batch takes the same for all, set_options({...})")
        observations: VecEnvObs
        observations, infos = self.env.reset(seed=self._first_seed, options=self._options[0] or None)
        self.reset_infos = [_of_env(infos, env_index) for env_index in range(self.num_envs)]
        self._first_seed = None
        self._reset_options()
        self._returns[:] = 0.0
        self._lengths[:] = 0
        return observations

    def step_async(self, actions: NDArray[np.float32]) -> None:
        """Store the actions of the next step."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """One control period in every environment."""
        observations, rewards, terminated, truncated, infos = self.env.step(self._actions)
        self._returns += rewards
        self._lengths += 1
        ended = terminated | truncated
        ended_infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for env_index in np.flatnonzero(ended).tolist():
            ended_infos[env_index] = {
                **_of_env(infos["final_info"], env_index),
                "episode": {"r": float(self._returns[env_index]), "l": int(self._lengths[env_index]), "t": 0.0},
                "terminal_observation": infos["final_obs"][env_index],
                "TimeLimit.truncated": bool(truncated[env_index] and not terminated[env_index]),
            }
        self._returns[ended] = 0.0
        self._lengths[ended] = 0
        return observations, rewards.astype(np.float32), ended, ended_infos

    def close(self) -> None:
        """Close the environment."""
        self.env.close()

    def get_images(self) -> list[NDArray[np.uint8]]:
        """The current frame of every environment, ``(height, width, 3)`` each."""
        frames: Any = self.env.render()
        return list(frames or ())

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """An attribute of the environment, which all share, for each index; an AttributeError if there is none."""
        value = getattr(self.env.unwrapped, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Refused: the environments share their attributes."""
        raise NotImplementedError(
            "environments share their attributes; make the environment with other settings instead"
        )

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        """What a method of the single environments gives, for each index: joint_state, motion_problem or render.

        Raises:
            NotImplementedError: for another method, since the environments are no separate objects.
        """
        chosen, env = list(self._get_indices(indices)), self.env.unwrapped
        if method_name not in _METHODS or not hasattr(env, method_name) or method_args or method_kwargs:
            raise NotImplementedError(
                f"{method_name} cannot be called for one environment: those of a batch are no separate objects; there "
                f"are {', '.join(_METHODS)} without arguments, and the methods of the vector environment, .env"
            )
        if method_name == "motion_problem":
            return [env.motion_problem(env_index) for env_index in chosen]  # type: ignore[attr-defined]
        if method_name == "render":
            frames = self.get_images()
            return [frames[env_index] if frames else None for env_index in chosen]
        q, qd = env.joint_state()  # type: ignore[attr-defined]
        return [(q[env_index], qd[env_index]) for env_index in chosen]

    def env_is_wrapped(
        self, wrapper_class: type[gym.Wrapper[Any, Any, Any, Any]], indices: VecEnvIndices = None
    ) -> list[bool]:
        """No environment is wrapped; but as with Monitor, infos hold the return and the length of an episode."""
        return [wrapper_class is Monitor for _ in self._get_indices(indices)]


def _of_env(infos: dict[str, Any], env_index: int) -> dict[str, Any]:
    """The part of Gymnasium's vector infos for one environment."""
    return {
        key: _of_env(values, env_index) if isinstance(values, dict) else values[env_index]
        for key, values in infos.items()
        if not key.startswith("_")
    }
