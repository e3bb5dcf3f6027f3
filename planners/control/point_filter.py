"""A Kalman filter of points that a camera sees: positions and velocities, with known and with unknown accelerations.

Every point moves freely along both axes, with the acceleration that is given for a period and an unknown one of a known
standard deviation. Both axes have the same noise, so that one covariance serves both. See D. Simon, "Optimal State
Estimation" (2006), section 5.1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planners.checks import float_vector, require_finite, require_mask, require_shape
from planners.typing import Array

WIDTH = 7
"""Numbers of a point in the memory: position and velocity, two each, their variances and covariance."""


@dataclass(frozen=True)
class PointFilter:
    """The filter of a batch of points.

    Attributes:
        period: between two samples, s.
        noise: standard deviations of measured positions (m) and velocities (m/s), along either axis; a velocity with a
            deviation of 0 is known.
        manoeuvre: standard deviation of a period's unknown acceleration, along either axis, m/s^2.
    """

    period: float
    noise: tuple[float, float]
    manoeuvre: float = 0.0

    def __post_init__(self) -> None:
        require_finite("period", self.period, "s", "positive")
        float_vector("noise", self.noise, 2, "not negative")
        require_finite("noise of positions", self.noise[0], "m", "positive")
        require_finite("manoeuvre", self.manoeuvre, "m/s^2", "not negative")

    def update(
        self, memory: Array, starts: NDArray[np.bool_], position: Array, velocity: Array, acceleration: Array | float
    ) -> None:
        """Follow a period and correct by a sample.

        Args:
            memory: ``(batch, points, WIDTH)``, renewed in place; the estimated positions are the first two numbers of a
                point, the estimated velocities the next two.
            starts: where an episode begins, ``(batch,)``: the sample is all that is known.
            position, velocity: the sample, ``(batch, points, 2)``, m and m/s.
            acceleration: known, of the last period, ``(batch, points, 2)``, m/s^2.

        Raises:
            ValueError: if a shape does not fit.
        """
        require_mask("starts", starts, len(memory))
        require_shape("memory", memory, (*memory.shape[:2], WIDTH))
        for name, sample in (("position", position), ("velocity", velocity)):
            require_shape(name, sample, (*memory.shape[:2], 2))
        t, variance = self.period, np.square(self.noise)
        place, rate = memory[..., :2].copy(), memory[..., 2:4].copy()
        pp, pv, vv = memory[..., 4], memory[..., 5], memory[..., 6]
        place += t * rate + 0.5 * t**2 * acceleration
        rate += t * acceleration
        unknown = self.manoeuvre**2
        pp = pp + 2.0 * t * pv + t**2 * vv + 0.25 * t**4 * unknown
        pv = pv + t * vv + 0.5 * t**3 * unknown
        vv = vv + t**2 * unknown
        share = (pp / (pp + variance[0]))[..., None], (pv / (pp + variance[0]))[..., None]
        innovation = position - place
        place, rate = place + share[0] * innovation, rate + share[1] * innovation
        left = variance[0] / (pp + variance[0])
        pp, pv, vv = pp * left, pv * left, vv - pv * pv / (pp + variance[0])
        if variance[1] > 0.0:
            innovation = velocity - rate
            spread = vv + variance[1]
            place = place + (pv / spread)[..., None] * innovation
            rate = rate + (vv / spread)[..., None] * innovation
            pp, pv, vv = pp - pv * pv / spread, pv * variance[1] / spread, vv * variance[1] / spread
        begun = starts[:, None]
        memory[..., :2] = np.where(begun[..., None], position, place)
        memory[..., 2:4] = np.where(begun[..., None], velocity, rate)
        memory[..., 4] = np.where(begun, variance[0], pp)
        memory[..., 5] = np.where(begun, 0.0, pv)
        memory[..., 6] = np.where(begun, variance[1], vv)
