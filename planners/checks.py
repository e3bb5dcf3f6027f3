"""Checks of given numbers, with errors that say what is allowed."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Literal

Sign = Literal["", "positive", "not negative"]
_LEAST: dict[Sign, float] = {"": -math.inf, "positive": math.ulp(0.0), "not negative": 0.0}


def require_finite(name: str, value: float, unit: str = "", sign: Sign = "") -> None:
    """Raise ValueError if a number is not finite or does not have the sign."""
    if not (math.isfinite(value) and value >= _LEAST[sign]):
        given, wanted = f"{value} {unit}".rstrip(), f"finite and {sign}" if sign else "finite"
        raise ValueError(f"{name} {given} must be {wanted}")


def require_vector(name: str, values: tuple[float, ...], length: int) -> None:
    """Raise ValueError if these are not so many finite numbers."""
    if len(values) != length or not all(math.isfinite(value) for value in values):
        raise ValueError(f"{name} {values} must be {length} finite numbers")


def require_choice(name: str, value: object, allowed: Iterable[object]) -> None:
    """Raise ValueError if an option is none of those allowed."""
    if value not in allowed:
        raise ValueError(f"{name} {value!r} must be one of {', '.join(map(repr, allowed))}")
