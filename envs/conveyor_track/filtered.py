"""A network that acts by jerks on what is estimated where the settings declare uncertainty."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import NDArray

from envs.conveyor_track.env import ConveyorTrack
from envs.experts.base import Expert
from envs.experts.robust import RobustTracking
from envs.observation import Observation
from envs.task import Task
from planners import Arm
from planners.typing import Array


class FilteredPolicy(Expert):
    """A network in robust tracking: it observes estimates, and its jerks are those of the estimated arm.

    So a network that was trained for the nominal robot observes nearly what it would without uncertainty.

    Args:
        task: the environment's task; see `wanted`.
        network: gives actions ``(num_envs, 2)`` for observations ``(num_envs, size)``.
    """

    def __init__(self, task: ConveyorTrack, network: Callable[[Observation], NDArray[np.float32]]) -> None:
        super().__init__(task)
        self._network = network

    @staticmethod
    def wanted(task: object) -> TypeGuard[ConveyorTrack]:
        """Whether a task is the belt with declared uncertainty, acted on by jerks."""
        return isinstance(task, ConveyorTrack) and task.config.control_mode == "jerk" and RobustTracking.wanted(task)

    def _act(self, observations: Observation, state: Any, starts: NDArray[np.bool_]) -> tuple[Array, tuple[()]]:
        return self._network(whole_observations(self.task, observations)).astype(float), ()


def whole_observations(task: Task, observations: Observation) -> Observation:
    """Observations whose hand, and errors of the hand, follow from their joints and their part."""
    seen = task.layout.parse(observations)
    seen["hand"] = task.arm.forward_kinematics(seen["joint_position"].copy()) - task.arm.base_array
    seen["part_error"] = seen["part"] - seen["hand"]
    if "relative_velocity" in seen:
        velocity, acceleration = _hand_rates(task.arm, seen)
        seen["relative_velocity"] = seen["part_velocity"] - velocity
        seen["relative_acceleration"] = seen["part_acceleration"] - acceleration
    return task.layout.compose(seen)


def _hand_rates(arm: Arm, seen: dict[str, Array]) -> tuple[Array, Array]:
    """Velocity (m/s) and acceleration (m/s^2) of the hand, ``(num_envs, 2)`` each, for motions of the joints."""
    names = "position", "velocity", "acceleration"
    angle, rate, change = (np.cumsum(seen[f"joint_{name}"], axis=-1)[..., None] for name in names)
    along = arm.length_array[:, None] * np.concatenate([np.cos(angle), np.sin(angle)], axis=-1)
    across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    return (rate * across).sum(axis=-2), (change * across - rate**2 * along).sum(axis=-2)
