"""Dynamics of the excavator attachment, and of any chain of revolute joints, batched.

`ChainDynamics` is the arm as it is. `PayloadModel` is what a controller knows of it: the same equations, with a payload
told by a few parameters in which they are linear.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit

from planners.excavator.machine import EXCAVATOR, Excavator
from planners.excavator.newton_euler import (
    Chain,
    acceleration_single,
    mass_matrix_single,
    potential_energy_single,
    regressor_single,
    torque_single,
)
from planners.robot.arm import Arm
from planners.typing import Array

INERTIAL_PARAMETERS = 10
"""Mass, first moments, moments of inertia: see :mod:`planners.excavator.newton_euler`."""


@dataclass(frozen=True)
class ChainDynamics:
    """Equations of motion of a chain of ``n`` revolute joints. States are ``(batch, n)`` throughout.

    Attributes:
        frames, gravity, inertia, drives: as :mod:`planners.excavator.newton_euler` has them.
    """

    frames: Array
    gravity: Array
    inertia: Array
    drives: Array

    @classmethod
    def of_excavator(cls, machine: Excavator = EXCAVATOR) -> ChainDynamics:
        """The five joints of an attachment; the tool is part of link 5."""
        n, geometry = machine.n_joints, machine.geometry
        alpha = geometry.alpha_array[:n]
        bodies = zip(machine.mass_array, machine.com_array, machine.inertia_array, strict=True)
        return cls(
            frames=np.stack([geometry.a_array[:n], geometry.d_array[:n], np.sin(alpha), np.cos(alpha)], axis=1),
            gravity=np.array([0.0, 0.0, -machine.gravity]),
            inertia=np.array([inertial_parameters(mass, com, np.diag(moments)) for mass, com, moments in bodies]),
            drives=np.stack([machine.actuator_inertia_array, machine.friction_array], axis=1),
        )

    @classmethod
    def of_planar_arm(cls, arm: Arm) -> ChainDynamics:
        """A planar arm: every joint axis parallel, gravity along -y, no friction."""
        n = arm.n_joints
        bodies = zip(arm.masses, arm.coms, arm.lengths, arm.inertias, strict=True)
        return cls(
            frames=np.stack([arm.length_array, np.zeros(n), np.zeros(n), np.ones(n)], axis=1),
            gravity=np.array([0.0, -arm.gravity, 0.0]),
            inertia=np.array(
                [
                    inertial_parameters(mass, np.array([com - length, 0.0, 0.0]), np.diag([0.0, inertia, inertia]))
                    for mass, com, length, inertia in bodies
                ]
            ),
            drives=np.zeros((n, 2)),
        )

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return len(self.frames)

    @cached_property
    def chain(self) -> Chain:
        """The form the compiled functions take."""
        return self.frames, self.gravity, self.inertia, self.drives

    def torque(self, q: Array, qd: Array, qd_r: Array, qdd_r: Array, load: Array | None = None) -> Array:
        """``M(q) qdd_r + C(q, qd) qd_r + g(q) + Ia qdd_r + b qd_r``, N m; ``qd_r = qd`` is inverse dynamics.

        Args:
            q, qd: state, ``(batch, n)``.
            qd_r, qdd_r: reference velocity and acceleration, ``(batch, n)``.
            load: inertial parameters of what the last link carries, ``(batch, 10)``; none when left out.
        """
        return _torque(self.chain, self._load(load, len(q)), q, qd, qd_r, qdd_r)

    def regressor(self, basis: Array, q: Array, qd: Array, qd_r: Array, qdd_r: Array) -> Array:
        """What each load of ``basis`` ``(p, 10)`` adds to `torque`, ``(batch, n, p)``."""
        return _regressor(self.chain, basis, q, qd, qd_r, qdd_r)

    def mass_matrix(self, q: Array, load: Array | None = None) -> Array:
        """Mass matrices ``(batch, n, n)``, drives included, kg m^2."""
        return _mass_matrix(self.chain, self._load(load, len(q)), q)

    def forward_dynamics(self, q: Array, qd: Array, tau: Array, load: Array | None = None) -> Array:
        """Joint accelerations ``(batch, n)``, rad/s^2, under torques ``tau``."""
        return _acceleration(self.chain, self._load(load, len(q)), q, qd, tau)

    def energy(self, q: Array, qd: Array, load: Array | None = None) -> Array:
        """Kinetic plus potential energy ``(batch,)``, J; potential zero at the height of the base."""
        loads = self._load(load, len(q))
        kinetic = 0.5 * np.einsum("li,lij,lj->l", qd, _mass_matrix(self.chain, loads, q), qd)
        total: Array = kinetic + _potential_energy(self.chain, loads, q)
        return total

    @staticmethod
    def _load(load: Array | None, rows: int) -> Array:
        if load is None:
            return np.zeros((rows, INERTIAL_PARAMETERS))
        if load.shape != (rows, INERTIAL_PARAMETERS):
            raise ValueError(f"load has shape {load.shape}; give ({rows}, {INERTIAL_PARAMETERS})")
        return load


@dataclass(frozen=True)
class PayloadModel:
    """The equations of motion linear in a few parameters of the payload: a :class:`planners.control.ArmModel`.

    Attributes:
        dynamics: the arm without payload.
        basis: what one unit of each parameter is, as a load of the last link, ``(p, 10)``.
    """

    dynamics: ChainDynamics
    basis: Array

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return self.dynamics.n_joints

    @property
    def n_parameters(self) -> int:
        """Number of parameters of the payload; the first is its mass, kg."""
        return len(self.basis)

    def torque(self, q: Array, qd: Array, qd_r: Array, qdd_r: Array, parameters: Array) -> Array:
        """`ChainDynamics.torque` with the payload of ``parameters`` ``(batch, p)``."""
        return self.dynamics.torque(q, qd, qd_r, qdd_r, parameters @ self.basis)

    def regressor(self, q: Array, qd: Array, qd_r: Array, qdd_r: Array) -> Array:
        """Derivative of `torque` by the parameters, ``(batch, n, p)``."""
        return self.dynamics.regressor(self.basis, q, qd, qd_r, qdd_r)

    def mass_matrix(self, q: Array, parameters: Array) -> Array:
        """Mass matrices ``(batch, n, n)`` with the payload of ``parameters`` ``(batch, p)``."""
        return self.dynamics.mass_matrix(q, parameters @ self.basis)


def inertial_parameters(mass: float, com: Array, inertia: Array) -> Array:
    """The ten inertial parameters of a rigid body.

    Args:
        mass: kg.
        com: its centre, ``(3,)``, m.
        inertia: matrix about that centre, ``(3, 3)``, kg m^2.

    Returns:
        ``(10,)``: see :mod:`planners.excavator.newton_euler`.
    """
    about_origin = inertia + mass * (com @ com * np.eye(3) - np.outer(com, com))
    return np.concatenate([[mass], mass * com, about_origin[np.triu_indices(3)]])


def payload(mass: float, machine: Excavator = EXCAVATOR, offset: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Array:
    """The ball that the tool carries, as a load of link 5, ``(10,)``.

    Args:
        mass: kg.
        machine: whose.
        offset: of its centre from where it should be, in the frame of link 5, m.

    Raises:
        ValueError: if the mass is negative or not finite.
    """
    shape = machine.payload
    return inertial_parameters(mass, shape.com_array + offset, shape.gyration_square(mass) * mass * np.eye(3))


def payload_basis(machine: Excavator = EXCAVATOR, moments: bool = False, typical_mass: float = 175.0) -> Array:
    """Parameters of a payload that is not known: its mass and, when asked for, the shift of its centre.

    Args:
        machine: whose.
        moments: adapt the three first moments (mass times shift of the centre, kg m), too.
        typical_mass: kg; the ball of this mass lends the unit mass its radius of gyration.

    Returns:
        ``(1, 10)`` or ``(4, 10)``.
    """
    mass = payload(typical_mass, machine) / typical_mass
    return np.vstack([mass, np.eye(INERTIAL_PARAMETERS)[1:4]]) if moments else mass[None]


@njit(cache=True, nogil=True)
def _torque(chain: Chain, load: Array, q: Array, qd: Array, qd_r: Array, qdd_r: Array) -> Array:
    tau = np.empty_like(q)
    for row in range(q.shape[0]):
        torque_single(chain, load[row], q[row], qd[row], qd_r[row], qdd_r[row], tau[row])
    return tau


@njit(cache=True, nogil=True)
def _regressor(chain: Chain, basis: Array, q: Array, qd: Array, qd_r: Array, qdd_r: Array) -> Array:
    columns = np.empty((*q.shape, basis.shape[0]))
    for row in range(q.shape[0]):
        regressor_single(chain, basis, q[row], qd[row], qd_r[row], qdd_r[row], columns[row])
    return columns


@njit(cache=True, nogil=True)
def _mass_matrix(chain: Chain, load: Array, q: Array) -> Array:
    rows, n = q.shape
    m = np.empty((rows, n, n))
    for row in range(rows):
        mass_matrix_single(chain, load[row], q[row], m[row])
    return m


@njit(cache=True, nogil=True)
def _acceleration(chain: Chain, load: Array, q: Array, qd: Array, tau: Array) -> Array:
    qdd = np.empty_like(q)
    for row in range(q.shape[0]):
        acceleration_single(chain, load[row], q[row], qd[row], tau[row], qdd[row])
    return qdd


@njit(cache=True, nogil=True)
def _potential_energy(chain: Chain, load: Array, q: Array) -> Array:
    total = np.empty(q.shape[0])
    for row in range(q.shape[0]):
        total[row] = potential_energy_single(chain, load[row], q[row])
    return total
