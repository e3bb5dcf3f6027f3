"""The dynamic program of a timing: place and speed on a line as the state, time as the stage.

A stage lasts `STAGE` and has one of the accelerations ``-a, 0, a``. What can be reached from the present state is on
a lattice, speeds ``a STAGE`` and places ``a STAGE^2 / 2`` apart, so the program is exact in time: no state is rounded.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planners.dpct.timing.crossings import (
    CONTACT,
    STAGE,
    ArmLimits,
    PredictedDiscs,
    StraightWay,
    posture,
    predicted_clearance,
    price,
    price_row,
)
from planners.dpct.timing.line import line_along, line_to
from planners.motion.double_integrator import along_profile, fill_profile, rest_time
from planners.typing import Array

LEAST_SPEEDS = 2
"""Speeds of the lattice between rest and the top speed, at least."""

EDGE = 1e-9
"""Rounding of a ratio."""


class Lattice(NamedTuple):
    """What can be reached: the speed ``speed + j rise`` and the place ``speed t + p step``, with whole j and p.

    Attributes:
        stages: how many there are.
        speed: at the start, rad/s.
        rise: between neighbouring speeds, rad/s.
        step: between neighbouring places, rad.
        slowest, fastest: bounds of j.
        back, ahead: bounds of p, the first one negative.
    """

    stages: int
    speed: float
    rise: float
    step: float
    slowest: int
    fastest: int
    back: int
    ahead: int


@njit(cache=True, nogil=True)
def best_timing(
    scene: PredictedDiscs, q: Array, qd: Array, goals: Array, asides: Array, limits: ArmLimits
) -> tuple[float, StraightWay, float, Array]:
    """The best timing on the straight lines to the goals and, if a disc is in their way, on lines aside.

    Args:
        scene: the arm and the discs.
        q, qd: state at time 0, ``(n,)``, rad and rad/s.
        goals, asides: postures to go to, ``(goals, n)``, rad, and directions of the lines aside, ``(lines, n)``.
        limits: of the arm.

    Returns:
        Its cost, its line, and the two other results of `search`; a cost of inf if there is none at all.
    """
    best_line = line_to(q, qd, goals[0], limits)
    best, unit, controls = np.inf, 0.0, np.zeros(0)
    count = goals.shape[0]
    for i in range(count + asides.shape[0]):
        if i == count and len(controls) <= best_line.held and best < np.inf:
            break  # no disc is in the way
        line = line_to(q, qd, goals[i], limits) if i < count else line_along(q, qd, asides[i - count], limits)
        cost, its_unit, its_controls = search(scene, line, goals, limits.table, best)
        if cost < best:
            best, best_line, unit, controls = cost, line, its_unit, its_controls
    return best, best_line, unit, controls


@njit(cache=True, nogil=True)
def search(
    scene: PredictedDiscs, line: StraightWay, goals: Array, limits: Array, bound: float
) -> tuple[float, float, Array]:
    """The best timing on a line, if it costs less than ``bound``.

    Returns:
        Its cost (time to one of the goals and the price of being near a disc, s; inf if there is none), the
        acceleration of the lattice, rad/s^2, and that of each stage in units of it, ``(stages,)``. From there it goes
        to rest as fast as possible: at the goal, or, on a line without one, wherever that is.
    """
    lattice = _lattice(scene, line)
    unit = lattice.rise / STAGE
    if np.isnan(line.low):
        return np.inf, unit, np.zeros(0)
    nothing = np.zeros(line.held)
    if not np.isnan(line.goal):
        start = line.held * STAGE
        least = start + rest_time(line.goal - line.speed * start, line.speed, line.top_speed, line.acceleration)
        if least >= bound:
            return np.inf, unit, nothing
        near = _price_of_holding(scene, line) + _price_of_rest(scene, line, line.speed * start, line.speed, start)
        if near == 0.0:
            return least, unit, nothing
    places, speeds = lattice.ahead - lattice.back + 1, lattice.fastest - lattice.slowest + 1
    came = np.zeros((lattice.stages + 1, places, speeds), dtype=np.int8)
    value = _forward(scene, line, lattice, came)
    cost, p, j = _best_end(line, lattice, value, goals, limits)
    if cost == np.inf:
        return cost, unit, nothing
    controls = _trace_back(lattice, came, p, j)
    if np.isnan(line.goal):
        return cost, unit, controls
    return _leave_early(scene, line, lattice, controls, cost)


@njit(cache=True, nogil=True)
def _lattice(scene: PredictedDiscs, line: StraightWay) -> Lattice:
    """The lattice of a line: coarser than its acceleration allows if that would leave too few speeds."""
    stages = max(line.held + 1, math.ceil(scene.prediction / STAGE - EDGE))
    rise = min(line.acceleration * STAGE, line.top_speed / LEAST_SPEEDS)
    fastest = min(stages, max(0, math.floor((line.top_speed - line.speed) / rise + EDGE)))
    slowest = max(-stages, min(0, -math.floor((line.top_speed + line.speed) / rise + EDGE)))
    ahead = min(stages * stages, stages * (2 * fastest + 1))
    back = -min(stages * stages, stages * (1 - 2 * slowest))
    return Lattice(stages, line.speed, rise, 0.5 * STAGE * rise, slowest, fastest, back, ahead)


@njit(cache=True, nogil=True)
def _forward(scene: PredictedDiscs, line: StraightWay, lattice: Lattice, came: NDArray[np.int8]) -> Array:
    """Least cost of every state of the last stage, ``(places, speeds)``; ``came`` gets the accelerations on the way.

    A timing that touches a disc pays for the first time only: what follows makes no difference.
    """
    places, speeds = came.shape[1], came.shape[2]
    value, after = np.full((places, speeds), np.inf), np.empty((places, speeds))
    value[-lattice.back, -lattice.slowest] = 0.0
    middle, end = np.empty(places), np.empty(places)
    low = high = -lattice.back  # the places that can be reached, as indices
    for k in range(lattice.stages):
        reach = min(k, -lattice.slowest), min(k, lattice.fastest)
        next_low, next_high = low - 2 * reach[0] - 1, high + 2 * reach[1] + 1
        next_low, next_high = max(next_low, 0), min(next_high, places - 1)
        half, full = (k + 0.5) * STAGE, (k + 1) * STAGE
        shift = lattice.step * lattice.back
        price_row(scene, line, half, lattice.speed * half + shift, lattice.step, next_low, next_high, middle)
        price_row(scene, line, full, lattice.speed * full + shift, lattice.step, next_low, next_high, end)
        after[next_low : next_high + 1] = np.inf
        held = k < line.held
        for place in range(low, high + 1):
            for index in range(-lattice.slowest - reach[0], -lattice.slowest + reach[1] + 1):
                before = value[place, index]
                if before == np.inf:
                    continue
                j = index + lattice.slowest
                for control in range(0 if held else -1, 1 if held else 2):
                    if not lattice.slowest <= j + control <= lattice.fastest:
                        continue
                    there = place + 2 * j + control
                    r = lattice.speed * full + lattice.step * (there + lattice.back)
                    v = lattice.speed + lattice.rise * (j + control)
                    stop = r + 0.5 * v * abs(v) / line.acceleration
                    if k + 1 >= line.held and not line.low <= stop <= line.high:
                        continue
                    cost = before + _price_of_stage(before, middle[place + j], end[there])
                    if not (abs(r - line.goal) <= lattice.step and abs(v) <= lattice.rise):
                        cost += STAGE
                    if cost < after[there, index + control]:
                        after[there, index + control] = cost
                        came[k + 1, there, index + control] = control
        value, after = after, value
        low, high = next_low, next_high
    value[:low], value[high + 1 :] = np.inf, np.inf
    return value


@njit(cache=True, nogil=True)
def _price_of_stage(before: float, middle: float, end: float) -> float:
    """What a stage adds to a cost for being near a disc in its middle and at its end."""
    if before >= CONTACT:
        return 0.0
    if middle >= CONTACT:
        return middle
    if end >= CONTACT:
        return end
    return 0.5 * STAGE * (middle + end)


@njit(cache=True, nogil=True)
def _best_end(line: StraightWay, lattice: Lattice, value: Array, goals: Array, limits: Array) -> tuple[float, int, int]:
    """Least cost with what remains from the last stage on, and the p and j of that state."""
    q = np.empty(line.origin.shape[0])
    best, best_p, best_j = np.inf, 0, 0
    for place in range(value.shape[0]):
        for index in range(value.shape[1]):
            cost = value[place, index]
            if cost >= best:
                continue
            p, j = place + lattice.back, index + lattice.slowest
            r = lattice.speed * STAGE * lattice.stages + p * lattice.step
            v = lattice.speed + j * lattice.rise
            if np.isnan(line.goal):
                braking = abs(v) / line.acceleration
                posture(line, r + 0.5 * v * braking, np.inf, q)
                cost += braking + time_from_rest(q, goals, limits)
            else:
                cost += rest_time(line.goal - r, v, line.top_speed, line.acceleration)
            if cost < best:
                best, best_p, best_j = cost, p, j
    return best, best_p, best_j


@njit(cache=True, nogil=True)
def time_from_rest(q: Array, goals: Array, limits: Array) -> float:
    """Least time, s, from rest at ``q``, ``(n,)``, to rest at the closest of the goals, ``(goals, n)``, rad."""
    least = np.inf
    for goal in range(goals.shape[0]):
        slowest = 0.0
        for i in range(q.shape[0]):
            slowest = max(slowest, rest_time(goals[goal, i] - q[i], 0.0, limits[1, i], limits[2, i]))
        least = min(least, slowest)
    return least


@njit(cache=True, nogil=True)
def _trace_back(lattice: Lattice, came: NDArray[np.int8], p: int, j: int) -> Array:
    """The accelerations that lead to a state of the last stage."""
    controls = np.empty(lattice.stages)
    for k in range(lattice.stages, 0, -1):
        control = came[k, p - lattice.back, j - lattice.slowest]
        controls[k - 1] = control
        j -= control
        p -= 2 * j + control
    return controls


@njit(cache=True, nogil=True)
def _leave_early(
    scene: PredictedDiscs, line: StraightWay, lattice: Lattice, controls: Array, cost: float
) -> tuple[float, float, Array]:
    """The timing, left for the fastest way to the goal at the stage where that costs least."""
    q = np.empty(line.origin.shape[0])
    unit = lattice.rise / STAGE
    best, kept = cost, lattice.stages
    r, v, near = 0.0, line.speed, 0.0
    for k in range(lattice.stages):
        t = k * STAGE
        if k >= line.held:
            total = t + near + rest_time(line.goal - r, v, line.top_speed, line.acceleration)
            if total < best:
                total += _price_of_rest(scene, line, r, v, t)
                if total < best:
                    best, kept = total, k
        u = controls[k] * unit
        halves = np.empty(2)
        for half in range(2):
            s = 0.5 * (half + 1) * STAGE
            posture(line, r + s * (v + 0.5 * s * u), t + s, q)
            halves[half] = price(scene, predicted_clearance(scene, q, t + s), t + s)
        near += _price_of_stage(near, halves[0], halves[1])
        r, v = r + STAGE * (v + 0.5 * STAGE * u), v + STAGE * u
    return best, unit, controls[:kept]


@njit(cache=True, nogil=True)
def _price_of_holding(scene: PredictedDiscs, line: StraightWay) -> float:
    """Price of the stages in which the speed stays as it is."""
    q = np.empty(line.origin.shape[0])
    total = 0.0
    for half in range(1, 2 * line.held + 1):
        t = 0.5 * STAGE * half
        posture(line, line.speed * t, t, q)
        total += price(scene, predicted_clearance(scene, q, t), t)
    return total


@njit(cache=True, nogil=True)
def _price_of_rest(scene: PredictedDiscs, line: StraightWay, r: float, v: float, start: float) -> float:
    """Price of the fastest way to rest at the goal from place ``r`` and speed ``v`` at time ``start``."""
    q, profile = np.empty(line.origin.shape[0]), np.empty(4)
    fill_profile(line.goal - r, v, line.top_speed, line.acceleration, 0.0, profile)
    total = 0.0
    step = 0.5 * STAGE
    for half in range(1, math.floor((scene.prediction - start) / step + EDGE) + 1):
        s = step * half
        posture(line, r + along_profile(profile, v, line.acceleration, s)[0], start + s, q)
        rate = price(scene, predicted_clearance(scene, q, start + s), start + s)
        if rate >= CONTACT:
            return total + rate
        total += step * rate
    return total
