"""Axes of charts: which part of the numbers they show, round ticks, places in the picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

OUTLIER = 4.0
"""How many times the span of the better half of the rows an axis grows, at most, on either side for the others."""


@dataclass(frozen=True)
class Axis:
    """A linear or logarithmic axis from ``low`` to ``high``, at the places ``start`` to ``end`` of a picture."""

    low: float
    high: float
    start: float
    end: float
    logarithmic: bool = False

    def place(self, value: float) -> float:
        """Where a value is; a value beyond an end is at that end."""
        value = min(max(value, self.low), self.high)
        low, high, here = (
            (map(math.log10, (self.low, self.high, value)))
            if self.logarithmic
            else (
                self.low,
                self.high,
                value,
            )
        )
        return self.start + (here - low) / (high - low) * (self.end - self.start)

    def shows(self, value: float) -> bool:
        """Whether a value is within."""
        return self.low <= value <= self.high

    def ticks(self, count: int = 5) -> list[float]:
        """About so many round values within."""
        if self.logarithmic:
            decades = range(math.ceil(math.log10(self.low) - 1e-9), math.floor(math.log10(self.high) + 1e-9) + 1)
            every = math.ceil(len(decades) / (count + 2)) if len(decades) else 1
            values = [10.0**decade for decade in decades if decade % every == 0]
            if len(values) >= 3:
                return values
            finer = [step * 10.0**decade for decade in range(decades.start - 1, decades.stop + 1) for step in (1, 2, 5)]
            return [value for value in finer if self.shows(value)]
        step = round_step((self.high - self.low) / count)
        first, last = math.ceil(self.low / step - 1e-9), math.floor(self.high / step + 1e-9)
        return [number * step for number in range(first, last + 1)]


def round_step(least: float) -> float:
    """The smallest of 1, 2, 5, 10, 20, ... that is not below."""
    decade = 10.0 ** math.floor(math.log10(least))
    return next(step * decade for step in (1.0, 2.0, 5.0, 10.0) if step * decade >= least * (1.0 - 1e-9))


def tick_text(value: float) -> str:
    """A tick in few characters."""
    return f"{value:.6g}".replace("e-0", "e-").replace("e+0", "e")


def span(rows: Sequence[Sequence[float]], more: Sequence[float] = ()) -> tuple[float, float]:
    """Which part of the numbers an axis shows, with a margin.

    Args:
        rows: numbers of each row, the most important row first. The first half of the rows is within; others are, too,
            unless that would make the axis much longer (`OUTLIER`).
        more: other numbers that are within.
    """
    finite = [[value for value in row if math.isfinite(value)] for row in rows]
    finite = [row for row in finite if row]
    core = [value for row in finite[: max(1, math.ceil(len(rows) / 2))] for value in row]
    core += [value for value in more if math.isfinite(value)]
    if not core:
        return 0.0, 1.0
    low, high = min(core), max(core)
    room = OUTLIER * (high - low or 0.1 * abs(high) or 1.0)
    for value in (value for row in finite for value in row):
        if low - room <= value <= high + room:
            core.append(value)
    low, high = min(core), max(core)
    margin = 0.06 * (high - low) or 0.1 * abs(high) or 1.0
    return low - margin, high + margin
