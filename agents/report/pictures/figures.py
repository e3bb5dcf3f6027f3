"""The charts of a report as figures for papers, PDF and SVG: the same file for the same results, fonts embedded."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from agents.evaluation.compare import Pair
from agents.evaluation.statistics import Estimate
from agents.figures.sheet import Axes, Figure, new_sheet
from agents.report.axes import Axis, span, tick_text
from agents.report.numbers import Quantity, costs, differences, profiled, profiles, quantities
from agents.report.pictures.drawing import shortened
from agents.report.pictures.labels import Box, place_labels
from agents.report.pictures.looks import Look, policy_looks
from agents.report.results_file import Results, TaskScores
from agents.report.side_by_side import side_by_side
from agents.tables import percent_text
from planners.files import write_bytes

COLORS = (
    "#2f80c4",
    "#d9642a",
    "#2a9467",
    "#a24bb0",
    "#b07d00",
    "#5b6475",
    "#0d8f9c",
    "#d1376b",
    "#86624a",
    "#5a5bd0",
)
"""Of policies, those of the page on light ground."""
_SHADES = ((0.0, 0.0), (0.48, 0.0), (0.38, 1.0), (0.75, 0.0))
"""For each shape, which share of a grey goes into the colour, and that grey: about those of the page."""
_LINES: tuple[Any, ...] = ("-", (0, (5, 2)), (0, (1, 1)), (0, (5, 1.5, 1, 1.5)))
_WIDTH, _ROW = 3.4, 0.21  # of a figure and of one of its rows, inches: a column of a paper
_STYLE = {"font.size": 8.0, "pdf.fonttype": 42, "svg.fonttype": "path", "svg.hashsalt": "planarm"}


def write_figures(files: Sequence[tuple[str, Results]], folder: Path) -> int:
    """Write every chart of every task into a folder, as PDF and as SVG; how many files there are.

    Raises:
        ModuleNotFoundError: without matplotlib, the viz extra.
        ValueError: if two tasks would have files of the same name.
    """
    new_sheet(1.0, 1.0)  # says first how to install matplotlib
    import matplotlib

    count, taken = 0, set[str]()
    with matplotlib.rc_context(_STYLE):  # type: ignore[arg-type]
        for name, sheet in _all_figures(files):
            stem = re.sub(r"[^\w.-]+", "_", name)
            if stem in taken:
                raise ValueError(f"two tasks have figures called {stem}: give one file of results after the other")
            taken.add(stem)
            for suffix in (".pdf", ".svg"):
                write_bytes(folder / f"{stem}{suffix}", _content(sheet, suffix))
                count += 1
    return count


def _all_figures(files: Sequence[tuple[str, Results]]) -> Iterator[tuple[str, Figure]]:
    """The leaderboard of all tasks, and the charts of each, with their names."""
    tasks = side_by_side(files)
    looks = policy_looks(files, tasks)
    if overview := [task for task in tasks if len(task.seeds) > 1]:
        yield "leaderboard", leaderboard(overview, looks)
    for task in tasks:
        for name, sheet in task_figures(task, looks):
            yield f"{task.task}_{name}", sheet


def leaderboard(tasks: Sequence[TaskScores], looks: Mapping[str, Look]) -> Figure:
    """Success and the primary metric, or the return, of every policy: a row of two charts for each task."""
    heights = [0.75 + _ROW * len(task.policies) for task in tasks]
    sheet = new_sheet(2.0 * _WIDTH, sum(heights))
    charts = sheet.subplots(len(tasks), 2, squeeze=False, height_ratios=heights)
    for task, row in zip(tasks, charts, strict=True):
        for quantity, axes in zip(quantities(task)[:2], row, strict=True):
            _prepare(axes)
            _points(task, quantity, looks, axes)
        row[0].set_title(_plain(task.task), loc="left", fontweight="bold")
        row[1].set_yticklabels([])
    return sheet


def task_figures(task: TaskScores, looks: Mapping[str, Look]) -> Iterator[tuple[str, Figure]]:
    """The charts of a task, each with its name: points of three quantities, profiles, differences, costs."""
    for quantity in quantities(task)[: 3 if task.primary else 2]:
        yield quantity.column, _sheet(len(task.policies), partial(_points, task, quantity, looks))
    if task.primary is not None:
        yield "profile", _sheet(11 + len(task.policies) // 3, partial(_profiles, task, looks))
    if pairs := differences(task):
        yield "differences", _sheet(len(pairs), partial(_differences, task, pairs, looks))
    yield "cost", _sheet(10, partial(_costs, task, looks))


def _sheet(rows: int, draw: Callable[[Axes], None]) -> Figure:
    sheet = new_sheet(_WIDTH, 0.55 + _ROW * rows)
    axes = sheet.subplots()
    _prepare(axes)
    draw(axes)
    return sheet


def _prepare(axes: Axes) -> None:
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.25, linewidth=0.5)
    axes.set_axisbelow(True)


def _points(task: TaskScores, quantity: Quantity, looks: Mapping[str, Look], axes: Axes) -> None:
    rows = [(each.policy, quantity.of(each)) for each in task.policies]
    shown = [(name, estimate) for name, estimate in rows if estimate is not None]
    lines = [(task.bound_name, quantity.bound, "--"), ("paper", quantity.published, ":")]
    known = [value for _, value, _ in lines if value is not None]
    numbers = [(each.low, each.value, each.high) for _, each in shown]
    low, high = (0.0, 100.0) if quantity.share else span(numbers, known)
    for name, value, style in lines:
        if value is not None:
            axes.axvline(value, color="black", linewidth=0.9, linestyle=style)
            axes.annotate(name, (value, 1.0), xycoords=("data", "axes fraction"), ha="center", va="bottom", fontsize=7)
    for row, (name, estimate) in enumerate(shown):
        _row(axes, row, estimate, (low, high), looks[name])
    axes.set_yticks(range(len(shown)), [_label(name) for name, _ in shown])
    axes.set(xlim=_widened(low, high), ylim=(len(shown) - 0.5, -0.5), xlabel=_plain(quantity.title))
    axes.grid(visible=False, axis="y")


def _differences(task: TaskScores, pairs: Sequence[Pair], looks: Mapping[str, Look], axes: Axes) -> None:
    metric = task.primary
    quantity = Quantity(metric.key, metric.title, metric.factor) if metric else Quantity("return", "return")
    rows = [(pair, (pair.metric or pair.returns).times(quantity.factor)) for pair in pairs]
    low, high = span([(each.low, each.value, each.high) for _, each in rows], [0.0])
    axes.axvline(0.0, color="black", linewidth=0.9)
    for row, (pair, estimate) in enumerate(rows):
        _row(axes, row, estimate, (low, high), looks[pair.policy])
        text = f"{percent_text(pair.improvement.value)} %"
        axes.annotate(text, (1.02, row), xycoords=("axes fraction", "data"), va="center", fontsize=7)
    axes.annotate("better in", (1.02, 1.0), xycoords="axes fraction", va="bottom", fontsize=7)
    axes.set_yticks(range(len(rows)), [_label(f"{pair.policy} \u2212 {pair.against}") for pair, _ in rows])
    title = _plain(f"difference of {quantity.title}")
    axes.set(xlim=_widened(low, high), ylim=(len(rows) - 0.5, -0.5), xlabel=title)
    axes.grid(visible=False, axis="y")


def _color(look: Look) -> str:
    """The colour of a policy in the shade of its shape."""
    share, grey = _SHADES[look.shape]
    channels = (int(COLORS[look.color][place : place + 2], 16) for place in (1, 3, 5))
    return "#" + "".join(f"{round((1.0 - share) * channel + 255.0 * share * grey):02x}" for channel in channels)


def _point(look: Look) -> dict[str, Any]:
    """How a point of a policy is drawn: round or square, full or empty."""
    color = _color(look)
    inner = "white" if look.shape % 2 else color
    return {"marker": "o" if look.shape < 2 else "s", "color": color, "markerfacecolor": inner, "markersize": 4}


def _row(axes: Axes, row: int, estimate: Estimate, shown: tuple[float, float], look: Look) -> None:
    """A point with its interval, or an arrow at the edge for one beyond it."""
    (low, high), color, point = shown, _color(look), _point(look)
    if math.isnan(estimate.value):
        return
    if not low <= estimate.value <= high:
        beyond = estimate.value > high
        axes.plot(high if beyond else low, row, **{**point, "marker": ">" if beyond else "<"})
        return
    if not math.isnan(estimate.low):
        axes.plot(
            [max(low, estimate.low), min(high, estimate.high)], [row, row], color=color, linewidth=1.6, alpha=0.55
        )
    axes.plot(estimate.value, row, **point)


def _profiles(task: TaskScores, looks: Mapping[str, Look], axes: Axes) -> None:
    metric, curves = task.primary, profiles(task)
    values = [float(value) for curve in curves for value in curve.values]
    logarithmic = bool(values) and min(values) > 0.0 and max(values) / min(values) > 30.0
    edges = (min(values), max(values)) if logarithmic else span([[float(v) for v in curve.values] for curve in curves])
    lower = metric is None or metric.lower_is_better
    names = {each.policy for each in task.policies}
    for curve in curves:
        x = [edges[0] if lower else edges[1], *curve.values, edges[1] if lower else edges[0]]
        last = curve.share[-1:] if len(curve.share) else [0.0]
        color, style = "black", "--"
        if curve.name in names:
            color, style = _color(looks[curve.name]), _LINES[looks[curve.name].shape]
        shares = [0.0, *curve.share, *last]
        axes.step(x, shares, where="post", linewidth=1.1, label=_label(curve.name), color=color, linestyle=style)
        if curve.name in names and len(curve.values) and len(task.seeds) > 1:
            lower_end, upper_end = ([0.0, *ends, ends[-1]] for ends in (curve.low, curve.high))
            axes.fill_between(x, lower_end, upper_end, step="post", alpha=0.1, linewidth=0.0, color=color)
    axes.set(xlim=edges, ylim=(0.0, 1.02), xlabel=_plain(f"{metric.title if metric else ''}: \u03c4"))
    sign = "\u2264" if lower else "\u2265"
    axes.set_ylabel(f"share of {profiled(task)}\nwith a success {sign} \u03c4")
    if logarithmic:
        axes.set_xscale("log")
    columns = max(1, 60 // (8 + max(len(shortened(curve.name)) for curve in curves)))
    axes.figure.legend(loc="outside lower center", ncols=columns, fontsize=6.5, frameon=False)


def _costs(task: TaskScores, looks: Mapping[str, Look], axes: Axes) -> None:
    quantity, shown = costs(task)
    bounds = [] if quantity.bound is None else [quantity.bound]
    low, high = span([(each.score.low, each.score.value, each.score.high) for each in shown], bounds)
    labels = []
    for value in bounds:
        axes.axhline(value, color="black", linewidth=0.9, linestyle="--")
        edge = axes.get_yaxis_transform()
        labels.append(
            axes.annotate(task.bound_name, (1.0, value), (0, 2), edge, "offset points", ha="right", fontsize=7)
        )
    for each in shown:
        look, score = looks[each.policy.policy], each.score
        beyond = not low <= score.value <= high
        top = score.value > high or (math.isnan(score.value) and quantity.lower_is_better is True)
        y = (high if top else low) if beyond else score.value
        if not beyond and not math.isnan(score.low):
            ends = [max(low, score.low), min(high, score.high)]
            axes.plot([each.action_us] * 2, ends, color=_color(look), linewidth=1.6, alpha=0.55)
        axes.plot(each.action_us, y, **{**_point(look), **({"marker": "^" if top else "v"} if beyond else {})})
        place = (each.action_us, y), (4, 3)
        labels.append(axes.annotate(_label(each.policy.policy), *place, textcoords="offset points", fontsize=7))
    axes.set(xscale="log", ylim=_widened(low, high), xlabel="time of an action, with planning (\u00b5s)")
    axes.set_ylabel(_plain(quantity.title))
    axes.margins(x=0.2)
    low, high = axes.get_xlim()
    ticks = Axis(low, high, 0.0, 1.0, logarithmic=True).ticks()
    axes.set_xticks(ticks, [tick_text(tick) for tick in ticks])
    axes.set_xticks([], minor=True)
    for label in labels:
        label.set_in_layout(False)
    _move_apart(labels, axes)


def _move_apart(labels: Sequence[Any], axes: Axes) -> None:
    """Move annotations within the axes to where none is over another or over a point."""
    sheet: Any = axes.figure
    sheet.draw_without_rendering()
    to_points = 72.0 / sheet.dpi
    fixed = [label for label in labels if label.get_ha() == "right"]
    moved = [label for label in labels if label not in fixed]
    taken: list[Box] = [tuple(label.get_window_extent().extents) for label in fixed]
    points: list[Any] = [tuple(axes.transData.transform(label.xy).tolist()) for label in moved]
    sizes = [(label.get_window_extent().width + 2.0, label.get_window_extent().height) for label in moved]
    area: Any = tuple(axes.bbox.extents)
    for label in fixed:
        y = label.get_window_extent().y0
        taken.append((area[0], y - 5.0, area[2], y))
    places = place_labels(points, sizes, area, taken)
    for label, (x, y), place in zip(moved, points, places, strict=True):
        label.xyann = to_points * (place.box[0] - x), to_points * (place.box[1] - y)
        label.set_verticalalignment("bottom")
        if place.line is not None:
            ends = axes.transData.inverted().transform(place.line)
            axes.plot(ends[:, 0], ends[:, 1], color="0.4", linewidth=0.5)


def _widened(low: float, high: float) -> tuple[float, float]:
    margin = 0.03 * (high - low)
    return low - margin, high + margin


def _plain(text: str) -> str:
    """A text in which matplotlib reads no formula."""
    return text.replace("$", r"\$")


def _label(name: str) -> str:
    """A name, shortened if it is long."""
    return _plain(shortened(name))


def _content(sheet: Figure, suffix: str) -> bytes:
    """A figure as a file without a date."""
    content = io.BytesIO()
    metadata = {"Date": None} if suffix == ".svg" else {"CreationDate": None}
    sheet.savefig(content, format=suffix.removeprefix("."), metadata=metadata)
    return content.getvalue()
