"""The compiled kernels of ObstacleDodge: how an environment begins, advances, is scored and observed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from envs.physics.actuation import command, finish_period
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
    table_of,
)
from envs.physics.rigid_bodies import arriving, read_joint_state, step_physics
from envs.uncertainty.kernels import add_camera_noise, add_joint_noise
from planners.compiled.calls import Kernel, call, call_real, copy_array, inlined, private
from planners.robot.clearance import clearance_single
from planners.robot.kinematics import hand_state_single, turned_towards, two_link_branch


def env_fields(discs: int) -> list[tuple[Any, ...]]:
    """Fields of an environment's record. Its table holds the path of each disc, ``(samples, discs, 2)``.

    The last of the discs are those along the second arm, if there is one (`envs.obstacle_dodge.second_arm`).
    """
    return [
        ("goal", "f8", (2,)),
        ("postures", "f8", (2, 2)),
        ("hand", "f8", (2,)),
        ("hand_velocity", "f8", (2,)),
        ("radii", "f8", (discs,)),
        ("discs", "f8", (discs, 2)),
        ("disc_velocities", "f8", (discs, 2)),
        ("disc_velocities_before", "f8", (discs, 2)),
        ("second_base", "f8", (2,)),
        ("start_distance", "f8"),
        ("distance", "f8"),
        ("clearance", "f8"),
        ("closest", "f8"),
        ("min_clearance", "f8"),
        ("held_steps", "i8"),
        ("collision", "?"),
    ]


def run(batch: Any, model: Any, first: int, last: int, work: int) -> None:
    """Begin, advance or refresh environments ``first`` to ``last - 1``: see `entry_points`."""
    shared = model[0]
    for start in range(first, last, shared.pack):
        end = min(start + shared.pack, last)
        if work == ADVANCE:
            for index in range(start, end):
                _command(batch[index], shared)
            if shared.closed_form:
                call(shared.physics_kernel, batch, model, start, end, shared.substeps)
            else:
                for index in range(start, end):
                    _move_among_discs(batch[index], shared)
        for index in range(start, end):
            env = batch[index]
            if work == ADVANCE:
                _finish(env, shared)
            else:
                if work == BEGIN:
                    _begin(env, shared)
                _find_postures(env, shared)
                env.clearance, env.distance = measure_clearance(env, shared), _goal_distance(env)
                if work == BEGIN:
                    env.min_clearance, env.start_distance = env.clearance, max(env.distance, shared.tolerance)
            if shared.measure_kernel == 0:
                _observe(env, shared)
            else:
                call(shared.measure_kernel, batch, model, index)


reset_env, advance_batch, refresh_env = entry_points(run)


@inlined
def _begin(env: Any, shared: Any) -> None:
    """Begin an episode in an environment whose posture, goal and paths are already set."""
    begin_episode(env, shared)
    env.held_steps = 0
    env.collision = False
    move_discs(env, shared, 0.0)
    copy_array(env.disc_velocities_before, env.disc_velocities)
    hand_state_single(shared.lengths, shared.base, env.q, env.qd, env.hand, env.hand_velocity)


@inlined
def _command(env: Any, shared: Any) -> None:
    """Turn the ``action`` into the torques of the next period."""
    command(env, shared, env.action)
    copy_array(env.disc_velocities_before, env.disc_velocities)


@inlined
def _move_among_discs(env: Any, shared: Any) -> None:
    """The physics of one period with Pymunk, and the least clearance after any of its steps.

    `envs.obstacle_dodge.closed_form` does the same in closed form.
    """
    env.closest = np.inf
    for substep in range(shared.substeps):
        step_physics(env, shared, arriving(env, shared, env.tau))
        read_joint_state(env, shared)
        move_discs(env, shared, env.step * shared.control_period + (substep + 1) * shared.physics_step)
        env.clearance = measure_clearance(env, shared)
        env.closest = min(env.closest, env.clearance)


@inlined
def _finish(env: Any, shared: Any) -> None:
    """Score a control period after the physics of the arm among the moving discs."""
    worst_ratio = finish_period(env, shared)
    env.step += 1
    # Measures: clearance, distance to the goal, periods at the goal.
    env.min_clearance = min(env.min_clearance, env.closest)
    distance_before = env.distance
    hand_state_single(shared.lengths, shared.base, env.q, env.qd, env.hand, env.hand_velocity)
    env.distance = _goal_distance(env)
    env.held_steps = env.held_steps + 1 if env.distance <= shared.tolerance else 0
    # End of the episode, reward and observation.
    env.collision = env.closest < 0.0
    env.success = not env.collision and env.held_steps >= shared.hold_steps
    env.terminated = env.collision or env.success
    env.truncated = not env.terminated and env.step >= shared.horizon_steps
    _score(env, shared, distance_before, worst_ratio)


@private
def move_discs(env: Any, shared: Any, t: float) -> None:
    """Move the discs of an environment along their paths to time ``t``, s; velocities are backward differences."""
    path, path_step = table_of(env, (shared.path_samples, env.radii.shape[0], 2)), shared.path_step
    left, share = sample_at(shared, t)
    for disc in range(env.radii.shape[0]):
        for axis in range(2):
            before, after = path[left, disc, axis], path[left + 1, disc, axis]
            env.discs[disc, axis] = before + share * (after - before)
            if share < 1e-6 and left > 0:
                before, after = path[left - 1, disc, axis], before
            env.disc_velocities[disc, axis] = (after - before) / path_step


@inlined
def sample_at(shared: Any, t: float) -> tuple[int, float]:
    """The sample of the discs' paths before time ``t``, s, and the share of the way to the next one."""
    place = t / shared.path_step + 1e-9  # a time that is a sample must not fall before it by rounding
    left = max(0, min(int(place), shared.path_samples - 2))
    return left, min(1.0, max(0.0, place - left))


