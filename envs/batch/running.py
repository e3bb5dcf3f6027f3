"""The running episodes of a task: how they begin, advance, are changed, kept as a value and continued."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from functools import cached_property
from threading import Lock
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from envs.batch.batch import Batch
from envs.batch.exclusive import exclusive, refuse_second
from envs.batch.records import Records, public_view
from envs.batch.state import Episodes, State, checked_state
from envs.card import Control, task_card
from envs.checks import checked_change
from envs.settings import Settings
from envs.task_settings import TaskSettings
from envs.uncertainty.draw import Uncertainty
from planners import Arm
from planners.typing import Array

Options = Mapping[str, Any]


class RunningEpisodes(ABC):
    """The part of `envs.task.Task` that no task changes: the episodes of a batch, which one thread at a time works on.

    Copying or pickling makes another task with the settings, and sets its state.
    """

    env_id: ClassVar[str]
    options_type: ClassVar[type[Settings]]
    measures: ClassVar[bool] = False
    config: TaskSettings
    arm: Arm
    uncertainty: Uncertainty

    def __init__(self, batch: Batch) -> None:
        self._batch = batch
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

    @abstractmethod
    def draw(self, generators: Sequence[np.random.Generator], options: Any) -> Sequence[Any]:
        """Draw one start per generator, as the options (of `options_type`) say; bad ones raise ValueError."""

    @abstractmethod
    def write_start(self, record: Any, start: Any) -> None:
        """Write a start into the record of an environment."""

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
        self._ready = self._ready or bool(self._batch.records["begun"].all())

    def begin(self, record: Any, start: Any) -> None:
        """Begin the episode of a start in the environment of a record."""
        self.write_start(record, start)
        self._batch.reset(int(record["env_index"]))

    @exclusive
    def take_over(self, other: RunningEpisodes) -> None:
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

    def write_table(self, record: Any, table: Array | bytes) -> None:
        """Give an environment the table of its episode, which its kernels read by `envs.physics.episode.table_of`."""
        self._batch.write_table(record, table)

    def table(self, env_index: int) -> Array:
        """The table of an environment's episode."""
        return self._batch.table(env_index)

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

    def _parsed(self, options: Options) -> Any:
        return self.options_type.parse(options, f"{self.env_id} option")

    @cached_property
    def _all_drawn(self) -> Any:
        """The options of an episode of which nothing is given."""
        return self._parsed({})

    @cached_property
    def _common(self) -> dict[str, Any]:
        """What an environment has to have in common with this one to continue its states."""
        own = [name for name in type(self.config).model_fields if name not in ("arm", "gravity", "info_terms")]
        return {
            "environment": self.env_id,
            "task": f"{type(self).__module__}.{type(self).__qualname__}",
            **{name: getattr(self.config, name) for name in own},
            "arm": self.arm,
            "fields of a record": str(self.batch.dtype),
        }


def _made_again(kind: Any, config: TaskSettings, num_envs: int, state: State) -> RunningEpisodes:
    """A task with the episodes of another one."""
    task: RunningEpisodes = kind(config, num_envs)
    task.set_state(state)
    return task
