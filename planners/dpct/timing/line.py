"""The straight joint-space line from the present state: splits the velocity into parts along and across the line."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from planners.compiled.calls import dividing, private
from planners.dpct.timing.crossings import STAGE, ArmLimits, StraightLine
from planners.robot.dynamics import inverse_dynamics_single
from planners.typing import Array

GENTLE = 0.05
"""Share of the acceleration limits for braking a small transverse velocity during the motion along the line."""

GENTLE_STAGES = 3  # most stages of such braking
ROUNDS = 3  # of a fixed point: the line gives the transverse velocity, whose decay covers part of the line
SPARED_SPEED = 1.0 - 1e-4  # share of the velocity limits to which a motion above them is reduced
TINY = 1e-9  # angle, rad, or velocity, rad/s, within rounding
LEAST_LENGTH = 1e-9  # distance between start and goal, rad, below which a line between them has no direction
LONGEST_BRAKING = 1000.0  # of a transverse velocity, s: beyond that a line is infeasible
PROBES = 5  # positions on a line at which the torque limits are checked

SLACK = 0.005
"""Largest excess of a joint range, rad, by a start that a tracking error has made too fast to stop within it."""


@private
def line_fields(line: StraightLine) -> tuple[Any, ...]:
    """The fields of a line, which compiled functions give to interpreted ones instead of the named tuple."""
    motion = (line.across, line.decay, line.speed, line.top_speed, line.acceleration)
    return (line.origin, line.direction, *motion, line.low, line.high, line.goal, line.held)


@njit(cache=True, nogil=True)
def fields_of_line_to(q: Array, qd: Array, goal: Array, limits: ArmLimits) -> tuple[Any, ...]:
    """`line_to` for interpreted functions."""
    return line_fields(line_to(q, qd, goal, limits))


@private
def line_to(q: Array, qd: Array, goal: Array, limits: ArmLimits) -> StraightLine:
    """The line to a goal, ``(n,)``, rad, from the state ``q``, ``qd``, once the transverse velocity is 0."""
    n, table = q.shape[0], limits.table
    change, displacement, across = np.empty(n), np.empty(n), np.empty(n)
    square = speed = 0.0
    for i in range(n):
        change[i] = displacement[i] = goal[i] - q[i]
        square += change[i] * change[i]
        speed += qd[i] * change[i]
    within = square > LEAST_LENGTH**2
    decay, gentle = 0.0, True
    if within:
        speed /= square  # displacements per second, until the line is made
        spared = 1.0
        for _ in range(ROUNDS):
            speed = _allowed_speed(speed, displacement, table)
            decay, gentle = _transverse_braking(qd, speed, displacement, table)
            # remaining displacement once the transverse velocity is 0: change - decay / 2 (qd - speed displacement)
            spared = max(0.5, 1.0 - 0.5 * speed * decay)
            for i in range(n):
                displacement[i] = (change[i] - 0.5 * decay * qd[i]) / spared
        within = spared > 0.5
        for i in range(n):
            across[i] = qd[i] - speed * displacement[i]
            most = table[2, i] * decay * (2.0 * GENTLE if gentle else 1.0) + TINY
            within = within and abs(across[i]) <= most and abs(speed * displacement[i]) <= table[1, i]
    if not within:
        speed = 0.0
        decay, gentle = _transverse_braking(qd, 0.0, displacement, table)
        for i in range(n):
            displacement[i], across[i] = change[i] - 0.5 * decay * qd[i], qd[i]
    return _line(q, displacement, speed, across, decay, gentle, 1.0, limits)


@private
def line_along(q: Array, qd: Array, direction: Array, limits: ArmLimits) -> StraightLine:
    """The line without a goal in a direction, ``(n,)``; the other arguments are those of `line_to`."""
    along = square = 0.0
    for i in range(q.shape[0]):
        along += qd[i] * direction[i]
        square += direction[i] * direction[i]
    speed = _allowed_speed(along / square, direction, limits.table)
    decay, gentle = _transverse_braking(qd, speed, direction, limits.table)
    across = np.empty(q.shape[0])
    for i in range(q.shape[0]):
        across[i] = qd[i] - speed * direction[i]
    return _line(q, direction, speed, across, decay, gentle, np.nan, limits)


@dividing
def _allowed_speed(speed: float, displacement: Array, table: Array) -> float:
    """The speed, 1/s, reduced to the velocity limits of the joints; the excess becomes transverse velocity."""
    excess = 0.0
    for i in range(displacement.shape[0]):
        excess = max(excess, abs(speed * displacement[i]) / table[1, i])
    return speed * SPARED_SPEED / excess if excess > SPARED_SPEED else speed


@dividing
def _transverse_braking(qd: Array, speed: float, displacement: Array, table: Array) -> tuple[float, bool]:
    """Time for braking a transverse velocity, s, and whether that leaves most of the acceleration for other use."""
    least = 0.0
    for i in range(qd.shape[0]):
        least = max(least, abs(qd[i] - speed * displacement[i]) / table[2, i])
    gentle = math.ceil(least / GENTLE / STAGE - 1e-9)
    if gentle <= GENTLE_STAGES:
        return gentle * STAGE, True
    return math.ceil(least / STAGE - 1e-9) * STAGE, False


@njit(cache=True, nogil=True)
def _line(
    q: Array, vector: Array, speed: float, across: Array, decay: float, gentle: bool, end: float, limits: ArmLimits
) -> StraightLine:
    """The line along a vector, ``(n,)``, and what the limits allow on it.

    The goal lies at ``end`` vectors; NaN for a line without one.
    """
    n, table = q.shape[0], limits.table
    origin, direction, square = np.empty(n), np.zeros(n), 0.0
    for i in range(n):
        origin[i] = q[i] + 0.5 * decay * across[i]
        square += vector[i] * vector[i]
    length = math.sqrt(square)
    if length > LEAST_LENGTH:
        for i in range(n):
            direction[i] = vector[i] / length
    else:
        length, direction[0] = 0.0, 1.0
    acceleration, top_speed, low, high = np.inf, np.inf, -np.inf, np.inf
    for i in range(n):
        slope = abs(direction[i])
        if slope > 0.0:
            besides = abs(across[i]) if gentle and decay > 0.0 else 0.0
            top_speed = min(top_speed, (table[1, i] - besides) / slope)
            acceleration = min(acceleration, (table[2, i] - (besides / decay if besides > 0.0 else 0.0)) / slope)
            to_middle = (limits.middle[i] - origin[i]) / direction[i]
            low, high = max(low, to_middle - table[3, i] / slope), min(high, to_middle + table[3, i] / slope)
    acceleration = min(acceleration, _most_acceleration(origin, direction, length, limits))
    if not (acceleration > 0.0 and top_speed > 0.0 and decay <= LONGEST_BRAKING):
        low = high = np.nan
    acceleration, top_speed = max(acceleration, TINY), max(top_speed, TINY)
    speed *= length
    goal = length * end
    held = 0 if gentle else round(min(decay, LONGEST_BRAKING) / STAGE)
    stop = speed * (held * STAGE + 0.5 * abs(speed) / acceleration)
    if not np.isnan(low):
        low, high = min(low, stop) - TINY, max(high, stop) + TINY
    for i in range(n):
        # a start at the edge of a range or beyond it is allowed, moving further out is not
        middle = limits.middle[i]
        if abs(origin[i] + stop * direction[i] - middle) > max(table[3, i], abs(q[i] - middle)) + SLACK:
            low = high = np.nan
    return StraightLine(origin, direction, across, decay, speed, top_speed, acceleration, low, high, goal, held)


@private
def _most_acceleration(origin: Array, direction: Array, length: float, limits: ArmLimits) -> float:
    """Largest acceleration along the line from rest within the torque limits, rad/s^2."""
    n = origin.shape[0]
    still, moved, held, weightless, q = np.zeros(n), np.empty(n), np.empty(n), np.zeros(n), np.empty(n)
    most = np.inf
    for probe in range(PROBES):
        for i in range(n):
            q[i] = origin[i] + length * probe / (PROBES - 1) * direction[i]
        inverse_dynamics_single(limits.coupling, limits.weight, q, still, still, held)
        inverse_dynamics_single(limits.coupling, weightless, q, still, direction, moved)
        for i in range(n):
            if moved[i] != 0.0:
                most = min(most, (limits.table[0, i] - abs(held[i])) / abs(moved[i]))
    return most
