"""What the charts of a report show: points with intervals, performance profiles, differences, and costs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from agents.evaluation.compare import Pair, compare_all
from agents.evaluation.statistics import CONFIDENCE, Estimate
from agents.report.results_file import PolicyScores, TaskScores
from agents.tables import number_text, percent_text
from envs.card import Metric
from planners.typing import Array


@dataclass(frozen=True)
class Quantity:
    """A number of every policy of a task: a column of its table, and the axis of a chart.

    Attributes:
        key: in a summary.
        title: with its unit.
        factor: from SI to that unit.
        lower_is_better: the direction; None if there is none.
        share: whether it is a share of episodes, in percent.
        bound: the median of the best known values, in that unit; None without.
        proven: the median of the lower bounds, in that unit; None without.
        published: the figure of a paper, in that unit; None without.
        source: the column of the episodes that it summarises, if that is not called as the key.
    """

    key: str
    title: str
    factor: float = 1.0
    lower_is_better: bool | None = False
    share: bool = False
    bound: float | None = None
    proven: float | None = None
    published: float | None = None
    source: str | None = None

    @property
    def column(self) -> str:
        """The column of the episodes that it summarises."""
        return self.source or self.key

    def of(self, policy: PolicyScores) -> Estimate | None:
        """The estimate of a policy in the unit of the title."""
        estimate = policy.estimate(self.key)
        return None if estimate is None else estimate.times(self.factor)

    def text(self, value: float) -> str:
        """A value as tables and charts write it; a dash for one that is not known."""
        if math.isnan(value):
            return "\u2013"
        if math.isinf(value):
            return "\u221e" if value > 0.0 else "\u2212\u221e"
        return percent_text(value / 100.0) if self.share else number_text(value)

    def interval_text(self, estimate: Estimate) -> str:
        """An estimate with its interval, if there is one."""
        value, low, high = map(self.text, (estimate.value, estimate.low, estimate.high))
        return value if math.isnan(estimate.low) else f"{value} ({low} to {high})"


@dataclass(frozen=True)
class Profile:
    """The distribution of a metric over the episodes of a policy: a step function.

    ``share[i]`` of all episodes are successes with a value at ``values[i]`` or a better one, with Wilson's interval
    (Dolan and Moré 2002; Agarwal et al. 2021).
    """

    name: str
    values: Array  # ascending if lower is better, descending otherwise
    share: Array
    low: Array
    high: Array


def quantities(task: TaskScores) -> list[Quantity]:
    """The columns of the table of a task; the first three have charts: success, the primary metric, the return."""
    bounds = task.bounds
    columns = []
    for metric in task.columns:
        if all(metric.key not in each.summary for each in task.policies):
            continue
        share = any(isinstance(value, bool) for each in task.policies for value in each.episodes.get(metric.key, ()))
        bound = None
        if bounds is not None and bounds[0].key == metric.key:
            bound = metric.factor * float(np.median(list(bounds[1].values())))
        paper = (task.published or {}).get(metric.key)
        columns.append(
            Quantity(
                metric.key,
                metric.title,
                100.0 if share else metric.factor,
                metric.lower_is_better,
                share,
                bound if bound is not None and math.isfinite(bound) else None,
                metric.factor * float(np.median(task.certified)) if bound is not None and task.certified else None,
                metric.factor * paper if isinstance(paper, (int, float)) else None,
            )
        )
    wanted = task.primary.key if task.primary else None
    columns.sort(key=lambda column: column.key != wanted)
    primary = int(bool(columns) and columns[0].key == wanted)  # how many there are
    others = [Quantity("limit_ratio", "limit ratio", lower_is_better=True)]
    others.append(Quantity("limit_broken", "broken (%)", 100.0, True, share=True, source="limit_ratio"))
    if bounds is not None:
        better, key = bounds[0].lower_is_better, bounds[0].key
        others.insert(0, Quantity("above_bound", "over best known", bounds[0].factor, better, source=key))
    columns += [each for each in others if any(each.key in policy.summary for policy in task.policies)]
    first = [Quantity("success", "success (%)", 100.0, share=True, source="is_success"), *columns[:primary]]
    return [*first, Quantity("return", "return"), *columns[primary:]]


def profiles(task: TaskScores) -> list[Profile]:
    """The profile of every policy in the primary metric, best first, and last that of the best known values.

    All are of the episodes that have a best known value, if any has.
    """
    metric, best = task.primary, _best_known(task)
    if metric is None:
        return []
    made = []
    for policy in task.policies:
        episodes = policy.evaluation
        values = np.where(episodes.success, episodes.metrics.get(metric.key, np.nan), np.nan)
        made.append(_profile(policy.policy, values[: len(best)] if len(best) else values, metric))
    if len(best):
        made.append(_profile("best known", best, metric))
    return made


def profiled(task: TaskScores) -> str:
    """Which episodes the profiles are of, in words."""
    count = len(_best_known(task)) or len(task.seeds)
    return "the episodes" if count == len(task.seeds) else f"the first {count} episodes"


def _best_known(task: TaskScores) -> Array:
    """The best known values of the primary metric in the first episodes; empty without."""
    bounds = task.bounds
    return np.array([] if bounds is None or bounds[0] != task.primary else list(bounds[1].values()))


def _profile(name: str, values: Array, metric: Metric) -> Profile:
    """The profile of values ``(episodes,)``, which are not finite where there was no success."""
    reached = metric.factor * values[np.isfinite(values)]
    steps, counts = np.unique(reached, return_counts=True)
    if not metric.lower_is_better:
        steps, counts = steps[::-1], counts[::-1]
    totals = np.cumsum(counts)
    low, high = wilson(totals, len(values))
    return Profile(name, steps, totals / len(values), low, high)


def wilson(successes: ArrayLike, trials: int) -> tuple[Array, Array]:
    """Wilson's score interval of a share, for several numbers of successes ``(n,)``; both ends, ``(n,)``."""
    from scipy import stats  # slow to import

    z = float(stats.norm.ppf(0.5 + CONFIDENCE / 2.0))
    share, weight = np.asarray(successes) / trials, z * z / trials
    middle = (share + weight / 2.0) / (1.0 + weight)
    half = z / (1.0 + weight) * np.sqrt(share * (1.0 - share) / trials + weight / (4.0 * trials))
    return middle - half, middle + half


def quantiles(profile: Profile, shares: Sequence[float]) -> list[float]:
    """The value that so large shares of all episodes reach or do better than; NaN where fewer do."""
    places = [int(np.searchsorted(profile.share, share - 1e-12)) for share in shares]
    return [float(profile.values[place]) if place < len(profile.values) else math.nan for place in places]


def differences(task: TaskScores) -> list[Pair]:
    """Paired differences of each of the policies that are compared and each of the others."""
    return compare_all([each.evaluation for each in task.policies], task.compared, task.primary)


@dataclass(frozen=True)
class Cost:
    """What a policy costs and reaches."""

    policy: PolicyScores
    action_us: float  # time of an action, with planning, microseconds
    score: Estimate  # in the unit of the quantity


def costs(task: TaskScores) -> tuple[Quantity, list[Cost]]:
    """Cost per action against the primary metric (against the return if there is none) of every policy."""
    shown = quantities(task)
    wanted = task.primary.key if task.primary else "return"
    quantity = next((each for each in shown if each.key == wanted), shown[0])
    found = [(policy, quantity.of(policy)) for policy in task.policies]
    return quantity, [Cost(policy, policy.action_us, score) for policy, score in found if score is not None]
