"""An evaluation in numbers: the one summary behind leaderboards, learning curves, stored scores and releases."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from agents.environments import card_of as card_of
from agents.evaluation import statistics
from agents.evaluation.results import Evaluation
from agents.evaluation.statistics import Estimate
from agents.tables import number_text, share_text
from envs.card import Metric

LIMIT_TOLERANCE = 0.005  # share by which a limit may be exceeded before an episode counts as one that breaks it


def summarise(evaluation: Evaluation, *, bootstrap: bool = True) -> dict[str, Estimate]:
    """Estimates by name.

    ``success``, ``limit_broken`` (episodes that exceed a limit by more than `LIMIT_TOLERANCE`) and every boolean metric
    are shares with Wilson's intervals; ``return`` is the interquartile mean (IQM); ``length`` and all other metrics are
    medians.

    Args:
        evaluation: episodes of a policy.
        bootstrap: also compute the intervals of medians and means; they are NaN otherwise.
    """
    estimates = {
        "success": statistics.rate(evaluation.success),
        "return": statistics.interquartile_mean(evaluation.returns, bootstrap=bootstrap),
        "length": statistics.median(evaluation.lengths, bootstrap=bootstrap),
    }
    if "limit_ratio" in evaluation.metrics:
        estimates["limit_broken"] = statistics.rate(breaks_limits(evaluation))
    for key, values in evaluation.metrics.items():
        if values.dtype != bool:
            estimates[key] = statistics.median(values, bootstrap=bootstrap)
        elif key != "is_success":
            estimates[key] = statistics.rate(values)
    return estimates


def breaks_limits(evaluation: Evaluation) -> NDArray[np.bool_]:
    """Which episodes exceed a limit by more than `LIMIT_TOLERANCE`; none of a task that measures no limits."""
    ratios = evaluation.metrics.get("limit_ratio", np.zeros(len(evaluation.seeds)))
    return np.asarray(ratios > 1.0 + LIMIT_TOLERANCE)


def training_scores(evaluation: Evaluation) -> dict[str, Estimate]:
    """What training runs and agents record: `summarise` with the mean return, without nested metrics and bootstrap."""
    estimates = summarise(evaluation, bootstrap=False)
    names = [name for name in evaluation.metrics if name != "is_success" and "/" not in name]
    mean_return = Estimate(float(evaluation.returns.mean()), np.nan, np.nan)
    return {"success": estimates["success"], "return": mean_return, **{name: estimates[name] for name in names}}


def values_of(estimates: dict[str, Estimate]) -> dict[str, float]:
    """Estimates without their intervals."""
    return {name: estimate.value for name, estimate in estimates.items()}


def metric_text(metric: Metric, evaluation: Evaluation, estimates: dict[str, Estimate]) -> str:
    """The cell of a metric: a share with its interval, or a median in the unit of its column."""
    if evaluation.metrics[metric.key].dtype == bool:
        return share_text(estimates[metric.key])
    return number_text(estimates[metric.key].value * metric.factor)
