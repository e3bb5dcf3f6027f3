"""Computed torque for the attachment in its plane, with payload, friction and state estimated by a Kalman filter."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planners.excavator.controllers import FARTHEST, HEAVIEST
from planners.excavator.machine import EXCAVATOR
from planners.excavator.newton_euler import Chain, torque_single
from planners.excavator.payload_filter import (
    ANGLES,
    FRICTION,
    N_JOINTS,
    N_LOAD,
    SETTINGS,
    SIZE,
    VELOCITIES,
    begin_filter,
    follow,
    load_of,
)
from planners.excavator.plane import JOINTS, planar_dynamics, planar_payload
from planners.typing import Array

LEAST_NOISE = (1e-6, 1e-5)
"""Standard deviations that the filter assumes at least, rad and rad/s; without noise the covariance would vanish."""

_COMMAND = SIZE * (SIZE + 1)
_WIDTH = _COMMAND + 3 * N_JOINTS


@dataclass(frozen=True)
class FilterSettings:
    """What controller and filter know of machine, sensors and payloads before the first sample.

    Attributes:
        period: between two samples, s.
        noise: standard deviations of measured angles (rad) and velocities (rad/s).
        lag: time constant with which the drives follow a command, s; 0 for none.
        mass: mean and standard deviation of a payload's mass, kg.
        shift: standard deviations of the shift of its centre along the axes of the bucket, m.
        friction: standard deviation of the logarithm of the factor on the joints' friction.
        unmodelled: standard deviation of what the model leaves out of a period's mean acceleration, rad/s^2.
        surprise: sum of a sample's six squared normalised innovations from which on the payload counts as another one;
            by chance, more than 50 come once in 200 million.
        bandwidth: rate at which the error of each joint decays, 1/s.
    """

    period: float = 0.02
    noise: tuple[float, float] = (1e-4, 5e-3)
    lag: float = 0.0
    mass: tuple[float, float] = (175.0, 100.0)
    shift: tuple[float, float] = (0.058, 0.046)
    friction: float = 0.5
    unmodelled: float = 0.01
    surprise: float = 50.0
    bandwidth: tuple[float, float, float] = (15.0, 15.0, 20.0)

    def record(self) -> NDArray[Any]:
        """The settings for the compiled functions, ``(1,)`` of `SETTINGS`."""
        unit = planar_payload(1.0)
        record = np.zeros(1, dtype=SETTINGS)
        record["period"], record["lag"] = self.period, self.lag
        record["noise"] = np.maximum(self.noise, LEAST_NOISE)
        record["mean"] = self.mass[0], 0.0, 0.0, 0.0
        record["deviation"] = self.mass[1], *self.shift, self.friction
        record["most"] = HEAVIEST, FARTHEST, FARTHEST
        record["unmodelled"], record["surprise"] = self.unmodelled, self.surprise
        record["ball"] = *unit[1:4], EXCAVATOR.payload.gyration_square(1.0)
        record["bandwidth"] = self.bandwidth
        record["ahead"] = 0.5 * self.period + self.lag
        return record


class KalmanComputedTorque:
    """Inverse dynamics of the desired acceleration plus PD, for the estimated state, payload and friction.

    A command acts over a period, and through the drives' lag, so it is computed for a time ahead: half a period and the
    lag. State and reference are extrapolated, the reference with the jerk between its last two accelerations.

    Args:
        settings: of controller and filter.
        rows: size of the batch.
    """

    def __init__(self, settings: FilterSettings, rows: int = 1) -> None:
        self.settings, self.rows = settings, rows
        self._settings = settings.record()
        self._chain = planar_dynamics().chain
        self._limit = np.array(EXCAVATOR.limits.torque[JOINTS])
        self._memory: Array = np.empty((rows, _WIDTH))
        self.reset()

    def reset(self, rows: NDArray[np.bool_] | None = None) -> None:
        """Forget all samples, in the rows of a mask ``(rows,)`` or in all of them."""
        self._memory[slice(None) if rows is None else rows] = np.nan

    @property
    def memory(self) -> Array:
        """State carried to the next sample, ``(rows, width)``, NaN before the first (a copy).

        State vector and covariance of the filter, last command, torque of the drives, last reference acceleration.
        """
        return self._memory.copy()

    @memory.setter
    def memory(self, memory: Array) -> None:
        if np.shape(memory) != self._memory.shape:
            raise ValueError(f"memory has shape {np.shape(memory)}; this controller's has {self._memory.shape}")
        self._memory[:] = memory

    def set_payload(self, mass: Array, shift: Array, friction: Array) -> None:
        """Set payload and friction, which the filter takes for certain until a sample contradicts them.

        Call it after a first sample.

        Args:
            mass: ``(rows,)``, kg.
            shift: of the payload's centre, ``(rows, 2)``, m.
            friction: factor on the joints' friction, ``(rows,)``, positive.
        """
        self._memory[:, 0], self._memory[:, 1:N_LOAD], self._memory[:, FRICTION] = mass, shift, np.log(friction)
        covariance = self._memory[:, SIZE:_COMMAND].reshape(-1, SIZE, SIZE)
        covariance[:, :ANGLES] = covariance[:, :, :ANGLES] = 0.0
        self._memory[:, SIZE:_COMMAND] = covariance.reshape(self.rows, -1)

    @property
    def mass_estimate(self) -> Array:
        """Estimated mass of the payload, ``(rows,)``, kg; NaN before the first sample."""
        return self._memory[:, 0].copy()

    def torque(
        self, q: Array, qd: Array, q_d: Array, qd_d: Array, qdd_d: Array, *, within: tuple[Array, Array] | None = None
    ) -> Array:
        """Torques to hold for a period, within the limits, N m: as `planners.control.Controller.torque`."""
        least, most, _ = np.broadcast_arrays(*(within or (-self._limit, self._limit)), q)
        samples = np.stack([q, qd, q_d, qd_d, qdd_d, least, most])
        tau: Array = np.empty_like(samples[0])
        _torque(self._settings, self._chain, samples, self._memory, tau)
        return tau


@njit(cache=True, nogil=True, error_model="numpy")
def _torque(settings: Any, chain: Chain, samples: Array, memory: Array, tau: Array) -> None:
    """The torques of all rows: filter, law, limits.

    ``samples`` ``(7, rows, n)`` are measured angle and velocity, desired angle, velocity and acceleration, least and
    largest torque.
    """
    known = settings[0]
    for row in range(tau.shape[0]):
        own = memory[row]
        x, cov = own[:SIZE], own[SIZE:_COMMAND].reshape(SIZE, SIZE)
        command = own[_COMMAND : _COMMAND + N_JOINTS]
        drive = own[_COMMAND + N_JOINTS : _COMMAND + 2 * N_JOINTS]
        q, qd = samples[0, row], samples[1, row]
        if math.isnan(x[0]):
            begin_filter(known, chain, q, qd, x, cov, drive)
        else:
            follow(known, chain, command, q, qd, x, cov, drive)
        _law(
            known, chain, x, samples[2, row], samples[3, row], samples[4, row], own[_COMMAND + 2 * N_JOINTS :], tau[row]
        )
        for i in range(N_JOINTS):
            command[i] = tau[row, i] = min(samples[6, row, i], max(samples[5, row, i], tau[row, i]))


@njit(cache=True, nogil=True, error_model="numpy")
def _law(known: Any, chain: Chain, x: Array, q_d: Array, qd_d: Array, qdd_d: Array, last: Array, tau: Array) -> None:
    """Torques for the state ``ahead``, to ``tau``; ``last``, the reference acceleration before, is renewed."""
    ahead = known.ahead
    load, q, qd, qdd = np.empty(10), np.empty(N_JOINTS), np.empty(N_JOINTS), np.empty(N_JOINTS)
    for i in range(N_JOINTS):
        jerk = 0.0 if math.isnan(last[i]) else (qdd_d[i] - last[i]) / known.period
        last[i] = qdd_d[i]
        qd[i] = x[VELOCITIES + i] + ahead * qdd_d[i]
        q[i] = x[ANGLES + i] + ahead * (x[VELOCITIES + i] + 0.5 * ahead * qdd_d[i])
        rate = qd_d[i] - x[VELOCITIES + i]
        error = q_d[i] - x[ANGLES + i] + ahead * rate
        qdd[i] = qdd_d[i] + ahead * jerk + known.bandwidth[i] * (known.bandwidth[i] * error + 2.0 * rate)
    load_of(known, x, load)
    torque_single(chain, load, q, qd, qd, qdd, tau)
    for i in range(N_JOINTS):
        tau[i] += (math.exp(x[FRICTION]) - 1.0) * chain[3][i, 1] * qd[i]
