"""`planarm curves`: learning curves of training runs, seeds side by side, as a table and a picture."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import tyro

from agents.commands.outputs import write_picture
from agents.console import note, say
from agents.evaluation.summarise import card_of
from agents.figures.curves import draw_curves
from agents.tables import Table, short_text
from agents.training.learning_curves import Curve, Groups, differing, grouped, read_curve, without_copies
from agents.yaml_config import refuse_twice
from envs.card import Metric
from envs.settings import refuse_unknown
from planners.files import check_output

COMMON = (Metric("success", "success (%)", 100.0), Metric("return", "return"))  # metrics of every task


@dataclass(frozen=True)
class CurvesOptions:
    """Draw learning curves of several training runs, and print their final scores.

    Runs are grouped by one of their settings; within a group only the seed should differ. Unfinished runs are shown as
    far as they are. What is no run, or has no evaluation yet, is left out and named. Runs of several environments give
    a table and a picture each: curves-ConveyorTrack-v0.png for --plot curves.png. The exit code is 1 if nothing can be
    shown.

    For example:

        $ planarm curves runs/clone-* runs/scratch-* --plot curves.png
        $ planarm curves runs/lr-* --by learning_rate --against steps --metrics success settling_time --plot curves.svg
    """

    runs: tyro.conf.Positional[tuple[Path, ...]]
    """Folders of planarm train, such as runs/*."""
    by: str = "warm_start"
    """The setting to group by; dots lead into nested ones, as in warm_start.episodes."""
    against: Literal["seconds", "steps"] = "seconds"
    """Horizontal axis of the picture: seconds of training, the warm start included, or control steps."""
    metrics: tuple[str, ...] = ()
    """Columns of metrics.csv, a panel each; by default success, return and what the task is measured by."""
    plot: Path | None = None
    """Draw the picture to this file: .png, .svg or .pdf."""
    dpi: int = 150
    """Resolution of the picture, which is 10 inches wide, dots per inch."""


def run(options: CurvesOptions) -> int:
    """Print the table and draw the picture; the exit code."""
    if not options.runs:
        raise ValueError("no runs: give the folders of at least one, such as runs/*")
    curves, skipped = read_curves(options.runs)
    shown, unfit = _by_environment(curves, options)
    skipped += unfit
    if not shown:
        note(f"planarm curves: no run to show: {'; '.join(skipped)}")
        return 1
    pictures = _pictures(options.plot, [env_id for env_id, _, _ in shown])
    for path in pictures:
        check_output(path)
    for path, (_, groups, metrics) in zip(pictures, shown, strict=False):
        write_picture(draw_curves(groups, metrics, options.against), path, options.dpi)
    for env_id, groups, metrics in shown:
        final_scores(env_id, groups, metrics).show()
    if skipped:
        say(f"Left out: {'; '.join(skipped)}.")
    return 0


def _pictures(plot: Path | None, env_ids: Sequence[str]) -> list[Path]:
    """The file of each environment's picture; none without a plot. A ValueError for two of the same name."""
    if plot is None or len(env_ids) == 1:
        return [] if plot is None else [plot]
    names = [re.sub(r"[^\w.-]+", "-", env_id) for env_id in env_ids]
    paths = [plot.with_name(f"{plot.stem}-{name}{plot.suffix}") for name in names]
    refuse_twice(map(str, paths), "the picture")
    return paths


def read_curves(folders: Sequence[Path]) -> tuple[list[Curve], list[str]]:
    """The curves of the runs among some paths, and a line about each of the others."""
    curves, skipped = [], []
    for folder in folders:
        if not folder.is_dir():
            skipped.append(f"{folder} is no folder")
        elif not (folder / "config.yaml").exists():
            skipped.append(f"{folder} is no run: it has no config.yaml")
        elif not (folder / "metrics.csv").exists():
            skipped.append(f"{folder} has no evaluation yet; a run writes its first once its warm start is done")
        else:
            try:
                curves.append(read_curve(folder))
            except ValueError as error:
                skipped.append(str(error))
    curves, copies = without_copies(curves)
    return curves, [*skipped, *copies]


def _by_environment(
    curves: Sequence[Curve], options: CurvesOptions
) -> tuple[list[tuple[str, Groups, list[Metric]]], list[str]]:
    """Groups and metrics of each environment, and a line about each run or environment that does not have them.

    Raises:
        ValueError: if none has the metrics, or the setting to group by.
    """
    environments: dict[str, list[Curve]] = {}
    for curve in curves:
        environments.setdefault(curve.config.env_id, []).append(curve)
    shown, lines, refused = [], list[str](), list[ValueError]()
    for env_id, own in environments.items():
        try:
            metrics = chosen_metrics(own, options.metrics)
            whole = [curve for curve in own if not _lacking(curve, metrics)]
            groups = grouped(whole, options.by)
        except ValueError as error:
            refused.append(error)
            lines.append(f"the runs of {env_id}: {error}")
            continue
        lines += [
            f"{curve.folder} has no column {', '.join(_lacking(curve, metrics))} in its metrics.csv"
            for curve in own
            if curve not in whole
        ]
        if whole:
            shown.append((env_id, groups, metrics))
    if refused and not shown:
        raise refused[0]
    return shown, lines


def _lacking(curve: Curve, metrics: Sequence[Metric]) -> list[str]:
    """Columns that a run does not have, of those of some metrics."""
    names = [metric.key for metric in metrics]
    return [
        name for name in (*names, *(f"expert_{name}" for name in names if curve.expert)) if name not in curve.columns
    ]


def chosen_metrics(curves: Sequence[Curve], names: Sequence[str]) -> list[Metric]:
    """The metrics to show: those of these names, or else success, return and the task's primary one.

    Raises:
        ValueError: for a name that is no column of any metrics.csv.
    """
    card, columns = card_of(curves[0].config.env_id), dict.fromkeys(name for curve in curves for name in curve.columns)
    known = {metric.key: metric for metric in (*COMMON, *card.metrics)}
    wanted = names or [metric.key for metric in (*COMMON, *([card.primary] if card.primary else []))]
    described = ("steps", "seconds")
    scores = (name for name in columns if name not in described and not name.startswith("expert_"))
    refuse_unknown(wanted, scores, "metric")
    return [known.get(name, Metric(name, name.replace("_", " "))) for name in wanted]


def final_scores(title: str, groups: Groups, metrics: Sequence[Metric]) -> Table:
    """The final scores of each group, and those of the best expert."""
    rows = [(label, *_group_cells(curves, metrics)) for label, curves in groups.items()]
    everything = [curve for curves in groups.values() for curve in curves]
    experts = []
    for curve in (curve for curve in everything if curve.expert):
        scores = (metric.factor * curve.columns[f"expert_{metric.key}"][-1] for metric in metrics)
        experts.append((f"{curve.expert} (expert)", *[""] * 4, *map(short_text, scores)))
    titles = [f"final {metric.title}" for metric in metrics]
    headers = ("runs", "seeds", "steps", "seconds", "best success (%)", *titles)
    return Table(title, headers, [*rows, *dict.fromkeys(experts)], " ".join(_caption(groups, everything)))


def _group_cells(curves: Sequence[Curve], metrics: Sequence[Metric]) -> Iterator[str]:
    under_way = sum(not curve.finished for curve in curves)
    yield f"{len(curves)} ({under_way} under way)" if under_way else str(len(curves))
    yield f"{np.mean([curve.columns['steps'][-1] for curve in curves]):,.0f}"
    yield _spread([curve.columns["seconds"][-1] for curve in curves], "{:.0f}".format)
    yield _spread([100.0 * curve.columns["success"][curve.best] for curve in curves])
    for metric in metrics:
        yield _spread([metric.factor * curve.columns[metric.key][-1] for curve in curves])


def _caption(groups: Groups, everything: Sequence[Curve]) -> Iterator[str]:
    """What the numbers are, sentence by sentence."""
    yield (
        "Means over the seeds, with the least and the greatest. Best: at each run's best checkpoint, selected on the "
        "same episodes, so slightly optimistic; final: at its last. Success and return: means over the episodes; all "
        "else: medians, of failures too. Seconds: of training, the warm start's among them, without evaluations."
    )
    for label, curves in groups.items():
        if names := differing(curves):
            yield f'The runs of "{label}" differ in more than the seed: {", ".join(names)}.'
    if any(name.startswith("env_config.") for name in differing(everything)):
        yield "The runs' environments have different settings: returns may not compare."


def _spread(values: Sequence[float], text: Callable[[float], str] = short_text) -> str:
    """Mean of a value of each seed, the least and the greatest."""
    mean, low, high = map(text, (float(np.mean(values)), min(values), max(values)))
    return mean if low == high else f"{mean} ({low} to {high})"
