"""Best known times to the goal of ObstacleDodge-v0, of motions that know the obstacles' whole paths.

Those of stored starts are in `envs.best_known`. For others a search in space and time
(:mod:`planners.motion.spacetime`) finds one, within half of the arm's acceleration.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from envs.best_known import best_known
from planners.motion import spacetime

SETTINGS: dict[str, Any] = {"time_steps": [0.2, 0.1], "gap": 0.05, "margin": spacetime.MARGIN, "nodes": 2_000_000}
"""Arguments of `planners.motion.spacetime.search`."""


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


def time_to_goal(env: Any, env_index: int, seed: int) -> float:
    """The best known time to the goal of an episode at its start, s: stored, or searched for; inf where none is found.

    Args:
        env: a vector environment.
        env_index: of the environment in it.
        seed: not used; for `envs.card.Bound`.
    """
    stored = best_known(env, env_index)
    return as_counted(solve(env, env_index), env) or math.inf if math.isnan(stored) else stored


def as_counted(answer: spacetime.Answer, env: Any) -> float | None:
    """The time to the goal as the environment counts it, at the ends of control periods, s."""
    if answer.trajectory is None:
        return None
    period: float = env.task.config.control_period
    return round(math.ceil(answer.time_to_goal / period - 1e-6) * period, 6)
