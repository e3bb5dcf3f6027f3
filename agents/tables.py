"""Tables of text and numbers: aligned on a terminal, Markdown in a file or a pipe."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
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
_UNBOUNDED = Console(width=_MARKDOWN_WIDTH)


@dataclass(frozen=True)
class Table:
    """A table with a title above and a caption below; ``str`` of it is Markdown."""

    title: str  # may be empty
    headers: Sequence[str]  # of the columns
    rows: Sequence[Sequence[str]]  # one cell a column
    caption: str = ""  # what its numbers are; may be empty
    text_columns: int = 1  # how many of the first columns hold text, which is aligned to the left
    foremost: Sequence[str] = ()  # headers that a terminal shows, as many of the first as fit beside the text columns
    brief: str = ""  # caption for a terminal, if it has foremost columns
    legend: str = ""  # what the numbers of all tables of its kind are, which need not be said below each; may be empty

    def show(
        self,
        console: Console | None = None,
        *,
        markdown: bool = False,
        wide: bool = False,
        explained: set[str] | None = None,
    ) -> None:
        """Print it.

        Args:
            console: where to; stdout if none is given.
            markdown: whether to print Markdown on a terminal too.
            wide: whether a terminal shows all columns, although some are folded; by default it shows the foremost ones,
                if there are any, and then the others, as far as they fit.
            explained: legends that have been printed above, which are not repeated; this one is added.
        """
        console, explained = console or Console(), set() if explained is None else explained
        full = self if self.legend in explained else replace(self, caption=f"{self.legend} {self.caption}".strip())
        if not console.is_terminal or markdown:
            text = io.StringIO()
            unbroken = Console(file=text, width=_MARKDOWN_WIDTH)
            escaped = replace(full, rows=[[cell.replace("|", r"\|") for cell in row] for row in full.rows])
            escaped._print(unbroken, self.title and f"### {self.title}", escaped._rich(box.MARKDOWN, narrow=False))
            lines = "\n".join(line.rstrip() for line in text.getvalue().strip().splitlines())
            console.print(Text(f"{lines}\n"), soft_wrap=True)
        elif self.foremost and not wide:
            fitting = self._fitting(console)
            fitting._print(console, self.title, fitting._rich(box.SIMPLE_HEAD, narrow=True))
            return  # without the legend
        else:
            full._print(console, self.title, self._rich(box.SIMPLE_HEAD, narrow=True))
        explained.add(self.legend)

    def __str__(self) -> str:
        text = io.StringIO()
        self.show(Console(file=text, force_terminal=False))
        return text.getvalue().strip() + "\n"

    def _fitting(self, console: Console) -> Table:
        """The table with as many columns as fit, at least one beside the text, and a caption that names the others."""
        texts = list(range(self.text_columns))
        others = [self.headers.index(header) for header in self.foremost if header in self.headers]
        others += [place for place in range(self.text_columns, len(self.headers)) if place not in others]
        count, shown = len(others), self
        while count > 1 and shown._terminal_width() > console.width:
            count -= 1
            shown = self._columns(sorted([*texts, *others[:count]]))
        hidden = [self.headers[place] for place in sorted(others[count:])]
        more = f"Not shown: {', '.join(hidden)} (--wide)." if hidden else ""
        return replace(shown, caption=f"{self.brief} {more}".strip())

    def _terminal_width(self) -> int:
        return self._rich(box.SIMPLE_HEAD, narrow=True).__rich_measure__(_UNBOUNDED, _UNBOUNDED.options).maximum

    def _columns(self, places: Sequence[int]) -> Table:
        rows = [[row[place] for place in places] for row in self.rows]
        return replace(self, headers=[self.headers[place] for place in places], rows=rows)

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
