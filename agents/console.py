"""What commands share beside tables: lines, notes on stderr, a progress bar, Ctrl-C."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from time import monotonic
from types import FrameType
from typing import Any

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    Task,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Column
from rich.text import Text

from planners.interrupts import was_interrupted

_REST = 50  # characters of a progress bar beside its description
INTERRUPTED = 130  # exit code of a command that Ctrl-C ended; 143 where SIGTERM did


def say(text: str) -> None:
    """Print a result to stdout; only a terminal wraps it."""
    console = Console()
    console.print(Text(text), soft_wrap=not console.is_terminal)


def note(text: str, style: str = "") -> None:
    """Print something about the run, such as a file that was written, to stderr, in one line."""
    Console(stderr=True).print(Text(text, style=style), soft_wrap=True)


class _Description(TextColumn):
    """What a progress bar does, cut so that the rest of the line has room."""

    def __init__(self, width: int) -> None:
        super().__init__("{task.description}", markup=False)
        self._width = max(_REST // 4, width)

    def render(self, task: Task) -> Text:
        text = super().render(task)
        text.truncate(self._width, overflow="ellipsis")
        return text


def progress_bar(unit: str, *, transient: bool = True, more: str = "") -> Progress:
    """A progress bar on stderr, drawn only where that is a terminal; a ``transient`` one disappears at the end.

    ``unit`` is what it counts, such as ``episodes``, and ``more`` the end of the line; both may use a task's fields, as
    in ``"steps, {task.fields[rate]}/s"``.
    """
    console = Console(stderr=True)
    columns = (
        _Description(console.width - _REST),
        BarColumn(),
        MofNCompleteColumn(table_column=Column(no_wrap=True)),
        TextColumn(unit),
        TimeElapsedColumn(table_column=Column(no_wrap=True)),
        TimeRemainingColumn(table_column=Column(no_wrap=True)),
        TextColumn(more),
    )
    return Progress(*columns, console=console, transient=transient, disable=not console.is_terminal)


class Compiling:
    """What is shown of compilation: a line at the first function and every ten seconds, or text in a progress bar.

    Attributes:
        functions: how many were compiled, also in other processes.
        show: shows a text in a progress bar; None without one.
    """

    def __init__(self) -> None:
        self.show: Callable[[str], object] | None = None
        self.begin()

    def begin(self) -> None:
        """Count from nothing: another command is run."""
        self.functions, self._said = 0, -INTERVAL

    def advance(self) -> None:
        """One more function is being compiled."""
        self.functions += 1
        many = f": {self.functions} functions" if self.functions > 1 else ""
        if self.show is not None:
            self.show(f"compiling, once{many}")
        elif monotonic() - self._said >= INTERVAL:
            self._said = monotonic()
            note(f"compiling, once{many or '; later runs load it'}")


INTERVAL = 10.0  # s between two lines about compilation
COMPILING = Compiling()
"""Of the command that is run."""


@contextmanager
def note_compiling() -> Iterator[None]:
    """Show on stderr that something is being compiled, and how far that is; nothing if all is compiled already."""
    COMPILING.begin()
    with listen_to_compiler(COMPILING.advance):
        yield


@contextmanager
def show_compiling(bar: Progress) -> Iterator[Callable[[str], None]]:
    """Show compilation in a progress bar that is drawn; yields what sets the description of its task."""
    described = ""

    def begin(description: str) -> None:
        nonlocal described
        described = description
        show(description)

    def show(text: str) -> None:
        for task in bar.task_ids:
            bar.update(task, description=text)

    COMPILING.show = None if bar.disable else lambda text: show(f"{described}: {text}" if described else text)
    try:
        yield begin
    finally:
        COMPILING.show = None


@contextmanager
def listen_to_compiler(begins: Callable[[], object]) -> Iterator[None]:
    """Call a function whenever Numba begins to compile one that is not in its cache, in this process."""
    event: Any = import_module("numba.core.event")

    class Listener(event.Listener):  # type: ignore[misc]
        def on_start(self, event: object) -> None:
            begins()

        def on_end(self, event: object) -> None:
            """Nothing to do."""

    listener = Listener()
    event.register("numba:compile", listener)
    try:
        yield
    finally:
        event.unregister("numba:compile", listener)


@contextmanager
def catch_interrupt(*, at_once: bool) -> Iterator[list[int]]:
    """Append its exit code to the yielded list at each Ctrl-C; the second, with ``at_once`` any, raises.

    That is a KeyboardInterrupt; one that leaves the block has the exit code with it (`exit_code_of`). The request to
    end that ``kill`` and schedulers send, SIGTERM, is taken for a Ctrl-C, with the exit code 143 instead of 130. An
    interrupt that meets Numba's conversion of results, which cannot bear an exception, waits for the end of the call;
    one that comes out of compiled code as a SystemError, or out of the compiler as a RuntimeError, is a
    KeyboardInterrupt here too.
    """
    caught: list[int] = []

    def handle(signal_number: int, frame: FrameType | None) -> None:
        caught.append(128 + signal_number)
        if at_once or len(caught) > 1:
            _interrupt(frame)

    before = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield caught
    except KeyboardInterrupt as interrupt:
        interrupt.args = interrupt.args or tuple(caught[:1])
        raise
    except (SystemError, RuntimeError) as error:
        if was_interrupted(error) or (caught and at_once):
            raise KeyboardInterrupt(*caught[:1]) from None
        raise
    finally:
        if caught:
            sys.setprofile(None)  # of an interrupt that is still waiting
        for number, handler in before.items():
            signal.signal(number, handler)


def exit_code_of(interrupt: KeyboardInterrupt) -> int:
    """The exit code of a command that an interrupt ended: 143 for SIGTERM that was met by `catch_interrupt`."""
    return next((code for code in interrupt.args if isinstance(code, int)), INTERRUPTED)


def _interrupt(frame: FrameType | None) -> None:
    """Raise a KeyboardInterrupt in a frame of Python, now or as soon as there is one that can bear it."""
    if _bears_exceptions(frame):
        raise KeyboardInterrupt

    def later(current: FrameType, event: str, argument: object) -> None:
        if _bears_exceptions(current):
            sys.setprofile(None)
            raise KeyboardInterrupt

    sys.setprofile(later)


def _bears_exceptions(frame: FrameType | None) -> bool:
    """Whether a frame is not called by Numba's conversion of results, which dies of an exception, or by LLVM, which
    drops it.

    The conversion unpickles the class of a named tuple and calls its ``__new__``, which is compiled from a string.
    """
    if frame is None:
        return True
    file = frame.f_code.co_filename
    here = file == __file__  # the handler's own frames, above the one that it interrupts
    if here or file.startswith("<") or file.endswith(os.path.join("numba", "core", "serialize.py")):
        return False
    while frame is not None:
        if frame.f_code.co_name == "_raw_object_cache_notify":
            return False
        frame = frame.f_back
    return True
