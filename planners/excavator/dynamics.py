"""Dynamics of the excavator attachment, and of any chain of revolute joints, batched.

`ChainDynamics` is the arm itself. `PayloadModel` is a controller's model of it: the same equations, linear in a few
parameters of the payload.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit

from planners.checks import float_rows
from planners.excavator.machine import EXCAVATOR, N_JOINTS, Excavator
from planners.excavator.newton_euler import Chain, mass_matrix_single, regressor_single, torque_single
from planners.typing import Array

INERTIAL_PARAMETERS = 10
"""Mass, first moments, moments of inertia: see :mod:`planners.excavator.newton_euler`."""


@dataclass(frozen=True)
class ChainDynamics:
    """Equations of motion of a chain of ``n`` revolute joints, see :mod:`planners.excavator.newton_euler`.

    States, reference velocities and accelerations are ``(batch, n)`` throughout; other shapes are a ValueError.
    """

    frames: Array
    gravity: Array
    inertia: Array
    drives: Array

    @classmethod
    def of_excavator(cls, machine: Excavator = EXCAVATOR) -> ChainDynamics:
        """The five joints of an attachment; the tool is part of link 5."""
        a, d, alpha = (column[:N_JOINTS] for column in machine.geometry.table)
        bodies = [inertial_parameters(link.mass, np.array(link.com), np.diag(link.inertia)) for link in machine.links]
        return cls(
            frames=np.stack([a, d, np.sin(alpha), np.cos(alpha)], axis=1),
            gravity=np.array([0.0, 0.0, -machine.gravity]),
            inertia=np.array(bodies),
            drives=machine.drives,
        )

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return len(self.frames)

    @cached_property
    def chain(self) -> Chain:
        """The chain for the compiled functions."""
        return self.frames, self.gravity, self.inertia, self.drives

    def torque(self, q: Array, qd: Array, qd_r: Array, qdd_r: Array, load: Array | None = None) -> Array:
        """``M(q) qdd_r + C(q, qd) qd_r + g(q) + Ia qdd_r + b qd_r``, N m; ``qd_r = qd`` is inverse dynamics.

        ``load`` are the inertial parameters of the last link's load, ``(batch, 10)``.
        """
        motion = float_rows(self.n_joints, q=q, qd=qd, qd_r=qd_r, qdd_r=qdd_r)
        return _torque(self.chain, self._load(load, len(motion[0])), *motion)

    def mass_matrix(self, q: Array, load: Array | None = None) -> Array:
        """Mass matrices ``(batch, n, n)``, drives included, kg m^2."""
        (q,) = float_rows(self.n_joints, q=q)
        return _mass_matrix(self.chain, self._load(load, len(q)), q)

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

    ``dynamics`` are those without payload; ``basis`` ``(p, 10)`` is one unit of each parameter as a last link's load.
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
        motion = float_rows(self.n_joints, q=q, qd=qd, qd_r=qd_r, qdd_r=qdd_r)
        return _regressor(self.dynamics.chain, self.basis, *motion)

    def mass_matrix(self, q: Array, parameters: Array) -> Array:
        """Mass matrices ``(batch, n, n)`` with the payload of ``parameters`` ``(batch, p)``."""
        return self.dynamics.mass_matrix(q, parameters @ self.basis)


def inertial_parameters(mass: float, com: Array, inertia: Array) -> Array:
    """The ten inertial parameters of a rigid body, see :mod:`planners.excavator.newton_euler`.

    ``inertia`` is the matrix ``(3, 3)`` about the centre ``com`` ``(3,)``, kg m^2 and m.
    """
    about_origin = inertia + mass * (com @ com * np.eye(3) - np.outer(com, com))
    return np.concatenate([[mass], mass * com, about_origin[np.triu_indices(3)]])


def payload(mass: float, machine: Excavator = EXCAVATOR, offset: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Array:
    """The ball of ``mass`` kg that the tool carries, as a load of link 5, ``(10,)``.

    ``offset`` is that of its centre from `PayloadShape.com`, in the frame of link 5, m. A mass that is negative or not
    finite raises ValueError.
    """
    shape = machine.payload
    return inertial_parameters(mass, np.add(shape.com, offset), shape.gyration_square(mass) * mass * np.eye(3))


def payload_basis(machine: Excavator = EXCAVATOR, moments: bool = False, typical_mass: float = 175.0) -> Array:
    """Basis ``(1, 10)`` of an unknown payload's mass; ``(4, 10)`` with its three first moments.

    These are the mass times the shift of its centre, kg m. The unit mass has the radius of gyration of a ball of
    ``typical_mass`` kg.
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
