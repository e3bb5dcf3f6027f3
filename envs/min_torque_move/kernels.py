"""The compiled kernels of MinTorqueMove: how a lane begins, advances, is scored and observed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from envs.physics.actuation import apply_action
from envs.physics.episode import begin_episode, finish_observation, limit_cost, sum_reward
from planners.control import held_torque_lane
from planners.motion.rest_curve import SHAPES, rest_curve_lane
from planners.quintic import quintic_effort
from planners.typing import Array

MAX_MISS = 1000.0
"""Error at the end, in tolerances, from which on a miss costs no more."""

SHAPE_SCALE = 5.0
"""What an action of 1 stands for where actions are coefficients of a motion, rad; of polynomial k, divided by k + 1,
because the higher it is, the more torque it takes."""

LANE_FIELDS: list[tuple[Any, ...]] = [
    ("start", "f8", (3,)),
    ("goal", "f8", (3,)),
    ("shape", "f8", (3, SHAPES)),
    ("duration_steps", "i8"),
    ("quintic_l1", "f8"),
    ("quintic_peak", "f8", (3,)),
    ("torque_l1", "f8"),
    ("torque_l2", "f8"),
    ("angle_error", "f8"),
    ("velocity_error", "f8"),
]
"""What a lane's record holds for this task, beside what every task has."""

MODEL_FIELDS: list[tuple[Any, ...]] = [
    ("whole_motion", "?"),
    ("position_gain", "f8"),
    ("velocity_gain", "f8"),
    ("angle_tolerance", "f8"),
    ("velocity_tolerance", "f8"),
    ("limit_tolerance", "f8"),
    ("limit_penalty", "f8"),
    ("miss_penalty", "f8"),
]
"""What the model record holds for this task."""


@njit(cache=True, nogil=True)
def reset_lane(lanes: Any, model: Any, index: int) -> None:
    """Begin an episode in one lane whose posture, goal and duration are already set."""
    lane, shared = lanes[index], model[0]
    begin_episode(lane, shared)
    lane.start[:] = lane.q
    lane.torque_l1 = lane.torque_l2 = 0.0
    duration = lane.duration_steps * shared.control_period
    lane.quintic_l1 = quintic_effort(shared.coupling, shared.weight, lane.q, lane.goal, duration, lane.quintic_peak)
    _measure_errors(lane)
    _observe(lane, shared)


@njit(cache=True, nogil=True)
def advance_lanes(lanes: Any, model: Any, first: int, last: int) -> None:
    """Advance lanes ``first`` to ``last - 1`` by one control period under their ``action``."""
    shared = model[0]
    for index in range(first, last):
        lane = lanes[index]
        if shared.whole_motion:
            worst_ratio = apply_action(lane, shared, _follow_motion(lane, shared))
        else:
            worst_ratio = apply_action(lane, shared, lane.action)
        lane.step += 1
        spent = 0.0
        for torque in lane.tau:
            spent += abs(torque) * shared.control_period
            lane.torque_l2 += torque * torque * shared.control_period
        lane.torque_l1 += spent
        _measure_errors(lane)
        lane.terminated = lane.step >= lane.duration_steps
        miss = max(lane.angle_error / shared.angle_tolerance, lane.velocity_error / shared.velocity_tolerance)
        lane.success = lane.terminated and miss <= 1.0
        lane.reward_terms[0] = -spent / lane.quintic_l1
        lane.reward_terms[1] = 0.0 - shared.miss_penalty * _miss_cost(miss) if lane.terminated else 0.0
        lane.reward_terms[2] = shared.limit_penalty * limit_cost(worst_ratio, shared.limit_tolerance)
        sum_reward(lane)
        _observe(lane, shared)


@njit(cache=True, nogil=True)
def _follow_motion(lane: Any, shared: Any) -> Array:
    """Shares of the torque limits that follow the motion which the first action of the episode has chosen."""
    n, period = lane.q.shape[0], shared.control_period
    if lane.step == 0:
        for i in range(n):
            for k in range(SHAPES):
                lane.shape[i, k] = SHAPE_SCALE / (k + 1.0) * min(1.0, max(-1.0, lane.action[i * SHAPES + k]))
    duration, now = lane.duration_steps * period, lane.step * period
    q, qd, q_ahead, qd_ahead = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    rest_curve_lane(lane.shape, lane.start, lane.goal, duration, now, q, qd)
    rest_curve_lane(lane.shape, lane.start, lane.goal, duration, now + period, q_ahead, qd_ahead)
    qdd, torque = np.empty(n), np.empty(n)
    for i in range(n):
        feedback = shared.position_gain * (q[i] - lane.q[i]) + shared.velocity_gain * (qd[i] - lane.qd[i])
        qdd[i] = (qd_ahead[i] - qd[i]) / period + feedback
    held_torque_lane(shared.coupling, shared.weight, lane.q, lane.qd, qdd, period, torque)
    share: Array = torque / shared.limits[0]
    return share


@njit(cache=True, nogil=True)
def _miss_cost(miss: float) -> float:
    """0 within tolerance, 1 just outside, 2 at `MAX_MISS` tolerances, linear in the logarithm between."""
    return 0.0 if miss <= 1.0 else 1.0 + math.log(min(miss, MAX_MISS)) / math.log(MAX_MISS)


@njit(cache=True, nogil=True)
def _measure_errors(lane: Any) -> None:
    """The largest error of any joint."""
    lane.angle_error = lane.velocity_error = 0.0
    for i in range(lane.q.shape[0]):
        lane.angle_error = max(lane.angle_error, abs(lane.q[i] - lane.goal[i]))
        lane.velocity_error = max(lane.velocity_error, abs(lane.qd[i]))


@njit(cache=True, nogil=True)
def _observe(lane: Any, shared: Any) -> None:
    """Write the observation: the entries of the layout, in its order."""
    seen = lane.seen
    seen[0:3] = lane.q
    seen[3:6] = lane.qd
    seen[6:9] = lane.qdd
    seen[9:12] = lane.goal
    for i in range(3):
        seen[12 + i] = lane.goal[i] - lane.q[i]
        seen[15 + i] = shared.limits[0, i]
    seen[18] = (lane.duration_steps - lane.step) * shared.control_period
    seen[19] = lane.quintic_l1 / (lane.duration_steps * shared.control_period)
    finish_observation(lane, shared)
