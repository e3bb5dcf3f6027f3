"""Conditions of the search: clearance of the discs, joint limits, and holding the goal."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planners.compiled.calls import private
from planners.motion.double_integrator import (
    BRAKE,
    CRUISE,
    RISE,
    SPEED,
    along_profile,
    entry_time,
    fill_profile,
    rest_time,
)
from planners.robot.clearance import clearance_single
from planners.typing import Array

ROUNDING = 1e-9
"""Share by which a velocity of the lattice may exceed a limit by rounding."""

FAR_AHEAD = 1 << 20
"""Number of samples to skip where nothing moves."""


class World(NamedTuple):
    """The arm, its limits, and the discs.

    Attributes:
        lengths, base, link_radius: of the arm, m.
        coupling, weight: see :mod:`planners.robot.dynamics`.
        torque, velocity, acceleration: limits of the joints, each ``(2,)``, N m, rad/s and rad/s^2.
        middle, angle: middle of the joint ranges and half of their width, each ``(2,)``, rad.
        path: centres of the discs, ``(samples, k, 2)``, m.
        radii: ``(k,)``, m.
        pace: speed of the fastest disc, m/s.
        step: time between two samples of the path, s.
        margin: clearance kept at every sample, m.
    """

    lengths: Array
    base: Array
    link_radius: float
    coupling: Array
    weight: Array
    torque: Array
    velocity: Array
    acceleration: Array
    middle: Array
    angle: Array
    path: Array
    radii: Array
    pace: float
    step: float
    margin: float


class Goal(NamedTuple):
    """Where and when the hand can be held.

    Attributes:
        position: ``(2,)``, m.
        tolerance: m.
        hold: number of samples for which it must be held.
        windows: for each sample, the first one from it on at which the discs leave the goal free for a hold; the number
            of samples where there is none, ``(samples,)``.
        aims: postures to come to rest in, ``(aims, 2)``, rad.
        boxes: range of each elbow branch's joint angles with the hand in the tolerance, ``(branches, 2, 2)``, rad.
    """

    position: Array
    tolerance: float
    hold: int
    windows: NDArray[np.int64]
    aims: Array
    boxes: Array


@private
def next_window(world: World, goal: Goal, t: float) -> float:
    """First time from ``t`` on, s, at which a hold can begin; inf if there is none."""
    sample = int(t / world.step)
    if sample >= len(goal.windows) or goal.windows[sample] == len(goal.windows):
        return np.inf
    return max(t, float(goal.windows[sample] * world.step))


@private
def least_entry(world: World, goal: Goal, q: Array, qd: Array) -> float:
    """A lower bound of the time, s, until the hand is in the tolerance for good."""
    least = np.inf
    for branch in range(goal.boxes.shape[0]):
        longest = 0.0
        for j in range(2):
            low, high = goal.boxes[branch, j]
            longest = max(longest, entry_time(q[j], qd[j], low, high, world.velocity[j], world.acceleration[j]))
        least = min(least, longest)
    return least


@njit(cache=True, nogil=True)
def in_range(world: World, q: Array, qd: Array) -> bool:
    """Whether both joints keep their velocity limits and can brake within their ranges."""
    inside = True
    for j in range(2):
        stop = q[j] + 0.5 * qd[j] * abs(qd[j]) / world.acceleration[j]
        inside &= abs(qd[j]) <= world.velocity[j] * (1.0 + ROUNDING) and abs(stop - world.middle[j]) <= world.angle[j]
    return inside


@private
def gap_to_discs(world: World, sample: int, q: Array) -> float:
    """Clearance of the arm from the nearest disc, m."""
    gap = np.inf
    for k in range(world.radii.shape[0]):
        x, y = world.path[sample, k]
        gap = min(gap, clearance_single(world.lengths, world.base, world.link_radius, q, x, y, world.radii[k]))
    return gap


@private
def free_samples(world: World, gap: float, speed: float) -> int:
    """Number of next samples that cannot touch: the arm moves by at most ``speed`` (m/s), the discs by ``pace``."""
    way = (speed + world.pace) * world.step
    return int((gap - world.margin) / way) if gap - world.margin < FAR_AHEAD * way else FAR_AHEAD


@private
def step_is_free(world: World, first: int, samples: int, q0: Array, qd0: Array, qdd: Array, q: Array) -> bool:
    """Whether a step at constant acceleration keeps the margin and the torque limits; ``q`` is scratch."""
    end = samples * world.step
    w1 = max(abs(qd0[0]), abs(qd0[0] + qdd[0] * end))
    w2 = max(abs(qd0[1]), abs(qd0[1] + qdd[1] * end))
    speed = world.lengths[0] * w1 + world.lengths[1] * (w1 + w2)
    i = samples
    while i > 0:  # from its end: its start is the end of another step
        t = i * world.step
        for j in range(2):
            q[j] = q0[j] + t * (qd0[j] + 0.5 * t * qdd[j])
        gap = gap_to_discs(world, first + i, q)
        if gap < world.margin:
            return False
        i -= 1 + free_samples(world, gap, speed)
    for part in range(3):
        t = 0.5 * part * end
        q1, q2 = q0[0] + t * (qd0[0] + 0.5 * t * qdd[0]), q0[1] + t * (qd0[1] + 0.5 * t * qdd[1])
        if overload(world, q1, q2, qd0[0] + t * qdd[0], qd0[1] + t * qdd[1], qdd[0], qdd[1]) > 1.0:
            return False
    return True


@njit(cache=True, nogil=True)
def overload(world: World, q1: float, q2: float, w1: float, w2: float, a1: float, a2: float) -> float:
    """Worst |torque| / limit: :func:`planners.robot.dynamics.inverse_dynamics_single`, written out for two links."""
    c, s = math.cos(q2), math.sin(q2)
    inner, both = world.coupling[0, 0], world.coupling[0, 1]
    outer = world.coupling[1, 1]
    tau2 = outer * (a1 + a2) + both * (c * a1 + s * w1 * w1)
    tau1 = tau2 + inner * a1 + both * (c * (a1 + a2) - s * (w1 + w2) ** 2)
    if world.weight[0] != 0.0 or world.weight[1] != 0.0:
        pull = world.weight[1] * math.cos(q1 + q2)
        tau2 += pull
        tau1 += pull + world.weight[0] * math.cos(q1)
    return float(max(abs(tau1) / world.torque[0], abs(tau2) / world.torque[1]))


@private
def begin_rest(world: World, aim: Array, q: Array, qd: Array, together: bool, profiles: Array) -> None:
    """Fastest motions of both joints to rest at ``aim``, written to ``profiles``; of equal duration if ``together``."""
    duration = 0.0
    if together:
        for j in range(2):
            duration = max(duration, rest_time(aim[j] - q[j], qd[j], world.velocity[j], world.acceleration[j]))
    for j in range(2):
        fill_profile(aim[j] - q[j], qd[j], world.velocity[j], world.acceleration[j], duration, profiles[j])


@private
def entry_sample(
    world: World, goal: Goal, first: int, best: int, q0: Array, qd0: Array, profiles: Array, q: Array
) -> int:
    """Sample of the path from which a motion to rest keeps the hand in the tolerance; ``q`` is scratch.

    -1 if it touches a disc before the end of the hold, breaks a limit, or arrives no sooner than ``best``.
    """
    w1, w2 = max(abs(qd0[0]), abs(profiles[0, SPEED])), max(abs(qd0[1]), abs(profiles[1, SPEED]))
    speed = world.lengths[0] * w1 + world.lengths[1] * (w1 + w2)
    duration = max(
        profiles[0, RISE] + profiles[0, CRUISE] + profiles[0, BRAKE],
        profiles[1, RISE] + profiles[1, CRUISE] + profiles[1, BRAKE],
    )
    moving = math.ceil(duration / world.step)
    last = world.path.shape[0] - 1
    if best <= last:  # most are not there before the best: check that first
        posture_at(world, q0, qd0, profiles, (best - 1 - first) * world.step, q)
        if distance_to(goal, world, q) > goal.tolerance:
            return -1
    # walk along the samples until the hold is over, skipping those that cannot matter
    i = entry = 0
    while i <= entry + goal.hold:
        if first + entry >= best or first + entry + goal.hold > last:
            return -1
        posture_at(world, q0, qd0, profiles, i * world.step, q)
        gap = gap_to_discs(world, first + i, q)
        if gap < world.margin:
            return -1
        skip = free_samples(world, gap, speed if i < moving else 0.0)
        if i < moving:
            outside = distance_to(goal, world, q) - goal.tolerance
            if outside > 0.0:
                skip = min(skip, int(outside / (speed * world.step)))
                entry = i + skip + 1
            else:
                skip = 0
        i += skip + 1
    return first + entry if rest_keeps_limits(world, q0, qd0, profiles, moving) else -1


@private
def posture_at(world: World, q0: Array, qd0: Array, profiles: Array, t: float, q: Array) -> None:
    """Joint angles at a time of a motion to rest, written to ``q``."""
    for j in range(2):
        q[j] = q0[j] + along_profile(profiles[j], qd0[j], world.acceleration[j], t)[0]


@private
def distance_to(goal: Goal, world: World, q: Array) -> float:
    """Distance of the hand from the goal, m."""
    l1, l2 = world.lengths
    x = world.base[0] + l1 * math.cos(q[0]) + l2 * math.cos(q[0] + q[1]) - goal.position[0]
    y = world.base[1] + l1 * math.sin(q[0]) + l2 * math.sin(q[0] + q[1]) - goal.position[1]
    return math.hypot(x, y)


@private
def rest_keeps_limits(world: World, q0: Array, qd0: Array, profiles: Array, samples: int) -> bool:
    """Whether a motion to rest keeps the joint ranges and the torque limits at every sample."""
    for i in range(samples + 1):
        t = i * world.step
        way1, w1, a1 = along_profile(profiles[0], qd0[0], world.acceleration[0], t)
        way2, w2, a2 = along_profile(profiles[1], qd0[1], world.acceleration[1], t)
        q1, q2 = q0[0] + way1, q0[1] + way2
        if abs(q1 - world.middle[0]) > world.angle[0] or abs(q2 - world.middle[1]) > world.angle[1]:
            return False
        if overload(world, q1, q2, w1, w2, a1, a2) > 1.0:
            return False
    return True
