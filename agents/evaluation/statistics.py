"""Estimates with 95 % intervals: Wilson's of rates, bootstrap intervals of medians and means."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

CONFIDENCE = 0.95
_RESAMPLES = 2000
_SEED = 20240229  # fixed, so that the same episodes always give the same interval


@dataclass(frozen=True)
class Estimate:
    """A value with its 95 % interval, whose ends are NaN if it was not computed or there is one episode only."""

    value: float
    low: float
    high: float

    def times(self, factor: float) -> Estimate:
        """In another unit."""
        return Estimate(factor * self.value, factor * self.low, factor * self.high)


def rate(outcomes: ArrayLike) -> Estimate:
    """Share of true outcomes ``(episodes,)``, with Wilson's score interval, which holds near 0 and 1 too."""
    from scipy import stats  # slow to import

    array = np.asarray(outcomes, dtype=bool)
    test = stats.binomtest(int(array.sum()), array.size)
    interval = test.proportion_ci(CONFIDENCE, method="wilson")
    return Estimate(float(array.mean()), float(interval.low), float(interval.high))


def mean(values: ArrayLike) -> Estimate:
    """Mean of ``values`` ``(episodes,)`` with a bootstrap interval."""
    return _estimate(values, np.mean, bootstrap=True)


def median(values: ArrayLike, *, bootstrap: bool = True) -> Estimate:
    """Median of ``values`` ``(episodes,)``, which may be infinite; NaN is left out."""
    return _estimate(values, np.median, bootstrap=bootstrap)


def interquartile_mean(values: ArrayLike, *, bootstrap: bool = True) -> Estimate:
    """Mean of the middle half of ``values`` ``(episodes,)``, which may be infinite (IQM; Agarwal et al. 2021)."""
    from scipy import stats  # slow to import

    return _estimate(values, lambda sample, axis: stats.trim_mean(sample, 0.25, axis=axis), bootstrap=bootstrap)


def _estimate(values: ArrayLike, statistic: Callable[..., Any], *, bootstrap: bool) -> Estimate:
    sample = np.asarray(values, dtype=float)
    sample = sample[~np.isnan(sample)]
    if not sample.size:
        return Estimate(np.nan, np.nan, np.nan)
    # Infinite values become finite ones so large that every statistic they enter lies beyond all others:
    # the quantiles of the resampled statistic would otherwise meet inf - inf.
    finite = sample[np.isfinite(sample)]
    largest = float(np.abs(finite).max(initial=0.0))
    sample = np.where(np.isinf(sample), np.sign(sample) * 1e12 * (1.0 + largest), sample)
    ends = [float(statistic(sample, axis=0)), np.nan, np.nan]
    if bootstrap and sample.size > 1:
        from scipy import stats  # slow to import

        result = stats.bootstrap(
            (sample,),
            statistic,
            confidence_level=CONFIDENCE,
            n_resamples=_RESAMPLES,
            method="percentile",
            rng=np.random.default_rng(_SEED),
        )
        ends[1:] = float(result.confidence_interval.low), float(result.confidence_interval.high)
    return Estimate(*(math.copysign(math.inf, end) if abs(end) > 1e3 * (1.0 + largest) else end for end in ends))
