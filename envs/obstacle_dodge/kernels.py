"""The compiled kernels of ObstacleDodge: how a lane begins, advances among its discs, is scored and observed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from envs.obstacle_dodge.paths import PATH_STEP
from envs.physics.actuation import command, finish_period
from envs.physics.episode import begin_episode, finish_observation, limit_cost, sum_reward
from envs.physics.world import read_joint_state, step_physics
from planners.robot.clearance import clearance_lane
from planners.robot.kinematics import hand_state_lane, two_link_branch


def lane_fields(samples: int, discs: int) -> list[tuple[Any, ...]]:
    """What a lane's record holds for this task: the path of each disc, ``(samples, discs, 2)``, among other things."""
    return [
        ("goal", "f8", (2,)),
        ("hand", "f8", (2,)),
        ("hand_velocity", "f8", (2,)),
        ("path", "f8", (samples, discs, 2)),
        ("radii", "f8", (discs,)),
        ("discs", "f8", (discs, 2)),
        ("disc_velocities", "f8", (discs, 2)),
        ("disc_velocities_before", "f8", (discs, 2)),
        ("start_distance", "f8"),
        ("distance", "f8"),
        ("clearance", "f8"),
        ("min_clearance", "f8"),
        ("held_steps", "i8"),
        ("collision", "?"),
    ]


MODEL_FIELDS: list[tuple[Any, ...]] = [
    ("link_radius", "f8"),
    ("tolerance", "f8"),
    ("hold_steps", "i8"),
    ("clearance_margin", "f8"),
    ("clearance_weight", "f8"),
    ("collision_penalty", "f8"),
    ("limit_tolerance", "f8"),
    ("limit_penalty", "f8"),
]
"""What the model record holds for this task."""


@njit(cache=True, nogil=True)
def reset_lane(lanes: Any, model: Any, index: int) -> None:
    """Begin an episode in one lane whose posture, goal and paths are already set."""
    lane, shared = lanes[index], model[0]
    begin_episode(lane, shared)
    lane.held_steps = 0
    lane.collision = False
    move_discs(lane, 0.0)
    lane.disc_velocities_before[:] = lane.disc_velocities
    lane.clearance = lane.min_clearance = measure_clearance(lane, shared)
    hand_state_lane(shared.lengths, shared.base, lane.q, lane.qd, lane.hand, lane.hand_velocity)
    lane.distance = _goal_distance(lane)
    lane.start_distance = max(lane.distance, shared.tolerance)
    _observe(lane, shared)


@njit(cache=True, nogil=True)
def advance_lanes(lanes: Any, model: Any, first: int, last: int) -> None:
    """Advance lanes ``first`` to ``last - 1`` by one control period under their ``action``."""
    shared = model[0]
    for index in range(first, last):
        lane = lanes[index]
        command(lane, shared, lane.action)
        lane.disc_velocities_before[:] = lane.disc_velocities
        closest = _move_among_discs(lane, shared)
        worst_ratio = finish_period(lane, shared)
        lane.step += 1
        lane.min_clearance = min(lane.min_clearance, closest)
        distance_before = lane.distance
        hand_state_lane(shared.lengths, shared.base, lane.q, lane.qd, lane.hand, lane.hand_velocity)
        lane.distance = _goal_distance(lane)
        lane.held_steps = lane.held_steps + 1 if lane.distance <= shared.tolerance else 0
        lane.collision = closest < 0.0
        lane.success = not lane.collision and lane.held_steps >= shared.hold_steps
        lane.terminated = lane.collision or lane.success
        lane.truncated = not lane.terminated and lane.step >= shared.horizon_steps
        _score(lane, shared, distance_before, closest, worst_ratio)
        _observe(lane, shared)


@njit(cache=True, nogil=True)
def _move_among_discs(lane: Any, shared: Any) -> float:
    """The physics of one period; the least clearance after any of its steps, m."""
    closest = np.inf
    for substep in range(shared.substeps):
        step_physics(lane, shared, lane.tau)
        read_joint_state(lane, shared)
        move_discs(lane, lane.step * shared.control_period + (substep + 1) * shared.physics_step)
        lane.clearance = measure_clearance(lane, shared)
        closest = min(closest, lane.clearance)
    return closest


@njit(cache=True, nogil=True)
def move_discs(lane: Any, t: float) -> None:
    """Put the discs of one lane where their paths are at time ``t``, s; their velocities are backward differences."""
    place = t / PATH_STEP + 1e-9  # a time that is a sample must not fall before it by rounding
    left = min(int(place), lane.path.shape[0] - 2)
    share = min(1.0, max(0.0, place - left))
    for disc in range(lane.radii.shape[0]):
        for axis in range(2):
            before, after = lane.path[left, disc, axis], lane.path[left + 1, disc, axis]
            lane.discs[disc, axis] = before + share * (after - before)
            if share < 1e-6 and left > 0:
                before, after = lane.path[left - 1, disc, axis], before
            lane.disc_velocities[disc, axis] = (after - before) / PATH_STEP


