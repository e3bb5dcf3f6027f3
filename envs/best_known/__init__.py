"""Best known motions: for each stored start of a task the best value that any motion has scored in the environment.

``python -m tools.best_known`` finds them and writes a file per task here. A file holds the actions too, so that every
value can be played back.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planners.files import whole_file

PAPER = -1
"""Key of the paper's own start, in place of a seed."""

_CLOSE = 1e-5
"""Largest difference between the observations of equal starts, in units of their scales."""

_ARRAYS = ("keys", "starts", "values", "lengths", "actions")


@dataclass
class BestKnown:
    """What is stored of a task with its default settings; entry i of each list belongs to one start.

    Attributes:
        recipe: command, method and versions.
        keys: seeds, or `PAPER`.
        starts: observations at the start, ``(size,)`` each.
        values: of the bounded metric, as the environment scored the motion.
        actions: of the motion, ``(periods, k)`` each, as given to ``env.step``.
    """

    recipe: dict[str, Any] = field(default_factory=dict)
    keys: list[int] = field(default_factory=list)
    starts: list[NDArray[np.float32]] = field(default_factory=list)
    values: list[float] = field(default_factory=list)
    actions: list[NDArray[np.float32]] = field(default_factory=list)

    def put(self, key: int, start: NDArray[np.float32], value: float, actions: NDArray[np.float32]) -> None:
        """Store a start, or replace it."""
        if key in self.keys:
            at = self.keys.index(key)
            self.starts[at], self.values[at], self.actions[at] = start, value, actions
            return
        self.keys.append(key)
        self.starts.append(start)
        self.values.append(value)
        self.actions.append(actions)

    def index_of(self, start: NDArray[np.float32]) -> int | None:
        """Which entry has this observation at its start; None if none has."""
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
        keys, starts, values, lengths, actions = (stored[name] for name in _ARRAYS)
    parts = np.split(actions, np.cumsum(lengths)[:-1])
    return BestKnown(recipe, keys.tolist(), list(starts), values.tolist(), parts)


def write(path: Path, known: BestKnown) -> None:
    """Write the results atomically."""
    lengths = [len(actions) for actions in known.actions]
    values = known.keys, known.starts, known.values, lengths, np.concatenate(known.actions)
    arrays: dict[str, Any] = dict(zip(_ARRAYS, map(np.asarray, values), strict=True))
    with whole_file(path) as draft, draft.open("wb") as file:
        np.savez_compressed(file, recipe=np.array(json.dumps(known.recipe)), **arrays)


@lru_cache(maxsize=8)
def load(env_id: str) -> BestKnown:
    """The stored results of a task."""
    return read(file_of(env_id))


def best_known(env: Any, env_index: int) -> float:
    """The best known value for an environment at its start; NaN for a start or settings of which none is stored.

    Args:
        env: a vector environment.
        env_index: of the environment in it.
    """
    config, known = env.task.config, load(env.task.env_id)
    if config.model_dump() != type(config)().model_dump():
        return math.nan
    index = known.index_of(env.task.batch[env_index]["observation"])
    return math.nan if index is None else float(known.values[index])
