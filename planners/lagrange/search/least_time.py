"""Why a fixed target is not reached in time, and in what time it is: bounds, brackets and a bisection."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from planners.checks import rounded_up
from planners.lagrange.joint_move import Curve, JointMove, Objective
from planners.lagrange.search.multistart import any_motion, direct_motion, reaches
from planners.motion.double_integrator import rest_time
from planners.problem import Infeasible
from planners.typing import Array

PRECISION = 0.01
"""Relative precision of the least time."""

LONGER = (1.0, 1.1, 1.5, 3.0)
"""Times that are tried for a plan from where a quick probe finds a motion, as multiples of that time."""

EARLIER, HALVINGS = 0.3, 8
"""Least time that is tried, as a share of that of the quick probe, and halvings of the range of times above it."""

SEARCHES, HEAVY_SEARCHES = 24, 12
"""Searches from many starts, times the number of links, to which the time of a search is about proportional; and the
same under gravity, where there are more starts.
"""

QUICKER, THOROUGH = 0.96, 4
"""A share of the least time found under gravity that a plan could take, since its search is the more thorough one; and
how often at most such a shorter time is tried."""

BESIDE = (1.0, 1.001)
"""Multiples of a time in which motions must be found for it to be named: searches fail by chance."""

SLOWER = (1.02, 1.5, 3.0, 10.0, 30.0)
"""Times that are probed, as multiples of the time in which the quintic to rest keeps the limits."""

HELD = 0.99
"""Largest share of a torque limit that weight takes where a time of the quintic is known, and a share of the least
time of single joints that is within rounding."""

WAY_SHARES = np.linspace(0.0, 1.0, 21)


def joint_time(move: JointMove) -> float:
    """Time that every motion to rest takes: that of each joint by itself, with its velocity and acceleration, s."""
    (q, qd, _), (goal, _, _) = move.ends
    tops, rises = move.limits.array("velocity"), move.limits.array("acceleration")
    least = 0.0
    for change, v, top, rise in zip(goal - q, qd, tops, rises, strict=True):
        if math.isfinite(rise):
            least = max(least, rest_time(change, v, top, rise))
        elif math.isfinite(top):
            least = max(least, abs(change) / top)
    return HELD * least


def late(
    moves: Sequence[JointMove],
    objective: Objective,
    guess: Curve | None,
    planned: Callable[[Sequence[JointMove]], object | None],
) -> Infeasible:
    """Why a fixed target is not reached in time: the least feasible time of any of the moves, if one is found.

    ``planned`` plans any of the moves, or gives None.
    """
    horizon = moves[0].duration
    weak = _too_weak_on_the_way(moves)
    bracket = _bracket(moves, max(horizon, min(map(joint_time, moves))))
    if bracket is None:
        return weak or Infeasible("limits", f"no motion within the limits found, whether in {horizon:.4g} s or more")
    move, high = bracket[0], _least(*bracket)
    searches = iter(range((HEAVY_SEARCHES if move.arm.gravity else SEARCHES) // move.arm.n_joints))

    def found(time: float, *, surely: bool = False) -> bool:
        if direct_motion([replace(move, duration=time)], objective) is not None:
            return True
        if next(searches, None) is None and not surely:
            return False
        return any_motion([replace(other, duration=time) for other in moves], objective, guess) is not None

    enough = next((time for factor in LONGER if found(time := rounded_up(factor * high))), None)
    if enough is None:
        return weak or too_late(horizon, math.inf)
    low, falling = max(horizon, EARLIER * high), [enough]
    for _ in range(HALVINGS):
        middle = rounded_up(math.sqrt(low * falling[-1]))
        if low < middle < falling[-1] and found(middle):
            falling.append(middle)
        else:
            low = middle
    sure = (time for time in reversed(falling) if found(BESIDE[1] * time, surely=True))
    least = next(sure, math.inf)
    for _ in range(THOROUGH if moves[0].arm.gravity and least < math.inf else 0):
        earlier = [replace(other, duration=rounded_up(QUICKER * least)) for other in moves]
        if earlier[0].duration <= horizon or planned(earlier) is None:
            break
        least = earlier[0].duration
    return too_late(horizon, least)


def too_late(time: float, minimum: float) -> Infeasible:
    """The refusal of a motion in a time, with the least one that does, s; inf if that is not known."""
    message = f"{time:.4g} s are not enough for a motion within the limits"
    if math.isinf(minimum):
        return Infeasible("late", f"{message}; allow more", time=time)
    return Infeasible("late", f"{message}; allow at least {rounded_up(minimum):.4g} s", time=time, minimum_time=minimum)


def _least(move: JointMove, low: float, high: float) -> float:
    """The least time from ``low`` to ``high``, s, for which a quick probe finds a motion, by bisection."""
    while high - low > PRECISION * high:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if reaches(replace(move, duration=middle)) else (middle, high)
    return high


def _bracket(moves: Sequence[JointMove], low: float) -> tuple[JointMove, float, float] | None:
    """A move that a quick probe finds a motion for, a time without one (not less than ``low``) and one with one, s."""
    slow = min(max(low, _quintic_time(move)) for move in moves)
    for factor in SLOWER:
        high = factor * slow
        for move in moves:
            if reaches(replace(move, duration=high)):
                return move, low, high
        low = high
    return None


def _quintic_time(move: JointMove) -> float:
    """Time in which the quintic between two states of rest keeps the limits, s; weight may leave less torque for it."""
    still = np.zeros_like(move.ends.start)
    start, goal = still.copy(), still.copy()
    start[0], goal[0] = move.ends.start[0], move.ends.end[0]
    s = np.linspace(0.0, 1.0, 101)
    u, change = s[:, None], goal[0] - start[0]
    q = start[0] + (10.0 * u**3 - 15.0 * u**4 + 6.0 * u**5) * change
    rates = 30.0 * (u * (1.0 - u)) ** 2 * change
    bends = (60.0 * u - 180.0 * u**2 + 120.0 * u**3) * change
    weight = move.arm.inverse_dynamics(q, 0.0 * q, 0.0 * q)
    torque = np.abs(move.arm.inverse_dynamics(q, rates, bends) - weight)
    limits = move.limits
    room = np.maximum(1.0 - HELD, 1.0 - np.abs(weight) / limits.array("torque"))
    return max(
        float((np.abs(rates) / limits.array("velocity")).max()),
        math.sqrt(float((np.abs(bends) / limits.array("acceleration")).max())),
        math.sqrt(float((torque / limits.array("torque") / room).max())),
        math.cbrt(float((60.0 * np.abs(change) / limits.array("jerk")).max())),
    )


def holdable(move: JointMove, goals: Sequence[Array]) -> list[Array]:
    """Goals at which the torque limits hold the arm against gravity.

    Raises:
        Infeasible: with reason ``limits`` if there is none.
    """
    loads = [_weight_loads(move, goal) for goal in goals]
    held = [goal for goal, load in zip(goals, loads, strict=True) if load.max() <= 1.0]
    if not held:
        raise _too_weak(move, goals[int(np.argmin([load.max() for load in loads]))], "hold the target")
    return held


def _weight_loads(move: JointMove, q: Array) -> Array:
    """|torque| / limit of every joint at rest in a posture, ``(n,)``."""
    still = np.zeros_like(q)
    loads: Array = np.abs(move.arm.inverse_dynamics(q, still, still)) / move.limits.array("torque")
    return loads


def _too_weak_on_the_way(moves: Sequence[JointMove]) -> Infeasible | None:
    """The refusal where gravity takes more than a torque limit at the start, or on every straight way to a goal."""
    start = moves[0].ends.start[0]
    if _weight_loads(moves[0], start).max() > 1.0:
        return _too_weak(moves[0], start, "hold the start")
    ways = [start + share * (move.ends.end[0] - start) for move in moves for share in WAY_SHARES]
    loads = np.array([_weight_loads(moves[0], q).max() for q in ways]).reshape(len(moves), -1)
    easiest = int(loads.max(axis=1).argmin())
    if loads[easiest].max() <= 1.0:
        return None
    q = ways[easiest * len(WAY_SHARES) + int(loads[easiest].argmax())]
    return _too_weak(moves[0], q, "pass slowly on the straight way to the target")


def _too_weak(move: JointMove, q: Array, what: str) -> Infeasible:
    """The refusal of a posture in which gravity takes more than a torque limit."""
    loads = _weight_loads(move, q)
    joint = int(loads.argmax())
    limit = float(move.limits.array("torque")[joint])
    message = (
        f"joint {joint + 1} needs {loads[joint] * limit:.4g} N m against gravity to {what}, and its torque limit is "
        f"{limit:.4g} N m; raise the limit or reduce the payload"
    )
    return Infeasible("limits", message, joint=joint, kind="torque", ratio=float(loads[joint]))
