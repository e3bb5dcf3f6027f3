"""An expert that neither plans nor looks ahead: a controller alone, as a baseline."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from envs.experts.base import Expert, HandGoal
from envs.observation import Observation
from envs.task import Task
from planners.typing import Array

_DAMPING = 1e-6


class FollowerExpert(Expert):
    """Computed torque on a goal of the hand, without planning.

    The hand is driven to the goal as a critically damped second-order system; accelerations and torques are scaled
    down to their limits, jerk limits are ignored.

    Args:
        task: the environment's task.
        goal: reads the goal from parsed observations.
        bandwidth: natural frequency of the hand's error, rad/s.
    """

    def __init__(self, task: Task, goal: HandGoal, bandwidth: float = 4.0) -> None:
        super().__init__(task)
        self._goal, self._bandwidth = goal, bandwidth

    def _act(self, observations: Observation, state: Any, starts: NDArray[np.bool_]) -> tuple[Array, tuple[()]]:
        seen = self.task.layout.parse(observations)
        arm, w = self.task.arm, self._bandwidth
        q, qd = np.ascontiguousarray(seen["joint_position"]), np.ascontiguousarray(seen["joint_velocity"])
        jacobian = arm.jacobian(q)
        position, velocity, acceleration = self._goal(seen)
        error = position - arm.forward_kinematics(q)
        hand_velocity = np.einsum("lij,lj->li", jacobian, qd)
        wanted = acceleration + 2.0 * w * (velocity - hand_velocity) + w**2 * error
        wanted = wanted - self._centripetal(q, qd)
        # Damped least squares, for postures near a singularity.
        square = np.einsum("lij,lkj->lik", jacobian, jacobian) + _DAMPING * np.eye(2)
        qdd = np.einsum("lji,lj->li", jacobian, np.linalg.solve(square, wanted[..., None])[..., 0])
        excess = np.max(np.abs(qdd) / np.array(arm.limits.acceleration), axis=1, keepdims=True)
        return self._action_for(seen, self._within_torque(seen, qdd / np.maximum(1.0, excess))), ()

    def _centripetal(self, q: Array, qd: Array) -> Array:
        """Acceleration of the hand at constant joint velocities, ``(num_envs, 2)``, m/s^2."""
        phi, w = np.cumsum(q, axis=1), np.cumsum(qd, axis=1)
        pull = self.task.arm.length_array * w**2
        return -np.stack([(pull * np.cos(phi)).sum(axis=1), (pull * np.sin(phi)).sum(axis=1)], axis=1)
