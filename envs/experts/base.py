"""What every expert is: observations in, actions out, behind the `predict` of a Stable-Baselines3 policy."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from typing import Any, ClassVar, Self, cast

import numpy as np
from numpy.typing import NDArray

from envs.checks import checked_observations, checked_starts
from envs.experts.payload_estimation import AdaptiveState, PayloadAdaptation, loaded_arms
from envs.experts.robust import RobustState, RobustTracking
from envs.observation import Observation
from envs.physics.actuation import action_scale
from envs.task import Task
from planners import Arm, Infeasible, MotionProblem, Trajectory
from planners.checks import brief
from planners.control import Estimate, held_torque, within_torque
from planners.typing import Array

Actions = NDArray[np.float32]
Planner = Callable[[MotionProblem], Trajectory]
HandGoal = Callable[[dict[str, Array]], tuple[Array, Array, Array]]
"""Reads from parsed observations where the hand should be: position, velocity, acceleration, ``(num_envs, 2)`` each."""


class Expert(ABC):
    """A policy whose actions come from a planner or a controller, not from a network.

    Where the settings declare uncertainty, it acts on an estimate: of the payload where nothing else is uncertain (see
    `PayloadAdaptation`), else of all that is (see `RobustTracking`). It does not expect a payload that is a single
    number, unless `adapt` makes it estimate the payload.

    Attributes:
        plans_made: number of motions planned so far.
        planning_seconds: time spent on them.
        infeasible: how many of the problems had no solution.
        refusal: why the last of them had none; empty if it had one.
        idle: environments whose actions are not used, ``(num_envs,)``; nothing is planned for them. None if there
            are none.
    """

    tracks: ClassVar[bool] = True
    """Whether its actions depend on the state of the joints."""

    def __init__(self, task: Task) -> None:
        self.task = task
        self.plans_made = 0
        self.planning_seconds = 0.0
        self.infeasible = 0
        self.refusal = ""
        self.idle: NDArray[np.bool_] | None = None
        self._memory: Any = None
        self._adaptation = PayloadAdaptation(task) if self.tracks and PayloadAdaptation.wanted(task) else None
        self._payload: Array = np.zeros(0)
        robust = self.tracks and self._adaptation is None and RobustTracking.wanted(task)
        self._robust = RobustTracking(task) if robust else None
        self._estimate: Estimate | None = None
        if task.action_space().shape != (task.arm.n_joints,):
            raise ValueError(
                f"experts give one number per joint, and control_mode {task.config.control_mode!r} of {task.env_id} "
                "takes another kind of action; leave it out"
            )
        self._scale = action_scale(task.arm, task.actuation_mode(task.config))

    def adapt(self) -> Self:
        """Estimate the payload from now on, and plan and act for the loaded arm; see `PayloadAdaptation`.

        It replaces `RobustTracking`.

        Raises:
            ValueError: if this environment or control mode does not allow it.
        """
        adaptation = PayloadAdaptation(self.task)
        self.unfiltered()._adaptation = adaptation
        return self

    def unfiltered(self) -> Self:
        """Act on observations as they are from now on, as if the settings declared no uncertainty."""
        self._adaptation = self._robust = self._estimate = self._memory = None
        return self

    @property
    def mass_estimate(self) -> Array | None:
        """Estimated payloads after the last call, ``(num_envs,)``, kg; None without estimation."""
        return self._memory.mass_estimate if isinstance(self._memory, AdaptiveState) else None

    def planned(self, env_index: int = 0) -> Array | None:
        """Joint angles that are planned from now on, ``(periods, n)``, rad; None without a plan."""
        return None

    def predict(
        self,
        observation: Observation,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = False,
    ) -> tuple[Actions, Any]:
        """Actions for observations.

        Args:
            observation: ``(size,)`` or ``(num_envs, size)``.
            state: from the last call; None to continue from this expert's own last call.
            episode_start: ``(num_envs,)``, which environments are at the first step of an episode; may be left out,
                because the observation holds the time.
            deterministic: ignored, for compatibility.

        Returns:
            Actions in [-1, 1], ``(n,)`` or ``(num_envs, n)``, and the state for the next call.

        Raises:
            ValueError: if the observation or ``episode_start`` has another shape, or is not of finite numbers; or the
                state is not one of such an expert.
        """
        batch = checked_observations(observation, self.task.layout.size)
        if not np.isfinite(batch).all():
            raise ValueError("an observation holds values that are not finite; nothing can be planned from it")
        starts = checked_starts(episode_start, len(batch))
        if state is not None:
            self._require_own(state)
        memory = self._memory if state is None else state
        if self._robust is not None:
            self._payload = np.zeros(len(batch))
            expected, self._estimate, robust, starts = self._robust.update(batch, memory, starts)
            actions, inner = self._act(expected, robust.expert, starts)
            clipped, self._memory = self._robust.act(robust, self._estimate, _clipped(actions), inner)
        elif self._adaptation is None:
            self._payload = np.zeros(len(batch))
            actions, self._memory = self._act(batch, memory, starts)
            clipped = _clipped(actions)
        else:
            known = self._adaptation.update(batch, cast(AdaptiveState | None, memory), starts)
            self._payload = known.mass_estimate
            actions, inner = self._act(batch, known.expert, starts)
            clipped = _clipped(actions)
            self._memory = known.after(self._scale * clipped, inner)
        return (clipped[0] if np.ndim(observation) == 1 else clipped), self._memory

    @abstractmethod
    def _act(self, observations: Observation, state: Any, starts: NDArray[np.bool_]) -> tuple[Array, Any]:
        """Unclipped actions ``(num_envs, n)`` and the next state."""

    def _require_own(self, state: Any) -> None:
        """Raise a ValueError for a state that such an expert cannot have returned."""
        around = RobustState if self._robust is not None else None if self._adaptation is None else AdaptiveState
        own = around is None or isinstance(state, around)
        inner = state.expert if own and around is not None else state
        if not own or not (inner is None or self._is_own(inner)):
            raise ValueError(
                f"state {brief(state)} is none that this expert has returned; leave it out to go on from its last call"
            )

    def _is_own(self, state: Any) -> bool:
        """Whether `_act` may have returned a state."""
        return isinstance(state, np.ndarray) or (isinstance(state, tuple) and not state)

    def _begins(self, seen: dict[str, Array]) -> NDArray[np.bool_]:
        """Environments at the first step of an episode, ``(num_envs,)``, by the time left."""
        config = self.task.config
        begins: NDArray[np.bool_] = seen["time_left"][:, 0] > config.horizon - 0.5 * config.control_period
        return begins

    def _action_for(self, seen: dict[str, Array], qdd: Array) -> Array:
        """The action, in the environment's control mode, that gives mean joint accelerations ``(num_envs, n)``."""
        config = self.task.config
        if config.control_mode == "acceleration":
            wanted = qdd
        elif config.control_mode == "jerk":
            wanted = (qdd - seen["joint_acceleration"]) / config.control_period
        elif config.control_mode == "velocity":
            wanted = seen["joint_velocity"] + config.control_period * qdd
        elif self._estimate is not None:
            wanted = self._estimate.held_torque(qdd, config.control_period)
        else:
            q, qd = seen["joint_position"], seen["joint_velocity"]
            wanted = np.empty_like(qdd)
            for arm, batch in self._arms():
                wanted[batch] = held_torque(arm, q[batch], qd[batch], qdd[batch], config.control_period)
        return wanted / self._scale

    def _plan(self, planner: Planner, problem: MotionProblem) -> Trajectory | None:
        """A plan, counted and timed; None if the problem has no solution."""
        began, self.refusal = time.perf_counter(), ""
        try:
            return planner(problem)
        except Infeasible as error:
            self.infeasible += 1
            self.refusal = str(error)
            return None
        finally:
            self.plans_made += 1
            self.planning_seconds += time.perf_counter() - began

    def _within_torque(self, seen: dict[str, Array], qdd: Array) -> Array:
        """Accelerations ``(num_envs, n)``, each row scaled down until its torques fit the limits."""
        q, qd, fitting = seen["joint_position"], seen["joint_velocity"], np.empty_like(qdd)
        for arm, batch in self._arms():
            state = q[batch], qd[batch], qdd[batch]
            fitting[batch] = within_torque(arm, *state, self.task.config.control_period)
        return fitting

    def _arms(self) -> Iterator[tuple[Arm, slice | NDArray[np.int64]]]:
        """The arms with their estimated payloads, each with its rows of the batch."""
        return loaded_arms(self.task.arm, self._payload)


def _clipped(actions: Array) -> Actions:
    clipped: Actions = np.clip(actions, -1.0, 1.0).astype(np.float32)
    return clipped
