"""The side panel: clock, joint torques, limits and status lines."""

from __future__ import annotations

from typing import TYPE_CHECKING

from envs.rendering import palette
from envs.rendering.scene import Scene

if TYPE_CHECKING:
    from envs.rendering.canvas import Canvas

FULL_SCALE = 1.25
"""Ratio at the end of a bar: past the limit, so that a violation is visible."""


class Panel:
    """A column on the right of the picture, filled from top to bottom.

    Args:
        canvas: where to draw.
        width: of the column, pixels.
        unit: size of a "pixel" of the design, pixels.
    """

    def __init__(self, canvas: Canvas, width: float, unit: float) -> None:
        self._canvas, self._unit = canvas, unit
        self._edge = canvas.size[0] - width
        self._left, self._right = self._edge + 24.0 * unit, canvas.size[0] - 24.0 * unit
        self._y = 0.0

    def draw_backdrop(self) -> None:
        """The empty panel."""
        width, height = self._canvas.size
        for edge, color in ((self._edge, palette.BORDER), (self._edge + self._unit, palette.PANEL)):
            self._canvas.polygon([(edge, 0), (width, 0), (width, height), (edge, height)], color)

    def draw(self, scene: Scene) -> None:
        """Clock, torques, limits and status of a scene."""
        self._y = 34.0 * self._unit
        self._write(scene.title, 26, palette.INK)
        self._y += 38.0 * self._unit
        self._clock(scene.time, scene.horizon)
        self._heading("JOINT TORQUE")
        for joint, ratio in enumerate(scene.torque_ratios, start=1):
            self._two_sided_bar(f"joint {joint}", float(ratio))
        if scene.limit_gauges:
            self._heading("USE OF LIMITS")
            for label, ratio in scene.limit_gauges:
                self._gauge(label, ratio)
        if scene.status:
            self._heading("STATUS")
            for label, value, good in scene.status:
                self._status(label, value, good)

    def _write(self, text: str, height: float, color: palette.Color, *, indent: float = 0.0, tail: str = "") -> None:
        """A line of text at the current height, and ``tail`` at its right end."""
        unit, taken = self._unit, 0.0
        if tail:
            place = (self._right, self._y)
            taken = 10.0 * unit + self._canvas.text(tail, place, height * unit, palette.INK, anchor="right")
        left = self._left + indent * unit
        self._canvas.text(text, (left, self._y), height * unit, color, max_width=self._right - left - taken)

    def _heading(self, text: str) -> None:
        self._y += 14.0 * self._unit
        self._write(text, 15, palette.MUTED)
        self._y += 25.0 * self._unit

    def _clock(self, time: float, horizon: float) -> None:
        self._write("time", 18, palette.MUTED, tail=f"{time:.2f} / {horizon:.2f} s")
        self._y += 16.0 * self._unit
        self._track()
        share = min(max(time / horizon, 0.0), 1.0)
        self._bar(self._left, share * (self._right - self._left), palette.ACCENT)
        self._y += 26.0 * self._unit

    def _two_sided_bar(self, label: str, ratio: float) -> None:
        self._labelled_track(label, f"{100.0 * ratio:+.0f} %")
        middle, half = (self._left + self._right) / 2.0, (self._right - self._left) / 2.0
        length = min(abs(ratio) / FULL_SCALE, 1.0) * half
        self._bar(middle if ratio > 0.0 else middle - length, length, ratio_color(ratio))
        self._mark(middle, palette.INK)
        self._mark(middle - half / FULL_SCALE, palette.MUTED)
        self._mark(middle + half / FULL_SCALE, palette.MUTED)
        self._y += 23.0 * self._unit

    def _gauge(self, label: str, ratio: float) -> None:
        self._labelled_track(label, f"{100.0 * ratio:.0f} %")
        width = self._right - self._left
        self._bar(self._left, min(max(ratio, 0.0) / FULL_SCALE, 1.0) * width, ratio_color(ratio))
        self._mark(self._left + width / FULL_SCALE, palette.MUTED)
        self._y += 23.0 * self._unit

    def _status(self, label: str, value: str, good: bool) -> None:
        unit = self._unit
        self._canvas.disc((self._left + 5.0 * unit, self._y), 5.0 * unit, palette.GOOD if good else palette.WAITING)
        self._write(label, 18, palette.INK, indent=20.0, tail=value)
        self._y += 25.0 * unit

    def _labelled_track(self, label: str, value: str) -> None:
        self._write(label, 18, palette.INK, tail=value)
        self._y += 15.0 * self._unit
        self._track()

    def _track(self) -> None:
        self._bar(self._left, self._right - self._left, palette.TRACK)

    def _bar(self, left: float, length: float, color: palette.Color) -> None:
        self._canvas.bar(left, self._y - 3.5 * self._unit, length, 7.0 * self._unit, color)

    def _mark(self, x: float, color: palette.Color) -> None:
        top, bottom = self._y - 6.0 * self._unit, self._y + 6.0 * self._unit
        half = 0.75 * self._unit
        self._canvas.polygon([(x - half, top), (x + half, top), (x + half, bottom), (x - half, bottom)], color)


def ratio_color(ratio: float) -> palette.Color:
    """Colour of a bar: blue within the limit, red past it."""
    # A ratio that is printed as 100 % does not count as past it.
    return palette.ACCENT if round(abs(ratio), 2) <= 1.0 else palette.BAD
