"""Paired comparison: two policies on the same episodes, difference by difference."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.environments import card_of
from agents.evaluation import statistics
from agents.evaluation.results import Evaluation
from agents.evaluation.statistics import Estimate
from agents.tables import Table, interval_text, number_text
from envs.card import Metric
from planners.typing import Array


@dataclass(frozen=True)
class Pair:
    """``policy`` minus ``against`` on the same episodes; each estimate has a bootstrap interval.

    ``improvement`` is the share of episodes in which the policy does better by the primary metric (by the return if
    there is none), ties by half: the probability of improvement (Agarwal et al. 2021).
    """

    policy: str
    against: str
    success: Estimate  # mean difference of success, a share
    metric: Estimate | None  # median difference of the primary metric; an episode without success is infinitely bad
    returns: Estimate  # interquartile mean of the differences of returns
    improvement: Estimate


def paired(policy: Evaluation, against: Evaluation, metric: Metric | None = None) -> Pair:
    """A policy minus another; a ValueError if they were not evaluated on the same episodes.

    ``metric`` is the primary one, by default that of the task's card.
    """
    if policy.env_id != against.env_id or not np.array_equal(policy.seeds, against.seeds):
        raise ValueError(f"{policy.policy} and {against.policy} were evaluated on different episodes")
    metric = metric or card_of(policy.env_id).primary
    returns = policy.returns - against.returns
    gains, estimate = returns, None
    if metric is not None:
        differences = _difference(_achieved(policy, metric), _achieved(against, metric))
        gains, estimate = -differences if metric.lower_is_better else differences, statistics.median(differences)
    return Pair(
        policy=policy.policy,
        against=against.policy,
        success=statistics.mean(policy.success.astype(float) - against.success),
        metric=estimate,
        returns=statistics.interquartile_mean(returns),
        improvement=statistics.mean(0.5 * (1.0 + np.sign(gains))),
    )


def compare_all(evaluations: Sequence[Evaluation], compared: Iterable[str], metric: Metric | None = None) -> list[Pair]:
    """Each of some policies of a task against each of the others, and against those of them that come later.

    ``metric`` is as in `paired`.
    """
    names = set(compared)
    ours = [evaluation for evaluation in evaluations if evaluation.policy in names]
    others = [evaluation for evaluation in evaluations if evaluation.policy not in names]
    return [paired(one, other, metric) for place, one in enumerate(ours) for other in [*others, *ours[place + 1 :]]]


def comparison(env_id: str, pairs: Sequence[Pair]) -> Table:
    """The table of the pairs of a task."""
    metric = card_of(env_id).primary
    headers = ["difference", "success (points)", *([metric.title] if metric else []), "return", "better (%)"]
    rows = []
    for pair in pairs:
        row = [f"{pair.policy} - {pair.against}", interval_text(pair.success.times(100.0), _signed)]
        if metric is not None and pair.metric is not None:
            row.append(interval_text(pair.metric.times(metric.factor), _signed))
        row += [interval_text(pair.returns, _signed), interval_text(pair.improvement.times(100.0), "{:.1f}".format)]
        rows.append(row)
    legend = (
        "The first policy minus the second, episode by episode, with 95 % bootstrap intervals: mean difference of "
        "success, median difference of the task's primary metric (an episode without success counts as infinitely "
        "bad), interquartile mean of the differences of the return. Better: share of episodes in which the first does "
        "better by the primary metric, ties by half."
    )
    return Table(
        "",
        headers,
        rows,
        legend=legend,
        foremost=(headers[-3] if metric else "return", "better (%)"),
        brief="The first policy minus the second, on the same episodes, with 95 % intervals. An episode without "
        "success counts as infinitely bad.",
    )


def as_documents(pairs: Iterable[Pair]) -> list[dict[str, Any]]:
    """Pairs for JSON; null in place of what is infinite."""
    return [
        {name: vars(value) if isinstance(value, Estimate) else value for name, value in vars(pair).items()}
        for pair in pairs
    ]


def worst_first(evaluation: Evaluation, metric: Metric | None) -> NDArray[np.int64]:
    """Indices of the episodes ``(episodes,)``: by success, then by a metric, then by the return, the worst first."""
    badness = np.where(evaluation.success, 0.0, np.inf)
    if metric is not None:
        achieved = _achieved(evaluation, metric)
        badness = achieved if metric.lower_is_better else -achieved
    return np.lexsort((evaluation.returns, -badness))


def _signed(value: float) -> str:
    if math.isinf(value):
        return "+inf" if value > 0.0 else "-inf"
    return f"+{number_text(value)}" if value > 0.0 else number_text(value)


def _achieved(evaluation: Evaluation, metric: Metric) -> Array:
    """The metric of each episode, infinitely bad where it was no success."""
    return np.where(evaluation.success, evaluation.metrics[metric.key], np.inf if metric.lower_is_better else -np.inf)


def _difference(ours: Array, theirs: Array) -> Array:
    """Differences, zero where both are infinite."""
    both = np.isinf(ours) & np.isinf(theirs)
    differences: Array = np.where(both, 0.0, ours) - np.where(both, 0.0, theirs)
    return differences
