"""Primal-dual interior point method for the tracking problem on stages, with a free or a given rendezvous time.

The index is ``weight_time T + weight_error J``: a large ratio of the two asks for the earliest rendezvous and, at
that time, the least tracking index J (eq 18 of "Motion Planning of a Robot Manipulator for Conveyor Tracking").
Constraints get slacks; they are linearised about the motion at hand in every step, whose quadratic problem
`solve_stages` solves.

This is not the method of :mod:`planners.lagrange.interior_point`, and the two share no loop. Here the problem is nearly
convex, has an equality at its end and a free time: a Gauss-Newton step with separate primal and dual lengths and a
barrier that follows the gap needs no line search. There it is not convex and smoothed: exact second derivatives, a
shift of the diagonal and a merit function. Nor do they share linear algebra: the Riccati recursion takes 14 us a step
for 60 stages (20 us for 100), where Cholesky's method on the problem condensed to its controls takes 65 us (180 us) for
the factor alone; the unknowns of a Lagrange interpolation act at all instants, so there are no stages to recur over.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from planners.compiled.calls import dividing, private
from planners.dpct.constraints import Tracking, bounded_rows, cost_matrices, evaluate, roll_out, tracking_index
from planners.dpct.riccati import solve_stages
from planners.typing import Array

BOUNDARY_FRACTION = 0.99
FEASIBLE, CLOSED = 1e-6, 1e-7  # largest excess of a scaled limit, largest |z_N|
FIRST_SLACK, FIRST_GAP = 0.3, 0.03  # least slack and its product with the multiplier at the first guess
STALL, STALLS = 0.1, 8  # so many steps in a row shorter than this mean that there is no feasible motion
SETTLED = 1e-4  # change of T in the last step, as a fraction of it
GUESSES = 8  # times tried for a first one
NEARLY = 0.3  # excess of a scaled limit from which the first step goes well


class Solution(NamedTuple):
    """Result of `solve`.

    Attributes:
        converged: whether the limits and the end condition hold and the index is at its optimum.
        time: rendezvous time T, s.
        acceleration: r'' at time 0.
        jerk: r''' on each stage, ``(N,)``.
        cost: the tracking index J (eq 18), in squared units of r times s.
        iterations: steps taken.
        violation: largest excess of a limit, as a fraction of it.
    """

    converged: bool
    time: float
    acceleration: float
    jerk: Array
    cost: float
    iterations: int
    violation: float


@njit(cache=True, nogil=True, error_model="numpy")
def solve(
    tracking: Tracking,
    time: float,
    time_low: float,
    time_high: float,
    weight_time: float,
    weight_error: float,
    max_time_change: float = 1.0,
    max_iterations: int = 60,
    final_gap: float = 1e-7,
) -> tuple[bool, float, float, Array, float, int, float]:
    """Best motion to the rendezvous: the fields of a `Solution`.

    Compiled functions give interpreted ones no named tuples: a Ctrl-C while Numba makes one crashes the process.

    Args:
        tracking: the problem.
        time: first guess of T; T itself where ``time_low >= time_high``.
        time_low, time_high: bounds of a free T, s.
        weight_time, weight_error: of T and of J in the index.
        max_time_change: largest change of T in a step, as a fraction: the constraints are far from linear in T.
        max_iterations, final_gap: steps before giving up, and mean slack times multiplier that counts as optimal.
    """
    free_time = time_low < time_high
    stages = tracking.durations.shape[0]
    position_cost, velocity_cost = cost_matrices(tracking.durations)
    bounded = bounded_rows(tracking)
    rows = bounded.shape[1]
    bounded[0, -1, 0] = bounded[0, -1, 1] = free_time
    bounds = 0
    for k in range(stages):
        for row in range(rows):
            bounds += int(bounded[k, row, 0]) + int(bounded[k, row, 1])
    bounds = max(bounds, 1)
    value, gradient = np.empty((stages, rows)), np.empty((stages, rows, 5))
    hessian, linear = np.empty((stages, 5, 5)), np.empty((stages, 5))
    slack, dual = np.empty((stages, rows, 2)), np.empty((stages, rows, 2))
    slack_step, dual_step = np.empty((stages, rows, 2)), np.empty((stages, rows, 2))

    acceleration = tracking.start[2]
    control = _quintic_control(tracking, time)
    gap = FIRST_GAP
    primal, dual_length, time_step = 1.0, 1.0, 0.0
    centring, violation, converged, iterations, stalled = 1.0, np.inf, False, 0, 0
    while True:
        z = roll_out(tracking, time, acceleration, control)
        evaluate(tracking, time, time_low, time_high, z, control, value, gradient)
        if iterations == 0:
            first_slacks(bounded, value, gap, slack, dual)
        else:
            # done, stalled, or on with a smaller barrier
            violation, gap = excess_of(bounded, value), 0.0
            for k in range(stages):
                for row in range(rows):
                    gap += slack[k, row, 0] * dual[k, row, 0]
                    gap += slack[k, row, 1] * dual[k, row, 1]
            gap /= bounds
            end, end_rate, end_bend = abs(z[stages, 0]), abs(z[stages, 1]), abs(z[stages, 2])
            if not np.isfinite(end + end_rate + end_bend + gap):
                break
            settled = primal > 0.9 and (not free_time or abs(time_step) < SETTLED * time)
            if violation < FEASIBLE and max(end, end_rate, end_bend) < CLOSED and gap < final_gap and settled:
                converged = True
                break
            stalled = stalled + 1 if primal < STALL else 0
            if stalled == STALLS:
                break
            smaller = min(primal, dual_length)
            centring = 0.1 if smaller > 0.9 else 0.2 if smaller > 0.5 else 0.5
        if iterations >= max_iterations:
            break
        iterations += 1
        # Newton's step: the quadratic model by (z, T, j) of each stage, solved over the stages (eq 29, 30)
        barrier = centring * gap
        _index_model(position_cost, velocity_cost, z, control, time, weight_time, weight_error, hessian, linear)
        barrier_model(bounded, value, gradient, slack, dual, barrier, hessian, linear, 5)
        basis = _start_basis(tracking, time, acceleration, free_time)
        steps, start_step = solve_stages(tracking.durations, hessian, linear, z[stages], basis)
        # as far as slacks, multipliers and T may go
        primal, dual_length = slack_steps(
            bounded, value, gradient, slack, dual, barrier, steps, slack_step, dual_step, 5
        )
        if free_time:
            time_step = start_step[0]
            primal = min(primal, max_time_change * time / max(abs(time_step), 1e-300))
            time += primal * time_step
        if tracking.free_acceleration:
            acceleration += primal * start_step[-1]
        for k in range(stages):
            control[k] += primal * steps[k, 4]
            for row in range(rows):
                for side in range(2):
                    slack[k, row, side] += primal * slack_step[k, row, side]
                    dual[k, row, side] += dual_length * dual_step[k, row, side]
    if converged:  # what is left of z_N goes by the least change of the control
        for k in range(stages):
            for a in range(5):
                linear[k, a] = 0.0
                for b in range(5):
                    hessian[k, a, b] = 0.0
            hessian[k, 4, 4] = 1.0
        steps, _ = solve_stages(tracking.durations, hessian, linear, z[stages], np.empty((0, 4)))
        for k in range(stages):
            control[k] += steps[k, 4]
        z = roll_out(tracking, time, acceleration, control)
    cost = tracking_index(position_cost, velocity_cost, z, control, time)
    cube = time**3
    for k in range(stages):
        control[k] /= cube
    return converged, time, acceleration, control, cost, iterations, violation


@njit(cache=True, nogil=True)
def guess_time(tracking: Tracking, time_low: float, time_high: float) -> float:
    """The first of some times at which a quintic nearly keeps the limits, or the one at which it does best."""
    bounded = bounded_rows(tracking)
    stages, rows = bounded.shape[:2]
    value, gradient = np.empty((stages, rows)), np.empty((stages, rows, 5))
    best_time, least = time_high, np.inf
    for guess in range(GUESSES):
        time = time_low + (time_high - time_low) * ((guess + 0.5) / GUESSES) ** 2
        control = _quintic_control(tracking, time)
        z = roll_out(tracking, time, tracking.start[2], control)
        evaluate(tracking, time, 0.0, 0.0, z, control, value, gradient)
        violation = excess_of(bounded, value)
        if violation < least:
            best_time, least = time, violation
        if violation < NEARLY:
            break
    return best_time


@njit(cache=True, nogil=True)
def quintic_index(tracking: Tracking, time: float) -> float:
    """The tracking index of the quintic from the start to a rendezvous at a time."""
    control = _quintic_control(tracking, time)
    position, velocity = cost_matrices(tracking.durations)
    return tracking_index(position, velocity, roll_out(tracking, time, tracking.start[2], control), control, time)


@private
def _quintic_control(tracking: Tracking, time: float) -> Array:
    """Scaled jerk at the middle of each stage of the quintic from the start to the rendezvous."""
    e = tracking.start[0] - tracking.target[0]
    v = time * (tracking.start[1] - tracking.target[1])
    a = time * time * (tracking.start[2] - tracking.target[2])
    control = np.empty(tracking.durations.shape[0])
    elapsed = 0.0
    for k in range(control.shape[0]):
        s = elapsed + 0.5 * tracking.durations[k]
        cubic, quartic = -10.0 * e - 6.0 * v - 1.5 * a, 15.0 * e + 8.0 * v + 1.5 * a
        control[k] = 6.0 * cubic + 24.0 * quartic * s - 60.0 * (6.0 * e + 3.0 * v + 0.5 * a) * s * s
        elapsed += tracking.durations[k]
    return control


@dividing
def first_slacks(bounded: Array, value: Array, barrier: float, slack: Array, dual: Array) -> None:
    """Positive slacks and multipliers, ``(N, rows, 2)``, with the products ``barrier``."""
    for k in range(value.shape[0]):
        for row in range(value.shape[1]):
            for side in range(2):
                slack[k, row, side], dual[k, row, side] = 1.0, 0.0
                if bounded[k, row, side]:
                    room = 1.0 - value[k, row] if side == 1 else 1.0 + value[k, row]
                    slack[k, row, side] = FIRST_SLACK if room < FIRST_SLACK else room
                    dual[k, row, side] = barrier / slack[k, row, side]


@dividing
def _index_model(
    position_cost: Array,
    velocity_cost: Array,
    z: Array,
    control: Array,
    time: float,
    weight_time: float,
    weight_error: float,
    hessian: Array,
    linear: Array,
) -> None:
    """Gradient and (positive semidefinite part of the) Hessian of the index by ``(z, T, j)`` of each stage."""
    place = (0, 1, 2, 4)  # of z and j in (z, T, j)
    x = np.empty(4)
    for k in range(control.shape[0]):
        x[0], x[1], x[2], x[3] = z[k, 0], z[k, 1], z[k, 2], control[k]
        for a in range(5):
            linear[k, a] = 0.0
            for b in range(5):
                hessian[k, a, b] = 0.0
        for a in range(4):
            for b in range(4):
                position, velocity = weight_error * position_cost[k, a, b], weight_error * velocity_cost[k, a, b]
                entry = 2.0 * (time * position + velocity / time)
                hessian[k, place[a], place[b]] = entry
                linear[k, place[a]] += entry * x[b]
                linear[k, 3] += x[a] * x[b] * (position - velocity / time**2)
                hessian[k, 3, 3] += 2.0 * x[a] * x[b] * velocity / time**3
        hessian[k, 4, 4] += 1e-12  # keeps the Hessian positive definite in the control
    linear[0, 3] += weight_time


@dividing
def barrier_model(
    bounded: Array,
    value: Array,
    gradient: Array,
    slack: Array,
    dual: Array,
    barrier: float,
    hessian: Array,
    linear: Array,
    size: int,
) -> None:
    """Adds the constraints, with slacks and multipliers eliminated; ``size`` is that of a gradient."""
    for k in range(bounded.shape[0]):
        for row in range(bounded.shape[1]):
            weight = pull = 0.0
            for side in range(2):
                if bounded[k, row, side]:
                    sign = 2 * side - 1
                    s, d = slack[k, row, side], dual[k, row, side]
                    weight += d / s
                    pull += sign * (d * (sign * value[k, row] + s - 1.0) + barrier) / s
            if weight > 0.0:
                for a in range(size):
                    weighted = weight * gradient[k, row, a]
                    linear[k, a] += pull * gradient[k, row, a]
                    for b in range(a + 1):
                        hessian[k, a, b] += weighted * gradient[k, row, b]
        for a in range(size):
            for b in range(a):
                hessian[k, b, a] = hessian[k, a, b]


@private
def _start_basis(tracking: Tracking, time: float, acceleration: float, free_time: bool) -> Array:
    """How the first ``(z, T)`` changes with what is free at the start: T, then the acceleration; ``(free, 4)``."""
    basis = np.zeros((int(free_time) + int(tracking.free_acceleration), 4))
    if free_time:
        basis[0, 1] = tracking.start[1] - tracking.target[1]
        basis[0, 2] = 2.0 * time * (acceleration - tracking.target[2])
        basis[0, 3] = 1.0
    if tracking.free_acceleration:
        basis[-1, 2] = time * time
    return basis


@dividing
def slack_steps(
    bounded: Array,
    value: Array,
    gradient: Array,
    slack: Array,
    dual: Array,
    barrier: float,
    steps: Array,
    slack_step: Array,
    dual_step: Array,
    size: int,
) -> tuple[float, float]:
    """Steps of slacks and multipliers (written), and how far each may go without leaving the positive side."""
    primal = dual_length = 1.0 / BOUNDARY_FRACTION
    for k in range(bounded.shape[0]):
        for row in range(bounded.shape[1]):
            change = 0.0
            for a in range(size):
                change += gradient[k, row, a] * steps[k, a]
            for side in range(2):
                slack_step[k, row, side] = dual_step[k, row, side] = 0.0
                if bounded[k, row, side]:
                    sign = 2 * side - 1
                    s, d = slack[k, row, side], dual[k, row, side]
                    ds = 1.0 - s - sign * (value[k, row] + change)
                    dd = (barrier - d * ds) / s - d
                    if primal * ds < -s:
                        primal = -s / ds
                    if dual_length * dd < -d:
                        dual_length = -d / dd
                    slack_step[k, row, side], dual_step[k, row, side] = ds, dd
    return BOUNDARY_FRACTION * primal, BOUNDARY_FRACTION * dual_length


@private
def excess_of(bounded: Array, value: Array) -> float:
    """Largest excess of a scaled limit, 0 if there is none."""
    excess = 0.0
    for k in range(value.shape[0]):
        for row in range(value.shape[1]):
            if bounded[k, row, 0]:
                excess = max(excess, -value[k, row] - 1.0)
            if bounded[k, row, 1]:
                excess = max(excess, value[k, row] - 1.0)
    return excess
