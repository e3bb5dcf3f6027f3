"""Closed forms of one joint, against linear programs over motions in discrete time."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from planners.motion.double_integrator import BRAKE, CRUISE, RISE, along_profile, entry_time, fill_profile, rest_time
from planners.typing import Array

TOP, A = 2.4, 4.5
speeds, places = st.floats(-TOP, TOP), st.floats(-3.0, 3.0)


def exists(v: float, duration: float, low: float, high: float, *, rest: bool, after: float = 1.0) -> bool:
    """Whether some motion from 0 with velocity ``v`` is in ``[low, high]`` from ``duration`` on, at rest or not."""
    before, beyond = 60, 1 if rest else 40
    h = np.concatenate([np.full(before, duration / before), np.full(beyond, after / beyond)])
    n, t = len(h), np.concatenate([[0.0], np.cumsum(h)])
    gain = np.tril(np.tile(h, (n, 1)))  # speed after each step, from the accelerations
    way = np.array([[h[j] * (t[i + 1] - t[j] - 0.5 * h[j]) if j <= i else 0.0 for j in range(n)] for i in range(n)])
    drift = v * t[1:]
    inside = slice(before - 1, n)
    rows = np.concatenate([gain, -gain, way[inside], -way[inside]])
    slack = 1e-9
    bounds = [np.full(n, TOP - v), np.full(n, TOP + v), high - drift[inside], drift[inside] - low]
    still, brakes = (gain[before - 1 :], np.full(n - before + 1, -v)) if rest else (None, None)
    upper = np.concatenate(bounds) + slack
    return bool(linprog(np.zeros(n), rows, upper, still, brakes, bounds=(-A, A)).status == 0)


@settings(max_examples=40, deadline=None)
@given(places, speeds)
def test_rest_is_reached_in_the_least_time(distance: float, v: float) -> None:
    least = rest_time(distance, v, TOP, A)
    assume(least > 0.1)
    assert exists(v, least + 0.06, distance - 1e-6, distance + 1e-6, rest=True, after=1e-3)
    assert not exists(v, least - 0.01, distance - 1e-6, distance + 1e-6, rest=True, after=1e-3)


@settings(max_examples=60, deadline=None)
@given(places, st.floats(0.02, 0.5), speeds)
def test_a_range_is_entered_in_the_least_time(low: float, width: float, v: float) -> None:
    least = entry_time(0.0, v, low, low + width, TOP, A)
    assert exists(v, least + 0.06, low - 1e-3, low + width + 1e-3, rest=False)
    if least > 0.05:
        assert not exists(v, least - 0.02, low, low + width, rest=False)


@settings(max_examples=100, deadline=None)
@given(places, speeds, st.floats(0.0, 2.0))
def test_profiles_end_at_rest_in_place_within_limits(distance: float, v: float, spare: float) -> None:
    profile = np.empty(4)
    least = rest_time(distance, v, TOP, A)
    fill_profile(distance, v, TOP, A, least + spare, profile)
    took = profile[[RISE, CRUISE, BRAKE]].sum()
    assert took == pytest.approx(least + spare) or took == pytest.approx(least)
    motion = np.array([along_profile(profile, v, A, t) for t in np.linspace(0.0, took, 400)])
    assert motion[0, 0] == 0.0
    assert motion[-1, :2] == pytest.approx([distance, 0.0], abs=1e-6)
    assert np.abs(motion[:, 1]).max() <= TOP + 1e-9
    assert set(np.abs(motion[:, 2])) <= {0.0, A}
    check_integrals(motion, took)


def check_integrals(motion: Array, took: float) -> None:
    """Velocity is the derivative of the way, acceleration never exceeded."""
    h = took / (len(motion) - 1)
    way, speed = motion[:, 0], motion[:, 1]
    np.testing.assert_allclose(np.diff(way), 0.5 * h * (speed[1:] + speed[:-1]), atol=A * h * h + 1e-12)
    assert np.abs(np.diff(speed)).max() <= A * h + 1e-9


def test_from_rest_it_can_take_as_long_as_it_is_told() -> None:
    profile = np.empty(4)
    fill_profile(1.0, 0.0, TOP, A, 3.0, profile)
    assert profile[[RISE, CRUISE, BRAKE]].sum() == pytest.approx(3.0)
    assert along_profile(profile, 0.0, A, 3.0)[0] == pytest.approx(1.0)
