"""The base of every task: a batch of environments whose whole state compiled kernels read and write."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, ClassVar, Self

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from envs.arms import ArmSetting, require_links
from envs.card import task_card
from envs.observation import Layout, Observation
from envs.physics.actuation import (
    LIMIT_KINDS,
    ControlMode,
    actuation_constants,
    actuation_env_fields,
)
from envs.physics.rigid_bodies import World, arm_constants, arm_fields, model_record, whole_multiple
from envs.rendering import Scene
from envs.settings import Settings
from planners import Arm, MotionProblem
from planners.typing import Array

Fields = list[tuple[Any, ...]]
Options = Mapping[str, Any]

_ENVS_PER_THREAD = 32  # below this a second thread costs more than it brings


class TaskSettings(Settings):
    """Settings that every task has; the kernels find the numbers among them in the model record.

    Attributes:
        control_mode: what an action means.
        control_period: time for which an action is held, s.
        physics_step: time of one step of the physics, s.
        horizon: length of an episode, s.
        payload: unknown point mass at the hand, kg.
        arm: the robot; a preset's name, an `Arm`, the path of a file or a mapping (`planners.load_arm`); the task's own
            when left out.
        gravity: along -y, m/s^2; 0 for a horizontal plane, 9.81 for a vertical one; the arm's own when left out.
    """

    control_mode: str = "torque"
    control_period: float = Field(0.02, gt=0.0)
    physics_step: float = Field(0.002, gt=0.0)
    horizon: float = Field(3.0, gt=0.0, le=60.0)
    payload: float = Field(0.0, ge=0.0, le=10.0)
    arm: ArmSetting | None = None
    gravity: float | None = Field(None, ge=0.0, le=30.0)


class LimitSettings(TaskSettings):
    """Settings of tasks whose reward has a term for broken joint limits.

    Attributes:
        limit_tolerance: share by which a limit may be exceeded before it counts as broken.
        limit_penalty: cost of one control period in which a limit is broken; twice that where by 100 % or more.
    """

    limit_tolerance: float = Field(0.005, ge=0.0)
    limit_penalty: float = Field(2.0, ge=0.0)


class Task(ABC):
    """A batch of environments of one task.

    An environment's whole state is one record of `batch`; what all environments share is the single record of `model`.
    A subclass declares what is listed below, draws the starts of episodes, and has two compiled kernels:
    ``reset_env(batch, model, index)`` begins an episode whose start is written into the record, and
    ``advance_batch(batch, model, first, last)`` advances environments ``first`` to ``last - 1`` by one control period
    under their ``action``. A kernel writes the observed values by name, ``env.seen.goal``, and ends with
    `envs.physics.episode.finish_observation`.

    Attributes:
        env_id: id in Gymnasium's registry.
        config_type: class of the configuration.
        options_type: class of the options of ``reset``.
        kernels: module with the two kernels.
        layout: entries of an observation.
        reward_terms: names of the terms whose sum is the reward.
        outcomes: meaning of each key that `outcome` gives, with its unit.
        gauges: kinds of limit that a frame shows.
        view: part of the plane that a frame shows: x from, x to, y from, y to, m.
        default_arm: the robot, unless the settings name another.
        arm: the robot as a policy knows it, without its payload.
        batch: one record per environment.
        model: array of one record: the numbers of the configuration, and the ``constants`` given to the constructor.
    """

    env_id: ClassVar[str]
    config_type: ClassVar[type[TaskSettings]]
    options_type: ClassVar[type[Settings]]
    kernels: ClassVar[Any]
    default_arm: ClassVar[Arm]
    layout: Layout
    reward_terms: ClassVar[tuple[str, ...]]
    outcomes: ClassVar[Mapping[str, str]] = {}
    gauges: ClassVar[tuple[str, ...]]
    view: tuple[float, float, float, float]

    def __init__(
        self, config: TaskSettings, arm: Arm, num_envs: int, env_fields: Fields, constants: Mapping[str, Any]
    ) -> None:
        n, observed = arm.n_joints, self.layout.size
        self.config = config
        self.arm = arm
        self.num_envs = num_envs
        self.horizon_steps = whole_periods(config, "horizon", config.horizon)
        common: Fields = [
            ("action", "f8", (self.action_size(config, arm),)),
            ("seen", self.layout.record),
            ("observation", "f4", (observed,)),
            ("reward_terms", "f8", (len(self.reward_terms),)),
            ("reward", "f8"),
            ("terminated", "?"),
            ("truncated", "?"),
            ("success", "?"),
            ("step", "i8"),
        ]
        fields = common + arm_fields(n) + actuation_env_fields(n) + env_fields
        self.batch = np.zeros(num_envs, np.dtype(fields, align=True))
        loaded = arm.with_payload(config.payload)
        self.model = model_record(
            {
                "scales": self.layout.scales,
                "bounds": self.layout.bounds,
                "horizon_steps": self.horizon_steps,
                **config.numbers(),
                **arm_constants(loaded, config.control_period, config.physics_step),
                **actuation_constants(arm, self.actuation_mode(config)),
                **constants,
            }
        )
        self._world = World(loaded, self.batch)
        self._threads = min(os.cpu_count() or 1, num_envs // _ENVS_PER_THREAD)
        self._pool: tuple[int, ThreadPoolExecutor] | None = None

    @classmethod
    def make(cls, config: Mapping[str, Any], num_envs: int) -> Self:
        """The task from settings by name.

        Raises:
            ValueError: for an unknown name or a value that is not allowed.
        """
        task: Any = cls
        settings = cls.config_type.parse(config, f"{cls.env_id} setting")
        if settings.arm is not None or settings.gravity is not None:
            require_links(settings.arm, task_card(cls.env_id).links, cls.env_id)
        settings = cls.fit(settings)
        whole_multiple("control_period", settings.control_period, "physics_step", settings.physics_step)
        whole_periods(settings, "horizon", settings.horizon)
        made: Self = task(settings, num_envs)
        return made

    @classmethod
    def fit(cls, config: Any) -> Any:
        """Settings in which values that were left out fit the arm; unchanged for the task's own arm."""
        return config

    def reset_envs(
        self, env_indices: Sequence[int], generators: Sequence[np.random.Generator], options: Options
    ) -> None:
        """Begin an episode in some environments, each with its own generator.

        Raises:
            ValueError: for unknown options, or a start from which the task cannot be solved; nothing has changed then.
        """
        starts = self.draw(generators, self.options_type.parse(options, f"{self.env_id} option"))
        for env_index, start in zip(env_indices, starts, strict=True):
            self.write_start(env_index, start)
            self.kernels.reset_env(self.batch, self.model, env_index)

    @abstractmethod
    def draw(self, generators: Sequence[np.random.Generator], options: Any) -> Sequence[Any]:
        """Draw one start per generator, as the options (of `options_type`) say; bad ones raise ValueError."""

    @abstractmethod
    def write_start(self, env_index: int, start: Any) -> None:
        """Write a start into an environment's record."""

    @abstractmethod
    def outcome(self, record: Any) -> dict[str, Any]:
        """Info at the end of the episode of an environment's record, besides the limits.

        What has a meaning for whole episodes only is NaN for one that was cut short.
        """

    @abstractmethod
    def motion_problem(self, observation: Observation) -> MotionProblem:
        """The planning problem that an observation ``(size,)`` states."""

    @abstractmethod
    def picture(self, record: Any) -> dict[str, Any]:
        """Fields of the `Scene` of an environment's record that are this task's own."""

    def hand_position(self, env_index: int) -> Array:
        """Position of the hand, ``(2,)``, m."""
        return self.arm.forward_kinematics(self.batch["q"][env_index])

    def scene(self, env_index: int, trail: Sequence[Any]) -> Scene:
        """What a frame of an environment shows, with the past hand positions ``trail``."""
        record = self.batch[env_index]
        ratios = self.limit_info(env_index)["limit_ratios"]
        common: dict[str, Any] = {
            "joints": self.arm.joint_positions(record["q"]),
            "torque_ratios": record["tau"] / np.array(self.arm.limits.torque),
            "time": int(record["step"]) * self.config.control_period,
            "horizon": self.config.horizon,
            "title": self.env_id,
            "trail": np.array(trail),
            "limit_gauges": tuple(("joint range" if kind == "angle" else kind, ratios[kind]) for kind in self.gauges),
            "settled": bool(record["success"]),
        }
        return Scene(**(common | self.picture(record)))

    def restart_clock(self, env_index: int) -> None:
        """Give a running episode its whole time again; the arm moves on."""
        record = self.batch[env_index]
        record["step"] = 0
        record["terminated"] = record["truncated"] = record["success"] = False

    def advance_slice(self, first: int, last: int) -> None:
        """Advance environments ``first`` to ``last - 1`` by one control period under their ``action``."""
        self.kernels.advance_batch(self.batch, self.model, first, last)

    def advance(self) -> None:
        """Advance every environment by one control period under its ``action``, a row of finite numbers.

        On several threads if there are many environments.
        """
        if self._threads < 2:
            self.advance_slice(0, self.num_envs)
            return
        cuts = np.linspace(0, self.num_envs, self._threads + 1).astype(int).tolist()
        list(self._executor().map(self.advance_slice, cuts[:-1], cuts[1:]))

    def close(self) -> None:
        """Stop the threads; may be called twice."""
        if self._pool is not None:
            self._pool[1].shutdown(wait=False)
            self._pool = None

    def step_info(self, env_index: int) -> dict[str, Any]:
        """Info after every step: whether the task is solved, and the terms of the reward."""
        record = self.batch[env_index]
        terms = dict(zip(self.reward_terms, record["reward_terms"].tolist(), strict=True))
        return {"is_success": bool(record["success"]), "reward_terms": terms}

    def episode_info(self, env_index: int) -> dict[str, Any]:
        """Info at the end of an episode: the task's own outcome, and the limits."""
        return {**self.outcome(self.batch[env_index]), **self.limit_info(env_index)}

    def limit_info(self, env_index: int) -> dict[str, Any]:
        """Worst limit ratio of an environment's episode, and the worst of each kind."""
        ratios = dict(zip(LIMIT_KINDS, self.batch["limit_ratios"][env_index].tolist(), strict=True))
        return {"limit_ratio": max(ratios.values()), "limit_ratios": ratios}

    @staticmethod
    def action_size(config: Any, arm: Arm) -> int:
        """Numbers in an action: one per joint, unless the task has other actions."""
        return arm.n_joints

    @staticmethod
    def actuation_mode(config: Any) -> ControlMode:
        """Control mode of the kernels: that of the policy, unless the task turns actions into others."""
        mode: ControlMode = config.control_mode
        return mode

    @property
    def frame_rate(self) -> int:
        """Frames a second of a film that shows every control period."""
        return round(1.0 / self.config.control_period)

    def action_space(self) -> gym.Space[NDArray[np.float32]]:
        """The action space of one environment: numbers in [-1, 1]."""
        return gym.spaces.Box(-1.0, 1.0, self.batch["action"].shape[1:], np.float32)

    def _seconds_held(self, record: Any, steps: int) -> float:
        """Time from which on a condition has held that has done so for ``steps`` control periods, s."""
        return (int(record["step"]) - steps + 1) * self.config.control_period

    def _problem(self, seen: dict[str, Array], target: Any, **more: Any) -> MotionProblem:
        """Reach a target from the observed joint state within the observed time left."""
        return MotionProblem(
            arm=self.arm,
            q=seen["joint_position"],
            qd=seen["joint_velocity"],
            qdd=seen["joint_acceleration"],
            target=target,
            horizon=max(float(seen["time_left"][0]), self.config.control_period),
            **more,
        )

    def _executor(self) -> ThreadPoolExecutor:
        # Threads do not survive a fork, so a pool belongs to the process that made it.
        if self._pool is None or self._pool[0] != os.getpid():
            self._pool = (os.getpid(), ThreadPoolExecutor(self._threads, thread_name_prefix="planarm"))
        return self._pool[1]


def whole_periods(config: TaskSettings, name: str, seconds: float) -> int:
    """A named time, s, in control periods; ValueError if it is no multiple of them, or longer than the horizon."""
    count = whole_multiple(name, seconds, "control_period", config.control_period)
    if count > whole_multiple("horizon", config.horizon, "control_period", config.control_period):
        raise ValueError(f"{name} {seconds} s is longer than the horizon {config.horizon} s; change one of them")
    return count
