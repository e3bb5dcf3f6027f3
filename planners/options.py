"""Checks the options of a planner's variant against the types that its signature declares, in one place for all."""

from __future__ import annotations

import inspect
import math
import types
from collections.abc import Callable, Mapping
from functools import cache
from numbers import Integral
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np

from planners.checks import LARGEST, is_number

WORDS = {float: "a number", int: "an integer", bool: "True or False", type(None): "None"}


def checked_options(function: Callable[..., Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """The options, with NumPy's numbers as Python's.

    Raises:
        ValueError: if the value of an option is not of the type that the function declares; unknown names are left to
            the call.
    """
    hints = _hints(function)
    return {name: _checked(name, value, hints[name]) if name in hints else value for name, value in given.items()}


def _hints(function: Callable[..., Any]) -> dict[str, Any]:
    """The types that a function declares; none of a user's own whose types cannot be found."""
    named = function if inspect.isroutine(function) else getattr(function, "func", type(function).__call__)
    try:
        return _declared(named)
    except (NameError, TypeError):
        return {}


@cache
def _declared(function: Callable[..., Any]) -> dict[str, Any]:
    return get_type_hints(function)


def _checked(name: str, value: Any, hint: Any) -> Any:
    kinds = get_args(hint) if get_origin(hint) in (Union, types.UnionType) else (hint,)
    for kind in kinds:
        if _fits(value, kind):
            if kind in (float, int) and LARGEST < abs(float(value)) < math.inf:
                raise ValueError(f"option {name} {value} must be at most {LARGEST:g}")
            return kind(value) if kind in (float, int, bool) else value
    raise ValueError(f"option {name} {value!r:.80} must be {' or '.join(map(_said, kinds))}")


def _fits(value: Any, kind: Any) -> bool:
    if kind is float:
        return is_number(value)
    if kind is bool:
        return isinstance(value, bool | np.bool_)
    if kind is int:
        return isinstance(value, Integral) and is_number(value)
    if get_origin(kind) is Literal:
        return isinstance(value, str) and value in get_args(kind)
    if get_origin(kind) is tuple:
        parts = get_args(kind)
        return isinstance(value, tuple) and len(value) == len(parts) and all(map(_fits, value, parts))
    return kind is Any or isinstance(value, get_origin(kind) or kind)


def _said(kind: Any) -> str:
    if get_origin(kind) is Literal:
        return f"one of {', '.join(map(repr, get_args(kind)))}"
    if get_origin(kind) is tuple:
        return f"({', '.join(map(_said, get_args(kind)))})"
    name = getattr(get_origin(kind) or kind, "__name__", str(kind))
    return WORDS.get(kind, f"of type {name}")
