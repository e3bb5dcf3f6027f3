"""Random rest-to-rest moves that are solvable: a quintic motion solves them within the torque limits.

Start and goal are uniform over the joint ranges (so folded postures and long moves are among them); the time of the
move is drawn so that the quintic needs a share between 0.3 and 0.9 of the torque limits, or is longer where limits of
velocity or acceleration need that. Along a quintic of duration T the torque is ``a(s) / T^2 + g(s)``, with ``s`` in
[0, 1] and the weight ``g``, so the T that goes with a share follows in closed form.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from envs.arms import farthest_angle
from planners.motion.time_laws import quintic
from planners.problem import FixedJoints, MotionProblem
from planners.robot.arm import Arm
from planners.robot.presets import PLANAR_3R
from planners.typing import Array

LEAST_SHARE, MOST_SHARE = 0.3, 0.9
"""Range of the share of the torque limits that the quintic needs."""

MOST_HELD = 0.8
"""Largest part of that share that the weight alone may take; the rest accelerates the arm."""

SHORTEST, LONGEST = 0.2, 1e6
"""Least and largest time of a move, s."""

_TRIES = 1000
_S = np.linspace(0.0, 1.0, 33)
_QUINTIC, _SPEED, _ACCELERATION = quintic(_S)


class Move(NamedTuple):
    """Rest at joint angles ``start`` to rest at ``goal``, ``(n,)`` each, rad, in ``duration``, s."""

    start: Array
    goal: Array
    duration: float


def random_move(
    generator: np.random.Generator,
    arm: Arm = PLANAR_3R,
    period: float | None = None,
    longest: float = math.inf,
    share: float | None = None,
    given: Mapping[str, Any] = MappingProxyType({}),
) -> Move:
    """One random move of an arm.

    Joints without a range start anywhere in [-pi, pi] and move by up to pi either way. Start and goal are drawn again
    where the weight alone takes most of the share, or the time becomes too long.

    Args:
        generator: source of random numbers.
        arm: an arm with finite torque limits; of the others only the joint ranges count.
        period: the duration is rounded up to a multiple of it, s; longer never takes more torque.
        longest: duration allowed, s.
        share: of the torque limits, that the quintic needs, in place of the drawn one.
        given: parts of the `Move`, in place of drawn ones; a given time is one in which the quintic keeps to
            `MOST_SHARE`.

    Raises:
        ValueError: if the arm has a joint without torque limit, or no drawn move fits.
    """
    torque = arm.limits.array("torque")
    if not np.isfinite(torque).all():
        raise ValueError(f"{arm.name} has torque limits {arm.limits.torque}; all must be finite")
    free = np.isinf(arm.limits.angle_half)
    lower, upper = np.where(free, -np.pi, arm.limits.angle_lower), np.where(free, np.pi, arm.limits.angle_upper)
    farthest = farthest_angle(arm)
    for _ in range(_TRIES):
        start = given.get("start", generator.uniform(lower, upper))
        goal = given.get("goal", np.where(free, start, 0.0) + generator.uniform(lower, upper))
        drawn = generator.uniform(LEAST_SHARE, MOST_SHARE)
        inertial, static = _quintic_torque(arm, start, goal)
        duration = _least_time(arm, goal - start, inertial, static, (drawn if share is None else share) * torque)
        if period is not None and duration < math.inf:
            duration = period * math.ceil(duration / period)
        if not duration <= min(longest, LONGEST) or np.abs(goal).max() > farthest:
            continue
        if "duration" not in given:
            return Move(start, goal, duration)
        if _least_time(arm, goal - start, inertial, static, MOST_SHARE * torque) <= given["duration"]:
            return Move(start, goal, given["duration"])
    parts = f" with this {' and '.join(sorted(given))}" if given else ""
    raise ValueError(
        f"{arm.name} can hold its own weight, and move within {longest} s, from and to hardly any posture{parts}; "
        f"raise the torque limits {arm.limits.torque} or the time"
    )


def random_moves(n: int, seed: int, arm: Arm = PLANAR_3R) -> list[MotionProblem]:
    """``n`` planning problems from `random_move`, fixed by the seed."""
    generator = np.random.default_rng(seed)
    moves = [random_move(generator, arm) for _ in range(n)]
    return [MotionProblem(arm, move.start, FixedJoints(move.goal), move.duration) for move in moves]


def _least_time(arm: Arm, change: Array, inertial: Array, static: Array, most: Array) -> float:
    """Least time in which the quintic takes these torques at most, s; inf where the weight alone takes most of them."""
    if (np.abs(static) > MOST_HELD * most).any():
        return math.inf
    room = most - np.sign(inertial) * static
    return max(SHORTEST, math.sqrt(np.max(np.abs(inertial) / room)), _smooth_time(arm, change))


def _smooth_time(arm: Arm, change: Array) -> float:
    """Least time of a quintic within `MOST_SHARE` of the limits of velocity and acceleration, s."""
    way = np.abs(change)
    speed = _SPEED.max() * way / (MOST_SHARE * arm.limits.array("velocity"))
    strength = _ACCELERATION.max() * way / (MOST_SHARE * arm.limits.array("acceleration"))
    return float(max(speed.max(), math.sqrt(strength.max())))


def _quintic_torque(arm: Arm, start: Array, goal: Array) -> tuple[Array, Array]:
    """Torque of the quintic in 1 s without weight, and the weight on its way, ``(samples, n)`` each, N m."""
    change = goal - start
    q, still = start + _QUINTIC[:, None] * change, np.zeros((len(_S), len(start)))
    static = arm.inverse_dynamics(q, still, still) if arm.gravity else still
    return arm.inverse_dynamics(q, _SPEED[:, None] * change, _ACCELERATION[:, None] * change) - static, static
