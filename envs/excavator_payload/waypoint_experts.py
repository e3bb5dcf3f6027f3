"""Experts that choose their own way from waypoint to waypoint, where the load is one that nobody has weighed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from envs.excavator_payload.controllers import PayloadExpert, Reference, given_reference
from envs.excavator_payload.env import ExcavatorPayload
from envs.excavator_payload.reference import QUINTIC_PEAK
from envs.experts.base import Planner
from envs.observation import Observation
from planners import FixedJoints, MotionProblem, Trajectory, lagrange
from planners.apf.joint_field import reach
from planners.typing import Array

SPEED_SHARE = 0.95
"""Of the speed limits, used by plans; what is left is for tracking."""

LEAST_SPEED = 0.05
"""That every joint may have, however small its part in a move, rad/s."""


@dataclass(frozen=True)
class _Plans:
    """Each environment's plan to the next waypoint, sampled at the control periods.

    Attributes:
        q, qd: ``(num_envs, samples, n)``.
        last: last sample that is planned, ``(num_envs,)``; -1 where the environment's reference is followed.
        now: sample of the next observation, ``(num_envs,)``.
        due: when the waypoint was due at the last observation, ``(num_envs,)``, s.
    """

    q: Array
    qd: Array
    last: NDArray[np.int64]
    now: NDArray[np.int64]
    due: Array


class PlannedWayExpert(PayloadExpert):
    """Plans its own way from each waypoint to the next, at rest in each, and tracks it with the adaptive controller.

    Where the planner has no solution the environment's reference is followed to the next waypoint; `infeasible` counts
    how often.

    Args:
        task: the environment's task.
        planner: makes the plans.
    """

    def __init__(self, task: ExcavatorPayload, planner: Planner) -> None:
        super().__init__(task)
        self._planner = planner

    def _reference(
        self, observations: Observation, seen: dict[str, Array], way: _Plans | None, begins: NDArray[np.bool_]
    ) -> tuple[Reference, _Plans]:
        due = seen["waypoint_time"][:, 0]
        plans = way or self._none_yet(len(observations))
        anew = begins | (due > plans.due)
        if anew.any():
            plans = self._replanned(observations, seen, plans, anew)
        batch = np.arange(len(observations))
        here, next_ = (np.clip(plans.now + step, 0, np.maximum(plans.last, 0)) for step in (0, 1))
        qd = plans.qd[batch, here]
        qdd = (plans.qd[batch, next_] - qd) / self.task.config.control_period
        own, follows = (plans.q[batch, here], qd, qdd), (plans.last < 0)[:, None]
        reference = tuple(np.where(follows, g, o) for g, o in zip(given_reference(seen), own, strict=True))
        return cast(Reference, reference), replace(plans, now=plans.now + 1, due=due)

    def _none_yet(self, batch: int) -> _Plans:
        samples = np.zeros((batch, self.task.horizon_steps + 1, self.task.arm.n_joints))
        zero = np.zeros(batch, dtype=np.int64)
        return _Plans(samples, samples, zero - 1, zero, np.full(batch, np.inf))

    def _replanned(
        self, observations: Observation, seen: dict[str, Array], old: _Plans, anew: NDArray[np.bool_]
    ) -> _Plans:
        new = replace(
            old, q=old.q.copy(), qd=old.qd.copy(), last=np.where(anew, -1, old.last), now=np.where(anew, 0, old.now)
        )
        period, (start, _, _) = self.task.config.control_period, given_reference(seen)
        for env_index in np.flatnonzero(anew):
            plan = self._plan(
                self._planner, _from_rest(self.task.motion_problem(observations[env_index]), start[env_index])
            )
            if plan is not None:
                last = min(int(np.ceil(plan.duration / period - 1e-9)), self.task.horizon_steps)
                new.q[env_index, : last + 1], new.qd[env_index, : last + 1], _ = plan.at(period * np.arange(last + 1))
                new.last[env_index] = last
        return new


class FieldWayExpert(PayloadExpert):
    """Goes from waypoint to waypoint as a field in joint space pulls; see `planners.apf.joint_field`.

    The field pulls an arm that is only imagined, undisturbed and with a typical load; the adaptive controller makes
    the real one follow.
    """

    def __init__(self, task: ExcavatorPayload) -> None:
        super().__init__(task)
        problem = task.motion_problem(np.zeros(task.layout.size, dtype=np.float32))
        self._imagined = replace(problem.arm, limits=problem.joint_limits)

    def _reference(
        self,
        observations: Observation,
        seen: dict[str, Array],
        way: tuple[Array, Array] | None,
        begins: NDArray[np.bool_],
    ) -> tuple[Reference, tuple[Array, Array]]:
        q, qd, _ = given_reference(seen)
        if way is not None:
            anew = begins[:, None]
            q, qd = (np.where(anew, one, own) for one, own in zip((q, qd), way, strict=True))
        period = self.task.config.control_period
        qdd = reach(self._imagined, q, qd, seen["waypoint"], seen["waypoint_time"][:, 0], period)
        return (q, qd, qdd), (q + period * (qd + 0.5 * period * qdd), qd + period * qdd)


def _from_rest(problem: MotionProblem, start: Array) -> MotionProblem:
    """The problem for plans that begin where the last one ended: in a waypoint, at rest, whatever is measured."""
    still, limits = np.zeros_like(start), problem.joint_limits
    limits = replace(limits, velocity=tuple(SPEED_SHARE * speed for speed in limits.velocity))
    return replace(problem, q=start, qd=still, qdd=still, limits=limits)


def unhurried(problem: MotionProblem) -> Trajectory:
    """Lagrange: least torque with no joint faster than its quintic would be.

    Left free, the arm saves torque by hanging down on the way, far outside the ranges of the waypoints. They are not
    symmetric about zero and so are no joint limits; but a joint that moves no faster than this cannot stray far.
    """
    target = cast(FixedJoints, problem.target)
    speed = QUINTIC_PEAK * np.abs(target.q - problem.q) / problem.horizon + LEAST_SPEED
    velocity = tuple(np.minimum(speed, problem.joint_limits.velocity).tolist())
    return lagrange.plan(replace(problem, limits=replace(problem.joint_limits, velocity=velocity)), explain=False)
