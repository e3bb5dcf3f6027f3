"""What a sweep varies: lists, ranges of integers and intervals to draw from; the trials that follow from them."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from agents.yaml_config import refuse_twice
from planners.checks import brief
from planners.documents import parse_yaml

MOST_TRIALS = 10_000
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_RANGE = re.compile(rf"({_NUMBER})\.\.({_NUMBER})(:log)?")
_DIGITS = 4  # significant digits of a drawn number: as many as a reader can make use of


@dataclass(frozen=True)
class Interval:
    """Numbers between two ends, to draw from."""

    low: float
    high: float
    log: bool  # whether their logarithms are uniform, and not they
    whole: bool  # whether they are integers

    def draw(self, rng: np.random.Generator) -> float | int:
        """A random number of the interval, with four significant digits."""
        if self.log:
            value = math.exp(rng.uniform(math.log(self.low), math.log(self.high)))
        else:
            value = rng.uniform(self.low, self.high)
        value = min(max(float(f"{value:.{_DIGITS}g}"), self.low), self.high)
        return round(value) if self.whole else value


Axes = dict[str, "list[Any] | Interval"]
"""By the name of a setting: its values, or an interval to draw them from."""


def parse_axes(terms: Sequence[str]) -> Axes:
    """What ``--over`` names.

    Args:
        terms: ``key=`` and values with commas between them, ``low..high`` for every integer from one to the other, or
            an interval to draw from: ``0.9..0.99`` (uniform), ``1e-4..1e-2:log`` (uniform logarithm). ``arm=`` is short
            for ``env_config.arm=``.

    Raises:
        ValueError: for a term that is not of this form, or a key that is given twice.
    """
    axes: Axes = {}
    for term in terms:
        key, equals, text = term.partition("=")
        if not key or not equals or not text.strip():
            raise ValueError(
                f'--over "{term:.80}" is no key=values, such as seed=0..4, learning_rate=1e-4,3e-4 or '
                "learning_rate=1e-4..1e-2:log"
            )
        key = "env_config.arm" if key == "arm" else key
        refuse_twice([*axes, key], "setting of --over")
        axes[key] = _values(term, text)
    return axes


def combinations(axes: Mapping[str, list[Any] | Interval], samples: int | None, seed: int) -> list[dict[str, Any]]:
    """The settings of each trial.

    Without intervals these are all combinations of the values, or ``samples`` of them, chosen at random. With
    intervals, ``samples`` points are drawn, and each is combined with all values of the other settings.

    Args:
        axes: as `parse_axes` gives them.
        samples: how many to draw.
        seed: of the draws.

    Raises:
        ValueError: if there are too many trials, or an interval and no number of samples.
    """
    if not axes:
        raise ValueError("nothing to sweep over: give --over, such as --over seed=0..4 learning_rate=1e-4,3e-4")
    if samples is not None and samples < 1:
        raise ValueError(f"samples {samples} must be at least 1")
    lists = {key: axis for key, axis in axes.items() if not isinstance(axis, Interval)}
    intervals = {key: axis for key, axis in axes.items() if isinstance(axis, Interval)}
    if intervals and samples is None:
        raise ValueError(
            f"--over {next(iter(intervals))} is an interval to draw from: say with --samples how many points; for "
            "single values write them with commas between"
        )
    count = math.prod(len(values) for values in lists.values()) * ((samples or 1) if intervals else 1)
    if count > MOST_TRIALS:
        raise ValueError(f"{count:,} trials are more than {MOST_TRIALS:,}: take fewer values")
    grid = [dict(zip(lists, values, strict=True)) for values in product(*lists.values())]
    rng = np.random.default_rng(seed)
    if not intervals:
        if samples is None or samples >= len(grid):
            return grid
        return [grid[place] for place in sorted(rng.choice(len(grid), samples, replace=False).tolist())]
    points = [{key: axis.draw(rng) for key, axis in intervals.items()} for _ in range(samples or 0)]
    return [{key: {**point, **values}[key] for key in axes} for point in points for values in grid]


def value_text(value: Any) -> str:
    """A value of a trial in a table or the name of a folder."""
    return f"{value:g}" if isinstance(value, float) else str(value)


def _values(term: str, text: str) -> list[Any] | Interval:
    """The values behind a key."""
    try:
        items = parse_yaml(f"[{text}]", term)
    except ValueError:
        raise ValueError(f'--over "{term:.80}": {brief(text)} are no YAML values with commas between') from None
    values: list[Any] = []
    for item in items:
        found = _RANGE.fullmatch(item) if isinstance(item, str) else None
        if found is None:
            values.append(_number(item))
            continue
        interval = _interval(term, found)
        if interval.whole and not interval.log:
            values += range(int(interval.low), _last(term, interval) + 1)
        elif len(items) > 1:
            raise ValueError(f'--over "{term:.80}": an interval to draw from stands alone, without other values')
        else:
            return interval
    refuse_twice(map(repr, values), f"value of --over {term.partition('=')[0]}")
    return values


def _interval(term: str, found: re.Match[str]) -> Interval:
    low, high = float(found[1]), float(found[2])
    whole = not re.search(r"[.eE]", found[1] + found[2])
    if low >= high:
        raise ValueError(f'--over "{term:.80}": the range must rise, from the lower end to the higher')
    if found[3] and low <= 0.0:
        raise ValueError(f'--over "{term:.80}": :log needs a lower end above 0')
    return Interval(low, high, bool(found[3]), whole)


def _last(term: str, interval: Interval) -> int:
    if interval.high - interval.low >= MOST_TRIALS:
        raise ValueError(f'--over "{term:.80}": more than {MOST_TRIALS:,} integers')
    return int(interval.high)


def _number(item: Any) -> Any:
    """A value; what YAML takes for text although it is a number, such as 1e-4, as that number."""
    return float(item) if isinstance(item, str) and re.fullmatch(_NUMBER, item) else item
