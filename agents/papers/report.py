"""What the commands that regenerate a paper's results share: options, tables, facts, JSON and figures."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from agents.console import say
from agents.figures.sheet import image_bytes
from agents.files import write_bytes, write_json
from agents.tables import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Record = TypeVar("Record")
Columns = Mapping[str, Callable[[Record], str]]
"""Headers, and what makes the cell of a record under each."""


@dataclass(frozen=True)
class ReportOptions:
    """Regenerate a paper's results; in a file or a pipe the tables are Markdown."""

    json: Path | None = None
    """Write the results to this file as JSON."""
    plot: Path | None = None
    """Draw the paper's figures to this file; its suffix (.png, .svg, .pdf) decides the format."""
    dpi: int = 150
    """Resolution of the plot, dots per inch."""


@dataclass(frozen=True)
class Fact:
    """A statement about a paper, and the numbers in it by name."""

    statement: str
    values: dict[str, Any]


@dataclass(frozen=True)
class Report:
    """A paper's results.

    Attributes:
        tables: to print.
        facts: to print below the tables.
        records: dataclass instances by the name they have in the JSON, where the facts follow them.
        figure: draws the paper's figures; called only if a plot is asked for.
    """

    tables: Sequence[Table]
    facts: Sequence[Fact]
    records: Mapping[str, Sequence[Any]]
    figure: Callable[[], Figure]


def tabulate(
    title: str, records: Iterable[Record], columns: Columns[Record], caption: str = "", text_columns: int = 1
) -> Table:
    """A table with a row for each record; see `agents.tables.Table` for the other arguments."""
    rows = [[cell(record) for cell in columns.values()] for record in records]
    return Table(title, list(columns), rows, caption, text_columns)


def publish(report: Report, options: ReportOptions) -> None:
    """Print a report; write its JSON and its figures if asked for.

    Raises:
        ModuleNotFoundError: if a plot is asked for and matplotlib is missing.
    """
    for table in report.tables:
        table.show()
    for fact in report.facts:
        say(f"- {fact.statement}")
    if options.json is not None:
        records = {**report.records, **({"facts": report.facts} if report.facts else {})}
        write_json(options.json, {name: [asdict(record) for record in found] for name, found in records.items()})
    if options.plot is not None:
        write_bytes(options.plot, image_bytes(report.figure(), options.plot.suffix, options.dpi))


def joined(values: Iterable[float], digits: int) -> str:
    """Numbers in one cell."""
    return " ".join(f"{value:.{digits}f}" for value in values)
