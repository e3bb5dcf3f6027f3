"""Compiling on two processors: a second process compiles what comes next, into the cache from which this one loads.

Numba compiles one function at a time in a process. The second process starts when this one meets the first function
that is not in the cache, so that it costs nothing once everything is compiled. It stands still while times are
measured, and ends with this one, however that ends.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from queue import SimpleQueue
from threading import Condition, Thread
from typing import Any, Literal

from agents.console import listen_to_compiler

_SERVE = "import json, sys; sys.path[:] = json.loads(sys.argv[1]); import agents.compile_ahead as it; it.serve()"
_WAIT = 0.1  # s between two looks at Ctrl-C while the second process finishes a job


@dataclass(eq=False)
class Job:
    """Something that is run in order to compile it.

    Attributes:
        group: jobs of a group are needed together.
        run: runs it in this process.
        text: what `serve` calls in the second process, ``module:function argument``; None if only this one can.
        state: who runs it.
    """

    group: str
    run: Callable[[], object]
    text: str | None = None
    state: Literal["open", "here", "there", "done"] = "open"


class CompileAhead:
    """Jobs that this process and a second one share."""

    def __init__(self, jobs: Sequence[Job], compiled: Callable[[], object] = lambda: None) -> None:
        """Of ``jobs`` in the order in which they are needed; ``compiled`` is called for each function compiled there.

        It is called from another thread.
        """
        self._jobs, self._compiled = list(jobs), compiled
        self._changed = Condition()
        self._process: subprocess.Popen[str] | None = None
        self._may_start = processors() > 1 and os.name == "posix" and bool(sys.executable)

    def prepare(self, group: str, progress: Callable[[int], object] = lambda ended: None) -> None:
        """Run all jobs of a group in this process, first those that the second one has not begun.

        ``progress`` is called now and then with 0; what it raises ends the waiting.
        """
        jobs = [job for job in self._jobs if job.group == group]
        with listen_to_compiler(self._start):
            while job := self._take(jobs, "here"):
                job.run()
            for job in jobs:
                if job.state == "there":
                    with self._changed:
                        while job.state == "there":
                            self._changed.wait(_WAIT)
                            progress(0)
                if job.state != "here":
                    job.run()

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Stop the second process for as long as times are measured."""
        process = self._process
        if process is None or process.poll() is not None:
            yield
            return
        process.send_signal(signal.SIGSTOP)
        try:
            yield
        finally:
            process.send_signal(signal.SIGCONT)

    def close(self) -> None:
        """End the second process."""
        with self._changed:
            self._may_start = False
            process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()

    def __enter__(self) -> CompileAhead:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _take(self, jobs: Sequence[Job], where: Literal["here", "there"]) -> Job | None:
        """The next job that nobody has begun."""
        with self._changed:
            able = (job for job in jobs if job.state == "open" and (where == "here" or job.text is not None))
            if (job := next(able, None)) is not None:
                job.state = where
            return job

    def _start(self) -> None:
        """Start the second process, once; it begins with the groups that this one has not come to."""
        with self._changed:
            if not self._may_start:
                return
            self._may_start = False
            begun = {job.group for job in self._jobs if job.state == "here"}
            jobs = sorted((job for job in self._jobs if job.text is not None), key=lambda job: job.group in begun)
            if not any(job.state == "open" for job in jobs):
                return
            with suppress(OSError):  # without one, this process compiles everything
                self._process = process = subprocess.Popen(
                    [sys.executable, "-c", _SERVE, json.dumps(sys.path)],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.DEVNULL,
                    text=True,
                    process_group=0,  # Ctrl-C is for this process, which ends the other
                )
                Thread(target=self._feed, args=(process, jobs), daemon=True).start()

    def _feed(self, process: subprocess.Popen[str], jobs: Sequence[Job]) -> None:
        """Give the second process one job after the other."""
        assert process.stdin is not None
        assert process.stdout is not None
        with process.stdin, process.stdout, suppress(OSError):
            while job := self._take(jobs, "there"):
                try:
                    print(job.text, file=process.stdin, flush=True)
                    for line in iter(process.stdout.readline, ""):
                        if line == "done\n":
                            break
                        self._compiled()
                    else:
                        return
                finally:
                    with self._changed:
                        job.state = "done"
                        self._changed.notify_all()


def processors() -> int:
    """How many processors this process may use; one if ``PLANARM_PROCESSES`` is 1, which keeps it to itself."""
    affinity = getattr(os, "sched_getaffinity", None)
    alone = os.environ.get("PLANARM_PROCESSES") == "1"
    return 1 if alone else len(affinity(0)) if affinity else os.cpu_count() or 1


def serve() -> None:
    """In the second process: call what each line of stdin names; a line on stdout for each compiled function.

    What a job raises, it raises in the first process too. The end of stdin is the end of the first process.
    """
    lines: SimpleQueue[str] = SimpleQueue()

    def read() -> None:
        for line in sys.stdin:
            lines.put(line)
        os._exit(0)

    def reply(text: str) -> None:
        with suppress(OSError):
            print(text, flush=True)

    Thread(target=read, daemon=True).start()
    with listen_to_compiler(lambda: reply("compiled")):
        while True:
            function, _, argument = lines.get().rstrip("\n").partition(" ")
            module, _, name = function.partition(":")
            with suppress(Exception):
                call: Any = getattr(import_module(module), name)
                call(argument)
            reply("done")
