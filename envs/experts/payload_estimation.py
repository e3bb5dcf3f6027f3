"""Online estimation of an unknown payload by experts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from envs.experts.continuity import Moment
from envs.observation import Observation
from envs.task import Task
from planners import Arm
from planners.control import LeastSquaresSums, PayloadEstimator, PlanarArmModel
from planners.typing import Array

_NEEDED = ("joint_position", "joint_velocity", "joint_acceleration", "time_left")
_GRAMS = 3


@dataclass(frozen=True)
class AdaptiveState:
    """The `state` of an expert that adapts.

    Attributes:
        expert: the state of the expert itself.
        sums: least-squares sums of the payload estimate.
        tau: torques of the last action, ``(num_envs, n)``, N m.
        moment: of the last observation.
    """

    expert: Any
    sums: LeastSquaresSums
    tau: Array
    moment: Moment

    @property
    def mass_estimate(self) -> Array:
        """Estimated payloads, ``(num_envs,)``, kg, rounded to grams so that environments can share an arm."""
        return np.round(self.sums.mass, _GRAMS)

    def after(self, tau: Array, expert: Any) -> AdaptiveState:
        """The state after an action with torques ``(num_envs, n)``, N m, and the expert's own new state."""
        return replace(self, expert=expert, tau=tau)


class PayloadAdaptation:
    """Adaptive computed torque around an expert.

    Every observation holds the mean acceleration under the torques of the last action, from which `PayloadEstimator`
    estimates the mass on the hand. Plans, limits and computed torque are those of the arm with that mass. An episode
    begins without payload, or with the lightest one of the range that the settings declare, whose torques are too hard
    for none of them.

    Args:
        task: the environment's task.

    Attributes:
        declared: whether the settings declare a range of payloads.
        expected: the payload with which an episode begins, kg.

    Raises:
        ValueError: if actions are not torques, or observations do not show their effect.
    """

    def __init__(self, task: Task) -> None:
        mode = task.config.control_mode
        if mode != "torque":
            raise ValueError(
                f"the adaptive law learns from the torques of its own actions, but {task.env_id} makes them from "
                f'actions of control_mode "{mode}", for an arm without payload; use control_mode "torque"'
            )
        missing = set(_NEEDED) - {entry.name for entry in task.layout.entries}
        if missing:
            raise ValueError(
                f"the adaptive law needs {', '.join(sorted(missing))}, not in the observation of {task.env_id}; "
                "make the expert without it"
            )
        payload = task.config.payload
        self._task, self.declared = task, isinstance(payload, tuple)
        self.expected = round(payload[0], _GRAMS) if isinstance(payload, tuple) else 0.0
        period, limit = task.config.control_period, np.array(task.arm.limits.torque)
        self._estimator = PayloadEstimator(PlanarArmModel(task.arm), limit, period)

    @staticmethod
    def wanted(task: Task) -> bool:
        """Whether an unknown payload is all the uncertainty that the settings declare, and this can estimate it."""
        entries, config = {entry.name for entry in task.layout.entries}, task.config
        if config.control_mode != "torque" or not entries >= set(_NEEDED):
            return False
        others = [max(ends) for name, ends in task.uncertainty.ends.items() if name != "payload"]
        return isinstance(config.payload, tuple) and not any(others) and not any(task.uncertainty.mass_error)

    def update(
        self, observations: Observation, before: AdaptiveState | None, starts: NDArray[np.bool_]
    ) -> AdaptiveState:
        """The estimate with new observations.

        Args:
            observations: ``(num_envs, size)``.
            before: the state after the last action, if any.
            starts: environments in which an episode begins, ``(num_envs,)``; one begins too where an observation does
                not continue the last episode.
        """
        seen = self._task.layout.parse(observations)
        now = Moment.of(self._task, seen)
        batch, n = seen["joint_position"].shape
        if before is None or len(before.tau) != batch:
            return AdaptiveState(None, LeastSquaresSums.before(batch, n, self.expected), np.zeros((batch, n)), now)
        state = seen["joint_position"], seen["joint_velocity"], seen["joint_acceleration"]
        sums = self._estimator.update(before.sums, *state, before.tau)
        goes_on = now.continues(before.moment, self._task)
        sums = sums.restarted(starts | ~goes_on, self.expected)
        return AdaptiveState(before.expert, sums, before.tau, now)


def loaded_arms(arm: Arm, payload: Array) -> Iterator[tuple[Arm, slice | NDArray[np.int64]]]:
    """The different arms among payloads ``(num_envs,)``, kg, each with its rows of the batch."""
    if np.all(payload == payload[0]):
        yield _loaded(arm, float(payload[0])), slice(None)
        return
    masses, which = np.unique(payload, return_inverse=True)
    for index, mass in enumerate(masses.tolist()):
        yield _loaded(arm, mass), np.flatnonzero(which == index)


@lru_cache(maxsize=4096)
def _loaded(arm: Arm, mass: float) -> Arm:
    return arm.with_payload(mass)
