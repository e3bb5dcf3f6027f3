"""The dynamic program of a timing: position and speed on a line as the state, time as the stage.

A stage lasts `STAGE` and has one of the accelerations ``-a, 0, a``. The reachable states are on a lattice, speeds
``a STAGE`` and positions ``a STAGE^2 / 2`` apart, so the program is exact in time: no state is rounded.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planners.compiled.calls import private
from planners.dpct.timing.crossings import (
    CONTACT,
    STAGE,
    ArmLimits,
    PredictedDiscs,
    StraightLine,
    cost_at,
    fill_costs,
    posture,
)
from planners.dpct.timing.line import line_along, line_fields, line_to
from planners.motion.double_integrator import along_profile, fill_profile, rest_time
from planners.typing import Array

LEAST_SPEEDS = 2  # speeds of the lattice between rest and the top speed, at least
MOST_STAGES = 60  # of constant speed, where discs are near: the effort grows with the cube of all stages
EDGE = 1e-9  # rounding of a ratio


class Lattice(NamedTuple):
    """The reachable states: speeds ``line.speed + j rise`` and positions ``line.speed t + p step``, whole j and p.

    Attributes:
        stages: number of stages.
        rise: between neighbouring speeds, rad/s.
        step: between neighbouring positions, rad.
        slowest, fastest: bounds of j.
        back, ahead: bounds of p, the first one negative.
    """

    stages: int
    rise: float
    step: float
    slowest: int
    fastest: int
    back: int
    ahead: int


@njit(cache=True, nogil=True)
def best_timing(
    scene: PredictedDiscs, q: Array, qd: Array, goals: Array, asides: Array, limits: ArmLimits
) -> tuple[float, tuple[Any, ...], Array]:
    """The best timing on the straight lines to the goals and, if discs block all of them, on detours.

    Args:
        scene: the arm and the discs.
        q, qd: state at time 0, ``(n,)``, rad and rad/s.
        goals, asides: goal postures, ``(goals, n)``, rad, and directions of the detours, ``(lines, n)``.
        limits: of the arm.

    Returns:
        Its cost, the fields of its line, and the accelerations of `search`; the cost is inf if there is none.
    """
    best_line = line_to(q, qd, goals[0], limits)
    best, accelerations = np.inf, np.zeros(0)
    count = goals.shape[0]
    for i in range(count + asides.shape[0]):
        if i == count and len(accelerations) <= best_line.held and best < np.inf:
            break  # no disc blocks the line
        line = line_to(q, qd, goals[i], limits) if i < count else line_along(q, qd, asides[i - count], limits)
        cost, found = search(scene, line, goals, limits.table, best)
        if cost < best:
            best, best_line, accelerations = cost, line, found
    return best, line_fields(best_line), accelerations


@njit(cache=True, nogil=True)
def search(scene: PredictedDiscs, line: StraightLine, goals: Array, limits: Array, bound: float) -> tuple[float, Array]:
    """The best timing on a line, if it costs less than ``bound``.

    Returns:
        Its cost (time to one of the goals and the cost of small clearances, s; inf if there is none), and the
        acceleration of each stage, ``(stages,)``, rad/s^2. After them the motion comes to rest as fast as possible: at
        the goal, or anywhere on a line without one.
    """
    lattice = _lattice(scene, line)
    constant_speed = np.zeros(line.held)
    if np.isnan(line.low):
        return np.inf, constant_speed
    if not np.isnan(line.goal):
        start = line.held * STAGE
        least = start + rest_time(line.goal - line.speed * start, line.speed, line.top_speed, line.acceleration)
        if least >= bound:
            return np.inf, constant_speed
        near = _cost_of_constant_speed(scene, line) + _cost_to_rest(scene, line, line.speed * start, line.speed, start)
        if near == 0.0:
            return least, constant_speed
    if line.held > MOST_STAGES:
        return np.inf, constant_speed
    places, speeds = lattice.ahead - lattice.back + 1, lattice.fastest - lattice.slowest + 1
    came = np.zeros((lattice.stages + 1, places, speeds), dtype=np.int8)
    value = _forward(scene, line, lattice, came)
    cost, p, j = _best_end(line, lattice, value, goals, limits)
    if cost == np.inf:
        return cost, constant_speed
    accelerations = _trace_back(lattice, came, p, j)
    if np.isnan(line.goal):
        return cost, accelerations
    return _leave_early(scene, line, accelerations, cost)


@private
def _lattice(scene: PredictedDiscs, line: StraightLine) -> Lattice:
    """The lattice of a line: coarser than its acceleration allows if that would leave too few speeds."""
    stages = max(line.held + 1, math.ceil(scene.prediction / STAGE - EDGE))
    rise = min(line.acceleration * STAGE, line.top_speed / LEAST_SPEEDS)
    fastest = min(stages, max(0, math.floor((line.top_speed - line.speed) / rise + EDGE)))
    slowest = max(-stages, min(0, -math.floor((line.top_speed + line.speed) / rise + EDGE)))
    ahead = min(stages * stages, stages * (2 * fastest + 1))
    back = -min(stages * stages, stages * (1 - 2 * slowest))
    return Lattice(stages, rise, 0.5 * STAGE * rise, slowest, fastest, back, ahead)


@private
def _forward(scene: PredictedDiscs, line: StraightLine, lattice: Lattice, came: NDArray[np.int8]) -> Array:
    """Least cost of every state of the last stage, ``(places, speeds)``; ``came`` gets the accelerations to each state.

    Only the first contact of a timing has a cost, and nothing after it.
    """
    places, speeds = came.shape[1], came.shape[2]
    value, after = np.empty((places, speeds)), np.empty((places, speeds))
    for place in range(places):
        for index in range(speeds):
            value[place, index] = np.inf
    value[-lattice.back, -lattice.slowest] = 0.0
    middle, end = np.empty(places), np.empty(places)
    low = high = -lattice.back  # the places that can be reached, as indices
    shift = lattice.step * lattice.back
    for k in range(lattice.stages):
        reach = min(k, -lattice.slowest), min(k, lattice.fastest)
        next_low, next_high = max(low - 2 * reach[0] - 1, 0), min(high + 2 * reach[1] + 1, places - 1)
        half, full = (k + 0.5) * STAGE, (k + 1) * STAGE
        fill_costs(scene, line, half, line.speed * half + shift, lattice.step, next_low, next_high, middle)
        fill_costs(scene, line, full, line.speed * full + shift, lattice.step, next_low, next_high, end)
        for place in range(next_low, next_high + 1):
            for index in range(speeds):
                after[place, index] = np.inf
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
                    r = line.speed * full + lattice.step * (there + lattice.back)
                    v = line.speed + lattice.rise * (j + control)
                    stop = r + 0.5 * v * abs(v) / line.acceleration
                    if k + 1 >= line.held and not line.low <= stop <= line.high:
                        continue
                    cost = before + _cost_of_stage(before, middle[place + j], end[there])
                    if not (abs(r - line.goal) <= lattice.step and abs(v) <= lattice.rise):
                        cost += STAGE
                    if cost < after[there, index + control]:
                        after[there, index + control] = cost
                        came[k + 1, there, index + control] = control
        value, after = after, value
        low, high = next_low, next_high
    for place in range(places):
        if not low <= place <= high:
            for index in range(speeds):
                value[place, index] = np.inf
    return value


@private
def _cost_of_stage(before: float, middle: float, end: float) -> float:
    """Cost of small clearances in a stage, from those per second in its middle and at its end."""
    if before >= CONTACT:
        return 0.0
    if middle >= CONTACT:
        return middle
    if end >= CONTACT:
        return end
    return 0.5 * STAGE * (middle + end)


@private
def _best_end(
    line: StraightLine, lattice: Lattice, value: Array, goals: Array, limits: Array
) -> tuple[float, int, int]:
    """Least cost with what remains from the last stage on, and the p and j of that state."""
    q = np.empty(line.origin.shape[0])
    best, best_p, best_j = np.inf, 0, 0
    for place in range(value.shape[0]):
        for index in range(value.shape[1]):
            cost = value[place, index]
            if cost >= best:
                continue
            p, j = place + lattice.back, index + lattice.slowest
            r = line.speed * STAGE * lattice.stages + p * lattice.step
            v = line.speed + j * lattice.rise
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


@private
def _trace_back(lattice: Lattice, came: NDArray[np.int8], p: int, j: int) -> Array:
    """The accelerations that lead to a state of the last stage, ``(stages,)``, rad/s^2."""
    unit = lattice.rise / STAGE
    accelerations = np.empty(lattice.stages)
    for k in range(lattice.stages, 0, -1):
        control = came[k, p - lattice.back, j - lattice.slowest]
        accelerations[k - 1] = control * unit
        j -= control
        p -= 2 * j + control
    return accelerations


@private
def _leave_early(scene: PredictedDiscs, line: StraightLine, accelerations: Array, cost: float) -> tuple[float, Array]:
    """The timing, cut at the stage from which the fastest motion to the goal gives the least cost."""
    q = np.empty(line.origin.shape[0])
    best, kept = cost, len(accelerations)
    r, v, near = 0.0, line.speed, 0.0
    for k in range(len(accelerations)):
        t = k * STAGE
        if k >= line.held:
            total = t + near + rest_time(line.goal - r, v, line.top_speed, line.acceleration)
            if total < best:
                total += _cost_to_rest(scene, line, r, v, t)
                if total < best:
                    best, kept = total, k
        u, half = accelerations[k], 0.5 * STAGE
        middle = cost_at(scene, line, r + half * (v + 0.5 * half * u), t + half, q)
        r, v = r + STAGE * (v + 0.5 * STAGE * u), v + STAGE * u
        near += _cost_of_stage(near, middle, cost_at(scene, line, r, t + STAGE, q))
    return best, accelerations[:kept]


@private
def _cost_of_constant_speed(scene: PredictedDiscs, line: StraightLine) -> float:
    """Cost of small clearances in the stages of constant speed."""
    q = np.empty(line.origin.shape[0])
    total = 0.0
    for half in range(1, min(2 * line.held, round(2.0 * scene.prediction / STAGE)) + 1):
        t = 0.5 * STAGE * half
        total += cost_at(scene, line, line.speed * t, t, q)
    return total


@private
def _cost_to_rest(scene: PredictedDiscs, line: StraightLine, r: float, v: float, start: float) -> float:
    """Cost of small clearances on the fastest motion to rest at the goal, from ``r`` and speed ``v`` at ``start``."""
    q, profile = np.empty(line.origin.shape[0]), np.empty(4)
    fill_profile(line.goal - r, v, line.top_speed, line.acceleration, 0.0, profile)
    total = 0.0
    step = 0.5 * STAGE
    for half in range(1, math.floor((scene.prediction - start) / step + EDGE) + 1):
        s = step * half
        rate = cost_at(scene, line, r + along_profile(profile, v, line.acceleration, s)[0], start + s, q)
        if rate >= CONTACT:
            return total + rate
        total += step * rate
    return total
