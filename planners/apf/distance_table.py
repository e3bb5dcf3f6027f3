"""The distance function of the paper (eq 20): a table that brings approaching discs nearer and sends others away.

"Collision-Free Trajectory Planning for SCARA robot" (T. H. Kim, M. S. Park, S. Y. Song, S. K. Hong) measures the
distance to a moving obstacle as ``rho = dist{rho_i, ..., delta rho_j, ...}`` (eq 20), values looked up by how
the obstacle moves relative to the hand. It prints none of them; they were found by experience. Here they follow from
one number with a meaning, the time ``T`` by which the hand wants to be early: a disc at relative speed v whose course
makes the angle beta with the straight line to the hand will, after T, have changed its distance by

    delta rho(v, beta) = -T v cos(beta)          to first order in v T / rho,

so it counts as that much nearer now (farther when it goes away). Only the closing speed ``v cos(beta)`` enters, which a
table filled with other numbers need not keep to.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from planners.typing import Array


@dataclass(frozen=True)
class DistanceTable:
    """How much farther away a moving disc counts than it is.

    Attributes:
        shifts: delta rho, m: rows for relative speeds from 0 to ``max_speed`` at even steps, columns for directions
            from 0 (straight at the hand) to pi (straight away from it) at even steps; at least 2 by 2. The first row
            is 0: a disc at rest has no direction.
        max_speed: of the last row, m/s; faster discs count as this fast.
    """

    shifts: Array
    max_speed: float

    def __post_init__(self) -> None:
        shifts = np.array(self.shifts, dtype=float)
        if shifts.ndim != 2 or min(shifts.shape) < 2:
            raise ValueError(f"shifts have shape {shifts.shape}; give (speeds, directions), at least (2, 2)")
        if not np.isfinite(shifts).all():
            raise ValueError("shifts must be finite")
        if shifts[0].any():
            raise ValueError(f"the first row of the shifts, {shifts[0]}, is for a disc at rest and must be 0")
        if not (math.isfinite(self.max_speed) and self.max_speed > 0.0):
            raise ValueError(f"max_speed {self.max_speed} m/s must be finite and positive")
        shifts.setflags(write=False)
        object.__setattr__(self, "shifts", shifts)

    @classmethod
    def static(cls) -> DistanceTable:
        """The plain distance (eq 10), whatever moves."""
        return cls(np.zeros((2, 2)), 1.0)

    @classmethod
    def looking_ahead(
        cls, time: float, max_speed: float = 3.0, speeds: int = 13, directions: int = 19
    ) -> DistanceTable:
        """The table ``-time v cos(beta)``: see the head of this module.

        Args:
            time: T, s.
            max_speed: m/s.
            speeds: number of rows.
            directions: number of columns; an odd number has one for a disc that passes by, which is at its distance.

        Raises:
            ValueError: if the time is negative or not finite, or the table has fewer than 2 rows or columns.
        """
        if not (math.isfinite(time) and time >= 0.0):
            raise ValueError(f"time {time} s must be finite and not negative")
        speed, direction = np.linspace(0.0, max_speed, speeds), np.linspace(0.0, np.pi, directions)
        return cls(-time * np.outer(speed, np.cos(direction)), max_speed)

    def shift(self, speed: float, direction: float) -> float:
        """delta rho, m, at a relative speed (m/s) and direction (rad, either side): bilinear between the entries."""
        return float(look_up(self.shifts, self.max_speed, speed, direction))


@njit(cache=True, nogil=True)
def look_up(shifts: Array, max_speed: float, speed: float, direction: float) -> float:
    """See :meth:`DistanceTable.shift`; ``direction`` within -pi to pi."""
    rows, columns = shifts.shape
    row = min(speed / max_speed, 1.0) * (rows - 1)
    column = min(abs(direction) / np.pi, 1.0) * (columns - 1)
    i, j = min(int(row), rows - 2), min(int(column), columns - 2)
    u, w = row - i, column - j
    slower = (1.0 - w) * shifts[i, j] + w * shifts[i, j + 1]
    faster = (1.0 - w) * shifts[i + 1, j] + w * shifts[i + 1, j + 1]
    return float((1.0 - u) * slower + u * faster)


@njit(cache=True, nogil=True)
def disc_shift(shifts: Array, max_speed: float, dx: float, dy: float, vx: float, vy: float) -> float:
    """delta rho, m, of a disc that sees the hand at ``(dx, dy)`` m and moves at ``(vx, vy)`` m/s relative to it."""
    direction = np.arctan2(vx * dy - vy * dx, vx * dx + vy * dy)
    return look_up(shifts, max_speed, np.hypot(vx, vy), direction)
