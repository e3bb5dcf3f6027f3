"""Scripted experts: a planner and a tracking controller behind the `predict` of a Stable-Baselines3 policy.

An expert sees what an agent sees, the observation, and gives what an agent gives, an action in the environment's
control mode. What it must remember between steps travels in the `state` that `predict` takes and returns; without
one an expert goes on from its own last call.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, cast

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from envs.actuation import action_scale
from envs.min_torque_move import MinTorqueMove
from envs.observation import Observation
from envs.obstacle_dodge import ObstacleDodge
from envs.settings import refuse_unknown
from envs.task import Task
from planners import Infeasible, MotionProblem, Trajectory, dpct, lagrange, quintic, trapezoid
from planners.control import Gains, held_torque, tracking_acceleration, within_torque
from planners.typing import Array

Actions = NDArray[np.float32]
Planner = Callable[[MotionProblem], Trajectory]


class Expert(ABC):
    """A policy that is not learnt.

    Attributes:
        plans_made: number of motions planned so far.
        planning_seconds: time they took.
        infeasible: how many of them had no solution.
    """

    def __init__(self, task: Task) -> None:
        self.task = task
        self.plans_made = 0
        self.planning_seconds = 0.0
        self.infeasible = 0
        self._memory: Any = None
        self._scale = action_scale(task.arm, task.config.control_mode)

    def predict(
        self,
        observation: Observation,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = False,
    ) -> tuple[Actions, Any]:
        """Actions for observations.

        Args:
            observation: ``(size,)`` or ``(lanes, size)``.
            state: what the last call returned; None to go on from this expert's own last call.
            episode_start: ``(lanes,)``, which lanes are at the first step of an episode; may be left out, because the
                observation tells the time.
            deterministic: accepted for compatibility; experts are deterministic unless their name says otherwise.

        Returns:
            Actions in [-1, 1], ``(n,)`` or ``(lanes, n)``, and the state for the next call.

        Raises:
            ValueError: if the observation has the wrong size.
        """
        batch = np.atleast_2d(observation)
        starts = np.zeros(len(batch), dtype=bool)
        if episode_start is not None:
            starts |= np.asarray(episode_start, dtype=bool)
        actions, self._memory = self._act(batch, self._memory if state is None else state, starts)
        clipped: Actions = np.clip(actions, -1.0, 1.0).astype(np.float32)
        return (clipped[0] if np.ndim(observation) == 1 else clipped), self._memory

    @abstractmethod
    def _act(self, observations: Observation, state: Any, starts: NDArray[np.bool_]) -> tuple[Array, Any]:
        """Unclipped actions ``(lanes, n)`` and the next state."""

    def _action_for(self, seen: dict[str, Array], qdd: Array) -> Array:
        """The action, in the environment's control mode, that gives mean joint accelerations ``(lanes, n)``."""
        config = self.task.config
        if config.control_mode == "acceleration":
            wanted = qdd
        elif config.control_mode == "jerk":
            wanted = (qdd - seen["joint_acceleration"]) / config.control_period
        else:
            q, qd = seen["joint_position"], seen["joint_velocity"]
            wanted = held_torque(self.task.arm, q, qd, qdd, config.control_period)
        return wanted / self._scale


@dataclass(frozen=True)
class _Tracking:
    """What a planning expert remembers: each lane's sampled plan, and how far along it is.

    Attributes:
        q, qd: plans sampled at the control periods, ``(lanes, samples, n)``.
        begun: control periods that were left when the plan was made, ``(lanes,)``.
        last: last sample that is planned, ``(lanes,)``; 0 where there is no plan.
        due: control periods that the next observation should leave, ``(lanes,)``.
    """

    q: Array
    qd: Array
    begun: NDArray[np.int64]
    last: NDArray[np.int64]
    due: NDArray[np.int64]


