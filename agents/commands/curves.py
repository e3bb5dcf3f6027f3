"""`planarm curves`: how training runs came along, seeds side by side, as a table and a picture."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import tyro
from rich import box
from rich.console import Console
from rich.table import Table

from agents.evaluation.leaderboard import METRICS, Metric, primary_metric, shown_number
from agents.figures.curves import draw_curves
from agents.figures.sheet import FORMATS, image_bytes, new_sheet
from agents.files import write_bytes
from agents.training.learning_curves import Curve, Groups, check_alike, differing, grouped, read_curve
from envs.settings import refuse_unknown

COMMON = (Metric("success", "success (%)", 100.0), Metric("return", "return"))
"""What every task has."""


@dataclass(frozen=True)
class CurvesOptions:
    """Draw learning curves of several training runs of one task, and say how they ended.

    Runs are put together by one of their settings; what else differs within a group should be the seed. Runs that are
    still under way are shown as far as they are.

    For example:

        $ planarm curves runs/clone-* runs/scratch-* --plot curves.png
        $ planarm curves runs/lr-* --by learning_rate --against steps --metrics success settling_time --plot curves.svg
    """

    runs: tyro.conf.Positional[tuple[Path, ...]]
    """Folders of `planarm train`."""
    by: str = "warm_start"
    """The setting that tells the groups apart; dots lead into nested ones, as in warm_start.episodes."""
    against: Literal["seconds", "steps"] = "seconds"
    """What the picture's curves run against: seconds of training, of which a warm start takes its part, or control
    steps."""
    metrics: tuple[str, ...] = ()
    """Columns of metrics.csv, a panel each; by default success, return and what the task is measured by."""
    plot: Path | None = None
    """Draw the picture to this file: .png, .svg or .pdf."""
    dpi: int = 150
    """Resolution of the picture, which is 10 inches wide, dots per inch."""


def run(options: CurvesOptions) -> int:
    """Print the table and draw the picture; the exit code.

    Raises:
        ValueError: for folders that hold no runs, runs of different environments or the same run twice, or an unknown
            setting, metric or file format.
        ModuleNotFoundError: if a picture is asked for and matplotlib is missing.
    """
    _check(options)
    waiting = [folder for folder in options.runs if _has_no_rows(folder)]
    curves = [read_curve(folder) for folder in options.runs if folder not in waiting]
    if not curves:
        raise ValueError(f"{_names(waiting)}: no evaluation yet; a run writes its first once its warm start is done")
    check_alike(curves)
    metrics = chosen_metrics(curves, options.metrics)
    groups = grouped(curves, options.by)
    console = Console()
    print_table(console, curves[0].config.env, groups, metrics)
    if waiting:
        console.print(f"Left out, without an evaluation yet: {_names(waiting)}.", soft_wrap=True)
    if options.plot is not None:
        sheet = draw_curves(groups, metrics, options.against)
        write_bytes(options.plot, image_bytes(sheet, options.plot.suffix, options.dpi, colors=256))
        Console(stderr=True).print(f"wrote {options.plot}", soft_wrap=True)
    return 0


def chosen_metrics(curves: Sequence[Curve], names: Sequence[str]) -> list[Metric]:
    """What the panels show: the metrics of these names, or else what says most of the task.

    Raises:
        ValueError: for a name that is no column of metrics.csv.
    """
    env, columns = curves[0].config.env, curves[0].columns
    known = {metric.key: metric for metric in (*COMMON, *METRICS.get(env, ()))}
    own = primary_metric(env)
    wanted = names or [metric.key for metric in (*COMMON, *([own] if own else []))]
    refuse_unknown(wanted, (name for name in columns if f"expert_{name}" in columns), "metric")
    return [known.get(name, Metric(name, name.replace("_", " "))) for name in wanted]


def print_table(console: Console, env: str, groups: Groups, metrics: Sequence[Metric]) -> None:
    """Print how the groups ended, with what is to be known of it; as Markdown where the console is no terminal."""
    table, caption = summary_table(groups, metrics), _caption(groups)
    if console.is_terminal:
        for column in table.columns:
            column.header = str(column.header).replace(" ", "\n")
        console.print(f"[bold]{env}[/bold]", table, caption, sep="\n", highlight=False)
        return
    table.box = box.MARKDOWN
    wide = Console(file=console.file, width=1000)  # a line of Markdown must not be broken
    wide.print(f"### {env}", table, f"{caption}\n", sep="\n", highlight=False, soft_wrap=True)


def summary_table(groups: Groups, metrics: Sequence[Metric]) -> Table:
    """How each group ended, and what the best expert does."""
    table = Table("runs", box=box.SIMPLE_HEAD, padding=0, header_style="bold")
    for title in ("seeds", "steps", "seconds", "best success (%)", *(f"final {metric.title}" for metric in metrics)):
        table.add_column(title, justify="right")
    for label, curves in groups.items():
        table.add_row(label, *_group_cells(curves, metrics))
    experts: dict[tuple[str, ...], None] = {}
    for curve in (curve for curves in groups.values() for curve in curves):
        numbers = [_spread([metric.factor * curve.columns[f"expert_{metric.key}"][-1]]) for metric in metrics]
        experts[(f"{curve.expert} (expert)", "", "", "", "", *numbers)] = None
    for cells in experts:
        table.add_row(*cells, style="italic")
    return table


def _group_cells(curves: Sequence[Curve], metrics: Sequence[Metric]) -> Iterator[str]:
    under_way = sum(not curve.finished for curve in curves)
    yield f"{len(curves)} ({under_way} under way)" if under_way else str(len(curves))
    yield f"{np.mean([curve.columns['steps'][-1] for curve in curves]):,.0f}"
    yield _spread([curve.columns["seconds"][-1] for curve in curves], ".0f")
    yield _spread([100.0 * curve.columns["success"][curve.best] for curve in curves])
    for metric in metrics:
        yield _spread([metric.factor * curve.columns[metric.key][-1] for curve in curves])


def _caption(groups: Groups) -> str:
    lines = [
        "Means over the seeds, with the least and the greatest. Best: at each run's best checkpoint, which the same "
        "episodes chose, so a little flattering; final: at its last. Success and return: means over the episodes; all "
        "else: medians, of failures too. Seconds: of training, the warm start's among them, without evaluations."
    ]
    for label, curves in groups.items():
        if names := differing(curves):
            lines.append(f'The runs of "{label}" differ in more than the seed: {", ".join(names)}.')
    everything = [curve for curves in groups.values() for curve in curves]
    if any(name.startswith("env_config.") for name in differing(everything)):
        lines.append("The runs' environments have different settings: returns may not compare.")
    return " ".join(lines)


def _check(options: CurvesOptions) -> None:
    if not options.runs:
        raise ValueError("no runs: give the folders of at least one, such as runs/*")
    resolved = [folder.resolve() for folder in options.runs]
    if len(set(resolved)) < len(resolved):
        twice = next(folder for folder in resolved if resolved.count(folder) > 1)
        raise ValueError(f"{twice} is given twice")
    if not 40 <= options.dpi <= 600:
        raise ValueError(f"dpi {options.dpi} must be from 40 to 600")
    if options.plot is not None:
        refuse_unknown([options.plot.suffix.lower()], FORMATS, f"file format of {options.plot}:")
        new_sheet(1.0, 1.0)  # says now if matplotlib is missing


def _has_no_rows(folder: Path) -> bool:
    """Whether a folder is that of a run which has not been evaluated yet."""
    return (folder / "config.yaml").exists() and not (folder / "metrics.csv").exists()


def _names(folders: Sequence[Path]) -> str:
    return ", ".join(map(str, folders))


def _spread(values: Sequence[float], form: str = "") -> str:
    """Mean of a value of each seed, the least and the greatest."""
    ends = (float(np.mean(values)), min(values), max(values))
    mean, low, high = (format(value, form) if form else shown_number(value).removesuffix(".0") for value in ends)
    return mean if low == high else f"{mean} ({low} to {high})"
