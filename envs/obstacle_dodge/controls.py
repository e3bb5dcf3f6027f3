"""What a spectator may change of ObstacleDodge while it runs: the goal, and where the discs are and how large."""

from __future__ import annotations

from typing import Any

import numpy as np

from envs.card import Control
from envs.physics.episode import restart_clock
from planners.typing import Array

RIM = 0.02
"""Least distance of a goal from the rim of the workspace, m."""


def _move_goal(task: Any, record: Any, point: Array, index: int = 0) -> bool:
    away = point - task.arm.base_array
    distance = max(1e-9, float(np.hypot(*away)))
    reached = min(task.arm.reach - RIM, max(abs(np.diff(task.arm.lengths).item()) + RIM, distance))
    record["goal"] = task.arm.base_array + away * (reached / distance)
    record["held_steps"] = 0
    _continue_paths(task, record)
    return True


def _move_disc(task: Any, record: Any, point: Array, index: int = 0) -> bool:
    paths = _continue_paths(task, record)
    paths[:, index] += point - record["discs"][index]
    task.write_table(record, paths)
    record["discs"][index] = point
    return True


def _set_radius(task: Any, record: Any, radius: float) -> bool:
    record["radii"][: task.config.num_obstacles] = radius
    return True


def _continue_paths(task: Any, record: Any) -> Array:
    """The whole time again: the discs go on as they would have, and then back the same way; their paths."""
    paths = task.table(int(record["env_index"]))
    seconds = int(record["step"]) * task.config.control_period
    now = min(len(paths) - 1, round(seconds / task.scale.path_step))
    ahead: Array = np.concatenate([paths[now:], paths[::-1]])[: len(paths)]
    task.write_table(record, ahead)
    restart_clock(record)
    return ahead


CONTROLS = (
    Control("goal", "goal", lambda task, record: record["goal"][None].copy(), _move_goal),
    Control("disc", "disc", lambda task, record: record["discs"][: task.config.num_obstacles].copy(), _move_disc),
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
