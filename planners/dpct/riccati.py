"""Dynamic programming for a quadratic problem on stages with a fixed end: a backward Riccati recursion.

The state is ``x = (z, T)``, the scaled error of :mod:`planners.dpct.constraints` and the rendezvous time, which does
not change from stage to stage. The problem is to find steps that minimise

    sum_k w_k' H_k w_k / 2 + g_k' w_k,   w_k = (x_k, u_k),
    x_{k+1} = F_k x_k + G_k u_k,   z_N = -residual,   x_0 = basis' y,

over ``u`` and ``y``. The value function of every stage (eq 29, 30 of "Motion Planning of a Robot Manipulator for
Conveyor Tracking", on quadratics in place of a grid) is ``x'P x / 2 + p'x + nu'(E x + d) + nu'W nu / 2``, linear in
the multiplier ``nu`` of the end condition; ``nu`` and ``y`` follow from its saddle point at the start.

Products of matrices call SciPy's BLAS. It is imported here, because Numba would import it in the middle of compiled
code, where an interrupt of the import ends the process.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import cython_blas  # noqa: F401

from planners.compiled.calls import dividing, private
from planners.typing import Array


@dividing
def solve_stages(durations: Array, hessian: Array, linear: Array, residual: Array, basis: Array) -> tuple[Array, Array]:
    """Optimal steps ``w``, ``(N, 5)``, and ``y``, ``(free,)``; not finite where there is no solution.

    Args:
        durations: of the stages, ``(N,)``.
        hessian, linear: ``H`` ``(N, 5, 5)``, positive definite in the control, and ``g`` ``(N, 5)``.
        residual: ``z_N`` before the step, ``(3,)``.
        basis: what may change at the start, ``(free, 4)``.
    """
    stages = durations.shape[0]
    # u = gain x + offset + answer nu
    gain, offset, answer = np.empty((stages, 4)), np.empty(stages), np.empty((stages, 3))
    p_matrix, p_vector = np.zeros((4, 4)), np.zeros(4)
    e_matrix, e_vector, w_matrix = np.zeros((3, 4)), residual.copy(), np.zeros((3, 3))
    for a in range(3):
        e_matrix[a, a] = 1.0
    column = np.empty(4)
    for k in range(stages - 1, -1, -1):
        h, h_stage, g_stage = durations[k], hessian[k], linear[k]
        for a in range(4):
            column[a] = _input(p_matrix[a], h)
        curvature = h_stage[4, 4] + _input(column, h)
        offset[k] = -(g_stage[4] + _input(p_vector, h)) / curvature
        _pull_back(column, h)
        for a in range(4):
            gain[k, a] = -(h_stage[4, a] + column[a]) / curvature
        for a in range(3):
            entry = _input(e_matrix[a], h)
            answer[k, a] = -entry / curvature
            e_vector[a] += entry * offset[k]
            _pull_back(e_matrix[a], h)
            for b in range(4):
                e_matrix[a, b] += entry * gain[k, b]
        for a in range(3):
            for b in range(3):
                w_matrix[a, b] -= curvature * answer[k, a] * answer[k, b]
        for a in range(4):
            _pull_back(p_matrix[a], h)
        for a in range(4):
            p_matrix[2, a] += h * (p_matrix[1, a] + h * p_matrix[0, a] / 2.0)
            p_matrix[1, a] += h * p_matrix[0, a]
        _pull_back(p_vector, h)
        for a in range(4):
            p_vector[a] += g_stage[a] - curvature * gain[k, a] * offset[k]
            for b in range(4):
                p_matrix[a, b] += h_stage[a, b] - curvature * gain[k, a] * gain[k, b]

    start, multiplier = _saddle_point(p_matrix, p_vector, e_matrix, e_vector, w_matrix, basis)
    steps = np.empty((stages, 5))
    x = start @ basis
    for k in range(stages):
        h = durations[k]
        u = offset[k] + gain[k] @ x + answer[k] @ multiplier
        for a in range(4):
            steps[k, a] = x[a]
        steps[k, 4] = u
        x[0] += h * (x[1] + h * (x[2] / 2.0 + h * u / 6.0))
        x[1] += h * (x[2] + h * u / 2.0)
        x[2] += h * u
    return steps, start


@private
def _input(row: Array, h: float) -> float:
    """``row @ G``, with G what one unit of control adds to the state over ``h``."""
    result: float = h * (row[2] + h * (row[1] / 2.0 + h * row[0] / 6.0))
    return result


@private
def _pull_back(row: Array, h: float) -> None:
    """``row @ F`` in place, with F the transition over ``h``."""
    row[2] += h * (row[1] + h * row[0] / 2.0)
    row[1] += h * row[0]


@private
def _saddle_point(
    p_matrix: Array, p_vector: Array, e_matrix: Array, e_vector: Array, w_matrix: Array, basis: Array
) -> tuple[Array, Array]:
    """The free part of the start (minimising) and the multiplier of the end condition (maximising)."""
    free = basis.shape[0]
    system, rhs = np.zeros((free + 3, free + 3)), np.empty(free + 3)
    corner, side, top = basis @ p_matrix @ basis.T, basis @ e_matrix.T, basis @ p_vector
    for a in range(free):
        for b in range(free):
            system[a, b] = corner[a, b]
        for b in range(3):
            system[a, free + b] = system[free + b, a] = side[a, b]
        rhs[a] = -top[a]
    for a in range(3):
        for b in range(3):
            system[free + a, free + b] = w_matrix[a, b]
        rhs[free + a] = -e_vector[a]
    solve_linear(system, rhs)
    start, multiplier = np.empty(free), np.empty(3)
    for a in range(free):
        start[a] = rhs[a]
    for a in range(3):
        multiplier[a] = rhs[free + a]
    return start, multiplier


@dividing
def solve_linear(matrix: Array, rhs: Array) -> None:
    """Solve in place by elimination with row exchanges; a singular matrix gives values that are not finite."""
    n = rhs.shape[0]
    for c in range(n):
        pivot = c
        for a in range(c + 1, n):
            if abs(matrix[a, c]) > abs(matrix[pivot, c]):
                pivot = a
        if matrix[pivot, c] == 0.0:
            for a in range(n):
                rhs[a] = np.nan
            return
        if pivot != c:
            for b in range(n):
                matrix[c, b], matrix[pivot, b] = matrix[pivot, b], matrix[c, b]
            rhs[c], rhs[pivot] = rhs[pivot], rhs[c]
        for a in range(c + 1, n):
            factor = matrix[a, c] / matrix[c, c]
            for b in range(c, n):
                matrix[a, b] -= factor * matrix[c, b]
            rhs[a] -= factor * rhs[c]
    for c in range(n - 1, -1, -1):
        for b in range(c + 1, n):
            rhs[c] -= matrix[c, b] * rhs[b]
        rhs[c] /= matrix[c, c]
