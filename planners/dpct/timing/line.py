"""From a state of motion to a straight line in joint space: what of the velocity leads along it, and what across."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from planners.dpct.timing.crossings import STAGE, ArmLimits, StraightWay
from planners.robot.dynamics import inverse_dynamics_single
from planners.typing import Array

GENTLE = 0.05
"""Share of the acceleration limits that may shed a small velocity across the line while the motion goes on."""

GENTLE_STAGES = 3
"""Number of stages in which a velocity across the line has to be shed to count as small."""

ROUNDS = 3
"""Rounds of the fixed point: the way left decides what is across it, and shedding that covers part of the way."""

SPARED_SPEED = 1.0 - 1e-4
"""Share of the velocity limits at which a motion that is too fast goes on."""

TINY = 1e-9
"""Angle, rad, or velocity, rad/s, that is rounding."""

SLACK = 0.005
"""How far a joint may leave its range, rad, that a tracking error makes too fast to stop within it."""

LEAST_LENGTH = 1e-9
"""Distance between start and goal, rad, below which a line between them has no direction."""

PROBES = 5
"""Places on a line at which the torque limits are looked at."""


@njit(cache=True, nogil=True)
def line_to(q: Array, qd: Array, goal: Array, limits: ArmLimits) -> StraightWay:
    """The line to a goal, ``(n,)``, rad, from the state ``q``, ``qd``, once the velocity across it is shed."""
    velocity, acceleration = limits.table[1], limits.table[2]
    change = goal - q
    square = np.sum(change * change)
    if square > LEAST_LENGTH**2:
        way = change
        speed = float(np.sum(qd * change) / square)  # ways per second, until the line is made
        for _ in range(ROUNDS):
            speed = _allowed_speed(speed, way, velocity)
            shed, gentle = _shedding(qd - speed * way, acceleration)
            # where all is shed, what is left of the way is: change - shed / 2 (qd - speed way)
            spared = max(0.5, 1.0 - 0.5 * speed * shed)
            way = (change - 0.5 * shed * qd) / spared
        across = qd - speed * way
        most = acceleration * shed * (2.0 * GENTLE if gentle else 1.0) + TINY
        if spared > 0.5 and np.all(np.abs(across) <= most) and np.all(np.abs(speed * way) <= velocity):
            return _line(q, way, speed, across, shed, gentle, True, limits)
    shed, gentle = _shedding(qd, acceleration)
    return _line(q, change - 0.5 * shed * qd, 0.0, qd.copy(), shed, gentle, True, limits)


@njit(cache=True, nogil=True)
def line_along(q: Array, qd: Array, way: Array, limits: ArmLimits) -> StraightWay:
    """The line without a goal in a direction ``way``, ``(n,)``; the other arguments are those of `line_to`."""
    speed = _allowed_speed(np.sum(qd * way) / np.sum(way * way), way, limits.table[1])
    across = qd - speed * way
    shed, gentle = _shedding(across, limits.table[2])
    return _line(q, way, speed, across, shed, gentle, False, limits)


@njit(cache=True, nogil=True)
def _allowed_speed(speed: float, way: Array, limit: Array) -> float:
    """The speed along a way, 1/s, brought within the velocity limits of the joints: what is beyond must be shed."""
    excess = np.max(np.abs(speed * way) / limit)
    return speed * SPARED_SPEED / excess if excess > SPARED_SPEED else speed


@njit(cache=True, nogil=True)
def _shedding(across: Array, acceleration: Array) -> tuple[float, bool]:
    """How long it takes to shed a velocity, s, and whether that leaves most of the acceleration for other use."""
    least = np.max(np.abs(across) / acceleration)
    gentle = math.ceil(least / GENTLE / STAGE - 1e-9)
    if gentle <= GENTLE_STAGES:
        return gentle * STAGE, True
    return math.ceil(least / STAGE - 1e-9) * STAGE, False


@njit(cache=True, nogil=True)
def _line(
    q: Array, way: Array, speed: float, across: Array, shed: float, gentle: bool, has_goal: bool, limits: ArmLimits
) -> StraightWay:
    """The line ``way`` long and what the limits allow on it."""
    table = limits.table
    origin = q + 0.5 * shed * across
    length = math.sqrt(np.sum(way * way))
    if length > LEAST_LENGTH:
        direction = way / length
    else:
        length, direction = 0.0, np.zeros_like(way)
        direction[0] = 1.0
    acceleration, top_speed, low, high = np.inf, np.inf, -np.inf, np.inf
    for i in range(q.shape[0]):
        slope = abs(direction[i])
        if slope > 0.0:
            besides = abs(across[i]) if gentle and shed > 0.0 else 0.0
            top_speed = min(top_speed, (table[1, i] - besides) / slope)
            acceleration = min(acceleration, (table[2, i] - (besides / shed if besides > 0.0 else 0.0)) / slope)
            to_zero = -origin[i] / direction[i]
            low, high = max(low, to_zero - table[3, i] / slope), min(high, to_zero + table[3, i] / slope)
    acceleration = min(acceleration, _most_acceleration(origin, direction, length, limits))
    if acceleration <= 0.0 or top_speed <= 0.0:
        low = high = np.nan
    acceleration, top_speed = max(acceleration, TINY), max(top_speed, TINY)
    speed *= length
    goal = length if has_goal else np.nan
    held = 0 if gentle else round(shed / STAGE)
    stop = speed * (held * STAGE + 0.5 * abs(speed) / acceleration)
    if not np.isnan(low):
        low, high = min(low, stop) - TINY, max(high, stop) + TINY
    for i in range(q.shape[0]):
        # a start at the edge of a range, or beyond it, is no reason not to move, but going further out is
        if abs(origin[i] + stop * direction[i]) > max(table[3, i], abs(q[i])) + SLACK:
            low = high = np.nan
    return StraightWay(origin, direction, across, shed, speed, top_speed, acceleration, low, high, goal, held)


@njit(cache=True, nogil=True)
def _most_acceleration(origin: Array, direction: Array, length: float, limits: ArmLimits) -> float:
    """What the torque limits leave for accelerating along the line from rest, rad/s^2."""
    n = origin.shape[0]
    still, moved, held, weightless = np.zeros(n), np.empty(n), np.empty(n), np.zeros(n)
    most = np.inf
    for probe in range(PROBES):
        q = origin + length * probe / (PROBES - 1) * direction
        inverse_dynamics_single(limits.coupling, limits.weight, q, still, still, held)
        inverse_dynamics_single(limits.coupling, weightless, q, still, direction, moved)
        for i in range(n):
            if moved[i] != 0.0:
                most = min(most, (limits.table[0, i] - abs(held[i])) / abs(moved[i]))
    return most
