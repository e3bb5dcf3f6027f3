"""The potential-field experts: they do not plan, a field says at every instant where to accelerate."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from envs.experts.base import Expert
from envs.observation import Observation
from envs.obstacle_dodge import ObstacleDodge
from planners.apf.dodge import DodgeGains, dodge_accelerations, new_memory, tuned_gains
from planners.apf.joint_field import reach
from planners.apf.moving_target import approach
from planners.typing import Array


class MovingTargetExpert(Expert):
    """A field that a moving target of the hand carries along; see `planners.apf.moving_target`."""

    def _act(self, observations: Observation, state: Any, starts: NDArray[np.bool_]) -> tuple[Array, Array]:
        seen = self.task.layout.parse(observations)
        # What was asked for is what the jerk is counted from: with a payload nobody knows of it is not what came of it.
        asked = seen["joint_acceleration"]
        if isinstance(state, np.ndarray) and state.shape == asked.shape:
            asked = np.where((starts | self._begins(seen))[:, None], asked, state)
        qdd = approach(
            self.task.arm,
            seen["joint_position"],
            seen["joint_velocity"],
            asked,
            self.task.hand_goal(seen),
            self.task.config.control_period,
        )
        return self._action_for(seen, qdd), qdd


class JointFieldExpert(Expert):
    """A field in joint space that ends at rest in time; see `planners.apf.joint_field`."""

    def _act(self, observations: Observation, state: Any, starts: NDArray[np.bool_]) -> tuple[Array, tuple[()]]:
        seen = self.task.layout.parse(observations)
        qdd = reach(
            self.task.arm,
            seen["joint_position"],
            seen["joint_velocity"],
            seen["goal"],
            seen["time_left"][:, 0],
            self.task.config.control_period,
        )
        return self._action_for(seen, qdd), ()


class DodgingExpert(Expert):
    """A field around the whole arm, among moving discs; see `planners.apf.dodge`.

    Args:
        task: the environment's task.
        gains: of the field; those that were tuned when left out.
    """

    def __init__(self, task: ObstacleDodge, gains: DodgeGains | None = None) -> None:
        super().__init__(task)
        self._rules = {"tolerance": task.config.tolerance, "hold_time": task.config.hold_time}
        self._gains = gains or tuned_gains()

    def _act(self, observations: Observation, state: Any, starts: NDArray[np.bool_]) -> tuple[Array, NDArray[Any]]:
        seen = self.task.layout.parse(observations)
        lanes, discs = seen["obstacle_radius"].shape
        memory = new_memory(lanes, discs) if state is None or len(state) != lanes else state.copy()
        memory[starts | self._begins(seen)] = np.zeros(1, memory.dtype)
        base = self.task.arm.base_array
        qdd = dodge_accelerations(
            self.task.arm,
            self._gains,
            seen["joint_position"],
            seen["joint_velocity"],
            seen["goal"] + base,
            seen["obstacle"].reshape(lanes, discs, 2) + base,
            seen["obstacle_velocity"].reshape(lanes, discs, 2),
            seen["obstacle_radius"],
            memory,
            self.task.config.control_period,
            **self._rules,
        )
        return self._action_for(seen, qdd), memory
