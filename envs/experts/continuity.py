"""Whether an observation continues the episode of the one before it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from envs.task import Task
from planners.typing import Array

JUMP = 0.02
"""Rotation of a joint beyond that of its velocities, rad, that is no motion of a period: another episode has begun."""

NOISE = 10.0
"""Rotation beyond that which noise may show, in standard deviations."""


class Moment(NamedTuple):
    """When and where a batch of arms is.

    Attributes:
        left: control periods that are left, ``(num_envs,)``; -1 before the first observation.
        q, qd: angles and velocities of the joints, ``(num_envs, n)``, rad and rad/s; of no joints where a task does not
            observe them.
        goal: of the joints (rad) or of the hand (m), ``(num_envs, size)``; of size 0 where a task has none that stays.
    """

    left: NDArray[np.int64]
    q: Array
    qd: Array
    goal: Array

    @classmethod
    def of(cls, task: Task, seen: dict[str, Array]) -> Moment:
        """The moment of parsed observations ``(num_envs, ...)``."""
        left = np.rint(seen["time_left"][:, 0] / task.config.control_period).astype(np.int64)
        nothing = np.zeros((len(left), 0))
        return cls(left, *(seen.get(name, nothing) for name in ("joint_position", "joint_velocity", "goal")))

    def continues(self, before: Moment, task: Task) -> NDArray[np.bool_]:
        """Which arms are a control period further in the same episode than ``before``, ``(num_envs,)``.

        Episodes of different lengths may have the same time left: then the joints have jumped, or the goal is another.
        """
        moved = np.abs(self.q - before.q) - task.config.control_period * (np.abs(self.qd) + np.abs(before.qd))
        slack = JUMP + NOISE * max(task.uncertainty.ends["encoder_noise"])
        same: NDArray[np.bool_] = (before.left - self.left == 1) & (moved.max(axis=1, initial=0.0) <= slack)
        if self.goal.shape == before.goal.shape:
            noise = NOISE * max(task.uncertainty.ends["camera_noise"])
            same &= np.abs(self.goal - before.goal).max(axis=1, initial=0.0) <= noise
        return same
