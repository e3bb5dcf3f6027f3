"""Learning curves of training runs, read from their folders, and grouped by their settings."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from agents.training.recipe import RECIPES, TrainingConfig
from agents.yaml_config import load_config
from envs.settings import refuse_unknown
from planners.typing import Array

_MOST_CHARACTERS = 1 << 24  # of metrics.csv
Row = dict[str, Any]  # a row of metrics.csv, by column
BY_START = "warm_start"  # groups by what a run begins with, and by its algorithm
Groups = dict[str, list["Curve"]]  # curves by the label of their group


@dataclass(frozen=True)
class Curve:
    """Scores of a training run, checkpoint by checkpoint."""

    folder: Path
    config: TrainingConfig
    expert: str  # name of the best expert on the same episodes; "" if the run has no baselines
    columns: dict[str, Array]  # numbers of metrics.csv, ``(checkpoints,)`` each; +inf: never

    @property
    def finished(self) -> bool:
        """Whether all steps are done."""
        return bool(self.columns["steps"][-1] >= self.config.total_steps)

    @property
    def best(self) -> int:
        """Index of the best checkpoint: most success, then the highest return."""
        success, returns = self.columns["success"], self.columns["return"]
        return max(range(len(success)), key=lambda row: (success[row], returns[row]))


def merit(row: Row) -> tuple[float, float]:
    """What agents are ranked by: success rate first, then the return."""
    return row["success"], row["return"]


def read_curve(folder: Path) -> Curve:
    """The curve of the run in a folder, up to its last checkpoint.

    Raises:
        ValueError: if there is no run, it has not been evaluated yet, or its files are damaged.
    """
    config = load_config(str(folder / "config.yaml"), TrainingConfig)
    path = folder / "metrics.csv"
    if path.exists() and not path.is_file():
        raise ValueError(f"{path} is no file")
    try:
        with path.open(encoding="utf-8", newline="") as file:
            text = file.read(_MOST_CHARACTERS + 1)
        if len(text) > _MOST_CHARACTERS:
            raise OSError(f"it has more than {_MOST_CHARACTERS} characters")
        rows = list(csv.DictReader(io.StringIO(text, newline="")))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f"cannot read {path}, which a run writes at its first evaluation: {error}") from None
    try:
        if not rows:
            raise ValueError("it has no row")
        expert = rows[0].get("expert", "")
        for name in ("steps", "seconds", "success", "return", *(("expert_success", "expert_return") if expert else ())):
            if name not in rows[0]:
                raise ValueError(f"it has no column {name}")
        columns = {name: np.array([float(row[name] or "nan") for row in rows]) for name in rows[0] if name != "expert"}
        if not (np.isfinite([columns["steps"], columns["seconds"]]).all() and np.all(np.diff(columns["steps"]) > 0.0)):
            raise ValueError("steps and seconds must be finite, and steps must grow from row to row")
        if np.isnan([columns["success"], columns["return"]]).any():
            raise ValueError("success and return must be numbers")
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path} is damaged: {str(error)[:200]}") from None
    return Curve(folder, config, expert, columns)


def without_copies(curves: Sequence[Curve]) -> tuple[list[Curve], list[str]]:
    """The runs that are all different, and a line about each other one: two of one seed would pass for agreement.

    Of two of the same settings the one that is further is kept.
    """
    kept: dict[str, Curve] = {}
    copies = []
    for curve in curves:
        key = curve.config.model_dump_json(exclude={"device", "threads"})
        other = kept.setdefault(key, curve)
        if other is not curve:
            if curve.columns["steps"][-1] > other.columns["steps"][-1]:
                kept[key], curve, other = curve, other, curve
            copies.append(
                f"{curve.folder} has the same settings and seed {curve.config.seed} as {other.folder}: the same "
                "run twice"
            )
    return list(kept.values()), copies


def grouped(curves: Sequence[Curve], key: str) -> Groups:
    """Curves by the value of a setting in their configurations; a ValueError if no run has such a setting."""
    settings = [_settings(curve.config) for curve in curves]
    refuse_unknown([key], {BY_START}.union(*settings), "setting to group by")
    groups: Groups = {}
    for curve, values in zip(curves, settings, strict=True):
        groups.setdefault(_label(key, values), []).append(curve)
    return groups


def differing(curves: Sequence[Curve]) -> list[str]:
    """Names of the settings other than the seed that differ between these runs.

    Of nested settings those that differ are named, or the whole if some runs lack it.
    """
    settings = [_settings(curve.config) for curve in curves]
    names: list[str] = []
    for name in dict.fromkeys(name for values in settings for name in values):
        values = [own.get(name) for own in settings]
        nested = all(isinstance(value, dict) for value in values)
        if name != "seed" and not nested and not name.startswith(tuple(f"{other}." for other in names)):
            names += [name] if len(set(map(_text, values))) > 1 else []
    return names


def _settings(config: TrainingConfig) -> dict[str, Any]:
    """All settings by name, nested ones as a whole and one by one."""
    return dict(_flat(config.model_dump(mode="json"), ""))


def _flat(settings: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, Any]]:
    for name, value in settings.items():
        yield prefix + name, value
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{name}.")


def _label(key: str, settings: Mapping[str, Any]) -> str:
    if key != BY_START:
        return f"{key}={_text(settings.get(key))}"
    title = RECIPES[settings["algorithm"]].title
    if settings.get("warm_start"):
        then = f", then {title}" if settings.get("total_steps") else ""
        return f"cloning {_source(settings['warm_start'])}{then}"
    if settings.get("demonstrations"):
        return f"demonstrations of {_source(settings['demonstrations'])}, then {title}"
    return f"fitting to the cost, then {title}" if settings.get("amortise") else f"{title} alone"


def _source(teacher: Mapping[str, Any]) -> str:
    """The expert or the dataset that a run learns from."""
    return str(teacher.get("expert") or teacher.get("dataset"))


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)