class PlanningExpert(Expert):
    """Plans once at the start of an episode and tracks the plan by computed torque.

    Where an observation does not continue the remembered episode, the lane is planned anew from there. A lane without
    a plan (the problem has no solution), or past the end of its plan, brakes within its limits.
    """

    def __init__(self, task: Task, planner: Planner, gains: Gains | None = None) -> None:
        super().__init__(task)
        self._planner = planner
        self._gains = gains or Gains.sampled(task.config.control_period)

    def _act(self, observations: Observation, state: Any, starts: NDArray[np.bool_]) -> tuple[Array, _Tracking]:
        seen = self.task.layout.parse(observations)
        left = np.rint(seen["time_left"][:, 0] / self.task.config.control_period).astype(np.int64)
        tracking = cast(_Tracking | None, state)
        if tracking is None or len(tracking.due) != len(observations):
            tracking = self._nothing(len(observations))
        anew = starts | (tracking.due != left)
        if anew.any():
            tracking = self._replan(observations, tracking, left, anew)
        lanes, sample = np.arange(len(observations)), tracking.begun - left
        now, ahead = np.minimum(sample, tracking.last), np.minimum(sample + 1, tracking.last)
        qdd = tracking_acceleration(
            seen["joint_position"],
            seen["joint_velocity"],
            (tracking.q[lanes, now], tracking.qd[lanes, now]),
            (tracking.q[lanes, ahead], tracking.qd[lanes, ahead]),
            self.task.config.control_period,
            self._gains,
        )
        braking = sample >= tracking.last
        if braking.any():
            qdd = np.where(braking[:, None], self._braking(seen), qdd)
        return self._action_for(seen, qdd), replace(tracking, due=left - 1)

    def _nothing(self, n_lanes: int) -> _Tracking:
        samples = (n_lanes, self.task.horizon_steps + 1, self.task.arm.n_joints)
        zero = np.zeros(n_lanes, dtype=np.int64)
        return _Tracking(np.zeros(samples), np.zeros(samples), zero, zero, zero - 1)

    def _replan(
        self, observations: Observation, old: _Tracking, left: NDArray[np.int64], anew: NDArray[np.bool_]
    ) -> _Tracking:
        new = _Tracking(old.q.copy(), old.qd.copy(), np.where(anew, left, old.begun), old.last.copy(), old.due)
        period = self.task.config.control_period
        for lane in np.flatnonzero(anew):
            plan = self._plan(self.task.motion_problem(observations[lane]))
            new.last[lane] = 0
            if plan is not None:
                last = min(int(plan.duration / period + 1e-3), self.task.horizon_steps)
                new.q[lane, : last + 1], new.qd[lane, : last + 1], _ = plan.at(period * np.arange(last + 1))
                new.last[lane] = last
        return new

    def _plan(self, problem: MotionProblem) -> Trajectory | None:
        began = time.perf_counter()
        try:
            return self._planner(problem)
        except Infeasible:
            self.infeasible += 1
            return None
        finally:
            self.plans_made += 1
            self.planning_seconds += time.perf_counter() - began

    def _braking(self, seen: dict[str, Array]) -> Array:
        """Accelerations that bring the joints to rest within the limits."""
        arm, period = self.task.arm, self.task.config.control_period
        acceleration, jerk = np.array(arm.limits.acceleration), np.array(arm.limits.jerk)
        q, qd, qdd = seen["joint_position"], seen["joint_velocity"], seen["joint_acceleration"]
        # Speed v is shed to rest at full jerk from an acceleration of at most sqrt(2 jerk v).
        limited = np.isfinite(jerk)
        smooth = np.where(limited, np.sqrt(2.0 * np.where(limited, jerk, 0.0) * np.abs(qd)), np.inf)
        gentle = np.minimum(np.minimum(np.abs(qd) / period, acceleration), smooth)
        wanted = within_torque(arm, q, qd, -np.sign(qd) * gentle, period)
        reachable: Array = np.clip(wanted, qdd - jerk * period, qdd + jerk * period)
        return reachable


