"""Control laws: with a fixed payload estimate, and with adaptive ones.

The estimates of an adaptive law start at the prior, follow a law derived from a Lyapunov function, and stay within the
prior's bounds. The laws hold in continuous time; sampled, they take one Euler step a period.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planners.checks import float_vector
from planners.control.controller import Controller, ControlSettings, PayloadPrior, Sample
from planners.control.model import ArmModel
from planners.typing import Array


class PDGravity(Controller):
    """PD control with gravity compensation: ``inertia (lambda^2 e + 2 lambda e') + g(q)``."""

    def _law(self, sample: Sample) -> Array:
        bandwidth, still = self.settings.bandwidth, np.zeros_like(sample.q)
        feedback = self.settings.inertia * bandwidth * (bandwidth * sample.error + 2.0 * sample.error_rate)
        return feedback + self.model.torque(sample.q, still, still, still, self.parameters)


class ComputedTorque(Controller):
    """Inverse dynamics of the desired acceleration plus PD: with an exact model a double error pole at -lambda."""

    def _law(self, sample: Sample) -> Array:
        return self.model.torque(sample.q, sample.qd, sample.qd, self._acceleration(sample), self.parameters)

    def _acceleration(self, sample: Sample) -> Array:
        """Desired acceleration with feedback, rad/s^2."""
        bandwidth = self.settings.bandwidth
        feedback: Array = bandwidth * (bandwidth * sample.error + 2.0 * sample.error_rate)
        return sample.qdd_d + feedback


class IntegralComputedTorque(ComputedTorque):
    """Computed torque with an integral of the error: with an exact model a triple pole at -lambda."""

    def _acceleration(self, sample: Sample) -> Array:
        bandwidth = self.settings.bandwidth
        feedback = 3.0 * (bandwidth * sample.error + sample.error_rate) + bandwidth**2 * self._carried
        return sample.qdd_d + bandwidth * feedback

    def _update(self, sample: Sample, free: NDArray[np.bool_]) -> None:
        self._carried[:] += self.settings.period * sample.error * free


class AdaptiveController(Controller):
    """A controller with an adaptation law.

    ``gain`` is Gamma, the adaptation gain of each parameter, ``(p,)``; its unit depends on the law.
    """

    def __init__(
        self, model: ArmModel, settings: ControlSettings, prior: PayloadPrior, gain: Array, rows: int = 1
    ) -> None:
        self.gain = float_vector("gain", gain, model.n_parameters, "not negative")
        super().__init__(model, settings, prior, rows)

    def _adapt(self, regressor: Array, direction: Array) -> None:
        """One period of ``parameters' = gain regressor^T direction``, ``(batch, n, p)`` and ``(batch, n)``."""
        rate = self.gain * np.einsum("lnp,ln->lp", regressor, direction)
        moved = self.parameters + self.settings.period * rate
        np.clip(moved, self.prior.lower, self.prior.upper, out=self.parameters)


class AdaptiveComputedTorque(AdaptiveController, ComputedTorque):
    """Computed torque with an estimated payload: the law of the excavator paper (eq 3-1 to 3-19).

    It is the law of J. J. Craig, P. Hsu and S. S. Sastry ("Adaptive Control of Mechanical Manipulators", 1987):
    ``parameters' = gain Y(q, q', q'')^T M^-1 B^T P (e, e')``. ``P`` solves ``A^T P + P A = -Q`` (eq 3-16) for the error
    dynamics of computed torque with ``Q = diag(2 lambda^3, 2 lambda)``, so that ``B^T P (e, e') = lambda e + e'``. The
    acceleration is the difference of two measured velocities; the estimated mass matrix must be regular.
    """

    _carried_at_first = np.nan  # the last velocity; none before the first sample

    def _update(self, sample: Sample, free: NDArray[np.bool_]) -> None:
        measured = (sample.qd - self._carried) / self.settings.period
        qdd = np.where(np.isnan(measured), sample.qdd_d, measured)
        direction = free * (self.settings.bandwidth * sample.error + sample.error_rate)
        m = self.model.mass_matrix(sample.q, self.parameters)
        settled: Array = np.linalg.solve(m, direction[..., None])[..., 0].astype(np.float64, copy=False)
        self._adapt(self.model.regressor(sample.q, sample.qd, sample.qd, qdd), settled)
        self._carried[:] = sample.qd


class SlotineLi(AdaptiveController):
    """Adaptive control without measured acceleration and without the inverse of the mass matrix.

    J.-J. E. Slotine and W. Li, "On the Adaptive Control of Robot Manipulators" (1987): with the reference velocity
    ``q_r' = q_d' + lambda e`` and the sliding variable ``s = q_r' - q'``

        tau = M q_r'' + C q_r' + g + K s,    parameters' = gain Y(q, q', q_r', q_r'')^T s,    K = lambda inertia
    """

    def _law(self, sample: Sample) -> Array:
        qd_r, qdd_r = self._reference(sample)
        damping = self.settings.bandwidth * self.settings.inertia
        return self.model.torque(sample.q, sample.qd, qd_r, qdd_r, self.parameters) + damping * (qd_r - sample.qd)

    def _update(self, sample: Sample, free: NDArray[np.bool_]) -> None:
        qd_r, qdd_r = self._reference(sample)
        self._adapt(self.model.regressor(sample.q, sample.qd, qd_r, qdd_r), free * (qd_r - sample.qd))

    def _reference(self, sample: Sample) -> tuple[Array, Array]:
        """Reference velocity and acceleration, ``(batch, n)``, rad/s and rad/s^2."""
        bandwidth = self.settings.bandwidth
        return sample.qd_d + bandwidth * sample.error, sample.qdd_d + bandwidth * sample.error_rate


class IntegralSlotineLi(SlotineLi):
    """Slotine and Li's law with an integral in the sliding variable, ``s = e' + 2 lambda e + lambda^2 int e``.

    With an exact model the error has a triple pole at -lambda, as with `IntegralComputedTorque`. The integral
    compensates what no parameter describes (friction, another centre of mass).
    """

    def _update(self, sample: Sample, free: NDArray[np.bool_]) -> None:
        super()._update(sample, free)
        self._carried[:] += self.settings.period * sample.error * free

    def _reference(self, sample: Sample) -> tuple[Array, Array]:
        bandwidth = self.settings.bandwidth
        qd_r = sample.qd_d + bandwidth * (2.0 * sample.error + bandwidth * self._carried)
        qdd_r = sample.qdd_d + bandwidth * (2.0 * sample.error_rate + bandwidth * sample.error)
        return qd_r, qdd_r
