"""Ctrl-C while compiled code runs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


def was_interrupted(error: BaseException | None) -> bool:
    """Whether an exception comes from a KeyboardInterrupt."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


@contextmanager
def plain_interrupts() -> Iterator[None]:
    """Make a KeyboardInterrupt of the SystemError that comes out of a compiled function when Ctrl-C meets its call."""
    try:
        yield
    except SystemError as error:
        if was_interrupted(error):
            raise KeyboardInterrupt from None
        raise
