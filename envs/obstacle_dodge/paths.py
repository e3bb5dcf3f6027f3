"""Random paths of discs around an arm, each drawn whole before the episode begins.

A path is the centre of a disc at every `PATH_STEP`, straight in between. Three kinds are drawn:

* ``waypoints``: legs between points, most of them aimed at the arm and ending behind it.
* ``passes``: straight through the workspace, aimed at the arm, to the rim or the base, and back again.
* ``wander``: a random velocity around zero, between soft walls.

Lengths and times are those of the task's own arm; other arms have other units (`envs.obstacle_dodge.scale`).

A disc is aimed at the place of a point of the arm at the disc's arrival, if the arm moves straight to its goal.
"""

from __future__ import annotations

import math
from typing import Any, Literal, get_args

import numpy as np

from envs.batch.generators import below, normal, uniform
from envs.physics.episode import table_of
from planners.compiled.calls import Kernel, inlined, private
from planners.motion.time_laws import trapezoid_share
from planners.robot.clearance import clearance_single
from planners.typing import Array

Kind = Literal["waypoints", "passes", "wander"]
KINDS: tuple[Kind, ...] = get_args(Kind)
_WAYPOINTS, _PASSES, _WANDER = 0, 1, 2  # positions in KINDS

PATH_STEP = 0.01
"""Time between two samples of a path, s."""

NEAREST, FARTHEST = 0.32, 1.3
"""Least and largest distance of the centre of a disc from the base of the arm, m."""

SLOWEST, FASTEST = 0.2, 1.0
"""Range of the drawn speeds, m/s."""

LAG = 0.2
"""Time constant with which a disc follows its commanded velocity, s."""

SPAWN_CLEARANCE = 0.30
"""Least distance between disc and arm at the start, m."""

AIMED = 0.7
"""Share of the legs between waypoints, after the first, that are aimed at the arm; the first always is."""

ARRIVED = 0.15
"""Distance from the end of a leg at which the next begins, m."""

AIMS = 8
"""Number of points of the arm to try for one that the base does not hide."""

SHORTEST_LEG = 0.3
"""Least length of a leg, m."""

CORRELATION_TIME, WANDER_SPEED = 0.8, 0.8
"""Correlation time, s, and root mean square, m/s, of a wandering velocity."""

WALL, WALL_STIFFNESS = 0.15, 12.0
"""Width of the soft walls in front of NEAREST and FARTHEST, m, and their stiffness, 1/s^2."""

_INSIDE, _OUTSIDE, _NOT_FAST = (NEAREST + WALL + 1e-6) ** 2, (FARTHEST - WALL - 1e-6) ** 2, (FASTEST - 1e-6) ** 2
"""Squares of distances from the base between which no wall pushes, and of a speed that is not too fast: a square costs
less than a distance."""

LEAD_ITERATIONS = 6
"""Fixed-point iterations between the place of an aim and the time of arrival there."""


@inlined
def draw_kind(generator: Any) -> int:
    """Draw an index into `KINDS`."""
    return below(generator, len(KINDS))


@private
def _spawn(generator: Any, draw: Any, arm: Any) -> tuple[float, float]:
    """Draw a start position of a disc, clear of the arm and of the goal."""
    while True:
        x, y = _anywhere(generator, NEAREST + WALL, FARTHEST)
        off_goal = math.hypot(x - draw.at[0], y - draw.at[1]) - draw.radius - arm.unit_link_radius
        off_arm = clearance_single(arm.unit_lengths, arm.origin, arm.unit_link_radius, draw.start, x, y, draw.radius)
        if min(off_goal, off_arm) >= SPAWN_CLEARANCE:
            return x, y


