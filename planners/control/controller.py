"""Base of the controllers: settings, prior of the payload, memory between samples, and torque limits."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planners.checks import (
    LARGEST,
    checked_count,
    float_array,
    float_rows,
    require_all_finite,
    require_finite,
    require_mask,
)
from planners.control.model import ArmModel
from planners.typing import Array


@dataclass(frozen=True, eq=False)
class ControlSettings:
    """Feedback gains and limits of a controller.

    Attributes:
        period: between two samples, s.
        bandwidth: lambda, the rate at which the error of each joint decays, 1/s, ``(n,)``.
        inertia: of each joint in a typical posture, kg m^2, ``(n,)``: scales the gains of laws without a mass matrix.
        torque_limit: largest absolute torques, N m, ``(n,)``; may be infinite.
    """

    period: float
    bandwidth: Array
    inertia: Array
    torque_limit: Array

    def __post_init__(self) -> None:
        require_finite("period", self.period, "s", "positive")
        for name in ("bandwidth", "inertia", "torque_limit"):
            values = float_array(name, getattr(self, name))
            require_all_finite(name, values, "positive", math.inf if name == "torque_limit" else LARGEST)
            object.__setattr__(self, name, values)


@dataclass(frozen=True, eq=False)
class PayloadPrior:
    """First estimate of a payload's parameters, kept by a fixed controller, and its bounds, each ``(p,)``."""

    initial: Array
    lower: Array
    upper: Array

    def __post_init__(self) -> None:
        for name, values in [*vars(self).items()]:
            object.__setattr__(self, name, float_array(name, values))
        require_all_finite("initial", self.initial)
        shapes = {np.shape(value) for value in vars(self).values()}
        if len(shapes) != 1 or not np.all((self.lower <= self.initial) & (self.initial <= self.upper)):
            raise ValueError(f"initial parameters {self.initial} must lie within {self.lower} and {self.upper}")


@dataclass(frozen=True, eq=False)
class Sample:
    """One sample of the loop, ``(batch, n)`` each: measured state and desired motion (``_d``)."""

    q: Array
    qd: Array
    q_d: Array
    qd_d: Array
    qdd_d: Array

    @cached_property
    def error(self) -> Array:
        """Desired minus measured angle, rad."""
        return self.q_d - self.q

    @cached_property
    def error_rate(self) -> Array:
        """Desired minus measured velocity, rad/s."""
        return self.qd_d - self.qd


class Controller(ABC):
    """A sampled tracking controller of a batch of ``rows`` arms with payloads, over a model of the arm.

    The state that a law carries from sample to sample is `memory`; it can be read and set, so that one controller can
    serve many loops in turn. Settings or a prior that do not fit the model raise ValueError.
    """

    _carried_at_first: ClassVar[float] = 0.0
    """Value carried by a joint before the first sample."""

    def __init__(self, model: ArmModel, settings: ControlSettings, prior: PayloadPrior, rows: int = 1) -> None:
        for name in ("bandwidth", "inertia", "torque_limit"):
            _refuse_shape(name, getattr(settings, name), model.n_joints, "joints")
        _refuse_shape("initial", prior.initial, model.n_parameters, "parameters of the payload")
        self.model, self.settings, self.prior, self.rows = model, settings, prior, checked_count("rows", rows)
        self._memory: Array = np.empty((rows, model.n_parameters + model.n_joints))
        self.reset()

    def reset(self, rows: NDArray[np.bool_] | None = None) -> None:
        """Reset the memory, in the rows of a mask ``(batch,)`` or in all of them."""
        if rows is not None:
            require_mask("rows", rows, self.rows)
        chosen = slice(None) if rows is None else rows
        self.parameters[chosen] = self.prior.initial
        self._carried[chosen] = self._carried_at_first

    @property
    def parameters(self) -> Array:
        """The estimates, ``(batch, p)``: a view of the memory, which a copied controller has of its own."""
        return self._memory[:, : self.model.n_parameters]

    @property
    def _carried(self) -> Array:
        """What each joint carries to the next sample, ``(batch, n)``, a view of the memory."""
        return self._memory[:, self.model.n_parameters :]

    @property
    def memory(self) -> Array:
        """State carried to the next sample, ``(batch, p + n)``: the estimates, then one number a joint (a copy).

        That number is the integral of the error or another quantity that the law needs.
        """
        return self._memory.copy()

    @memory.setter
    def memory(self, memory: Array) -> None:
        if np.shape(memory) != self._memory.shape:
            raise ValueError(f"memory has shape {np.shape(memory)}; this controller's has {self._memory.shape}")
        self._memory[:] = memory

    @property
    def mass_estimate(self) -> Array:
        """Estimated mass of the payload, ``(batch,)``, kg."""
        mass: Array = self.parameters[:, 0]
        return mass

    def torque(
        self, q: Array, qd: Array, q_d: Array, qd_d: Array, qdd_d: Array, *, within: tuple[Array, Array] | None = None
    ) -> Array:
        """Torques to hold for a period, within the limits, N m; updates the memory. All arrays are ``(batch, n)``.

        Args:
            q, qd: measured angles and velocities.
            q_d, qd_d, qdd_d: desired angles, velocities and accelerations.
            within: least and largest torques available at this sample, N m; the settings' limits when left out.

        Raises:
            ValueError: if a shape does not fit, or a least torque is above the largest.
        """
        sample = self._sample(q, qd, q_d, qd_d, qdd_d)
        limit = self.settings.torque_limit
        lower, upper = (-limit, limit) if within is None else within
        if not np.all(np.asarray(lower) <= np.asarray(upper)):
            raise ValueError(f"within {within!r:.200} must be the least torques and then the largest, N m")
        unlimited = self._law(sample)
        tau: Array = np.clip(unlimited, lower, upper)
        self._update(sample, free=tau == unlimited)
        return tau

    def unlimited_torque(self, q: Array, qd: Array, q_d: Array, qd_d: Array, qdd_d: Array) -> Array:
        """Torques of the law without limits, see `torque`; the memory stays as it is."""
        return self._law(self._sample(q, qd, q_d, qd_d, qdd_d))

    def _sample(self, q: Array, qd: Array, q_d: Array, qd_d: Array, qdd_d: Array) -> Sample:
        n = self.model.n_joints
        return Sample(*float_rows(n, self.rows, q=q, qd=qd, q_d=q_d, qd_d=qd_d, qdd_d=qdd_d))

    @abstractmethod
    def _law(self, sample: Sample) -> Array:
        """The torques of the law, without limits."""

    def _update(self, sample: Sample, free: NDArray[np.bool_]) -> None:  # noqa: B027
        """Update the memory by the joints within their torque limits, ``free``; the others' error is the limit's."""


def _refuse_shape(name: str, values: ArrayLike, count: int, what: str) -> None:
    if np.shape(values) != (count,):
        raise ValueError(f"{name} has shape {np.shape(values)}; the model has {count} {what}, give ({count},)")
