"""A sweep and its folder: what was asked for is in ``sweep.json``, each trial is a training run in ``trials/``."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from agents.cluster import Place
from agents.environments import import_env, portable
from agents.provenance import versions
from agents.sweeps.axes import value_text
from agents.training import devices
from agents.training.learning_curves import Row, read_curve
from agents.training.recipe import TrainingConfig
from planners.documents import read_document
from planners.files import write_json

Scheduler = Literal["grid", "asha"]
ABOUT = "sweep.json"
_MOST_BYTES = 1 << 27
_LONGEST = 100  # characters of a folder's name


@dataclass(frozen=True)
class Trial:
    """One training run of a sweep."""

    name: str  # of its folder
    values: Mapping[str, Any]  # of the settings that the sweep varies
    config: TrainingConfig  # whole, with device and threads as they were resolved when the sweep began


@dataclass(frozen=True)
class Plan:
    """How the trials of a sweep are run.

    Attributes:
        scheduler: ``grid`` trains every trial to its end; ``asha`` ends those that fall behind (asynchronous successive
            halving, Li et al. 2020).
        grace_steps: control steps that ASHA gives every trial.
        reduction: ASHA lets one of so many go on at each of its milestones.
        retries: how often a trial whose worker is lost goes on from its last checkpoint; -1 for any number.
    """

    scheduler: Scheduler = "grid"
    grace_steps: int = 1
    reduction: float = 3.0
    retries: int = 3


@dataclass(frozen=True)
class Sweep:
    """Trials in a folder.

    Raises:
        ValueError: for trials of different environments, whose scores cannot be ranked.
    """

    folder: Path
    trials: Sequence[Trial]
    plan: Plan
    command: str

    def __post_init__(self) -> None:
        if len(found := {trial.config.env_id for trial in self.trials}) > 1:
            raise ValueError(
                f"the trials are of {' and '.join(sorted(found))}, whose scores cannot be ranked in one table: make "
                "a sweep for each"
            )

    @property
    def keys(self) -> list[str]:
        """The settings that the trials vary."""
        return list(dict.fromkeys(key for trial in self.trials for key in trial.values))

    def folder_of(self, trial: Trial) -> Path:
        """Where a trial's run is."""
        return self.folder / "trials" / trial.name

    def check_new(self) -> None:
        """Raise a ValueError if there is something in the folder already."""
        if self.folder.exists() and (not self.folder.is_dir() or any(self.folder.iterdir())):
            raise ValueError(
                f"{self.folder} is not empty: choose another --out, or go on with the sweep there: "
                f"planarm sweep --resume {self.folder}"
            )

    def write(self) -> None:
        """Write what was asked for into the folder; raises as `check_new`."""
        self.check_new()
        trials = [
            {"name": trial.name, "values": trial.values, "config": trial.config.model_dump(mode="json")}
            for trial in self.trials
        ]
        write_json(
            self.folder / ABOUT,
            {
                "command": self.command,
                "began": datetime.now(UTC).isoformat("T", "seconds"),
                "versions": versions(("stable-baselines3", "torch")),
                "plan": vars(self.plan),
                "trials": trials,
            },
        )

    @classmethod
    def read(cls, folder: Path) -> Sweep:
        """The sweep in a folder.

        Raises:
            ValueError: if there is none, its file is damaged, or its trials are of different environments.
        """
        if not (folder / ABOUT).is_file():
            raise ValueError(f"{folder} is no folder of a sweep: it has no {ABOUT}")
        about = read_document(folder / ABOUT, _MOST_BYTES)
        try:
            trials = [
                Trial(str(trial["name"]), dict(trial["values"]), TrainingConfig.parse(trial["config"], ABOUT))
                for trial in about["trials"]
            ]
            if any(not re.fullmatch(r"[\w=.+-]+", trial.name) for trial in trials):
                raise ValueError("the name of a trial is no name of a folder")
            plan, command = Plan(**about["plan"]), str(about["command"])
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f"{folder / ABOUT} is damaged: {str(error)[:200]}; restore it, or begin again") from None
        return cls(folder, trials, plan, command)


def make_trials(base: TrainingConfig, points: Sequence[Mapping[str, Any]]) -> list[Trial]:
    """The trials of a sweep, each a whole recipe.

    Args:
        base: the recipe that they share.
        points: the values of each, by the names of settings; dots lead into nested ones.

    Raises:
        ValueError: for a setting that does not exist or a value that it refuses, and if two trials are the same.
    """
    trials: list[Trial] = []
    known: dict[str, str] = {}
    for number, values in enumerate(points):
        config = base.overridden(f"{key}={json.dumps(value)}" for key, value in values.items())
        import_env(config.env)
        config = devices.resolved(config).model_copy(update={"env_config": portable(config.env_config)})
        name = f"{number:0{len(str(len(points) - 1))}d}-" + "-".join(
            f"{key}={value_text(value)}" for key, value in values.items()
        )
        name = re.sub(r"[^\w=.+-]+", "_", name)[:_LONGEST]
        twin = known.setdefault(config.model_dump_json(exclude={"device", "threads"}), name)
        if twin != name:
            raise ValueError(f"the trials {twin} and {name} have the same settings: give each value once")
        trials.append(Trial(name, dict(values), config))
    return trials


def check_asha(trials: Sequence[Trial], grace_steps: int | None, reduction: float) -> Plan:
    """ASHA for some trials; its grace lasts to the second checkpoint if it is left out.

    Raises:
        ValueError: for numbers that ASHA cannot work with, or trials of different lengths.
    """
    steps = {trial.config.total_steps for trial in trials}
    if len(steps) > 1:
        raise ValueError("ASHA compares trials at the same steps: do not sweep over total_steps, or take grid")
    total = steps.pop()
    segment = max(trial.config.segment_steps for trial in trials)
    grace = 2 * segment if grace_steps is None else grace_steps
    if not 1 <= grace < total:
        raise ValueError(
            f"grace_steps {grace:,} must be from 1 to below total_steps, {total:,}: ASHA decides at checkpoints, which "
            f"are {segment:,} steps apart; lower checkpoint_steps or raise total_steps"
        )
    if not reduction > 1.0:
        raise ValueError(f"reduction {reduction:g} must be above 1, such as 3: one of so many trials goes on")
    return Plan("asha", grace, reduction)


@dataclass(frozen=True)
class Task:
    """What a worker does: a trial, in a folder that every node sees."""

    trial: Trial
    sweep: Path  # folder of the sweep
    folder: Path  # of the trial
    command: str
    ended: bool  # whether ASHA has ended it before: then it only reports its scores again
    place: Place


def rows_so_far(folder: Path) -> list[Row]:
    """The scores of a run at each of its checkpoints; none if it has no checkpoint yet."""
    if not (folder / "metrics.csv").is_file():
        return []
    columns = read_curve(folder).columns
    return [{name: float(values[place]) for name, values in columns.items()} for place in range(len(columns["steps"]))]
