"""The picture of `planarm paths`: arm, target and discs at several instants for each policy, and a curve over time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from agents.figures.episode_record import EpisodeRecord
from agents.figures.sheet import Axes, Figure, Rgb, new_sheet, rgb
from envs.rendering import palette
from envs.rendering.palette import Color, mix
from planners.typing import Array

WIDTH = 10.0  # of the picture, inches
_LEFT, _RIGHT, _GAP = 0.5, 0.15, 0.2  # inches: margins, and between panels
_TOP, _FOOT, _CURVES, _BOTTOM = 0.32, 0.32, 1.5, 0.45  # inches: from the top down
_HEADING, _LINE = 0.15, 0.17  # inches: above a panel, and for each line of its title
_INSTANTS = 5

_COLORS: dict[str, Color] = {
    "dpct": palette.ACCENT,
    "lagrange": (205, 105, 20),
    "apf": (122, 78, 178),
    "agent": (22, 130, 96),
}
_OTHER_COLORS: tuple[Color, ...] = (palette.MUTED, (160, 90, 60), (190, 60, 110), palette.INK)
_BELT, _PART = 0.18, 0.07  # m: width of the belt, side of the part
_BELOW_BELT = 0.3  # m: how much of the arm is shown beside the belt


def draw_paths(records: Sequence[EpisodeRecord], start: str) -> Figure:
    """The picture of the paths that policies take from the same start, which ``start`` names."""
    times = np.linspace(0.0, max(record.arrival for record in records), _INSTANTS)
    left, right, bottom, top = _view(records, times)
    columns = 2 if len(records) in (2, 4) else len(records)
    rows = -(-len(records) // columns)
    width = (WIDTH - _LEFT - _RIGHT - (columns - 1) * _GAP) / columns
    height = width * (top - bottom) / (right - left)
    heading = _HEADING + _LINE * max(len(record.outcome.splitlines()) for record in records)
    row = heading + height + _FOOT
    total = _TOP + rows * row + _HEADING + _LINE + _CURVES + _BOTTOM
    sheet = new_sheet(WIDTH, total)
    sheet.set_layout_engine("none")  # panels of equal scale, placed to the inch
    others = iter(_OTHER_COLORS)
    colors = [rgb(_COLORS[record.policy] if record.policy in _COLORS else next(others)) for record in records]
    for place, (record, color) in enumerate(zip(records, colors, strict=True)):
        x, y = _LEFT + place % columns * (width + _GAP), _TOP + place // columns * row + heading
        axes = sheet.add_axes((x / WIDTH, 1.0 - (y + height) / total, width / WIDTH, height / total))
        axes.set(xlim=(left, right), ylim=(bottom, top))
        _draw_panel(axes, record, times, color, 72.0 * width / (right - left))
        axes.tick_params(labelleft=place % columns == 0)
    axes = sheet.add_axes((_LEFT / WIDTH, _BOTTOM / total, 1.0 - (_LEFT + _RIGHT) / WIDTH, _CURVES / total))
    _draw_curves(axes, records, times, colors)
    target = "dotted: the reference" if _moves(records[0]) else "star: the goal"
    if records[0].picture.belt:
        target = "squares: the part on its belt"
    text = f"{start}. Numbers: the same {_INSTANTS} instants in every panel; darker: later; {target}. Axes in metres."
    sheet.text(0.5, 1.0 - 0.22 / total, text, ha="center", fontsize=9, color=rgb(palette.INK))
    return sheet


def _moves(record: EpisodeRecord) -> bool:
    """Whether the target moves."""
    return bool(np.ptp(record.target, axis=0).any())


def _view(records: Sequence[EpisodeRecord], times: Array) -> tuple[float, float, float, float]:
    """The part of the plane to show, m: left, right, bottom, top. Of a belt, what lies around the hand."""
    points: list[Array] = []
    for record in records:
        shown = [record.sample_at(time) for time in times]
        points += [record.joints[: shown[-1] + 1, -1], record.target[shown]]
        if not record.picture.belt:
            points.append(record.joints[shown].reshape(-1, 2))
        points.append(record.second_arm[shown, 1:].reshape(-1, 2))
        for disc, radius in enumerate(record.radii):
            points += [record.discs[shown, disc] + radius, record.discs[shown, disc] - radius]
    low, high = np.concatenate(points).min(axis=0), np.concatenate(points).max(axis=0)
    if records[0].picture.belt:
        low, high = low - np.array([_PART, _BELOW_BELT]), high + np.array([_PART, 0.5 * _BELT])
    margin = 0.06 * float((high - low).max())
    return float(low[0]) - margin, float(high[0]) + margin, float(low[1]) - margin, float(high[1]) + margin


def _draw_panel(axes: Axes, record: EpisodeRecord, times: Array, color: Rgb, scale: float) -> None:
    """A policy's path through the plane; ``scale`` is points a metre."""
    shown, labels = _instants(record, times)
    shades = [record.t[sample] / times[-1] for sample in shown]
    if record.picture.belt:
        height = float(record.target[0, 1])
        axes.axhspan(height - 0.5 * _BELT, height + 0.5 * _BELT, color=rgb(palette.BORDER), zorder=1)
    link = max(4.0, 2.0 * record.arm.link_radius * scale)
    for sample, shade, label in zip(shown, shades, labels, strict=True):
        if record.picture.belt:
            _draw_part(axes, record.target[sample], shade, label)
        for disc, radius in enumerate(record.radii):
            _draw_disc(axes, record.discs[sample, disc], float(radius), shade, label)
        if record.second_arm.shape[1]:
            _draw_arm(axes, record.second_arm[sample], shade, link, palette.BAD)
        _draw_arm(axes, record.joints[sample], shade, link)
    until = shown[-1] + 1
    for disc in range(len(record.radii)):
        axes.plot(*record.discs[:until, disc].T, color=rgb(palette.BAD), linestyle=":", linewidth=1.3, zorder=5)
    if record.second_arm.shape[1]:
        axes.plot(*record.second_arm[:until, -1].T, color=rgb(palette.BAD), linestyle=":", linewidth=1.3, zorder=5)
    hand = record.joints[:until, -1]
    axes.plot(*hand.T, color="white", linewidth=4.0, zorder=6)
    axes.plot(*hand.T, color=color, linewidth=2.2, zorder=6)
    if _moves(record) and not record.picture.belt:
        axes.plot(*record.target[:until].T, color=rgb(palette.INK), linestyle=":", linewidth=1.1, zorder=6.5)
    for rank, (place, label) in enumerate(zip(record.joints[shown, -1], labels, strict=True)):
        axes.plot(*place, marker="o", markersize=10.5, color="white", markeredgecolor=color, zorder=7 + 0.1 * rank)
        _write(axes, place, label, color, 7.5, 7.05 + 0.1 * rank)
    if not _moves(record):
        star = {"color": rgb(palette.GOOD), "markeredgecolor": "white", "markersize": 24}
        axes.plot(*record.target[0], marker="*", zorder=6.5, **star)  # type: ignore[arg-type]
    axes.set_title(f"{record.policy}: {record.outcome}", fontsize=10, color=color, fontweight="bold")
    axes.tick_params(labelsize=8)
    axes.locator_params(nbins=4)
    axes.grid(alpha=0.25)
    axes.set_axisbelow(True)


