"""A batch in slices, on threads that no interrupt leaves running; and calls that only one thread makes at a time."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import wraps
from itertools import pairwise
from threading import Lock
from typing import Any, Concatenate, NoReturn, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

_ENVS_PER_THREAD = 32  # below this a second thread costs more than it brings

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


class Workers:
    """Runs compiled work on a batch, in slices on several threads if it is large.

    Args:
        work: advances environments ``first`` to ``last - 1``.
        count: number of environments.
        needs: what must not be freed while a thread is at work.
    """

    def __init__(self, work: Callable[[int, int], None], count: int, needs: object) -> None:
        threads = max(1, min(os.cpu_count() or 1, count // _ENVS_PER_THREAD))
        self._work, self._needs = work, needs
        self._slices = list(pairwise(np.linspace(0, count, threads + 1).astype(int).tolist()))
        self._turns = [Lock() for _ in self._slices]
        self._ticket: object | None = None
        self._pool: tuple[int, ThreadPoolExecutor] | None = None

    @property
    def threads(self) -> int:
        """Number of slices."""
        return len(self._slices)

    def run(self, resting: NDArray[np.bool_] | None = None) -> None:
        """Work on all that does not rest. When it returns or raises, also by an interrupt, no thread is at work."""
        self.settle()
        ticket = self._ticket = object()
        try:
            pool = self._executor()
            jobs = [
                pool.submit(self._slice, ticket, turn, *ends, resting)
                for turn, ends in zip(self._turns, self._slices, strict=True)
            ]
            for job in jobs:
                job.result()
        finally:
            self.settle()

    def settle(self) -> None:
        """Let no slice begin any more, and wait for those that are at work.

        Whoever touches the batch calls this first: a second interrupt may have ended the wait of the last run.
        """
        self._ticket = None
        for turn in self._turns:
            with turn:
                pass

    def close(self) -> None:
        """Stop the threads; may be called twice."""
        self.settle()
        if self._pool is not None:
            self._pool[1].shutdown(wait=False)
            self._pool = None

    def work_without(self, resting: NDArray[np.bool_], first: int, last: int) -> None:
        """Work on what does not rest of a slice, on this thread."""
        edges = (first + 1 + np.flatnonzero(np.diff(resting[first:last]))).tolist()
        for begin, end in pairwise([first, *edges, last]):
            if not resting[begin]:
                self._work(begin, end)

    def _slice(self, ticket: object, turn: Lock, first: int, last: int, resting: NDArray[np.bool_] | None) -> None:
        with turn:
            if self._ticket is not ticket:
                return
            if resting is None:
                self._work(first, last)
            else:
                self.work_without(resting, first, last)

    def _executor(self) -> ThreadPoolExecutor:
        # Threads do not survive a fork, so a pool belongs to the process that made it.
        if self._pool is None or self._pool[0] != os.getpid():
            self._pool = (os.getpid(), ThreadPoolExecutor(len(self._slices), thread_name_prefix="planarm"))
        return self._pool[1]