@njit(cache=True, nogil=True)
def measure_clearance(lane: Any, shared: Any) -> float:
    """Distance between the surfaces of the arm and of the nearest disc, m."""
    nearest = np.inf
    for disc in range(lane.radii.shape[0]):
        x, y = lane.discs[disc]
        gap = clearance_lane(shared.lengths, shared.base, shared.link_radius, lane.q, x, y, lane.radii[disc])
        nearest = min(nearest, gap)
    return nearest


@njit(cache=True, nogil=True)
def _goal_distance(lane: Any) -> float:
    return math.hypot(lane.goal[0] - lane.hand[0], lane.goal[1] - lane.hand[1])


@njit(cache=True, nogil=True)
def _score(lane: Any, shared: Any, distance_before: float, closest: float, worst_ratio: float) -> None:
    """Write the terms of the reward, in the task's order, and their sum."""
    too_close = min(1.0, max(0.0, 1.0 - closest / shared.clearance_margin))
    time_left = 1.0 - lane.step / shared.horizon_steps
    lane.reward_terms[0] = (distance_before - lane.distance) / lane.start_distance
    lane.reward_terms[1] = 1.0 + time_left if lane.success else 0.0
    lane.reward_terms[2] = 0.0 - shared.clearance_weight * shared.control_period * too_close
    lane.reward_terms[3] = 0.0 - shared.collision_penalty if lane.collision else 0.0
    lane.reward_terms[4] = shared.limit_penalty * limit_cost(worst_ratio, shared.limit_tolerance)
    sum_reward(lane)


@njit(cache=True, nogil=True)
def _observe(lane: Any, shared: Any) -> None:
    """Write the observation: the entries of the layout, in its order."""
    seen = lane.seen
    discs = lane.radii.shape[0]
    seen[0:2] = lane.q
    seen[2:4] = lane.qd
    seen[4:6] = lane.qdd
    for axis in range(2):
        seen[6 + axis] = lane.hand[axis] - shared.base[axis]
        seen[8 + axis] = lane.goal[axis] - shared.base[axis]
        seen[10 + axis] = lane.goal[axis] - lane.hand[axis]
    place = 12
    for disc in range(discs):
        for axis in range(2):
            seen[place + 2 * disc + axis] = lane.discs[disc, axis] - shared.base[axis]
            seen[place + 2 * discs + 2 * disc + axis] = lane.disc_velocities[disc, axis]
        seen[place + 4 * discs + disc] = lane.radii[disc]
    place += 5 * discs
    _observe_postures(lane, shared, place)
    _observe_from_links(lane, shared, place + 4)
    place += 4 + 12 * discs
    seen[place] = lane.clearance
    seen[place + 1] = (shared.horizon_steps - lane.step) * shared.control_period
    seen[place + 2] = min(1.0, lane.held_steps / shared.hold_steps)
    finish_observation(lane, shared)


@njit(cache=True, nogil=True)
def _observe_postures(lane: Any, shared: Any, place: int) -> None:
    """What is left to both postures with the hand at the goal."""
    x, y = lane.goal[0] - shared.base[0], lane.goal[1] - shared.base[1]
    for branch in range(2):
        q1, q2 = two_link_branch(shared.lengths[0], shared.lengths[1], x, y, 1.0 - 2.0 * branch)
        lane.seen[place + 2 * branch] = q1 - lane.q[0]
        lane.seen[place + 2 * branch + 1] = q2 - lane.q[1]


@njit(cache=True, nogil=True)
def _observe_from_links(lane: Any, shared: Any, place: int) -> None:
    """Discs as the links see them: position, velocity, acceleration and clearance, entry by entry."""
    seen = lane.seen
    discs = lane.radii.shape[0]
    velocities, accelerations, clearances = place + 4 * discs, place + 8 * discs, place + 10 * discs
    for disc in range(discs):
        x, y = lane.discs[disc, 0] - shared.base[0], lane.discs[disc, 1] - shared.base[1]
        vx, vy = lane.disc_velocities[disc]
        ax = (vx - lane.disc_velocities_before[disc, 0]) / shared.control_period
        ay = (vy - lane.disc_velocities_before[disc, 1]) / shared.control_period
        angle = 0.0
        for link in range(2):
            angle += lane.q[link]
            c, s = math.cos(angle), math.sin(angle)
            along, across = c * x + s * y, c * y - s * x
            at = 4 * disc + 2 * link
            seen[place + at], seen[place + at + 1] = along, across
            seen[velocities + at], seen[velocities + at + 1] = c * vx + s * vy, c * vy - s * vx
            if link == 0:
                seen[accelerations + 2 * disc] = c * ax + s * ay
                seen[accelerations + 2 * disc + 1] = c * ay - s * ax
            beyond = along - min(shared.lengths[link], max(0.0, along))
            gap = math.hypot(beyond, across) - shared.link_radius - lane.radii[disc]
            seen[clearances + 2 * disc + link] = gap
            x, y = x - shared.lengths[link] * c, y - shared.lengths[link] * s
