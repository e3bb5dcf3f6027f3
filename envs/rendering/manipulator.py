"""The arm: base, tapered links, joints with torque arcs, and the gripper or the bucket."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from envs.rendering import palette
from envs.rendering.camera import Camera
from envs.rendering.panel import ratio_color
from planners.typing import Array

if TYPE_CHECKING:
    from envs.rendering.canvas import Canvas

TORQUE_ARC = np.radians(120.0)
"""Length of the arc around a joint at its torque limit."""
BUCKET = np.array([[0.0, -0.06], [-0.1, 0.12], [0.0, 0.42], [0.25, 0.6], [0.55, 0.58], [0.84, 0.36], [1.0, 0.0]])
"""Outline of a bucket, joint to tip: along the line between them and to its left, in units of its length."""
HOLLOW = np.array([0.42, 0.16])
"""Centre about which the outline is scaled to that of the bucket's inside, in the same units."""


def draw_arm(
    canvas: Canvas, camera: Camera, joints: Array, torque_ratios: Array, *, closed: bool, bucket: float | None = None
) -> None:
    """The whole arm; its thickness is proportional to its reach.

    Args:
        canvas: where to draw.
        camera: metres to pixels.
        joints: positions of the joints and the hand, ``(n + 1, 2)``, m.
        torque_ratios: torque over limit, ``(n,)``, shown as arcs around the joints.
        closed: whether the gripper is closed.
        bucket: fill of the bucket that replaces the last link and its gripper.
    """
    points = camera.pixels(joints)
    reach = float(np.hypot(*np.diff(points, axis=0).T).sum())
    thickness = 0.04 * reach
    wrist = _wrist(points, thickness)
    chain = points[:-1] if bucket is not None else np.concatenate([points[:-1], [wrist]])
    radii = thickness * np.linspace(1.0, 0.55, len(chain))
    with canvas.layer(points, 3.0 * thickness):
        shift = np.array([0.18, 0.32]) * thickness
        for i in range(len(chain) - 1):
            canvas.capsule(chain[i] + shift, chain[i + 1] + shift, (radii[i], radii[i + 1]), (*palette.INK, 44))
    _draw_base(canvas, points[0], thickness)
    for i in range(len(chain) - 1):
        color = palette.mix(palette.LINK_BASE, palette.LINK_HAND, i / max(1, len(chain) - 2))
        _draw_link(canvas, chain[i], chain[i + 1], (radii[i], radii[i + 1]), color)
    if bucket is not None:
        _draw_bucket(canvas, points[-2], points[-1], thickness, bucket)
    else:
        _draw_gripper(canvas, wrist, points[-1], thickness, closed=closed)
    for joint, ratio in enumerate(torque_ratios):
        _draw_joint(canvas, points[joint], radii[joint], float(ratio))


def _wrist(points: Array, thickness: float) -> Array:
    """End of the last link, where the gripper begins."""
    last = points[-1] - points[-2]
    length = np.hypot(*last)
    wrist: Array = points[-1] - last * min(1.9 * thickness / length, 0.6)
    return wrist


def _draw_base(canvas: Canvas, center: Array, thickness: float) -> None:
    canvas.disc(center, 1.75 * thickness, palette.mix(palette.BORDER, palette.MUTED, 0.35))
    canvas.disc(center, 1.6 * thickness, palette.BORDER)
    for direction in np.radians(45.0 + 90.0 * np.arange(4)):
        bolt = center + 1.33 * thickness * np.array([np.cos(direction), np.sin(direction)])
        canvas.disc(bolt, 0.14 * thickness, palette.MUTED)


def _draw_link(canvas: Canvas, first: Array, second: Array, radii: tuple[float, float], color: palette.Color) -> None:
    canvas.capsule(first, second, radii, color)
    inlay = palette.mix(color, palette.PANEL, 0.16)
    along = second - first
    canvas.capsule(first + 0.14 * along, second - 0.14 * along, (0.42 * radii[0], 0.42 * radii[1]), inlay)


def _draw_joint(canvas: Canvas, center: Array, radius: float, ratio: float) -> None:
    canvas.disc(center, 0.62 * radius, palette.JOINT)
    length = TORQUE_ARC * min(abs(ratio), 1.25)
    if length > 0.05:
        ends = (np.pi / 2.0, np.pi / 2.0 + np.copysign(length, ratio))
        canvas.arc(center, 1.45 * radius, 0.55 * radius, ends, palette.JOINT)  # sets the arc off from the links
        canvas.arc(center, 1.45 * radius, 0.3 * radius, ends, ratio_color(ratio))


def _draw_gripper(canvas: Canvas, wrist: Array, hand: Array, thickness: float, *, closed: bool) -> None:
    """A palm across the wrist, two fingers around the hand, and a dot at the hand itself."""
    along = (hand - wrist) / max(float(np.hypot(*(hand - wrist))), 1e-9)
    across = np.array([-along[1], along[0]])
    opening = (0.95 if closed else 1.25) * thickness
    width = 0.36 * thickness
    canvas.disc(wrist, 0.68 * thickness, palette.LINK_BASE)
    canvas.line(wrist - opening * across, wrist + opening * across, 1.3 * width, palette.LINK_BASE)
    for side in (-1.0, 1.0):
        root = wrist + side * opening * across
        tip = hand + side * opening * across + 0.5 * thickness * along
        canvas.line(root, tip, width, palette.LINK_BASE)
        canvas.line(tip, tip - side * 0.2 * thickness * across, width, palette.LINK_BASE)
    canvas.disc(hand, 0.34 * thickness, palette.PANEL)
    canvas.disc(hand, 0.25 * thickness, palette.HAND)


def _draw_bucket(canvas: Canvas, joint: Array, tip: Array, thickness: float, full: float) -> None:
    """A bucket from the side with its content, and a dot at its tip."""
    along = tip - joint
    axes = np.stack([along, [along[1], -along[0]]])  # pixels run down, so this is to the left
    shell = joint + BUCKET @ axes
    canvas.polygon(shell, palette.LINK_BASE)
    inside = joint + (HOLLOW + 0.82 * (BUCKET - HOLLOW)) @ axes
    canvas.polygon(inside, palette.mix(palette.LINK_BASE, palette.PANEL, 0.25))
    if full > 0.0:
        heap = np.concatenate([[[0.1, 0.0], [0.45, -0.12], [0.9, 0.0]], BUCKET[5:1:-1]])
        middle = np.array([0.45, 0.4])
        canvas.polygon(joint + (middle + 0.8 * np.sqrt(full) * (heap - middle)) @ axes, palette.EARTH)
    canvas.disc(tip, 0.34 * thickness, palette.PANEL)
    canvas.disc(tip, 0.25 * thickness, palette.HAND)
