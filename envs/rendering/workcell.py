"""Surroundings of the arm: floor, belt, part, obstacles, target, and the trail of the hand."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from envs.rendering import palette
from envs.rendering.camera import Camera
from envs.rendering.scene import Belt
from planners.typing import Array

if TYPE_CHECKING:
    from envs.rendering.canvas import Canvas

STRIPE_SPACING = 0.12
PART_SIZE = 0.11
TRAIL_POINTS = 120


def draw_floor(canvas: Canvas, camera: Camera, joints: Array, unit: float) -> None:
    """Floor, reach of the arm, grid, and the length of a grid step."""
    canvas.fill(palette.FLOOR)
    base, reach = camera.pixels(joints[0]), float(np.hypot(*np.diff(joints, axis=0).T).sum()) * camera.scale
    canvas.disc(base, reach, palette.BORDER)
    canvas.disc(base, reach - 1.5 * unit, palette.WORKSPACE)
    low, high = camera.visible
    step = camera.nice_step(48.0 * unit)
    for axis in (0, 1):
        for tick in np.arange(np.ceil(low[axis] / step), np.floor(high[axis] / step) + 1.0) * step:
            ends = np.array([low, high])
            ends[:, axis] = tick
            first, last = camera.pixels(ends)
            canvas.line(first, last, (1.0 if abs(tick) > 1e-9 else 2.0) * unit, palette.GRID)
    _draw_scale(canvas, camera, step, unit)


def draw_ground(canvas: Canvas, camera: Camera, height: float, unit: float) -> None:
    """The surface of the ground and, translucent, the earth below."""
    low, high = camera.visible
    below = camera.pixels([[low[0], height], [high[0], height], [high[0], low[1]], [low[0], low[1]]])
    with canvas.layer(below, 0.0):
        canvas.polygon(below, (*palette.EARTH, 60))
    canvas.line(below[0], below[1], 2.0 * unit, palette.EARTH)


def _draw_scale(canvas: Canvas, camera: Camera, length: float, unit: float) -> None:
    left, y = 20.0 * unit, camera.size[1] - 20.0 * unit
    right = left + length * camera.scale
    canvas.line((left, y), (right, y), 2.0 * unit, palette.MUTED)
    for x in (left, right):
        canvas.line((x, y - 4.0 * unit), (x, y + 4.0 * unit), 2.0 * unit, palette.MUTED)
    canvas.text(f"{length:g} m", ((left + right) / 2.0, y - 12.0 * unit), 17.0 * unit, palette.MUTED, anchor="center")


def draw_belt(canvas: Canvas, camera: Camera, belt: Belt) -> None:
    """The conveyor from above: rails, chevrons that move with the belt, and a roller at either end."""
    start, end = np.asarray(belt.start, dtype=float), np.asarray(belt.end, dtype=float)
    length = float(np.hypot(*(end - start)))
    if length == 0.0:
        raise ValueError(f"the belt starts and ends at {start} m; its ends must differ")
    along = (end - start) / length
    frame = np.stack([along, [-along[1], along[0]]])
    half, roller = belt.width / 2.0, 0.2 * belt.width

    def box(low: float, high: float, half_width: float, color: palette.Color) -> None:
        corners = np.array([[low, -half_width], [high, -half_width], [high, half_width], [low, half_width]])
        canvas.polygon(camera.pixels(start + corners @ frame), color)

    rail = 0.1 * belt.width
    box(-roller, length + roller, half + rail, palette.BELT_RAIL)
    box(0.0, length, half, palette.BELT)
    chevron = np.array([[0.0, -1.0], [0.3, 0.0], [0.0, 1.0], [0.14, 1.0], [0.44, 0.0], [0.14, -1.0]]) * half * 0.72
    for offset in np.arange(belt.travel % STRIPE_SPACING - STRIPE_SPACING, length, STRIPE_SPACING):
        corners = chevron + np.array([offset, 0.0])
        corners[:, 0] = np.clip(corners[:, 0], 0.0, length)
        canvas.polygon(camera.pixels(start + corners @ frame), palette.BELT_STRIPE)
    for place in (0.0, length):
        box(place - roller, place + roller, half, palette.ROLLER)
        # light lines wander over the roller as it turns
        for phase in np.arange(4) * np.pi / 2.0 + belt.travel / roller:
            if np.cos(phase) > 0.0:
                shine = place + roller * np.sin(phase)
                width = 0.1 * roller * np.cos(phase)
                box(shine - width, shine + width, 0.94 * half, palette.ROLLER_SHINE)


def draw_part(canvas: Canvas, camera: Camera, position: Array, unit: float, *, settled: bool) -> None:
    """A box seen from above, amber until it is settled, then green."""
    center = camera.pixels(position)
    half = max(PART_SIZE / 2.0 * camera.scale, 5.0 * unit)
    square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    color = palette.GOOD if settled else palette.WAITING
    with canvas.layer([center], 2.0 * half):
        canvas.polygon(center + np.array([2.0, 3.0]) * unit + half * square, (*palette.INK, 70))
    canvas.polygon(center + half * square, palette.mix(color, palette.INK, 0.35))
    canvas.polygon(center + (half - 1.5 * unit) * square, color)
    canvas.polygon(center + half * square * [0.62, 0.14], palette.mix(color, palette.PANEL, 0.35))


def draw_target(canvas: Canvas, camera: Camera, position: Array, unit: float) -> None:
    """A cross-hair."""
    center = camera.pixels(position)
    canvas.ring(center, 13.0 * unit, 2.5 * unit, palette.GOOD)
    canvas.disc(center, 3.5 * unit, palette.GOOD)
    for direction in np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]]):
        canvas.line(center + 9.0 * unit * direction, center + 18.0 * unit * direction, 2.5 * unit, palette.GOOD)


def draw_obstacles(
    canvas: Canvas, camera: Camera, obstacles: Sequence[tuple[float, float, float]], unit: float
) -> None:
    """The obstacle discs."""
    for x, y, radius in obstacles:
        center, pixels = camera.pixels([x, y]), radius * camera.scale
        with canvas.layer([center], pixels + 6.0 * unit):
            canvas.disc(center + np.array([2.0, 4.0]) * unit, pixels, (*palette.INK, 40))
        canvas.disc(center, pixels, palette.BAD)
        canvas.disc(center, pixels - 2.5 * unit, palette.mix(palette.BAD, palette.PANEL, 0.62))
        canvas.disc(center, 0.35 * pixels, palette.mix(palette.BAD, palette.PANEL, 0.3))


def draw_second_arm(canvas: Canvas, camera: Camera, joints: Sequence[tuple[float, float, float]], unit: float) -> None:
    """The capsules of an arm to avoid, in the colours of the discs."""
    if not joints:
        return
    points = camera.pixels([joint[:2] for joint in joints])
    radius = max(radius for *_, radius in joints) * camera.scale
    canvas.disc(points[0], 1.6 * radius, palette.BORDER)
    for color, thinner in ((palette.BAD, 0.0), (palette.mix(palette.BAD, palette.PANEL, 0.62), 2.5 * unit)):
        for first, second in pairwise(points):
            canvas.capsule(first, second, (radius - thinner, radius - thinner), color)
    for point in points:
        canvas.disc(point, 0.35 * radius, palette.mix(palette.BAD, palette.PANEL, 0.3))


def draw_trail(canvas: Canvas, camera: Camera, trail: Array, unit: float) -> None:
    """Past positions of the hand, fading with age."""
    if len(trail) < 2:
        return
    shown = np.unique(np.linspace(0, len(trail) - 1, TRAIL_POINTS).astype(int))
    path = camera.pixels(trail[shown])
    youth = np.linspace(0.0, 1.0, len(path))
    with canvas.layer(path, 4.0 * unit):
        canvas.ribbon(path, (2.0 + 2.5 * youth) * unit, [(*palette.HAND, round(20 + 210 * y)) for y in youth[1:]])
