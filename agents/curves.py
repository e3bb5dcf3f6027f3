"""`planarm curves`: how training runs came along, seeds side by side, as a table and a picture."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro
from rich import box
from rich.console import Console
from rich.table import Table

from agents.curves_figure import draw_curves
from agents.experiment import load_experiment
from agents.files import write_bytes
from agents.leaderboard import METRICS, Metric, primary_metric, shown_number
from agents.paths import FORMATS
from agents.paths_figure import picture_bytes
from agents.report import new_sheet
from agents.training.config import TrainingConfig
from envs.settings import refuse_unknown
from planners.typing import Array

Groups = dict[str, list["Curve"]]
"""Curves by what they have in common."""

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


@dataclass(frozen=True)
class Curve:
    """What has become of a training run, checkpoint by checkpoint.

    Attributes:
        folder: of the run.
        config: what it does.
        expert: name of the best expert on the same episodes.
        columns: numbers of metrics.csv, ``(checkpoints,)`` each; +inf: never.
    """

    folder: Path
    config: TrainingConfig
    expert: str
    columns: dict[str, Array]

    @property
    def finished(self) -> bool:
        """Whether all steps are done."""
        return bool(self.columns["steps"][-1] >= self.config.total_steps)

    @property
    def best(self) -> int:
        """The checkpoint whose agent is kept as the best: most success, then the highest return."""
        success, returns = self.columns["success"], self.columns["return"]
        return max(range(len(success)), key=lambda row: (success[row], returns[row]))


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
        write_bytes(options.plot, picture_bytes(sheet, options.plot.suffix.lower().removeprefix("."), options.dpi))
        Console(stderr=True).print(f"wrote {options.plot}", soft_wrap=True)
    return 0


def read_curve(folder: Path) -> Curve:
    """The curve of the run in a folder, as far as it has come.

    Raises:
        ValueError: if there is no run, it has not been evaluated yet, or its files are damaged.
    """
    config = load_experiment(str(folder / "config.yaml"), TrainingConfig)
    path = folder / "metrics.csv"
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"cannot read {path}, which a run writes at its first evaluation: {error}") from None
    try:
        expert = rows[0]["expert"]
        columns = {name: np.array([float(row[name]) for row in rows]) for name in rows[0] if name != "expert"}
        for name in ("steps", "seconds", "success", "return", "expert_success", "expert_return"):
            columns[name]  # a KeyError if it is missing
    except (IndexError, KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path} is damaged: {type(error).__name__} {error}") from None
    return Curve(folder, config, expert, columns)


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


def grouped(curves: Sequence[Curve], key: str) -> Groups:
    """Curves by what their configurations say for a setting.

    Raises:
        ValueError: if no run has such a setting.
    """
    settings = [_settings(curve.config) for curve in curves]
    refuse_unknown([key], set().union(*settings), "setting to group by")
    groups: Groups = {}
    for curve, values in zip(curves, settings, strict=True):
        groups.setdefault(_label(key, values), []).append(curve)
    return groups


def differing(curves: Sequence[Curve]) -> list[str]:
    """Names of the settings, but for the seed, that are not the same in all of these runs.

    Of nested settings those that differ are named, or the whole if some runs do not have it.
    """
    settings = [_settings(curve.config) for curve in curves]
    names: list[str] = []
    for name in dict.fromkeys(name for values in settings for name in values):
        values = [own.get(name) for own in settings]
        nested = all(isinstance(value, dict) for value in values)
        if name != "seed" and not nested and not name.startswith(tuple(f"{other}." for other in names)):
            names += [name] if len(set(map(_text, values))) > 1 else []
    return names


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


def check_alike(curves: Sequence[Curve]) -> None:
    """Raise a ValueError unless the runs can stand in one picture."""
    first = curves[0]
    for curve in curves:
        if curve.config.env != first.config.env:
            raise ValueError(
                f"{first.folder} is a run of {first.config.env}, {curve.folder} one of {curve.config.env}; "
                "give runs of one environment"
            )
    seen: dict[str, Path] = {}
    for curve in curves:
        other = seen.setdefault(curve.config.model_dump_json(), curve.folder)
        if other is not curve.folder:
            raise ValueError(
                f"{other} and {curve.folder} have the same settings and seed {curve.config.seed}: the same run twice, "
                "which would pass for agreement between seeds; leave one out"
            )


def _has_no_rows(folder: Path) -> bool:
    """Whether a folder is that of a run which has not been evaluated yet."""
    return (folder / "config.yaml").exists() and not (folder / "metrics.csv").exists()


def _settings(config: TrainingConfig) -> dict[str, Any]:
    """All settings by name, nested ones as a whole and one by one."""
    return dict(_flat(config.model_dump(mode="json"), ""))


def _flat(settings: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, Any]]:
    for name, value in settings.items():
        yield prefix + name, value
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{name}.")


def _label(key: str, settings: Mapping[str, Any]) -> str:
    if key != "warm_start":
        return f"{key}={_text(settings.get(key))}"
    if settings["warm_start"]:
        return f"cloning {settings['warm_start']['expert']}, then PPO"
    return "fitting to the cost, then PPO" if settings["amortise"] else "PPO alone"


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)


def _names(folders: Sequence[Path]) -> str:
    return ", ".join(map(str, folders))


def _spread(values: Sequence[float], form: str = "") -> str:
    """Mean of a value of each seed, the least and the greatest."""
    ends = (float(np.mean(values)), min(values), max(values))
    mean, low, high = (format(value, form) if form else shown_number(value).removesuffix(".0") for value in ends)
    return mean if low == high else f"{mean} ({low} to {high})"
