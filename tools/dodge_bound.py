"""The bound of ObstacleDodge-v0: for each seed whether a collision-free motion exists, and its least time to the goal.

``python -m tools.dodge_bound`` searches for the earliest collision-free motion with the discs' whole paths known
(:mod:`planners.motion.spacetime`), within the limits that planners are given (half of the arm's acceleration), and
writes ``envs/obstacle_dodge/bound.json`` with the recipe. Ctrl-C keeps what is done, and the next run continues there.
"""

from __future__ import annotations

import hashlib
import json
import math
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import tyro

import envs  # noqa: F401  registers the environment
from agents.console import note, progress_bar
from agents.provenance import versions
from envs.obstacle_dodge.bound import ENV_ID, FILE, LETTERS, SETTINGS, Bounds, as_counted, solve
from planners.files import write_json

BATCH = 20  # seeds after which the result is stored


@dataclass(frozen=True)
class DodgeBoundOptions:
    """Search for the earliest motion of each of ObstacleDodge-v0's seeds, and store what is found."""

    seeds: int = 1000
    """How many, from 0."""
    out: Path = FILE
    """Where to store the result; a result there that was made in the same way is continued."""


def main(options: DodgeBoundOptions) -> None:
    """Search, with a progress bar, and store."""
    bounds = _begin(options.out)
    with progress_bar("seeds", transient=False) as progress:
        task = progress.add_task(ENV_ID, total=options.seeds, completed=len(bounds.verdicts))
        try:
            while len(bounds.verdicts) < options.seeds:
                first = len(bounds.verdicts)
                with closing(gym.make_vec(ENV_ID, num_envs=min(BATCH, options.seeds - first))) as env:
                    env.reset(seed=first)
                    for env_index in range(env.num_envs):
                        answer = solve(env.unwrapped, env_index)
                        lower = None if math.isinf(answer.lower_bound) else round(answer.lower_bound, 3)
                        bounds.verdicts += LETTERS[answer.verdict]
                        bounds.time_to_goal.append(as_counted(answer, env.unwrapped))
                        bounds.lower_bound.append(lower)
                        progress.advance(task)
                write_json(options.out, vars(bounds))
        except KeyboardInterrupt:
            note(f"stopped; run again to continue from seed {len(bounds.verdicts)}")
        finally:
            write_json(options.out, vars(bounds))
    note(summary(bounds))


def summary(bounds: Bounds) -> str:
    """A line for the console."""
    times = [value for value in bounds.time_to_goal if value is not None]
    counts = ", ".join(f"{name} {bounds.verdicts.count(letter)}" for name, letter in LETTERS.items())
    mean = f"; mean time to the goal {np.mean(times):.3f} s" if times else ""
    return f"{len(bounds.verdicts)} seeds: {counts}{mean}"


def fingerprint() -> str:
    """A hash of how the first episodes begin and of where their discs go: it changes with the distribution."""
    digest = hashlib.sha256()
    with closing(gym.make_vec(ENV_ID, num_envs=BATCH)) as env:
        env.reset(seed=0)
        task: Any = env.unwrapped.task  # type: ignore[attr-defined]
        paths = np.array([task.obstacle_path(env_index) for env_index in range(BATCH)])
        for values in (task.batch["q"], task.batch["goal"], paths):
            # rounded: the last digits of sine and cosine depend on the machine
            digest.update((np.round(values, 6) + 0.0).tobytes())
    return digest.hexdigest()[:16]


def _begin(path: Path) -> Bounds:
    """What is stored, if it was made in the same way; nothing otherwise."""
    recipe = {
        "command": "python -m tools.dodge_bound",
        "method": "planners.motion.spacetime.search: hybrid A* over joint angles, velocities and time, all paths known",
        "limits": "motion_problem().limits",
        "env": ENV_ID,
        "episodes": fingerprint(),
        **SETTINGS,
        "versions": versions(),
    }
    if path.exists():
        bounds = Bounds(**json.loads(path.read_text()))
        if bounds.recipe == recipe:
            return bounds
    return Bounds(recipe)


if __name__ == "__main__":
    main(tyro.cli(DodgeBoundOptions))
