"""Best known motions: for each stored start of a task the best value that any motion has scored in the environment.

``python -m tools.best_known`` finds them and writes a file per task here. A file holds the actions too, so that every
value can be played back, and lower bounds: values that no motion can be better than.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planners.files import whole_file
from planners.problem import MotionProblem

PAPER = -1
"""Key of the paper's own start, in place of a seed."""

_CLOSE = 1e-5
"""Largest difference between equal starts, in units of the scales of observations."""

_TABLE_SAMPLES = 16

_ARRAYS = ("keys", "starts", "values", "lower", "lengths", "actions")


@dataclass
class BestKnown:
    """What is stored of a task with its default settings; entry i of each list belongs to one start.

    Attributes:
        recipe: command, method and versions.
        keys: seeds, or `PAPER`.
        starts: what `start_of` gives, ``(size,)`` each.
        values: of the bounded metric, as the environment scored the motion.
        lower: certified lower bounds of it; NaN where there is none.
        actions: of the motion, ``(periods, k)`` each, as given to ``env.step``.
    """

    recipe: dict[str, Any] = field(default_factory=dict)
    keys: list[int] = field(default_factory=list)
    starts: list[NDArray[np.float32]] = field(default_factory=list)
    values: list[float] = field(default_factory=list)
    lower: list[float] = field(default_factory=list)
    actions: list[NDArray[np.float32]] = field(default_factory=list)

    def put(
        self, key: int, start: NDArray[np.float32], value: float, lower: float, actions: NDArray[np.float32]
    ) -> None:
        """Store a start, or replace it."""
        lists: tuple[list[Any], ...] = (self.keys, self.starts, self.values, self.lower, self.actions)
        at = self.keys.index(key) if key in self.keys else len(self.keys)
        for entries, entry in zip(lists, (key, start, value, lower, actions), strict=True):
            entries[at : at + 1] = [entry]

    def index_of(self, start: NDArray[np.float32]) -> int | None:
        """Which entry has this start; None if none has."""
        if not self.starts or self.starts[0].shape != start.shape:
            return None
        distance = np.abs(np.array(self.starts) - start).max(axis=1)
        nearest = int(distance.argmin())
        return nearest if distance[nearest] <= _CLOSE else None


def file_of(env_id: str) -> Path:
    """Where the results of a task are."""
    return Path(__file__).with_name(f"{env_id}.npz")


def read(path: Path) -> BestKnown:
    """The results in a file; none if there is no file."""
    if not path.exists():
        return BestKnown()
    with np.load(path, allow_pickle=False) as stored:
        recipe = json.loads(str(stored["recipe"]))
        keys, starts, values, lower, lengths, actions = (stored[name] for name in _ARRAYS)
    parts = np.split(actions, np.cumsum(lengths)[:-1])
    return BestKnown(recipe, keys.tolist(), list(starts), values.tolist(), lower.tolist(), parts)


def write(path: Path, known: BestKnown) -> None:
    """Write the results atomically."""
    lengths = [len(actions) for actions in known.actions]
    values = known.keys, known.starts, known.values, known.lower, lengths, np.concatenate(known.actions)
    arrays: dict[str, Any] = dict(zip(_ARRAYS, map(np.asarray, values), strict=True))
    with whole_file(path) as draft, draft.open("wb") as file:
        np.savez_compressed(file, recipe=np.array(json.dumps(known.recipe)), **arrays)


@lru_cache(maxsize=8)
def load(env_id: str) -> BestKnown:
    """The stored results of a task."""
    return read(file_of(env_id))


def start_of(task: Any, env_index: int = 0) -> NDArray[np.float32]:
    """What tells the starts of a task apart: the observation, and samples of the table, which holds paths of discs."""
    table = np.ravel(task.table(env_index))
    samples = table[:: max(1, table.size // _TABLE_SAMPLES)]
    return np.concatenate([task.batch[env_index]["observation"], samples.astype(np.float32)])


def best_known(env: Any, env_index: int) -> float:
    """The best known value for an environment at its start; NaN for a start or settings of which none is stored.

    Args:
        env: a vector environment.
        env_index: of the environment in it.
    """
    index = _stored(env, env_index)
    return math.nan if index is None else float(load(env.task.env_id).values[index])


def lower_bound(env: Any, env_index: int, seed: int = 0) -> float:
    """A value that no motion can be better than, for an environment at its start; NaN where none is stored.

    Args:
        env: a vector environment.
        env_index: of the environment in it.
        seed: not used; for `envs.card.Bound`.
    """
    index = _stored(env, env_index)
    return math.nan if index is None else float(load(env.task.env_id).lower[index])


def true_problem(env: Any, env_index: int) -> MotionProblem:
    """What an environment at its start asks for, from the joint state as it is and not as it is measured.

    Args:
        env: a vector environment.
        env_index: of the environment in it.
    """
    record = env.task.batch[env_index]
    problem: MotionProblem = env.motion_problem(env_index)
    return replace(problem, q=record["q"].copy(), qd=record["qd"].copy(), qdd=record["qdd"].copy())


def _stored(env: Any, env_index: int) -> int | None:
    """The stored entry of an environment's start."""
    config, known = env.task.config, load(env.task.env_id)
    if config.model_dump() != type(config)().model_dump():
        return None
    return known.index_of(start_of(env.task, env_index))
