"""The mathematics under the Lagrange planner, each piece against an independent one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BarycentricInterpolator

from planners import PLANAR_3R, SCARA_1M, Arm
from planners.lagrange.banded import factorise, substitute
from planners.lagrange.interpolation import (
    differentiation_matrices,
    evaluation_matrix,
    lobatto_nodes,
    lobatto_quadrature,
)
from planners.lagrange.joint_move import JointMove
from planners.lagrange.newton import TorqueTask, evaluate, index, newton_model
from planners.lagrange.torque_derivatives import (
    add_torque_curvature_single,
    torque_jacobian_single,
    torques_single,
    turn_couplings,
)
from planners.lagrange.transcription import Basis, Ends, fit, lagrange_basis, motion, spline_basis, transcribe
from planners.typing import Array

VERTICAL = replace(PLANAR_3R, gravity=9.81)


@pytest.mark.parametrize("degree", [2, 3, 8, 20, 40])
def test_interpolation_is_scipys(degree: int) -> None:
    nodes = lobatto_nodes(degree)
    values = np.random.default_rng(degree).normal(size=degree + 1)
    s = np.sort(np.append(np.linspace(0.0, 1.0, 57), nodes))
    expected = BarycentricInterpolator(nodes, values)(s)
    np.testing.assert_allclose(evaluation_matrix(degree, s) @ values, expected, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("degree", [4, 8, 20])
def test_derivative_matrices_are_exact_on_polynomials(degree: int) -> None:
    nodes, matrices = lobatto_nodes(degree), differentiation_matrices(degree, 3)
    for power in range(degree + 1):
        polynomial = np.polynomial.Polynomial.basis(power)
        for order, matrix in enumerate(matrices):
            expected = polynomial.deriv(order)(nodes) if order else polynomial(nodes)
            scale = max(1.0, float(np.abs(expected).max()))
            np.testing.assert_allclose(matrix @ nodes**power, expected, atol=3e-13 * scale * degree ** (2 * order))


def test_derivatives_of_an_interpolant_are_its_differences() -> None:
    degree, h = 12, 1e-5
    values = np.random.default_rng(0).normal(size=degree + 1)
    s = np.linspace(0.05, 0.95, 31)
    for order in range(3):
        below, above = (evaluation_matrix(degree, s + d) for d in (-h, h))
        matrices = differentiation_matrices(degree, 3)
        difference = (above - below) @ matrices[order] @ values / (2.0 * h)
        derivative = evaluation_matrix(degree, s) @ matrices[order + 1] @ values
        np.testing.assert_allclose(derivative, difference, rtol=1e-5, atol=1e-5 * np.abs(derivative).max())


@pytest.mark.parametrize("degree", [4, 7, 48, 81])
def test_quadrature_is_exact_for_the_interpolant(degree: int) -> None:
    nodes, weights = lobatto_nodes(degree), lobatto_quadrature(degree)
    for power in range(degree + 1):
        assert weights @ nodes**power == pytest.approx(1.0 / (power + 1), abs=1e-13)


def bases() -> list[Basis]:
    return [
        lagrange_basis(8, False, 33),
        lagrange_basis(20, True, 81),
        spline_basis(10, False, 2),
        spline_basis(25, True, 3),
    ]


@pytest.mark.parametrize("number", range(4))
def test_a_basis_meets_both_ends_whatever_its_unknowns(number: int) -> None:
    basis, rng = bases()[number], np.random.default_rng(number)
    ends = Ends(rng.normal(size=(3, 2)), rng.normal(size=(3, 2)))
    unknowns = rng.normal(size=(len(basis.fitting), 2))
    q, qd, qdd, _ = motion(transcribe(basis, ends, 1.7), unknowns)
    orders = 3 if number % 2 else 2
    for side, end in ((0, ends.start), (-1, ends.end)):
        np.testing.assert_allclose(np.stack([q[side], qd[side], qdd[side]])[:orders], end[:orders], atol=1e-7)


@pytest.mark.parametrize("number", range(4))
def test_a_basis_gives_derivatives_of_its_angles(number: int) -> None:
    basis, rng = bases()[number], np.random.default_rng(number)
    ends = Ends(rng.normal(size=(3, 1)), rng.normal(size=(3, 1)))
    duration = 0.6
    q, qd, qdd, jerk = motion(transcribe(basis, ends, duration), rng.normal(size=(len(basis.fitting), 1)))
    step = np.diff(basis.s)[:, None] * duration
    for values, rates in ((q, qd), (qd, qdd)):
        # Hermite: the increment of a cubic is known from the rates and their rates
        bend = qdd if rates is qd else jerk
        if number >= 2:  # on each of the spline's stages the quadrature below is exact
            third = jerk[:-1] if rates is qd else np.zeros_like(jerk[:-1])
            increment = rates[:-1] * step + bend[:-1] * step**2 / 2.0 + third * step**3 / 6.0
            np.testing.assert_allclose(np.diff(values, axis=0), increment, atol=1e-9 * np.abs(values).max())
        else:
            matrix = differentiation_matrices(len(basis.s) - 1, 1)[1]
            np.testing.assert_allclose(matrix @ values / duration, rates, atol=1e-7 * np.abs(rates).max())


@pytest.mark.parametrize("number", range(4))
def test_a_motion_of_the_basis_is_fitted_exactly(number: int) -> None:
    basis, rng = bases()[number], np.random.default_rng(number)
    transcription = transcribe(basis, Ends(rng.normal(size=(3, 3)), rng.normal(size=(3, 3))), 0.8)
    unknowns = rng.normal(size=(len(basis.fitting), 3))
    found = fit(basis, transcription, motion(transcription, unknowns)[0])
    np.testing.assert_allclose(found, unknowns, atol=1e-6)


def relative(links: Array) -> Array:
    return np.diff(links, axis=1, prepend=0.0)


@pytest.mark.parametrize("arm", [PLANAR_3R, VERTICAL, SCARA_1M], ids=lambda arm: f"{arm.name}, g {arm.gravity}")
def test_torque_and_its_derivatives(arm: Arm) -> None:
    """Torque against the arm's own; derivatives against differences of torque and of first derivatives."""
    n, rng, h = arm.n_joints, np.random.default_rng(1), 1e-6
    constants = arm.chain_constants

    def torque(links: Array) -> Array:
        tau = np.empty(n)
        torques_single(*constants, links, tau)
        return tau

    def jacobian(links: Array) -> Array:
        rows = np.empty((n, 3, n))
        torque_jacobian_single(constants[1], links, *turned(links), rows)
        return rows

    def turned(links: Array) -> Array:
        pair = np.empty((2, n, n))
        turn_couplings(constants[0], links, *pair)
        return pair

    for _ in range(10):
        links, factors = rng.normal(size=(3, n)) * 2.0, rng.normal(size=n)
        np.testing.assert_allclose(torque(links), arm.inverse_dynamics(*relative(links)), atol=1e-12)
        flat = np.zeros((4 * n, 4 * n))
        add_torque_curvature_single(constants[1], links, *turned(links), factors, flat)
        curvature = flat.reshape(4, n, 4, n)
        assert not curvature[3].any()
        for d in range(3):
            for j in range(n):
                change = np.zeros((3, n))
                change[d, j] = h
                slope = (torque(links + change) - torque(links - change)) / (2.0 * h)
                np.testing.assert_allclose(jacobian(links)[:, d, j], slope, atol=1e-7)
                bend = np.einsum("j,jea->ea", factors, jacobian(links + change) - jacobian(links - change)) / (2.0 * h)
                np.testing.assert_allclose(curvature[d, j, :3], bend, atol=1e-7)


