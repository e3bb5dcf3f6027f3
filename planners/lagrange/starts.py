"""Motions from which the search for the least torque starts: local minima differ in how the arm folds and swings."""

from __future__ import annotations

from functools import partial

import numpy as np

from planners.lagrange.joint_move import Curve, JointMove
from planners.typing import Array

FOLD, SWING = 2.0, 1.0
"""How far the outer joints fold, and the first one swings, half way, beyond the quintic, rad."""

INSIDE = 0.95
"""Share of the joint ranges that the starts keep to."""

HOPELESS = 2.0
"""A start whose detour alone takes so many times the velocity limit is left out."""


def start_curves(move: JointMove) -> list[Curve]:
    """Quintic, extended, swung either way, folded every way."""
    n = move.arm.n_joints
    outer: Array = np.where(np.arange(n) > 0, 1.0, 0.0)
    alternating: Array = np.where(np.arange(n) % 2 == 0, outer, -outer)
    patterns = [SWING * (1.0 - outer), *(FOLD * pattern for pattern in (alternating, outer)[: n - 1])]
    detours = [side * pattern for pattern in patterns for side in (1.0, -1.0)]
    # The fastest part of a detour covers it in about a third of the time.
    swift = HOPELESS * np.array(move.limits.velocity) * move.duration / 3.0
    possible = [detour for detour in detours if (np.abs(detour) <= swift).all()]
    return [
        move.quintic,
        partial(_curve, move, np.zeros(n), -outer),
        *(partial(_curve, move, detour, np.zeros(n)) for detour in possible),
    ]


def _curve(move: JointMove, detour: Array, share: Array, s: Array) -> Array:
    """The quintic plus ``detour`` (rad) plus a ``share`` of itself half way, within the joint ranges."""
    quintic = move.quintic(s)
    half_way = (16.0 * (s * (1.0 - s)) ** 2)[:, None]
    reach = np.maximum(INSIDE * np.array(move.limits.angle), np.abs(quintic).max(axis=0))
    return np.clip(quintic + half_way * (detour + share * quintic), -reach, reach)
