"""The leaderboard: results of several policies on one task as a table, beside best known and published values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.environments import full_name
from agents.evaluation import statistics
from agents.evaluation.benchmark_config import BenchmarkTask
from agents.evaluation.results import Evaluation, Timing
from agents.evaluation.statistics import Estimate
from agents.evaluation.summarise import LIMIT_TOLERANCE, breaks_limits, card_of, metric_text, summarise
from agents.tables import Table, interval_text, number_text, percent_text, share_text
from envs.card import Bound, TaskCard
from planners.typing import Array

LEGEND = (
    "Success, like other shares, with its 95 % interval. Return: interquartile mean with its 95 % bootstrap interval. "
    "All else: medians. Limit ratio: worst value over its limit; broken: episodes in which it is more than "
    f"{1.0 + LIMIT_TOLERANCE:g}."
)
"""What the numbers of every leaderboard are."""


@dataclass
class TaskResult:
    """What is finished of one task.

    ``bounds`` are the best known values of the bounded metric for the first seeds, None if they are not computed, inf
    where none is known;
    ``lower`` are its certified lower bounds, NaN where none is known;
    ``action_configs`` are by policy the settings that define what its actions mean, where they are not the task's;
    ``sources`` are by policy the names or paths that commands know it by, empty for one in memory;
    ``assumptions`` say what is taken for granted about a policy; ``compared`` names the policies whose episodes are
    compared with those of all others; ``replays`` are recorded episodes (`agents.evaluation.replays`).
    """

    task: BenchmarkTask
    seeds: NDArray[np.int64]
    evaluations: list[Evaluation] = field(default_factory=list)
    bounds: Array | None = None
    lower: Array | None = None
    action_configs: dict[str, Mapping[str, Any]] = field(default_factory=dict)
    sources: dict[str, str] = field(default_factory=dict)
    assumptions: list[str] = field(default_factory=list)
    compared: tuple[str, ...] = ()
    replays: Mapping[str, Any] | None = None

    @property
    def card(self) -> TaskCard:
        """The card of the task."""
        return card_of(self.task.env)

    @property
    def ranked(self) -> list[Evaluation]:
        """Best policy first: by success, then by return."""
        mean_return = {
            id(each): statistics.interquartile_mean(each.returns, bootstrap=False).value for each in self.evaluations
        }
        return sorted(self.evaluations, key=lambda each: (-each.success.mean(), -mean_return[id(each)]))

    @property
    def bounded(self) -> tuple[Bound, Array] | None:
        """The bound and its values, if they are computed."""
        bound = self.card.bound
        return None if bound is None or self.bounds is None else (bound, self.bounds)

    @property
    def certified(self) -> Array | None:
        """The lower bounds, if one is known of every bounded episode."""
        return None if self.lower is None or np.isnan(self.lower).any() else self.lower

    def bound_by_policies(self) -> None:
        """Put better episodes of the policies, within the limits, in the place of best known values."""
        if self.bounded is None or not self.bounded[0].of_motions:
            return
        bound, values = self.bounded
        metric = next(each for each in self.card.metrics if each.key == bound.metric)
        better = np.fmin if metric.lower_is_better else np.fmax
        known = np.where(np.isfinite(values), values, np.nan)
        for each in self.evaluations:
            allowed = each.success & ~breaks_limits(each)
            known = better(known, np.where(allowed, each.metrics[bound.metric], np.nan)[: len(known)])
        self.bounds = np.where(np.isnan(known), np.inf, known)

    def summarise(self, evaluation: Evaluation) -> dict[str, Estimate]:
        """`summarise`, and the median of how much worse an episode is than its best known value, if one is known."""
        estimates = summarise(evaluation)
        if self.bounded is not None:
            bound, values = self.bounded
            reachable = np.isfinite(values)
            above = evaluation.metrics[bound.metric][: len(values)][reachable] - values[reachable]
            if above.size:
                estimates["above_bound"] = statistics.median(above)
        return estimates


def leaderboard(result: TaskResult) -> Table:
    """The table of one task, best policy first."""
    metrics, bounded = result.card.metrics, result.bounded
    headers = [
        "policy",
        "success (%)",
        *(metric.title for metric in metrics),
        *(["over best known"] if bounded else []),
    ]
    headers += ["limit ratio", "broken (%)", "return", "plan (ms)", "step (us)"]
    rows = [list(_policy_cells(result, each, result.summarise(each))) for each in result.ranked]
    references: list[tuple[str, str, str, float]] = []
    if bounded is not None:
        bound, values = bounded
        reachable, which = share_text(statistics.rate(np.isfinite(values))), _which(result)
        references.append((f"best known{which}", reachable, bound.metric, statistics.median(values).value))
        if result.certified is not None:
            references.append((f"lower bound{which}", "", bound.metric, statistics.median(result.certified).value))
    if result.task.published is not None:
        references.append(("paper", "", "settling_time", result.task.published.settling_time))
    for name, success, key, value in references:
        cells = [number_text(value * metric.factor) if metric.key == key else "" for metric in metrics]
        rows.append([name, success, *cells, *([""] * (len(headers) - 2 - len(cells)))])
    count = f"{len(result.seeds)} {'episode' if len(result.seeds) == 1 else 'episodes'}"
    primary = result.card.primary
    return Table(
        f"{result.task.title}: {count}",
        headers,
        rows,
        " ".join(_caption(result)),
        legend=LEGEND,
        foremost=("success (%)", *([primary.title] if primary else []), "over best known", "broken (%)", "return"),
        brief="Success and return with 95 % intervals, all else medians.",
    )


def _policy_cells(result: TaskResult, evaluation: Evaluation, estimates: dict[str, Estimate]) -> Iterator[str]:
    yield evaluation.policy
    yield share_text(estimates["success"])
    for metric in result.card.metrics:
        yield metric_text(metric, evaluation, estimates)
    if result.bounded is not None:
        factor = next(metric.factor for metric in result.card.metrics if metric.key == result.bounded[0].metric)
        yield number_text(factor * estimates["above_bound"].value) if "above_bound" in estimates else ""
    yield number_text(estimates["limit_ratio"].value) if "limit_ratio" in estimates else ""
    yield percent_text(estimates["limit_broken"].value) if "limit_broken" in estimates else ""
    yield interval_text(estimates["return"])
    yield number_text(evaluation.timing.planning_ms) if evaluation.timing.plans else ""
    yield number_text(evaluation.timing.policy_us)


def _which(result: TaskResult) -> str:
    """Which episodes have best known values, for their names; empty for all."""
    count = 0 if result.bounded is None else len(result.bounded[1])
    return "" if count == len(result.seeds) else f" (first {count})"


def _meaning(bound: Bound) -> str:
    """What the best known values of a table are."""
    return bound.meaning + (", or of a policy's episode that is better within the limits" if bound.of_motions else "")


def _caption(result: TaskResult) -> Iterator[str]:
    """What only the numbers of this leaderboard are, sentence by sentence."""
    if result.bounded is not None:
        meaning = _meaning(result.bounded[0])
        yield f"Best known: {meaning}, from the same starts{_which(result)}; over best known: the difference."
        if result.certified is not None:
            yield "Lower bound: proven, no motion is better; its median."
    if beside := result.task.beside_title:
        yield f"Not as by default: {beside}."
    timing = sum((evaluation.timing for evaluation in result.evaluations), Timing())
    yield f"Step: of the policy, without planning; the environment takes {timing.env_us:.1f} us."
    for policy, settings in result.action_configs.items():
        meaning = ", ".join(f"{name} {value}" for name, value in settings.items())
        yield f"Actions of {policy}: {meaning}."
    for assumption in result.assumptions:
        yield f"{assumption}."
    if result.task.published is not None:
        yield f"Paper: {result.task.published.source}. {result.task.published.note}".strip()


def as_document(result: TaskResult) -> dict[str, Any]:
    """All results of a task, for JSON; a time that is null is never."""
    task, bounded = result.task, result.bounded
    return {
        "task": task.title,
        "env": task.env,
        "env_name": full_name(task.env),
        "env_config": task.env_config,
        "options": task.options,
        "policies": [_evaluation_document(result, evaluation) for evaluation in result.evaluations],
        "bound": bounded and {"seeds": result.seeds[: len(bounded[1])], bounded[0].metric: bounded[1]},
        "lower_bound": bounded and {"seeds": result.seeds[: len(bounded[1])], bounded[0].metric: result.lower},
        "published": task.published and task.published.model_dump(),
        "metrics": [vars(metric) for metric in result.card.metrics],
        "bound_meaning": bounded and _meaning(bounded[0]),
        "replays": result.replays,
    }


def _evaluation_document(result: TaskResult, evaluation: Evaluation) -> dict[str, Any]:
    timing = evaluation.timing
    averages = {name: getattr(timing, name) for name in ("planning_ms", "policy_us", "env_us")}
    own = {"seed": evaluation.seeds, "return": evaluation.returns, "length": evaluation.lengths}
    return {
        "policy": evaluation.policy,
        "source": result.sources.get(evaluation.policy),
        "action_config": result.action_configs.get(evaluation.policy, {}),
        "summary": {name: vars(estimate) for name, estimate in result.summarise(evaluation).items()},
        "timing": {**vars(timing), **averages},
        "episodes": {**own, **evaluation.metrics},
    }
