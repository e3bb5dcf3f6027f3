"""Checks of given numbers and names, with errors that say what is allowed."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable
from numbers import Real
from typing import Any, Literal, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

Sign = Literal["", "positive", "not negative"]
_LEAST: dict[Sign, float] = {"": -math.inf, "positive": math.ulp(0.0), "not negative": 0.0}

LARGEST = 1e100
"""Largest magnitude of a number that describes an arm, a problem or an option: squares of larger ones may overflow."""


def is_number(value: Any) -> bool:
    """Whether a value is a single number, of Python or of NumPy."""
    if isinstance(value, bool | np.bool_) or is_masked(value):
        return False
    if isinstance(value, int) and value.bit_length() > 1023:  # beyond what a float holds
        return False
    return isinstance(value, Real) or (isinstance(value, np.ndarray) and value.ndim == 0 and value.dtype.kind in "iuf")


def is_masked(given: Any) -> bool:
    """Whether an array, or one in a list or tuple, hides some of its numbers."""
    if isinstance(given, list | tuple):
        return any(isinstance(one, list | tuple | np.ma.MaskedArray) and is_masked(one) for one in given)
    return isinstance(given, np.ma.MaskedArray) and bool(np.ma.is_masked(given))


def rounded_up(value: float) -> float:
    """A positive number rounded to four digits, never down: for messages that say how much is enough."""
    shown = float(f"{value:.3e}")
    digit = 10.0 ** (math.floor(math.log10(value)) - 3)
    return shown if shown >= value else float(f"{shown + digit:.3e}")


def float_array(name: str, given: Any) -> NDArray[np.float64]:
    """A new array of floats, of a number or of numbers in any nesting; ValueError for text, truth values and others."""
    try:
        if is_masked(given):
            raise ValueError
        array = np.array(given)
        fine = array.dtype.kind in "iuf" or (array.dtype.kind == "O" and all(map(is_number, array.flat)))
        if fine and not isinstance(given, np.ndarray):  # True among numbers would become 1.0
            fine = all(map(is_number, np.array(given, dtype=object).flat))
        if fine:
            return array.astype(float)
    except (TypeError, ValueError, OverflowError):
        pass
    raise ValueError(f"{name} {brief(given, 80)} must be numbers, as in (0.4, 0.3)")


def floats(name: str, given: Any) -> NDArray[np.float64]:
    """As `float_array`, without a copy of what is an array of floats already."""
    return given if type(given) is np.ndarray and given.dtype == np.float64 else float_array(name, given)


def require_finite(name: str, value: float, unit: str = "", sign: Sign = "", most: float = LARGEST) -> None:
    """Raise ValueError if a number is not finite, is larger than ``most``, or does not have the sign."""
    if not is_number(value):
        raise ValueError(f"{name} {brief(value, 80)} must be a finite number")
    size = float(value)  # a float32 cannot be compared with LARGEST
    if not _LEAST[sign] <= size <= most or size < -most:
        _refuse(f"{name} {value} {unit}".rstrip(), sign, most if math.isfinite(value) else math.inf)


def require_all_finite(name: str, values: ArrayLike, sign: Sign = "", most: float = LARGEST) -> None:
    """As `require_finite`, for each of several numbers."""
    array = np.asarray(values, dtype=float)
    if not ((array >= _LEAST[sign]) & (np.abs(array) <= most)).all():  # also for NaN
        given = array if isinstance(values, np.ndarray) else brief(values)
        _refuse(f"{name} {given}", sign, most if np.isfinite(array).all() else math.inf)


def _refuse(given: str, sign: Sign, most: float) -> NoReturn:
    wanted = f"finite and {sign}" if sign else "finite"
    raise ValueError(
        f"{given} must be {wanted}" + (f", at most {most:g}{'' if sign else ' in size'}" if math.isfinite(most) else "")
    )


def require_vector(name: str, values: tuple[float, ...], length: int, most: float = LARGEST) -> None:
    """Raise ValueError if these are not so many finite numbers, none larger than ``most``."""
    if len(values) != length or not all(math.isfinite(value) for value in values):
        raise ValueError(f"{name} {brief(values)} must be {length} finite numbers")
    require_all_finite(name, values, most=most)


def require_shape(name: str, values: ArrayLike, shape: tuple[int, ...]) -> None:
    """Raise ValueError if an array does not have the shape: compiled code reads it without looking."""
    if np.shape(values) != shape:
        raise ValueError(f"{name} has shape {np.shape(values)}; it must have {shape}")


def float_vector(name: str, given: Any, length: int, sign: Sign = "", most: float = LARGEST) -> NDArray[np.float64]:
    """A new array of so many floats that have the sign; ValueError for others. ``most`` infinite allows infinity."""
    array = float_array(name, given)
    require_shape(name, array, (length,))
    require_all_finite(name, array, sign, most)
    return array


def float_rows(width: int, batch: int | None = None, **given: ArrayLike) -> list[NDArray[np.float64]]:
    """Contiguous arrays of floats of the named values, all ``(batch, width)``, the batch being that of the first.

    Raises:
        ValueError: if one has another shape, or is no array of numbers.
    """
    arrays = []
    for name, values in given.items():
        arrays.append(np.ascontiguousarray(floats(name, values)))
        batch = len(arrays[0]) if batch is None and arrays[0].ndim else batch
        require_shape(name, arrays[-1], (batch or 0, width))
    return arrays


def require_mask(name: str, mask: Any, count: int) -> None:
    """Raise ValueError unless this is an array of so many truth values: numbers would choose, or count, otherwise."""
    require_shape(name, mask, (count,))
    if np.asarray(mask).dtype != np.bool_:
        raise ValueError(f"{name} must be an array of truth values, not of {np.asarray(mask).dtype}")


def checked_count(name: str, value: Any, hint: str = "", least: int = 1) -> int:
    """A whole number of at least 1, or of another ``least``; ValueError for anything else."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | np.integer) or value < least:
        raise ValueError(f"{name} {value!r:.80} must be a whole number of at least {least}{hint}")
    return int(value)


def require_choice(name: str, value: object, allowed: Iterable[object]) -> None:
    """Raise ValueError if an option is none of those allowed."""
    choices = list(allowed)
    if not any(isinstance(value, type(choice)) and value == choice for choice in choices):
        raise ValueError(f"{name} {value!r:.80} must be one of {', '.join(map(repr, choices))}")


def brief(value: object, longest: int = 120) -> str:
    """A value as Python writes it, in one line, cut after so many characters, for messages."""
    text = " ".join(repr(value).split())
    return text if len(text) <= longest else f"{text[:longest]}..."


class UnknownName(ValueError, TypeError):
    """A name that is not known: an unexpected keyword (a TypeError) with a bad value (a ValueError)."""


def refuse_unknown(given: Iterable[str], known: Iterable[str], what: str) -> None:
    """Raise `UnknownName` if a given name is not known, with the nearest known name."""
    names = sorted(known)
    for name in given:
        if name not in names:
            near = difflib.get_close_matches(str(name)[:80], names, n=1, cutoff=0.5)
            hint = f'; did you mean "{near[0]}"?' if near else ""
            raise UnknownName(f'unknown {what} "{name!s:.80}"{hint} (known: {", ".join(names) or "none"})')
