"""Distance between an arm, whose links are capsules, and a disc, and between two segments, in closed form."""

from __future__ import annotations

import numpy as np
from numba import njit

from planners.compiled.calls import private
from planners.typing import Array

Point = tuple[float, float]


@private
def clearance_single(
    lengths: Array, base: Array, link_radius: float, q: Array, x: float, y: float, radius: float
) -> float:
    """Distance between the surfaces of one arm in posture ``q``, ``(n,)``, and of the disc at ``(x, y)``, m."""
    nearest = np.inf
    ax, ay, phi = base[0], base[1], 0.0
    for i in range(q.shape[0]):
        phi += q[i]
        bx, by = ax + lengths[i] * np.cos(phi), ay + lengths[i] * np.sin(phi)
        dx, dy = bx - ax, by - ay
        # the point of the link closest to the disc, as a share of its length
        s = min(1.0, max(0.0, ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy)))
        dx, dy = x - ax - s * dx, y - ay - s * dy
        nearest = min(nearest, dx * dx + dy * dy)
        ax, ay = bx, by
    return float(np.sqrt(nearest)) - link_radius - radius


@njit(cache=True, nogil=True)
def clearance(lengths: Array, base: Array, link_radius: float, q: Array, centers: Array, radius: float) -> Array:
    """Clearances ``(batch,)``, m, for ``q`` of ``(batch, n)`` and discs at ``(batch, 2)``."""
    gaps = np.empty(q.shape[0])
    for row in range(q.shape[0]):
        gaps[row] = clearance_single(lengths, base, link_radius, q[row], centers[row, 0], centers[row, 1], radius)
    return gaps


@private
def segment_distance(a: Point, b: Point, c: Point, d: Point) -> float:
    """Distance between the segments from ``a`` to ``b`` and from ``c`` to ``d``, points ``(x, y)``, m; 0 if they cross.

    Segments that do not cross are nearest at an end of one of them.
    """
    sides = _side(a, b, c) * _side(a, b, d), _side(c, d, a) * _side(c, d, b)
    if sides[0] < 0.0 and sides[1] < 0.0:
        return 0.0
    squares = min(_to_segment(a, c, d), _to_segment(b, c, d)), min(_to_segment(c, a, b), _to_segment(d, a, b))
    return float(np.sqrt(min(squares)))


@njit(cache=True, nogil=True, inline="always")
def _side(a: Point, b: Point, point: Point) -> float:
    """Positive to the left of the line from ``a`` to ``b``, negative to its right."""
    return (b[0] - a[0]) * (point[1] - a[1]) - (b[1] - a[1]) * (point[0] - a[0])


@private
def _to_segment(point: Point, a: Point, b: Point) -> float:
    """Squared distance from a point to the segment from ``a`` to ``b``, m^2."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    s = min(1.0, max(0.0, ((point[0] - a[0]) * dx + (point[1] - a[1]) * dy) / (dx * dx + dy * dy)))
    dx, dy = point[0] - a[0] - s * dx, point[1] - a[1] - s * dy
    return dx * dx + dy * dy
