"""`planarm paper-excavator`: the excavator paper's simulation again, with numbers and beside other controllers.

"A Study on Motion Control and Kinematics Analysis of Articulated Manipulator Attachment for Excavator" (2019) shows how
joints 1 and 2 follow a motion with payloads of 2, 4, 6, 8 and 10 %, in figures without a number. Machine, motion and
gains are stated here; the paper's law is :class:`planners.control.AdaptiveComputedTorque`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from rich import box
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from agents.papers.excavator.facts import facts
from agents.papers.excavator.figures import draw
from agents.papers.excavator.runs import (
    CASES,
    CONTROLLERS,
    ROUGH_PAYLOADS,
    PayloadRow,
    Trial,
    payload_rows,
    rough_rows,
)
from agents.papers.report import ReportOptions, report_console, write_report
from planners.excavator import EXCAVATOR
from planners.excavator.controllers import ADAPTIVE

Cell = Callable[[PayloadRow], str]


@dataclass(frozen=True)
class PaperExcavatorOptions(ReportOptions):
    """What to carry, and where to write the excavator paper's results, its figures 4 to 8 among them."""

    payloads: tuple[float, ...] = (0.0, 2.0, 4.0, 6.0, 8.0, 10.0)
    """Payloads, % of the rated load."""
    rated_load: float = EXCAVATOR.payload.rated_load
    """What the percentages are of, kg; the paper's conclusion says 3.5 t."""
    cycles: int = 3
    """How many times the motion is done; the first and the last are told."""
    rate: float = 200.0
    """Samples of the controllers per second."""

    def trial(self) -> Trial:
        """What all runs have in common.

        Raises:
            ValueError: if an option is out of range.
        """
        if not self.payloads or not all(math.isfinite(value) and value >= 0.0 for value in self.payloads):
            raise ValueError(f"payloads {self.payloads} must be one percentage or more, none negative")
        for name in ("rated_load", "cycles", "rate"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise ValueError(f"{name} {getattr(self, name)} must be positive")
        machine = replace(EXCAVATOR, payload=replace(EXCAVATOR.payload, rated_load=self.rated_load))
        return Trial(machine=machine, cycles=self.cycles, period=1.0 / self.rate)


def run(options: PaperExcavatorOptions) -> None:
    """Regenerate the paper's results and, when asked for, its figures. Where the output is no terminal, it is Markdown.

    Raises:
        ModuleNotFoundError: if a plot is asked for and matplotlib is missing.
        ValueError: if an option is out of range.
    """
    trial = options.trial()
    payloads, rough = _run_with_bar(trial, options.payloads)
    known = list(facts(payloads, rough))
    console = report_console()
    for title, table in (*_payload_tables(payloads, trial.cycles), *_rough_tables(rough)):
        _print_table(console, title, table)
    for fact in known:
        console.print(f"- {fact.statement}", highlight=False, soft_wrap=not console.is_terminal)
    document: dict[str, Sequence[Any]] = {"payloads": payloads, "rough": rough, "facts": known}

    def figure(file_format: str, dpi: int) -> bytes:
        return draw(trial, options.payloads, file_format, dpi)

    write_report(options, {name: [asdict(row) for row in rows] for name, rows in document.items()}, figure)


def _run_with_bar(trial: Trial, percents: Sequence[float]) -> tuple[list[PayloadRow], list[PayloadRow]]:
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("cycles", total=2 * trial.cycles * len(CONTROLLERS))

        def progress() -> None:
            bar.advance(task)

        return list(payload_rows(trial, percents, progress)), list(rough_rows(trial, progress))


def _payload_tables(rows: Sequence[PayloadRow], cycles: int) -> list[tuple[str, Table]]:
    both = f"cycle 1 / cycle {cycles}"
    learning = {entry.title for entry in CONTROLLERS if entry.controller in ADAPTIVE}
    cells: list[tuple[str, Cell]] = [
        (f"RMS error of the five joints, deg: {both}", _joints),
        (f"Tip, mm: RMS and peak in cycle 1 / RMS and peak in cycle {cycles}", _tip),
        (f"Joints 1 and 2, RMS error in cycle {cycles}: angles, deg / velocities, deg/s", _first_two),
        (f"Estimated mass after cycle 1 / largest error in cycle {cycles}, kg", _mass),
    ]
    return [
        (title, _table(rows if cell is not _mass else [row for row in rows if row.controller in learning], cell))
        for title, cell in cells
    ]


def _table(rows: Sequence[PayloadRow], cell: Cell) -> Table:
    """Controllers by payloads."""
    table = Table("controller")
    for percent, mass in dict.fromkeys((row.percent, row.mass) for row in rows):
        table.add_column(f"{percent:g} %, {mass:g} kg", justify="right")
    for title in dict.fromkeys(row.controller for row in rows):
        table.add_row(title, *(cell(row) for row in rows if row.controller == title))
    return table


def _rough_tables(rows: Sequence[PayloadRow]) -> list[tuple[str, Table]]:
    """Controllers by what the arm differs in, for each of two payloads."""
    tables = []
    for percent in ROUGH_PAYLOADS:
        mass = next(row.mass for row in rows if row.percent == percent)
        table = Table("controller")
        for case in CASES:
            table.add_column(case.title, justify="right")
        for entry in CONTROLLERS:
            chosen = [row for row in rows if (row.controller, row.percent) == (entry.title, percent)]
            table.add_row(entry.title, *(f"{np.degrees(row.last.joints):.4f} / {_mm(row.last.tip)}" for row in chosen))
        tables.append(
            (f"What the controller does not know, {mass:g} kg: joints, deg / tip, mm, RMS, last cycle", table)
        )
    return tables


def _joints(row: PayloadRow) -> str:
    return f"{np.degrees(row.first.joints):.3f} / {np.degrees(row.last.joints):.4f}"


def _tip(row: PayloadRow) -> str:
    return " / ".join(f"{_mm(cycle.tip)} {_mm(cycle.tip_peak)}" for cycle in (row.first, row.last))


def _first_two(row: PayloadRow) -> str:
    position, velocity = np.degrees(row.last.position[:2]), np.degrees(row.last.velocity[:2])
    return f"{position[0]:.4f} {position[1]:.4f} / {velocity[0]:.3f} {velocity[1]:.3f}"


def _mass(row: PayloadRow) -> str:
    return f"{row.first.mass_estimate:.1f} / {row.last.mass_error:.1f}"


def _mm(length: float) -> str:
    return f"{1e3 * length:.1f}"


def _print_table(console: Console, title: str, table: Table) -> None:
    if console.is_terminal:
        console.print(f"[bold]{title}[/bold]", table, "", sep="\n", highlight=False)
        return
    table.box = box.MARKDOWN
    wide = Console(file=console.file, width=1000)  # a line of Markdown must not be broken
    wide.print(f"### {title}", table, "", sep="\n")
