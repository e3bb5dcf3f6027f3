"""Checks of what users hand to an environment or a policy: actions, observations, seeds, options, counts, modes."""

from __future__ import annotations

import inspect
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from envs.card import Control
from envs.observation import Observation
from planners.checks import checked_count, float_array, is_masked, refuse_unknown
from planners.typing import Array


def checked_actions(given: Any, shape: tuple[int, ...], resting: NDArray[np.bool_] | None = None) -> Array:
    """Actions as float64 of a shape, ``(n,)`` or ``(num_envs, n)``; 0 for environments in ``resting``, which hold none.

    Raises:
        ValueError: for anything but finite numbers of that shape, with what is expected and what was found.
    """
    if type(given) is np.ndarray and given.dtype.char in "fd" and given.shape == shape and resting is None:
        # Of one environment without the cost of array operations.
        finite = math.isfinite(sum(given.tolist())) if len(shape) == 1 else np.isfinite(given).all()
        if finite:
            usual: Array = given
            return usual
    try:
        actions = np.asarray(given)
    except (ValueError, TypeError) as error:
        raise ValueError(f"expected an action of shape {shape}, found {_shown(given)}, which is no array") from error
    if actions.dtype.kind not in "fiu" or is_masked(given):
        raise ValueError(
            f"expected an action of numbers (float32) of shape {shape}, found {_shown(given)} of type {actions.dtype}"
        )
    if actions.shape != shape:
        raise ValueError(
            f"expected an action of shape {shape}, found shape {actions.shape}; "
            + ("give one row of numbers per environment" if len(shape) == 2 else f"give {shape[0]} numbers")
        )
    with np.errstate(over="ignore"):  # of a longer type: found below
        numbers: Array = np.ascontiguousarray(actions, dtype=np.float64)
    if resting is not None:
        numbers = np.where(resting[:, None], 0.0, numbers)
    if not np.isfinite(numbers).all():
        bad = int(np.flatnonzero(~np.isfinite(numbers).all(axis=-1))[0]) if len(shape) == 2 else 0
        row = numbers[bad] if len(shape) == 2 else numbers
        raise ValueError(
            f"action {row.tolist()} (environment {bad}) is not finite; "
            "actions are numbers in [-1, 1], larger ones are clipped"
        )
    return numbers


def checked_observations(given: Any, size: int) -> Observation:
    """Observations as a batch, ``(num_envs, size)``, from those of a batch or of one environment, ``(size,)``.

    Raises:
        ValueError: for anything but numbers of such a shape, with what is expected and what was found.
    """
    array = np.asarray(given)
    batch: Observation = np.atleast_2d(array)
    if batch.ndim != 2 or batch.shape[1] != size or not len(batch) or array.dtype.kind not in "fiu":
        raise ValueError(
            f"expected observations of shape ({size},) or (num_envs, {size}), found shape {array.shape} of type "
            f"{array.dtype}"
        )
    if is_masked(given):
        raise ValueError("observations are masked: what is hidden is no number")
    return batch


def checked_starts(given: Any, count: int) -> NDArray[np.bool_]:
    """Which of so many environments are at the first step of an episode; none if that is None.

    Raises:
        ValueError: for anything but a truth value for each, with both shapes.
    """
    if given is None:
        return np.zeros(count, dtype=np.bool_)
    array = np.atleast_1d(np.asarray(given))
    if array.shape != (count,) or array.dtype.kind not in "biuf":
        raise ValueError(
            f"expected episode_start of shape ({count},), a bool for each environment, found {_shown(given)} of shape "
            f"{np.shape(given)}"
        )
    return array.astype(np.bool_)


