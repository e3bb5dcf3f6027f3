"""A picture drawn at three times its size and scaled down, which smooths every edge."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from typing import Literal

os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")

import numpy as np
import pygame
from numpy.typing import ArrayLike, NDArray

from envs.rendering.palette import Color
from planners.typing import Array

SUPERSAMPLING = 3
ELLIPSIS = "..."
Anchor = Literal["left", "center", "right"]
SHIFT: dict[Anchor, float] = {"left": 0.0, "center": 0.5, "right": 1.0}


class Canvas:
    """Shapes and text in pixels of the finished picture, fractions allowed.

    Colours are (red, green, blue) or, inside :meth:`layer`, also (red, green, blue, alpha).

    Args:
        size: width and height of the finished picture, pixels.
    """

    def __init__(self, size: tuple[int, int]) -> None:
        pygame.font.init()
        self.size = size
        self._large = pygame.Surface((size[0] * SUPERSAMPLING, size[1] * SUPERSAMPLING), depth=32)
        self._finished = pygame.Surface(size, depth=32)
        self._target, self._origin = self._large, np.zeros(2)
        self._font = lru_cache(maxsize=16)(lambda height: pygame.font.Font(None, height))
        self._render = lru_cache(maxsize=512)(lambda text, height, color: self._font(height).render(text, True, color))

    def fill(self, color: Color) -> None:
        """Fill the canvas."""
        self._target.fill(color)

    def polygon(self, corners: ArrayLike, color: Color) -> None:
        """A filled polygon with ``corners`` ``(k, 2)``."""
        pygame.draw.polygon(self._target, color, self._large_pixels(corners).tolist())

    def ribbon(self, path: Array, widths: Array, colors: Sequence[Color]) -> None:
        """A band along ``path`` ``(k, 2)``, ``widths`` ``(k,)`` across, one colour for each of its k - 1 pieces."""
        along = np.gradient(path, axis=0)
        across = np.stack([-along[:, 1], along[:, 0]], axis=-1) / np.maximum(np.hypot(*along.T), 1e-9)[:, None]
        offset = 0.5 * widths[:, None] * across
        left, right = path + offset, path - offset
        pieces = np.stack([left[:-1], left[1:], right[1:], right[:-1]], axis=1)
        for corners, color in zip(self._large_pixels(pieces).tolist(), colors, strict=True):
            pygame.draw.polygon(self._target, color, corners)

    def disc(self, center: ArrayLike, radius: float, color: Color) -> None:
        """A filled circle."""
        pygame.draw.circle(self._target, color, self._large_pixels(center).tolist(), radius * SUPERSAMPLING)

    def ring(self, center: ArrayLike, radius: float, width: float, color: Color) -> None:
        """A circle line of outer ``radius``."""
        line = max(1, round(width * SUPERSAMPLING))
        pygame.draw.circle(self._target, color, self._large_pixels(center).tolist(), radius * SUPERSAMPLING, line)

    def bar(self, left: float, top: float, width: float, height: float, color: Color) -> None:
        """A filled rectangle with round ends."""
        if width > 0.0:
            area = (max(1, round(width * SUPERSAMPLING)), max(1, round(height * SUPERSAMPLING)))
            corner = self._large_pixels([left, top]).tolist()
            pygame.draw.rect(self._target, color, pygame.Rect(corner, area), border_radius=min(area) // 2)

    def capsule(self, first: ArrayLike, second: ArrayLike, radii: tuple[float, float], color: Color) -> None:
        """The hull of a disc of ``radii[0]`` around ``first`` and one of ``radii[1]`` around ``second``."""
        a, b = np.asarray(first, dtype=float), np.asarray(second, dtype=float)
        distance = float(np.hypot(*(b - a)))
        if distance > abs(radii[0] - radii[1]):
            along = (b - a) / distance
            across = np.array([-along[1], along[0]])
            # the outer tangents touch both discs where the outward normal leans by (r0 - r1) / distance
            lean = (radii[0] - radii[1]) / distance
            upright = np.sqrt(1.0 - lean**2)
            left, right = lean * along + upright * across, lean * along - upright * across
            self.polygon([a + radii[0] * left, b + radii[1] * left, b + radii[1] * right, a + radii[0] * right], color)
        self.disc(a, radii[0], color)
        self.disc(b, radii[1], color)

    def line(self, first: ArrayLike, second: ArrayLike, width: float, color: Color) -> None:
        """A straight line with round ends."""
        self.capsule(first, second, (width / 2.0, width / 2.0), color)

    def arc(self, center: ArrayLike, radius: float, width: float, angles: tuple[float, float], color: Color) -> None:
        """Part of a ring of mean ``radius`` between two ``angles``, rad counter-clockwise from the right."""
        turns = np.linspace(*angles, max(2, int(abs(angles[1] - angles[0]) * 12)))
        directions = np.stack([np.cos(turns), -np.sin(turns)], axis=-1)
        middle = np.asarray(center, dtype=float)
        outer = middle + (radius + width / 2.0) * directions
        inner = middle + (radius - width / 2.0) * directions
        self.polygon(np.concatenate([outer, inner[::-1]]), color)

    def text(
        self,
        text: str,
        position: tuple[float, float],
        height: float,
        color: Color,
        *,
        anchor: Anchor = "left",
        max_width: float = np.inf,
    ) -> float:
        """Text with its middle line at ``position``, shortened to ``max_width``.

        Returns:
            Its width, pixels.
        """
        size = max(6, round(height * SUPERSAMPLING))
        shown = text
        while len(shown) > 1 and self._font(size).size(shown)[0] > max_width * SUPERSAMPLING:
            shown = shown.removesuffix(ELLIPSIS)[:-1] + ELLIPSIS
        image = self._render(shown, size, color)
        left, top = self._large_pixels(position) - [SHIFT[anchor] * image.get_width(), image.get_height() / 2.0]
        self._target.blit(image, (round(left), round(top)))
        return image.get_width() / SUPERSAMPLING

    @contextmanager
    def layer(self, corners: ArrayLike, margin: float) -> Iterator[None]:
        """Draw translucent shapes that do not darken each other where they overlap.

        Args:
            corners: points ``(k, 2)`` whose bounding box, widened by ``margin`` pixels, contains the shapes.
            margin: pixels.
        """
        points = self._large_pixels(corners)
        low, high = points.min(axis=0) - margin * SUPERSAMPLING, points.max(axis=0) + margin * SUPERSAMPLING
        box = pygame.Rect(*low.tolist(), *(high - low).tolist()).clip(self._large.get_rect())
        sheet = pygame.Surface(box.size, pygame.SRCALPHA)
        self._target, self._origin = sheet, np.array(box.topleft, dtype=float)
        try:
            yield
        finally:
            self._target, self._origin = self._large, np.zeros(2)
        self._large.blit(sheet, box.topleft)

    def finish(self) -> pygame.Surface:
        """The finished picture."""
        pygame.transform.smoothscale(self._large, self.size, self._finished)
        return self._finished

    def _large_pixels(self, points: ArrayLike) -> Array:
        """Coordinates on the large surface, clipped to the range of C integers."""
        place: Array = np.rint(np.minimum(np.maximum(np.asarray(points) * SUPERSAMPLING, -1e4), 1e4)) - self._origin
        return place


def pixels_of(picture: pygame.Surface) -> NDArray[np.uint8]:
    """A copy of the picture as an array, ``(height, width, 3)``."""
    width, height = picture.get_size()
    flat = np.frombuffer(pygame.image.tobytes(picture, "RGB"), dtype=np.uint8)
    return flat.reshape(height, width, 3).copy()
