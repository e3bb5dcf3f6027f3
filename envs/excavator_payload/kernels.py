"""The compiled kernels of ExcavatorPayload: how an environment begins, advances, is scored and observed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from envs.excavator_payload.reference import HIGHEST, LOOKAHEAD, LOWEST, empty_machine, reference_at
from envs.excavator_payload.world import N_JOINTS, change_load, move_links, tip_of
from envs.hashing import normal_pair
from envs.physics.actuation import command, finish_period
from envs.physics.episode import ADVANCE, BEGIN, REFRESH, clear_episode, entry_points, finish_observation, sum_reward
from envs.physics.rigid_bodies import begin_commands
from planners.compiled.calls import Kernel, call, clear_array, copy_array, inlined, new_array, private
from planners.excavator.newton_euler import torque_single
from planners.typing import Array

RESIDUAL_SHARE = np.array([0.4, 0.4, 0.3])
"""Share of the torque limits that an action of 1 adds in residual mode."""

FASTEST = 6.0
"""Joint velocity at which an episode ends as failed, rad/s."""
STRAY = math.radians(30.0)
"""Distance outside the range of the waypoints at which an episode ends as failed, rad."""


ENV_FIELDS: list[tuple[Any, ...]] = [
    ("payload_inertia", "f8"),
    ("pick_step", "i8"),
    ("drop_step", "i8"),
    ("reference", "f8", (3, N_JOINTS)),
    ("ahead", "f8", (3, N_JOINTS)),
    ("measured", "f8", (2, N_JOINTS)),
    ("error_integral", "f8", (N_JOINTS,)),
    ("held_action", "f8", (N_JOINTS,)),
    ("leg", "i8"),
    ("tip", "f8", (2,)),
    ("wanted_tip", "f8", (2,)),
    ("tip_error", "f8"),
    ("judged_after", "i8"),
    ("judged_steps", "i8"),
    ("tip_squares", "f8"),
    ("tip_max", "f8"),
    ("joint_squares", "f8"),
    ("waypoint_error", "f8"),
    ("torque_l1", "f8"),
]
"""What an environment's record holds for this task, besides its physics and its reference."""


def run(batch: Any, model: Any, first: int, last: int, work: int) -> None:
    """Begin, advance or refresh environments ``first`` to ``last - 1``: see `entry_points`."""
    shared = model[0]
    for start in range(first, last, shared.pack):
        end = min(start + shared.pack, last)
        if work == ADVANCE:
            for index in range(start, end):
                _command(batch[index], shared)
            move_links(batch, model, start, end)
        for index in range(start, end):
            env = batch[index]
            if work == ADVANCE:
                _finish(env, shared)
            elif work == BEGIN:
                _begin(env, shared)
            _measure(env, shared)
            if work == ADVANCE:
                _score(env, shared)
            if shared.estimated and work != REFRESH:
                call(shared.estimate_kernel, env, shared)
            _observe(env, shared)


reset_env, advance_batch, _ = entry_points(run)


@inlined
def _begin(env: Any, shared: Any) -> None:
    """Begin an episode in an environment whose reference, payload and noise are already set.

    The drives begin with the torque that holds the empty machine, which does not depend on the payload.
    """
    copy_array(env.q, env.waypoints[0])
    clear_episode(env)
    _hold(env, env.pick_step == 0)
    call(shared.place_kernel, env, shared)
    clear_array(env.ahead)
    copy_array(env.ahead[0], env.q)
    call(shared.torque_kernel, shared, 0, env.ahead, env.tau)
    begin_commands(env)
    copy_array(env.drive_torque, env.tau)
    clear_array(env.error_integral)
    for i in range(N_JOINTS):
        env.held_action[i] = 0.0 if shared.residual else env.tau[i] / shared.limits[0, i]
    env.leg = 1
    env.judged_after = shared.judged_after
    env.judged_steps = 0
    env.tip_squares = env.tip_max = env.joint_squares = env.waypoint_error = env.torque_l1 = 0.0


@inlined
def _command(env: Any, shared: Any) -> None:
    """Pick up or drop the payload where that is due, and turn the ``action`` into the torques of the next period."""
    if env.step == env.drop_step or (env.step == env.pick_step and env.step > 0):
        _hold(env, env.step == env.pick_step)
        if not shared.closed_form:
            change_load(env, shared)
        env.judged_after = max(env.judged_after, env.step + shared.settling_steps)
    command(env, shared, env.action)
    if shared.residual:
        call(shared.residual_kernel, env, shared)


@inlined
def _finish(env: Any, shared: Any) -> None:
    """Measure a control period after its physics: torque, and the integral of the error observed before."""
    finish_period(env, shared)
    env.step += 1
    for i in range(N_JOINTS):
        env.torque_l1 += shared.control_period * abs(env.tau[i])
        env.error_integral[i] += shared.control_period * (env.reference[0, i] - env.measured[0, i])


@inlined
def _score(env: Any, shared: Any) -> None:
    """Judge the tip error, and write the end of the episode and the reward."""
    _judge(env)
    # End of the episode, and reward.
    env.terminated = _out_of_bounds(env)
    env.truncated = env.step >= shared.horizon_steps and not env.terminated
    env.success = env.truncated and _within(env, shared)
    env.reward_terms[0] = shared.step_reward * (1.0 - min(1.0, env.tip_error / shared.reward_distance))
    env.reward_terms[1] = -shared.step_reward * shared.smoothness_weight * _change_of_action(env)
    env.reward_terms[2] = -shared.failure_penalty if env.terminated else 0.0
    sum_reward(env)


