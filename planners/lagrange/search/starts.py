"""Motions from which the search for the least torque starts."""

from __future__ import annotations

import math
from functools import lru_cache, partial

import numpy as np

from planners.lagrange.joint_move import Curve, JointMove
from planners.typing import Array

FOLD, TURN = 2.0, 1.0
"""Displacements from the quintic at half time: of the outer joints in a fold, of the first one alone, rad."""

FASTEST_DETOUR = 2.0
"""Starts whose detour alone needs more than this multiple of the velocity limit are left out."""

SWING_REACH = (1.5, 2.6)
"""Largest detour of the first and of the other joints in random starts, rad."""

HANGS = (
    (0.5, 0.5, False, 0.0),
    (0.3, 0.7, False, 0.0),
    (0.15, 0.85, False, 0.0),
    (0.3, 0.7, True, 0.0),
    (0.5, 0.5, False, 2.4),
    (0.5, 0.5, False, -2.4),
    (0.3, 0.7, False, 2.4),
    (0.3, 0.7, False, -2.4),
)
"""Starts under gravity that hang still for a while, which takes no torque: from and to which share of the time, whether
it is the second nearest of the postures that hang, and the bend of the second joint there, rad."""

INSIDE = 0.95
"""Share of the joint ranges that the starts use."""


def start_curves(move: JointMove, swings: int) -> list[Curve]:
    """The quintic, an extended one, swings and folds in every direction, under gravity hanging ones, and so many random
    ones.
    """
    n = move.arm.n_joints
    outer: Array = np.where(np.arange(n) > 0, 1.0, 0.0)
    alternating: Array = np.where(np.arange(n) % 2 == 0, outer, -outer)
    patterns = [TURN * (1.0 - outer), *(FOLD * pattern for pattern in (alternating, outer)[: n - 1])]
    detours = [side * pattern for pattern in patterns for side in (1.0, -1.0)]
    # the fastest part of a detour takes about a third of the time
    longest = FASTEST_DETOUR * np.array(move.limits.velocity) * move.duration / 3.0
    possible = [detour for detour in detours if (np.abs(detour) <= longest).all()]
    curves: list[Curve] = [
        move.quintic,
        partial(_curve, move, np.zeros(n), -outer),
        *(partial(_curve, move, detour, np.zeros(n)) for detour in possible),
    ]
    if move.arm.gravity:
        curves += [partial(_hang, move, *hang) for hang in HANGS if n > 1 or not hang[-1]]
    return curves + [partial(_swing, move, *pair) for pair in _swings(n, swings)]


def with_detour(move: JointMove, angles: Array, detour: Array, lean: Array, s: Array) -> Array:
    """Joint angles at ``s`` in [0, 1] plus a detour, within the joint ranges, ``(points, n)``, rad.

    The detour is in full at half time, leans to the start, or against it, and fades to the ends.
    """
    half_way = (16.0 * (s * (1.0 - s)) ** 2)[:, None]
    return _in_range(move, angles, angles + half_way * (detour + (1.0 - 2.0 * s)[:, None] * lean))


@lru_cache
def _swings(n: int, count: int) -> Array:
    """Detour at half time and lean of every random start, ``(count, 2, n)``, rad: the same for every move."""
    reach = np.where(np.arange(n) > 0, SWING_REACH[1], SWING_REACH[0])
    return np.random.default_rng(n).uniform(-reach, reach, (count, 2, n))


def _curve(move: JointMove, detour: Array, share: Array, s: Array) -> Array:
    """The quintic plus, at half time, ``detour`` (rad) and a ``share`` of itself."""
    quintic = move.quintic(s)
    return with_detour(move, quintic, detour + share * quintic, np.zeros_like(detour), s)


def _swing(move: JointMove, detour: Array, lean: Array, s: Array) -> Array:
    """The quintic plus a detour that leans."""
    return with_detour(move, move.quintic(s), detour, lean, s)


def _hang(move: JointMove, first: float, last: float, other: bool, bend: float, s: Array) -> Array:
    """To a posture that hangs at ``first`` (in [0, 1]), and from there at ``last``; by quintics, within the ranges."""
    start, end = move.ends.start[0], move.ends.end[0]
    hanging: Array = np.zeros(len(start))
    hanging[0] = -math.copysign(0.5 * math.pi, move.arm.gravity)
    turns = (0.5 * (start[0] + end[0]) - hanging[0]) / (2.0 * math.pi)
    nearest = round(turns)
    hanging[0] += 2.0 * math.pi * (nearest + (math.copysign(1.0, turns - nearest) if other else 0.0))
    hanging[1:2] = bend
    there, back = (np.clip(x, 0.0, 1.0)[:, None] for x in (s / first, (s - last) / (1.0 - last)))
    there, back = (x**3 * (10.0 - 15.0 * x + 6.0 * x**2) for x in (there, back))
    return _in_range(move, move.quintic(s), start + there * (hanging - start) + back * (end - hanging))


def _in_range(move: JointMove, known: Array, angles: Array) -> Array:
    """Joint angles within the joint ranges, or as far out as a ``known`` motion, ``(points, n)``, rad."""
    middle = move.limits.angle_middle
    reach = np.maximum(INSIDE * move.limits.angle_half, np.abs(known - middle).max(axis=0))
    return middle + np.clip(angles - middle, -reach, reach)
