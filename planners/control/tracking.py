"""Tracking of a sampled reference: the acceleration for the next control period and the torque to hold for it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from planners.checks import float_rows, require_finite
from planners.compiled.calls import private
from planners.robot.arm import Arm
from planners.robot.dynamics import forward_dynamics_single, inverse_dynamics_single, mass_matrix_single
from planners.typing import Array


@dataclass(frozen=True)
class Gains:
    """Feedback gains of every joint: acceleration per angle error, 1/s^2, and per velocity error, 1/s."""

    position: float = 64.0
    velocity: float = 16.0

    def __post_init__(self) -> None:
        require_finite("position gain", self.position, "1/s^2", "not negative")
        require_finite("velocity gain", self.velocity, "1/s", "not negative")

    @classmethod
    def sampled(cls, period: float) -> Gains:
        """Critically damped gains with a bandwidth of 0.16 / period (s): 8 rad/s at 20 ms."""
        require_finite("period", period, "s", "positive")
        bandwidth = 0.16 / period
        return cls(position=bandwidth**2, velocity=2.0 * bandwidth)


def tracking_acceleration(
    q: Array,
    qd: Array,
    now: tuple[Array, Array],
    ahead: tuple[Array, Array],
    period: float,
    gains: Gains | None = None,
) -> Array:
    """Mean joint acceleration over the next control period that follows a sampled reference.

    The feed-forward is the reference's mean acceleration over the period, (qd(t + T) - qd(t)) / T: torques held for the
    period then reach the reference's velocity at the next sample.

    Measured angles and velocities ``q, qd``, and those of the reference at this and the next sample, ``now`` and
    ``ahead``, are ``(batch, n)``, as is the result, rad/s^2; ``period`` is T, s. A shape that does not fit is a
    ValueError.
    """
    require_finite("period", period, "s", "positive")
    gains = gains or Gains()
    reference = {"angles now": now[0], "velocities now": now[1], "angles ahead": ahead[0], "velocities ahead": ahead[1]}
    q, qd, q_now, qd_now, _, qd_ahead = float_rows(np.shape(q)[-1], None, q=q, qd=qd, **reference)
    feed_forward = (qd_ahead - qd_now) / period
    return feed_forward + gains.velocity * (qd_now - qd) + gains.position * (q_now - q)


def held_torque(arm: Arm, q: Array, qd: Array, qdd: Array, period: float) -> Array:
    """Torques ``(batch, n)``, N m, that held for a period (s) give the mean accelerations ``qdd`` ``(batch, n)``.

    Inverse dynamics half a period ahead, corrected once by the predicted effect of those torques.

    Raises:
        ValueError: if a shape does not fit.
    """
    require_finite("period", period, "s", "positive")
    q, qd, qdd = float_rows(arm.n_joints, q=q, qd=qd, qdd=qdd)
    tau = np.empty_like(q)
    _held_torque(*arm.chain_constants, q, qd, qdd, float(period), tau)
    return tau


@private
def held_torque_single(
    coupling: Array, weight: Array, q: Array, qd: Array, qdd: Array, period: float, tau: Array
) -> None:
    """One row of `held_torque`: inverse dynamics in the state half a period ahead, written to ``tau``."""
    half = 0.5 * period
    q_half, qd_half = np.empty_like(q), np.empty_like(q)
    for i in range(q.shape[0]):
        qd_half[i] = qd[i] + half * qdd[i]
        q_half[i] = q[i] + half * (qd[i] + 0.5 * half * qdd[i])
    inverse_dynamics_single(coupling, weight, q_half, qd_half, qdd, tau)


@njit(cache=True, nogil=True)
def _held_torque(coupling: Array, weight: Array, q: Array, qd: Array, qdd: Array, period: float, tau: Array) -> None:
    n = q.shape[1]
    m, predicted = np.empty((n, n)), np.empty(n)
    for row in range(q.shape[0]):
        held_torque_single(coupling, weight, q[row], qd[row], qdd[row], period, tau[row])
        _mean_acceleration(coupling, weight, q[row], qd[row], tau[row], period, predicted)
        mass_matrix_single(coupling, q[row], m)
        for i in range(n):
            for j in range(n):
                tau[row, i] += m[i, j] * (qdd[row, j] - predicted[j])


@njit(cache=True, nogil=True)
def held_torque_rows(
    coupling: Array, weight: Array, q: Array, qd: Array, qdd: Array, period: float, tau: Array
) -> None:
    """`held_torque` with an arm a row, coupling ``(batch, n, n)`` and weight ``(batch, n)``, written to ``tau``."""
    for row in range(q.shape[0]):
        rows = slice(row, row + 1)
        _held_torque(coupling[row], weight[row], q[rows], qd[rows], qdd[rows], period, tau[rows])


@private
def _mean_acceleration(
    coupling: Array, weight: Array, q: Array, qd: Array, tau: Array, period: float, mean: Array
) -> None:
    """Mean acceleration of one row over a period under held torques, by one step of Runge-Kutta 4."""
    k1, k2, k3, k4 = np.empty_like(q), np.empty_like(q), np.empty_like(q), np.empty_like(q)
    half = 0.5 * period
    forward_dynamics_single(coupling, weight, q, qd, tau, k1)
    forward_dynamics_single(coupling, weight, q + half * qd, qd + half * k1, tau, k2)
    forward_dynamics_single(coupling, weight, q + half * (qd + half * k1), qd + half * k2, tau, k3)
    forward_dynamics_single(coupling, weight, q + period * (qd + half * k2), qd + period * k3, tau, k4)
    for i in range(q.shape[0]):
        mean[i] = (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]) / 6.0
