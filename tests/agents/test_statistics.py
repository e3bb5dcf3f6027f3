"""Intervals against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.evaluation import statistics

Z = 1.959963984540054  # 97.5 % quantile of the normal distribution


@given(st.integers(1, 400).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_rate_is_wilsons_closed_form(counts: tuple[int, int]) -> None:
    successes, n = counts
    p = successes / n
    middle = (p + Z**2 / (2 * n)) / (1 + Z**2 / n)
    half = Z / (1 + Z**2 / n) * math.sqrt(p * (1 - p) / n + Z**2 / (4 * n**2))
    estimate = statistics.rate([True] * successes + [False] * (n - successes))
    assert estimate.value == pytest.approx(p)
    assert estimate.low == pytest.approx(middle - half, abs=1e-9)
    assert estimate.high == pytest.approx(middle + half, abs=1e-9)


def test_interquartile_mean_is_the_mean_of_the_middle_half() -> None:
    values = [100.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, -50.0]
    assert statistics.interquartile_mean(values).value == pytest.approx((2.0 + 3.0 + 4.0 + 5.0) / 4.0)


def test_median_interval_of_a_normal_sample_has_the_known_width() -> None:
    sample = np.random.default_rng(1).normal(size=900)
    estimate = statistics.median(sample)
    asymptotic = Z * math.sqrt(math.pi / 2.0) / math.sqrt(900)
    assert estimate.low < estimate.value < estimate.high
    assert (estimate.high - estimate.low) / 2.0 == pytest.approx(asymptotic, rel=0.25)


def test_same_episodes_give_the_same_interval() -> None:
    sample = np.random.default_rng(2).exponential(size=50)
    assert statistics.interquartile_mean(sample) == statistics.interquartile_mean(sample)


@pytest.mark.parametrize("estimator", [statistics.median, statistics.interquartile_mean])
def test_a_few_infinities_leave_the_middle_finite(estimator: object) -> None:
    assert callable(estimator)
    estimate = estimator([1.0] * 90 + [math.inf] * 10)
    assert (estimate.value, estimate.low, estimate.high) == (1.0, 1.0, 1.0)


def test_many_infinities_make_the_estimate_infinite() -> None:
    estimate = statistics.median([1.0] * 10 + [math.inf] * 12)
    assert estimate.value == estimate.high == math.inf
    assert estimate.low == 1.0
    assert statistics.median([math.inf] * 5) == statistics.Estimate(math.inf, math.inf, math.inf)


def test_one_episode_has_no_interval() -> None:
    estimate = statistics.median([2.5])
    assert estimate.value == 2.5
    assert math.isnan(estimate.low)
    assert math.isnan(estimate.high)
