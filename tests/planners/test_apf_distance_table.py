"""The distance table of the potential-field paper."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.interpolate import RegularGridInterpolator

from planners.apf.distance_table import DistanceTable, disc_shift
from planners.apf.hand_field import make_field
from planners.typing import Array

compiled = settings(deadline=None)  # the first example waits for the compiler
vectors = st.tuples(st.floats(-1.2, 1.2), st.floats(-1.2, 1.2)).map(np.array)
speeds, directions = st.floats(0.0, 4.0), st.floats(-math.pi, math.pi)

TABLE = DistanceTable.looking_ahead(0.4)


@compiled
@given(direction=directions)
def test_a_disc_at_rest_is_at_its_distance(direction: float) -> None:
    assert TABLE.shift(0.0, direction) == 0.0


@compiled
@given(speed=speeds, direction=directions)
def test_the_table_is_symmetric(speed: float, direction: float) -> None:
    assert TABLE.shift(speed, -direction) == TABLE.shift(speed, direction)
    assert TABLE.shift(speed, math.pi - abs(direction)) == pytest.approx(-TABLE.shift(speed, direction), abs=1e-12)


@compiled
@given(slow=speeds, fast=speeds, direction=st.floats(0.0, math.pi))
def test_faster_approach_is_nearer_and_faster_retreat_farther(slow: float, fast: float, direction: float) -> None:
    slow, fast = sorted((slow, fast))
    change = TABLE.shift(fast, direction) - TABLE.shift(slow, direction)
    assert change <= 1e-15 if direction < math.pi / 2.0 else change >= -1e-15


@compiled
@given(speed=speeds, direction=directions)
def test_look_up_is_bilinear(speed: float, direction: float) -> None:
    shifts = np.random.default_rng(0).normal(size=(4, 6))
    shifts[0] = 0.0
    axes = np.linspace(0.0, 3.0, 4), np.linspace(0.0, math.pi, 6)
    reference = RegularGridInterpolator(axes, shifts)((min(speed, 3.0), abs(direction)))
    assert DistanceTable(shifts, 3.0).shift(speed, direction) == pytest.approx(float(reference), abs=1e-12)


@compiled
@given(offset=vectors, velocity=vectors)
def test_the_table_holds_the_closing_speed(offset: Array, velocity: Array) -> None:
    distance = np.hypot(*offset)
    assume(distance > 1e-3)
    shift = disc_shift(TABLE.shifts, TABLE.max_speed, *offset, *velocity)
    closing = velocity @ offset / distance
    # a chord of the cosine over 10 degrees is off by 1 - cos(5 degrees) at most
    assert shift == pytest.approx(-0.4 * closing, abs=0.4 * np.hypot(*velocity) * 0.00381 + 1e-12)


@pytest.mark.parametrize(
    ("shifts", "max_speed", "words"),
    [
        (np.zeros(3), 1.0, "at least"),
        (np.zeros((1, 5)), 1.0, "at least"),
        ([[0.0, 0.1], [0.0, 0.0]], 1.0, "at rest"),
        ([[0.0, 0.0], [0.0, math.nan]], 1.0, "finite"),
        (np.zeros((2, 2)), 0.0, "max_speed"),
    ],
)
def test_bad_tables_are_refused(shifts: Any, max_speed: float, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        DistanceTable(shifts, max_speed)


def test_a_table_cannot_look_back() -> None:
    with pytest.raises(ValueError, match="time"):
        DistanceTable.looking_ahead(-0.1)


def test_a_table_of_ones_own_is_used() -> None:
    mine = make_field(distance=DistanceTable(np.array([[0.0, 0.0], [0.5, 0.5]]), 2.0))
    np.testing.assert_array_equal(mine.shifts, [[0.0, 0.0], [0.5, 0.5]])
    assert not make_field(distance="static").shifts.any()
    with pytest.raises(ValueError, match="'table', 'static'"):
        make_field(distance="quadratic")  # type: ignore[arg-type]
