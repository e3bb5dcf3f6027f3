"""Distance between an arm, whose links are capsules, and a disc, in closed form."""

from __future__ import annotations

import numpy as np
from numba import njit

from planners.typing import Array


@njit(cache=True, nogil=True)
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