@private
def _hold(env: Any, loaded: bool) -> None:
    """Set the current load: the payload, or nothing."""
    env.load = env.payload if loaded else 0.0
    env.load_inertia = env.payload_inertia if loaded else 0.0


@inlined
def _change_of_action(env: Any) -> float:
    """Square of the change of the action since the last period; keeps the action for the next."""
    change = 0.0
    for i in range(N_JOINTS):
        share = min(1.0, max(-1.0, env.action[i]))
        step = share - env.held_action[i]
        change += step * step
        env.held_action[i] = share
    return change


def _add_to_controller(env: Any, shared: Any) -> None:
    """Write the controller's torques plus the action's, within the limits."""
    tau = new_array(N_JOINTS)
    _empty_bucket_torque(shared, env.measured[0], env.measured[1], env.reference, tau)
    for i in range(N_JOINTS):
        limit = shared.limits[0, i]
        wanted = tau[i] + RESIDUAL_SHARE[i] * limit * min(1.0, max(-1.0, env.action[i]))
        env.tau[i] = min(limit, max(-limit, wanted))


ADD_TO_CONTROLLER = Kernel(_add_to_controller)


@inlined
def _empty_bucket_torque(model: Any, q: Array, qd: Array, reference: Array, tau: Array) -> None:
    """Slotine and Li's controller for the empty bucket, without adaptation, written to ``tau`` ``(n,)``, N m."""
    qd_r, qdd_r, nothing = new_array(N_JOINTS), new_array(N_JOINTS), new_array(10)
    clear_array(nothing)
    for i in range(N_JOINTS):
        qd_r[i] = reference[1, i] + model.bandwidth[i] * (reference[0, i] - q[i])
        qdd_r[i] = reference[2, i] + model.bandwidth[i] * (reference[1, i] - qd[i])
    torque_single(empty_machine(model), nothing, q, qd, qd_r, qdd_r, tau)
    for i in range(N_JOINTS):
        tau[i] += model.damping[i] * (qd_r[i] - qd[i])


@private
def add_noise(key: int, step: int, deviations: tuple[float, float], measured: Array) -> None:
    """Add noise to ``measured`` ``(2, n)``: angles and velocities, with two standard ``deviations``."""
    n = measured.shape[1]
    for i in range(n):
        angle, velocity = normal_pair(key, step * n + i)
        measured[0, i] += deviations[0] * angle
        measured[1, i] += deviations[1] * velocity


@inlined
def _measure(env: Any, shared: Any) -> None:
    """Update the reference, the noisy measurements of the joints, and the true tip error."""
    reference_at(env, shared, float(env.step), env.reference)
    copy_array(env.measured[0], env.q)
    copy_array(env.measured[1], env.qd)
    add_noise(env.noise_key, env.step, (env.encoder_noise, env.velocity_noise), env.measured)
    tip_of(shared, env.q[0], env.q[1], env.q[2], env.tip)
    tip_of(shared, env.reference[0, 0], env.reference[0, 1], env.reference[0, 2], env.wanted_tip)
    env.tip_error = math.hypot(env.tip[0] - env.wanted_tip[0], env.tip[1] - env.wanted_tip[1])


@inlined
def _judge(env: Any) -> None:
    """Add this step to the errors of the episode, unless the payload has changed too recently."""
    judged = env.step > env.judged_after
    if judged:
        env.judged_steps += 1
        env.tip_squares += env.tip_error * env.tip_error
        env.tip_max = max(env.tip_max, env.tip_error)
        for i in range(N_JOINTS):
            error = env.reference[0, i] - env.q[i]
            env.joint_squares += error * error
    if env.step == env.due[env.leg]:
        if judged:
            env.waypoint_error = max(env.waypoint_error, env.tip_error)
        env.leg = min(env.leg + 1, env.n_waypoints - 1)


@inlined
def _within(env: Any, shared: Any) -> bool:
    """Whether the judged errors are within the tolerances."""
    squares = shared.rms_tolerance * shared.rms_tolerance * env.judged_steps
    return bool(env.judged_steps > 0 and env.tip_squares <= squares and env.tip_max <= shared.peak_tolerance)


@inlined
def _out_of_bounds(env: Any) -> bool:
    """Whether a joint is too fast or too far outside the range of the waypoints."""
    for i in range(N_JOINTS):
        inside = LOWEST[i] - STRAY <= env.q[i] <= HIGHEST[i] + STRAY
        if not inside or abs(env.qd[i]) > FASTEST:
            return True
    return False


@inlined
def _observe(env: Any, shared: Any) -> None:
    """Write the observation."""
    seen = env.seen
    ahead = env.ahead
    for k in range(len(LOOKAHEAD)):
        reference_at(env, shared, env.step + LOOKAHEAD[k] / shared.control_period, ahead)
        for i in range(N_JOINTS):
            seen.reference_ahead[k, i] = ahead[0, i] - env.reference[0, i]
    reference, measured = env.reference, env.measured
    copy_array(seen.error_integral, env.error_integral)
    copy_array(seen.joint_position, measured[0])
    copy_array(seen.joint_velocity, measured[1])
    copy_array(seen.reference_velocity, reference[1])
    copy_array(seen.reference_acceleration, reference[2])
    copy_array(seen.waypoint, env.waypoints[env.leg])
    for i in range(N_JOINTS):
        seen.reference_error[i] = reference[0, i] - measured[0, i]
        seen.last_torque[i] = env.tau[i] / shared.limits[0, i]
    seen.waypoint_time = max(0.0, (env.due[env.leg] - env.step) * shared.control_period)
    seen.time_left = (shared.horizon_steps - env.step) * shared.control_period
    finish_observation(env, shared)
