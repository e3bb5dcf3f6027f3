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
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numba import njit

from planners.compiled.calls import inlined, private
from planners.motion.time_laws import trapezoid, trapezoid_share
from planners.robot.arm import Arm, JointLimits
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

LEAD_ITERATIONS = 6
"""Fixed-point iterations between the place of an aim and the time of arrival there."""


class StraightMove(NamedTuple):
    """A straight motion of a two-link arm in joint space; see `planners.motion.time_laws.trapezoid`.

    Attributes:
        lengths: lengths of the links, ``(2,)``, m.
        link_radius: radius of the links, m.
        start: posture at time 0, ``(2,)``, rad.
        change: change of the posture, ``(2,)``, rad.
        top, ramp: top speed, 1/s, and ramp time, s, of the trapezoid.
        goal: final position of the hand, ``(2,)``, m.
    """

    lengths: Array
    link_radius: float
    start: Array
    change: Array
    top: float
    ramp: float
    goal: Array

    def in_units(self, length: float, time: float) -> StraightMove:
        """The same move with lengths in units of ``length`` m and times in units of ``time`` s."""
        return self._replace(
            lengths=self.lengths / length,
            link_radius=self.link_radius / length,
            top=self.top * time,
            ramp=self.ramp / time,
            goal=self.goal / length,
        )


def straight_move(arm: Arm, limits: JointLimits, start: Array, end: Array) -> StraightMove:
    """The straight move of an arm between two postures within limits of velocity and acceleration."""
    # In Python: there is nothing to round differently, and one call a path is not worth compiling.
    top, ramp = trapezoid.py_func(end - start, np.array(limits.velocity), np.array(limits.acceleration))
    goal = arm.forward_kinematics(end) - arm.base_array
    return StraightMove(arm.length_array, arm.link_radius, start, end - start, float(top), float(ramp), goal)


def draw_path(generator: Any, kind: int, speed: float, radius: float, move: StraightMove, path: Array) -> None:
    """Draw the path of one disc, relative to the base of the arm.

    Args:
        generator: a NumPy generator.
        kind: index into `KINDS`.
        speed: speed of the disc, m/s; drawn where NaN.
        radius: radius of the disc, m.
        move: motion of the arm at which the disc is aimed.
        path: samples of the path, filled in, ``(samples, 2)``, m.
    """
    x, y = _spawn(generator, radius, move)
    if kind == _WANDER:
        _wander(generator, WANDER_SPEED if math.isnan(speed) else speed, move, x, y, path)
    else:
        _follow_legs(generator, kind, speed, move, x, y, path)


@njit(cache=True, nogil=True)
def _spawn(generator: Any, radius: float, move: StraightMove) -> tuple[float, float]:
    """Draw a start position of a disc, clear of the arm and of the goal."""
    base = np.zeros(2)
    while True:
        x, y = _anywhere(generator, NEAREST + WALL, FARTHEST)
        off_goal = math.hypot(x - move.goal[0], y - move.goal[1]) - radius - move.link_radius
        off_arm = clearance_single(move.lengths, base, move.link_radius, move.start, x, y, radius)
        if min(off_goal, off_arm) >= SPAWN_CLEARANCE:
            return x, y


@njit(cache=True, nogil=True)
def _follow_legs(generator: Any, kind: int, speed: float, move: StraightMove, x: float, y: float, path: Array) -> None:
    """Write a path leg by leg; the velocity follows the leg's with a lag."""
    follow = 1.0 - math.exp(-PATH_STEP / LAG)
    pace, vx, vy, end_x, end_y = speed, 0.0, 0.0, x, y
    for sample in range(path.shape[0]):
        path[sample, 0], path[sample, 1] = x, y
        if math.hypot(end_x - x, end_y - y) < ARRIVED:
            if math.isnan(speed) and (sample == 0 or kind == _WAYPOINTS):
                pace = SLOWEST + (FASTEST - SLOWEST) * generator.random()
            end_x, end_y = _next_leg(generator, kind, pace, move, sample * PATH_STEP, x, y)
        far = max(math.hypot(end_x - x, end_y - y), 1e-9)
        share = 1.0 if sample == 0 else follow
        vx += share * (pace * (end_x - x) / far - vx)
        vy += share * (pace * (end_y - y) / far - vy)
        x, y = _within(x + PATH_STEP * vx, y + PATH_STEP * vy)


