"""NumPy's random numbers in compiled code: the same as from Python."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numba import njit

from envs.batch.generators import addresses_of, below, normal, uniform


@njit
def drawn(words: Any, count: int) -> Any:
    numbers = np.empty((count, 3))
    for row in range(count):
        numbers[row, 0], numbers[row, 1], numbers[row, 2] = uniform(words), below(words, 3), normal(words)
    return numbers


@pytest.mark.parametrize("bits", [np.random.PCG64, np.random.MT19937, np.random.SFC64])
def test_compiled_code_draws_what_numpy_draws(bits: Any) -> None:
    compiled, plain = np.random.Generator(bits(7)), np.random.Generator(bits(7))
    numbers = drawn(np.array(addresses_of(compiled)), 500)
    expected = [(plain.random(), plain.integers(3), plain.standard_normal()) for _ in range(500)]
    np.testing.assert_array_equal(numbers, expected)
    assert compiled.random() == plain.random()
