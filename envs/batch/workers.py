"""A batch in slices, on threads that no interrupt leaves running; and calls that only one thread makes at a time."""

from __future__ import annotations

import os
import weakref
from _thread import start_new_thread
from collections.abc import Callable
from functools import partial, wraps
from itertools import pairwise
from queue import SimpleQueue
from threading import Lock
from typing import Any, Concatenate, NoReturn, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

_ENVS_PER_THREAD = 32  # below this a second thread costs more than it brings

_Jobs = SimpleQueue["partial[None] | None"]
_Results = SimpleQueue["BaseException | None"]

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

    The threads are plain ones behind queues written in C: an interrupt in `concurrent.futures` can leave one of its
    locks taken for ever.

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
        self._started: tuple[int, weakref.finalize[[list[_Jobs]], Workers], list[_Jobs]] | None = None

    @property
    def threads(self) -> int:
        """Number of slices."""
        return len(self._slices)

    def run(self, resting: NDArray[np.bool_] | None = None) -> None:
        """Work on all that does not rest. When it returns or raises, also by an interrupt, no thread is at work."""
        self.settle()
        ticket, results = object(), _Results()
        self._ticket = ticket
        try:
            for jobs, turn, ends in zip(self._threads(), self._turns, self._slices, strict=True):
                jobs.put(partial(self._slice, ticket, results, turn, *ends, resting))
            errors = [results.get() for _ in self._slices]
        finally:
            self.settle()
        for error in errors:
            if error is not None:
                raise error

    def settle(self) -> None:
        """Let no slice begin any more, and wait for those that are at work.

        Call this before touching the batch: a second interrupt may have ended the wait of the last run.
        """
        self._ticket = None
        for turn in self._turns:
            with turn:
                pass

    def close(self) -> None:
        """Stop the threads; may be called twice."""
        self.settle()
        if self._started is not None:
            self._started[1]()
            self._started = None

    def work_without(self, resting: NDArray[np.bool_], first: int, last: int) -> None:
        """Work on what does not rest of a slice, on this thread."""
        edges = (first + 1 + np.flatnonzero(np.diff(resting[first:last]))).tolist()
        for begin, end in pairwise([first, *edges, last]):
            if not resting[begin]:
                self._work(begin, end)

    def _slice(
        self,
        ticket: object,
        results: _Results,
        turn: Lock,
        first: int,
        last: int,
        resting: NDArray[np.bool_] | None,
    ) -> None:
        with turn:
            try:
                if self._ticket is ticket:
                    if resting is None:
                        self._work(first, last)
                    else:
                        self.work_without(resting, first, last)
                results.put(None)
            except BaseException as error:
                results.put(error)

    def _threads(self) -> list[_Jobs]:
        """A queue of jobs for each thread, which belongs to the process that began it: it does not survive a fork."""
        if self._started is None or self._started[0] != os.getpid():
            queues = [_Jobs() for _ in self._slices]
            for jobs in queues:
                start_new_thread(_serve, (jobs,))
            self._started = os.getpid(), weakref.finalize(self, _stop, queues), queues
        return self._started[2]


def _serve(jobs: _Jobs) -> None:
    """Do jobs until there is a None."""
    while True:
        job = jobs.get()
        if job is None:
            return
        job()
        del job  # with its batch


def _stop(queues: list[_Jobs]) -> None:
    for jobs in queues:
        jobs.put(None)
