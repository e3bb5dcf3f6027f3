"""Online estimation of a payload's mass from the applied torques."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planners.checks import float_rows, float_vector, require_finite, require_mask
from planners.control.model import ArmModel
from planners.typing import Array

CUTOFF = 2.0
"""Cutoff of the low-pass filter on both sides of the prediction, rad/s."""

PRIOR = 1e-9
"""Information of the prior, 1/kg^2: negligible beside any motion, it keeps the expected payload at rest."""


@dataclass(frozen=True, eq=False)
class LeastSquaresSums:
    """Sums over the samples of each row so far.

    Attributes:
        regressor, residual: filtered torques of 1 kg of payload, and filtered torques minus those of the arm without
            payload, shares of the limits, ``(batch, n)``.
        information: sum of the squares of the regressors, 1/kg^2, ``(batch,)``.
        correlation: sum of the products of regressors and residuals, 1/kg, ``(batch,)``.
    """

    regressor: Array
    residual: Array
    information: Array
    correlation: Array

    @classmethod
    def before(cls, rows: int, n_joints: int, expected: float = 0.0) -> LeastSquaresSums:
        """Before the first sample, with an expected payload, kg."""
        nothing = np.zeros((rows, n_joints))
        return cls(nothing, nothing, np.zeros(rows), np.full(rows, PRIOR * expected))

    def restarted(self, rows: NDArray[np.bool_], expected: float = 0.0) -> LeastSquaresSums:
        """A copy with the rows of a mask ``(batch,)`` as they are before the first sample."""
        require_mask("rows", rows, len(self.information))
        regressor, residual = self.regressor * ~rows[:, None], self.residual * ~rows[:, None]
        correlation = np.where(rows, PRIOR * expected, self.correlation)
        return LeastSquaresSums(regressor, residual, self.information * ~rows, correlation)

    @property
    def mass(self) -> Array:
        """The estimate, ``(batch,)``, kg; never negative."""
        return np.maximum(0.0, self.correlation / (self.information + PRIOR))


class PayloadEstimator:
    """Least squares on the error of the predicted torque.

    The torques ``tau`` that were held for a period gave the mean acceleration ``q''`` over it, so in the state at its
    middle ``tau - tau_0(q, q', q'')`` should be ``Y(q, q', q'') m``. Both sides pass the same low-pass filter, which
    keeps the equation and removes noise: unfiltered, noise of the acceleration, which is in ``Y`` too, biases the
    estimate to zero. The mass has the least squared error over all samples, joints weighted by their torque limits.
    ``tau`` is the applied torque, after any limit.

    With computed torque of the estimated mass it is the indirect adaptive law of R. H. Middleton and G. C. Goodwin,
    "Adaptive computed torque control for rigid link manipulations" (1988). Unlike `AdaptiveComputedTorque` it needs no
    tracking error (so it serves policies without a reference) and no inverse of the mass matrix.

    Args:
        model: the arm without payload, with the mass as the only parameter.
        torque_limit: of each joint, ``(n,)``, N m; a joint without one (infinite) counts as much as the strongest.
        period: for which torques are held, s.
        cutoff: of the filter, rad/s.

    Raises:
        ValueError: for a model with other parameters, and for values that are not positive.
    """

    def __init__(self, model: ArmModel, torque_limit: Array, period: float, cutoff: float = CUTOFF) -> None:
        if model.n_parameters != 1:
            raise ValueError(f"a model with {model.n_parameters} parameters; give one with the mass alone")
        require_finite("period", period, "s", "positive")
        require_finite("cutoff", cutoff, "rad/s", "positive")
        limit = float_vector("torque_limit", torque_limit, model.n_joints, "positive", math.inf)
        strongest = limit[np.isfinite(limit)].max(initial=0.0)
        self._torque_limit = np.where(np.isfinite(limit), limit, strongest or 1.0)
        self._model, self._period = model, period
        self._passed = -np.expm1(-cutoff * period)

    def update(self, before: LeastSquaresSums, q: Array, qd: Array, qdd: Array, tau: Array) -> LeastSquaresSums:
        """The sums after another period.

        Args:
            before: the sums at its beginning.
            q, qd: angles and velocities at its end, ``(batch, n)``.
            qdd: mean accelerations over it, ``(batch, n)``.
            tau: torques that were held, ``(batch, n)``, N m.

        Raises:
            ValueError: if a shape does not fit.
        """
        q, qd, qdd, tau = float_rows(self._model.n_joints, len(before.information), q=q, qd=qd, qdd=qdd, tau=tau)
        half = 0.5 * self._period
        qd_middle = qd - half * qdd
        state = q - half * (qd - 0.5 * half * qdd), qd_middle, qd_middle, qdd
        expected = self._model.torque(*state, np.zeros((len(q), 1)))
        regressor = self._filtered(before.regressor, self._model.regressor(*state)[..., 0])
        residual = self._filtered(before.residual, tau - expected)
        information = before.information + (regressor**2).sum(axis=1)
        correlation = before.correlation + (regressor * residual).sum(axis=1)
        return LeastSquaresSums(regressor, residual, information, correlation)

    def _filtered(self, before: Array, sample: Array) -> Array:
        filtered: Array = before + self._passed * (sample / self._torque_limit - before)
        return filtered