def checked_change(control: Control, points: int, value: Any, index: Any) -> tuple[Any, ...]:
    """What a control writes: a number, or a position and the index of one of so many points.

    Raises:
        ValueError: for anything but a finite number in the control's span, or the finite position of a point there is.
    """
    number, span = float_array(control.title, value), control.span
    if number.shape != (() if span else (2,)) or not np.isfinite(number).all():
        wanted = "a finite number" if span else "a finite position (x, y), m"
        raise ValueError(f"{control.title} must be {wanted}; found {_shown(value)}")
    if span:
        if not span[0] <= number <= span[1]:
            raise ValueError(f"{control.title} {number:g} must be from {span[0]:g} to {span[1]:g}")
        return (float(number),)
    if index not in range(points):
        raise ValueError(f"{control.title} {_shown(index)} must be from 0 to {points - 1}")
    return number, int(index)


def checked_seed(seed: Any) -> int | None:
    """A seed as a whole number of Python; None as it is.

    Raises:
        ValueError: for anything but a whole number of at least 0.
    """
    if seed is None:
        return None
    if isinstance(seed, (bool, np.bool_)) or not isinstance(seed, (int, np.integer)) or seed < 0:
        raise ValueError(f"seed {_shown(seed)} must be a whole number of at least 0")
    return int(seed)


def checked_seeds(seeds: Any, count: int) -> list[int | None]:
    """A seed for each of so many environments: from one each, or seed + i from a single one.

    Raises:
        ValueError: for anything else.
    """
    if isinstance(seeds, np.ndarray):
        seeds = seeds.tolist()
    if isinstance(seeds, Sequence) and not isinstance(seeds, str | bytes):
        if len(seeds) != count:
            raise ValueError(f"{len(seeds)} seeds for {count} environments; give one int, or one seed per environment")
        return [checked_seed(seed) for seed in seeds]
    first = checked_seed(seeds)
    return [None if first is None else first + env_index for env_index in range(count)]


def checked_mode(mode: Any) -> AutoresetMode:
    """An autoreset mode, from itself, its value or its name.

    Raises:
        ValueError: for anything else, with what there is.
    """
    if isinstance(mode, AutoresetMode):
        return mode
    known = {text: one for name, one in AutoresetMode.__members__.items() for text in (one.value, name)}
    if not isinstance(mode, str):
        raise ValueError(f"autoreset_mode {mode!r} must be one of {', '.join(known)}")
    refuse_unknown([mode], known, "autoreset_mode")
    return known[mode]


def checked_time_limit(steps: Any) -> int | None:
    """A limit on the steps of an episode; None without one, which is also -1, as in `gymnasium.make`.

    Raises:
        ValueError: for anything else but a whole number of at least 1.
    """
    if steps is None or (isinstance(steps, (int, np.integer)) and steps == -1):
        return None
    return checked_count("max_episode_steps", steps, "; -1, or leaving it out, truncates at the horizon only")


def checked_options(options: Any) -> dict[str, Any]:
    """A copy of the options of ``reset``.

    Raises:
        ValueError: if they are no mapping.
    """
    if options is None:
        return {}
    if not isinstance(options, Mapping):
        raise ValueError(f'expected options by name, as in {{"scenario": "random"}}; found {_shown(options)}')
    return dict(options)


@contextmanager
def untouched_when_refused(generators: Sequence[np.random.Generator]) -> Iterator[None]:
    """Set random number generators back to where they were if the block raises an exception."""
    states = [generator.bit_generator.state for generator in generators]
    try:
        yield
    except BaseException:
        for generator, state in zip(generators, states, strict=True):
            generator.bit_generator.state = state
        raise


def time_limits_of(env: gym.Env[Any, Any]) -> list[gym.wrappers.TimeLimit[Any, Any]]:
    """Each of Gymnasium's `TimeLimit` around an environment that it is now resetting.

    An environment does not know its wrappers, so this looks for them among the callers of ``reset``.
    """
    found, frame = [], inspect.currentframe()
    while frame is not None:
        caller = frame.f_locals.get("self")
        if isinstance(caller, gym.wrappers.TimeLimit) and caller.unwrapped is env and caller not in found:
            found.append(caller)
        frame = frame.f_back
    return found


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
