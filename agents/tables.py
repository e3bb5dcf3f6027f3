"""Tables of text and numbers: aligned on a terminal, Markdown in a file or a pipe."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from rich import box
from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text


class Interval(Protocol):
    """A number with an interval, which is NaN where there is none."""

    @property
    def value(self) -> float:
        """The number."""

    @property
    def low(self) -> float:
        """The lower end."""

    @property
    def high(self) -> float:
        """The upper end."""


_MARKDOWN_WIDTH = 10_000  # characters: a row of Markdown must stay on one line


@dataclass(frozen=True)
class Table:
    """A table with a title above and a caption below."""

    title: str  # may be empty
    headers: Sequence[str]  # of the columns
    rows: Sequence[Sequence[str]]  # one cell a column
    caption: str = ""  # what its numbers are; may be empty
    text_columns: int = 1  # how many of the first columns hold text, which is aligned to the left

    def show(self, console: Console | None = None) -> None:
        """Print it to a console, stdout if none is given."""
        console = console or Console()
        if console.is_terminal:
            self._print(console, self.title, self._rich(box.SIMPLE_HEAD, narrow=True))
        else:
            wide = Console(file=console.file, width=_MARKDOWN_WIDTH)
            self._print(wide, self.title and f"### {self.title}", self._rich(box.MARKDOWN, narrow=False))

    def _print(self, console: Console, heading: str, table: RichTable) -> None:
        parts = (Text(heading, style="bold"), table, Text(f"{self.caption}\n"))
        for part, wanted in zip(parts, (heading, True, self.caption), strict=True):
            if wanted:
                console.print(part)

    def _rich(self, style: box.Box, *, narrow: bool) -> RichTable:
        """As a table of rich; a narrow one has a line for each word of a header, so that 80 characters are enough."""
        table = RichTable(box=style, padding=0, header_style="bold")
        for number, header in enumerate(self.headers):
            title = header.replace(" ", "\n") if narrow else header
            table.add_column(Text(title), justify="left" if number < self.text_columns else "right", overflow="fold")
        for row in self.rows:
            table.add_row(*map(Text, row))
        return table


def number_text(value: float) -> str:
    """A number with three decimals if it is below 10, with one otherwise; "never" for an infinite one."""
    if math.isinf(value):
        return "never"
    if 0.0 < abs(value) < 0.0005:
        return "<0.001"
    return f"{value:.3f}" if abs(value) < 10.0 else f"{value:.1f}"


def short_text(value: float) -> str:
    """As `number_text`, without a decimal that is zero."""
    return number_text(value).removesuffix(".0")


def percent_text(share: float) -> str:
    """A share in percent with at most one decimal."""
    return f"{100.0 * share:.1f}".removesuffix(".0")


def share_text(share: Interval) -> str:
    """A share in percent, with its interval."""
    return f"{percent_text(share.value)} ({percent_text(share.low)}-{percent_text(share.high)})"


def interval_text(estimate: Interval, text: Callable[[float], str] = number_text) -> str:
    """An estimate with its interval, if there is one; ``text`` writes each number."""
    value, low, high = map(text, (estimate.value, estimate.low, estimate.high))
    return value if math.isnan(estimate.low) else f"{value} ({low} to {high})"
