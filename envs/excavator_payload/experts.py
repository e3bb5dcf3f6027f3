"""Experts of ExcavatorPayload-v0: controllers that track the given reference with an unknown payload in the bucket."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from envs.excavator_payload.env import ExcavatorPayload
from envs.excavator_payload.estimation import filter_settings
from envs.excavator_payload.kernels import RESIDUAL_SHARE
from envs.experts.base import Expert
from envs.observation import Observation
from planners.control import Controller
from planners.excavator.controllers import ADAPTIVE, DEFAULT, make_controller
from planners.excavator.kalman import KalmanComputedTorque
from planners.typing import Array

KALMAN = "kalman"
"""The controller of :mod:`planners.excavator.kalman`."""


class PayloadExpert(Expert):
    """Tracks the reference; its `state` is the controller's memory, ``(num_envs, p + n)``.

    In the modes with a controller of the environment's own the action is what this controller's torque adds to that.

    Args:
        task: the environment's task.
        controller: of :mod:`planners.excavator.controllers`, or `KALMAN`; some estimate the payload, some assume none.
        moments: whether the payload's first moments are estimated too, or its mass alone.
    """

    def __init__(self, task: ExcavatorPayload, controller: str = DEFAULT, *, moments: bool = True) -> None:
        super().__init__(task)
        self.task: ExcavatorPayload = task
        self._name, self._moments = controller, moments
        self._prepare(1)

    @property
    def mass_estimate(self) -> Array | None:
        """Estimated payloads after the last call, ``(num_envs,)``, kg; None if the controller estimates none."""
        return self._memory[:, 0].copy() if self._memory is not None and self._name in (*ADAPTIVE, KALMAN) else None

    def _is_own(self, state: Any) -> bool:
        """Whether `_act` may have returned a state."""
        return isinstance(state, np.ndarray) and state.shape[1:] == self._controller.memory.shape[1:]

    def _act(self, observations: Observation, state: Array | None, starts: NDArray[np.bool_]) -> tuple[Array, Array]:
        seen = self.task.layout.parse(observations)
        if self._controller.rows != len(observations):
            self._prepare(len(observations))
        if state is None or len(state) != len(observations):
            self._controller.reset()
        else:
            self._controller.memory = state
        self._controller.reset(starts | self._begins(seen))
        q, qd = seen["joint_position"], seen["joint_velocity"]
        reference = q + seen["reference_error"], seen["reference_velocity"], seen["reference_acceleration"]
        if self.task.config.control_mode != "torque":
            known = "estimated_torque" in seen
            base = seen["estimated_torque"] * self._scale if known else self._empty.unlimited_torque(q, qd, *reference)
            actions = self._added(base, q, qd, reference)
        else:
            actions = self._controller.torque(q, qd, *reference) / self._scale
        return actions, self._controller.memory

    def _added(self, base: Array, q: Array, qd: Array, reference: tuple[Array, Array, Array]) -> Array:
        """Actions that add up to the wanted torque with ``base``, the environment's own controller's."""
        room, limit = RESIDUAL_SHARE * self._scale, self._scale
        within = np.clip(base - room, -limit, limit), np.clip(base + room, -limit, limit)
        return (self._controller.torque(q, qd, *reference, within=within) - base) / room

    def _prepare(self, rows: int) -> None:
        """Make the controllers for another number of environments."""
        period = self.task.config.control_period
        self._empty = make_controller("slotine-li", planar=True, rows=rows, period=period)
        self._controller: Controller | KalmanComputedTorque = (
            KalmanComputedTorque(filter_settings(self.task.config, self.task.uncertainty), rows)
            if self._name == KALMAN
            else make_controller(self._name, planar=True, moments=self._moments, rows=rows, period=period)
        )
