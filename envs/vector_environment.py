"""`PlanarArmVectorEnv`: a batch of environments of a task as a Gymnasium vector environment."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from threading import Lock
from typing import Any, ClassVar, Self

import gymnasium as gym
import numpy as np
from gymnasium.utils import EzPickle, seeding
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from envs.batch.exclusive import exclusive
from envs.batch.state import Episodes, State, episodes_of, set_generator, state_of_generator
from envs.checks import (
    checked_actions,
    checked_mode,
    checked_options,
    checked_seeds,
    checked_time_limit,
    untouched_when_refused,
)
from envs.environment import make_task
from envs.infos import Info, TaskInfos
from envs.observation import Observation
from envs.task import Task
from envs.task_camera import Frame, TaskCamera
from planners import MotionProblem
from planners.checks import checked_count
from planners.typing import Array


class PlanarArmVectorEnv(gym.vector.VectorEnv[Observation, NDArray[np.float32], Any], EzPickle):
    """A batch as a Gymnasium vector environment; environment i equals the single one with seed + i.

    What it returns equals `gymnasium.vector.SyncVectorEnv` of the single environments, in every autoreset mode:

    * ``NEXT_STEP``: the step after the one that ends an episode begins the next one. It ignores that environment's
      action, and its reward is 0.
    * ``SAME_STEP``: the step that ends an episode begins the next one. Its observation and infos are the new episode's;
      the last ones are in ``infos["final_obs"]`` and ``infos["final_info"]``.
    * ``DISABLED``: ``reset`` with ``options={"reset_mask": ...}`` begins the next one; ``step`` waits for it.

    Args:
        num_envs: number of environments.
        render_mode: ``"rgb_array"`` or None.
        max_episode_steps: truncate every episode after so many steps, if that is before the task's horizon; -1 for the
            horizon only.
        autoreset_mode: a `gymnasium.vector.AutoresetMode`, or its value or name.
        task_type: the `Task` class, or ``"module:Name"`` of it.
        config: fields of the task's configuration.
    """

    metadata: ClassVar[dict[str, Any]] = {  # type: ignore[misc]
        "render_modes": ["rgb_array"],
        "render_fps": 50,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        render_mode: str | None = None,
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        *,
        task_type: type[Any] | str,
        **config: Any,
    ) -> None:
        given = num_envs, render_mode, max_episode_steps, autoreset_mode
        EzPickle.__init__(self, *given, task_type=task_type, **config)
        num_envs = checked_count("num_envs", num_envs)
        self._max_episode_steps = checked_time_limit(max_episode_steps)
        self.autoreset_mode = checked_mode(autoreset_mode)
        self.task: Task = make_task(task_type, config, num_envs, render_mode, self.metadata)
        self.metadata = {  # type: ignore[misc]
            **self.metadata,
            "render_fps": self.task.frame_rate,
            "autoreset_mode": self.autoreset_mode,
        }
        self.num_envs = num_envs
        self.render_mode = render_mode
        self.single_observation_space = self.task.layout.space()
        self.single_action_space = self.task.action_space()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._infos = TaskInfos(self.task)
        self._generators: list[np.random.Generator] = []
        self._randoms: tuple[Any, ...] | None = None  # their states, where they have been looked at since the last draw
        self._cameras = [TaskCamera(self.task, env_index) for env_index in range(num_envs)] if render_mode else []
        self._running = False
        self._in_use = Lock()

    @exclusive
    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, Info]:
        """Begin an episode in every environment, or in those of ``options["reset_mask"]``.

        Raises:
            ValueError: for options, seeds or a mask that are refused; episodes and random numbers go on as if not
                called.
        """
        self._require_open()
        options = checked_options(options)
        mask = options.pop("reset_mask", None)
        chosen = list(range(self.num_envs)) if mask is None else np.flatnonzero(self._checked_mask(mask)).tolist()
        generators = self._seeded(seed, chosen)
        with untouched_when_refused(generators):
            self._begin(chosen, options, generators)
        self._generators, self._running = generators, True
        present = None if mask is None else self._of(chosen)
        return self._observations(), self._infos.of_batch(present=present, begun=self._of(chosen))

    @exclusive
    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[Observation, Array, NDArray[np.bool_], NDArray[np.bool_], Info]:
        """Hold one action per environment, ``(num_envs, n)``, for one control period."""
        if not self._running:
            self._require_open()
            raise gym.error.ResetNeeded("no episode has begun: call reset() first")
        batch = self.task.batch
        terminated, truncated = self._ends()
        over = terminated | truncated
        resting = over if over.any() else None
        if resting is not None and self.autoreset_mode == AutoresetMode.DISABLED:
            raise gym.error.ResetNeeded(
                f"the episodes of environments {np.flatnonzero(over).tolist()} are over: call "
                'reset(options={"reset_mask": terminated | truncated}) first'
            )
        numbers = checked_actions(actions, batch["action"].shape, resting)
        if resting is not None:
            self._begin_next(resting)
        self.task.advance(numbers, resting)
        for env_index, camera in enumerate(self._cameras):
            if not over[env_index]:
                camera.follow()
        terminated, truncated = self._ends()
        rewards, ended = batch["reward"].copy(), terminated | truncated
        if not ended.any():
            infos = self._infos.of_batch(begun=resting)
        elif self.autoreset_mode != AutoresetMode.SAME_STEP:
            infos = self._infos.of_batch(begun=resting, ended=ended)
        else:
            final = self._final(ended)
            self._begin_next(ended)
            infos = self._infos.of_batch(begun=ended) | final
        return self._observations(), rewards, terminated, truncated, infos

    @exclusive
    def render(self) -> tuple[Frame, ...] | None:
        """One frame per environment."""
        if not self._running:
            self._require_open()
            raise gym.error.ResetNeeded("no episode has begun: call reset() before render()")
        return tuple(camera.frame() for camera in self._cameras) if self._cameras else None

    @exclusive
    def get_state(self) -> State:
        """The running episodes, with their random numbers; see `PlanarArmEnv.get_state`."""
        if self._randoms is None:
            self._randoms = tuple(state_of_generator(one) for one in self._generators)
        trails = tuple(camera.trail for camera in self._cameras) or ((),) * self.num_envs
        terminated, truncated = self._ends()
        over = tuple((terminated | truncated).tolist())
        return self.task.get_state(Episodes(self._running, over, self._randoms, None, trails))

    @exclusive
    def set_state(self, state: State) -> None:
        """Continue from what `get_state` returned, here or in another environment with the same settings.

        The state of one environment, also of a single `PlanarArmEnv`, goes to every environment of the batch.

        Raises:
            ValueError: for anything else, with what differs; nothing has changed then.
        """
        self._require_open()
        episodes = episodes_of(state, self.num_envs)
        if not episodes.begun:
            raise ValueError("the episode of the state has not begun, so that there is nothing to continue")
        self.task.set_state(state)
        if episodes.randoms is not self._randoms:
            blank = self._generators or [np.random.default_rng(0) for _ in episodes.randoms]
            self._generators = [set_generator(*pair) for pair in zip(blank, episodes.randoms, strict=True)]
            self._randoms = episodes.randoms
        self._running = True
        for camera, trail in zip(self._cameras, episodes.trails, strict=False):
            camera.trail = trail

    def __getstate__(self) -> Info:
        return {**EzPickle.__getstate__(self), "episode": self.get_state(), "spec": self.spec, "closed": self.closed}

    def __setstate__(self, kept: Info) -> None:
        EzPickle.__setstate__(self, kept)
        self.spec = kept["spec"]
        if kept["episode"].episodes.begun:
            self.set_state(kept["episode"])
        if kept["closed"]:
            self.close()

    def __copy__(self) -> Self:
        return deepcopy(self)

    def close_extras(self, **kwargs: Any) -> None:
        """Free the surfaces."""
        self._stop()

    @exclusive
    def _stop(self) -> None:
        for camera in self._cameras:
            camera.close()
        self.task.close()
        self._running = False

    def joint_state(self) -> tuple[Array, Array]:
        """Joint angles (rad) and velocities (rad/s), each ``(num_envs, n)``."""
        return self.task.batch["q"].copy(), self.task.batch["qd"].copy()

    def motion_problem(self, env_index: int) -> MotionProblem:
        """The planning problem that the current observation of an environment states."""
        return self.task.motion_problem(self.task.batch["observation"][env_index])

    def _require_open(self) -> None:
        if self.closed:
            raise gym.error.ClosedEnvironmentError("the environment is closed: make another one")

    def _begin(self, chosen: list[int], options: dict[str, Any], generators: list[np.random.Generator]) -> None:
        """Begin an episode in the chosen environments, each with its own of all generators."""
        self._randoms = None
        self.task.reset_envs(chosen, [generators[env_index] for env_index in chosen], options)
        for env_index in chosen if self._cameras else ():
            self._cameras[env_index].begin()

    def _seeded(self, seed: int | Sequence[int | None] | None, chosen: list[int]) -> list[np.random.Generator]:
        """The generators of all environments, those of the chosen ones seeded again if seeds are given."""
        seeds = checked_seeds(seed, self.num_envs)
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
        if not array.any():
            raise ValueError("reset_mask chooses no environment: set at least one element to True")
        return array

    def _observations(self) -> Observation:
        return self.task.batch["observation"].copy()

    def _begin_next(self, over: NDArray[np.bool_]) -> None:
        """Begin the next episode of the environments whose last one is over."""
        chosen = np.flatnonzero(over).tolist()
        with untouched_when_refused([self._generators[env_index] for env_index in chosen]):
            self._begin(chosen, {}, self._generators)

    def _ends(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Which episodes have ended by what happened, and which by the time."""
        terminated, truncated = self.task.batch["terminated"].copy(), self.task.batch["truncated"].copy()
        if self._max_episode_steps is not None:
            truncated |= self.task.batch["step"] >= self._max_episode_steps
        return terminated, truncated

    def _final(self, ended: NDArray[np.bool_]) -> Info:
        """Last observations and infos of the environments that ended, in Gymnasium's vector form."""
        observations, chosen = np.empty(self.num_envs, dtype=object), np.flatnonzero(ended)
        for env_index, last in zip(chosen.tolist(), self.task.batch["observation"][chosen], strict=True):
            observations[env_index] = last
        final = self._infos.of_batch(present=ended, ended=ended)
        return {"final_obs": observations, "_final_obs": ended, "final_info": final, "_final_info": ended.copy()}

    def _of(self, chosen: list[int]) -> NDArray[np.bool_]:
        """A mask of the chosen environments."""
        mask = np.zeros(self.num_envs, dtype=np.bool_)
        mask[chosen] = True
        return mask
