"""The filter of points that a camera sees."""

from __future__ import annotations

import numpy as np
import pytest

from planners.control.point_filter import WIDTH, PointFilter
from planners.typing import Array

PERIOD, NOISE = 0.02, (2e-4, 1e-2)


def errors(acceleration: float, known: float, manoeuvre: float = 0.0, periods: int = 60) -> tuple[Array, Array]:
    """Errors of position and velocity of 200 points on lines after some periods, ``(200, 2)`` each."""
    generator = np.random.default_rng(0)
    kind, memory = PointFilter(PERIOD, NOISE, manoeuvre), np.zeros((200, 1, WIDTH))
    start, rate, direction = np.array([0.3, -0.5]), np.array([0.2, 0.1]), np.array([1.0, 0.0])
    for k in range(periods):
        t = k * PERIOD
        place = start + rate * t + 0.5 * acceleration * t**2 * direction
        speed = rate + acceleration * t * direction
        noise = generator.normal(size=(2, 200, 1, 2))
        seen = place + NOISE[0] * noise[0], speed + NOISE[1] * noise[1]
        kind.update(memory, np.full(200, k == 0), *seen, known * direction)
    return memory[:, 0, :2] - place, memory[:, 0, 2:4] - speed


@pytest.mark.parametrize("acceleration", [0.0, 0.4])
def test_a_known_motion_is_estimated_as_its_covariance_says(acceleration: float) -> None:
    place, rate = errors(acceleration, acceleration)
    # least squares: sigma sqrt(4 / n) at the end of the line, sigma sqrt(12 / n^3) / T for its slope
    assert place.std() == pytest.approx(2e-4 * np.sqrt(4.0 / 60), rel=0.15)
    assert rate.std() == pytest.approx(2e-4 * np.sqrt(12.0 / 60**3) / PERIOD, rel=0.15)
    assert np.abs(rate.mean(axis=0)).max() < 0.1 * rate.std() * np.sqrt(2.0)


def test_a_declared_manoeuvre_bounds_the_lag_behind_an_unknown_acceleration() -> None:
    _, trusting = errors(0.4, 0.0)
    _, wary = errors(0.4, 0.0, manoeuvre=0.4)
    assert np.abs(wary.mean(axis=0)).max() < 0.1 * np.abs(trusting.mean(axis=0)).max()


def test_an_episode_begins_with_its_first_sample() -> None:
    kind, memory = PointFilter(PERIOD, NOISE), np.ones((2, 1, WIDTH))
    place, rate = np.full((2, 1, 2), 3.0), np.full((2, 1, 2), 4.0)
    kind.update(memory, np.array([True, False]), place, rate, 0.0)
    np.testing.assert_array_equal(memory[0, 0], [3.0, 3.0, 4.0, 4.0, NOISE[0] ** 2, 0.0, NOISE[1] ** 2])
    assert 1.0 < memory[1, 0, 0] < 3.1


def test_a_point_at_rest_is_averaged() -> None:
    generator = np.random.default_rng(1)
    kind, memory, still = PointFilter(PERIOD, (3e-3, 0.0)), np.zeros((300, 1, WIDTH)), np.zeros((300, 1, 2))
    for k in range(25):
        kind.update(memory, np.full(300, k == 0), 1.0 + 3e-3 * generator.normal(size=(300, 1, 2)), still, 0.0)
    assert (memory[..., :2] - 1.0).std() == pytest.approx(3e-3 / 5.0, rel=0.1)
    np.testing.assert_array_equal(memory[..., 2:4], 0.0)
