"""Experts that do not plan: a potential field gives the acceleration at every instant."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from envs.experts.base import Expert, HandGoal
from envs.observation import Observation
from envs.task import Task
from planners.apf.joint_field import reach
from planners.apf.moving_target import approach
from planners.typing import Array


class MovingTargetExpert(Expert):
    """A field that moves with the target of the hand; see `planners.apf.moving_target`.

    Args:
        task: the environment's task.
        goal: reads the target from parsed observations.
    """

    def __init__(self, task: Task, goal: HandGoal) -> None:
        super().__init__(task)
        self._goal = goal

    def _act(self, observations: Observation, state: Any, starts: NDArray[np.bool_]) -> tuple[Array, Array]:
        seen = self.task.layout.parse(observations)
        # Jerk is counted from the commanded acceleration; with an unknown payload the observed one differs.
        commanded = seen["joint_acceleration"]
        if self._adaptation is None and isinstance(state, np.ndarray) and state.shape == commanded.shape:
            commanded = np.where((starts | self._begins(seen))[:, None], commanded, state)
        q, qd, goal = seen["joint_position"], seen["joint_velocity"], self._goal(seen)
        qdd, period = np.empty_like(q), self.task.config.control_period
        for arm, rows in self._arms():
            target = goal[0][rows], goal[1][rows], goal[2][rows]
            qdd[rows] = approach(arm, q[rows], qd[rows], commanded[rows], target, period)
        return self._action_for(seen, qdd), qdd


class JointFieldExpert(Expert):
    """A field in joint space that ends at rest in time; see `planners.apf.joint_field`."""

    def _act(self, observations: Observation, state: Any, starts: NDArray[np.bool_]) -> tuple[Array, tuple[()]]:
        seen = self.task.layout.parse(observations)
        q, qd, goal, left = (seen[name] for name in ("joint_position", "joint_velocity", "goal", "time_left"))
        qdd, period = np.empty_like(q), self.task.config.control_period
        for arm, rows in self._arms():
            qdd[rows] = reach(arm, q[rows], qd[rows], goal[rows], left[rows, 0], period)
        return self._action_for(seen, qdd), ()
