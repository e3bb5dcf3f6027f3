"""A second arm of the same kind in the space of the first: how its motion is drawn, and how near it is.

It is two capsules. Its joints go from rest to rest between random postures, each move by a quintic time law (see
`planners.motion.time_laws`) within the limits of velocity and acceleration. It does not see the first arm.

Policies observe it as `PER_LINK` discs along each link, with the velocities of their centres, in the places behind
those of the free discs. Their radius (`cover_radii`) is the least with which they cover the links from half a gap
beyond the base on. Collisions are of the capsules themselves.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from envs.batch.generators import uniform
from envs.obstacle_dodge.paths import PATH_STEP, SPAWN_CLEARANCE
from envs.physics.episode import table_of
from planners import Arm
from planners.compiled.calls import Kernel, inlined, private
from planners.robot.clearance import segment_distance
from planners.typing import Array

PER_LINK = 4
"""Discs along a link, as policies observe it: at quarters of its length, the last at its outer end."""

DISCS = 2 * PER_LINK
"""Discs of the second arm."""

BASE_FROM, BASE_TO = 1.35, 1.5
"""Distance between the bases, in units of the reach: so far that the second arm never comes nearer to the base of the
first than any disc (`NEAREST`), and near enough that the spaces of both overlap."""

SLOWEST, FASTEST = 0.4, 0.9
"""Range of the highest speed of a move, as a share of the velocity limits."""

TURN_CLEARANCE = 0.15
"""Least distance, in units of the reach, between a posture in which the second arm comes to rest and the first arm at
its goal."""

AIMED, AIM = 0.8, 0.15
"""Share of the moves that are aimed at the first arm: they bring the second hand at most so far, in units of the reach,
from a point of the first arm on its straight move to the goal."""

ASIDE = 1.0
"""Largest angle, seen from the first base, between a point of the first arm on its way and the second base, rad."""

TRIES = 1000
"""Postures to try for one that is clear; one that is aimed is given up after half of them."""

BASES = 20
"""Places of the base to try for one from which there is room for the motion."""

QUINTIC_TOP, QUINTIC_HARDEST = 15.0 / 8.0, 10.0 / math.sqrt(3.0)
"""Top speed and acceleration of the quintic time law of a change 1 within a time 1."""

_DRAWN, _NO_SECOND_ARM = 0, 3


def cover_radii(arm: Arm) -> Array:
    """Radii of the discs along the links of an arm, ``(DISCS,)``, m."""
    half_gaps = np.repeat(arm.length_array / (2.0 * PER_LINK), PER_LINK)
    return np.hypot(arm.link_radius, half_gaps)


@private
def joints_of(env: Any, discs: int) -> tuple[tuple[float, float], tuple[float, float], tuple[float, float]]:
    """Positions of base, elbow and hand of the second arm, m, where ``discs`` are the free discs."""
    elbow, hand = env.discs[discs + PER_LINK - 1], env.discs[discs + DISCS - 1]
    return (env.second_base[0], env.second_base[1]), (elbow[0], elbow[1]), (hand[0], hand[1])


def _gap(env: Any, shared: Any) -> float:
    """Distance between the surfaces of both arms of an environment, m; negative if they overlap."""
    own = _chain(shared.lengths, shared.base, env.q)
    return float(_apart(own, joints_of(env, shared.num_obstacles)) - 2.0 * shared.link_radius)


SECOND_ARM = Kernel(_gap, error_model="numpy")
"""``kernel(env, shared)``: the distance between the surfaces of both arms, m."""


@inlined
def _chain(lengths: Array, base: Any, q: Array) -> tuple[tuple[float, float], tuple[float, float], tuple[float, float]]:
    """Positions of base, elbow and hand of a two-link arm, m."""
    x, y = base[0] + lengths[0] * math.cos(q[0]), base[1] + lengths[0] * math.sin(q[0])
    phi = q[0] + q[1]
    return (base[0], base[1]), (x, y), (x + lengths[1] * math.cos(phi), y + lengths[1] * math.sin(phi))


@inlined
def _apart(own: Any, other: Any) -> float:
    """Distance between the axes of two arms, given by their joints, m."""
    nearest = np.inf
    for i in range(2):
        for j in range(2):
            nearest = min(nearest, segment_distance(own[i], own[i + 1], other[j], other[j + 1]))
    return nearest


def _draw_second_arms(draws: Any, arms: Any, first: int, last: int) -> None:
    """Draw the bases and the motions of the second arms, after the ends of the first arm's move have been drawn."""
    for index in range(first, last):
        for _ in range(BASES):
            draws[index].found = _draw_motion(draws[index], arms[0], np.empty((2, 2)))
            if draws[index].found == _DRAWN:
                break


DRAW_SECOND_ARM = Kernel(_draw_second_arms, error_model="numpy")
"""Writes `second_base` of draws (`envs.obstacle_dodge.starts`) and the last `DISCS` columns of their paths."""


