"""What a forecast of a disc is made from: numbers in the frame that looks along the velocity the disc wants."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from agents.policies.forecasting.track import PERIOD, arm_at
from envs.obstacle_dodge.paths import ARRIVED, FARTHEST, NEAREST
from planners.typing import Array

FEATURES = 37
"""How many there are."""

BEYOND = 0.4
"""How far beyond the arm a leg is taken to end whose end is not known, m."""

ARRIVAL = 100.0
"""A time by which the arm has long come to its goal, s."""

AT_RIM = 0.005
"""Distance from a rim up to which a leg is taken to end there, m."""


@njit(cache=True, nogil=True)
def disc_features(track: Any, move: Any, features: Array) -> tuple[float, float]:
    """Fill in the features of a disc, ``(FEATURES,)``; cosine and sine of the frame's direction."""
    now, joints = PERIOD * (track.seen - 1), np.empty(4)
    x, y, pace = track.place[0], track.place[1], math.hypot(track.wanted[0], track.wanted[1])
    c, s = 1.0, 0.0
    if pace > 1e-3:
        c, s = track.wanted[0] / pace, track.wanted[1] / pace
    along, across = c * x + s * y, c * y - s * x
    free, inwards = _free_way(along, x * x + y * y)
    known, until_arm = track.crossing > 0.0, track.aim_time - now
    end_x, end_y = track.end[0], track.end[1]
    if not known:
        way = max(0.0, min(free, pace * until_arm + BEYOND))
        end_x, end_y = x + way * c, y + way * s
    end_along, end_across = c * (end_x - x) + s * (end_y - y), c * (end_y - y) - s * (end_x - x)
    away, slow = math.hypot(end_x, end_y), max(pace, 0.1)
    at_rim = known and (abs(away - FARTHEST) < AT_RIM or abs(away - NEAREST) < AT_RIM)

    features[0] = pace
    features[1] = c * track.velocity[0] + s * track.velocity[1]
    features[2] = c * track.velocity[1] - s * track.velocity[0]
    features[3], features[4], features[5] = along, across, math.hypot(x, y)
    features[6] = track.restlessness
    features[7], features[8] = min(track.paces, 3.0) / 3.0, min(track.turns, 3.0) / 3.0
    features[9], features[10] = min(track.age, 2.0), min(now, 3.0)
    features[11], features[12], features[13] = _one_if(known), min(2.0, end_along), end_across
    features[14], features[15] = min(free, 2.0), _one_if(inwards)
    features[16], features[17] = min(3.0, max(-1.5, until_arm)), min(0.5, track.aim_gap)
    features[18] = min(2.0, max(-1.0, pace * until_arm))
    arm_at(move, now, joints)
    _into_frame(joints, x, y, c, s, features, 19)
    arm_at(move, ARRIVAL, joints)
    _into_frame(joints, x, y, c, s, features, 23)
    features[27], features[28] = min(3.0, (end_along - ARRIVED) / slow), min(3.0, (free - ARRIVED) / slow)
    features[29] = min(3.0, free - end_along)
    # Which way the next leg would go: from the rim, or from the end of this leg, to the arm at its goal.
    middle_x, middle_y = 0.5 * (joints[0] + joints[2]), 0.5 * (joints[1] + joints[3])
    _direction(x + (free - ARRIVED) * c, y + (free - ARRIVED) * s, middle_x, middle_y, c, s, features, 30)
    _direction(end_x, end_y, middle_x, middle_y, c, s, features, 32)
    _direction(end_x, end_y, joints[2], joints[3], c, s, features, 34)
    features[36] = _one_if(at_rim)
    return c, s


@njit(cache=True, nogil=True)
def _free_way(along: float, square: float) -> tuple[float, bool]:
    """How far a disc can go straight on, m, and whether it is the inner rim that ends it."""
    chord = along * along - square + NEAREST**2
    if along < 0.0 and chord > 0.0:
        return max(0.0, -along - math.sqrt(chord)), True
    return -along + math.sqrt(max(0.0, along * along - square + FARTHEST**2)), False


@njit(cache=True, nogil=True)
def _into_frame(joints: Array, x: float, y: float, c: float, s: float, features: Array, first: int) -> None:
    """Elbow and hand as seen from the disc."""
    for k in range(2):
        dx, dy = joints[2 * k] - x, joints[2 * k + 1] - y
        features[first + 2 * k], features[first + 2 * k + 1] = c * dx + s * dy, c * dy - s * dx


@njit(cache=True, nogil=True)
def _direction(x: float, y: float, to_x: float, to_y: float, c: float, s: float, features: Array, first: int) -> None:
    """Unit vector from a place to another; shorter where they are close."""
    dx, dy = to_x - x, to_y - y
    far = max(0.05, math.hypot(dx, dy))
    features[first], features[first + 1] = (c * dx + s * dy) / far, (c * dy - s * dx) / far


@njit(cache=True, nogil=True)
def _one_if(true: bool) -> float:
    return 1.0 if true else 0.0
