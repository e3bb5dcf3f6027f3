"""What commands do with scores: run them with a progress bar, write files, print tables."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Literal

import tyro

from agents.compile_ahead import CompileAhead
from agents.console import COMPILING, INTERRUPTED, catch_interrupt, note, progress_bar, say, show_compiling
from agents.evaluation.benchmark import Benchmark
from agents.evaluation.leaderboard import TaskResult
from agents.evaluation.scoreboard import Scoreboard
from agents.report.page import write_report
from agents.report.results_file import Results
from planners.files import write_json


@dataclass(frozen=True, kw_only=True)
class ScoreOutputs:
    """What becomes of scores: the options of `planarm benchmark` and `planarm evaluate` about their output."""

    json: Path | None = None
    """Write every episode, with versions, seeds and replays, to this file; planarm report makes pages and figures of
    it."""
    report: Path | None = None
    """Write one HTML file in which every number leads to the episodes behind it, and these to their replays."""
    replays: int | None = None
    """Number of seeds of each task whose episodes are recorded for --json and --report, of every policy: first the
    first ones, then the worst of each policy. 8 if left out, 0 for none; scores and timings do not depend on it."""
    format: Literal["markdown", "csv"] | None = None
    """How to print: tables in Markdown, or one number a line as CSV. By default tables as wide as the terminal, and
    Markdown where the output is no terminal."""
    wide: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Print every column, however narrow the terminal is."""


def run_and_print(benchmark: Benchmark, outputs: ScoreOutputs, opening: str = "") -> int:
    """Run a benchmark with a progress bar, print the tables of each task when it is finished, write files.

    ``opening`` is a line above the first table. What fails on the way is raised when all that was finished before is
    printed and written.

    Returns:
        The exit code.
    """
    started, board = datetime.now(UTC), benchmark.board
    tables, failure, code = _Tables(outputs, opening), None, 0
    try:
        code = run_with_bar(benchmark, tables.show, record=outputs.json is not None or outputs.report is not None)
    except Exception as error:
        if tables.error is not None or not board.evaluations:
            raise
        failure = error
    if code or failure is not None:
        note(f"{'interrupted' if code else 'failed'}: this is all that was finished", "yellow")
    for result in board.results:
        tables.show(result)
    origin = {"command": shlex.join(["planarm", *sys.argv[1:]]), "started": started.isoformat("T", "seconds")}
    document = {**origin, **board.document()}
    if outputs.json is not None:
        write_json(outputs.json, document)
        note(f"wrote {outputs.json}")
    if outputs.report is not None and board.evaluations:
        write_report([("results", Results.of(document))], outputs.report)
        note(f"wrote {outputs.report}")
    if tables.error is not None:
        raise tables.error
    if outputs.format == "csv":
        print(board.csv(), end="")
    if failure is not None:
        raise failure
    return code


class _Tables:
    """The tables on stdout, task by task; `error` is why it takes no more."""

    def __init__(self, outputs: ScoreOutputs, opening: str) -> None:
        self._outputs, self._opening, self._shown, self._explained = outputs, opening, set[int](), set[str]()
        self.error: OSError | SystemExit | None = None

    def show(self, result: TaskResult) -> None:
        """Print the tables of a task, once, and what is assumed about its policies."""
        if id(result) in self._shown:
            return
        self._shown.add(id(result))
        for assumption in dict.fromkeys(result.assumptions):
            note(f"{assumption}, such as --settings control_mode=jerk", "yellow")
        opening, self._opening = self._opening, ""
        if opening and self._outputs.format == "csv":
            note(opening)
        if self._outputs.format == "csv" or self.error is not None:
            return
        try:
            if opening:
                say(f"{opening}\n")
            markdown = self._outputs.format == "markdown"
            Scoreboard([result]).show(markdown=markdown, wide=self._outputs.wide, explained=self._explained)
            sys.stdout.flush()
        except (
            OSError,
            SystemExit,
        ) as error:  # rich exits where the reader has stopped; files are written nevertheless
            self.error = error
            if self._outputs.json is None and self._outputs.report is None:
                raise


def run_with_bar(benchmark: Benchmark, show: Callable[[TaskResult], object], *, record: bool) -> int:
    """Run a benchmark until all is done, or Ctrl-C or SIGTERM stops it; the exit code.

    ``show`` is called with the results of each task when it is finished.
    """
    with (
        suppress(KeyboardInterrupt),
        catch_interrupt(at_once=True) as interrupts,
        progress_bar("episodes") as bar,
        show_compiling(bar) as begin,
    ):
        total = benchmark.total_episodes + (benchmark.total_replays if record else 0)
        task = bar.add_task("", total=total)

        def check(ended: int = 0) -> None:
            if interrupts:  # one that fell into a callback from C was printed there and lost
                raise KeyboardInterrupt

        def advance(ended: int) -> None:
            check()
            bar.advance(task, ended)

        def print_tables(result: TaskResult) -> None:
            bar.stop()  # it would take the tables for lines of its own, on stderr
            show(result)
            bar.start()

        benchmark.check(replays=record)
        jobs = benchmark.jobs(check) if benchmark.workers is None else []  # workers compile what they need
        with CompileAhead(jobs, COMPILING.advance) as ahead:
            benchmark.fill(begin, advance, print_tables, ahead)
        check()
        if record:
            benchmark.record(begin, advance)
            check()
        return 0
    return (interrupts or [INTERRUPTED])[0]