def _follow_legs(draw: Any, arm: Any) -> None:
    """Write a path leg by leg; the velocity follows the leg's with a lag."""
    generator, paths = draw.generator, table_of(draw, (arm.samples, arm.points, 2))
    disc, kind, speed = draw.disc, draw.path_kind, draw.speed
    x, y = _spawn(generator, draw, arm)
    follow = 1.0 - math.exp(-PATH_STEP / LAG)
    pace, vx, vy, end_x, end_y, far = speed, 0.0, 0.0, x, y, 0.0
    for sample in range(paths.shape[0]):
        paths[sample, disc, 0], paths[sample, disc, 1] = x, y
        if far < ARRIVED:
            if math.isnan(speed) and (sample == 0 or kind == _WAYPOINTS):
                pace = SLOWEST + (FASTEST - SLOWEST) * uniform(generator)
            end_x, end_y = _next_leg(generator, kind, pace, draw, arm, sample * PATH_STEP, x, y)
            far = max(math.hypot(end_x - x, end_y - y), 1e-9)
        share = 1.0 if sample == 0 else follow
        vx += share * (pace * (end_x - x) / far - vx)
        vy += share * (pace * (end_y - y) / far - vy)
        x, y = x + PATH_STEP * vx, y + PATH_STEP * vy
        far = math.hypot(end_x - x, end_y - y)
        held_x, held_y = _within(x, y)
        if held_x != x or held_y != y:  # in few samples; in the others `far` need not wait for `_within`
            x, y = held_x, held_y
            far = math.hypot(end_x - x, end_y - y)
    _place(arm, paths, disc)


@inlined
def _next_leg(
    generator: Any, kind: int, pace: float, draw: Any, arm: Any, now: float, x: float, y: float
) -> tuple[float, float]:
    """End of the leg that begins at (x, y): aimed at the arm or, where the base is in the way, anywhere."""
    end_x, end_y = x, y
    if kind == _PASSES or now == 0.0 or uniform(generator) < AIMED:
        for _ in range(AIMS):
            at_x, at_y = _lead(draw, arm, 0.5 + 1.5 * uniform(generator), pace, now, x, y)
            way = math.hypot(at_x - x, at_y - y)
            beyond = np.inf if kind == _PASSES else 0.2 + 0.4 * uniform(generator)
            end_x, end_y = _clear_end(x, y, at_x, at_y, way + beyond)
            if math.hypot(end_x - x, end_y - y) >= way:  # or the base is in between
                break
    while math.hypot(end_x - x, end_y - y) < SHORTEST_LEG:
        to_x, to_y = _anywhere(generator, NEAREST, FARTHEST)
        length = np.inf if kind == _PASSES else math.hypot(to_x - x, to_y - y)
        end_x, end_y = _clear_end(x, y, to_x, to_y, length)
    return end_x, end_y


@private
def _lead(draw: Any, arm: Any, point: float, pace: float, now: float, x: float, y: float) -> tuple[float, float]:
    """Place of a point of the moving arm, ``point`` links from the base, when the disc arrives there."""
    at_x = at_y = 0.0
    arrival = now
    for _ in range(LEAD_ITERATIONS):
        share = trapezoid_share(draw.top, draw.ramp, arrival)
        inner = draw.start[0] + share * draw.change[0]
        outer = inner + draw.start[1] + share * draw.change[1]
        upper, fore = min(point, 1.0) * arm.unit_lengths[0], max(point - 1.0, 0.0) * arm.unit_lengths[1]
        at_x = upper * math.cos(inner) + fore * math.cos(outer)
        at_y = upper * math.sin(inner) + fore * math.sin(outer)
        arrival = now + math.hypot(at_x - x, at_y - y) / pace
    return at_x, at_y


@private
def _clear_end(x: float, y: float, to_x: float, to_y: float, length: float) -> tuple[float, float]:
    """End of a leg from (x, y) towards a point: after its length, at the rim, or too near to the base."""
    far = max(math.hypot(to_x - x, to_y - y), 1e-9)
    along_x, along_y = (to_x - x) / far, (to_y - y) / far
    middle, square = x * along_x + y * along_y, x * x + y * y
    beside = middle * middle - square
    length = min(length, -middle + math.sqrt(max(0.0, beside + FARTHEST * FARTHEST)))
    chord = beside + NEAREST * NEAREST
    if middle < 0.0 and chord > 0.0:
        length = min(length, max(0.0, -middle - math.sqrt(chord)))
    return x + length * along_x, y + length * along_y


