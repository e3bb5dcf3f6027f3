"""Arm models of the controllers: equations of motion linear in the parameters of a payload."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from planners.checks import float_rows
from planners.robot.arm import Arm
from planners.typing import Array


class ArmModel(Protocol):
    """Equations of motion, linear in the parameters of a payload: ``tau = tau_0 + Y parameters``.

    States, velocities and accelerations are ``(batch, n)``, parameters ``(batch, p)``; the first parameter is the mass
    of the payload, kg.
    """

    @property
    def n_joints(self) -> int:
        """Number of joints, n."""
        ...

    @property
    def n_parameters(self) -> int:
        """Number of parameters, p."""
        ...

    def torque(self, q: Array, qd: Array, qd_r: Array, qdd_r: Array, parameters: Array) -> Array:
        """``M(q) qdd_r + C(q, qd) qd_r + g(q)`` plus friction at ``qd_r``, N m, ``dM/dt - 2 C`` being skew."""
        ...

    def regressor(self, q: Array, qd: Array, qd_r: Array, qdd_r: Array) -> Array:
        """``Y``, the derivative of `torque` by the parameters, ``(batch, n, p)``."""
        ...

    def mass_matrix(self, q: Array, parameters: Array) -> Array:
        """``M``, ``(batch, n, n)``, kg m^2."""
        ...


class PlanarArmModel:
    """An `Arm` as an `ArmModel`; the one parameter is the point mass at the hand, kg.

    In absolute link angles the equations of :mod:`planners.robot.dynamics` are linear in coupling matrix and weight; a
    mass m at the hand adds ``m l l^T`` and ``m g l`` to them, as `Arm.with_payload` does, l being the link lengths.
    """

    n_parameters = 1

    def __init__(self, arm: Arm) -> None:
        self.n_joints = arm.n_joints
        self._arm = arm.chain_constants
        self._unit_mass = np.outer(arm.length_array, arm.length_array), arm.gravity * arm.length_array

    def torque(self, q: Array, qd: Array, qd_r: Array, qdd_r: Array, parameters: Array) -> Array:
        """``M(q) qdd_r + C(q, qd) qd_r + g(q)``, N m, ``dM/dt - 2 C`` being skew; all ``(batch, n)``."""
        motion = self._motion(q, qd, qd_r, qdd_r)
        (parameters,) = float_rows(1, len(q), parameters=parameters)
        return _torque(*self._arm, motion) + parameters * _torque(*self._unit_mass, motion)

    def regressor(self, q: Array, qd: Array, qd_r: Array, qdd_r: Array) -> Array:
        """Torques for a mass of 1 kg alone, N m/kg, ``(batch, n, 1)``."""
        return _torque(*self._unit_mass, self._motion(q, qd, qd_r, qdd_r))[..., None]

    def _motion(self, q: Array, qd: Array, qd_r: Array, qdd_r: Array) -> Array:
        """Absolute angles and their rates, ``(4, batch, n)``."""
        motion: Array = np.cumsum(float_rows(self.n_joints, q=q, qd=qd, qd_r=qd_r, qdd_r=qdd_r), axis=2)
        return motion

    def mass_matrix(self, q: Array, parameters: Array) -> Array:
        """``M``, ``(batch, n, n)``, kg m^2."""
        (q,), (parameters,) = float_rows(self.n_joints, q=q), float_rows(1, len(q), parameters=parameters)
        coupling = self._arm[0] + parameters[:, :, None] * self._unit_mass[0]
        phi = np.cumsum(q, axis=1)
        absolute = coupling * np.cos(phi[:, :, None] - phi[:, None, :])
        outer: Array = absolute[:, ::-1, ::-1].cumsum(axis=1).cumsum(axis=2)[:, ::-1, ::-1]
        return outer


def _torque(coupling: Array, weight: Array, motion: Array) -> Array:
    """Joint torques ``(batch, n)``, N m, of a chain in absolute angles and their rates, ``(4, rows, n)``."""
    phi, w, w_r, alpha_r = motion
    difference = phi[:, :, None] - phi[:, None, :]
    inertial = np.cos(difference) * alpha_r[:, None, :]
    centrifugal = np.sin(difference) * (w * w_r)[:, None, :]
    moments = (coupling * (inertial + centrifugal)).sum(axis=2) + weight * np.cos(phi)
    outer: Array = moments[:, ::-1].cumsum(axis=1)[:, ::-1]
    return outer
