"""An extended Kalman filter of a planar arm: joints, masses, payload and friction, and the state ahead of a latency.

The state vector holds the angles (rad) and velocities (rad/s) of the n joints, the share by which each link is heavier
than the nominal one, the payload (kg), viscous (N m s/rad) and dry friction (N m) of a joint, and the time by which a
command comes late, in steps of the simulation: ``3 n + 4`` numbers. Between two samples the equations of motion move
the joints under the torques that reach them; the other numbers stay. See D. Simon, "Optimal State Estimation" (2006),
section 13.2. The state is then simulated on over the latency, with the torques that are on their way.

Each correction is linear, around what is likely so far: a payload of several times the mass of the last link, far above
the standard deviation that was declared, is underestimated, because accelerations hardly depend on it any more.

A latency that is not known is between two declared ends. A derivative by it is a difference over what is likely, with
noise for the bend between: motion bends where another command begins to arrive (M. Norgaard, N. Poulsen and O. Ravn,
"New developments in state estimation for nonlinear systems", 2000).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planners.checks import float_rows, floats, require_finite, require_mask, require_shape
from planners.compiled.calls import private
from planners.control.filtering import correct_by, move_covariance
from planners.control.observer_settings import ObserverSettings
from planners.control.tracking import held_torque_rows
from planners.robot.arm import Arm
from planners.robot.dynamics import mass_matrix_single, solve_mass_matrix
from planners.typing import Array

LEAST_NOISE = (2e-6, 2e-5)
"""Standard deviations that are assumed at least, rad and rad/s; without noise the covariance would vanish."""

CREEP = 0.01
"""Joint velocity below which dry friction is proportional to the velocity, rad/s."""

REACH = 3.0
"""Square of the standard deviations either way that count as likely."""

LEAST_REACH = 1e-3
"""Difference of latencies over which a derivative is taken at least, in steps."""

_SURE = 5.0
"""Standard deviations of the noise up to which a first measured velocity counts as rest."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """What is estimated for the time at which the next command arrives.

    Attributes:
        q, qd, qdd: angles, velocities and accelerations of the joints, ``(batch, n)``.
        coupling: coupling matrices of the arms, ``(batch, n, n)``, kg m^2.
        weight: weights of the arms, ``(batch, n)``, N m.
        friction: viscous (N m s/rad) and dry friction (N m), ``(batch, 2)``.
        late: time until then, ``(batch,)``, s.
    """

    q: Array
    qd: Array
    qdd: Array
    coupling: Array
    weight: Array
    friction: Array
    late: Array

    def held_torque(self, qdd: Array, period: float) -> Array:
        """Torques ``(batch, n)``, N m, that held for a period (s) give mean accelerations ``qdd`` ``(batch, n)``.

        Another shape is a ValueError.
        """
        require_finite("period", period, "s", "positive")
        require_shape("qdd", qdd, self.q.shape)
        qdd = floats("qdd", qdd)
        tau = np.empty_like(qdd)
        held_torque_rows(self.coupling, self.weight, self.q, self.qd, qdd, float(period), tau)
        middle = self.qd + 0.5 * period * qdd
        return tau + self.friction[:, :1] * middle + self.friction[:, 1:] * np.clip(middle / CREEP, -1.0, 1.0)


class ArmObserver:
    """The filter of a batch of arms; all that it remembers lies in the rows of ``memory``.

    Args:
        arm: the nominal arm, without payload.
        settings: what is known beforehand.
    """

    def __init__(self, arm: Arm, settings: ObserverSettings) -> None:
        n, period = arm.n_joints, settings.period
        self.n_joints, self.settings = n, settings
        nominal = arm.chain_constants
        chains = [nominal]
        for i in range(n):  # the equations are linear in the masses: what each link adds
            double = 1.0 + np.eye(n)[i]
            doubled = replace(
                arm,
                masses=tuple((double * np.array(arm.masses)).tolist()),
                inertias=tuple((double * np.array(arm.inertias)).tolist()),
            ).chain_constants
            chains.append((doubled[0] - nominal[0], doubled[1] - nominal[1]))
        lengths = arm.length_array
        chains.append((np.outer(lengths, lengths), arm.gravity * lengths))
        self._coupling = np.ascontiguousarray([coupling for coupling, _ in chains])
        self._weight = np.ascontiguousarray([weight for _, weight in chains])
        self._size = 3 * n + 4
        prior = np.zeros((self._size, self._size))
        prior[2 * n : 3 * n, 2 * n : 3 * n] = settings.masses**2 * (np.ones((n, n)) if settings.alike else np.eye(n))
        prior[3 * n, 3 * n] = settings.payload**2
        prior[3 * n + 1, 3 * n + 1], prior[3 * n + 2, 3 * n + 2] = np.square(settings.friction)
        prior[3 * n + 3, 3 * n + 3] = (settings.late[1] - settings.late[0]) ** 2 / 12.0  # of a uniform distribution
        noise = np.maximum(settings.noise, LEAST_NOISE)
        # Friction takes at most half of what would stop a joint in a step: else the simulation would not be stable.
        mobility = 1.0 / np.array(arm.inertias)
        mobility[1:] += mobility[:-1].copy()
        most = 0.5 / (mobility * period / settings.steps)
        self._known = prior, noise, most, np.array(settings.likely_friction)
        self._times = np.array([period, period / settings.steps, settings.unmodelled])
        self._steps = np.array([settings.steps, *settings.late])

    @property
    def width(self) -> int:
        """Numbers in a row of the memory: state vector, covariance, and commands on their way."""
        return self._size * (self._size + 1) + (self.settings.waiting + 1) * self.n_joints

    def update(self, memory: Array, starts: NDArray[np.bool_], q: Array, qd: Array) -> Estimate:
        """Follow a period and correct by the samples ``q, qd`` ``(batch, n)``; renews ``memory`` ``(batch, width)``.

        In the rows of ``starts`` ``(batch,)`` an episode begins. A shape that does not fit is a ValueError.
        """
        q, qd = float_rows(self.n_joints, q=q, qd=qd)
        rows, n = q.shape
        self._require_memory(memory, rows)
        require_mask("starts", starts, rows)
        out, coupling, weight = np.empty((3, rows, n)), np.empty((rows, n, n)), np.empty((rows, n))
        chain = self._coupling, self._weight
        _update(chain, self._known, self._times, self._steps, memory, starts, q, qd, out, coupling, weight)
        friction, late = memory[:, 3 * n + 1 : 3 * n + 3].copy(), memory[:, 3 * n + 3] * self._times[1]
        return Estimate(out[0], out[1], out[2], coupling, weight, friction, late)

    def _require_memory(self, memory: Array, rows: int) -> None:
        require_shape("memory", memory, (rows, self.width))
        if type(memory) is not np.ndarray or memory.dtype != np.float64 or not (memory.flags.carray):
            raise ValueError("memory must be an array of floats that can be written to, row by row, as np.zeros makes")

    def send(self, memory: Array, tau: Array) -> None:
        """Note in ``memory`` the torques ``(batch, n)`` of a new command, N m."""
        n, first = self.n_joints, self._size * (self._size + 1)
        require_shape("tau", tau, (len(memory), n))
        self._require_memory(memory, len(memory))
        memory[:, first + n :] = memory[:, first:-n].copy()
        memory[:, first : first + n] = tau


@njit(cache=True, nogil=True, error_model="numpy")
def _update(
    chain: Any,
    known: Any,
    times: Array,
    steps: Any,
    memory: Array,
    starts: Any,
    q: Array,
    qd: Array,
    out: Array,
    coupling: Array,
    weight: Array,
) -> None:
    """All rows of `ArmObserver.update`; ``out`` ``(3, rows, n)`` are angles, velocities and accelerations ahead."""
    n = q.shape[1]
    size = 3 * n + 4
    prior, noise, most, friction = known
    for row in range(q.shape[0]):
        own = memory[row]
        x, cov = own[:size], own[size : size * (size + 1)].reshape(size, size)
        commands = own[size * (size + 1) :].reshape(-1, n)
        qdd = out[2, row]
        if starts[row]:
            x[:], cov[:, :], commands[:, :] = 0.0, prior, 0.0
            x[3 * n + 1], x[3 * n + 2] = friction
            x[size - 1] = 0.5 * (steps[1] + steps[2])
            for i in range(n):
                x[i], cov[i, i] = q[row, i], noise[0] ** 2
                moving = abs(qd[row, i]) > _SURE * noise[1]
                x[n + i] = qd[row, i] if moving else 0.0
                cov[n + i, n + i] = noise[1] ** 2 if moving else LEAST_NOISE[1] ** 2
        else:
            if not steps[1] <= x[size - 1] <= steps[2]:  # not from here; commands are looked up by it
                x[size - 1] = 0.5 * (steps[1] + steps[2])
            _predict(chain, most, times, steps, commands, x, cov, qdd)
            _correct(noise, steps, q[row], qd[row], x, cov)
        ahead = x.copy()
        qdd[:] = 0.0
        _move(chain, most, times, steps[0], commands, 0, ahead[size - 1], ahead, qdd)
        out[0, row], out[1, row] = ahead[:n], ahead[n : 2 * n]
        _loaded(chain, x, coupling[row], weight[row])


@private
def _loaded(chain: Any, x: Array, coupling: Array, weight: Array) -> None:
    """Coupling matrix and weight of the arm with the masses of ``x``."""
    n = weight.shape[0]
    coupling[:, :], weight[:] = chain[0][0], chain[1][0]
    for k in range(n + 1):
        share = x[2 * n + k]
        for i in range(n):
            weight[i] += share * chain[1][k + 1, i]
            for j in range(n):
                coupling[i, j] += share * chain[0][k + 1, i, j]


@private
def _move(
    chain: Any,
    most: Array,
    times: Array,
    steps: int,
    commands: Array,
    first: int,
    last: float,
    x: Array,
    qdd: Array,
) -> None:
    """Move the joints of ``x`` on from step ``first`` to ``last``, counted from now.

    ``commands[k]`` was sent ``k + 1`` periods of so many ``steps`` ago. A step in which another command begins to
    arrive has the mean torque; the last step may be a part of one.
    """
    n = qdd.shape[0]
    coupling, weight, tau = np.empty((n, n)), np.empty(n), np.empty(n)
    _loaded(chain, x, coupling, weight)
    angles, rates = x[:n], x[n : 2 * n]
    viscous, dry = x[3 * n + 1], x[3 * n + 2]
    whole = int(x[3 * n + 3])
    part = x[3 * n + 3] - whole
    for step in range(first, math.ceil(last)):
        duration = times[1] * min(1.0, last - step)
        new = commands[max(0, (whole - step + steps - 1) // steps - 1)]
        old = commands[min(len(commands) - 1, (whole - step + steps) // steps - 1)]
        for i in range(n):
            speed = rates[i]
            friction = viscous * speed + dry * min(1.0, max(-1.0, speed / CREEP))
            bound = most[i] * abs(speed)
            tau[i] = new[i] + part * (old[i] - new[i]) - min(bound, max(-bound, friction))
            angles[i] += 0.5 * duration * speed
        _accelerate(coupling, weight, angles, rates, tau, duration, qdd)
        for i in range(n):
            rates[i] += duration * qdd[i]
            angles[i] += 0.5 * duration * rates[i]


@private
def _accelerate(
    coupling: Array, weight: Array, half: Array, rates: Array, tau: Array, duration: float, qdd: Array
) -> None:
    """Mean accelerations over a step of a ``duration``, to ``qdd``, with the angles ``half`` a step on.

    The links' momenta, along the directions they had half a step before the start, change by the impulse of the
    torques in the directions ``half`` a step after it, as in the simulation of rigid bodies joined by impulses.
    """
    n = qdd.shape[0]
    phi, turn, m, outer = np.cumsum(half), np.cumsum(rates), np.empty((n, n)), 0.0
    mass_matrix_single(coupling, half, m)
    for i in range(n - 1, -1, -1):
        moment = weight[i] * math.cos(phi[i])
        for j in range(n):
            apart = phi[i] - phi[j]
            moment += coupling[i, j] * (math.cos(apart) - math.cos(apart + duration * turn[j])) * turn[j] / duration
        outer += moment
        qdd[i] = tau[i] - outer
    solve_mass_matrix(m, qdd)


@private
def _predict(
    chain: Any, most: Array, times: Array, steps: Any, commands: Array, x: Array, cov: Array, qdd: Array
) -> None:
    """Move state and covariance on by the last period; the derivatives are differences."""
    n, size = qdd.shape[0], x.shape[0]
    begin, f, bend = x.copy(), np.eye(size), np.zeros(2 * n)
    _move(chain, most, times, steps[0], commands, -steps[0], 0.0, x, qdd)
    for k in range(size):
        if cov[k, k] > 0.0:
            low, high = begin[k], begin[k] + 1e-6
            less = x
            if k == size - 1:
                reach = max(LEAST_REACH, math.sqrt(REACH * cov[k, k]))
                low, high = max(float(steps[1]), low - reach), min(float(steps[2]), high + reach)
                less = begin.copy()
                less[k] = low
                _move(chain, most, times, steps[0], commands, -steps[0], 0.0, less, qdd)
            more = begin.copy()
            more[k] = high
            _move(chain, most, times, steps[0], commands, -steps[0], 0.0, more, qdd)
            for i in range(2 * n):
                f[i, k] = (more[i] - less[i]) / (high - low)
                bend[i] += (x[i] - less[i] - f[i, k] * (begin[k] - low)) ** 2
    move_covariance(f, cov)
    for i in range(n):
        cov[i, i] += (0.5 * times[2] * times[0] ** 2) ** 2 + bend[i]
        cov[n + i, n + i] += (times[2] * times[0]) ** 2 + bend[n + i]


@private
def _correct(noise: Array, steps: Any, q: Array, qd: Array, x: Array, cov: Array) -> None:
    """Correct by the measured numbers, one after the other."""
    n, size = q.shape[0], x.shape[0]
    for j in range(2 * n):
        correct_by(q[j] if j < n else qd[j - n], j, noise[j // n] ** 2, x, cov)
    for k in range(2 * n, size - 1):
        x[k] = max(-0.9 if k < 3 * n else 0.0, x[k])
    x[size - 1] = min(float(steps[2]), max(float(steps[1]), x[size - 1]))
