"""Cyclic reference motions: quintics from rest to rest through postures."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from planners.motion.time_laws import quintic_motion
from planners.typing import Array


@dataclass(frozen=True)
class Cycle:
    """A periodic motion through postures ``(k, n)``, rad, at rest in each.

    ``durations`` ``(k,)``, s, are those from each posture to the next, and from the last to the first.
    """

    postures: Array
    durations: Array

    def __post_init__(self) -> None:
        if self.postures.ndim != 2 or self.durations.shape != (len(self.postures),):
            raise ValueError(
                f"a cycle has as many durations as postures; got {self.durations.shape} for {self.postures.shape}"
            )
        if not np.all(self.durations > 0.0):
            raise ValueError(f"durations {self.durations} s must be positive")

    @cached_property
    def period(self) -> float:
        """Time of one cycle, s."""
        return math.fsum(self.durations)

    def sample(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Angles, velocities and accelerations at times ``(samples,)``, s; each ``(samples, n)``."""
        time = np.mod(np.asarray(t, dtype=np.float64), self.period)
        ends = np.cumsum(self.durations)
        leg = np.minimum(np.searchsorted(ends, time, side="right"), len(ends) - 1)
        duration = self.durations[leg, None]
        s = np.clip((time - ends[leg] + self.durations[leg])[:, None] / duration, 0.0, 1.0)
        start = self.postures[leg]
        change = self.postures[(leg + 1) % len(self.postures)] - start
        return quintic_motion(start, change, duration, s)


WORK_CYCLE = Cycle(
    postures=np.radians(
        [[-30.0, 5.0, -75.0, 40.0, 90.0], [-30.0, 40.0, -70.0, 30.0, 90.0], [50.0, 45.0, -50.0, 5.0, 60.0]]
    ),
    durations=np.array([2.0, 3.0, 3.0]),
)
"""Lift, swing out with all five joints, and back: 8 s. With 350 kg the slew needs 95 % of the torque of `EXCAVATOR`."""
