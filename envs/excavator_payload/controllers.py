"""Experts with a load that nobody has weighed: they track a motion with a controller that may learn the load."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self, cast

import numpy as np
from numpy.typing import NDArray

from envs.excavator_payload.env import ExcavatorPayload
from envs.excavator_payload.kernels import RESIDUAL_SHARE
from envs.experts.base import Expert
from envs.observation import Observation
from planners.excavator.controllers import ADAPTIVE, DEFAULT, make_controller
from planners.typing import Array

Reference = tuple[Array, Array, Array]
"""Wanted angles, velocities and accelerations, ``(num_envs, n)`` each."""


@dataclass(frozen=True)
class PayloadState:
    """What an expert remembers from step to step.

    Attributes:
        control: memory of the controller, ``(num_envs, p + n)``: see `planners.control.Controller.memory`.
        way: of the way to the next waypoint, if the expert chooses its own.
    """

    control: Array
    way: Any = None

    @property
    def mass_estimate(self) -> Array:
        """What the load is taken to weigh, ``(num_envs,)``, kg."""
        return self.control[:, 0].copy()


class PayloadExpert(Expert):
    """Tracks the reference of the environment; subclasses choose their own way between its waypoints.

    In residual mode the law underneath pulls to the reference: away from it, a residual may not be strong enough.

    Args:
        task: the environment's task.
        controller: of :mod:`planners.excavator.controllers`; some learn the load, some take the bucket for empty.
        moments: whether it learns the first moments of the load, too, not the mass alone.
    """

    def __init__(self, task: ExcavatorPayload, controller: str = DEFAULT, *, moments: bool = True) -> None:
        super().__init__(task)
        self.task: ExcavatorPayload = task
        self._name, self._moments = controller, moments
        self._prepare(1)

    @property
    def mass_estimate(self) -> Array | None:
        """What it takes the loads to weigh after the last call, ``(num_envs,)``, kg; None if it does not weigh them."""
        known = cast(PayloadState | None, self._memory)
        return known.mass_estimate if known is not None and self._name in ADAPTIVE else None

    def adapt(self) -> Self:
        """Nothing is left to do: that is its controller's business.

        Raises:
            ValueError: if it has a controller that takes the bucket for empty.
        """
        if self._name not in ADAPTIVE:
            raise ValueError(f'the controller "{self._name}" takes the bucket for empty; the expert "adaptive" learns')
        return self

    def _act(self, observations: Observation, state: Any, starts: NDArray[np.bool_]) -> tuple[Array, PayloadState]:
        seen = self.task.layout.parse(observations)
        begins = starts | self._begins(seen)
        known = cast(PayloadState | None, state)
        if self._controller.rows != len(observations):
            self._prepare(len(observations))
        if known is None or len(known.control) != len(observations):
            self._controller.reset()
            known = PayloadState(self._controller.memory)
        self._controller.memory = known.control
        self._controller.reset(begins)
        reference, way = self._reference(observations, seen, known.way, begins)
        if self.task.config.control_mode == "residual":
            actions = self._residual(seen, reference)
        else:
            actions = self._controller.torque(seen["joint_position"], seen["joint_velocity"], *reference) / self._scale
        return actions, PayloadState(self._controller.memory, way)

    def _reference(
        self, observations: Observation, seen: dict[str, Array], way: Any, begins: NDArray[np.bool_]
    ) -> tuple[Reference, Any]:
        """The motion to track at this step, and what is to be remembered of the way; None if nothing is yet."""
        return given_reference(seen), None

    def _residual(self, seen: dict[str, Array], reference: Reference) -> Array:
        """Actions to be added to Slotine and Li's law for an empty bucket, which tracks the environment's reference."""
        q, qd = seen["joint_position"], seen["joint_velocity"]
        added_to = self._empty.wanted_torque(q, qd, *given_reference(seen))
        room, limit = RESIDUAL_SHARE * self._scale, self._scale
        within = np.clip(added_to - room, -limit, limit), np.clip(added_to + room, -limit, limit)
        return (self._controller.torque(q, qd, *reference, within=within) - added_to) / room

    def _prepare(self, rows: int) -> None:
        """Make the controllers for another number of environments."""
        period = self.task.config.control_period
        self._controller = make_controller(self._name, planar=True, moments=self._moments, rows=rows, period=period)
        self._empty = make_controller("slotine-li", planar=True, rows=rows, period=period)


def given_reference(seen: dict[str, Array]) -> Reference:
    """The environment's own reference, of parsed observations."""
    q = seen["joint_position"] + seen["reference_error"]
    return q, seen["reference_velocity"], seen["reference_acceleration"]
