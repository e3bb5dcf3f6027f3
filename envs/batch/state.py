"""`State`: a running episode, or a batch of them, as one value that can be kept, compared, pickled and continued."""

from __future__ import annotations

import reprlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, cast

import numpy as np


class Episodes(NamedTuple):
    """What a Gymnasium environment knows of its episodes.

    Attributes:
        begun: whether there has been a reset.
        over: which episodes are over and wait for the next reset.
        randoms: states of their random number generators; empty before the first reset.
        seed: of the last reset, in a single environment.
        trails: past positions of the hands, for pictures.
    """

    begun: bool
    over: tuple[bool, ...]
    randoms: tuple[Any, ...]
    seed: int | None
    trails: tuple[tuple[tuple[float, ...], ...], ...]

    def for_each_of(self, count: int) -> Episodes:
        """The same for so many environments, if it is that of a single one."""
        if len(self.over) == count:
            return self
        return self._replace(over=self.over * count, randoms=self.randoms * count, trails=self.trails * count)


@dataclass(frozen=True, init=False)
class State:
    """What `get_state` returns and `set_state` continues from, to the bit; its contents are no public names.

    Nobody else can make one, or another one with other contents: compiled code trusts the numbers in its records.

    Attributes:
        settings: what an environment must have in common with the one that the state is from, by name.
        count: number of environments.
        records: their records.
        physics: numbers of Chipmunk; none without it.
        tables: what they have drawn at the reset besides.
        episodes: what the Gymnasium environment knows of them, besides its task.
    """

    settings: Mapping[str, Any] = field(repr=False)
    count: int
    records: bytes = field(repr=False)
    physics: bytes = field(repr=False)
    tables: tuple[bytes, ...] = field(repr=False)
    episodes: Episodes | None = field(repr=False)

    def require_fit(self, settings: Mapping[str, Any], count: int) -> None:
        """Raise a ValueError, which names what differs, if an environment with these settings cannot continue it."""
        if self.settings is not settings and self.settings != settings:
            raise ValueError(f"the state is from another environment: {_differences(self.settings, settings)}")
        if self.count not in (1, count):
            raise ValueError(
                f"the state is that of {self.count} environments, here are {count}; "
                "give the state of as many, or of a single environment for all of them"
            )


def make_state(**contents: Any) -> State:
    """A state, of all of its attributes by name."""
    state = object.__new__(State)
    state.__dict__.update(contents)
    return state


def checked_state(state: Any) -> State:
    """A state; a ValueError if it is something else."""
    if not isinstance(state, State):
        raise ValueError(f"expected what get_state() returned, found {reprlib.repr(state)}")
    return state


def episodes_of(state: Any, count: int) -> Episodes:
    """What the Gymnasium environment of a state knew, for each of so many; a ValueError if it is another's."""
    episodes = checked_state(state).episodes
    if episodes is None or state.count not in (1, count):
        wanted = f"1 or {count} environments" if count > 1 else "a single environment"
        raise ValueError(f"expected the state of {wanted}, from its get_state(); found {state}")
    return episodes.for_each_of(count)


def _differences(given: Mapping[str, Any], here: Mapping[str, Any]) -> str:
    names = [name for name in {**given, **here} if given.get(name) != here.get(name)]
    if "environment" in names:
        names = ["environment"]
    return ", ".join(f"{name} {reprlib.repr(given.get(name))}, here {reprlib.repr(here.get(name))}" for name in names)


def state_of_generator(generator: np.random.Generator) -> dict[str, Any]:
    """The state of a random number generator, as a value that can be compared."""
    state = generator.bit_generator.state
    return cast(dict[str, Any], state if state["bit_generator"].startswith("PCG64") else _plain(state))


def set_generator(generator: np.random.Generator, state: dict[str, Any]) -> np.random.Generator:
    """A generator that continues from a state: the given one if it is of that kind."""
    kind = state["bit_generator"]
    if type(generator.bit_generator).__name__ != kind:
        generator = np.random.Generator(getattr(np.random, kind)(0))
    generator.bit_generator.state = state
    return generator


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _plain(item) for name, item in value.items()}
    return value.tolist() if isinstance(value, np.ndarray) else value


def rows(values: Sequence[Any], count: int) -> Sequence[Any]:
    """One value for each of so many environments; a single one is that of all."""
    return values if len(values) == count else [values[0]] * count