@private
def measure_clearance(env: Any, shared: Any) -> float:
    """Distance between the surfaces of the arm and of the nearest disc or the second arm, m."""
    nearest = np.inf
    for disc in range(shared.num_obstacles):
        x, y = env.discs[disc, 0], env.discs[disc, 1]
        gap = clearance_single(shared.lengths, shared.base, shared.link_radius, env.q, x, y, env.radii[disc])
        nearest = min(nearest, gap)
    if shared.second_arm_kernel != 0:
        nearest = min(nearest, call_real(shared.second_arm_kernel, env, shared))
    return nearest


@private
def _goal_distance(env: Any) -> float:
    return math.hypot(env.goal[0] - env.hand[0], env.goal[1] - env.hand[1])


@inlined
def _score(env: Any, shared: Any, distance_before: float, worst_ratio: float) -> None:
    """Write the terms of the reward, in the task's order, and their sum."""
    too_close = min(1.0, max(0.0, 1.0 - env.closest / shared.clearance_margin))
    time_left = 1.0 - env.step / shared.horizon_steps
    env.reward_terms[0] = (distance_before - env.distance) / env.start_distance
    env.reward_terms[1] = 1.0 + time_left if env.success else 0.0
    env.reward_terms[2] = 0.0 - shared.clearance_weight * shared.control_period * too_close
    env.reward_terms[3] = 0.0 - shared.collision_penalty if env.collision else 0.0
    env.reward_terms[4] = shared.limit_penalty * limit_cost(worst_ratio, shared.limit_tolerance)
    sum_reward(env)


