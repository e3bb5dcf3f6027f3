"""The paired table: two policies on the same episodes, difference by difference."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

from agents.evaluation import statistics
from agents.evaluation.evaluate import Evaluation
from agents.evaluation.leaderboard import TaskResult, primary_metric, shown_number, with_interval
from agents.evaluation.statistics import Estimate
from planners.typing import Array


@dataclass(frozen=True)
class Pair:
    """One policy minus another on the same episodes; each estimate has a bootstrap interval.

    Attributes:
        policy: whose episodes count positive.
        against: whose count negative.
        success: mean difference of success, a share.
        metric: median difference of the task's own number, of which less is better; an episode without success counts
            as infinite. None if the task has no such number.
        returns: interquartile mean of the differences of returns.
        improvement: share of episodes in which the policy does better by the task's own number (by the return if there
            is none), ties by half: the probability of improvement.
    """

    policy: str
    against: str
    success: Estimate
    metric: Estimate | None
    returns: Estimate
    improvement: Estimate


def compare(policy: Evaluation, against: Evaluation) -> Pair:
    """A policy minus another.

    Raises:
        ValueError: if they were not evaluated on the same episodes.
    """
    if policy.env_id != against.env_id or not np.array_equal(policy.seeds, against.seeds):
        raise ValueError(f"{policy.policy} and {against.policy} were evaluated on different episodes")
    metric = primary_metric(policy.env_id)
    returns = policy.returns - against.returns
    gains, estimate = returns, None
    if metric is not None:
        differences = _difference(_achieved(policy, metric.key), _achieved(against, metric.key))
        gains, estimate = -differences, statistics.median(differences)
    return Pair(
        policy=policy.policy,
        against=against.policy,
        success=statistics.mean(policy.success.astype(float) - against.success),
        metric=estimate,
        returns=statistics.interquartile_mean(returns),
        improvement=statistics.mean(0.5 * (1.0 + np.sign(gains))),
    )


def compare_all(result: TaskResult, compared: Iterable[str]) -> list[Pair]:
    """Each of some policies of a task against each of the others."""
    names = set(compared)
    ours = [evaluation for evaluation in result.evaluations if evaluation.policy in names]
    others = [evaluation for evaluation in result.evaluations if evaluation.policy not in names]
    return [compare(one, other) for one in ours for other in others]


def print_comparison(console: Console, env_id: str, pairs: list[Pair]) -> None:
    """Print the paired table of a task; as Markdown where the console is no terminal."""
    table = _table(env_id, pairs)
    caption = (
        "The first policy minus the second, episode by episode, with 95 % bootstrap intervals: mean difference of "
        "success, median difference of the task's number (less is better; an episode without success counts as "
        "infinite), interquartile mean of the differences of the return. Better: share of episodes in which the first "
        "does better by the task's number, ties by half."
    )
    if console.is_terminal:
        console.print(table, caption, "", sep="\n", highlight=False)
        return
    table.box = box.MARKDOWN
    Console(file=console.file, width=1000).print(table, f"{caption}\n", sep="\n")


def as_documents(pairs: list[Pair]) -> list[dict[str, Any]]:
    """Pairs for JSON; null in place of what is infinite."""
    return [
        {name: vars(value) if isinstance(value, Estimate) else value for name, value in vars(pair).items()}
        for pair in pairs
    ]


def _table(env_id: str, pairs: list[Pair]) -> Table:
    metric = primary_metric(env_id)
    table = Table("difference", box=box.SIMPLE_HEAD, padding=0, header_style="bold")
    titles = ["success (points)", *([metric.title] if metric else []), "return", "better (%)"]
    for title in titles:
        table.add_column(title, justify="right")
    for pair in pairs:
        cells = [with_interval(pair.success, _signed_times(100.0))]
        if metric is not None and pair.metric is not None:
            cells.append(with_interval(pair.metric, _signed_times(metric.factor)))
        cells += [
            with_interval(pair.returns, _signed),
            with_interval(pair.improvement, lambda share: f"{100 * share:.1f}"),
        ]
        table.add_row(f"{pair.policy} - {pair.against}", *cells)
    return table


def _signed_times(factor: float) -> Callable[[float], str]:
    return lambda value: _signed(factor * value)


def _signed(value: float) -> str:
    if math.isinf(value):
        return "+inf" if value > 0.0 else "-inf"
    return f"+{shown_number(value)}" if value > 0.0 else shown_number(value)


def _achieved(evaluation: Evaluation, key: str) -> Array:
    """The number of each episode, infinite where it was no success."""
    return np.where(evaluation.success, evaluation.metrics[key], np.inf)


def _difference(ours: Array, theirs: Array) -> Array:
    """Differences, zero where both are infinite."""
    both = np.isinf(ours) & np.isinf(theirs)
    differences: Array = np.where(both, 0.0, ours) - np.where(both, 0.0, theirs)
    return differences
