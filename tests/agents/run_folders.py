"""Folders of training runs made by hand: what `planarm train` leaves, without training."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from agents.training.recipe import TrainingConfig

CONVEYOR = "ConveyorTrack-v0"
EXPERT = {"expert": "dpct", "expert_success": 1.0, "expert_return": 1.3, "expert_settling_time": 1.06}


def config(**changes: Any) -> TrainingConfig:
    return TrainingConfig.parse({"env": CONVEYOR, "total_steps": 200, **changes}, "training setting")


def make_run(folder: Path, rows: Sequence[tuple[float, ...]], **changes: Any) -> Path:
    """A run with rows of steps, seconds, success, return and settling time."""
    folder.mkdir(parents=True)
    (folder / "config.yaml").write_text(yaml.safe_dump(config(**changes).model_dump(mode="json")))
    if rows:
        names = ["steps", "seconds", "success", "return", "settling_time"]
        with (folder / "metrics.csv").open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow([*names, *EXPERT])
            writer.writerows([*row, *EXPERT.values()] for row in rows)
    return folder