@inlined
def _observe(env: Any, shared: Any) -> None:
    """Write the observation."""
    seen = env.seen
    observe_joints(env)
    copy_array(seen.obstacle_velocity, env.disc_velocities)
    copy_array(seen.obstacle_radius, env.radii)
    for axis in range(2):
        seen.hand[axis] = env.hand[axis] - shared.base[axis]
        seen.goal[axis] = env.goal[axis] - shared.base[axis]
        seen.goal_error[axis] = env.goal[axis] - env.hand[axis]
    for disc in range(env.radii.shape[0]):
        for axis in range(2):
            seen.obstacle[disc, axis] = env.discs[disc, axis] - shared.base[axis]
        _observe_from_links(env, shared, disc)
    for branch in range(2):
        for joint in range(2):
            seen.posture_error[branch, joint] = env.postures[branch, joint] - env.q[joint]
    seen.clearance = env.clearance
    seen.time_left = (shared.horizon_steps - env.step) * shared.control_period
    seen.held = min(1.0, env.held_steps / shared.hold_steps)
    finish_observation(env, shared)


@private
def _find_postures(env: Any, shared: Any) -> None:
    """Write both postures with the hand at the goal, near the middle of the joint ranges, rad."""
    x, y = env.goal[0] - shared.base[0], env.goal[1] - shared.base[1]
    for branch in range(2):
        q1, q2 = two_link_branch(shared.lengths[0], shared.lengths[1], x, y, 1.0 - 2.0 * branch)
        env.postures[branch, 0] = turned_towards(q1, shared.angle_middle[0])
        env.postures[branch, 1] = turned_towards(q2, shared.angle_middle[1])


@inlined
def _observe_from_links(env: Any, shared: Any, disc: int) -> None:
    """Write position, velocity, acceleration and clearance of a disc in the frames of the links."""
    seen = env.seen
    x, y = env.discs[disc, 0] - shared.base[0], env.discs[disc, 1] - shared.base[1]
    vx, vy = env.disc_velocities[disc, 0], env.disc_velocities[disc, 1]
    ax = (vx - env.disc_velocities_before[disc, 0]) / shared.control_period
    ay = (vy - env.disc_velocities_before[disc, 1]) / shared.control_period
    angle, radius = 0.0, env.radii[disc]
    for link in range(2):
        length = shared.lengths[link]
        angle += env.q[link]
        c, s = math.cos(angle), math.sin(angle)
        along, across = c * x + s * y, c * y - s * x
        seen.obstacle_in_link[disc, link, 0], seen.obstacle_in_link[disc, link, 1] = along, across
        seen.obstacle_velocity_in_link[disc, link, 0] = c * vx + s * vy
        seen.obstacle_velocity_in_link[disc, link, 1] = c * vy - s * vx
        if link == 0:
            seen.obstacle_acceleration[disc, 0] = c * ax + s * ay
            seen.obstacle_acceleration[disc, 1] = c * ay - s * ax
        beyond = along - min(length, max(0.0, along))
        seen.link_clearance[disc, link] = math.hypot(beyond, across) - shared.link_radius - radius
        x, y = x - length * c, y - length * s


@private
def _observe_measured(copies: Any, model: Any) -> None:
    """Observe a copy of an environment's record through noisy measurements of the joints, the goal and the discs."""
    env, shared = copies[0], model[0]
    add_joint_noise(env, shared)
    discs, noise = env.radii.shape[0], env.camera_noise
    points, rate = 2 * discs + 1, noise / shared.control_period
    for disc in range(discs):
        add_camera_noise(env, env.step, 2 * disc, points, env.discs[disc], noise)
        add_camera_noise(env, env.step, 2 * disc + 1, points, env.disc_velocities[disc], rate)
        before = max(0, env.step - 1)
        add_camera_noise(env, before, 2 * disc + 1, points, env.disc_velocities_before[disc], rate)
    add_camera_noise(env, env.step, 2 * discs, points, env.goal, noise)
    _find_postures(env, shared)
    hand_state_single(shared.lengths, shared.base, env.q, env.qd, env.hand, env.hand_velocity)
    env.clearance = measure_clearance(env, shared)
    _observe(env, shared)


def _measure(batch: Any, model: Any, index: int) -> None:
    """Write an environment's observation from noisy measurements."""
    copies = np.empty(1, batch.dtype)
    copies[0] = batch[index]
    _observe_measured(copies, model)
    observed_through(batch[index], copies)


MEASURE = Kernel(_measure, error_model="numpy")
