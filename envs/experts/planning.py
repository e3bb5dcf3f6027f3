"""An expert that plans a motion and tracks it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from envs.experts.base import Expert, Planner
from envs.experts.continuity import Moment
from envs.experts.payload_estimation import AdaptiveState
from envs.experts.robust import RobustState, careful, slower
from envs.observation import Observation
from envs.task import Task
from planners import JointLimits, MotionProblem
from planners.control import Gains, tracking_acceleration
from planners.typing import Array

PAYLOAD_TOLERANCE = 0.01
"""Replan when the payload estimate differs by more from the one planned for, kg."""

SOONEST = 4
"""Control periods after which a plan to a target seen with noise is made anew for the first time; then at 8, 16, ..."""

CALM = 0.02
"""Least period of the tracking controller's gains where jerk is limited, s: a shorter one makes jerk of rounding."""

REST = 1e-3
"""Joint velocity up to which a plan ends at rest, rad/s."""


class PlanningExpert(Expert):
    """Plans at the start of an episode, and periodically if asked to; tracks the plan by computed torque.

    An environment is replanned where its observation does not continue the last episode, and where the payload
    estimate has changed. A plan to a moving target that is seen with noise goes on with better and better estimates of
    it: from the planned state of 4, 8, 16, ... periods after the start, up to half of the episode.
    Without a plan (the problem has no solution), and past its end, the arm brakes within limits. Under declared latency
    it goes on as the plan ends for the periods after which a command may be late.
    The `state` is a record of each environment's plan, and the `Moment` of the last observation.

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
        smooth = np.isfinite(task.arm.limits.array("jerk")).any()
        self._gains = gains or Gains.sampled(max(CALM if smooth else 0.0, task.config.control_period))
        samples = task.horizon_steps + 1, task.arm.n_joints
        self._plan_type = np.dtype(
            [
                ("q", "f8", samples),  # the plan at the control periods
                ("qd", "f8", samples),
                ("last", "i8"),  # index of the last planned sample, 0 without a plan
                ("begun", "i8"),  # control periods left when the plan was made
                ("origin", "f4", task.layout.size),  # the observation that it was made from
                ("payload", "f8"),  # the payload it was made for, kg
                ("late", "f8"),  # the latency it was made for, s
            ]
        )

    def planned(self, env_index: int = 0) -> Array | None:
        """Joint angles that are planned from the last observation on, ``(periods, n)``, rad; None without a plan."""
        memory = self._memory.expert if isinstance(self._memory, AdaptiveState | RobustState) else self._memory
        if memory is None:
            return None
        plan, left = memory[0][env_index], int(memory[1].left[env_index])
        ahead: Array = plan["q"][max(0, int(plan["begun"]) - left) : int(plan["last"]) + 1]
        return ahead.copy() if plan["last"] > 0 and len(ahead) else None

    def _is_own(self, state: Any) -> bool:
        """Whether `_act` may have returned a state."""
        if not (isinstance(state, tuple) and len(state) == 2 and isinstance(state[1], Moment)):
            return False
        return getattr(state[0], "dtype", None) == self._plan_type

    def _act(self, observations: Observation, state: Any, starts: NDArray[np.bool_]) -> tuple[Array, Any]:
        seen = self.task.layout.parse(observations)
        now = Moment.of(self.task, seen)
        left = now.left
        if state is None or len(state[0]) != len(observations):
            state = np.zeros(len(observations), self._plan_type), now
        plans, before = state
        due = starts | (before.left - left != 1)
        if self._robust is None:  # which has compared the joints as they are observed
            due |= ~now.continues(before, self.task)
        if self._replan_every is not None:
            due |= plans["begun"] - left >= self._replan_every
        wanted = np.ones_like(due) if self.idle is None else ~self.idle
        due &= wanted
        if due.any():
            plans = plans.copy()
            plans["last"][due], plans["begun"][due], plans["origin"][due] = 0, left[due], observations[due]
            self._replan(plans, observations, left, due)
        outdated = wanted & (np.abs(self._payload - plans["payload"]) > PAYLOAD_TOLERANCE)
        if outdated.any():
            origin, begun, plans = plans["origin"], plans["begun"], plans.copy()
            failed = outdated & ~self._replan(plans, observations, left, outdated)
            # Not every planner starts from a moving arm; in the first periods the old start is close enough.
            self._replan(plans, origin, begun, failed)
        if self._robust is not None and self._robust.chases:
            elapsed = self.task.horizon_steps - left
            known_better = wanted & ~due & (plans["begun"] - left < plans["last"])
            known_better &= (elapsed >= SOONEST) & (elapsed & (elapsed - 1) == 0) & (2 * elapsed < left + elapsed)
            if known_better.any():
                plans = plans.copy()
                self._replan(plans, observations, left, known_better, joined=True)
        sample = np.maximum(0, plans["begun"] - left)
        wanted_now, ahead = self._planned_at(plans, sample), self._planned_at(plans, sample + 1)
        qdd = tracking_acceleration(
            seen["joint_position"],
            seen["joint_velocity"],
            wanted_now,
            ahead,
            self.task.config.control_period,
            self._gains,
        )
        braking = sample >= plans["last"]
        if (
            self._robust is not None
        ):  # a plan that ends at rest is held; one to a part goes on while commands may be late
            over = sample >= plans["last"] + self._robust.waiting
            braking &= (plans["last"] == 0) | over & (np.abs(wanted_now[1]).max(axis=1) > REST)
        if braking.any():
            qdd = np.where(braking[:, None], self._braking(seen), qdd)
        return self._action_for(seen, qdd), (plans, now)

    def _planned_at(self, plans: NDArray[Any], sample: NDArray[np.int64]) -> tuple[Array, Array]:
        """Angles and velocities of the plans, ``(num_envs, n)`` each, when the next commands arrive.

        The estimated latency may have changed since a plan was made: between two samples the acceleration is constant.
        After its end a plan keeps its velocity.
        """
        rows, period = np.arange(len(plans)), self.task.config.control_period
        if self._estimate is None:
            place = np.minimum(sample, plans["last"])
            return plans["q"][rows, place], plans["qd"][rows, place]
        rests = np.abs(plans["qd"][rows, plans["last"]]).max(axis=1) <= REST
        later = np.where(rests, 0.0, self._estimate.late - plans["late"])
        exact = np.maximum(0.0, sample + later / period)
        beyond = np.maximum(0.0, exact - plans["last"])[:, None]
        exact = np.minimum(exact, plans["last"])
        place = np.minimum(exact.astype(np.int64), np.maximum(0, plans["last"] - 1))
        after, share = np.minimum(place + 1, plans["last"]), (exact - place)[:, None]
        rise = plans["qd"][rows, after] - plans["qd"][rows, place]
        qd = (1.0 - share) * plans["qd"][rows, place] + share * plans["qd"][rows, after]
        q = (1.0 - share) * plans["q"][rows, place] + share * plans["q"][rows, after]
        return q - 0.5 * period * share * (1.0 - share) * rise + period * beyond * qd, qd

    def _replan(
        self,
        plans: NDArray[Any],
        observations: Observation,
        left: NDArray[np.int64],
        due: NDArray[np.bool_],
        *,
        joined: bool = False,
    ) -> NDArray[np.bool_]:
        """Replace plans in place, from observations with so many periods left, and say which have been replaced.

        With ``joined`` a plan starts in the state in which the one before it is.
        """
        planned = np.zeros_like(due)
        period = self.task.config.control_period
        plans["payload"][due] = self._payload[due]
        if joined:
            sample = plans["begun"] - left
            (_, before), (q, qd), (_, after) = (self._planned_at(plans, sample + step) for step in (-1, 0, 1))
            qdd = (after - before) / (2.0 * period)
        for row in np.flatnonzero(due):
            problem = self.task.motion_problem(observations[row])
            if joined:
                problem = replace(problem, q=q[row], qd=qd[row], qdd=qdd[row])
            problem = replace(problem, payload=float(self._payload[row]))
            room = self._limits_with_room(problem)
            plan = None if room is None else self._plan(self._planner, replace(problem, limits=room))
            if plan is None:
                plan = self._plan(self._planner, problem)
            if plan is None and self._estimate is not None:  # the arm may fall until the first command arrives
                plan = self._plan(self._planner, replace(problem, qdd=np.zeros_like(problem.q)))
            if plan is not None:
                last = min(int(plan.duration / period + 1e-3), self.task.horizon_steps)
                plans["q"][row, : last + 1], plans["qd"][row, : last + 1], _ = plan.at(period * np.arange(last + 1))
                plans["late"][row] = 0.0 if self._estimate is None else self._estimate.late[row]
                plans["last"][row], plans["begun"][row], plans["origin"][row] = last, left[row], observations[row]
                planned[row] = True
        return planned

    def _limits_with_room(self, problem: MotionProblem) -> JointLimits | None:
        """Limits of a plan with room to correct: of one that is kept, for an unknown payload, or for commands that the
        environment makes fit by less torque. None for no room.
        """
        if self._replan_every is not None:
            return None
        if self._robust is not None:
            return self._robust.careful(problem.joint_limits)
        adaptation = self._adaptation
        if adaptation is not None and adaptation.declared and problem.payload == adaptation.expected:
            return careful(problem.joint_limits)
        if self.task.config.control_mode != "velocity":
            return None
        return slower(problem.joint_limits)

    def _braking(self, seen: dict[str, Array]) -> Array:
        """Accelerations that bring the joints to rest within the limits."""
        arm, period = self.task.arm, self.task.config.control_period
        acceleration, jerk = np.array(arm.limits.acceleration), np.array(arm.limits.jerk)
        qd = seen["joint_velocity"]
        qdd = seen.get("joint_acceleration", np.zeros_like(qd))  # not every task shows it
        # At full jerk, speed v can be braked to rest from an acceleration of at most sqrt(2 jerk v).
        limited = np.isfinite(jerk)
        smooth = np.where(limited, np.sqrt(2.0 * np.where(limited, jerk, 0.0) * np.abs(qd)), np.inf)
        gentle = np.minimum(np.minimum(np.abs(qd) / period, acceleration), smooth)
        reachable = np.clip(-np.sign(qd) * gentle, qdd - jerk * period, qdd + jerk * period)
        # Last, because a joint whose torque saturates would drive the others on.
        return self._within_torque(seen, reachable)
