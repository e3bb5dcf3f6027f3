"""From a reference motion to joint torques: computed torque, in continuous and in sampled form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from planners.arm import Arm
from planners.dynamics import inverse_dynamics_lane
from planners.typing import Array


@dataclass(frozen=True)
class Gains:
    """Feedback gains of every joint.

    Attributes:
        position: acceleration per angle error, 1/s^2.
        velocity: acceleration per velocity error, 1/s.
    """

    position: float = 64.0
    velocity: float = 16.0


def computed_torque(
    arm: Arm, q: Array, qd: Array, reference: tuple[Array, Array, Array], gains: Gains | None = None
) -> Array:
    """Computed torque: inverse dynamics of the reference acceleration plus feedback.

    Args:
        arm: the arm as the controller knows it.
        q, qd: measured joint angles and velocities, ``(n,)`` or ``(lanes, n)``.
        reference: wanted angles, velocities and accelerations, shaped like ``q``.
        gains: of the feedback.

    Returns:
        Joint torques, shaped like ``q``, N m.
    """
    gains = gains or Gains()
    q_wanted, qd_wanted, qdd_wanted = reference
    qdd = qdd_wanted + gains.velocity * (qd_wanted - qd) + gains.position * (q_wanted - q)
    return arm.inverse_dynamics(q, qd, qdd)


def tracking_acceleration(
    q: Array,
    qd: Array,
    now: tuple[Array, Array],
    ahead: tuple[Array, Array],
    period: float,
    gains: Gains | None = None,
) -> Array:
    """Mean joint acceleration over the next control period that follows a sampled reference.

    The feed-forward is the mean acceleration of the reference over the period, (qd(t + T) - qd(t)) / T, so that a
    torque held for the whole period reproduces the reference's velocity at the next sample, not only at this one.

    Args:
        q, qd: measured joint angles and velocities, ``(lanes, n)``.
        now: wanted angles and velocities at this sample, each ``(lanes, n)``.
        ahead: the same at the next sample.
        period: control period T, s.
        gains: of the feedback.

    Returns:
        ``(lanes, n)``, rad/s^2.
    """
    gains = gains or Gains()
    feed_forward = (ahead[1] - now[1]) / period
    return feed_forward + gains.velocity * (now[1] - qd) + gains.position * (now[0] - q)


def held_torque(arm: Arm, q: Array, qd: Array, qdd: Array, period: float) -> Array:
    """Torques ``(lanes, n)``, N m, that held for a period (s) give the mean accelerations ``qdd`` ``(lanes, n)``."""
    tau = np.empty_like(q)
    _held_torque(*arm.chain_constants, q, qd, qdd, period, tau)
    return tau


def within_torque(arm: Arm, q: Array, qd: Array, qdd: Array, period: float) -> Array:
    """Accelerations scaled down, lane by lane, until the torques held for a period fit the arm's limits.

    Args:
        arm: the arm as the controller knows it.
        q, qd, qdd: joint angles, velocities and wanted mean accelerations, ``(lanes, n)``.
        period: control period, s.

    Returns:
        ``(lanes, n)``, rad/s^2; zero in a lane whose limits not even zero acceleration keeps.
    """
    limit = np.array(arm.limits.torque)
    still, wanted = held_torque(arm, q, qd, np.zeros_like(qdd), period), held_torque(arm, q, qd, qdd, period)
    room = np.where(wanted > still, limit - still, limit + still)
    share = np.divide(room, np.abs(wanted - still), out=np.ones_like(room), where=wanted != still)
    fitting: Array = qdd * np.clip(share.min(axis=1, keepdims=True), 0.0, 1.0)
    return fitting


@njit(cache=True, nogil=True)
def held_torque_lane(
    coupling: Array, weight: Array, q: Array, qd: Array, qdd: Array, period: float, tau: Array
) -> None:
    """One lane of `held_torque`: inverse dynamics in the state half a period ahead, written to ``tau``."""
    half = 0.5 * period
    q_half, qd_half = np.empty_like(q), np.empty_like(q)
    for i in range(q.shape[0]):
        qd_half[i] = qd[i] + half * qdd[i]
        q_half[i] = q[i] + half * (qd[i] + 0.5 * half * qdd[i])
    inverse_dynamics_lane(coupling, weight, q_half, qd_half, qdd, tau)


@njit(cache=True, nogil=True)
def _held_torque(coupling: Array, weight: Array, q: Array, qd: Array, qdd: Array, period: float, tau: Array) -> None:
    for lane in range(q.shape[0]):
        held_torque_lane(coupling, weight, q[lane], qd[lane], qdd[lane], period, tau[lane])
