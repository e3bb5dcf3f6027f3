"""Estimates with their uncertainty: Wilson's intervals of rates, bootstrap intervals of medians and means."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

CONFIDENCE = 0.95
_RESAMPLES = 2000
_SEED = 20240229
"""Fixed, so that the same episodes always give the same interval."""


@dataclass(frozen=True)
class Estimate:
    """A value with its 95 % interval; the ends are NaN where one episode cannot tell."""

    value: float
    low: float
    high: float


def rate(outcomes: ArrayLike) -> Estimate:
    """Share of true outcomes ``(episodes,)``, with Wilson's score interval, which holds near 0 and 1 too."""
    array = np.asarray(outcomes, dtype=bool)
    test = stats.binomtest(int(array.sum()), array.size)
    interval = test.proportion_ci(CONFIDENCE, method="wilson")
    return Estimate(float(array.mean()), float(interval.low), float(interval.high))


def mean(values: ArrayLike) -> Estimate:
    """Mean of ``values`` ``(episodes,)`` with a bootstrap interval."""
    return _bootstrap(values, np.mean)


def median(values: ArrayLike) -> Estimate:
    """Median of ``values`` ``(episodes,)`` with a bootstrap interval; values may be infinite."""
    return _bootstrap(values, np.median)


def interquartile_mean(values: ArrayLike) -> Estimate:
    """Mean of the middle half of ``values`` ``(episodes,)`` with a bootstrap interval; values may be infinite."""
    return _bootstrap(values, lambda sample, axis: stats.trim_mean(sample, 0.25, axis=axis))


def _bootstrap(values: ArrayLike, statistic: Callable[..., Any]) -> Estimate:
    sample = np.asarray(values, dtype=float)
    # An infinite value takes part as a finite one so large that whatever it touches lies beyond all others:
    # the quantiles of the resampled statistic would otherwise meet inf - inf.
    finite = sample[np.isfinite(sample)]
    largest = float(np.abs(finite).max(initial=0.0))
    sample = np.where(np.isinf(sample), np.sign(sample) * 1e12 * (1.0 + largest), sample)
    value = float(statistic(sample, axis=0))
    low = high = np.nan
    if sample.size > 1:
        result = stats.bootstrap(
            (sample,),
            statistic,
            confidence_level=CONFIDENCE,
            n_resamples=_RESAMPLES,
            method="percentile",
            rng=np.random.default_rng(_SEED),
        )
        low, high = float(result.confidence_interval.low), float(result.confidence_interval.high)
    ends = (value, low, high)
    return Estimate(*(np.copysign(np.inf, end) if abs(end) > 1e3 * (1.0 + largest) else end for end in ends))