def _wander(draw: Any, arm: Any) -> None:
    """Write a path whose velocity follows, with a lag, an Ornstein-Uhlenbeck process around zero."""
    generator, paths = draw.generator, table_of(draw, (arm.samples, arm.points, 2))
    disc, pace = draw.disc, WANDER_SPEED if math.isnan(draw.speed) else draw.speed
    x, y = _spawn(generator, draw, arm)
    keep, follow = math.exp(-PATH_STEP / CORRELATION_TIME), 1.0 - math.exp(-PATH_STEP / LAG)
    root = pace / math.sqrt(2.0)
    fresh = root * math.sqrt(1.0 - keep * keep)
    at_x, at_y = _lead(draw, arm, 0.5 + 1.5 * uniform(generator), pace, 0.0, x, y)
    far = max(math.hypot(at_x - x, at_y - y), 1e-9)
    wanted_x, wanted_y = pace * (at_x - x) / far, pace * (at_y - y) / far
    vx, vy = wanted_x, wanted_y
    for sample in range(paths.shape[0]):
        paths[sample, disc, 0], paths[sample, disc, 1] = x, y
        wanted_x = keep * wanted_x + fresh * normal(generator)
        wanted_y = keep * wanted_y + fresh * normal(generator)
        if not _INSIDE < x * x + y * y < _OUTSIDE:  # at a wall
            away = math.hypot(x, y)
            push = WALL_STIFFNESS * (max(0.0, NEAREST + WALL - away) - max(0.0, away - FARTHEST + WALL)) / away
            wanted_x, wanted_y = wanted_x + PATH_STEP * push * x, wanted_y + PATH_STEP * push * y
        too_fast = 1.0
        if wanted_x * wanted_x + wanted_y * wanted_y > _NOT_FAST:
            too_fast = max(1.0, math.hypot(wanted_x, wanted_y) / FASTEST)
        vx += follow * (wanted_x / too_fast - vx)
        vy += follow * (wanted_y / too_fast - vy)
        x, y = _within(x + PATH_STEP * vx, y + PATH_STEP * vy)
    _place(arm, paths, disc)


PATH_KERNELS = {
    "legs_kernel": Kernel(_follow_legs, error_model="numpy"),
    "wander_kernel": Kernel(_wander, error_model="numpy"),
}
"""``kernel(draw, arm)`` writes the path of the disc ``draw.disc`` of a start (`envs.obstacle_dodge.starts`), m."""


@inlined
def path_kernel(kind: int, arm: Any) -> int:
    """The address of the kernel for an index into `KINDS`; 0 until it is compiled."""
    address: int = arm.wander_kernel if kind == _WANDER else arm.legs_kernel
    return address


@inlined
def _place(arm: Any, paths: Array, disc: int) -> None:
    """Give the path of a disc, in the units of the arm and relative to its base, its place, m."""
    for sample in range(paths.shape[0]):
        for axis in range(2):
            paths[sample, disc, axis] = arm.length * paths[sample, disc, axis] + arm.base[axis]


@private
def _anywhere(generator: Any, nearest: float, farthest: float) -> tuple[float, float]:
    """Draw a point of an annulus around the base, uniform in distance and direction."""
    distance = nearest + (farthest - nearest) * uniform(generator)
    angle = 2.0 * math.pi * uniform(generator)
    return distance * math.cos(angle), distance * math.sin(angle)


@private
def _within(x: float, y: float) -> tuple[float, float]:
    """The closest point within NEAREST and FARTHEST of the base."""
    away = math.hypot(x, y)
    allowed = min(FARTHEST, max(NEAREST, away))
    return x * allowed / away, y * allowed / away


def follow_points(points: Array, speed: float, samples: int) -> Array:
    """The path between points ``(k, 2)`` m at constant speed, m/s, staying at the last; ``(samples, 2)``."""
    lengths = np.hypot(*np.diff(points, axis=0).T)
    places = np.concatenate([[0.0], np.cumsum(lengths)])
    run = speed * PATH_STEP * np.arange(samples)
    return np.stack([np.interp(run, places, points[:, axis]) for axis in (0, 1)], axis=1)
