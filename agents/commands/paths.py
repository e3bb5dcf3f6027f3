"""`planarm paths`: the ways that several policies take from one start, side by side, as a table and a picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro
from rich import box
from rich.table import Table

from agents.evaluation.leaderboard import METRICS
from agents.figures.episode_record import EpisodeRecord, picture_of, record_episode
from agents.figures.paths import draw_paths
from agents.figures.sheet import FORMATS, image_bytes, new_sheet
from agents.files import write_bytes
from agents.papers.report import report_console
from agents.policies.lookup import find_policy
from envs.settings import refuse_unknown


@dataclass(frozen=True)
class PathsOptions:
    """Run one episode of each policy from the same start; say and draw what became of it.

    The pictures of the README:

        $ planarm paths ConveyorTrack-v0 --seed 0 --plot docs/paths_conveyor_track.png
        $ planarm paths MinTorqueMove-v0 --policies follower dpct lagrange apf --seed 18 \
--plot docs/paths_min_torque_move.png
        $ planarm paths ObstacleDodge-v0 --policies follower dpct lagrange apf --seed 29 \
--plot docs/paths_obstacle_dodge.png
        $ planarm paths ExcavatorPayload-v0 --policies computed_torque integral_computed_torque adaptive \
agent --seed 12 --plot docs/paths_excavator_payload.png
    """

    env: tyro.conf.Positional[str]
    """Id of the environment, such as ObstacleDodge-v0."""
    policies: tuple[str, ...] = ("dpct", "lagrange", "apf")
    """Names of experts, agent for the one that comes with planarm, or paths of runs; at most 4."""
    seed: int = 0
    """Seed of the episodes' start."""
    scenario: Literal["random", "paper"] = "random"
    """Draw the start, or take the paper's."""
    plot: Path | None = None
    """Draw the picture to this file: .png, .svg or .pdf."""
    dpi: int = 150
    """Resolution of the picture, which is 10 inches wide, dots per inch."""


def run(options: PathsOptions) -> int:
    """Run the episodes; the exit code.

    Raises:
        ValueError: for an unknown environment, policy or file format, or a bad number, before anything runs.
        ModuleNotFoundError: if a picture is asked for and matplotlib is missing.
    """
    _check(options)
    policies = [find_policy(name, options.env) for name in options.policies]
    scenario = {"scenario": options.scenario}
    records = [record_episode(options.env, named, options.seed, scenario) for named in policies]
    console = report_console()
    start = f"{options.env}, " + ("the paper's start" if options.scenario == "paper" else f"seed {options.seed}")
    console.print(outcome_table(start, records))
    if options.plot is not None:
        sheet = draw_paths(records, start)
        write_bytes(options.plot, image_bytes(sheet, options.plot.suffix, options.dpi, colors=256))
        console.print(f"wrote {options.plot}")
    return 0


def outcome_table(title: str, records: Sequence[EpisodeRecord]) -> Table:
    """What became of each policy, with the numbers of the leaderboard."""
    table = Table("policy", "outcome", title=title, title_justify="left", box=box.SIMPLE_HEAD)
    metrics = [metric for metric in METRICS[records[0].env_id] if metric.key != "collision"]
    for heading in (*(metric.title for metric in metrics), "limit ratio", "return"):
        table.add_column(heading, justify="right")
    for record in records:
        numbers = [f"{metric.factor * record.info[metric.key]:.6g}" for metric in metrics]
        outcome = record.outcome.replace("\n", " ")
        last = (f"{record.info[key]:.6g}" for key in ("limit_ratio", "return"))
        table.add_row(record.policy, outcome, *numbers, *last)
    return table


def _check(options: PathsOptions) -> None:
    picture_of(options.env)
    if not 1 <= len(options.policies) <= 4:
        raise ValueError(f"{len(options.policies)} policies: give 1 to 4")
    if options.seed < 0:
        raise ValueError(f"seed {options.seed} must not be negative")
    if not 40 <= options.dpi <= 600:
        raise ValueError(f"dpi {options.dpi} must be from 40 to 600")
    if options.plot is not None:
        refuse_unknown([options.plot.suffix.lower()], FORMATS, f"file format of {options.plot}:")
        new_sheet(1.0, 1.0)  # says now, not after the episodes, if matplotlib is missing
