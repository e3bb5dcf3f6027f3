"""Certified lower bounds of a time: before it, no motion within the limits has each joint where it must be.

Each joint is taken alone, without torques, discs and the other joint, so what it cannot do no motion can. Its
velocities at the ends of control periods, mean accelerations and jerks are limited as the environment measures them;
whether it can be in given ranges of angle and velocity at given times is a linear program. Two things are assumed:
within a control period an acceleration changes by at most `VARIATION`, and ranges found by samples, made wider, hold
what they should.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import linprog

from planners.robot.arm import Arm
from planners.robot.kinematics import turned_towards
from planners.typing import Array

VARIATION = 0.25
"""Largest change of an acceleration within a control period, in units of its limit."""

WIDER = 1.05
"""Factor on ranges that are found by samples."""

SAMPLES, RINGS = 32, 5
"""Points of a ring around a place, and rings."""


class Ranges(NamedTuple):
    """Where a joint must be at the ends of control periods: lowest and highest, rad and rad/s, ``(periods,)`` each."""

    angle: tuple[Array, Array]
    velocity: tuple[Array, Array]


class Joint(NamedTuple):
    """Start of a joint at rest (rad), its limits with the environment's tolerance, and the control period (s)."""

    start: float
    velocity: float
    acceleration: float
    jerk: float
    period: float


def joints_of(arm: Arm, q: Array, limit_tolerance: float, period: float) -> list[Joint]:
    """The joints of an arm at rest in a posture."""
    share = 1.0 + limit_tolerance
    speed, hardest, jerk = (share * arm.limits.array(kind) for kind in ("velocity", "acceleration", "jerk"))
    return [
        Joint(*values, period)
        for values in zip(q.tolist(), speed.tolist(), hardest.tolist(), jerk.tolist(), strict=True)
    ]


def can_be_there(joint: Joint, first: int, ranges: Ranges) -> bool:
    """Whether a joint can be within ranges at the ends of the periods ``first``, ``first + 1``, ... ."""
    last = first + len(ranges.angle[0]) - 1
    far = np.maximum(ranges.angle[0] - joint.start, joint.start - ranges.angle[1])
    times = joint.period * np.arange(first, last + 1)
    drift = VARIATION * joint.acceleration * joint.period**2 / 12.0
    if (far > np.minimum(joint.velocity * times, 0.5 * joint.acceleration * times**2) + (last + 1) * drift).any():
        return False
    if last == 0:
        return True
    # Variables: angles and velocities at the ends of the periods 1 to last.
    period, one, before = joint.period, np.eye(last), np.eye(last, k=-1)
    change, mean, zero = one - before, (one + before) / 2.0, np.zeros((last, last))
    rows = [np.hstack([change, -period * mean]), np.hstack([zero, change / period])]
    most = [np.full(last, drift), np.full(last, joint.acceleration)]
    if np.isfinite(joint.jerk):
        rows.append(np.hstack([zero, change @ change / period**2]))
        most.append(np.full(last, joint.jerk))
    matrix, high, low = np.vstack(rows), np.concatenate(most), -np.concatenate(most)
    high[0], low[0] = joint.start + drift, joint.start - drift
    bounds = np.empty((2 * last, 2))
    bounds[:last], bounds[last:] = (-np.inf, np.inf), (-joint.velocity, joint.velocity)
    for at, (least, greatest) in ((0, ranges.angle), (last, ranges.velocity)):
        asked = bounds[at + max(first, 1) - 1 : at + last]
        asked[:, 0] = np.maximum(asked[:, 0], least[-len(asked) :])
        asked[:, 1] = np.minimum(asked[:, 1], greatest[-len(asked) :])
    if (bounds[:, 0] > bounds[:, 1]).any():
        return False
    span: Any = bounds.tolist()
    found: Any = linprog(
        np.zeros(2 * last),
        A_ub=np.vstack([matrix, -matrix]),
        b_ub=np.concatenate([high, -low]),
        bounds=span,
    )
    return bool(found.status != 2)  # 2: infeasible


def earliest(joints: Sequence[Joint], alternatives: Callable[[int], list[list[Ranges]]], periods: int) -> int | None:
    """The first period, of so many, from which on all joints can be where they must be; None if there is none.

    Args:
        joints: of the arm.
        alternatives: for a period, lists with the ranges of each joint, one of which must be met.
        periods: how many are tried.
    """
    for first in range(periods):
        for ranges in alternatives(first):
            if all(can_be_there(joint, first, each) for joint, each in zip(joints, ranges, strict=True)):
                return first
    return None


def with_hand_at(
    arm: Arm,
    near: Array,
    places: Array,
    distance: float,
    velocity: ArrayLike = (0.0, 0.0),
    off: float = np.inf,
) -> list[list[Ranges]]:
    """Ranges of the joints of a two-link arm with its hand near places, for each side of the elbow.

    Args:
        arm: two links.
        near: angles in whose whole turns those of the ranges are, ``(2,)``, rad.
        places: at the ends of periods, ``(periods, 2)``, m.
        distance: largest one of the hand, m.
        velocity: of the places, m/s.
        off: largest difference of the hand's velocity from it, m/s.
    """
    turns = np.linspace(0.0, 2.0 * np.pi, SAMPLES, endpoint=False)
    rings = np.linspace(0.0, WIDER * distance, RINGS)[:, None, None]
    disc = (rings * np.column_stack([np.cos(turns), np.sin(turns)])).reshape(-1, 2)
    away = places[:, None] + disc - arm.base_array
    reach = np.hypot(away[..., 0], away[..., 1])
    shortest, longest = abs(arm.lengths[0] - arm.lengths[1]), arm.reach
    within = np.clip(reach, max(shortest, 1e-6), longest * (1.0 - 1e-9)) / np.maximum(reach, 1e-9)
    postures = arm.inverse_kinematics((arm.base_array + within[..., None] * away).reshape(-1, 2))
    branches = np.moveaxis(turned_towards(postures, near).reshape(*reach.shape, 2, 2), 2, 0)
    if (reach > longest).any() or (reach < shortest).any():  # the elbow can change its side there
        return [_ranges(np.concatenate(list(branches), axis=1), None)]
    inverses = np.linalg.inv(arm.jacobian(branches.reshape(-1, 2))).reshape(*branches.shape, 2)
    rates, slack = inverses @ np.asarray(velocity), off * np.linalg.norm(inverses, axis=-1)
    return [
        _ranges(branch, (low, high)) for branch, low, high in zip(branches, rates - slack, rates + slack, strict=True)
    ]


def _ranges(angles: Array, rates: tuple[Array, Array] | None) -> list[Ranges]:
    """Ranges of each joint that hold all samples ``(periods, samples, 2)``."""
    free = np.full(angles.shape[::2], np.inf)
    low, high = (-free, free) if rates is None else (rates[0].min(axis=1), rates[1].max(axis=1))
    more = 0.5 * (WIDER - 1.0) * np.ptp(angles, axis=1)
    least, most = angles.min(axis=1) - more, angles.max(axis=1) + more
    return [Ranges((least[:, i], most[:, i]), (low[:, i], high[:, i])) for i in range(2)]
