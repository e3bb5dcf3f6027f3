"""What a spectator may change of ConveyorTrack while it runs: where the part is, and how fast the belt moves."""

from __future__ import annotations

from typing import Any

import numpy as np

from envs.card import Control
from planners.typing import Array


def _move_part(task: Any, env_index: int, point: Array, index: int = 0) -> bool:
    record, base = task.batch[env_index], task.arm.base_array
    away = np.asarray(point) - base
    far = float(np.hypot(*away)) / (1.5 * task.arm.reach)
    task.kernels.move_part(task.batch, env_index, *(base + away / max(1.0, far)).tolist())
    _begin_again(task, env_index, record)
    return True


def _set_speed(task: Any, env_index: int, speed: float) -> bool:
    record = task.batch[env_index]
    record["part_velocity"] = speed, 0.0
    _begin_again(task, env_index, record)
    return True


def _begin_again(task: Any, env_index: int, record: Any) -> None:
    task.restart_clock(env_index)
    record["settled_steps"] = 0
    record["steady_state_error"] = record["lq_cost"] = 0.0
    task.kernels.observe(task.batch, task.model, env_index)


CONTROLS = (
    Control("part", "part", lambda task, record: record["part_position"][None].copy(), _move_part),
    Control(
        "belt_speed",
        "belt speed (m/s)",
        lambda task, record: float(record["part_velocity"][0]),
        _set_speed,
        span=(-0.4, 0.4),
    ),
)
"""The controls of ConveyorTrack-v0."""
