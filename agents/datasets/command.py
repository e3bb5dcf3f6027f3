"""`planarm dataset`: record episodes of policies as a Minari dataset."""

from __future__ import annotations

import shlex
import sys
from dataclasses import dataclass
from typing import Annotated

import tyro

import envs
from agents.commands.reset_options import given_options
from agents.console import INTERRUPTED, catch_interrupt, note, progress_bar
from agents.datasets.record import Recording, record_dataset
from agents.environments import import_env
from agents.tables import Table, number_text, percent_text
from agents.yaml_config import assigned
from envs.experts import expert_names


@dataclass(frozen=True)
class DatasetOptions:
    """Record episodes of policies as a Minari dataset: demonstrations to learn from.

    Every episode holds observations, actions, rewards and infos, its seed, and what the policy had planned; a fresh
    environment repeats it to the bit. Ctrl-C keeps the episodes so far.

    For example:

        $ planarm dataset ConveyorTrack-v0 --policies dpct apf --episodes 200 --out belt/planners-v0
        $ planarm dataset ObstacleDodge-v0 --settings control_mode=velocity --only-successes --out dodge/apf-v0
        $ planarm train bc/ObstacleDodge-v0 warm_start.dataset=dodge/apf-v0
    """

    env: tyro.conf.Positional[str]
    """Id of the environment, such as ConveyorTrack-v0; module:id for your own."""
    out: str
    """Id of the dataset, (namespace/)name-v0. Minari keeps it below MINARI_DATASETS_PATH, ~/.minari/datasets if left
    out."""
    policies: tuple[str, ...] = ()
    """Names of experts, by default the first on the task's card; agent for the one that comes with planarm; the path of
    a run, an agent or a .zip; module:name for your own."""
    episodes: int = 100
    """Episodes of each policy."""
    seed: int = 0
    """Seed of the first episode; each further episode has the next."""
    scenario: str | None = None
    """Which start, short for --options scenario=...; paper is the paper's."""
    options: tuple[str, ...] = ()
    """key=value for each option of the reset, such as belt_speed=0.2."""
    level: str | None = None
    """Difficulty level, from the task's card (docs/benchmark/levels.md)."""
    settings: tuple[str, ...] = ()
    """key=value for each setting of the environment to change from its default, such as control_mode=jerk."""
    only_successes: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Leave out episodes that are no successes."""
    overwrite: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Replace a dataset of this id."""
    allow_code: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Load a Stable-Baselines3 .zip, and the statistics beside it, although any code in them is run."""


def run(options: DatasetOptions) -> int:
    """Record; the exit code."""
    env_id = import_env(options.env)
    card = envs.task_card(env_id)  # raises for an unknown id
    given = assigned({}, options.settings), given_options(options.options, options.scenario)
    settings, reset_options = card.at_level(options.level, *given)
    policies = options.policies or (expert_names(env_id)[0],)
    with catch_interrupt(at_once=True) as interrupts, progress_bar("episodes") as bar:
        task = bar.add_task(f"recording {options.out}", total=len(policies) * options.episodes)
        recording = record_dataset(
            options.out,
            env_id,
            policies,
            options.episodes,
            seed=options.seed,
            env_config=settings,
            options=reset_options,
            only_successes=options.only_successes,
            overwrite=options.overwrite,
            allow_code=options.allow_code,
            command=shlex.join(["planarm", *sys.argv[1:]]),
            progress=lambda ended: bar.advance(task, ended),
        )
    show(recording)
    return 0 if recording.finished else (interrupts or [INTERRUPTED])[0]


def show(recording: Recording) -> None:
    """Print what was recorded, and how to load it."""
    if not recording.finished:
        note("interrupted: the dataset holds the episodes so far", "yellow")
    note(f"wrote {recording.folder}")
    rows = []
    for each in recording.policies:
        episodes = len(each.returns)
        success = percent_text(each.successes / episodes) if episodes else ""
        mean = number_text(sum(each.returns) / episodes) if episodes else ""
        rows.append((each.policy, str(episodes), success, mean, str(each.left_out)))
    title = f'minari.load_dataset("{recording.dataset_id}")'
    Table(title, ("policy", "episodes", "success (%)", "mean return", "left out"), rows).show()
