"""What a spectator may change of ObstacleDodge while it runs: the goal, and where the discs are and how large."""

from __future__ import annotations

from typing import Any

import numpy as np

from envs.card import Control
from planners.typing import Array


def _move_goal(task: Any, env_index: int, point: Array, index: int = 0) -> bool:
    record, base = task.batch[env_index], task.arm.base_array
    away = np.asarray(point) - base
    near, far = abs(np.diff(task.arm.lengths).item()) + 0.02, task.arm.reach - 0.02
    distance = max(1e-9, float(np.hypot(*away)))
    record["goal"] = base + away * (min(far, max(near, distance)) / distance)
    record["held_steps"] = 0
    _continue_paths(task, env_index, record)
    task.kernels.observe(task.batch, task.model, env_index)
    return True


def _move_disc(task: Any, env_index: int, point: Array, index: int = 0) -> bool:
    record = task.batch[env_index]
    _continue_paths(task, env_index, record)
    record["path"][:, index] += np.asarray(point) - record["discs"][index]
    record["discs"][index] = point
    task.kernels.observe(task.batch, task.model, env_index)
    return True


def _set_radius(task: Any, env_index: int, radius: float) -> bool:
    task.batch[env_index]["radii"] = radius
    return True


def _continue_paths(task: Any, env_index: int, record: Any) -> None:
    """The whole time again: the discs go on as they would have, and then back the same way."""
    path, step = record["path"], task.scale.path_step
    now = min(len(path) - 1, round(int(record["step"]) * task.config.control_period / step))
    there_and_back = np.concatenate([path[now:], path[::-1]])
    record["path"] = there_and_back[: len(path)]
    task.restart_clock(env_index)


CONTROLS = (
    Control("goal", "goal", lambda task, record: record["goal"][None].copy(), _move_goal),
    Control("disc", "disc", lambda task, record: record["discs"].copy(), _move_disc),
    Control(
        "radius",
        "disc radius (m)",
        lambda task, record: float(record["radii"][0]),
        _set_radius,
        span=(0.03, 0.25),
        replans=False,
    ),
)
"""The controls of ObstacleDodge-v0."""
