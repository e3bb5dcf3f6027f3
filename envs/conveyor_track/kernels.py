"""The compiled kernels of ConveyorTrack: how a lane begins, advances, is scored and observed."""

from __future__ import annotations

import math
from typing import Any

from numba import njit

from envs.physics import chipmunk
from envs.physics.actuation import apply_action
from envs.physics.episode import begin_episode, finish_observation, limit_cost, sum_reward
from planners.robot.kinematics import hand_state_lane, two_link_branch

LINE_LENGTH = 0.5
"""Length of the paper's path, X_h(t_f) - X_h(t_0), m: the unit of its position r in the index J of eq 18."""

MAX_ERROR = 1000.0
"""Tracking error, in tolerances, from which on the progress term sees no difference: 1 m, 2 m/s by default."""

LANE_FIELDS: list[tuple[Any, ...]] = [
    ("part", "i8"),
    ("part_position", "f8", (2,)),
    ("part_velocity", "f8", (2,)),
    ("part_acceleration", "f8", (2,)),
    ("hand", "f8", (2,)),
    ("hand_velocity", "f8", (2,)),
    ("belt_start", "f8", (2,)),
    ("settled_steps", "i8"),
    ("error", "f8"),
    ("velocity_error", "f8"),
    ("steady_state_error", "f8"),
    ("lq_cost", "f8"),
]
"""What a lane's record holds for this task, beside what every task has."""

MODEL_FIELDS: list[tuple[Any, ...]] = [
    ("position_tolerance", "f8"),
    ("velocity_tolerance", "f8"),
    ("limit_tolerance", "f8"),
    ("limit_penalty", "f8"),
    ("hold_steps", "i8"),
]
"""What the model record holds for this task."""


@njit(cache=True, nogil=True)
def reset_lane(lanes: Any, model: Any, index: int, elbow: float) -> None:
    """Begin an episode in one lane whose hand and part are already set: posture, bodies, counters, observation."""
    lane, shared = lanes[index], model[0]
    dx, dy = lane.hand[0] - shared.base[0], lane.hand[1] - shared.base[1]
    lane.q[0], lane.q[1] = two_link_branch(shared.lengths[0], shared.lengths[1], dx, dy, elbow)
    begin_episode(lane, shared)
    lane.settled_steps = 0
    lane.steady_state_error = lane.lq_cost = 0.0
    lane.belt_start[:] = lane.part_position
    chipmunk.body_set_position(lane.part, lane.part_position[0], lane.part_position[1])
    hand_state_lane(shared.lengths, shared.base, lane.q, lane.qd, lane.hand, lane.hand_velocity)
    _measure_errors(lane)
    _observe(lane, shared)


@njit(cache=True, nogil=True)
def advance_lanes(lanes: Any, model: Any, first: int, last: int) -> None:
    """Advance lanes ``first`` to ``last - 1`` by one control period under their ``action``."""
    shared = model[0]
    for index in range(first, last):
        lane = lanes[index]
        progress_before = _progress(lane, shared)
        settled_before = lane.settled_steps
        cost_rate_before = _lq_cost_rate(lane)
        _set_belt_moving(lane, shared)
        worst_ratio = apply_action(lane, shared, lane.action)
        _read_part(lane, shared)
        hand_state_lane(shared.lengths, shared.base, lane.q, lane.qd, lane.hand, lane.hand_velocity)
        _measure_errors(lane)
        lane.step += 1
        lane.lq_cost += 0.5 * shared.control_period * (cost_rate_before + _lq_cost_rate(lane))
        lane.settled_steps = lane.settled_steps + 1 if _error_in_tolerances(lane, shared) <= 1.0 else 0
        if lane.step > shared.horizon_steps - shared.hold_steps:
            lane.steady_state_error = max(lane.steady_state_error, lane.error)
        lane.success = lane.settled_steps >= shared.hold_steps
        lane.truncated = lane.step >= shared.horizon_steps
        lane.reward_terms[0] = _progress(lane, shared) - progress_before
        lane.reward_terms[1] = (lane.settled_steps - settled_before) / shared.horizon_steps
        lane.reward_terms[2] = shared.limit_penalty * limit_cost(worst_ratio, shared.limit_tolerance)
        sum_reward(lane)
        _observe(lane, shared)


@njit(cache=True, nogil=True)
def _set_belt_moving(lane: Any, shared: Any) -> None:
    """Give the part the belt's velocity in the middle of the period: exact for a constant acceleration."""
    half = 0.5 * shared.control_period
    chipmunk.body_set_velocity(
        lane.part,
        lane.part_velocity[0] + half * lane.part_acceleration[0],
        lane.part_velocity[1] + half * lane.part_acceleration[1],
    )


@njit(cache=True, nogil=True)
def _read_part(lane: Any, shared: Any) -> None:
    lane.part_position[0], lane.part_position[1] = chipmunk.body_get_position(lane.part)
    for axis in range(2):
        lane.part_velocity[axis] += shared.control_period * lane.part_acceleration[axis]


@njit(cache=True, nogil=True)
def _measure_errors(lane: Any) -> None:
    dx, dy = lane.part_position[0] - lane.hand[0], lane.part_position[1] - lane.hand[1]
    dvx, dvy = lane.part_velocity[0] - lane.hand_velocity[0], lane.part_velocity[1] - lane.hand_velocity[1]
    lane.error = math.sqrt(dx * dx + dy * dy)
    lane.velocity_error = math.sqrt(dvx * dvx + dvy * dvy)


@njit(cache=True, nogil=True)
def _error_in_tolerances(lane: Any, shared: Any) -> float:
    """The larger of position and velocity error, each in units of its tolerance: settled means at most 1."""
    return float(max(lane.error / shared.position_tolerance, lane.velocity_error / shared.velocity_tolerance))


@njit(cache=True, nogil=True)
def _progress(lane: Any, shared: Any) -> float:
    """0 where settled, -1 where the error is `MAX_ERROR` tolerances or more, and linear in its logarithm between."""
    error = min(MAX_ERROR, max(1.0, _error_in_tolerances(lane, shared)))
    return -math.log(error) / math.log(MAX_ERROR)


@njit(cache=True, nogil=True)
def _lq_cost_rate(lane: Any) -> float:
    """Integrand of eq 18, with lengths in units of the paper's path."""
    squares = lane.error * lane.error + lane.velocity_error * lane.velocity_error
    return float(squares / (LINE_LENGTH * LINE_LENGTH))


@njit(cache=True, nogil=True)
def _observe(lane: Any, shared: Any) -> None:
    """Write the observation: the entries of the layout, in its order."""
    seen = lane.seen
    seen[0:2] = lane.q
    seen[2:4] = lane.qd
    seen[4:6] = lane.qdd
    seen[6:8] = lane.hand - shared.base
    seen[8:10] = lane.part_position - shared.base
    seen[10:12] = lane.part_position - lane.hand
    seen[12:14] = lane.part_velocity
    seen[14:16] = lane.part_acceleration
    seen[16] = (shared.horizon_steps - lane.step) * shared.control_period
    seen[17] = lane.settled_steps / shared.horizon_steps
    finish_observation(lane, shared)
