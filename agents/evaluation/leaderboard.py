"""The leaderboard: results of several policies on one task as a table, beside the bound and published figures."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich import box
from rich.console import Console
from rich.table import Table

from agents.evaluation import statistics
from agents.evaluation.bounds import BOUNDS
from agents.evaluation.evaluate import Evaluation
from agents.evaluation.statistics import Estimate
from agents.yaml_config import BenchmarkTask
from planners.typing import Array

LIMIT_TOLERANCE = 0.005
"""Share by which a limit may be exceeded before an episode counts as one that breaks it."""


@dataclass(frozen=True)
class Metric:
    """A number of ``info`` that has its own column: its key, its title, and the factor it is shown with.

    What is true or false is shown as a share, with its interval. By the primary one of a task, of which less is better,
    its episodes are compared.
    """

    key: str
    title: str
    factor: float = 1.0
    primary: bool = False


METRICS: dict[str, tuple[Metric, ...]] = {
    "ConveyorTrack-v0": (
        Metric("settling_time", "settled (s)", primary=True),
        Metric("steady_state_error", "error (mm)", 1e3),
    ),
    "MinTorqueMove-v0": (
        Metric("quintic_ratio", "torque / quintic's", primary=True),
        Metric("torque_l1", "PI1 (N m s)"),
        Metric("angle_error", "error (mrad)", 1e3),
    ),
    "ObstacleDodge-v0": (
        Metric("collision", "collided (%)"),
        Metric("time_to_goal", "to goal (s)", primary=True),
        Metric("min_clearance", "clearance (mm)", 1e3),
    ),
    "ExcavatorPayload-v0": (
        Metric("success_easy", "easy (%)"),
        Metric("tip_rms", "tip RMS (mm)", 1e3, primary=True),
        Metric("tip_max", "tip worst (mm)", 1e3),
        Metric("waypoint_error", "at waypoints (mm)", 1e3),
    ),
}


def primary_metric(env_id: str) -> Metric | None:
    """The number by which episodes of a task are compared; the less, the better."""
    return next((metric for metric in METRICS.get(env_id, ()) if metric.primary), None)


@dataclass
class TaskResult:
    """What is finished of one task.

    Attributes:
        task: the task.
        seeds: of its episodes.
        evaluations: one a policy.
        bounds: best known values for the first seeds of what `BOUNDS` bounds; None if they are not computed.
        action_configs: by policy, settings with which its actions are meant, where they are not the task's.
    """

    task: BenchmarkTask
    seeds: NDArray[np.int64]
    evaluations: list[Evaluation] = field(default_factory=list)
    bounds: Array | None = None
    action_configs: dict[str, Mapping[str, Any]] = field(default_factory=dict)

    def above_bound(self, evaluation: Evaluation) -> Array | None:
        """How much worse than the bound each episode is, where the bound is known."""
        if self.bounds is None:
            return None
        reachable = np.isfinite(self.bounds)
        reached = evaluation.metrics[BOUNDS[self.task.env].metric][: len(self.bounds)]
        return np.asarray(reached[reachable] - self.bounds[reachable])


def summary(result: TaskResult, evaluation: Evaluation) -> dict[str, Estimate]:
    """The estimates the leaderboard shows, and more, by name: medians, but for rates and the return."""
    estimates = {
        "success": statistics.rate(evaluation.success),
        "return": statistics.interquartile_mean(evaluation.returns),
        "length": statistics.median(evaluation.lengths),
    }
    if "limit_ratio" in evaluation.metrics:
        estimates["limit_broken"] = statistics.rate(evaluation.metrics["limit_ratio"] > 1.0 + LIMIT_TOLERANCE)
    for key, values in evaluation.metrics.items():
        if key != "is_success":
            estimates[key] = statistics.rate(values) if values.dtype == bool else statistics.median(values)
    above = result.above_bound(evaluation)
    if above is not None and above.size:
        estimates["above_bound"] = statistics.median(above)
    return estimates


def print_leaderboard(console: Console, result: TaskResult) -> None:
    """Print a task's table with what is to be known of it; as Markdown where the console is no terminal."""
    episodes = len(result.seeds)
    heading = f"{result.task.title}: {episodes} {'episode' if episodes == 1 else 'episodes'}"
    table = leaderboard(result)
    if console.is_terminal:
        for column in table.columns:
            column.header = str(column.header).replace(" ", "\n")  # narrow enough for 80 characters
            column.overflow = "fold"
        console.print(f"[bold]{heading}[/bold]", table, _caption(result), "", sep="\n", highlight=False)
        return
    table.box = box.MARKDOWN
    wide = Console(file=console.file, width=1000)  # a line of Markdown must not be broken
    wide.print(f"### {heading}", table, f"{_caption(result)}\n", sep="\n")


