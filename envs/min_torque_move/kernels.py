"""The compiled kernels of MinTorqueMove: how an environment begins, advances, is scored and observed."""

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
from envs.uncertainty.kernels import add_joint_noise
from planners.compiled.calls import Kernel, call, copy_array, inlined, private
from planners.control.tracking import held_torque_single
from planners.motion.time_laws import SHAPES, rest_curve_single
from planners.quintic import quintic_effort

MAX_MISS = 1000.0
"""Error at the end, in tolerances, from which on the cost of a miss is constant."""

SHAPE_SCALE = 5.0
"""Scale of the actions that are coefficients of a motion, rad; divided by k + 1 for polynomial k, because higher ones
take more torque."""


def env_fields(n_joints: int) -> list[tuple[Any, ...]]:
    """What an environment's record holds for this task, besides what every task has."""
    return [
        ("start", "f8", (n_joints,)),
        ("goal", "f8", (n_joints,)),
        ("shape", "f8", (n_joints, SHAPES)),
        ("duration_steps", "i8"),
        ("quintic_l1", "f8"),
        ("quintic_peak", "f8", (n_joints,)),
        ("torque_l1", "f8"),
        ("torque_l2", "f8"),
        ("angle_error", "f8"),
        ("velocity_error", "f8"),
    ]


def run(batch: Any, model: Any, first: int, last: int, work: int) -> None:
    """Begin, advance or refresh environments ``first`` to ``last - 1``: see `entry_points`."""
    shared = model[0]
    for start in range(first, last, shared.pack):
        end = min(start + shared.pack, last)
        if work == ADVANCE:
            for index in range(start, end):
                _command(batch[index], shared)
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


reset_env, advance_batch, _ = entry_points(run)


@inlined
def _begin(env: Any, shared: Any) -> None:
    """Begin an episode in an environment whose posture, goal and duration are already set."""
    begin_episode(env, shared)
    copy_array(env.start, env.q)
    env.torque_l1 = env.torque_l2 = 0.0
    duration = env.duration_steps * shared.control_period
    env.quintic_l1 = quintic_effort(shared.coupling, shared.weight, env.q, env.goal, duration, env.quintic_peak)
    _measure_errors(env)


@inlined
def _command(env: Any, shared: Any) -> None:
    """Set the torques of the next control period: those of the ``action``, or of the motion it has chosen."""
    if shared.whole_motion:
        call(shared.motion_kernel, env, shared)
    else:
        for i in range(env.q.shape[0]):
            env.share[i] = env.action[i]
    command(env, shared, env.share)


@inlined
def _finish(env: Any, shared: Any) -> None:
    """Measure and score a control period after its physics."""
    worst_ratio = finish_period(env, shared)
    env.step += 1
    # Measures: PI1 and PI2, the integrals of the absolute and squared torques.
    spent = 0.0
    for i in range(env.q.shape[0]):
        spent += abs(env.tau[i]) * shared.control_period
        env.torque_l2 += env.tau[i] * env.tau[i] * shared.control_period
    env.torque_l1 += spent
    _measure_errors(env)
    env.terminated = env.step >= env.duration_steps
    miss = max(env.angle_error / shared.angle_tolerance, env.velocity_error / shared.velocity_tolerance)
    env.success = env.terminated and miss <= 1.0
    # Reward and observation.
    env.reward_terms[0] = -spent / env.quintic_l1
    env.reward_terms[1] = 0.0 - shared.miss_penalty * _miss_cost(miss) if env.terminated else 0.0
    env.reward_terms[2] = shared.limit_penalty * limit_cost(worst_ratio, shared.limit_tolerance)
    sum_reward(env)


def _follow_motion(env: Any, shared: Any) -> None:
    """Write the shares of the torque limits that track the motion chosen by the first action of the episode."""
    n, period = env.q.shape[0], shared.control_period
    # The first action holds the coefficients.
    if env.step == 0:
        for i in range(n):
            for k in range(SHAPES):
                env.shape[i, k] = SHAPE_SCALE / (k + 1.0) * min(1.0, max(-1.0, env.action[i * SHAPES + k]))
    duration, now = env.duration_steps * period, env.step * period
    q, qd, q_ahead, qd_ahead = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    rest_curve_single(env.shape, env.start, env.goal, duration, now, q, qd)
    rest_curve_single(env.shape, env.start, env.goal, duration, now + period, q_ahead, qd_ahead)
    # Computed torque: the mean acceleration of the motion over the period, and feedback.
    qdd, torque = np.empty(n), np.empty(n)
    for i in range(n):
        feedback = shared.position_gain * (q[i] - env.q[i]) + shared.velocity_gain * (qd[i] - env.qd[i])
        qdd[i] = (qd_ahead[i] - qd[i]) / period + feedback
    held_torque_single(shared.coupling, shared.weight, env.q, env.qd, qdd, period, torque)
    for i in range(n):
        env.share[i] = torque[i] / shared.limits[0, i]


FOLLOW_MOTION = Kernel(_follow_motion)


@inlined
def _miss_cost(miss: float) -> float:
    """0 within tolerance, 1 just outside, 2 at `MAX_MISS` tolerances, linear in the logarithm between."""
    return 0.0 if miss <= 1.0 else 1.0 + math.log(min(miss, MAX_MISS)) / math.log(MAX_MISS)


@private
def _measure_errors(env: Any) -> None:
    """Largest errors of any joint."""
    env.angle_error = env.velocity_error = 0.0
    for i in range(env.q.shape[0]):
        env.angle_error = max(env.angle_error, abs(env.q[i] - env.goal[i]))
        env.velocity_error = max(env.velocity_error, abs(env.qd[i]))


@inlined
def _observe(env: Any, shared: Any) -> None:
    """Write the observation."""
    seen = env.seen
    observe_joints(env)
    copy_array(seen.goal, env.goal)
    for i in range(env.q.shape[0]):
        seen.goal_error[i] = env.goal[i] - env.q[i]
        seen.torque_limit[i] = shared.limits[0, i]
    seen.time_left = (env.duration_steps - env.step) * shared.control_period
    seen.quintic_torque = env.quintic_l1 / (env.duration_steps * shared.control_period)
    finish_observation(env, shared)


@private
def _observe_measured(copies: Any, model: Any) -> None:
    """Observe a copy of an environment's record through noisy measurements of the joints."""
    env, shared = copies[0], model[0]
    add_joint_noise(env, shared)
    _observe(env, shared)


def _measure(batch: Any, model: Any, index: int) -> None:
    """Write an environment's observation from noisy measurements."""
    copies = np.empty(1, batch.dtype)
    copies[0] = batch[index]
    _observe_measured(copies, model)
    observed_through(batch[index], copies)


MEASURE = Kernel(_measure, error_model="numpy")
