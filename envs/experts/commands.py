"""Accelerations, jerks or velocities that give an uncertain arm the accelerations that an expert wants."""

from __future__ import annotations

import numpy as np
from numba import njit

from envs.physics.actuation import action_scale
from envs.task import Task
from planners import JointLimits
from planners.control import Estimate
from planners.control.joint_limits import smooth_bounds
from planners.robot.dynamics import forward_dynamics, inverse_dynamics
from planners.robot.limits import LimitKind
from planners.typing import Array

_SMOOTH: tuple[LimitKind, ...] = ("velocity", "acceleration", "jerk")
_ROUNDS = 2  # of finding the accelerations over a period, which follow from the state half a period ahead


class NominalCommands:
    """From wanted accelerations to commands of the nominal arm, for estimated arms.

    In every control mode but ``"torque"`` the environment makes accelerations of an action and finds their torques for
    the nominal arm, in the state that it measures. Other masses, friction or late torques move the arm otherwise. So
    the wanted accelerations become the torques of the estimated arm, and those the accelerations of the nominal arm,
    which are the command.

    Args:
        task: the environment's task.
        within: limits of the accelerations that are wanted by jerks, and of the jerk that the environment is commanded.
    """

    def __init__(self, task: Task, within: JointLimits) -> None:
        own = task.arm.limits
        self._mode, self._period = task.config.control_mode, task.config.control_period
        self._chain = task.arm.chain_constants
        self._torque, self._fastest = own.array("torque"), action_scale(task.arm, "velocity")
        self._acceleration, self._jerk = own.array("acceleration"), own.array("jerk")
        self._within = np.array([within.array(kind) for kind in _SMOOTH])
        self._command_limits = np.array([own.array("velocity"), own.array("acceleration"), within.array("jerk")])

    def follow(
        self, estimate: Estimate, state: tuple[Array, Array], memory: Array, shares: Array
    ) -> tuple[Array, Array]:
        """Actions and their torques, N m, ``(num_envs, n)`` each, for actions of an expert, ``shares`` of the limits.

        Args:
            estimate: of arms and of the state in which the action reaches the joints.
            state: estimated angles and velocities now, ``(num_envs, n)`` each.
            memory: for jerks, accelerations so far, ``(num_envs, 2, n)``, rad/s^2, renewed in place: those that were
                wanted, as far as the limits of the command allow, and those that the environment was commanded.
            shares: ``(num_envs, n)``.
        """
        if self._mode == "jerk":
            wanted, commanded = memory[:, 0].copy(), memory[:, 1].copy()
            _change(estimate.qd, shares * self._jerk * self._period, self._period, self._within, wanted)
        elif self._mode == "velocity":
            wanted = (shares * self._fastest - estimate.qd) / self._period
        else:
            wanted = shares * self._acceleration
        nominal = self._nominal(*state, estimate.held_torque(wanted, self._period), wanted)
        if self._mode == "jerk":
            _change(state[1], nominal - commanded, self._period, self._command_limits, commanded)
            actions = (commanded - memory[:, 1]) / (self._jerk * self._period)
            memory[:, 0], memory[:, 1] = wanted + (commanded - nominal), commanded
        else:
            commanded = np.clip(nominal, -self._acceleration, self._acceleration)
            actions = commanded / self._acceleration
            if self._mode == "velocity":
                actions = (state[1] + self._period * commanded) / self._fastest
        tau = inverse_dynamics(*self._chain, *self._half(*state, commanded), commanded)
        return actions, np.clip(tau, -self._torque, self._torque)

    def _nominal(self, q: Array, qd: Array, tau: Array, qdd: Array) -> Array:
        """Mean accelerations of the nominal arm under torques that are held for a period; ``qdd`` are near them."""
        for _ in range(_ROUNDS):
            qdd = forward_dynamics(*self._chain, *self._half(q, qd, qdd), tau)
        return qdd

    def _half(self, q: Array, qd: Array, qdd: Array) -> tuple[Array, Array]:
        """Angles and velocities half a period ahead."""
        half = 0.5 * self._period
        return q + half * (qd + 0.5 * half * qdd), qd + half * qdd


@njit(cache=True, nogil=True)
def _change(speeds: Array, changes: Array, period: float, limits: Array, accelerations: Array) -> None:
    """Change accelerations ``(rows, n)`` within what keeps limits of velocity, acceleration and jerk, ``(3, n)``."""
    for row in range(accelerations.shape[0]):
        for i in range(accelerations.shape[1]):
            now = accelerations[row, i]
            lower, upper = smooth_bounds(speeds[row, i], now, period, limits[0, i], limits[1, i], limits[2, i])
            accelerations[row, i] = min(upper, max(lower, now + changes[row, i]))
