"""What every task is: a batch of environments with compiled state, and the few questions an environment asks of it."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from numba import njit

from envs.observation import Layout, Observation
from envs.physics.actuation import (
    LIMIT_KINDS,
    ControlMode,
    actuation_env_fields,
    actuation_model_fields,
    fill_actuation,
)
from envs.physics.world import World, arm_fields, body_fields
from envs.rendering import Scene
from envs.settings import Settings
from planners import Arm, MotionProblem
from planners.typing import Array

Fields = list[tuple[Any, ...]]
Options = Mapping[str, Any]

_ENVS_PER_THREAD = 32  # below this a second thread costs more than it brings


class TaskSettings(Settings):
    """Settings that every task has.

    Attributes:
        control_mode: what an action means.
        control_period: time for which an action is held, s.
        physics_step: time of one step of the physics, s.
        horizon: length of an episode, s.
        payload: point mass at the hand that no policy is told, kg.
    """

    control_mode: str = "torque"
    control_period: float = 0.02
    physics_step: float = 0.002
    horizon: float = 3.0
    payload: float = 0.0


class Task(ABC):
    """A batch of environments of one task.

    An environment's whole state is one record of `batch`; what the environments share is the single record of
    `model`. Compiled
    kernels read and write both. Subclasses name their extra fields, their observation and reward terms, and write the
    kernel that advances a slice of environments.

    Attributes:
        arm: the robot as the policy knows it, without its payload.
        layout: what an observation holds.
        reward_terms: names of the terms whose sum is the reward.
        batch: one record an environment.
        model: an array of one record.
    """

    env_id: ClassVar[str]
    layout: Layout
    reward_terms: ClassVar[tuple[str, ...]]

    def __init__(self, config: TaskSettings, arm: Arm, num_envs: int, extra_env: Fields, extra_model: Fields) -> None:
        n = arm.n_joints
        self.config = config
        self.arm = arm
        self.num_envs = num_envs
        self.horizon_steps = self._whole_periods("horizon", config.horizon)
        common: Fields = [
            ("action", "f8", (self.action_size(config, arm),)),
            ("seen", "f8", (self.layout.size,)),
            ("observation", "f4", (self.layout.size,)),
            ("reward_terms", "f8", (len(self.reward_terms),)),
            ("reward", "f8"),
            ("terminated", "?"),
            ("truncated", "?"),
            ("success", "?"),
            ("step", "i8"),
        ]
        scales: Fields = [("scales", "f8", (self.layout.size,)), ("bounds", "f8", (self.layout.size,))]
        horizon: Fields = [("horizon_steps", "i8")]
        env_type = np.dtype(common + arm_fields(n) + actuation_env_fields(n) + extra_env, align=True)
        model_type = np.dtype(scales + horizon + body_fields(n) + actuation_model_fields(n) + extra_model, align=True)
        self.batch = np.zeros(num_envs, env_type)
        self.model = np.zeros(1, model_type)
        self.model["scales"], self.model["bounds"] = self.layout.scales, self.layout.bounds
        self.model["horizon_steps"] = self.horizon_steps
        fill_actuation(self.model, arm, self.actuation_mode(config), config.control_period)
        self._world = World(
            arm.with_payload(config.payload),
            self.batch,
            self.model,
            control_period=config.control_period,
            physics_step=config.physics_step,
        )
        self._threads = min(os.cpu_count() or 1, num_envs // _ENVS_PER_THREAD)
        self._pool: tuple[int, ThreadPoolExecutor] | None = None

    @abstractmethod
    def reset_envs(
        self, env_indices: Sequence[int], generators: Sequence[np.random.Generator], options: Options
    ) -> None:
        """Begin an episode in some environments, each with its own generator; unusable options raise ValueError."""

    @abstractmethod
    def advance_slice(self, first: int, last: int) -> None:
        """Advance environments ``first`` to ``last - 1`` by one control period under their ``action``."""

    @abstractmethod
    def episode_info(self, env_index: int) -> dict[str, Any]:
        """What is to be told of an environment's episode at its end."""

    @abstractmethod
    def motion_problem(self, observation: Observation) -> MotionProblem:
        """The problem that an observation ``(size,)`` states, for a planner to solve."""

    def hand_goal(self, seen: dict[str, Array]) -> tuple[Array, Array, Array]:
        """Where the hand should be, of parsed observations: position, velocity, acceleration, each ``(num_envs, 2)``.

        Raises:
            NotImplementedError: if the task's goal is no place for the hand.
        """
        raise NotImplementedError(f"the goal of {self.env_id} is no place for the hand")

    def hand_position(self, env_index: int) -> Array:
        """Where the hand of an environment is, ``(2,)``, m."""
        return self.arm.forward_kinematics(self.batch["q"][env_index])

    @abstractmethod
    def scene(self, env_index: int, trail: Sequence[Any]) -> Scene:
        """What a frame of this environment shows, with the hand positions so far."""

    @property
    @abstractmethod
    def view(self) -> tuple[float, float, float, float]:
        """Stretch of the plane a frame shows: x from, x to, y from, y to, m."""

    def advance(self) -> None:
        """Advance every environment by one control period, on as many threads as pay.

        Raises:
            ValueError: if an action is not finite; nothing has moved then.
        """
        if not actions_finite(self.batch):
            bad = np.flatnonzero(~np.isfinite(self.batch["action"]).all(axis=1))
            raise ValueError(
                f"action {self.batch['action'][bad[0]].tolist()} (environment {bad[0]}) is not finite; "
                "actions are numbers in [-1, 1], larger ones are clipped"
            )
        if self._threads < 2:
            self.advance_slice(0, self.num_envs)
            return
        cuts = np.linspace(0, self.num_envs, self._threads + 1).astype(int).tolist()
        list(self._executor().map(self.advance_slice, cuts[:-1], cuts[1:]))

    def close(self) -> None:
        """Let the threads go; may be called twice."""
        if self._pool is not None:
            self._pool[1].shutdown(wait=False)
            self._pool = None

    def limit_info(self, env_index: int) -> dict[str, Any]:
        """Worst limit ratio of an environment's episode, and the worst of each kind."""
        ratios = dict(zip(LIMIT_KINDS, self.batch["limit_ratios"][env_index].tolist(), strict=True))
        return {"limit_ratio": max(ratios.values()), "limit_ratios": ratios}

    @staticmethod
    def action_size(config: Any, arm: Arm) -> int:
        """Numbers in an action: one a joint, unless a task has other actions too."""
        return arm.n_joints

    @staticmethod
    def actuation_mode(config: Any) -> ControlMode:
        """What the kernels take for actions: what the policy gives, unless a task makes that into something else."""
        mode: ControlMode = config.control_mode
        return mode

    @property
    def frame_rate(self) -> int:
        """Frames a second of a film that shows every control period."""
        return round(1.0 / self.config.control_period)

    def action_space(self) -> gym.spaces.Box:
        """The action space of one environment: numbers in [-1, 1]."""
        return gym.spaces.Box(-1.0, 1.0, self.batch["action"].shape[1:], np.float32)

    def _hold_steps(self, hold_time: float) -> int:
        """A hold time, s, in control periods; refused where an episode is too short for it."""
        if hold_time > self.config.horizon:
            raise ValueError(f"hold_time {hold_time} s is longer than the horizon {self.config.horizon} s; shorten it")
        return self._whole_periods("hold_time", hold_time)

    def _copy_settings(self, *names: str) -> None:
        """Settings that the kernels read go into the model record under their own names."""
        for name in names:
            self.model[name] = getattr(self.config, name)

    def _executor(self) -> ThreadPoolExecutor:
        # Threads do not survive a fork, so a pool belongs to the process that made it.
        if self._pool is None or self._pool[0] != os.getpid():
            self._pool = (os.getpid(), ThreadPoolExecutor(self._threads, thread_name_prefix="planarm"))
        return self._pool[1]

    def _whole_periods(self, name: str, seconds: float) -> int:
        periods = seconds / self.config.control_period
        if abs(periods - round(periods)) > 1e-6 or round(periods) < 1:
            raise ValueError(
                f"{name} {seconds} s is no multiple of control_period {self.config.control_period} s; "
                f"{max(1, round(periods)) * self.config.control_period:g} s would do"
            )
        return round(periods)


@njit(cache=True, nogil=True)
def actions_finite(batch: Any) -> bool:
    """Whether every action of every environment is finite."""
    for env_index in range(batch.shape[0]):
        for value in batch[env_index].action:
            if not np.isfinite(value):
                return False
    return True
