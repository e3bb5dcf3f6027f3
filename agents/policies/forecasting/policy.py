"""The policy that dodges by forecasts: learnt futures of the disc, and the field that weighs them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from agents.policies.forecasting.forecaster import Forecaster
from agents.policies.forecasting.futures import PATHS, Network, expect, knot_table
from agents.policies.forecasting.track import MOVE, PERIOD, follow_disc, new_tracks
from envs.experts.base import Expert
from envs.observation import Observation
from envs.obstacle_dodge.env import ObstacleDodge
from envs.obstacle_dodge.paths import straight_move
from envs.task import Task
from planners import Arm, FixedHand, JointLimits
from planners.apf.dodge import dodge_accelerations, new_memory, tuned_gains
from planners.apf.hedging import Futures, HedgeGains
from planners.apf.safety import STEP
from planners.robot.kinematics import UnreachableTarget
from planners.typing import Array

FORESIGHT = 3.0
"""How far ahead the field looks with forecasts, s; without them it does not pay to look as far."""


@dataclass(frozen=True)
class Memory:
    """What is remembered of each environment.

    Attributes:
        field: of the field, see `planners.apf.dodge.new_memory`.
        tracks: of the discs, see `agents.policies.forecasting.track.TRACK`.
        moves: at which the discs are aimed, ``MOVE``.
    """

    field: NDArray[Any]
    tracks: NDArray[Any]
    moves: NDArray[Any]

    @classmethod
    def of_nothing(cls, num_envs: int) -> Memory:
        """Before the first observation."""
        return cls(new_memory(num_envs, 1), new_tracks(num_envs), np.zeros(num_envs, MOVE))

    def copy(self) -> Memory:
        """One that can be changed."""
        return Memory(self.field.copy(), self.tracks.copy(), self.moves.copy())


class ForecastingDodger(Expert):
    """Watches the disc, forecasts the ways it may go, and takes the proposal of the field that costs least on average.

    Args:
        task: ObstacleDodge-v0 with one disc.
        forecaster: trained.

    Raises:
        ValueError: for another task, or other settings than those that the forecaster knows.
    """

    def __init__(self, task: Task, forecaster: Forecaster) -> None:
        super().__init__(task)
        if not isinstance(task, ObstacleDodge):
            raise ValueError(f"the forecaster knows the discs of {ObstacleDodge.env_id}; {task.env_id} has none")
        if task.config.num_obstacles != 1 or abs(task.config.control_period - PERIOD) > 1e-9:
            raise ValueError(
                f"the forecaster was trained with num_obstacles 1 and control_period {PERIOD:g} s, not "
                f"{task.config.num_obstacles} and {task.config.control_period:g} s; leave them out"
            )
        self._rules: dict[str, Any] = {"tolerance": task.config.tolerance, "hold_time": task.config.hold_time}
        self._gains, self._hedge = replace(tuned_gains(), horizon=FORESIGHT), HedgeGains()
        self._network, self._table = forecaster.network, knot_table(round(self._gains.horizon / STEP))

    def _act(self, observations: Observation, state: Any, starts: NDArray[np.bool_]) -> tuple[Array, Memory]:
        seen = self.task.layout.parse(observations)
        num_envs, base = len(observations), self.task.arm.base_array
        begins = starts | self._begins(seen)
        if isinstance(state, Memory) and len(state.tracks) == num_envs:
            memory = state.copy()
        else:
            memory, begins = Memory.of_nothing(num_envs), np.ones(num_envs, dtype=bool)
        memory.field[begins], memory.tracks[begins] = np.zeros(1, memory.field.dtype), new_tracks(1)
        for env_index in np.flatnonzero(begins):
            memory.moves[env_index] = self._move(observations[env_index])
        deciding = ~memory.field["decided"]
        futures, weights = np.zeros((num_envs, PATHS, len(self._table), 1, 2)), np.zeros((num_envs, PATHS))
        _watch_and_expect(
            memory.tracks,
            memory.moves,
            seen["obstacle"].astype(np.float64),
            seen["obstacle_velocity"].astype(np.float64),
            deciding,
            self._network,
            self._table,
            futures,
            weights,
        )
        q, qd = seen["joint_position"], seen["joint_velocity"]
        qdd = np.empty_like(q)
        for arm, chosen in self._arms():
            part = memory.field[chosen]
            qdd[chosen] = dodge_accelerations(
                arm,
                self._gains,
                q[chosen],
                qd[chosen],
                seen["goal"][chosen] + base,
                seen["obstacle"][chosen, None] + base,
                seen["obstacle_velocity"][chosen, None],
                seen["obstacle_radius"][chosen],
                part,
                self.task.config.control_period,
                **self._rules,
                futures=Futures(futures[chosen] + base, weights[chosen], self._hedge),
            )
            memory.field[chosen] = part
        return self._action_for(seen, qdd), memory

    def _move(self, observation: Observation) -> NDArray[Any]:
        problem = self.task.motion_problem(observation)
        assert isinstance(problem.target, FixedHand)  # the goal of ObstacleDodge-v0
        return aimed_move(problem.arm, problem.joint_limits, problem.q, problem.target.position)


def aimed_move(arm: Arm, limits: JointLimits, start: Array, goal: Array) -> NDArray[Any]:
    """The straight move to a goal of the hand at which discs are aimed, a record of ``MOVE``.

    To the posture on the start's side of the elbow, if the ranges allow it; nowhere if the goal is out of reach.

    Args:
        arm: with two links.
        limits: of velocity and acceleration.
        start: joint angles, ``(2,)``, rad.
        goal: ``(2,)``, m.
    """
    ranges = np.array(arm.limits.angle)
    try:
        allowed = [q for q in arm.inverse_kinematics(goal) if (np.abs(q) <= ranges).all()]
    except UnreachableTarget:  # single precision may put a goal at the end of the reach just out of it
        allowed = []
    end = min(allowed, key=lambda q: float(q[1] * start[1] < 0.0)) if allowed else start
    way = straight_move(arm, limits, start, end)
    record = np.zeros((), MOVE)
    record["start"], record["change"], record["lengths"] = way.start, way.change, way.lengths
    record["top"], record["ramp"] = way.top, way.ramp
    return record


@njit(cache=True, nogil=True)
def _watch_and_expect(
    tracks: Any,
    moves: Any,
    places: Array,
    velocities: Array,
    deciding: NDArray[np.bool_],
    network: Network,
    table: Array,
    futures: Array,
    weights: Array,
) -> None:
    """Take in the discs of all environments; fill in the futures of those that decide."""
    for env_index in range(tracks.shape[0]):
        follow_disc(tracks[env_index], moves[env_index], places[env_index], velocities[env_index])
        if deciding[env_index]:
            expect(tracks[env_index], moves[env_index], network, table, futures[env_index, :, :, 0], weights[env_index])
