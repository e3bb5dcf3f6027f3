"""Best known values of tasks: ``python -m tools.best_known [TASK ...]`` (needs the ``tools`` extra).

For the paper's start and the seeds of the published leaderboard it searches for the best motion, plays it in the
environment, and writes it to ``envs/best_known/`` with a lower bound, where the task has one. What is stored there
stays where it is the better value, seeds that are stored already are left out, and Ctrl-C keeps what is done.
"""

from __future__ import annotations

import math
from contextlib import closing
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import gymnasium as gym
import tyro

from agents.console import note, progress_bar
from agents.provenance import versions
from envs.best_known import PAPER, file_of, read, start_of, write
from tools.best_known import conveyor, dodge, torque_move
from tools.best_known.playback import begin, play_actions

TASKS: dict[str, ModuleType] = {module.ENV_ID: module for module in (conveyor, torque_move, dodge)}
"""The modules that search, by task."""


@dataclass(frozen=True)
class BestKnownOptions:
    """Search for the best motions of a task's published episodes, and store what the environment scores."""

    tasks: tyro.conf.Positional[tuple[str, ...]] = tuple(TASKS)
    """Ids of the environments."""
    seeds: int = 128
    """How many, from 0, beside the paper's start."""
    again: bool = False
    """Search for stored seeds too, from their stored motions."""


def main(options: BestKnownOptions) -> None:
    """Search, with a progress bar, and store after every seed."""
    for name in options.tasks:
        module, path = TASKS[name], file_of(name)
        known = read(path)
        known.recipe = {"command": "python -m tools.best_known", "method": module.METHOD, "versions": versions()}
        keys = [PAPER, *range(options.seeds)]
        if not options.again:
            keys = [key for key in keys if key not in known.keys]
        with closing(gym.make(name)) as env, progress_bar("starts", transient=False) as progress:
            task = progress.add_task(name, total=len(keys))
            try:
                for key in keys:
                    stored = known.actions[known.keys.index(key)] if key in known.keys else None
                    known.put(key, *solved(env, module, key, stored))
                    write(path, known)
                    progress.advance(task)
            except KeyboardInterrupt:
                note(f"stopped; run again to continue with the other starts of {name}")
        note(f"{name}: {len(known.keys)} starts stored")


def solved(env: gym.Env[Any, Any], module: ModuleType, key: int, stored: Any) -> tuple[Any, float, float, Any]:
    """Start, best known value, lower bound and actions of an episode."""
    begin(env, key)
    task: Any = env.unwrapped
    start = start_of(task.task)
    best = module.search(env, key, None if stored is None else play_actions(env, key, stored))
    replayed = play_actions(env, key, best.actions)  # by its actions alone, as a user would
    value = replayed.score(module.METRIC, task.task.config.limit_tolerance)
    if value != best.score(module.METRIC, task.task.config.limit_tolerance):
        raise RuntimeError(f"{module.ENV_ID}, seed {key}: the environment does not repeat its own score")
    lower = module.lower(env, key) if hasattr(module, "lower") else math.nan
    return start, value, lower, best.actions


if __name__ == "__main__":
    main(tyro.cli(BestKnownOptions))