@inlined
def _draw_motion(draw: Any, arm: Any, q: Array) -> int:
    """Draw the base and the motion of a second arm; whether there is room for it."""
    generator = draw.generator
    path = table_of(draw, (arm.samples, arm.points, 2))
    x, y = _point_on_way(generator, draw, arm)
    direction = math.atan2(y, x) + ASIDE * (2.0 * uniform(generator) - 1.0)
    distance = BASE_FROM + (BASE_TO - BASE_FROM) * uniform(generator)
    base = distance * math.cos(direction), distance * math.sin(direction)
    # the middle of the first joint's range points at the other base
    heading = direction + math.pi - 0.5 * (arm.lowest[0] + arm.highest[0])
    if not _draw_clear(generator, draw, arm, base, heading, q[1], True, False):
        return _NO_SECOND_ARM
    begin, end = 0.0, 0.0
    for sample in range(arm.samples):
        now = sample * PATH_STEP
        if now >= end:
            q[0, 0], q[0, 1] = q[1, 0], q[1, 1]
            if not _draw_clear(generator, draw, arm, base, heading, q[1], False, uniform(generator) < AIMED):
                return _NO_SECOND_ARM
            pace = SLOWEST + (FASTEST - SLOWEST) * uniform(generator)
            begin, end = now, now + _duration(arm, q, pace)
        s = (now - begin) / (end - begin)
        share = s * s * s * (10.0 + s * (6.0 * s - 15.0))
        inner = q[0, 0] + share * (q[1, 0] - q[0, 0])
        outer = inner + q[0, 1] + share * (q[1, 1] - q[0, 1])
        _write_discs(arm, base, heading + inner, heading + outer, path[sample])
    for axis in range(2):
        draw.second_base[axis] = arm.length * base[axis] + arm.base[axis]
    return _DRAWN


@private
def _draw_clear(
    generator: Any, draw: Any, arm: Any, base: Any, heading: float, q: Array, begins: bool, aimed: bool
) -> bool:
    """Draw a posture clear of the first arm at its goal, and at its start if the episode begins; whether one is found.

    ``aimed`` brings the hand near the first arm on its way.
    """
    start, goal = _chain(arm.unit_lengths, arm.origin, draw.start), _chain(arm.unit_lengths, arm.origin, draw.end)
    for tried in range(TRIES):
        for i in range(2):
            q[i] = arm.lowest[i] + (arm.highest[i] - arm.lowest[i]) * uniform(generator)
        inner = heading + q[0]
        elbow = base[0] + arm.unit_lengths[0] * math.cos(inner), base[1] + arm.unit_lengths[0] * math.sin(inner)
        outer = inner + q[1]
        hand = elbow[0] + arm.unit_lengths[1] * math.cos(outer), elbow[1] + arm.unit_lengths[1] * math.sin(outer)
        if aimed and tried < TRIES // 2:
            x, y = _point_on_way(generator, draw, arm)
            if math.hypot(x - hand[0], y - hand[1]) > AIM:
                continue
        joints, thick = (base, elbow, hand), 2.0 * arm.unit_link_radius
        if _apart(goal, joints) < thick + TURN_CLEARANCE:
            continue
        if not begins or _apart(start, joints) >= thick + SPAWN_CLEARANCE:
            return True
    return False


@private
def _point_on_way(generator: Any, draw: Any, arm: Any) -> tuple[float, float]:
    """Draw a point of the outer link of the first arm on its straight move to the goal."""
    share, place = uniform(generator), uniform(generator)
    inner = draw.start[0] + share * draw.change[0]
    outer = inner + draw.start[1] + share * draw.change[1]
    x = arm.unit_lengths[0] * math.cos(inner) + place * arm.unit_lengths[1] * math.cos(outer)
    y = arm.unit_lengths[0] * math.sin(inner) + place * arm.unit_lengths[1] * math.sin(outer)
    return x, y


@inlined
def _duration(arm: Any, q: Array, pace: float) -> float:
    """Time of a move between two postures within the limits, in the arm's unit of time; at least a sample."""
    time = PATH_STEP
    for i in range(2):
        change = abs(q[1, i] - q[0, i])
        top, hardest = pace * arm.velocity[i] * arm.time, arm.acceleration[i] * arm.time * arm.time
        time = max(time, QUINTIC_TOP * change / top, math.sqrt(QUINTIC_HARDEST * change / hardest))
    return time


@inlined
def _write_discs(arm: Any, base: Any, inner: float, outer: float, points: Array) -> None:
    """Write the centres of the discs along the links, whose directions are given, m."""
    x, y = base
    for link in range(2):
        angle = inner if link == 0 else outer
        dx, dy = arm.unit_lengths[link] * math.cos(angle), arm.unit_lengths[link] * math.sin(angle)
        for place in range(PER_LINK):
            share, at = (place + 1) / PER_LINK, arm.discs + link * PER_LINK + place
            points[at, 0] = arm.length * (x + share * dx) + arm.base[0]
            points[at, 1] = arm.length * (y + share * dy) + arm.base[1]
        x, y = x + dx, y + dy
