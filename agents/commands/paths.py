"""`planarm paths`: the paths of several policies from one start, side by side, as a table and a picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

import envs
from agents.commands.outputs import write_picture
from agents.commands.reset_options import given_options
from agents.console import note
from agents.environments import check_names, check_seed, import_env
from agents.figures.episode_record import EpisodeRecord, picture_of, record_episode
from agents.figures.paths import draw_paths
from agents.policies.lookup import name_policies
from agents.tables import Table, number_text
from agents.yaml_config import assigned, refuse_twice
from planners.checks import brief


@dataclass(frozen=True)
class PathsOptions:
    """Run one episode of each policy from the same start; print its outcome and draw its path.

    The pictures of the planners' pages:

        $ planarm paths ConveyorTrack-v0 --seed 0 --plot docs/pictures/paths_conveyor_track.png
        $ planarm paths MinTorqueMove-v0 --policies follower dpct lagrange apf --seed 18 \
--plot docs/pictures/paths_min_torque_move.png
        $ planarm paths ObstacleDodge-v0 --policies follower dpct lagrange apf --seed 29 \
--plot docs/pictures/paths_obstacle_dodge.png
        $ planarm paths ExcavatorPayload-v0 --policies computed_torque integral_computed_torque adaptive \
agent --seed 12 --plot docs/pictures/paths_excavator_payload.png
    """

    env: tyro.conf.Positional[str]
    """Id of the environment, such as ObstacleDodge-v0; module:id for your own."""
    policies: tuple[str, ...] | None = None
    """Names of experts, agent for the one that comes with planarm, paths of runs, agents or .zips, or module:name for
    your own; at most 4. If left out, the first three experts of the environment."""
    seed: int = 0
    """Seed of the episodes' start."""
    scenario: str | None = None
    """Which start, short for --options scenario=...; paper is the paper's."""
    level: str | None = None
    """Difficulty level, from the task's card (docs/benchmark/levels.md)."""
    options: tuple[str, ...] = ()
    """key=value for each option of the reset, such as belt_speed=0.2."""
    settings: tuple[str, ...] = ()
    """key=value for each setting of the environment to change from its default."""
    plot: Path | None = None
    """Draw the picture to this file: .png, .svg or .pdf."""
    dpi: int = 150
    """Resolution of the picture, which is 10 inches wide, dots per inch."""
    allow_code: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Load a Stable-Baselines3 .zip, and the statistics beside it, although any code in them is run."""


def run(options: PathsOptions) -> int:
    """Run the episodes; the exit code."""
    env_id = import_env(options.env)
    picture_of(env_id)  # raises for an environment without one
    names = list(envs.task_card(env_id).experts)[:3] if options.policies is None else options.policies
    if not 1 <= len(names) <= 4:
        raise ValueError(f"{len(names)} policies: give 1 to 4")
    refuse_twice(names, "policy")
    check_seed(options.seed)
    given = assigned({}, options.settings), given_options(options.options, options.scenario)
    settings, reset_options = envs.task_card(env_id).at_level(options.level, *given)
    check_names(env_id, settings, reset_options)
    policies = name_policies(names, env_id, allow_code=options.allow_code)
    for named in policies:
        if assumption := named.assumption(env_id, settings):
            note(f"{assumption}, such as --settings control_mode=jerk", "yellow")
    records = [record_episode(env_id, named, options.seed, reset_options, settings) for named in policies]
    paper = reset_options.get("scenario") == "paper"
    shown = [f"{name} {brief(value)}" for part in given for name, value in part.items() if value != "paper"]
    task = env_id if options.level is None else f"{env_id}/{options.level}"
    start = ", ".join([task, "the paper's start" if paper else f"seed {options.seed}", *shown])
    if options.plot is not None:
        write_picture(draw_paths(records, start), options.plot, options.dpi)
    outcome_table(start, records).show()
    return 0


def outcome_table(title: str, records: Sequence[EpisodeRecord]) -> Table:
    """The outcome of each policy, with the numbers of the leaderboard."""
    metrics = [metric for metric in envs.task_card(records[0].env_id).metrics if metric.key != "collision"]
    headers = ("policy", "outcome", *(metric.title for metric in metrics), "limit ratio", "return")
    rows = []
    for record in records:
        numbers = [metric.factor * record.info[metric.key] for metric in metrics]
        numbers += [record.info["limit_ratio"], record.info["return"]]
        rows.append((record.policy, record.outcome.replace("\n", " "), *map(number_text, numbers)))
    return Table(title, headers, rows, text_columns=2)
