"""What is remembered of a disc while it is watched: how it turns, and where the leg that it is on must end.

A disc takes on the velocity that it wants to have like a first-order lag does (`envs.obstacle_dodge.paths`), so two
velocities
in a row tell the wanted one. That points to the end of the leg all the time, so the lines along it from two places
cross there; where it jumps, another leg has begun.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from envs.obstacle_dodge.paths import FARTHEST, LAG, NEAREST, PATH_STEP
from planners.trapezoid import share_at
from planners.typing import Array

PERIOD = 2.0 * PATH_STEP
"""Time between two observations, s."""

FOLLOW = 1.0 - math.exp(-PATH_STEP / LAG)
"""Share of the way to the wanted velocity that a disc's velocity goes in one step of its path."""

RIM = 1e-4
"""How far from the rims of its world a disc has to be for its velocity to tell what it wants, m."""

FASTEST_WANTED = 1.6
"""A wanted velocity beyond this is the trace of a rim, m/s."""

PACE_CHANGE, TURN = 4e-3, 0.2
"""Change of the wanted speed, m/s, or sine of the angle by which it turns, that tells another leg."""

CROSSING = 2e-3
"""Least sine of the angle between two lines whose crossing is believed."""

RESTLESS = 0.6
"""Share of turns from which on a disc is taken to wander, not to follow legs."""

AT_FIRST, MEMORY = 0.2, 0.12
"""That share before anything is seen, and the weight of the last observation in it."""

LEAD_STEP, LEAD_STEPS = 0.06, 50
"""When along its way it is looked how close a disc comes to the moving arm: s, and how often."""

MOVE = [("start", "f8", (2,)), ("change", "f8", (2,)), ("top", "f8"), ("ramp", "f8"), ("lengths", "f8", (2,))]
"""The straight move to the goal at which discs are aimed, see `envs.obstacle_dodge.paths.StraightMove`."""

TRACK = [
    ("seen", "i8"),
    ("place", "f8", (2,)),
    ("velocity", "f8", (2,)),
    ("wanted", "f8", (2,)),
    ("line", "f8", (2,)),
    ("restlessness", "f8"),
    ("paces", "f8"),
    ("turns", "f8"),
    ("age", "f8"),
    ("end", "f8", (2,)),
    ("crossing", "f8"),
    ("aim_time", "f8"),
    ("aim_gap", "f8"),
]
"""Of one disc: observations so far; place and velocity, m from the base and m/s; the velocity it wants, and a place on
the line along it; the share of turns lately; how many legs began at another pace, and at the same; for how long it has
been on this one, s; its end, m, with the sine of the angle between the lines that crossed there, 0 if it is not known;
when it comes closest to the arm that moves straight to its goal, s from the start, and how close, m. All zeros before
the first observation."""


def new_tracks(num_envs: int) -> NDArray[Any]:
    """Tracks of discs not yet seen, ``(num_envs,)``."""
    return np.zeros(num_envs, TRACK)


@njit(cache=True, nogil=True)
def follow_disc(track: Any, move: Any, place: Array, velocity: Array) -> None:
    """Take in the next observation of a disc, `PERIOD` after the last.

    Args:
        track: of `TRACK`, brought up to date.
        move: of `MOVE`.
        place, velocity: ``(2,)``, m from the base and m/s; the velocity is that over the last `PATH_STEP`.
    """
    if track.seen == 0:
        track.restlessness = AT_FIRST
        track.wanted[:], track.line[:] = velocity, place
        _take_aim(track, move, 0.0, place)
    elif NEAREST + RIM < math.hypot(place[0], place[1]) < FARTHEST - RIM:
        _read_wanted(track, move, place, velocity)
    track.place[:], track.velocity[:] = place, velocity
    track.seen += 1


