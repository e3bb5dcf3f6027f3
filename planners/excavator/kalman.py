"""Computed torque for the attachment in its plane, with payload, friction and state estimated by a Kalman filter."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planners.checks import require_mask, require_shape
from planners.compiled.calls import private, require_compiled
from planners.excavator.controllers import FARTHEST, HEAVIEST
from planners.excavator.filter_model import (
    ANGLES,
    FRICTION,
    FULL_SIZE,
    N_JOINTS,
    N_LOAD,
    SETTINGS,
    SIZE,
    VELOCITIES,
    load_of,
    look_ahead,
    machine_of,
)
from planners.excavator.machine import EXCAVATOR
from planners.excavator.newton_euler import Chain, torque_single
from planners.excavator.payload_filter import begin_filter, follow
from planners.excavator.plane import JOINTS, planar_dynamics, planar_payload
from planners.typing import Array

LEAST_NOISE = (1e-6, 1e-5)
"""Standard deviations that the filter assumes at least, rad and rad/s; without noise the covariance would vanish."""


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
        masses: standard deviation of the shares by which the links are heavier than the nominal ones.
        latency: mean, standard deviation and largest value of the time by which a command comes late, s.
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
    masses: float = 0.0
    latency: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def size(self) -> int:
        """Length of the state vector: link masses and latency are estimated where they are uncertain."""
        return FULL_SIZE if self.masses > 0.0 or self.latency[2] > 0.0 else SIZE

    @property
    def commands(self) -> int:
        """Commands that can still arrive between the last sample and the next."""
        return 1 if self.size == SIZE else max(2, 1 + math.ceil(self.latency[2] / self.period - 1e-9))

    @property
    def width(self) -> int:
        """Numbers in a row of the controller's memory."""
        return self.size * (self.size + 1) + (self.commands + 2) * N_JOINTS

    def record(self) -> NDArray[Any]:
        """The settings for the compiled functions, ``(1,)`` of `SETTINGS`."""
        unit = planar_payload(1.0)
        record = np.zeros(1, dtype=SETTINGS)
        record["period"], record["lag"] = self.period, self.lag
        record["noise"] = np.maximum(self.noise, LEAST_NOISE)
        record["mean"] = self.mass[0], 0.0, 0.0, 0.0
        # Shifts of the payload's centre, or first moments.
        typical, heaviest = (math.hypot(*self.mass), HEAVIEST) if self.size == FULL_SIZE else (1.0, 1.0)
        record["deviation"] = self.mass[1], self.shift[0] * typical, self.shift[1] * typical, self.friction
        record["most"] = HEAVIEST, heaviest * FARTHEST, heaviest * FARTHEST
        # A lighter bucket may count as a payload of less than nothing.
        record["least"] = -2.0 * self.masses * planar_dynamics().inertia[-1, 0]
        record["unmodelled"], record["surprise"] = self.unmodelled, self.surprise
        record["ball"] = *unit[1:4], EXCAVATOR.payload.gyration_square(1.0)
        record["bandwidth"], record["masses"], record["latency"] = self.bandwidth, self.masses, self.latency
        record["size"], record["waiting"] = self.size, self.commands
        record["ahead"] = 0.5 * self.period + self.lag
        return record


