from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planners.dpct.riccati import solve_linear, solve_stages


def transition(h: float) -> tuple[np.ndarray, np.ndarray]:
    f = np.array([[1, h, h * h / 2, 0], [0, 1, h, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
    return f, np.array([h**3 / 6, h * h / 2, h, 0.0])


@given(st.integers(0, 2**32 - 1), st.integers(0, 2), st.integers(4, 9))
@settings(max_examples=25, deadline=None)
def test_recursion_solves_the_dense_problem(seed: int, free: int, stages: int) -> None:
    """All conditions of optimality of the whole problem, with the states written out as functions of y and u."""
    rng = np.random.default_rng(seed)
    durations = rng.uniform(0.5, 1.5, stages)
    root = rng.standard_normal((stages, 5, 5))
    hessian = root @ root.transpose(0, 2, 1) + 0.1 * np.eye(5)
    linear, residual = rng.standard_normal((stages, 5)), rng.standard_normal(3)
    basis = np.eye(4)[[3, 2]][:free] + 0.0
    steps, start = solve_stages(durations, hessian, linear, residual, basis)

    unknowns = free + stages
    state = np.zeros((4, unknowns))
    state[:, :free] = basis.T
    rows = []
    for k in range(stages):
        control = np.zeros((1, unknowns))
        control[0, free + k] = 1.0
        rows.append(np.vstack([state, control]))
        f, g = transition(durations[k])
        state = f @ state + g[:, None] * control
    total = sum(row.T @ hessian[k] @ row for k, row in enumerate(rows))
    slope = sum(row.T @ linear[k] for k, row in enumerate(rows))
    end = state[:3]
    system = np.block([[total, end.T], [end, np.zeros((3, 3))]])
    expected = np.linalg.solve(system, np.concatenate([-slope, -residual]))[:unknowns]
    found = np.concatenate([start, steps[:, 4]])
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())
    np.testing.assert_allclose(steps, [row @ expected for row in rows], atol=1e-6 * np.abs(expected).max())


def test_elimination_exchanges_rows_and_tells_a_singular_matrix() -> None:
    matrix, rhs = np.array([[0.0, 2.0], [3.0, 1.0]]), np.array([4.0, 5.0])
    solve_linear(matrix, rhs)
    assert rhs == pytest.approx([1.0, 2.0])
    rhs = np.ones(2)
    solve_linear(np.zeros((2, 2)), rhs)
    assert np.isnan(rhs).all()