@njit(cache=True, nogil=True)
def arm_at(move: Any, t: float, joints: Array) -> None:
    """Elbow and hand of the arm that moves straight to its goal, ``(4,)``, m from the base, at a time, s."""
    share = share_at(move.top, move.ramp, t)
    inner = move.start[0] + share * move.change[0]
    outer = inner + move.start[1] + share * move.change[1]
    joints[0], joints[1] = move.lengths[0] * math.cos(inner), move.lengths[0] * math.sin(inner)
    joints[2], joints[3] = joints[0] + move.lengths[1] * math.cos(outer), joints[1] + move.lengths[1] * math.sin(outer)


@njit(cache=True, nogil=True)
def _read_wanted(track: Any, move: Any, place: Array, velocity: Array) -> None:
    """The wanted velocity, and what its change since the last observation tells."""
    before_x, before_y = place[0] - PATH_STEP * velocity[0], place[1] - PATH_STEP * velocity[1]
    vx, vy = (before_x - track.place[0]) / PATH_STEP, (before_y - track.place[1]) / PATH_STEP
    wanted_x, wanted_y = vx + (velocity[0] - vx) / FOLLOW, vy + (velocity[1] - vy) / FOLLOW
    was_x, was_y = track.wanted[0], track.wanted[1]
    pace, was = math.hypot(wanted_x, wanted_y), math.hypot(was_x, was_y)
    if pace >= FASTEST_WANTED:
        return
    cross = was_x * wanted_y - was_y * wanted_x
    sine = cross / max(1e-9, was * pace)
    other_pace = abs(pace - was) > PACE_CHANGE
    turned = other_pace or abs(sine) > TURN or was_x * wanted_x + was_y * wanted_y < 0.0
    track.age += PERIOD
    if turned:
        if track.seen > 1:
            track.paces += 1.0 if other_pace else 0.0
            track.turns += 0.0 if other_pace else 1.0
        track.age = track.crossing = 0.0
    elif abs(sine) > max(CROSSING, track.crossing):
        way = ((before_x - track.line[0]) * wanted_y - (before_y - track.line[1]) * wanted_x) / cross
        end_x, end_y = track.line[0] + way * was_x, track.line[1] + way * was_y
        if way > 0.0 and math.hypot(end_x, end_y) < FARTHEST + 0.05:
            track.end[0], track.end[1], track.crossing = end_x, end_y, abs(sine)
    track.wanted[0], track.wanted[1] = wanted_x, wanted_y
    if turned and track.restlessness < RESTLESS:
        _take_aim(track, move, PERIOD * track.seen, place)
    track.line[0], track.line[1] = before_x, before_y
    track.restlessness += MEMORY * ((1.0 if turned and track.seen > 1 else 0.0) - track.restlessness)


@njit(cache=True, nogil=True)
def _take_aim(track: Any, move: Any, now: float, place: Array) -> None:
    """When the disc, going on as it wants, comes closest to the outer half of the arm, and how close."""
    joints = np.empty(4)
    track.aim_time, track.aim_gap = now, 1e9
    for step in range(LEAD_STEPS):
        t = now + LEAD_STEP * step
        arm_at(move, t, joints)
        x, y = place[0] + track.wanted[0] * (t - now), place[1] + track.wanted[1] * (t - now)
        upper = _from_segment(x, y, 0.5 * joints[0], 0.5 * joints[1], joints[0], joints[1])
        gap = min(upper, _from_segment(x, y, joints[0], joints[1], joints[2], joints[3]))
        if gap < track.aim_gap - 1e-3:
            track.aim_time, track.aim_gap = t, gap
        elif track.aim_gap < 0.03 and gap > track.aim_gap + 0.05:
            return


@njit(cache=True, nogil=True)
def _from_segment(x: float, y: float, from_x: float, from_y: float, to_x: float, to_y: float) -> float:
    along_x, along_y = to_x - from_x, to_y - from_y
    share = ((x - from_x) * along_x + (y - from_y) * along_y) / (along_x * along_x + along_y * along_y)
    share = min(1.0, max(0.0, share))
    return math.hypot(x - from_x - share * along_x, y - from_y - share * along_y)
