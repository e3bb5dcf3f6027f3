"""What the commands that regenerate a paper's results have in common: options, facts, tables, JSON and figures."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from agents.files import write_bytes, write_json

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_TABLE_WIDTH = 160


@dataclass(frozen=True)
class ReportOptions:
    """Where to write a report."""

    json: Path | None = None
    """Write the tables to this file as JSON."""
    plot: Path | None = None
    """Draw the paper's figures to this file; its suffix (.png, .svg, .pdf) decides the format."""
    dpi: int = 150
    """Resolution of the plot, dots per inch."""


@dataclass(frozen=True)
class Fact:
    """Something about a paper that numbers show: a sentence, and the numbers in it by name."""

    statement: str
    values: dict[str, Any]


def report_console() -> Console:
    """Where a report is printed: in a file or a pipe wide enough that no cell is broken."""
    console = Console()
    if not console.is_terminal:
        console.width = _TABLE_WIDTH
    return console


def write_report(options: ReportOptions, document: Mapping[str, Any], figure: Callable[[str, int], bytes]) -> None:
    """Write the JSON and the figures that are asked for.

    Args:
        options: where to.
        document: the content of the JSON file.
        figure: draws the figures, given the file format (png, svg, pdf) and the resolution in dots per inch.

    Raises:
        ModuleNotFoundError: if a plot is asked for and matplotlib is missing.
    """
    if options.json is not None:
        write_json(options.json, document)
    if options.plot is not None:
        write_bytes(options.plot, figure(options.plot.suffix.removeprefix("."), options.dpi))


def new_sheet(width: float, height: float) -> Figure:
    """An empty sheet for panels, inches.

    Raises:
        ModuleNotFoundError: if matplotlib is missing; the message says how to install it.
    """
    try:
        from matplotlib.figure import Figure
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError('plots need matplotlib: pip install "planarm[viz]"') from error
    return Figure(figsize=(width, height), layout="constrained")


def image_bytes(sheet: Figure, file_format: str, dpi: int) -> bytes:
    """A sheet as an image file.

    Raises:
        ValueError: if matplotlib does not know the file format.
    """
    image = io.BytesIO()
    sheet.savefig(image, format=file_format, dpi=dpi)
    return image.getvalue()


def name_axes(axes: Axes, title: str, x: str, y: str, fontsize: str = "small") -> None:
    """Title, axis names, a faint grid and a legend for a panel."""
    axes.set(title=title, xlabel=x, ylabel=y)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=fontsize)
