"""Primal-dual interior point method for a chase on stages, and the Riccati recursion that solves its steps.

The loop is that of :mod:`planners.dpct.interior_point`, with the errors of all joints as the state and a control for
each. The index is the rendezvous time T and a small weight on squared jerk. The end condition is a quadratic penalty
here: so the recursion needs no multipliers, and the little that is left of the errors goes when the motion is sampled.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from planners.compiled.calls import dividing, private
from planners.dpct.free.constraints import Chase, bounded_rows, evaluate, roll_out
from planners.dpct.interior_point import barrier_model, excess_of, first_slacks, slack_steps
from planners.robot.dynamics import solve_mass_matrix
from planners.typing import Array

FEASIBLE, CLOSED, FINAL_GAP = 1e-5, 1e-5, 1e-6  # largest excess of a scaled limit, largest |z_N|, mean product
FIRST_GAP, PENALTY, SMOOTHNESS = 0.03, 1e7, 1e-4
STALL, STALLS, MOST_STEPS = 0.05, 8, 60
GUESSES, NEARLY = 8, 0.3


@njit(cache=True, nogil=True, error_model="numpy")
def solve(
    chase: Chase, time: float, low: float, high: float, largest_change: float
) -> tuple[bool, float, Array, int, float]:
    """The earliest rendezvous from ``low`` to ``high``, s, or a motion to it at ``time`` where the two are equal.

    ``largest_change`` is that of T in a step, as a fraction.

    Returns:
        Whether it converged, T (s), the jerks of the errors ``(N, n)``, rad/s^3, steps taken, and the largest excess of
        a limit as a fraction of it.
    """
    free_time = low < high
    stages, n = chase.durations.shape[0], chase.middle.shape[0]
    size = 4 * n + 1
    bounded = bounded_rows(chase)
    rows = bounded.shape[1]
    bounded[0, -1, 0] = bounded[0, -1, 1] = free_time
    bounds = max(1, int(bounded.sum()))
    value, gradient = np.zeros((stages, rows)), np.zeros((stages, rows, size))
    hessian, linear = np.empty((stages, size, size)), np.empty((stages, size))
    slack, dual = np.empty((stages, rows, 2)), np.empty((stages, rows, 2))
    slack_step, dual_step = np.empty((stages, rows, 2)), np.empty((stages, rows, 2))

    control = _quintic_control(chase, time)
    weight, scale = 1.0 / time, max(1e-12, float(np.abs(control).max()))
    gap, primal, dual_length, time_step = FIRST_GAP, 1.0, 1.0, 0.0
    centring, violation, converged, iterations, stalled = 1.0, np.inf, False, 0, 0
    while True:
        z = roll_out(chase, time, control)
        evaluate(chase, time, low, high, z, control, value, gradient)
        if iterations == 0:
            first_slacks(bounded, value, gap, slack, dual)
        else:
            violation = excess_of(bounded, value)
            gap = (slack * dual).sum() / bounds
            end = np.abs(z[stages]).max()
            if not np.isfinite(end + gap):
                break
            settled = primal > 0.9 and abs(time_step) < 1e-3 * time
            if violation < FEASIBLE and end < CLOSED and gap < FINAL_GAP and settled:
                converged = True
                break
            stalled = stalled + 1 if primal < STALL else 0
            if stalled == STALLS:
                break
            smaller = min(primal, dual_length)
            centring = 0.1 if smaller > 0.9 else 0.2 if smaller > 0.5 else 0.5
        if iterations >= MOST_STEPS:
            break
        iterations += 1
        hessian[:], linear[:] = 0.0, 0.0
        linear[0, 3 * n] = weight
        for k in range(stages):
            for i in range(3 * n + 1, size):
                smooth = SMOOTHNESS * chase.durations[k] / scale**2
                hessian[k, i, i] = smooth
                linear[k, i] = smooth * control[k, i - 3 * n - 1]
        barrier = centring * gap
        barrier_model(bounded, value, gradient, slack, dual, barrier, hessian, linear, size)
        basis = np.zeros(3 * n + 1)
        if free_time:
            for i in range(n):
                basis[3 * i + 1] = chase.start[1, i] - chase.ride[0, 1, i]
                basis[3 * i + 2] = 2.0 * time * (chase.start[2, i] - chase.ride[0, 2, i])
            basis[3 * n] = 1.0
        steps = _solve_stages(chase.durations, hessian, linear, z[stages], basis)
        primal, dual_length = slack_steps(
            bounded, value, gradient, slack, dual, barrier, steps, slack_step, dual_step, size
        )
        time_step = steps[0, 3 * n]
        primal = min(primal, largest_change * time / max(abs(time_step), 1e-300))
        time += primal * time_step
        for k in range(stages):
            for i in range(n):
                control[k, i] += primal * steps[k, 3 * n + 1 + i]
        slack += primal * slack_step
        dual += dual_length * dual_step
    return converged, time, control / time**3, iterations, violation


@njit(cache=True, nogil=True)
def guess_time(chase: Chase, low: float, high: float) -> float:
    """The first of some times at which quintics nearly keep the limits, or the one at which they do best."""
    bounded = bounded_rows(chase)
    stages, rows = bounded.shape[:2]
    value, gradient = np.zeros((stages, rows)), np.zeros((stages, rows, 4 * chase.middle.shape[0] + 1))
    best, least = high, np.inf
    for guess in range(GUESSES):
        time = low + (high - low) * ((guess + 0.5) / GUESSES) ** 2
        control = _quintic_control(chase, time)
        evaluate(chase, time, 0.0, 0.0, roll_out(chase, time, control), control, value, gradient)
        violation = excess_of(bounded, value)
        if violation < least:
            best, least = time, violation
        if violation < NEARLY:
            break
    return best


@private
def _quintic_control(chase: Chase, time: float) -> Array:
    """Scaled jerks ``(N, n)`` at the middle of each stage of the quintics from the start to the rendezvous."""
    stages, n = chase.durations.shape[0], chase.middle.shape[0]
    control = np.empty((stages, n))
    for i in range(n):
        e = chase.start[0, i] - chase.ride[0, 0, i]
        v = time * (chase.start[1, i] - chase.ride[0, 1, i])
        a = time * time * (chase.start[2, i] - chase.ride[0, 2, i])
        elapsed = 0.0
        for k in range(stages):
            s = elapsed + 0.5 * chase.durations[k]
            cubic, quartic = -10.0 * e - 6.0 * v - 1.5 * a, 15.0 * e + 8.0 * v + 1.5 * a
            control[k, i] = 6.0 * cubic + 24.0 * quartic * s - 60.0 * (6.0 * e + 3.0 * v + 0.5 * a) * s * s
            elapsed += chase.durations[k]
    return control


@dividing
def _solve_stages(durations: Array, hessian: Array, linear: Array, end: Array, basis: Array) -> Array:
    """Steps of z, T and the controls, ``(N, 4 n + 1)``, that minimise the model with the penalty on the end.

    Args:
        durations: of the stages, ``(N,)``.
        hessian, linear: of each stage, ``(N, 4 n + 1, 4 n + 1)`` and ``(N, 4 n + 1)``.
        end: ``z_N`` before the step, ``(n, 3)``.
        basis: how the first state changes with T, ``(3 n + 1,)``; 0 for a given T.
    """
    stages, n = durations.shape[0], end.shape[0]
    size = 3 * n + 1
    gain, offset = np.empty((stages, n, size)), np.empty((stages, n))
    value, slope = np.zeros((size, size)), np.zeros(size)
    for i in range(n):
        for a in range(3):
            value[3 * i + a, 3 * i + a] = PENALTY
            slope[3 * i + a] = PENALTY * end[i, a]
    curvature, factor, cross, rhs = np.empty((n, n)), np.empty((n, n)), np.empty((n, size)), np.empty(n)
    for k in range(stages - 1, -1, -1):
        h, h_stage, g_stage = durations[k], hessian[k], linear[k]
        # what a control adds to the state, through the value function
        for i in range(n):
            for b in range(size):
                cross[i, b] = _input(value[b], i, h)
        for i in range(n):
            for j in range(n):
                curvature[i, j] = h_stage[size + i, size + j] + _input(cross[i], j, h)
            _pull_back(cross[i], n, h)
            for b in range(size):
                cross[i, b] += h_stage[size + i, b]
        for b in range(size + 1):  # the last column is the offset
            for i in range(n):
                rhs[i] = -cross[i, b] if b < size else -(g_stage[size + i] + _input(slope, i, h))
                for j in range(n):
                    factor[i, j] = curvature[i, j]
            solve_mass_matrix(factor, rhs)
            for i in range(n):
                if b < size:
                    gain[k, i, b] = rhs[i]
                else:
                    offset[k, i] = rhs[i]
        # the value function a stage earlier
        for b in range(size):
            _pull_back(value[b], n, h)
        for i in range(n):
            for b in range(size):
                value[3 * i + 2, b] += h * (value[3 * i + 1, b] + h * value[3 * i, b] / 2.0)
                value[3 * i + 1, b] += h * value[3 * i, b]
        _pull_back(slope, n, h)
        for a in range(size):
            slope[a] += g_stage[a]
            for i in range(n):
                slope[a] += cross[i, a] * offset[k, i]
            for b in range(size):
                value[a, b] += h_stage[a, b]
                for i in range(n):
                    value[a, b] += cross[i, a] * gain[k, i, b]
    steps, x = np.empty((stages, size + n)), np.zeros(size)
    bend = basis @ value @ basis
    if basis[size - 1] != 0.0:
        x[:] = -(basis @ slope) / bend * basis
    for k in range(stages):
        h = durations[k]
        for a in range(size):
            steps[k, a] = x[a]
        for i in range(n):
            u = offset[k, i]
            for a in range(size):
                u += gain[k, i, a] * steps[k, a]
            steps[k, size + i] = u
            x[3 * i] += h * (x[3 * i + 1] + h * (x[3 * i + 2] / 2.0 + h * u / 6.0))
            x[3 * i + 1] += h * (x[3 * i + 2] + h * u / 2.0)
            x[3 * i + 2] += h * u
    return steps


@private
def _input(row: Array, i: int, h: float) -> float:
    """``row @ G``, with G what one unit of the control of joint ``i`` adds to the state over ``h``."""
    result: float = h * (row[3 * i + 2] + h * (row[3 * i + 1] / 2.0 + h * row[3 * i] / 6.0))
    return result


@private
def _pull_back(row: Array, n: int, h: float) -> None:
    """``row @ F`` in place, with F the transition over ``h``."""
    for i in range(n):
        row[3 * i + 2] += h * (row[3 * i + 1] + h * row[3 * i] / 2.0)
        row[3 * i + 1] += h * row[3 * i]
