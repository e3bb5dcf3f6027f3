"""The base of every task: a batch of environments whose whole state compiled kernels read and write."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from functools import cached_property
from threading import Lock
from types import MappingProxyType
from typing import Any, ClassVar, Self

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from envs.arms import require_links
from envs.batch.assembly import assemble
from envs.batch.exclusive import exclusive, refuse_second
from envs.batch.records import Fields, Records, public_view
from envs.batch.state import Episodes, State, checked_state
from envs.card import Control, task_card
from envs.checks import checked_change
from envs.observation import Layout, Observation
from envs.physics.actuation import LIMIT_KINDS, ControlMode
from envs.physics.rigid_bodies import whole_multiple
from envs.rendering import Scene
from envs.settings import Settings, refuse_unknown
from envs.task_settings import LimitSettings as LimitSettings
from envs.task_settings import TaskSettings as TaskSettings
from envs.task_settings import whole_periods as whole_periods
from envs.uncertainty.draw import Uncertainty
from planners import Arm, MotionProblem
from planners.compiled.calls import Kernel
from planners.typing import Array

Options = Mapping[str, Any]


class Task(ABC):
    """A batch of environments of one task.

    An environment's state is one record of `batch`; what all environments share is the single record of `model`. Both
    are views that nobody can write to: a kernel gets the whole records, with the addresses of the bodies in Chipmunk.
    Copying or pickling a task keeps the running episodes: it makes another with the settings, and sets its state.
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

    env_id: ClassVar[str]
    config_type: ClassVar[type[TaskSettings]]
    options_type: ClassVar[type[Settings]]
    kernels: ClassVar[Any]
    default_arm: ClassVar[Arm]
    physics: ClassVar[tuple[str, ...]] = ("pymunk",)
    layout: Layout
    reward_terms: ClassVar[tuple[str, ...]]
    outcomes: ClassVar[Mapping[str, str]] = {}
    boolean_outcomes: ClassVar[tuple[str, ...]] = ()
    gauges: ClassVar[tuple[str, ...]]
    view: tuple[float, float, float, float]
    measures: ClassVar[bool] = False

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
        self._batch = assemble(self, num_envs, env_fields, constants, table_shape, kernels)
        self._ready, self._in_use = False, Lock()

    @property
    def num_envs(self) -> int:
        """Number of environments."""
        return len(self._batch.records)

    @property
    def batch(self) -> Records:
        """One record per environment, to read."""
        return self._batch.view

    @property
    def model(self) -> Records:
        """One record: the numbers of the configuration, and the ``constants`` given to the constructor, to read."""
        return public_view(self._batch.model)

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

    @exclusive
    def reset_envs(
        self, env_indices: Sequence[int], generators: Sequence[np.random.Generator], options: Options
    ) -> None:
        """Begin an episode in some environments, each with its own generator.

        Raises:
            ValueError: for unknown options, or a start from which the task cannot be solved; nothing has changed then.
        """
        records = [self._batch.record(env_index) for env_index in env_indices]
        if len(generators) != len(records):
            raise ValueError(f"{len(generators)} generators for {len(records)} environments; give one for each")
        starts = self.draw(generators, self._parsed(options) if options else self._all_drawn)
        truths = self.uncertainty.draw(generators, key=not self.measures)
        for record, start, truth in zip(records, starts, truths, strict=True):
            self.uncertainty.write(record, truth)
            self.begin(record, start)
            record["begun"] = True
        self._ready = bool(self._batch.records["begun"].all())

    def begin(self, record: Any, start: Any) -> None:
        """Begin the episode of a start in the environment of a record."""
        self.write_start(record, start)
        self._batch.reset(int(record["env_index"]))

    @exclusive
    def take_over(self, other: Task) -> None:
        """Continue the episodes of a task whose settings differ in the payload at most.

        Raises:
            ValueError: for another task, other settings, or a task with a machine of its own.
        """
        ours, theirs = (one.config.model_dump(exclude={"payload"}) for one in (self, other))
        if type(self) is not type(other) or self.num_envs != other.num_envs or ours != theirs:
            raise ValueError("the episodes are of another task, or one whose settings differ in more than the payload")
        if not task_card(self.env_id).links:
            raise ValueError(f"{self.env_id} has a machine of its own, whose payload belongs to the episode")
        self._batch.take_over(other._batch, self.uncertainty.load)
        self._ready = other._ready

    @exclusive
    def change(self, env_index: int, control: Control, value: Any, index: int = 0) -> bool:
        """Change a running episode by a control of the task's card; whether that is done, as `Control.write` says.

        Raises:
            ValueError: for a value that the control does not take, or that is impossible.
        """
        record = self._batch.record(env_index)
        points = 0 if control.span else len(control.read(self, record))
        done = control.write(self, record, *checked_change(control, points, value, index))
        if done:
            self._batch.refresh(env_index)
        return done

    @abstractmethod
    def draw(self, generators: Sequence[np.random.Generator], options: Any) -> Sequence[Any]:
        """Draw one start per generator, as the options (of `options_type`) say; bad ones raise ValueError."""

    @abstractmethod
    def write_start(self, record: Any, start: Any) -> None:
        """Write a start into the record of an environment."""

    def write_table(self, record: Any, table: Array | bytes) -> None:
        """Give an environment the table of its episode, which its kernels read by `envs.physics.episode.table_of`."""
        self._batch.write_table(record, table)

    def table(self, env_index: int) -> Array:
        """The table of an environment's episode."""
        return self._batch.table(env_index)

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

    def advance(self, actions: Array | None = None, resting: NDArray[np.bool_] | None = None) -> None:
        """Advance every environment by one control period, on several threads if there are many.

        Args:
            actions: finite numbers, ``(num_envs, k)``; None for those of the last period.
            resting: environments that stay as they are, ``(num_envs,)``; none if left out.
        """
        if self._in_use.locked():
            refuse_second("advance", self)
        if not self._ready:
            raise gym.error.ResetNeeded("an environment has not begun an episode: call reset_envs() first")
        with self._in_use:
            if actions is not None:
                self._batch.actions[...] = actions
            self._batch.advance(resting)

    @exclusive
    def get_state(self, episodes: Episodes | None = None) -> State:
        """The running episodes as one value, to the bit, with what a Gymnasium environment knows of them.

        Raises:
            RuntimeError: if the installed Pymunk keeps its numbers elsewhere than planarm knows.
        """
        return self._batch.save(self._common, episodes)

    @exclusive
    def set_state(self, state: State) -> None:
        """Continue from a state of a task with the same settings; that of a single environment goes to all.

        Raises:
            ValueError: for the state of another task, or with other settings; nothing has changed then.
        """
        checked_state(state).require_fit(self._common, self.num_envs)
        self._batch.load(state)
        self._ready = bool(self._batch.records["begun"].all())

    def __reduce__(self) -> tuple[Any, ...]:
        return _made_again, (type(self), self.config, self.num_envs, self.get_state())

    def close(self) -> None:  # noqa: B027  nothing that every task would have to do
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

    def _parsed(self, options: Options) -> Any:
        return self.options_type.parse(options, f"{self.env_id} option")

    @cached_property
    def _all_drawn(self) -> Any:
        """The options of an episode of which nothing is given."""
        return self._parsed({})

    @cached_property
    def _common(self) -> dict[str, Any]:
        """What an environment has to have in common with this one to continue its states."""
        own = [name for name in type(self.config).model_fields if name not in ("arm", "gravity")]
        return {
            "environment": self.env_id,
            "task": f"{type(self).__module__}.{type(self).__qualname__}",
            **{name: getattr(self.config, name) for name in own},
            "arm": self.arm,
            "fields of a record": str(self.batch.dtype),
        }


def _made_again(kind: Any, config: TaskSettings, num_envs: int, state: State) -> Task:
    """A task with the episodes of another one."""
    task: Task = kind(config, num_envs)
    task.set_state(state)
    return task
