"""The potential-field experts: they do not plan, a field says at every instant where to accelerate."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from envs.experts.base import Expert
from envs.observation import Observation
from envs.obstacle_dodge.env import ObstacleDodge
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
        if self._adaptation is None and isinstance(state, np.ndarray) and state.shape == asked.shape:
            asked = np.where((starts | self._begins(seen))[:, None], asked, state)
        q, qd, goal, qdd = (
            seen["joint_position"],
            seen["joint_velocity"],
            self.task.hand_goal(seen),
            np.empty_like(asked),
        )
        for arm, batch in self._arms():
            target = goal[0][batch], goal[1][batch], goal[2][batch]
            qdd[batch] = approach(arm, q[batch], qd[batch], asked[batch], target, self.task.config.control_period)
        return self._action_for(seen, qdd), qdd


class JointFieldExpert(Expert):
    """A field in joint space that ends at rest in time; see `planners.apf.joint_field`."""

    def _act(self, observations: Observation, state: Any, starts: NDArray[np.bool_]) -> tuple[Array, tuple[()]]:
        seen = self.task.layout.parse(observations)
        q, qd, goal, left = (seen[name] for name in ("joint_position", "joint_velocity", "goal", "time_left"))
        qdd, period = np.empty_like(q), self.task.config.control_period
        for arm, batch in self._arms():
            qdd[batch] = reach(arm, q[batch], qd[batch], goal[batch], left[batch, 0], period)
        return self._action_for(seen, qdd), ()


class DodgingExpert(Expert):
    """A field around the whole arm, among moving discs; see `planners.apf.dodge`.

    Args:
        task: the environment's task.
        gains: of the field; those that were tuned when left out.
    """

    def __init__(self, task: ObstacleDodge, gains: DodgeGains | None = None) -> None:
        super().__init__(task)
        self._rules: dict[str, Any] = {"tolerance": task.config.tolerance, "hold_time": task.config.hold_time}
        self._gains = gains or tuned_gains()

    def _act(self, observations: Observation, state: Any, starts: NDArray[np.bool_]) -> tuple[Array, NDArray[Any]]:
        seen = self.task.layout.parse(observations)
        batch, discs = seen["obstacle_radius"].shape
        memory = new_memory(batch, discs) if state is None or len(state) != batch else state.copy()
        memory[starts | self._begins(seen)] = np.zeros(1, memory.dtype)
        q, qd, base = seen["joint_position"], seen["joint_velocity"], self.task.arm.base_array
        places = seen["obstacle"].reshape(batch, discs, 2) + base
        rates = seen["obstacle_velocity"].reshape(batch, discs, 2)
        qdd = np.empty_like(q)
        for arm, chosen in self._arms():
            part = memory[chosen]
            qdd[chosen] = dodge_accelerations(
                arm,
                self._gains,
                q[chosen],
                qd[chosen],
                seen["goal"][chosen] + base,
                places[chosen],
                rates[chosen],
                seen["obstacle_radius"][chosen],
                part,
                self.task.config.control_period,
                **self._rules,
            )
            memory[chosen] = part
        return self._action_for(seen, qdd), memory
