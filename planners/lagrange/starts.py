"""Start motions of the search for the least torque: local minima differ in how the arm folds and swings."""

from __future__ import annotations

from functools import partial

import numpy as np

from planners.lagrange.joint_move import Curve, JointMove
from planners.typing import Array

FOLD, SWING = 2.0, 1.0
"""Displacements from the quintic at half time: of the outer joints in a fold, of the first one in a swing, rad."""

INSIDE = 0.95
"""Share of the joint ranges that the starts use."""

FASTEST_DETOUR = 2.0
"""Starts whose detour alone needs more than this multiple of the velocity limit are left out."""


def start_curves(move: JointMove) -> list[Curve]:
    """The quintic, an extended one, and swings and folds in every direction."""
    n = move.arm.n_joints
    outer: Array = np.where(np.arange(n) > 0, 1.0, 0.0)
    alternating: Array = np.where(np.arange(n) % 2 == 0, outer, -outer)
    patterns = [SWING * (1.0 - outer), *(FOLD * pattern for pattern in (alternating, outer)[: n - 1])]
    detours = [side * pattern for pattern in patterns for side in (1.0, -1.0)]
    # the fastest part of a detour takes about a third of the time
    longest = FASTEST_DETOUR * np.array(move.limits.velocity) * move.duration / 3.0
    possible = [detour for detour in detours if (np.abs(detour) <= longest).all()]
    return [
        move.quintic,
        partial(_curve, move, np.zeros(n), -outer),
        *(partial(_curve, move, detour, np.zeros(n)) for detour in possible),
    ]


def _curve(move: JointMove, detour: Array, share: Array, s: Array) -> Array:
    """The quintic plus, at half time, ``detour`` (rad) and a ``share`` of itself, within the joint ranges."""
    quintic = move.quintic(s)
    half_way = (16.0 * (s * (1.0 - s)) ** 2)[:, None]
    middle = move.limits.angle_middle
    reach = np.maximum(INSIDE * move.limits.angle_half, np.abs(quintic - middle).max(axis=0))
    return middle + np.clip(quintic + half_way * (detour + share * quintic) - middle, -reach, reach)
