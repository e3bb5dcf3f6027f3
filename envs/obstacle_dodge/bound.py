"""The bound of ObstacleDodge-v0: the least time to the goal of a motion that knows the obstacles' whole paths.

It is found by a search in space and time (:mod:`planners.motion.spacetime`) within the limits of the planners, half of
the arm's acceleration. ``python -m tools.dodge_bound`` stores the results of the first seeds in ``bound.json``.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

import envs  # noqa: F401  registers the environment
from planners.motion import spacetime
from planners.typing import Array

ENV_ID = "ObstacleDodge-v0"
FILE = Path(__file__).with_name("bound.json")

SETTINGS: dict[str, Any] = {"time_steps": [0.2, 0.1], "gap": 0.05, "margin": spacetime.MARGIN, "nodes": 2_000_000}
"""Arguments of `planners.motion.spacetime.search`."""

LETTERS: dict[spacetime.Verdict, str] = {"found": "f", "exhausted": "x", "gave up": "?"}
"""Verdicts in the file, one letter per seed."""


@dataclass
class Bounds:
    """Results of the seeds 0, 1, 2, ...

    Attributes:
        recipe: settings and versions of the search.
        verdicts: one letter per seed; see `LETTERS`.
        time_to_goal: as the environment counts it, s; None without a motion.
        lower_bound: time before which no motion of the finest lattice arrives, s; None where none exists at all.
    """

    recipe: dict[str, Any]
    verdicts: str = ""
    time_to_goal: list[float | None] = field(default_factory=list)
    lower_bound: list[float | None] = field(default_factory=list)


def solve(env: Any, env_index: int, acceleration: float = 0.5, **settings: Any) -> spacetime.Answer:
    """The earliest motion in an environment of a vector environment that is at the start of an episode.

    Args:
        env: the vector environment.
        env_index: of the environment in it.
        acceleration: share of the arm's limits that is used.
        settings: in place of `SETTINGS`.
    """
    record, config, problem = env.task.batch[env_index], env.task.config, env.motion_problem(env_index)
    settings = SETTINGS | settings
    hardest = acceleration * problem.arm.limits.array("acceleration")
    length, time = env.task.scale
    fitting = {
        "time_steps": [time * step for step in settings["time_steps"]],
        "gap": time * settings["gap"],
        "margin": length * settings["margin"],
    }
    return spacetime.search(
        problem.arm,
        record["q"],
        record["goal"],
        env.task.obstacle_path(env_index),
        env.task.scale.path_step,
        record["radii"],
        limits=replace(problem.arm.limits, acceleration=tuple(hardest.tolist())),
        tolerance=config.tolerance,
        hold=config.hold_time,
        horizon=config.horizon,
        **(settings | fitting),
    )


def stored_bound(seeds: Sequence[int]) -> Array:
    """Stored times to the goal, ``(len(seeds),)``, s.

    inf where no motion exists at the lattice's resolution; NaN where the search was inconclusive or nothing is stored.
    """
    bounds = load()
    ruled_out = LETTERS["exhausted"]
    times = [
        math.inf if letter == ruled_out else math.nan if time is None else time
        for letter, time in zip(bounds.verdicts, bounds.time_to_goal, strict=True)
    ]
    return np.array([times[seed] if 0 <= seed < len(times) else math.nan for seed in seeds])


def time_to_goal(env: Any, env_index: int, seed: int) -> float:
    """The bound of an episode at its start, s: stored, or searched for if settings or options change the episode.

    inf where no motion was found.
    """
    stored = float(stored_bound([seed])[0])
    if math.isnan(stored) or not _is_standard(env.task, env_index, seed):
        return as_counted(solve(env, env_index), env) or math.inf
    return stored


def _is_standard(task: Any, env_index: int, seed: int) -> bool:
    """Whether an episode is that of the seed with default settings and options."""
    standard: Any = _standard_env().unwrapped
    standard.reset(seed=seed)
    pairs = [(standard.task.batch[0][name], task.batch[env_index][name]) for name in ("q", "goal", "radii")]
    pairs.append((standard.task.obstacle_path(0), task.obstacle_path(env_index)))
    return all(np.array_equal(own, other) for own, other in pairs)


@lru_cache(maxsize=1)
def _standard_env() -> gym.Env[Any, Any]:
    return gym.make(ENV_ID)


@lru_cache(maxsize=1)
def load() -> Bounds:
    """The stored result."""
    return Bounds(**json.loads(FILE.read_text()))


def as_counted(answer: spacetime.Answer, env: Any) -> float | None:
    """The time to the goal as the environment counts it, at the ends of control periods, s."""
    if answer.trajectory is None:
        return None
    period: float = env.task.config.control_period
    return round(math.ceil(answer.time_to_goal / period - 1e-6) * period, 6)
