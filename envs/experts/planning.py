"""An expert that plans a motion and tracks it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from envs.experts.base import Expert, Planner
from envs.observation import Observation
from envs.task import Task
from planners.control import Gains, tracking_acceleration
from planners.typing import Array

PAYLOAD_TOLERANCE = 0.01
"""Replan when the payload estimate differs by more from the one planned for, kg."""


@dataclass(frozen=True)
class _Tracking:
    """The `state` of a planning expert: each environment's plan and its progress.

    Attributes:
        q, qd: plans sampled at the control periods, ``(num_envs, samples, n)``.
        begun: control periods left when the plan was made, ``(num_envs,)``.
        last: index of the last planned sample, ``(num_envs,)``; 0 where there is no plan.
        posed: observations the plans were made from, ``(num_envs, size)``.
        payload: payload estimates they were made for, ``(num_envs,)``, kg.
        due: control periods left at the next observation, ``(num_envs,)``.
    """

    q: Array
    qd: Array
    begun: NDArray[np.int64]
    last: NDArray[np.int64]
    posed: Observation
    payload: Array
    due: NDArray[np.int64]


class PlanningExpert(Expert):
    """Plans at the start of an episode, and periodically if asked to; tracks the plan by computed torque.

    An environment is replanned where its observation does not continue the last episode, and where the payload
    estimate has changed. Without a plan (the problem has no solution), and past its end, the arm brakes within limits.

    Args:
        task: the environment's task.
        planner: makes the plans.
        replan_every: control periods between two plans; None to keep one to the end.
        gains: of the tracking controller.
    """

    def __init__(
        self, task: Task, planner: Planner, replan_every: int | None = None, gains: Gains | None = None
    ) -> None:
        super().__init__(task)
        self._planner = planner
        self._replan_every = replan_every
        self._gains = gains or Gains.sampled(task.config.control_period)

    def _act(self, observations: Observation, state: Any, starts: NDArray[np.bool_]) -> tuple[Array, _Tracking]:
        seen = self.task.layout.parse(observations)
        left = np.rint(seen["time_left"][:, 0] / self.task.config.control_period).astype(np.int64)
        tracking = cast(_Tracking | None, state)
        if tracking is None or len(tracking.due) != len(observations):
            tracking = self._nothing(len(observations))
        anew = starts | (tracking.due != left)
        if self._replan_every is not None:
            anew |= tracking.begun - left >= self._replan_every
        if anew.any():
            tracking, _ = self._replanned(_forgotten(tracking, observations, left, anew), observations, left, anew)
        misjudged = np.abs(self._payload - tracking.payload) > PAYLOAD_TOLERANCE
        if misjudged.any():
            posed, begun = tracking.posed, tracking.begun
            tracking, planned = self._replanned(tracking, observations, left, misjudged)
            # Not every planner starts from a moving arm; in the first periods the old start is close enough.
            again = misjudged & ~planned
            if again.any():
                tracking, _ = self._replanned(tracking, posed, begun, again)
        batch, sample = np.arange(len(observations)), tracking.begun - left
        now, ahead = np.minimum(sample, tracking.last), np.minimum(sample + 1, tracking.last)
        qdd = tracking_acceleration(
            seen["joint_position"],
            seen["joint_velocity"],
            (tracking.q[batch, now], tracking.qd[batch, now]),
            (tracking.q[batch, ahead], tracking.qd[batch, ahead]),
            self.task.config.control_period,
            self._gains,
        )
        braking = sample >= tracking.last
        if braking.any():
            qdd = np.where(braking[:, None], self._braking(seen), qdd)
        return self._action_for(seen, qdd), replace(tracking, due=left - 1)

    def _nothing(self, num_envs: int) -> _Tracking:
        samples = (num_envs, self.task.horizon_steps + 1, self.task.arm.n_joints)
        zero = np.zeros(num_envs, dtype=np.int64)
        posed = np.zeros((num_envs, self.task.layout.size), dtype=np.float32)
        return _Tracking(np.zeros(samples), np.zeros(samples), zero, zero, posed, np.zeros(num_envs), zero - 1)

    def _replanned(
        self, old: _Tracking, observations: Observation, left: NDArray[np.int64], anew: NDArray[np.bool_]
    ) -> tuple[_Tracking, NDArray[np.bool_]]:
        """Replan environments ``anew`` from observations with so many periods left.

        Returns the new state, and which environments have a new plan; the others keep theirs.
        """
        new = replace(
            old,
            q=old.q.copy(),
            qd=old.qd.copy(),
            begun=old.begun.copy(),
            last=old.last.copy(),
            posed=old.posed.copy(),
            payload=np.where(anew, self._payload, old.payload),
        )
        planned = np.zeros_like(anew)
        period = self.task.config.control_period
        for env_index in np.flatnonzero(anew):
            problem = self.task.motion_problem(observations[env_index])
            plan = self._plan(self._planner, replace(problem, payload=float(self._payload[env_index])))
            if plan is not None:
                last = min(int(plan.duration / period + 1e-3), self.task.horizon_steps)
                new.q[env_index, : last + 1], new.qd[env_index, : last + 1], _ = plan.at(period * np.arange(last + 1))
                new.begun[env_index], new.last[env_index], new.posed[env_index] = (
                    left[env_index],
                    last,
                    observations[env_index],
                )
                planned[env_index] = True
        return new, planned

    def _braking(self, seen: dict[str, Array]) -> Array:
        """Accelerations that bring the joints to rest within the limits."""
        arm, period = self.task.arm, self.task.config.control_period
        acceleration, jerk = np.array(arm.limits.acceleration), np.array(arm.limits.jerk)
        qd, qdd = seen["joint_velocity"], seen["joint_acceleration"]
        # At full jerk, speed v can be braked to rest from an acceleration of at most sqrt(2 jerk v).
        limited = np.isfinite(jerk)
        smooth = np.where(limited, np.sqrt(2.0 * np.where(limited, jerk, 0.0) * np.abs(qd)), np.inf)
        gentle = np.minimum(np.minimum(np.abs(qd) / period, acceleration), smooth)
        wanted = self._within_torque(seen, -np.sign(qd) * gentle)
        reachable: Array = np.clip(wanted, qdd - jerk * period, qdd + jerk * period)
        return reachable


def _forgotten(
    old: _Tracking, observations: Observation, left: NDArray[np.int64], batch: NDArray[np.bool_]
) -> _Tracking:
    """The same without the plans of some environments, which start from these observations."""
    return replace(
        old,
        begun=np.where(batch, left, old.begun),
        last=np.where(batch, 0, old.last),
        posed=np.where(batch[:, None], observations, old.posed),
    )
