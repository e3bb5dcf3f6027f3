"""The picture of `planarm curves`: a panel for each metric, with a line for each seed, their median and their range."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from agents.figures.sheet import Axes, Figure, new_sheet, rgb
from agents.training.learning_curves import Curve
from envs.card import Metric
from envs.rendering import palette
from envs.rendering.palette import Color
from planners.typing import Array

WIDTH, HEIGHT = 10.0, 3.5  # of the picture, inches
_COLORS: tuple[Color, ...] = (
    palette.ACCENT,
    (205, 105, 20),
    (122, 78, 178),
    (22, 130, 96),
    (160, 90, 60),
    (200, 60, 120),
)
GROUPS_AT_MOST = len(_COLORS)  # largest number of groups, one colour each
_WIDE = 20.0  # range of values above which an axis becomes logarithmic beyond 1
_AGAINST = {"seconds": "seconds of training, warm start included", "steps": "control steps after the warm start"}


def draw_curves(groups: Mapping[str, Sequence[Curve]], metrics: Sequence[Metric], against: str) -> Figure:
    """Learning curves of groups of runs, a panel for each metric, against ``seconds`` or ``steps``.

    The best expert's value is a dashed line. More groups than colours are a ValueError.
    """
    if len(groups) > GROUPS_AT_MOST:
        raise ValueError(f"{len(groups)} groups; a picture has room for {GROUPS_AT_MOST}: give fewer runs")
    sheet = new_sheet(WIDTH, HEIGHT)
    panels = sheet.subplots(1, len(metrics), squeeze=False)[0]
    everything = [curve for curves in groups.values() for curve in curves]
    for axes, metric in zip(panels, metrics, strict=True):
        for (label, curves), color in zip(groups.items(), _COLORS, strict=False):
            _draw_group(axes, label, curves, metric, against, color)
        _draw_experts(axes, everything, metric)
        _finish(axes, metric, against)
        _say_never(axes, everything, metric)
        if any(np.isinf(curve.columns[metric.key]).any() for curve in everything):
            axes.set_title(f"{metric.title}; gaps: never", fontsize=10)
    text = f"{everything[0].config.env_id}. Thin: each seed; thick: their median; shaded: from minimum to maximum."
    sheet.suptitle(text, fontsize=9)
    handles, labels = panels[0].get_legend_handles_labels()
    sheet.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=9, frameon=False)
    return sheet


def median_curve(curves: Sequence[Curve], key: str, against: str) -> tuple[Array, Array, Array, Array]:
    """Abscissae, then median, minimum and maximum over seeds, ``(points,)`` each, up to the shortest run.

    Seeds are combined at equal numbers of steps, and the abscissa is the median of theirs, so that the speeds of their
    machines do not matter. A seed's curve is linear between its checkpoints, and infinite beside one that is infinite.
    """
    steps = [curve.columns["steps"] for curve in curves]
    last = min(own[-1] for own in steps)
    points = np.unique(np.concatenate(steps))
    points = points[points <= last]
    values, across = (
        np.array([np.interp(points, own, curve.columns[name]) for own, curve in zip(steps, curves, strict=True)])
        for name in (key, against)
    )
    return np.median(across, axis=0), np.median(values, axis=0), values.min(axis=0), values.max(axis=0)


def _draw_group(axes: Axes, label: str, curves: Sequence[Curve], metric: Metric, against: str, color: Color) -> None:
    shade, seeds = rgb(color), f"{len(curves)} seed" + ("s" if len(curves) > 1 else "")
    if len(curves) > 1:
        for curve in curves:
            values = _finite(metric.factor * curve.columns[metric.key])
            axes.plot(curve.columns[against], values, color=shade, linewidth=0.8, alpha=0.5)
    across, *ordinates = median_curve(curves, metric.key, against)
    middle, low, high = (_finite(metric.factor * values) for values in ordinates)
    axes.fill_between(across, low, high, color=shade, alpha=0.15, linewidth=0.0)
    marker = "o" if len(across) == 1 else ""
    axes.plot(across, middle, color=shade, linewidth=2.2, marker=marker, label=f"{label} ({seeds})")


def _draw_experts(axes: Axes, curves: Sequence[Curve], metric: Metric) -> None:
    """A dashed line for each value of a best expert; runs evaluated on the same episodes share one."""
    ink = rgb(palette.INK)
    levels = {
        (curve.expert, metric.factor * float(curve.columns[f"expert_{metric.key}"][-1]))
        for curve in curves
        if curve.expert
    }
    names = " or ".join(sorted({name for name, _ in levels}))
    for number, (_, level) in enumerate(sorted(levels)):
        if np.isfinite(level):
            axes.axhline(
                level, color=ink, linestyle="--", linewidth=1.1, label="" if number else f"best expert: {names}"
            )


def _say_never(axes: Axes, curves: Sequence[Curve], metric: Metric) -> None:
    """Write into a panel without a finite value that there is none."""
    if not any(np.isfinite(curve.columns[metric.key]).any() for curve in curves):
        axes.text(0.5, 0.5, "never", transform=axes.transAxes, ha="center", fontsize=10)
        axes.set_yticks([])


def _finish(axes: Axes, metric: Metric, against: str) -> None:
    axes.set_title(metric.title, fontsize=10)
    axes.set_xlabel(_AGAINST[against], fontsize=9)
    from matplotlib.ticker import EngFormatter, StrMethodFormatter

    low, high = axes.get_ylim()
    if metric.key == "success":
        bottom = 10.0 * np.floor(low / 10.0) if low > 50.0 else 0.0
        axes.set_ylim(bottom - 0.03 * (100.0 - bottom), 100.0 + 0.03 * (100.0 - bottom))
    elif high - low > _WIDE:
        axes.set_yscale("symlog", linthresh=1.0)
        axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        if axes.dataLim.ymin >= 0.0:
            axes.set_ylim(bottom=0.0)
    else:
        axes.ticklabel_format(axis="y", useOffset=False)
    axes.set_xlim(left=0.0)
    if against == "steps":
        axes.xaxis.set_major_formatter(EngFormatter(sep=""))
    axes.tick_params(labelsize=8)
    axes.grid(alpha=0.25)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _finite(values: Array) -> Array:
    """Values with a gap where they are infinite."""
    return np.where(np.isfinite(values), values, np.nan)
