"""Predicts the motion of discs: each approaches its own target velocity with a first-order lag.

The target velocity is the present one plus the remaining change, ``lag`` times the acceleration. Discs slide along the
ring around the base that they do not enter. The velocity observed there does not show the target velocity, so the last
one observed outside is kept.
"""

from __future__ import annotations

import math
from typing import Any

from numpy.typing import NDArray

from planners.compiled.calls import private
from planners.typing import Array


@private
def observe_discs(gains: Any, record: Any, positions: Array, velocities: Array, period: float, trends: Array) -> None:
    """Estimate the target velocity of each disc of a row, and the remaining change.

    Args:
        gains, record: of `DodgeGains`, and the row's memory, whose ``disc_velocity`` is updated.
        positions, velocities: of the discs, ``(discs, 2)``, m from the base and m/s.
        period: time since the last call, s.
        trends: filled in with velocity and change, ``(discs, 4)``, m/s.
    """
    sliding = (gains.nearest + 1e-3) ** 2
    for disc in range(positions.shape[0]):
        outside = positions[disc, 0] ** 2 + positions[disc, 1] ** 2 > sliding
        for axis in range(2):
            change = 0.0
            if outside or not record.begun:
                if record.begun:
                    change = gains.lag / period * (velocities[disc, axis] - record.disc_velocity[disc, axis])
                record.disc_velocity[disc, axis] = velocities[disc, axis]
            trends[disc, axis], trends[disc, 2 + axis] = record.disc_velocity[disc, axis] + change, change


@private
def predict_discs(gains: Any, instants: NDArray[Any], positions: Array, trends: Array, places: Array) -> None:
    """Predict the positions of the discs of one row, between `nearest` and `farthest` from the base.

    ``instants`` are an array of `planners.apf.dodge.gains.INSTANTS`, ``trends`` are from `observe_discs`; the present
    ``positions``, ``(discs, 2)``, and the predicted ``places``, ``(steps, discs, 2)``, are m from the base.
    """
    inner, outer = gains.nearest * gains.nearest, gains.farthest * gains.farthest
    for disc in range(positions.shape[0]):
        x, y = positions[disc, 0], positions[disc, 1]
        vx, vy, change_x, change_y = trends[disc]
        for step in range(places.shape[0]):
            x += instants[step].travel * vx - instants[step].settling * change_x
            y += instants[step].travel * vy - instants[step].settling * change_y
            square = x * x + y * y
            if square < inner or square > outer:
                away = math.sqrt(square)
                scale = min(gains.farthest, max(gains.nearest, away)) / max(away, 1e-9)
                x, y = scale * x, scale * y
            places[step, disc, 0], places[step, disc, 1] = x, y
