"""`planarm paper-excavator`: the excavator paper's simulation, with numbers and with baselines.

"A Study on Motion Control and Kinematics Analysis of Articulated Manipulator Attachment for Excavator" (2019) shows how
joints 1 and 2 follow a motion with payloads of 2, 4, 6, 8 and 10 %, in figures without a number. Machine, motion and
gains are stated here; the paper's law is :class:`planners.control.AdaptiveComputedTorque`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from agents.console import progress_bar
from agents.papers.excavator.facts import facts
from agents.papers.excavator.figures import figures
from agents.papers.excavator.runs import CONTROLLERS, MISMATCHED_CONDITIONS, MISMATCHED_PAYLOADS, NOMINAL, Trial
from agents.papers.report import Record, Report, ReportOptions, joined, publish
from agents.tables import Table
from planners.excavator import EXCAVATOR
from planners.excavator.controllers import ADAPTIVE

Cell = Callable[[Record], str]

RANGES = {
    "payload": (0.0, 100.0, " %"),
    "rated_load": (1.0, 1e5, " kg"),
    "cycles": (1, 1000, ""),
    "rate": (10.0, 2000.0, " samples/s"),
}
"""Least and greatest value of each option, and its unit."""


@dataclass(frozen=True)
class PaperExcavatorOptions(ReportOptions):
    """Regenerate the excavator paper's results, its figures 4 to 8 among them, with payloads of your own.

    For example:

        $ planarm paper-excavator --payloads 0 5 10 --plot figures.png
    """

    payloads: tuple[float, ...] = (0.0, 2.0, 4.0, 6.0, 8.0, 10.0)
    """Payloads, % of the rated load."""
    rated_load: float = EXCAVATOR.payload.rated_load
    """Rated load, kg; the paper's conclusion says 3.5 t."""
    cycles: int = 3
    """Cycles of the motion; the first and the last are reported."""
    rate: float = 200.0
    """Control rate, samples per second."""

    def trial(self) -> Trial:
        """What all runs share; a ValueError if an option is out of range."""
        if not self.payloads:
            raise ValueError("no payloads: give at least one, % of the rated load, such as --payloads 0 10")
        given = [("payload", percent) for percent in self.payloads]
        given += [(name, getattr(self, name)) for name in ("rated_load", "cycles", "rate")]
        for name, value in given:
            least, most, unit = RANGES[name]
            if not least <= value <= most:
                raise ValueError(f"{name} {value:g}{unit} must be from {least:g} to {most:g}{unit}")
        machine = replace(EXCAVATOR, payload=replace(EXCAVATOR.payload, rated_load=self.rated_load))
        return Trial(machine=machine, cycles=self.cycles, period=1.0 / self.rate)


def run(options: PaperExcavatorOptions) -> None:
    """Regenerate the paper's results: the entry point of the command; a ValueError if an option is out of range."""
    trial = options.trial()
    with progress_bar("cycles") as bar:
        progress = partial(bar.advance, bar.add_task("simulating", total=2 * trial.cycles * len(CONTROLLERS)))
        payloads = list(trial.records([(percent, NOMINAL) for percent in options.payloads], progress))
        mismatched = list(trial.records(MISMATCHED_CONDITIONS, progress))
    tables = [*_payload_tables(payloads, trial.cycles), *_mismatch_tables(mismatched)]
    records = {"payloads": payloads, "rough": mismatched}
    draw = partial(figures, trial, options.payloads)
    publish(Report("excavator", tables, list(facts(payloads, mismatched)), records, draw), options)


def _payload_tables(rows: Sequence[Record], cycles: int) -> Iterator[Table]:
    """Controllers by payloads."""

    header = "{percent:g} %, {mass:g} kg".format_map
    yield _pivot(
        f"RMS error of the five joints, deg: cycle 1 / cycle {cycles}",
        rows,
        header,
        lambda row: f"{_degrees(row['first']):.3f} / {_degrees(row['last']):.4f}",
    )
    yield _pivot(
        f"Tip, mm: RMS and peak in cycle 1 / RMS and peak in cycle {cycles}",
        rows,
        header,
        lambda row: " / ".join(
            joined((1e3 * cycle["tip"], 1e3 * cycle["tip_peak"]), 1) for cycle in (row["first"], row["last"])
        ),
    )
    yield _pivot(
        f"Joints 1 and 2, RMS error in cycle {cycles}: angles, deg / velocities, deg/s",
        rows,
        header,
        lambda row: " / ".join(
            joined(np.degrees(row["last"][name][:2]), digits) for name, digits in (("position", 4), ("velocity", 3))
        ),
    )
    adaptive = {entry.title for entry in CONTROLLERS if entry.controller in ADAPTIVE}
    yield _pivot(
        f"Estimated mass after cycle 1 / largest error in cycle {cycles}, kg",
        [row for row in rows if row["controller"] in adaptive],
        header,
        "{first[mass_estimate]:.1f} / {last[mass_error]:.1f}".format_map,
    )


def _mismatch_tables(rows: Sequence[Record]) -> Iterator[Table]:
    """Controllers by the arm's differences from their model, for each payload."""
    for percent in MISMATCHED_PAYLOADS:
        shown = [row for row in rows if row["percent"] == percent]
        yield _pivot(
            f"Model mismatch, {shown[0]['mass']:g} kg: joints, deg / tip, mm, RMS, last cycle",
            shown,
            "{case}".format_map,
            lambda row: f"{_degrees(row['last']):.4f} / {1e3 * row['last']['tip']:.1f}",
        )


def _degrees(errors: Record) -> float:
    """The error of the joints, deg."""
    return float(np.degrees(errors["joints"]))


def _pivot(title: str, rows: Sequence[Record], header: Cell, cell: Cell) -> Table:
    """A line for each controller; its rows, in order, are the cells."""
    headers = ["controller", *dict.fromkeys(header(row) for row in rows)]
    names = dict.fromkeys(row["controller"] for row in rows)
    return Table(title, headers, [[name, *(cell(row) for row in rows if row["controller"] == name)] for name in names])
