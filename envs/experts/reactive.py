"""Experts without a plan: random actions, a controller alone, and potential fields."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from envs.experts.base import Expert, HandGoal
from envs.experts.robust import slower
from envs.hashing import to_unit
from envs.observation import Observation
from envs.task import Task
from planners.apf.joint_field import reach
from planners.apf.moving_target import approach
from planners.typing import Array

_DAMPING = 1e-6

_JERK_SHARE = 0.83
"""Share of the jerk limits that the moving field uses where a payload is declared: its first torque, which is that of
an empty hand, moves a joint of a loaded arm up to a fifth harder than it expects."""


class RandomExpert(Expert):
    """Uniformly random actions.

    Actions are a hash of the observation, so that an episode does not depend on the batch it runs in.

    Args:
        task: the environment's task.
        seed: of the constants of the hash.
    """

    tracks = False

    def __init__(self, task: Task, seed: int = 0) -> None:
        super().__init__(task)
        generator = np.random.default_rng(seed)
        shape = (task.layout.size, task.arm.n_joints)
        self._multipliers = generator.integers(0, 2**64, shape, dtype=np.uint64, endpoint=False) | np.uint64(1)

    def _act(self, observations: Observation, state: Any, starts: NDArray[np.bool_]) -> tuple[Array, tuple[()]]:
        words = np.ascontiguousarray(observations, dtype=np.float32).view(np.uint32).astype(np.uint64)
        bits = (words[:, :, None] * self._multipliers).sum(axis=1, dtype=np.uint64)
        return 2.0 * to_unit(bits) - 1.0, ()


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
        # Jerk is counted from the commanded acceleration: with an unknown payload the observed one differs. Robust
        # tracking by jerks shows what has been commanded.
        commanded = seen["joint_acceleration"]
        shown = self._robust is not None and self.task.config.control_mode == "jerk"
        if not shown and self._adaptation is None and isinstance(state, np.ndarray) and state.shape == commanded.shape:
            commanded = np.where((starts | self._begins(seen))[:, None], commanded, state)
        q, qd, goal = seen["joint_position"], seen["joint_velocity"], self._goal(seen)
        qdd, period = np.empty_like(q), self.task.config.control_period
        for arm, rows in self._arms():
            target = goal[0][rows], goal[1][rows], goal[2][rows]
            limits = slower(arm.limits) if self.task.config.control_mode == "velocity" else arm.limits
            if self._robust is not None and self._robust.unknown_arm:
                limits = self._robust.careful(limits)
            elif self._adaptation is not None and self._adaptation.declared:
                limits = replace(limits, jerk=tuple((_JERK_SHARE * limits.array("jerk")).tolist()))
            qdd[rows] = approach(arm, q[rows], qd[rows], commanded[rows], target, period, limits=limits)
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
