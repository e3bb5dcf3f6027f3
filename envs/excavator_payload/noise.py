"""Measurement noise fixed by a seed and a step: no state, the same bits in every environment and thread."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from planners.typing import Array

_SHIFTS = np.array([30, 27, 31, 11], dtype=np.uint64)
_GAMMA = np.uint64(0x9E3779B97F4A7C15)
_FIRST_MIX, _SECOND_MIX = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_UNIT = 2.0**-53


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
    """The ``count``-th uniform number in [0, 1) of a ``seed``, by SplitMix64.

    G. L. Steele, D. Lea and C. H. Flood, "Fast Splittable Pseudorandom Number Generators" (2014).
    """
    z = np.uint64(seed) + np.uint64(count + 1) * _GAMMA
    z = (z ^ (z >> _SHIFTS[0])) * _FIRST_MIX
    z = (z ^ (z >> _SHIFTS[1])) * _SECOND_MIX
    z = z ^ (z >> _SHIFTS[2])
    return float(z >> _SHIFTS[3]) * _UNIT


@njit(cache=True, nogil=True)
def add_noise(seed: int, step: int, deviations: Array, measured: Array) -> None:
    """Add noise to ``measured`` ``(2, n)``: angles and velocities, with two standard ``deviations``."""
    n = measured.shape[1]
    for i in range(n):
        angle, velocity = normal_pair(seed, step * n + i)
        measured[0, i] += deviations[0] * angle
        measured[1, i] += deviations[1] * velocity