class FollowerExpert(Expert):
    """Computed torque on the goal itself, without planning: what a controller alone achieves.

    The hand is driven to the goal as a critically damped second-order system; accelerations and torques are scaled
    down to their limits, jerk is not looked at.

    Args:
        task: the environment's task.
        bandwidth: natural frequency of the hand's error, rad/s.
    """

    def __init__(self, task: Task, bandwidth: float = 4.0) -> None:
        super().__init__(task)
        self._bandwidth = bandwidth

    def _act(self, observations: Observation, state: Any, starts: NDArray[np.bool_]) -> tuple[Array, tuple[()]]:
        seen = self.task.layout.parse(observations)
        arm, w = self.task.arm, self._bandwidth
        q, qd = np.ascontiguousarray(seen["joint_position"]), np.ascontiguousarray(seen["joint_velocity"])
        jacobian = arm.jacobian(q)
        position, velocity, acceleration = self.task.hand_goal(seen)
        error = position - arm.forward_kinematics(q)
        hand_velocity = np.einsum("lij,lj->li", jacobian, qd)
        wanted = acceleration + 2.0 * w * (velocity - hand_velocity) + w**2 * error
        wanted = wanted - self._centripetal(q, qd)
        # Damped least squares: near a singular posture the arm does what it can.
        square = np.einsum("lij,lkj->lik", jacobian, jacobian) + 1e-6 * np.eye(2)
        qdd = np.einsum("lji,lj->li", jacobian, np.linalg.solve(square, wanted[..., None])[..., 0])
        excess = np.max(np.abs(qdd) / np.array(arm.limits.acceleration), axis=1, keepdims=True)
        qdd = within_torque(arm, q, qd, qdd / np.maximum(1.0, excess), self.task.config.control_period)
        return self._action_for(seen, qdd), ()

    def _centripetal(self, q: Array, qd: Array) -> Array:
        """Acceleration of the hand at constant joint velocities, ``(lanes, 2)``, m/s^2."""
        phi, w = np.cumsum(q, axis=1), np.cumsum(qd, axis=1)
        pull = self.task.arm.length_array * w**2
        return -np.stack([(pull * np.cos(phi)).sum(axis=1), (pull * np.sin(phi)).sum(axis=1)], axis=1)


class RandomExpert(Expert):
    """Uniformly random actions.

    They are drawn by hashing the observation, so that an episode is the same in whatever batch it is run.

    Args:
        task: the environment's task.
        seed: of the constants of the hash.
    """

    def __init__(self, task: Task, seed: int = 0) -> None:
        super().__init__(task)
        generator = np.random.default_rng(seed)
        shape = (task.layout.size, task.arm.n_joints)
        self._multipliers = generator.integers(0, 2**64, shape, dtype=np.uint64, endpoint=False) | np.uint64(1)

    def _act(self, observations: Observation, state: Any, starts: NDArray[np.bool_]) -> tuple[Array, tuple[()]]:
        words = np.ascontiguousarray(observations, dtype=np.float32).view(np.uint32).astype(np.uint64)
        bits = (words[:, :, None] * self._multipliers).sum(axis=1, dtype=np.uint64)
        # The finaliser of splitmix64 spreads every bit over all others.
        for shift, multiplier in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
            bits = (bits ^ (bits >> np.uint64(shift))) * np.uint64(multiplier)
        bits ^= bits >> np.uint64(31)
        return 2.0 * (bits >> np.uint64(11)).astype(np.float64) / 2.0**53 - 1.0, ()


def _dpct(task: Task) -> Expert:
    if isinstance(task, MinTorqueMove):
        return PlanningExpert(task, partial(dpct.plan, variant="torque"))
    return PlanningExpert(task, partial(dpct.plan, allow_reverse=True, explain=False))


def _follower(task: Task) -> Expert:
    """Without planning: straight to the goal, by a quintic in joint space where the time for it is given."""
    if isinstance(task, ObstacleDodge):
        return PlanningExpert(task, trapezoid.plan)
    return PlanningExpert(task, quintic.plan) if isinstance(task, MinTorqueMove) else FollowerExpert(task)


EXPERTS: dict[str, Callable[[Task], Expert]] = {
    "dpct": _dpct,
    "lagrange": lambda task: PlanningExpert(task, lagrange.plan),
    "follower": _follower,
    "random": RandomExpert,
}
"""How each expert is made from a task."""


def make_expert(name: str, env: gym.Env[Any, Any] | gym.vector.VectorEnv[Any, Any, Any]) -> Expert:
    """A scripted expert for an environment.

    Args:
        name: one of `EXPERTS`.
        env: the environment, single or vector, wrapped or not.

    Raises:
        ValueError: if there is no such expert, or the environment is not one of planarm's.
    """
    refuse_unknown([name], EXPERTS, "expert")
    task = getattr(env.unwrapped, "task", None)
    if not isinstance(task, Task):
        raise ValueError(f"{env} is not one of planarm's environments; experts need one, such as ConveyorTrack-v0")
    return EXPERTS[name](task)
