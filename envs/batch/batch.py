"""`Batch`: the memory of a task's environments, which compiled kernels advance, and their bodies in Chipmunk."""

from __future__ import annotations

from collections.abc import Callable
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from envs.arms import require_inertia
from envs.batch.pool import NO_PURPOSE, RESTING, Words, job_of, work, work_on_all
from envs.batch.records import Fields, Records, address_of_first, first_public_byte, make_records, public_view
from envs.batch.state import Episodes, State, make_state, rows
from envs.physics.episode import EntryPoint
from envs.physics.rigid_bodies import NoWorld, World
from planners import Arm
from planners.typing import Array


class Batch:
    """Records, bodies and tables of environments; nothing outside of a task holds one.

    Args:
        kernels: module with the kernels of the task.
        arm: the arm with the payload that it holds.
        count: number of environments.
        fields: fields of a record.
        model: the record that all share.
        table_shape: shape of an environment's table; ``()`` for none.

    Attributes:
        records: one per environment, with the addresses of its bodies.
        actions: their actions, ``(count, k)``.
        world: their bodies in Pymunk, if it moves them.
    """

    def __init__(
        self, kernels: Any, arm: Arm, count: int, fields: Fields, model: Records, table_shape: tuple[int, ...]
    ) -> None:
        self.records = make_records(count, fields)
        self.records["env_index"] = np.arange(count)
        self.actions = self.records["action"]
        self.model = model
        exact = bool(model["closed_form"][0])
        if not exact:
            require_inertia(arm)
        self.world = NoWorld(count) if exact else World(arm, self.records)
        self.table_shape = table_shape
        self._kernels = kernels
        self._bytes = self.records.view(np.uint8).reshape(count, -1)[:, first_public_byte(self.records) :]
        self._view = public_view(self.records)
        self._tables = [b""] * count
        for env_index in range(count):
            self._place_table(env_index, bytes(8 * prod(table_shape)))
        self._resting, self._some_rested = np.zeros(count), False
        self._jobs: dict[str, Words] = {}

    @property
    def view(self) -> Records:
        """The records, to read, without addresses."""
        return self._view.view()

    def record(self, env_index: int) -> Any:
        """The record of an environment; a ValueError if there is none of this index."""
        if not 0 <= env_index < len(self.records):
            raise ValueError(f"env_index {env_index} must be 0 to {len(self.records) - 1}")
        return self.records[env_index]

    def reset(self, env_index: int) -> None:
        """Begin the episode whose start has been written into an environment's record."""
        if isinstance(self._kernels.reset_env, EntryPoint):
            work(self._job("reset_env"), env_index, env_index + 1)
        else:
            self._kernels.reset_env(self.records, self.model, env_index)

    def refresh(self, env_index: int) -> None:
        """Let the bodies and the observation follow what was written into a record in the middle of an episode."""
        if hasattr(self._kernels, "refresh_env"):
            work(self._job("refresh_env"), env_index, env_index + 1)

    def advance(self, resting: NDArray[np.bool_] | None = None) -> None:
        """Advance the environments, but those that rest, by one control period, on several threads if they are many."""
        job = self._jobs.get("advance_batch")
        if job is None:
            job = self._job("advance_batch")
        if resting is not None:
            self._resting[:] = resting
            job[RESTING] = address_of_first(self._resting)
        elif self._some_rested:
            job[RESTING] = 0
        self._some_rested = resting is not None
        work_on_all(job, len(self.records))

    def take_over(self, other: Batch, load: Callable[[Any], None]) -> None:
        """Continue the episodes of another batch of the same task and arm, whose payload may be another.

        Args:
            other: the batch.
            load: writes this batch's payload into a record.
        """
        self._bytes[...] = other._bytes
        for env_index, table in enumerate(other._tables):
            self._place_table(env_index, table)
            load(self.records[env_index])
            self.world.place(self.records, self.model, env_index)
            self.refresh(env_index)

    def table(self, env_index: int) -> Array:
        """The table of an environment, to read."""
        self.record(env_index)
        return np.frombuffer(self._tables[env_index]).reshape(self.table_shape)

    def write_table(self, record: Any, table: Array | bytes) -> None:
        """Give the environment of a record another table, or its bytes."""
        if not isinstance(table, bytes):
            if table.shape != self.table_shape:
                raise ValueError(f"expected a table of shape {self.table_shape}, found {table.shape}")
            table = table.astype(np.float64, order="C").tobytes()
        elif len(table) != 8 * prod(self.table_shape):
            raise ValueError(f"expected a table of {8 * prod(self.table_shape)} bytes, found {len(table)}")
        self._place_table(int(record["env_index"]), table)

    def save(self, settings: dict[str, Any], episodes: Episodes | None) -> State:
        """The state of all environments, which have these settings."""
        return make_state(
            settings=settings,
            count=len(self.records),
            records=self._bytes.tobytes(),
            physics=self.world.save().tobytes(),
            tables=tuple(self._tables),
            episodes=episodes,
        )

    def load(self, state: State) -> None:
        """Continue from a state that fits.

        Raises:
            ValueError: if its parts have other sizes than those of this batch.
        """
        count, (_, numbers) = state.count, self.world.shape
        sizes = count * self._bytes.shape[1], 8 * count * numbers, [8 * prod(self.table_shape)] * count
        if (len(state.records), len(state.physics), [len(table) for table in state.tables]) != sizes:
            raise ValueError("the state is damaged, or from another version of planarm: its parts have other sizes")
        self.world.load(np.broadcast_to(np.frombuffer(state.physics).reshape(count, numbers), self.world.shape))
        self._bytes[...] = np.frombuffer(state.records, np.uint8).reshape(count, -1)
        for env_index, table in enumerate(rows(state.tables, len(self.records))):
            if table is not self._tables[env_index]:
                self._place_table(env_index, table)

    def _place_table(self, env_index: int, table: bytes) -> None:
        self._tables[env_index] = table
        self.records["table"][env_index] = address_of_first(table) if table else 0

    def _job(self, name: str) -> Words:
        """A kernel of the task, which works on the records."""
        if name not in self._jobs:
            kernel = getattr(self._kernels, name)
            kernel, purpose = kernel if isinstance(kernel, EntryPoint) else (kernel, NO_PURPOSE)
            self._jobs[name] = job_of(kernel, self.records, self.model, purpose)
        return self._jobs[name]
