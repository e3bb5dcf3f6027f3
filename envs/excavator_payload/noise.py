"""Measurement noise as a function of a seed and a step, so that it is the same in every batch and thread."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from envs.hashing import GAMMA, to_unit
from planners.typing import Array


@njit(cache=True, nogil=True)
def normal_pair(seed: int, count: int) -> tuple[float, float]:
    """Two independent standard normal numbers, the ``count``-th pair of a ``seed`` (both unsigned 64-bit integers).

    G. E. P. Box and M. E. Muller, "A Note on the Generation of Random Normal Deviates" (1958).
    """
    radius = math.sqrt(-2.0 * math.log(1.0 - uniform(seed, 2 * count)))
    angle = 2.0 * math.pi * uniform(seed, 2 * count + 1)
    return radius * math.cos(angle), radius * math.sin(angle)


@njit(cache=True, nogil=True)
def uniform(seed: int, count: int) -> float:
    """The ``count``-th number of SplitMix64 with a ``seed``, in [0, 1)."""
    return float(to_unit(np.uint64(seed) + np.uint64(count + 1) * GAMMA))


@njit(cache=True, nogil=True)
def add_noise(seed: int, step: int, deviations: Array, measured: Array) -> None:
    """Add noise to ``measured`` ``(2, n)``: angles and velocities, with two standard ``deviations``."""
    n = measured.shape[1]
    for i in range(n):
        angle, velocity = normal_pair(seed, step * n + i)
        measured[0, i] += deviations[0] * angle
        measured[1, i] += deviations[1] * velocity