@pytest.mark.parametrize("power", [1, 2])
@pytest.mark.parametrize("basis", [lagrange_basis(9, False, 37), spline_basis(7, True, 2)], ids=["lagrange", "spline"])
def test_gradient_and_hessian_of_the_index(power: int, basis: Basis) -> None:
    """Against differences of the index, and of the gradient, by every unknown."""
    rng = np.random.default_rng(5)
    ends = Ends(np.zeros((3, 3)), np.vstack([[1.0, -0.5, 0.3], np.zeros((2, 3))]))
    move = JointMove(VERTICAL, VERTICAL.limits, ends, 0.9, False)
    tr = transcribe(basis, move.ends, move.duration)
    none, nothing = np.zeros(0, dtype=np.int64), np.zeros((len(basis.s), 0))
    task = TorqueTask(*VERTICAL.chain_constants, none, none, np.zeros(0), nothing, power, 3.0)
    x, eps = rng.normal(size=(len(basis.fitting), 3)) * 0.3, 0.2

    def value(unknowns: Array) -> float:
        return index(tr.weights, evaluate(tr, task, unknowns).tau, power, eps)

    def model(unknowns: Array) -> tuple[Array, Array, Array]:
        point = evaluate(tr, task, unknowns)
        sign = point.tau / np.sqrt(point.tau**2 + eps**2)  # where the dual is the primal the Hessian is exact
        found = newton_model(tr, task, tr.weights, point, sign, eps, *np.zeros((3, 0)))
        return found.gradient, found.index_gradient, full(found.hessian)

    gradient, index_gradient, hessian = model(x)
    np.testing.assert_array_equal(gradient, index_gradient)
    for i in range(x.size):
        change = np.zeros(x.size)
        change[i] = 1e-5
        change = change.reshape(x.shape)
        slope = (value(x + change) - value(x - change)) / 2e-5
        assert gradient[i] == pytest.approx(slope, rel=1e-5, abs=1e-6 * np.abs(gradient).max())
        bend = (model(x + change)[0] - model(x - change)[0]) / 2e-5
        np.testing.assert_allclose(hessian[i], bend, atol=1e-5 * np.abs(hessian).max())


def full(banded: Array) -> Array:
    """The symmetric matrix whose lower bands are given row by row."""
    size, width = banded.shape
    matrix = np.zeros((size, size))
    for i in range(size):
        for j in range(max(0, i - width + 1), i + 1):
            matrix[i, j] = matrix[j, i] = banded[i, j - i + width - 1]
    return matrix


@settings(max_examples=30, deadline=None)
@given(size=st.integers(1, 12), band=st.integers(0, 11), seed=st.integers(0, 1000))
def test_banded_systems_are_solved(size: int, band: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(size, band + 1))
    rows[:, -1] = 2.0 * (band + 1) + np.abs(rows).sum() / size + 10.0
    matrix, rhs = full(rows), rng.normal(size=size)
    if np.linalg.eigvalsh(matrix)[0] <= 0.0:
        return
    solution, factor = rhs.copy(), rows.copy()
    assert factorise(factor)
    substitute(factor, solution)
    np.testing.assert_allclose(matrix @ solution, rhs, atol=1e-10)
    rows[:, -1] -= 2.0 * np.linalg.eigvalsh(matrix)[-1]
    assert not factorise(rows)
