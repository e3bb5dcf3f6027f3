"""Experts of ObstacleDodge-v0: planners that replan as the predicted discs change, and a field that reacts to them."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from envs.experts.base import Expert
from envs.observation import Observation
from envs.obstacle_dodge.env import ObstacleDodge
from envs.obstacle_dodge.paths import NEAREST
from envs.obstacle_dodge.scale import Scale, scale_of_task
from planners import MotionProblem, Trajectory, dpct, lagrange
from planners.apf.dodge import DodgeGains, dodge_accelerations, look_ahead_steps, new_memory, tuned_gains
from planners.typing import Array

REPLAN_EVERY = 5
"""Control periods between two plans."""

ACCELERATION_SHARE, VELOCITY_SHARE = 0.88, 0.96
"""Shares of the arm's limits for plans; the rest is for tracking."""


def time_along_line(problem: MotionProblem) -> Trajectory:
    """DPCT: straight lines in joint space, timed so that the discs have passed or have not come yet.

    Where no timing avoids a disc, the motion that delays the contact.
    """
    return dpct.plan(_with_full_limits(problem), variant="timing", contact="delay")


def pass_via_nodes(problem: MotionProblem) -> Trajectory:
    """Lagrange: an interpolant whose inner nodes are moved aside of the predicted discs."""
    keep_out = NEAREST * scale_of_task(problem.arm).length
    return lagrange.plan(_with_full_limits(problem), variant="via", contact="delay", keep_out=keep_out)


def _with_full_limits(problem: MotionProblem) -> MotionProblem:
    """Evading takes more than half of the acceleration, which is what the problem allows for an undisturbed move.

    Plans follow each other every tenth of a second and their accelerations do not join, so that none keeps jerk limits.
    """
    limits = problem.arm.limits
    acceleration = tuple(ACCELERATION_SHARE * value for value in limits.acceleration)
    velocity = tuple(VELOCITY_SHARE * value for value in limits.velocity)
    jerk = (math.inf,) * problem.arm.n_joints
    return replace(problem, limits=replace(limits, acceleration=acceleration, velocity=velocity, jerk=jerk))


def in_units(gains: DodgeGains, scale: Scale) -> DodgeGains:
    """Gains that were tuned for the task's own arm in the units of another."""
    length, time = scale
    if scale == (1.0, 1.0):
        return gains
    return replace(
        gains,
        horizon=min(5.0, time * gains.horizon),
        margin=length * gains.margin,
        margin_growth=length / time * gains.margin_growth,
        closeness=gains.closeness / length,
        closeness_memory=time * gains.closeness_memory,
        collision=time * gains.collision,
        collision_memory=time * gains.collision_memory,
        success=time * gains.success,
        detour=time * gains.detour,
        constancy=time * gains.constancy,
        elbow=time * gains.elbow,
        corner=time * gains.corner,
        corner_reach=length * gains.corner_reach,
        lag=time * gains.lag,
        confidence=time * gains.confidence,
        nearest=length * gains.nearest,
        farthest=length * gains.farthest,
    )


class DodgingExpert(Expert):
    """A field around the whole arm, among moving discs; see `planners.apf.dodge`.

    Args:
        task: the environment's task.
        gains: of the field; the tuned ones when left out.
    """

    def __init__(self, task: ObstacleDodge, gains: DodgeGains | None = None) -> None:
        super().__init__(task)
        self._rules: dict[str, Any] = {"tolerance": task.config.tolerance, "hold_time": task.config.hold_time}
        self._discs = task.n_discs
        self._gains = gains or in_units(tuned_gains(self._discs), task.scale)

    @property
    def steps(self) -> int:
        """Number of steps of the look-ahead, `planners.apf.dodge.STEP` apart."""
        return look_ahead_steps(self._gains)

    def _is_own(self, state: Any) -> bool:
        """Whether `_act` may have returned a state."""
        return isinstance(state, np.ndarray) and state.dtype == self._memory_of(1).dtype

    def _act(self, observations: Observation, state: Any, starts: NDArray[np.bool_]) -> tuple[Array, Any]:
        seen = self.task.layout.parse(observations)
        batch = len(observations)
        memory = self._memory_of(batch) if state is None or len(state) != batch else state.copy()
        memory[starts | self._begins(seen)] = np.zeros(1, memory.dtype)
        qdd, memory = self._accelerate(seen, memory)
        return self._action_for(seen, qdd), memory

    def _memory_of(self, batch: int) -> NDArray[Any]:
        return new_memory(batch, self._discs)

    def _accelerate(
        self, seen: dict[str, Array], memory: NDArray[Any], forecast: Array | None = None
    ) -> tuple[Array, NDArray[Any]]:
        """Joint accelerations ``(num_envs, 2)`` of the field, and its memory, which is changed in place.

        ``forecast`` says where the discs will be, ``(num_envs, steps, discs, 2)``, m from the base.
        """
        (batch, room), discs = seen["obstacle_radius"].shape, self._discs
        q, qd, base = seen["joint_position"], seen["joint_velocity"], self.task.arm.base_array
        places = seen["obstacle"].reshape(batch, room, 2)[:, :discs] + base
        rates = seen["obstacle_velocity"].reshape(batch, room, 2)[:, :discs]
        qdd = np.zeros_like(q)
        for arm, part_of in self._arms():
            rows = part_of if self.idle is None else np.arange(batch)[part_of][~self.idle[part_of]]
            part = memory[rows]
            qdd[rows] = dodge_accelerations(
                arm,
                self._gains,
                q[rows],
                qd[rows],
                seen["goal"][rows] + base,
                places[rows],
                rates[rows],
                seen["obstacle_radius"][rows, :discs],
                part,
                self.task.config.control_period,
                forecast=None if forecast is None else forecast[rows] + base,
                **self._rules,
            )
            memory[rows] = part
        return qdd, memory
