"""Closed-loop simulation of a controller and a batch of arms that differ from its model.

A sample's torque is held for a period (or follows with a lag); the equations of motion are integrated by Runge-Kutta 4.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit

from planners.checks import require_shape
from planners.control import Controller
from planners.excavator.dynamics import ChainDynamics
from planners.excavator.motion import Cycle
from planners.excavator.newton_euler import Chain, acceleration_single
from planners.typing import Array

STEP = 2.5e-3
"""Longest step of the integration, s."""


@dataclass(frozen=True)
class Plant:
    """The simulated arms, one a row.

    Attributes:
        frames, gravity: of all, see :mod:`planners.excavator.newton_euler`.
        inertia: inertial parameters of their links, payload included, ``(batch, n, 10)``.
        drives: inertia and friction of their joints, ``(batch, n, 2)``.
        lag: time constant of their actuators, ``(batch,)``, s; 0 for none.
        noise: standard deviations of measured angle and velocity, ``(batch, 2)``, rad and rad/s.
    """

    frames: Array
    gravity: Array
    inertia: Array
    drives: Array
    lag: Array
    noise: Array

    @classmethod
    def loaded(
        cls,
        dynamics: ChainDynamics,
        load: Array,
        *,
        link_scale: Array | float = 1.0,
        friction_scale: Array | float = 1.0,
        lag: Array | float = 0.0,
        noise: tuple[float, float] | Array = (0.0, 0.0),
    ) -> Plant:
        """Arms that carry loads ``(batch, 10)`` in the frame of the last link.

        Args:
            dynamics: of the arm without load.
            load: inertial parameters of the loads.
            link_scale: factor on mass and inertia of every link, ``(n,)`` or ``(batch, n)``.
            friction_scale: factor on the friction, a number or ``(batch,)``.
            lag, noise: see the class; a single value holds for all rows.
        """
        rows, n = len(load), dynamics.n_joints
        inertia = dynamics.inertia * np.broadcast_to(link_scale, (rows, n))[..., None]
        inertia[:, -1] += load
        drives = np.broadcast_to(dynamics.drives, (rows, n, 2)).copy()
        drives[..., 1] *= np.broadcast_to(friction_scale, rows)[:, None]
        lags = np.broadcast_to(np.asarray(lag, dtype=float), rows).copy()
        noises = np.broadcast_to(np.asarray(noise, dtype=float), (rows, 2)).copy()
        return cls(dynamics.frames, dynamics.gravity, inertia, drives, lags, noises)

    @property
    def rows(self) -> int:
        """Size of the batch."""
        return len(self.inertia)

    def advance(
        self, q: Array, qd: Array, applied: Array, command: Array, period: float, outside: Array | float = 0.0
    ) -> None:
        """Advance states and ``applied`` torques, ``(batch, n)``, in place by a period (s) under ``command``.

        ``outside`` are joint torques of forces from outside, ``(batch, n)``, N m, held for the period without lag.
        A shape that does not fit is a ValueError.
        """
        shape = self.inertia.shape[:2]
        for name, array in {"q": q, "qd": qd, "applied": applied, "command": command}.items():
            require_shape(name, array, shape)
        steps = math.ceil(period / STEP - 1e-9)
        arms = (self.frames, self.gravity, self.inertia, self.drives)
        pushes = np.ascontiguousarray(np.broadcast_to(np.asarray(outside, dtype=float), q.shape))
        _advance(arms, self.lag, q, qd, applied, command, pushes, period / steps, steps)


@dataclass(frozen=True)
class Run:
    """Record of a simulation at every sample.

    Attributes:
        t: ``(samples,)``, s.
        q, qd: joint angles and velocities, ``(samples, rows, n)``, rad, rad/s.
        q_d, qd_d: desired ones, ``(samples, n)``.
        tau: commanded torques, ``(samples, rows, n)``, N m.
        mass: estimated payload, ``(samples, rows)``, kg.
    """

    t: Array
    q: Array
    qd: Array
    q_d: Array
    qd_d: Array
    tau: Array
    mass: Array


def simulate(
    controller: Controller,
    plant: Plant,
    cycle: Cycle,
    cycles: int,
    *,
    seed: int = 0,
    outside: Callable[[float, Array], Array] | None = None,
    progress: Callable[[], object] = lambda: None,
) -> Run:
    """Follow a cycle several times, starting at rest on it with the payload.

    The controller keeps its memory. The measurement noise is the same in every row. ``outside`` gives the joint torques
    of forces from outside, ``(rows, n)``, N m, at a time (s) and joint angles ``(rows, n)``; the controller does not
    know them. ``progress`` is called after every cycle.

    Raises:
        ValueError: if controller and plant differ in rows, or the period of control does not divide the cycle.
    """
    period = controller.settings.period
    samples = round(cycle.period / period) * cycles
    if controller.rows != plant.rows:
        raise ValueError(f"the controller has {controller.rows} rows, the plant {plant.rows}")
    if abs(cycle.period / period - round(cycle.period / period)) > 1e-6:
        raise ValueError(f"a control period of {period} s does not divide a cycle of {cycle.period} s")
    t: Array = np.arange(samples, dtype=np.float64) * period
    q_d, qd_d, qdd_d = cycle.sample(t)
    shape, rng = plant.inertia.shape[:2], np.random.default_rng(seed)
    q, qd = np.tile(q_d[0], (plant.rows, 1)), np.zeros(shape)
    applied = np.full(shape, np.nan)
    angles, speeds, torques = np.empty((3, samples, *shape))
    masses = np.empty((samples, plant.rows))
    for k in range(samples):
        q_noise, qd_noise = rng.normal(size=(2, shape[1]))
        tau = controller.torque(
            q + plant.noise[:, :1] * q_noise,
            qd + plant.noise[:, 1:] * qd_noise,
            *(np.broadcast_to(desired[k], shape) for desired in (q_d, qd_d, qdd_d)),
        )
        angles[k], speeds[k], torques[k], masses[k] = q, qd, tau, controller.mass_estimate
        if k == 0:
            applied[:] = tau
        plant.advance(q, qd, applied, tau, period, 0.0 if outside is None else outside(float(t[k]), q))
        if (k + 1) % (samples // cycles) == 0:
            progress()
    return Run(t, angles, speeds, q_d, qd_d, torques, masses)


@njit(cache=True, nogil=True)
def _advance(
    arms: Chain,
    lag: Array,
    q: Array,
    qd: Array,
    applied: Array,
    command: Array,
    outside: Array,
    step: float,
    steps: int,
) -> None:
    frames, gravity, inertia, drives = arms
    for row in range(q.shape[0]):
        chain = (frames, gravity, inertia[row], drives[row])
        for _ in range(steps):
            _step(chain, lag[row], q[row], qd[row], applied[row], command[row], outside[row], step)


@njit(cache=True, nogil=True)
def _step(
    chain: Chain, lag: float, q: Array, qd: Array, applied: Array, command: Array, outside: Array, step: float
) -> None:
    """One step of Runge-Kutta 4; the actuators' lag is exact."""
    n = q.shape[0]
    half, nothing = 0.5 * step, np.zeros(10)
    left_half = math.exp(-half / lag) if lag > 0.0 else 0.0
    middle = command + left_half * (applied - command)
    start = applied if lag > 0.0 else command
    end = command + left_half * left_half * (applied - command)
    k1, k2, k3, k4 = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    acceleration_single(chain, nothing, q, qd, start + outside, k1)
    acceleration_single(chain, nothing, q + half * qd, qd + half * k1, middle + outside, k2)
    acceleration_single(chain, nothing, q + half * (qd + half * k1), qd + half * k2, middle + outside, k3)
    acceleration_single(chain, nothing, q + step * (qd + half * k2), qd + step * k3, end + outside, k4)
    q += step * (qd + step * (k1 + k2 + k3) / 6.0)
    qd += step * (k1 + 2.0 * (k2 + k3) + k4) / 6.0
    applied[:] = end
