"""Observation layouts: every entry declared once, by name, with its shape, unit and scale."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from planners.checks import floats
from planners.typing import Array

Observation = NDArray[np.float32]


@dataclass(frozen=True)
class Entry:
    """One named part of an observation.

    Attributes:
        name: name of the entry.
        shape: shape of the entry; ``()`` for a single number. An observation holds it flattened.
        scale: physical value of an observed 1; an observation holds value / scale.
        bound: largest observed magnitude; larger values are clipped.
        unit: unit of the physical value.
        meaning: description for the documentation.
    """

    name: str
    shape: tuple[int, ...]
    scale: float
    bound: float
    unit: str
    meaning: str

    @property
    def size(self) -> int:
        """Number of elements."""
        return math.prod(self.shape)


@dataclass(frozen=True)
class Layout:
    """The named entries of an observation, in order."""

    entries: tuple[Entry, ...]

    @property
    def size(self) -> int:
        """Number of elements of one observation."""
        return sum(entry.size for entry in self.entries)

    @property
    def scales(self) -> Array:
        """Physical value of an observed 1, ``(size,)``."""
        return np.repeat([entry.scale for entry in self.entries], [entry.size for entry in self.entries])

    @property
    def bounds(self) -> Array:
        """Largest observed magnitude, ``(size,)``."""
        return np.repeat([entry.bound for entry in self.entries], [entry.size for entry in self.entries])

    @property
    def record(self) -> np.dtype[Any]:
        """Record of the physical values by name; its field ``flat``, ``(size,)``, is the same memory."""
        fields = [(entry.name, ("f8", entry.shape), 8 * place.start) for entry, place in self.slices()]
        names, formats, offsets = zip(*fields, ("flat", ("f8", (self.size,)), 0), strict=True)
        return np.dtype({"names": names, "formats": formats, "offsets": offsets}, align=True)

    def slices(self) -> Iterator[tuple[Entry, slice]]:
        """Each entry with its place in the observation."""
        begin = 0
        for entry in self.entries:
            yield entry, slice(begin, begin + entry.size)
            begin += entry.size

    def space(self) -> gym.Space[Observation]:
        """The observation space."""
        bounds = self.bounds.astype(np.float32)
        return gym.spaces.Box(-bounds, bounds, dtype=np.float32)

    def parse(self, observation: Observation) -> dict[str, Array]:
        """Physical values by name, each ``(..., entry.size)`` in SI units, from observations ``(..., size)``.

        Raises:
            ValueError: if the observation has another size.
        """
        values = floats("observation", observation)
        if values.shape[-1:] != (self.size,):
            raise ValueError(
                f"observation of shape {values.shape}; this layout has {self.size} elements in its last axis"
            )
        physical = values * self.scales
        return {entry.name: np.ascontiguousarray(physical[..., place]) for entry, place in self.slices()}

    def compose(self, seen: Mapping[str, Array]) -> Observation:
        """Observations ``(num_envs, size)`` of physical values as `parse` gives them, clipped to the bounds."""
        parts = [np.clip(seen[entry.name] / entry.scale, -entry.bound, entry.bound) for entry in self.entries]
        return np.concatenate(parts, axis=-1).astype(np.float32)

    def table(self) -> str:
        """The layout as a Markdown table."""
        rows = ["| Index | Name | Unit | Scale | Bound | Meaning |", "|---|---|---|---|---|---|"]
        for entry, place in self.slices():
            index = str(place.start) if entry.size == 1 else f"{place.start}-{place.stop - 1}"
            bound = f"±{entry.scale * entry.bound:g}"
            rows.append(f"| {index} | `{entry.name}` | {entry.unit} | {entry.scale:g} | {bound} | {entry.meaning} |")
        return "\n".join(rows)
