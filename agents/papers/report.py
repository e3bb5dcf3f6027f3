"""What the commands that regenerate a paper's results share: options, tables, facts, JSON and figures."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from agents.commands.outputs import write_picture
from agents.console import note, say
from agents.figures.sheet import Figure, SubFigure, new_sheet
from agents.tables import Table
from planners.files import write_json

Record = dict[str, Any]  # a result by the names that it has in the JSON
Columns = Mapping[str, str | Callable[[Record], str]]
"""By header, the cell of a record: a template such as "{cost:.2f}", or a function."""


FIGURE_DPI, FIGURE_COLORS = 100, 48
"""Of a figure in a file of its own."""


@dataclass(frozen=True)
class ReportOptions:
    """Regenerate a paper's results; in a file or a pipe the tables are Markdown.

    For example:

        $ planarm paper-dpct
        $ planarm paper-lagrange --json results.json --plot figures.pdf
        $ planarm paper-apf > tables.md
    """

    json: Path | None = None
    """Write the results to this file as JSON."""
    plot: Path | None = None
    """Draw the paper's figures to this file; its suffix (.png, .svg, .pdf) decides the format."""
    figures: Path | None = None
    """Draw each of them to a PNG of its own in this folder, in a size to lay beside the paper's."""
    dpi: int = 150
    """Resolution of the plot, dots per inch."""


@dataclass(frozen=True)
class Fact:
    """A statement about a paper, and the numbers in it by name."""

    statement: str
    values: Record


@dataclass(frozen=True)
class Part:
    """A figure of a paper: what draws its panels on a sheet, or on a part of one, and how large they are, inches."""

    draw: Callable[[Figure | SubFigure], None]
    width: float
    height: float

    def alone(self) -> Figure:
        """It on a sheet of its own."""
        sheet = new_sheet(self.width, self.height)
        self.draw(sheet)
        return sheet


Sheet = Figure | SubFigure
Parts = Mapping[str, Part]
"""The figures of a paper by the ends of their files' names."""


def whole_sheet(parts: Parts) -> Figure:
    """All figures of a paper, one below the other."""
    heights = [part.height for part in parts.values()]
    sheet = new_sheet(max(part.width for part in parts.values()), sum(heights))
    places = sheet.subfigures(len(parts), 1, height_ratios=heights, squeeze=False).flat
    for part, place in zip(parts.values(), places, strict=True):
        part.draw(place)
    return sheet


@dataclass(frozen=True)
class Report:
    """A paper's results: tables and facts to print, records for the JSON, and the paper's figures.

    ``name`` is that of the paper, with which the files of its figures begin.
    """

    name: str
    tables: Sequence[Table]
    facts: Sequence[Fact]
    records: Mapping[str, Sequence[Record]]
    figures: Callable[[], Parts]


def tabulate(
    title: str, records: Iterable[Record], columns: Columns, caption: str = "", text_columns: int = 1
) -> Table:
    """A table with a row for each record; see `agents.tables.Table` for the other arguments."""
    rows = [
        [cell.format_map(record) if isinstance(cell, str) else cell(record) for cell in columns.values()]
        for record in records
    ]
    return Table(title, list(columns), rows, caption, text_columns)


def publish(report: Report, options: ReportOptions) -> None:
    """Write a report's JSON and its figures if asked for; print it."""
    if options.json is not None:
        facts = {"facts": [asdict(fact) for fact in report.facts]} if report.facts else {}
        write_json(options.json, {**report.records, **facts})
        note(f"wrote {options.json}")
    if options.plot is not None:
        write_picture(whole_sheet(report.figures()), options.plot, options.dpi, colors=None)
    if options.figures is not None:
        options.figures.mkdir(parents=True, exist_ok=True)
        for name, part in report.figures().items():
            path = options.figures / f"paper_{report.name}_{name}.png"
            write_picture(part.alone(), path, FIGURE_DPI, colors=FIGURE_COLORS)
    for table in report.tables:
        table.show()
    for fact in report.facts:
        say(f"- {fact.statement}")


def joined(values: Iterable[float], digits: int) -> str:
    """Numbers in one cell."""
    return " ".join(f"{value:.{digits}f}" for value in values)