@inlined
def _next_leg(
    generator: Any, kind: int, pace: float, move: StraightMove, now: float, x: float, y: float
) -> tuple[float, float]:
    """End of the leg that begins at (x, y): aimed at the arm or, where the base is in the way, anywhere."""
    end_x, end_y = x, y
    if kind == _PASSES or now == 0.0 or generator.random() < AIMED:
        for _ in range(AIMS):
            at_x, at_y = _lead(move, 0.5 + 1.5 * generator.random(), pace, now, x, y)
            way = math.hypot(at_x - x, at_y - y)
            beyond = np.inf if kind == _PASSES else 0.2 + 0.4 * generator.random()
            end_x, end_y = _clear_end(x, y, at_x, at_y, way + beyond)
            if math.hypot(end_x - x, end_y - y) >= way:  # or the base is in between
                break
    while math.hypot(end_x - x, end_y - y) < SHORTEST_LEG:
        to_x, to_y = _anywhere(generator, NEAREST, FARTHEST)
        length = np.inf if kind == _PASSES else math.hypot(to_x - x, to_y - y)
        end_x, end_y = _clear_end(x, y, to_x, to_y, length)
    return end_x, end_y


@private
def _lead(move: StraightMove, point: float, pace: float, now: float, x: float, y: float) -> tuple[float, float]:
    """Place of a point of the moving arm, ``point`` links from the base, when the disc arrives there."""
    at_x = at_y = 0.0
    arrival = now
    for _ in range(LEAD_ITERATIONS):
        share = trapezoid_share(move.top, move.ramp, arrival)
        inner = move.start[0] + share * move.change[0]
        outer = inner + move.start[1] + share * move.change[1]
        upper, fore = min(point, 1.0) * move.lengths[0], max(point - 1.0, 0.0) * move.lengths[1]
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
    length = min(length, -middle + math.sqrt(max(0.0, middle**2 - square + FARTHEST**2)))
    chord = middle**2 - square + NEAREST**2
    if middle < 0.0 and chord > 0.0:
        length = min(length, max(0.0, -middle - math.sqrt(chord)))
    return x + length * along_x, y + length * along_y


@njit(cache=True, nogil=True)
def _wander(generator: Any, pace: float, move: StraightMove, x: float, y: float, path: Array) -> None:
    """Write a path whose velocity follows, with a lag, an Ornstein-Uhlenbeck process around zero."""
    keep, follow = math.exp(-PATH_STEP / CORRELATION_TIME), 1.0 - math.exp(-PATH_STEP / LAG)
    root = pace / math.sqrt(2.0)
    fresh = root * math.sqrt(1.0 - keep * keep)
    at_x, at_y = _lead(move, 0.5 + 1.5 * generator.random(), pace, 0.0, x, y)
    far = max(math.hypot(at_x - x, at_y - y), 1e-9)
    wanted_x, wanted_y = pace * (at_x - x) / far, pace * (at_y - y) / far
    vx, vy = wanted_x, wanted_y
    for sample in range(path.shape[0]):
        path[sample, 0], path[sample, 1] = x, y
        away = math.hypot(x, y)
        push = WALL_STIFFNESS * (max(0.0, NEAREST + WALL - away) - max(0.0, away - FARTHEST + WALL)) / away
        wanted_x = keep * wanted_x + fresh * generator.standard_normal() + PATH_STEP * push * x
        wanted_y = keep * wanted_y + fresh * generator.standard_normal() + PATH_STEP * push * y
        too_fast = max(1.0, math.hypot(wanted_x, wanted_y) / FASTEST)
        vx += follow * (wanted_x / too_fast - vx)
        vy += follow * (wanted_y / too_fast - vy)
        x, y = _within(x + PATH_STEP * vx, y + PATH_STEP * vy)


@private
def _anywhere(generator: Any, nearest: float, farthest: float) -> tuple[float, float]:
    """Draw a point of an annulus around the base, uniform in distance and direction."""
    distance = nearest + (farthest - nearest) * generator.random()
    angle = 2.0 * math.pi * generator.random()
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
