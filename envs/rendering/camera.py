"""From metres to pixels."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from planners.typing import Array


class Camera:
    """Maps a rectangle of the plane to a rectangle of the picture, undistorted and centred.

    Args:
        view: visible rectangle ``(xmin, xmax, ymin, ymax)``, m.
        size: width and height of the picture's part, from its top left corner, pixels.
    """

    def __init__(self, view: tuple[float, float, float, float], size: tuple[float, float]) -> None:
        xmin, xmax, ymin, ymax = view
        if not (np.isfinite(view).all() and xmin < xmax and ymin < ymax):
            raise ValueError(
                f"view {view} must be (xmin, xmax, ymin, ymax) with xmin < xmax and ymin < ymax, in metres"
            )
        self.scale = min(size[0] / (xmax - xmin), size[1] / (ymax - ymin))
        self.size = size
        self._center = np.array([(xmin + xmax) / 2.0, (ymin + ymax) / 2.0])

    def pixels(self, points: ArrayLike) -> Array:
        """Pixel coordinates, x to the right and y down, of points ``(..., 2)`` in metres."""
        offset = (np.asarray(points, dtype=float) - self._center) * self.scale
        place: Array = np.array(self.size) / 2.0 + offset * [1.0, -1.0]
        return place

    @property
    def visible(self) -> tuple[Array, Array]:
        """Lower left and upper right corner of the visible rectangle, m."""
        half = np.array(self.size) / (2.0 * self.scale)
        return self._center - half, self._center + half

    def nice_step(self, pixels: float) -> float:
        """The smallest round length (1, 2 or 5 times a power of ten, m) of at least ``pixels`` in the picture."""
        decade = 10.0 ** np.floor(np.log10(pixels / self.scale))
        return float(next(step * decade for step in (1.0, 2.0, 5.0, 10.0) if step * decade * self.scale >= pixels))
