"""Random numbers without a state, the same in every batch and thread: words hashed by the finaliser of SplitMix64.

G. L. Steele, D. Lea and C. H. Flood, "Fast Splittable Pseudorandom Number Generators" (2014).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from planners.compiled.calls import private

GAMMA = np.uint64(0x9E3779B97F4A7C15)
"""SplitMix64 hashes the multiples of this number."""

_FIRST_MIX, _SECOND_MIX = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_FIRST_SHIFT, _SECOND_SHIFT, _THIRD_SHIFT, _LOW_BITS = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)


@njit(cache=True, nogil=True)
def to_unit(word: Any) -> Any:
    """Hash an unsigned 64-bit word, or an array of them, to a number in [0, 1)."""
    word = (word ^ (word >> _FIRST_SHIFT)) * _FIRST_MIX
    word = (word ^ (word >> _SECOND_SHIFT)) * _SECOND_MIX
    word = word ^ (word >> _THIRD_SHIFT)
    return (word >> _LOW_BITS) * 2.0**-53


@private
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
