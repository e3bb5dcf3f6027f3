"""What is possible in ObstacleDodge-v0: for each seed whether a motion exists at all, and how soon it is at the goal.

``python -m agents.dodge_bound`` searches with the discs' whole paths before its eyes (:mod:`planners.spacetime`),
within the limits that planners are given (half of the arm's acceleration), and writes ``data/dodge_bound.json`` with
the recipe. Ctrl-C keeps what is done, and the next run goes on from there.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import tyro
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

import envs  # noqa: F401  registers the environment
from agents.files import write_json
from agents.provenance import versions
from envs.obstacle_path import PATH_STEP
from planners import spacetime
from planners.typing import Array

ENV_ID = "ObstacleDodge-v0"
FILE = Path(__file__).parent / "data" / "dodge_bound.json"

BATCH = 20
"""Seeds after which the result is stored."""

SETTINGS: dict[str, Any] = {"time_steps": [0.2, 0.1], "gap": 0.05, "margin": spacetime.MARGIN, "nodes": 2_000_000}
"""Of `planners.spacetime.search`."""

LETTERS: dict[spacetime.Verdict, str] = {"found": "f", "exhausted": "x", "gave up": "?"}
"""How the file writes verdicts, one letter a seed."""


@dataclass(frozen=True)
class DodgeBoundOptions:
    """Search for the earliest motion of each of ObstacleDodge-v0's seeds, and store what is found."""

    seeds: int = 1000
    """How many, from 0."""
    out: Path = FILE
    """Where to store the result; what is there is gone on from, if it was made in the same way."""


@dataclass
class Bounds:
    """What is known of the seeds 0, 1, 2, ...

    Attributes:
        recipe: how it was found.
        verdicts: a letter a seed; see `LETTERS`.
        time_to_goal: as the environment counts it, s; None without a motion.
        lower_bound: times before which no motion of the finest lattice is there, s; None where none exists at all.
    """

    recipe: dict[str, Any]
    verdicts: str = ""
    time_to_goal: list[float | None] = field(default_factory=list)
    lower_bound: list[float | None] = field(default_factory=list)


def main(options: DodgeBoundOptions) -> None:
    """Search, with a progress bar, and store."""
    console = Console(stderr=True)
    bounds = _begin(options.out)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, TimeRemainingColumn(), console=console) as progress:
        task = progress.add_task(ENV_ID, total=options.seeds, completed=len(bounds.verdicts))
        try:
            while len(bounds.verdicts) < options.seeds:
                first = len(bounds.verdicts)
                with closing(gym.make_vec(ENV_ID, num_envs=min(BATCH, options.seeds - first))) as env:
                    env.reset(seed=first)
                    for lane in range(env.num_envs):
                        _append(bounds, solve(env.unwrapped, lane), env.unwrapped)
                        progress.advance(task)
                write_json(options.out, vars(bounds))
        except KeyboardInterrupt:
            console.print(f"stopped; run again to go on from seed {len(bounds.verdicts)}")
        finally:
            write_json(options.out, vars(bounds))
    console.print(summary(bounds))


def solve(env: Any, lane: int) -> spacetime.Answer:
    """The earliest motion for the episode that a lane of a vector environment is at the start of."""
    record, config, problem = env.task.lanes[lane], env.task.config, env.motion_problem(lane)
    return spacetime.search(
        problem.arm,
        record["q"],
        record["goal"],
        env.task.obstacle_path(lane),
        PATH_STEP,
        record["radii"],
        limits=problem.limits,
        tolerance=config.tolerance,
        hold=config.hold_time,
        horizon=config.horizon,
        **SETTINGS,
    )


def summary(bounds: Bounds) -> str:
    """A line for the console."""
    times = [value for value in bounds.time_to_goal if value is not None]
    counts = ", ".join(f"{name} {bounds.verdicts.count(letter)}" for name, letter in LETTERS.items())
    mean = f"; mean time to the goal {np.mean(times):.3f} s" if times else ""
    return f"{len(bounds.verdicts)} seeds: {counts}{mean}"


def stored_bound(seeds: Sequence[int]) -> Array:
    """Stored times to the goal, ``(len(seeds),)``, s.

    inf where no motion exists at the lattice's resolution; NaN where none is known but none is ruled out, and where
    nothing is stored.
    """
    bounds = load()
    ruled_out = LETTERS["exhausted"]
    times = [
        math.inf if letter == ruled_out else math.nan if time is None else time
        for letter, time in zip(bounds.verdicts, bounds.time_to_goal, strict=True)
    ]
    return np.array([times[seed] if 0 <= seed < len(times) else math.nan for seed in seeds])


def time_to_goal(env: Any, lane: int, seed: int) -> float:
    """The bound of the episode that a lane is at the start of, s: stored if it is the seed's own, else searched for.

    inf where no motion was found.
    """
    stored = float(stored_bound([seed])[0])
    if math.isnan(stored) or not _is_standard(env.task.lanes[lane], seed):
        return _as_seen(solve(env, lane), env) or math.inf
    return stored


def _is_standard(record: Any, seed: int) -> bool:
    """Whether an episode is what the seed alone gives, without other settings or options."""
    standard: Any = _standard_env().unwrapped
    standard.reset(seed=seed)
    own = standard.task.lanes[0]
    names = ("q", "goal", "radii", "path")
    return all(own[name].shape == record[name].shape and (own[name] == record[name]).all() for name in names)


@lru_cache(maxsize=1)
def _standard_env() -> gym.Env[Any, Any]:
    return gym.make(ENV_ID)


@lru_cache(maxsize=1)
def load() -> Bounds:
    """The stored result."""
    return Bounds(**json.loads(FILE.read_text()))


def fingerprint() -> str:
    """A hash of how the first episodes begin and of where their discs go: it changes with the distribution."""
    digest = hashlib.sha256()
    with closing(gym.make_vec(ENV_ID, num_envs=BATCH)) as env:
        env.reset(seed=0)
        task: Any = env.unwrapped.task  # type: ignore[attr-defined]
        for name in ("q", "goal", "path"):
            # rounded: the last digits of sine and cosine depend on the machine
            digest.update((np.round(task.lanes[name], 6) + 0.0).tobytes())
    return digest.hexdigest()[:16]


def _begin(path: Path) -> Bounds:
    """What is stored, if it was made in the same way; nothing otherwise."""
    recipe = {
        "command": "python -m agents.dodge_bound",
        "method": "planners.spacetime.search: hybrid A* over joint angles, velocities and time, all paths known",
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


def _append(bounds: Bounds, answer: spacetime.Answer, env: Any) -> None:
    """Keep an answer."""
    bounds.verdicts += LETTERS[answer.verdict]
    bounds.time_to_goal.append(_as_seen(answer, env))
    bounds.lower_bound.append(None if math.isinf(answer.lower_bound) else round(answer.lower_bound, 3))


def _as_seen(answer: spacetime.Answer, env: Any) -> float | None:
    """The time to the goal by the environment's clock, which looks at the end of every control period only, s."""
    if answer.trajectory is None:
        return None
    period: float = env.task.config.control_period
    return round(math.ceil(answer.time_to_goal / period - 1e-6) * period, 6)


if __name__ == "__main__":
    main(tyro.cli(DodgeBoundOptions))
