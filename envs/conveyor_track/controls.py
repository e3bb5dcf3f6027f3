"""What a spectator may change of ConveyorTrack while it runs: where the part is, and how fast the belt moves."""

from __future__ import annotations

from typing import Any

import numpy as np

from envs.card import Control
from envs.physics.episode import restart_clock
from planners.typing import Array

FARTHEST = 1.5
"""Largest distance of the part from the base, in reaches of the arm."""


def _move_part(task: Any, record: Any, point: Array, index: int = 0) -> bool:
    away = point - task.arm.base_array
    beyond = float(np.hypot(*away)) / (FARTHEST * task.arm.reach)
    record["part_position"] = task.arm.base_array + away / max(1.0, beyond)
    _begin_again(record)
    return True


def _set_speed(task: Any, record: Any, speed: float) -> bool:
    record["part_velocity"] = speed, 0.0
    _begin_again(record)
    return True


def _begin_again(record: Any) -> None:
    restart_clock(record)
    record["settled_steps"] = 0
    record["steady_state_error"] = record["lq_cost"] = 0.0


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