def _instants(record: EpisodeRecord, times: Array) -> tuple[list[int], list[str]]:
    """Samples at the times, and their numbers.

    The end of an episode that ends earlier replaces the times after or just before it; it is labelled with a check mark
    if it is a success, or else with a cross.
    """
    labels = [str(rank + 1) for rank in range(len(times))]
    if record.duration >= times[-1] - 1e-9:
        return [record.sample_at(time) for time in times], labels
    before = times[times < record.duration - 0.4 * (times[1] - times[0])]
    end = "\u2713" if record.info["is_success"] else "\u00d7"
    return [record.sample_at(time) for time in (*before, record.duration)], [*labels[: len(before)], end]


def _draw_arm(axes: Axes, joints: Array, shade: float, width: float, full: Color = palette.LINK_BASE) -> None:
    color = rgb(mix(palette.BORDER, full, 0.15 + 0.85 * shade))
    zorder = 3.0 + shade
    axes.plot(*joints.T, color=color, linewidth=width, solid_capstyle="round", solid_joinstyle="round", zorder=zorder)
    axes.plot(*joints[:-1].T, color="white", marker="o", markersize=2.6, linestyle="", zorder=zorder)


def _draw_part(axes: Axes, center: Array, shade: float, label: str) -> None:
    from matplotlib.patches import Rectangle

    corner = center - 0.5 * _PART
    color = rgb(mix(palette.PANEL, palette.WAITING, 0.15 + 0.85 * shade))
    edge = rgb(mix(palette.WAITING, palette.INK, 0.4))
    axes.add_patch(Rectangle((corner[0], corner[1]), _PART, _PART, facecolor=color, edgecolor=edge, zorder=2))
    _write(axes, center + np.array([0.0, 0.75 * _PART]), label, edge, 8.5, 5.5)