class KalmanComputedTorque:
    """Inverse dynamics of the desired acceleration plus PD, for the estimated state, payload and friction.

    A command acts over a period, and through the drives' lag, so it is computed for a time ahead: half a period and the
    lag. State and reference are extrapolated, the reference with the jerk between its last two accelerations. Before
    that, the state is moved on over the latency by the commands that are on their way.

    Args:
        settings: of controller and filter.
        rows: size of the batch.
    """

    def __init__(self, settings: FilterSettings, rows: int = 1) -> None:
        require_compiled("the Kalman filter of the excavator")
        self.settings, self.rows = settings, rows
        self._settings = settings.record()
        self._chain = planar_dynamics().chain
        self._limit = np.array(EXCAVATOR.limits.torque[JOINTS])
        self._covariance = slice(settings.size, settings.size * (settings.size + 1))
        self._memory: Array = np.empty((rows, settings.width))
        self.reset()

    def reset(self, rows: NDArray[np.bool_] | None = None) -> None:
        """Forget all samples, in the rows of a mask ``(rows,)`` or in all of them."""
        if rows is not None:
            require_mask("rows", rows, len(self._memory))
        self._memory[slice(None) if rows is None else rows] = np.nan

    @property
    def memory(self) -> Array:
        """State carried to the next sample, ``(rows, width)``, NaN before the first (a copy).

        State vector and covariance of the filter, last commands, torque of the drives, last reference acceleration.
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
        size = self.settings.size
        first = shift * np.reshape(mass, (-1, 1)) if size == FULL_SIZE else shift
        self._memory[:, 0], self._memory[:, 1:N_LOAD], self._memory[:, FRICTION] = mass, first, np.log(friction)
        covariance = self._memory[:, self._covariance].reshape(-1, size, size)
        covariance[:, :ANGLES] = covariance[:, :, :ANGLES] = 0.0
        self._memory[:, self._covariance] = covariance.reshape(self.rows, -1)

    @property
    def mass_estimate(self) -> Array:
        """Estimated mass of the payload, ``(rows,)``, kg; NaN before the first sample."""
        return self._memory[:, 0].copy()

    def torque(
        self, q: Array, qd: Array, q_d: Array, qd_d: Array, qdd_d: Array, *, within: tuple[Array, Array] | None = None
    ) -> Array:
        """Torques to hold for a period, within the limits, N m: as `planners.control.Controller.torque`."""
        least, most, _ = np.broadcast_arrays(*(within or (-self._limit, self._limit)), q)
        samples = np.stack([q, qd, q_d, qd_d, qdd_d, least, most]).astype(float, copy=False)
        require_shape("q", q, (self.rows, len(self._limit)))
        tau: Array = np.empty_like(samples[0])
        _torque(self._settings, self._chain, samples, self._memory, tau)
        return tau


@njit(cache=True, nogil=True, error_model="numpy")
def _torque(settings: Any, chain: Chain, samples: Array, memory: Array, tau: Array) -> None:
    """The torques of all rows: filter, law, limits.

    ``samples`` ``(7, rows, n)`` are measured angle and velocity, desired angle, velocity and acceleration, least and
    largest torque.
    """
    for row in range(tau.shape[0]):
        estimate_and_control(settings[0], chain, samples[:, row], memory[row], tau[row])


@private
def estimate_and_control(known: Any, chain: Chain, samples: Array, own: Array, tau: Array) -> None:
    """One row of `_torque`: ``samples`` ``(7, n)`` and memory ``own`` ``(width,)`` to torques ``tau`` ``(n,)``.

    The torques count as sent; `replace_command` says if others were.
    """
    size, waiting = known.size, known.waiting
    first = size * (size + 1)
    last = first + waiting * N_JOINTS
    x, cov = own[:size], own[size:first].reshape(size, size)
    commands, drive = own[first:last].reshape(waiting, N_JOINTS), own[last : last + N_JOINTS]
    if math.isnan(x[0]):
        begin_filter(known, chain, samples[0], samples[1], x, cov, drive, commands)
    else:
        follow(known, chain, commands, samples[0], samples[1], x, cov, drive)
    ahead, late = x, 0.0
    if size == FULL_SIZE:
        ahead = x.copy()
        late = look_ahead(known, chain, commands, ahead, drive.copy())
    _law(known, chain, ahead, late, samples[2:5], own[last + N_JOINTS :], tau)
    for age in range(waiting - 1, 0, -1):
        commands[age, :] = commands[age - 1]
    for i in range(N_JOINTS):
        commands[0, i] = tau[i] = min(samples[6, i], max(samples[5, i], tau[i]))


@private
def replace_command(known: Any, own: Array, tau: Array) -> None:
    """Note in the memory of a row that other torques were sent than it gave last."""
    first = known.size * (known.size + 1)
    for i in range(N_JOINTS):
        own[first + i] = tau[i]


@njit(cache=True, nogil=True, error_model="numpy")
def _law(known: Any, chain: Chain, x: Array, late: float, wanted: Array, last: Array, tau: Array) -> None:
    """Torques for the state ``ahead`` of ``x``, to ``tau``; ``last``, the reference acceleration before, is renewed.

    ``wanted`` ``(3, n)`` are desired angle, velocity and acceleration, a time ``late`` before those of ``x``.
    """
    ahead = known.ahead
    load, q, qd, qdd = np.empty(10), np.empty(N_JOINTS), np.empty(N_JOINTS), np.empty(N_JOINTS)
    for i in range(N_JOINTS):
        q_d, qd_d, qdd_d = wanted[0, i], wanted[1, i], wanted[2, i]
        jerk = 0.0 if math.isnan(last[i]) else (qdd_d - last[i]) / known.period
        last[i] = qdd_d
        if late > 0.0:
            q_d += late * (qd_d + late * (0.5 * qdd_d + late * jerk / 6.0))
            qd_d += late * (qdd_d + 0.5 * late * jerk)
            qdd_d += late * jerk
        qd[i] = x[VELOCITIES + i] + ahead * qdd_d
        q[i] = x[ANGLES + i] + ahead * (x[VELOCITIES + i] + 0.5 * ahead * qdd_d)
        rate = qd_d - x[VELOCITIES + i]
        error = q_d - x[ANGLES + i] + ahead * rate
        qdd[i] = qdd_d + ahead * jerk + known.bandwidth[i] * (known.bandwidth[i] * error + 2.0 * rate)
    load_of(known, x, load)
    torque_single(machine_of(chain, x), load, q, qd, qd, qdd, tau)
    for i in range(N_JOINTS):
        tau[i] += (math.exp(x[FRICTION]) - 1.0) * chain[3][i, 1] * qd[i]
