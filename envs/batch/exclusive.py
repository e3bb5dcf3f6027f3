"""Methods that only one thread runs at a time."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, Concatenate, NoReturn, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")
Owner = TypeVar("Owner", bound=Any)


def exclusive(method: Callable[Concatenate[Owner, P], R]) -> Callable[Concatenate[Owner, P], R]:
    """A method that refuses a second caller while one of the exclusive methods of its object runs.

    Two threads cannot advance one physics, and neither can a signal handler while it is being advanced. The object has
    a `threading.Lock` named ``_in_use``.
    """

    @wraps(method)
    def alone(self: Owner, /, *args: P.args, **kwargs: P.kwargs) -> R:
        if self._in_use.locked():
            refuse_second(method.__name__, self)
        # In the rare moment in which two threads get here at once, the second waits for the first.
        with self._in_use:
            return method(self, *args, **kwargs)

    return alone


def refuse_second(call: str, owner: object) -> NoReturn:
    """Raise the RuntimeError of a caller who comes while the lock of an object is taken."""
    raise RuntimeError(
        f"{call}() while another thread, or the call that was interrupted, is using this {type(owner).__name__}; "
        "give every thread its own environment (copy.deepcopy makes one), or let them take turns"
    )
