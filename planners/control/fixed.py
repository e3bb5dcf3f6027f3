"""Controllers that take the payload for known. Their errors are what adapting has to beat."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planners.control.controller import Controller, Sample
from planners.typing import Array


class PDGravity(Controller):
    """PD control with gravity compensation: ``inertia (lambda^2 e + 2 lambda e') + g(q)``."""

    def _wanted(self, sample: Sample) -> Array:
        bandwidth, still = self.settings.bandwidth, np.zeros_like(sample.q)
        feedback = self.settings.inertia * bandwidth * (bandwidth * sample.error + 2.0 * sample.error_rate)
        return feedback + self.model.torque(sample.q, still, still, still, self.parameters)


class ComputedTorque(Controller):
    """Inverse dynamics of the wanted acceleration plus PD: error poles at a double -lambda if the model is right."""

    def _wanted(self, sample: Sample) -> Array:
        return self.model.torque(sample.q, sample.qd, sample.qd, self._acceleration(sample), self.parameters)

    def _acceleration(self, sample: Sample) -> Array:
        """The acceleration that the torques are to give, rad/s^2."""
        bandwidth = self.settings.bandwidth
        feedback: Array = bandwidth * (bandwidth * sample.error + 2.0 * sample.error_rate)
        return sample.qdd_d + feedback


class IntegralComputedTorque(ComputedTorque):
    """Computed torque with an integral of the error, carried on: a triple pole at -lambda if the model is right."""

    def _acceleration(self, sample: Sample) -> Array:
        bandwidth = self.settings.bandwidth
        feedback = 3.0 * (bandwidth * sample.error + sample.error_rate) + bandwidth**2 * self._carried
        return sample.qdd_d + bandwidth * feedback

    def _learn(self, sample: Sample, free: NDArray[np.bool_]) -> None:
        self._carried += self.settings.period * sample.error * free
