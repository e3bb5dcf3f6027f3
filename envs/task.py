"""The base of every task: what it declares and means; its running episodes are in `envs.batch.running`."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, ClassVar, Self

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from envs.arms import require_links
from envs.batch.assembly import assemble
from envs.batch.records import Fields
from envs.batch.running import RunningEpisodes
from envs.card import task_card
from envs.observation import Layout, Observation
from envs.physics.actuation import LIMIT_KINDS, ControlMode
from envs.physics.rigid_bodies import whole_multiple
from envs.rendering import Scene
from envs.settings import refuse_unknown
from envs.task_settings import LimitSettings as LimitSettings
from envs.task_settings import TaskSettings as TaskSettings
from envs.task_settings import whole_periods as whole_periods
from envs.uncertainty.draw import Uncertainty
from planners import Arm, MotionProblem
from planners.compiled.calls import Kernel
from planners.typing import Array


class Task(RunningEpisodes):
    """A batch of environments of one task.

    An environment's state is one record of `batch`; what all environments share is the single record of `model`. Both
    are views that nobody can write to: a kernel gets the whole records, with the addresses of the bodies in Chipmunk.
    A subclass declares what is listed below, draws the starts of episodes and writes them into records (`draw`,
    `write_start`), and has two compiled kernels:
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
        boolean_outcomes: those of the keys whose values are bools; the others' are numbers.
        gauges: kinds of limit that a frame shows.
        view: part of the plane that a frame shows: x from, x to, y from, y to, m.
        physics: what can move the arms, of the setting ``physics``; ``"closed_form"`` needs kernels that move them by
            `envs.physics.actuation.move_arms`.
        measures: whether the kernels observe noise themselves, under the ``noise_key`` that `write_start` writes; else
            the module has a kernel ``MEASURE``, ``kernel(batch, model, index)``, which writes the observation of an
            environment where the settings ask for noise.
        default_arm: the robot, unless the settings name another.
        arm: the robot as a policy knows it, without its payload.
        uncertainty: what is drawn of the true robot for an episode.

    Args:
        config: the settings.
        arm: the robot.
        num_envs: number of environments.
        env_fields: fields of an environment's record, besides what every task has.
        constants: what the kernels read from the model record, besides the numbers of the settings.
        table_shape: of a table of numbers per episode that `write_start` gives to `write_table`.
        kernels: called with an environment's record and the model record, by the field of the model record with the
            address; the name ends with ``_kernel``. None for one that these settings do not need.
    """

    config_type: ClassVar[type[TaskSettings]]
    kernels: ClassVar[Any]
    default_arm: ClassVar[Arm]
    physics: ClassVar[tuple[str, ...]] = ("pymunk",)
    layout: Layout
    reward_terms: ClassVar[tuple[str, ...]]
    outcomes: ClassVar[Mapping[str, str]] = {}
    boolean_outcomes: ClassVar[tuple[str, ...]] = ()
    gauges: ClassVar[tuple[str, ...]]
    view: tuple[float, float, float, float]

    def __init__(
        self,
        config: TaskSettings,
        arm: Arm,
        num_envs: int,
        env_fields: Fields,
        constants: Mapping[str, Any],
        *,
        table_shape: tuple[int, ...] = (),
        kernels: Mapping[str, Kernel | None] = MappingProxyType({}),
    ) -> None:
        self.config = config
        self.arm = arm
        self.horizon_steps = whole_periods(config, "horizon", config.horizon)
        self.uncertainty = Uncertainty(config, arm)
        super().__init__(assemble(self, num_envs, env_fields, constants, table_shape, kernels))

    @classmethod
    def make(cls, config: Mapping[str, Any], num_envs: int) -> Self:
        """The task from settings by name.

        Raises:
            ValueError: for an unknown name or a value that is not allowed.
        """
        task: Any = cls
        settings = cls.config_type.parse(config, f"{cls.env_id} setting")
        refuse_unknown([settings.physics], cls.physics, f"{cls.env_id} physics")
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

    @abstractmethod
    def outcome(self, record: Any) -> dict[str, Any]:
        """Results of the episode of an environment's record, under the keys of `outcomes`.

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
        return self.arm.forward_kinematics(self._batch.record(env_index)["q"])

    def scene(self, env_index: int, trail: Sequence[Any]) -> Scene:
        """What a frame of an environment shows, with the past hand positions ``trail``."""
        record = self._batch.record(env_index)
        ratios = dict(zip(LIMIT_KINDS, record["limit_ratios"].tolist(), strict=True))
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

    def forget_worst_ratios(self, env_index: int) -> None:
        """Let `limit_ratios`, and the gauges of the next frame, count from now on; rewards and scores stay the same."""
        self._batch.record(env_index)["limit_ratios"][:] = 0.0

    def close(self) -> None:
        """Free what a subclass holds besides memory; may be called twice. Here, nothing."""

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
        return gym.spaces.Box(-1.0, 1.0, self._batch.actions.shape[1:], np.float32)

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