def _draw_disc(axes: Axes, center: Array, radius: float, shade: float, label: str) -> None:
    from matplotlib.patches import Circle

    color = rgb(mix(palette.PANEL, palette.BAD, 0.15 + 0.85 * shade))
    axes.add_patch(Circle((center[0], center[1]), radius, facecolor=color, edgecolor=rgb(palette.BAD), zorder=2))
    _write(axes, center, label, rgb(palette.INK), 9.0, 6.6)


def _write(axes: Axes, center: Array, label: str, color: Rgb, size: float, zorder: float) -> None:
    text = axes.text(center[0], center[1], label, color=color, fontsize=size, zorder=zorder, clip_on=True)
    text.set(ha="center", va="center_baseline")


def _draw_curves(axes: Axes, records: Sequence[EpisodeRecord], times: Array, colors: Sequence[Rgb]) -> None:
    """The task's measure over time, with the instants of the panels."""
    picture = records[0].picture
    until = min(1.12 * times[-1], max(record.duration for record in records))
    for record, color in zip(records, colors, strict=True):
        shown = record.t <= until + 1e-9
        axes.plot(record.t[shown], record.measure[shown], color=color, label=record.policy, linewidth=1.8)
        if record.info["is_success"] and record.arrival < record.duration:
            axes.plot(record.arrival, record.measure[record.sample_at(record.arrival)], marker="o", color=color)
        elif record.duration < times[-1]:
            axes.plot(record.t[-1], record.measure[-1], marker="x", color=color, markersize=9, markeredgewidth=2.5)
    tolerance = records[0].tolerance
    if tolerance is not None:
        label = f"tolerance, {tolerance:g} mm"
        axes.axhline(tolerance, color=rgb(palette.MUTED), linestyle="--", linewidth=1.0, label=label)
    if picture.logarithmic:
        axes.set(yscale="log", ylim=(1e-3, None))
    for rank, time in enumerate(times):
        axes.axvline(time, color=rgb(palette.BORDER), linewidth=0.8, zorder=0)
        number = axes.text(time, 1.0, str(rank + 1), transform=axes.get_xaxis_transform(), fontsize=7.5)
        number.set(ha="center", va="center_baseline", color=rgb(palette.INK))
        number.set_bbox({"boxstyle": "circle,pad=0.2", "facecolor": "white", "edgecolor": rgb(palette.MUTED)})
    axes.set(xlim=(-0.02 * until, 1.01 * until))
    axes.set_xlabel("time (s)", fontsize=9)
    axes.set_title(picture.title, fontsize=9.5, pad=10, loc="left")
    axes.tick_params(labelsize=8)
    axes.legend(fontsize=8, ncols=5, frameon=False, loc="lower right", bbox_to_anchor=(1.0, 1.04), borderaxespad=0.0)
    axes.grid(alpha=0.2, axis="y")
