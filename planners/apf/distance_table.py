"""The distance function of the paper (eq 20): a table that reduces the distance of approaching discs.

T. H. Kim, M. S. Park, S. Y. Song, S. K. Hong, "Collision-Free Trajectory Planning for SCARA robot", takes the distance
to a moving obstacle as ``rho = dist{rho_i, ..., delta rho_j, ...}`` (eq 20), with values looked up by the obstacle's
motion relative to the hand; it prints none of them. Here they follow from a look-ahead time ``T``. A disc with relative
speed v at the angle beta to the straight line to the hand changes its distance within T by

    delta rho(v, beta) = -T v cos(beta)          to first order in v T / rho.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from planners.checks import require_finite
from planners.compiled.calls import private
from planners.problem import ByValue
from planners.typing import Array


@dataclass(frozen=True, eq=False)
class DistanceTable(ByValue):
    """Shifts of the distance of a moving disc.

    Attributes:
        shifts: delta rho, m: rows for relative speeds from 0 to ``max_speed`` in even steps, columns for directions
            from 0 (straight at the hand) to pi (straight away) in even steps; at least 2 by 2. The first row is 0.
        max_speed: of the last row, which also holds for faster discs, m/s.
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
    def looking_ahead(
        cls, time: float, max_speed: float = 3.0, speeds: int = 13, directions: int = 19
    ) -> DistanceTable:
        """The table ``-T v cos(beta)`` for a look-ahead ``time`` T, s; with 0 the plain distance (eq 10).

        Raises:
            ValueError: if the time is negative or not finite, or the table has fewer than 2 rows or columns.
        """
        if not (math.isfinite(time) and time >= 0.0):
            raise ValueError(f"time {time} s must be finite and not negative")
        speed, direction = np.linspace(0.0, max_speed, speeds), np.linspace(0.0, np.pi, directions)
        return cls(-time * np.outer(speed, np.cos(direction)), max_speed)

    def shift(self, speed: float, direction: float) -> float:
        """delta rho, m, at a relative speed (m/s) and direction (rad, either side): bilinear between the entries."""
        require_finite("speed", speed, "m/s", "not negative")
        require_finite("direction", direction, "rad")
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


@private
def disc_shift(shifts: Array, max_speed: float, dx: float, dy: float, vx: float, vy: float) -> float:
    """delta rho, m, of a disc that has the hand at ``(dx, dy)`` m and moves at ``(vx, vy)`` relative to it."""
    direction = np.arctan2(vx * dy - vy * dx, vx * dx + vy * dy)
    return look_up(shifts, max_speed, np.hypot(vx, vy), direction)
