"""Gymnasium environments of a task: `PlanarArmEnv` (a batch of one) and `PlanarArmVectorEnv` (the batch itself)."""

from __future__ import annotations

from collections.abc import Sequence
from inspect import cleandoc
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium.utils import EzPickle, seeding
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from envs.card import load
from envs.checks import checked_actions, checked_count, checked_options, steps_of_time_limit, untouched_when_refused
from envs.observation import Observation
from envs.settings import refuse_unknown
from envs.task import Task
from envs.task_camera import Frame, TaskCamera
from planners import MotionProblem
from planners.typing import Array

Info = dict[str, Any]

_DECLARED = """{text}

## Observation
Each element is a physical value divided by a fixed scale, clipped at the bound.

{layout}

## Info
| Key | When | Meaning |
|---|---|---|
| `is_success` | always | whether the task is solved |
| `reward_terms` | always | the terms of the reward |
{outcomes}
| `limit_ratio` | at the end | worst value / limit of all kinds |
| `limit_ratios` | at the end | worst value / limit of each kind |

The end is also where Gymnasium's `TimeLimit` (`max_episode_steps`) cuts an episode.

## Arguments
{settings}
"""


class PlanarArmEnv(gym.Env[Observation, NDArray[np.float32]], EzPickle):
    """One environment of a task as a Gymnasium environment.

    Pickling keeps the arguments, not the current episode. The docstring of a subclass with a `task_type` gets tables of
    the observation, the info and the settings that the task declares.

    Args:
        render_mode: ``"human"``, ``"rgb_array"`` or None.
        task_type: the `Task` class, or ``"module:Name"`` of it; by default the class attribute of this name.
        config: fields of the task's configuration.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["human", "rgb_array"], "render_fps": 50}  # type: ignore[misc]
    task_type: ClassVar[type[Any]]

    def __init_subclass__(cls) -> None:
        task: Any = cls.task_type
        outcomes = [f"| `{key}` | at the end | {meaning} |" for key, meaning in task.outcomes.items()]
        cls.__doc__ = _DECLARED.format(
            text=cleandoc(cls.__doc__ or ""),
            layout=task.layout.table(),
            outcomes="\n".join(outcomes),
            settings=task.config_type.table(),
        )

    def __init__(
        self, render_mode: str | None = None, *, task_type: type[Any] | str | None = None, **config: Any
    ) -> None:
        EzPickle.__init__(self, render_mode, task_type=task_type, **config)
        self.task: Task = _make_task(task_type or self.task_type, config, 1, render_mode, self.metadata)
        self.metadata = {**self.metadata, "render_fps": self.task.frame_rate}  # type: ignore[misc]
        self.render_mode = render_mode
        self.observation_space = self.task.layout.space()
        self.action_space = self.task.action_space()
        self._needs_reset, self._begun, self._cut_after = True, False, 0
        self._camera = TaskCamera(self.task, 0, window=render_mode == "human")
        # Views of the one record, made once to keep a step fast.
        self._env = self.task.batch[0]
        self._action, self._observation = self._env["action"], self._env["observation"]

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Observation, Info]:
        """Begin an episode; the environment's docstring lists the options.

        Raises:
            ValueError: for options that are refused; the episode and the random numbers go on as if not called.
        """
        generator, used_seed = (self.np_random, self.np_random_seed) if seed is None else seeding.np_random(seed)
        with untouched_when_refused([generator]):
            self.task.reset_envs([0], [generator], checked_options(options))
        self._np_random, self._np_random_seed = generator, used_seed
        self._needs_reset, self._begun = False, True
        self._cut_after = steps_of_time_limit(self)
        self._camera.begin()
        if self.render_mode == "human":
            self.render()
        return self._observation.copy(), self.task.step_info(0)

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, Info]:
        """Hold an action for one control period."""
        if self._needs_reset:
            raise gym.error.ResetNeeded("the episode is over or has not begun: call reset() first")
        self._action[:] = checked_actions(action, self._action.shape)
        self.task.advance()
        env = self._env
        terminated, truncated = bool(env["terminated"]), bool(env["truncated"])
        info = self.task.step_info(0)
        self._needs_reset = terminated or truncated
        if self._needs_reset or env["step"] == self._cut_after:
            info.update(self.task.episode_info(0))
        if self.render_mode is not None:
            self._camera.follow()
            if self.render_mode == "human":
                self.render()
        return self._observation.copy(), float(env["reward"]), terminated, truncated, info

    def render(self) -> Frame | None:
        """The current frame, ``(height, width, 3)``, or None in ``"human"`` mode, where it goes to a window."""
        if not self._begun:
            raise gym.error.ResetNeeded("no episode has begun: call reset() before render()")
        if self.render_mode is None:
            gym.logger.warn('render() needs a render mode: gym.make(..., render_mode="rgb_array")')
            return None
        frame = self._camera.frame()
        return None if self.render_mode == "human" else frame

    def close(self) -> None:
        """Close the window, if any; may be called twice."""
        self._camera.close()
        self.task.close()

    def joint_state(self) -> tuple[Array, Array]:
        """Joint angles (rad) and velocities (rad/s), each ``(n,)``."""
        return self.task.batch["q"][0].copy(), self.task.batch["qd"][0].copy()

    def motion_problem(self) -> MotionProblem:
        """The planning problem that the current observation states."""
        return self.task.motion_problem(self._observation)


class PlanarArmVectorEnv(gym.vector.VectorEnv[Observation, NDArray[np.float32], Any], EzPickle):
    """A batch as a Gymnasium vector environment; environment i equals the single one with seed + i.

    An environment whose episode ends begins the next one in the same step: the returned observation is the first of the
    new episode; the last one and its info are in ``infos["final_obs"]`` and ``infos["final_info"]``.

    Args:
        num_envs: number of environments.
        render_mode: ``"rgb_array"`` or None.
        max_episode_steps: truncate every episode after so many steps, if that is before the task's horizon.
        task_type: the `Task` class, or ``"module:Name"`` of it.
        config: fields of the task's configuration.
    """

    metadata: ClassVar[dict[str, Any]] = {  # type: ignore[misc]
        "render_modes": ["rgb_array"],
        "render_fps": 50,
        "autoreset_mode": AutoresetMode.SAME_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        render_mode: str | None = None,
        max_episode_steps: int | None = None,
        *,
        task_type: type[Any] | str,
        **config: Any,
    ) -> None:
        EzPickle.__init__(self, num_envs, render_mode, max_episode_steps, task_type=task_type, **config)
        num_envs = checked_count("num_envs", num_envs)
        if max_episode_steps is not None:
            hint = "; leave it out to truncate at the horizon only"
            max_episode_steps = checked_count("max_episode_steps", max_episode_steps, hint)
        self.task: Task = _make_task(task_type, config, num_envs, render_mode, self.metadata)
        self.metadata = {**self.metadata, "render_fps": self.task.frame_rate}  # type: ignore[misc]
        self.num_envs = num_envs
        self.render_mode = render_mode
        self.single_observation_space = self.task.layout.space()
        self.single_action_space = self.task.action_space()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._max_episode_steps = max_episode_steps
        self._generators: list[np.random.Generator] = []
        self._cameras = [TaskCamera(self.task, env_index) for env_index in range(num_envs)] if render_mode else []
        self._running = False

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, Info]:
        """Begin an episode in every environment, or in those of ``options["reset_mask"]``.

        Raises:
            ValueError: for options, seeds or a mask that are refused; episodes and random numbers go on as if not
                called.
        """
        options = checked_options(options)
        mask = options.pop("reset_mask", None)
        chosen = list(range(self.num_envs)) if mask is None else np.flatnonzero(self._checked_mask(mask)).tolist()
        generators = self._seeded(seed, chosen)
        with untouched_when_refused(generators):
            self._begin(chosen, options, generators)
        self._generators, self._running = generators, True
        return self._observations(), self._step_infos()

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[Observation, Array, NDArray[np.bool_], NDArray[np.bool_], Info]:
        """Hold one action per environment, ``(num_envs, n)``, for one control period."""
        if not self._running:
            raise gym.error.ResetNeeded("no episode has begun: call reset() first")
        batch = self.task.batch
        batch["action"] = checked_actions(actions, batch["action"].shape)
        self.task.advance()
        for camera in self._cameras:
            camera.follow()
        terminated, truncated = batch["terminated"].copy(), batch["truncated"].copy()
        if self._max_episode_steps is not None:
            truncated |= batch["step"] >= self._max_episode_steps
        rewards, infos = batch["reward"].copy(), self._step_infos()
        ended = terminated | truncated
        if ended.any():
            infos.update(self._final(ended))
            self._begin(np.flatnonzero(ended).tolist(), {}, self._generators)
        return self._observations(), rewards, terminated, truncated, infos

    def render(self) -> tuple[Frame, ...] | None:
        """One frame per environment."""
        if not self._running:
            raise gym.error.ResetNeeded("no episode has begun: call reset() before render()")
        return tuple(camera.frame() for camera in self._cameras) if self._cameras else None

    def close_extras(self, **kwargs: Any) -> None:
        """Stop the threads and free the surfaces."""
        for camera in self._cameras:
            camera.close()
        self.task.close()

    def joint_state(self) -> tuple[Array, Array]:
        """Joint angles (rad) and velocities (rad/s), each ``(num_envs, n)``."""
        return self.task.batch["q"].copy(), self.task.batch["qd"].copy()

    def motion_problem(self, env_index: int) -> MotionProblem:
        """The planning problem that the current observation of an environment states."""
        return self.task.motion_problem(self.task.batch["observation"][env_index])

    def _begin(self, chosen: list[int], options: dict[str, Any], generators: list[np.random.Generator]) -> None:
        """Begin an episode in the chosen environments, each with its own of all generators."""
        self.task.reset_envs(chosen, [generators[env_index] for env_index in chosen], options)
        for env_index in chosen if self._cameras else ():
            self._cameras[env_index].begin()

    def _seeded(self, seed: int | Sequence[int | None] | None, chosen: list[int]) -> list[np.random.Generator]:
        """The generators of all environments, those of the chosen ones seeded again if seeds are given."""
        if isinstance(seed, (int, np.integer)):
            seeds: Sequence[int | None] = [int(seed) + env_index for env_index in range(self.num_envs)]
        else:
            seeds = [None] * self.num_envs if seed is None else seed
        if len(seeds) != self.num_envs:
            raise ValueError(
                f"{len(seeds)} seeds for {self.num_envs} environments; give one int, or one seed per environment"
            )
        if not self._generators:
            return [seeding.np_random(one)[0] for one in seeds]
        generators = list(self._generators)
        for env_index in chosen:
            if seeds[env_index] is not None:
                generators[env_index] = seeding.np_random(seeds[env_index])[0]
        return generators

    def _checked_mask(self, mask: Any) -> NDArray[np.bool_]:
        array = np.asarray(mask)
        if array.shape != (self.num_envs,) or array.dtype != np.bool_:
            raise ValueError(f"reset_mask must be a bool array of shape ({self.num_envs},)")
        if not self._running and not array.all():
            raise ValueError("the first reset must reset every environment: leave out reset_mask")
        return array

    def _observations(self) -> Observation:
        return self.task.batch["observation"].copy()

    def _step_infos(self) -> Info:
        columns = self.task.batch["reward_terms"].T
        terms = {name: column.copy() for name, column in zip(self.task.reward_terms, columns, strict=True)}
        return self._present({"is_success": self.task.batch["success"].copy(), "reward_terms": self._present(terms)})

    def _present(self, values: Info) -> Info:
        """Values with Gymnasium's masks, which say that every environment has them."""
        return values | {f"_{name}": np.ones(self.num_envs, dtype=np.bool_) for name in values}

    def _final(self, ended: NDArray[np.bool_]) -> Info:
        """Last observations and infos of the environments that ended, in Gymnasium's vector form."""
        final: Info = {}
        for env_index in np.flatnonzero(ended).tolist():
            info = {**self.task.step_info(env_index), **self.task.episode_info(env_index)}
            final = self._add_info(final, info, env_index)
        observations = np.where(ended[:, None], self._observations(), np.float32(0.0))
        return {"final_obs": observations, "_final_obs": ended, "final_info": final, "_final_info": ended.copy()}


def _make_task(
    task_type: type[Any] | str, config: Info, num_envs: int, render_mode: str | None, metadata: Info
) -> Task:
    """The task of an environment, whose render mode has to be one of those in its metadata."""
    refuse_unknown([render_mode] if render_mode else [], metadata["render_modes"], "render mode")
    kind: Any = load(task_type) if isinstance(task_type, str) else task_type
    task: Task = kind.make(config, num_envs)
    return task
