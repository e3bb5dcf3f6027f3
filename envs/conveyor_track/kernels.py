"""The compiled kernels of ConveyorTrack: how an environment begins, advances, is scored and observed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from envs.physics.actuation import command, finish_period, move_arms
from envs.physics.episode import (
    ADVANCE,
    BEGIN,
    begin_episode,
    entry_points,
    finish_observation,
    limit_cost,
    observe_joints,
    observed_through,
    sum_reward,
)
from envs.uncertainty.kernels import add_camera_noise, add_joint_noise
from planners.compiled.calls import Kernel, call, copy_array, inlined, private
from planners.robot.kinematics import hand_state_single

LINE_LENGTH = 0.5
"""Length of the paper's path, X_h(t_f) - X_h(t_0), m: the unit of its position r in the index J of eq 18."""

MAX_ERROR = 1000.0
"""Tracking error, in tolerances, from which on the progress term is constant: 1 m, 2 m/s by default."""

ENV_FIELDS: list[tuple[Any, ...]] = [
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
"""What an environment's record holds for this task, besides what every task has."""


def run(batch: Any, model: Any, first: int, last: int, work: int) -> None:
    """Begin, advance or refresh environments ``first`` to ``last - 1``: see `entry_points`."""
    shared = model[0]
    for start in range(first, last, shared.pack):
        end = min(start + shared.pack, last)
        if work == ADVANCE:
            for index in range(start, end):
                command(batch[index], shared, batch[index].action)
            move_arms(batch, model, start, end, shared.substeps)
        for index in range(start, end):
            env = batch[index]
            if work == ADVANCE:
                _finish(env, shared)
            elif work == BEGIN:
                _begin(env, shared)
            if shared.measure_kernel == 0:
                _observe(env, shared)
            else:
                call(shared.measure_kernel, batch, model, index)


reset_env, advance_batch, refresh_env = entry_points(run)


@inlined
def _begin(env: Any, shared: Any) -> None:
    """Begin an episode whose posture and part are set."""
    begin_episode(env, shared)
    env.settled_steps = 0
    env.steady_state_error = env.lq_cost = 0.0
    copy_array(env.belt_start, env.part_position)
    hand_state_single(shared.lengths, shared.base, env.q, env.qd, env.hand, env.hand_velocity)
    _measure_errors(env)


@inlined
def _finish(env: Any, shared: Any) -> None:
    """Measure and score a control period after the physics of the arm; moves the part."""
    # What the period is compared with: errors are those before it.
    progress_before = _progress(env, shared)
    settled_before = env.settled_steps
    cost_rate_before = _lq_cost_rate(env)
    worst_ratio = finish_period(env, shared)
    _move_part(env, shared)
    hand_state_single(shared.lengths, shared.base, env.q, env.qd, env.hand, env.hand_velocity)
    _measure_errors(env)
    env.step += 1
    # Measures: J of eq 18 by the trapezoidal rule, settled periods, steady-state error.
    env.lq_cost += 0.5 * shared.control_period * (cost_rate_before + _lq_cost_rate(env))
    env.settled_steps = env.settled_steps + 1 if _error_in_tolerances(env, shared) <= 1.0 else 0
    if env.step > shared.horizon_steps - shared.hold_steps:
        env.steady_state_error = max(env.steady_state_error, env.error)
    env.success = env.settled_steps >= shared.hold_steps
    env.truncated = env.step >= shared.horizon_steps
    # Reward and observation.
    env.reward_terms[0] = _progress(env, shared) - progress_before
    env.reward_terms[1] = (env.settled_steps - settled_before) / shared.horizon_steps
    env.reward_terms[2] = shared.limit_penalty * limit_cost(worst_ratio, shared.limit_tolerance)
    sum_reward(env)


@inlined
def _move_part(env: Any, shared: Any) -> None:
    """Move the part by one control period with the velocity in the middle of it: exact for a constant acceleration."""
    for axis in range(2):
        velocity = env.part_velocity[axis] + 0.5 * shared.control_period * env.part_acceleration[axis]
        for _ in range(shared.substeps):
            env.part_position[axis] += velocity * shared.physics_step
        env.part_velocity[axis] += shared.control_period * env.part_acceleration[axis]


@private
def _measure_errors(env: Any) -> None:
    """Distance and relative velocity between part and hand."""
    dx, dy = env.part_position[0] - env.hand[0], env.part_position[1] - env.hand[1]
    dvx, dvy = env.part_velocity[0] - env.hand_velocity[0], env.part_velocity[1] - env.hand_velocity[1]
    env.error = math.sqrt(dx * dx + dy * dy)
    env.velocity_error = math.sqrt(dvx * dvx + dvy * dvy)


@private
def _error_in_tolerances(env: Any, shared: Any) -> float:
    """The larger of position and velocity error, each in units of its tolerance: settled means at most 1."""
    return float(max(env.error / shared.position_tolerance, env.velocity_error / shared.velocity_tolerance))


@private
def _progress(env: Any, shared: Any) -> float:
    """0 where settled, -1 where the error is `MAX_ERROR` tolerances or more, and linear in its logarithm between."""
    error = min(MAX_ERROR, max(1.0, _error_in_tolerances(env, shared)))
    return -math.log(error) / math.log(MAX_ERROR)


@private
def _lq_cost_rate(env: Any) -> float:
    """Integrand of eq 18, with lengths in units of the paper's path."""
    squares = env.error * env.error + env.velocity_error * env.velocity_error
    return float(squares / (LINE_LENGTH * LINE_LENGTH))


@inlined
def _observe(env: Any, shared: Any) -> None:
    """Write the observation."""
    seen = env.seen
    observe_joints(env)
    for axis in range(2):
        base, hand, part = shared.base[axis], env.hand[axis], env.part_position[axis]
        seen.hand[axis] = hand - base
        seen.part[axis] = part - base
        seen.part_error[axis] = part - hand
    copy_array(seen.part_velocity, env.part_velocity)
    copy_array(seen.part_acceleration, env.part_acceleration)
    if shared.relative_kernel != 0:
        call(shared.relative_kernel, env, shared)
    seen.time_left = (shared.horizon_steps - env.step) * shared.control_period
    seen.settled = env.settled_steps / shared.horizon_steps
    finish_observation(env, shared)


def _observe_relative(env: Any, shared: Any) -> None:
    """Write velocity and acceleration of the part relative to the hand into the physical values of the observation."""
    velocity, acceleration = env.seen.relative_velocity, env.seen.relative_acceleration
    for axis in range(2):
        velocity[axis] = env.part_velocity[axis] - env.hand_velocity[axis]
        acceleration[axis] = env.part_acceleration[axis]
    phi = w = alpha = 0.0
    for link in range(env.q.shape[0]):  # less the acceleration of the hand: each link's turns and is centripetal
        phi, w, alpha = phi + env.q[link], w + env.qd[link], alpha + env.qdd[link]
        dx, dy = shared.lengths[link] * math.cos(phi), shared.lengths[link] * math.sin(phi)
        acceleration[0] += dy * alpha + dx * w * w
        acceleration[1] -= dx * alpha - dy * w * w


RELATIVE = Kernel(_observe_relative, error_model="numpy")
"""``kernel(env, shared)``: observes the motion of the part relative to the hand."""


@private
def _observe_measured(copies: Any, model: Any) -> None:
    """Observe a copy of an environment's record through noisy measurements of the joints and of the part."""
    env, shared = copies[0], model[0]
    add_joint_noise(env, shared)
    add_camera_noise(env, env.step, 0, 2, env.part_position, env.camera_noise)
    add_camera_noise(env, env.step, 1, 2, env.part_velocity, env.camera_noise / shared.control_period)
    hand_state_single(shared.lengths, shared.base, env.q, env.qd, env.hand, env.hand_velocity)
    _observe(env, shared)


def _measure(batch: Any, model: Any, index: int) -> None:
    """Write an environment's observation from noisy measurements."""
    copies = np.empty(1, batch.dtype)
    copies[0] = batch[index]
    _observe_measured(copies, model)
    observed_through(batch[index], copies)


MEASURE = Kernel(_measure, error_model="numpy")
