"""Interface between controllers and models of arms."""

from __future__ import annotations

from typing import Protocol

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