def leaderboard(result: TaskResult) -> Table:
    """The table of one task, best policy first: by success, then by return."""
    metrics = METRICS.get(result.task.env, ())
    bounded = result.bounds is not None
    table = Table("policy", box=box.SIMPLE_HEAD, padding=0, header_style="bold")
    table.add_column("success (%)", justify="right")
    for title in (*(metric.title for metric in metrics), *(("over bound",) if bounded else ())):
        table.add_column(title, justify="right")
    for title in ("limit ratio", "broken (%)", "return", "plan (ms)", "step (us)"):
        table.add_column(title, justify="right")
    rows = [(evaluation, summary(result, evaluation)) for evaluation in result.evaluations]
    for evaluation, estimates in sorted(rows, key=lambda row: (-row[1]["success"].value, -row[1]["return"].value)):
        table.add_row(*_policy_cells(evaluation, estimates, metrics, bounded=bounded))
    if result.bounds is not None:
        best = statistics.median(result.bounds).value
        possible = _share(statistics.rate(np.isfinite(result.bounds)))
        table.add_row("bound", possible, *_lone_cells(metrics, BOUNDS[result.task.env].metric, best), style="italic")
    if result.task.published is not None:
        table.add_row(
            "paper", "", *_lone_cells(metrics, "settling_time", result.task.published.settling_time), style="italic"
        )
    return table


def _policy_cells(
    evaluation: Evaluation, estimates: dict[str, Estimate], metrics: Sequence[Metric], *, bounded: bool
) -> Iterator[str]:
    yield evaluation.policy
    yield _share(estimates["success"])
    for metric in metrics:
        told = evaluation.metrics[metric.key].dtype == bool
        yield _share(estimates[metric.key]) if told else shown_number(estimates[metric.key].value * metric.factor)
    if bounded:
        yield shown_number(estimates["above_bound"].value) if "above_bound" in estimates else ""
    yield shown_number(estimates["limit_ratio"].value) if "limit_ratio" in estimates else ""
    yield _percent(estimates["limit_broken"].value) if "limit_broken" in estimates else ""
    yield with_interval(estimates["return"], shown_number)
    yield shown_number(evaluation.timing.planning_ms) if evaluation.timing.plans else ""
    yield shown_number(evaluation.timing.policy_us)


def _lone_cells(metrics: Sequence[Metric], key: str, value: float) -> list[str]:
    """Cells of the metric columns for a row of which one number alone is known."""
    return [shown_number(value * metric.factor) if metric.key == key else "" for metric in metrics]


def _caption(result: TaskResult) -> str:
    lines = [
        "Success, like other shares, with its 95 % interval. Return: interquartile mean with its 95 % bootstrap "
        "interval. All else: medians. "
        f"Limit ratio: worst value over its limit; broken: episodes in which it is more than {1.0 + LIMIT_TOLERANCE:g}."
    ]
    if result.bounds is not None:
        which = "" if len(result.bounds) == len(result.seeds) else f" (the first {len(result.bounds)})"
        lines.append(
            f"Bound: {BOUNDS[result.task.env].meaning}, from the same starts{which}; over bound: the difference."
        )
    steps = sum(evaluation.timing.env_steps for evaluation in result.evaluations)
    env_us = 1e6 * sum(evaluation.timing.env_seconds for evaluation in result.evaluations) / steps
    lines.append(f"Step: of the policy, without planning; the environment takes {env_us:.1f} us.")
    for policy, settings in result.action_configs.items():
        told = ", ".join(f"{name} {value}" for name, value in settings.items())
        lines.append(f"Actions of {policy}: {told}.")
    if result.task.published is not None:
        lines.append(f"Paper: {result.task.published.source}. {result.task.published.note}".strip())
    return " ".join(lines)


def _share(rate: Estimate) -> str:
    return f"{_percent(rate.value)} ({_percent(rate.low)}-{_percent(rate.high)})"


def _percent(share: float) -> str:
    return f"{100.0 * share:.1f}".removesuffix(".0")


def with_interval(estimate: Estimate, shown: Callable[[float], str]) -> str:
    """An estimate with its interval, if there is one; each number as it is to be shown."""
    value, low, high = (shown(end) for end in (estimate.value, estimate.low, estimate.high))
    return value if math.isnan(estimate.low) else f"{value} ({low} to {high})"


def shown_number(value: float) -> str:
    """A number with three decimals if it is small, with one if it is not."""
    if math.isinf(value):
        return "never"
    if 0.0 < abs(value) < 0.0005:
        return "<0.001"
    return f"{value:.3f}" if abs(value) < 10.0 else f"{value:.1f}"


def as_document(result: TaskResult) -> dict[str, Any]:
    """Everything of a task's results, for JSON. null in place of a time: never."""
    task = result.task
    return {
        "task": task.title,
        "env": task.env,
        "env_config": task.env_config,
        "options": task.options,
        "policies": [_evaluation_document(result, evaluation) for evaluation in result.evaluations],
        "bound": None
        if result.bounds is None
        else {"seeds": result.seeds[: len(result.bounds)], BOUNDS[result.task.env].metric: result.bounds},
        "published": task.published.model_dump() if task.published else None,
    }


def _evaluation_document(result: TaskResult, evaluation: Evaluation) -> dict[str, Any]:
    timing = evaluation.timing
    return {
        "policy": evaluation.policy,
        "action_config": result.action_configs.get(evaluation.policy, {}),
        "summary": {name: vars(estimate) for name, estimate in summary(result, evaluation).items()},
        "timing": {
            **vars(timing),
            "planning_ms": timing.planning_ms,
            "policy_us": timing.policy_us,
            "env_us": timing.env_us,
        },
        "episodes": {
            "seed": evaluation.seeds,
            "return": evaluation.returns,
            "length": evaluation.lengths,
            **evaluation.metrics,
        },
    }
