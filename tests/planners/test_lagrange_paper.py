"""The published minimal-torque search: its interpolation, its grid search against brute force, and its own numbers."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial import Polynomial
from numpy.polynomial.chebyshev import chebpts1
from numpy.testing import assert_allclose
from scipy.integrate import quad
from scipy.interpolate import BarycentricInterpolator, KroghInterpolator

from planners import PLANAR_3R, SCARA_1M, Arm, FixedHand, FixedJoints, JointLimits, MotionProblem, Trajectory
from planners.lagrange.paper import (
    PUBLISHED_ANGLES,
    PUBLISHED_COEFFICIENTS,
    PUBLISHED_TIMES,
    Method,
    chebyshev_nodes,
    lagrange_basis,
    lagrange_family,
    motion,
    node_angles,
    plan_paper,
    polynomial_family,
    published_motion,
    torque_integral,
)
from planners.typing import Array

LOBATTO = tuple((1.0 - np.cos(np.pi * np.arange(5) / 4.0)) / 2.0)


def paper_problem(gravity: float = 0.0) -> MotionProblem:
    """Table 1 and eq 13."""
    return MotionProblem(replace(PLANAR_3R, gravity=gravity), np.zeros(3), FixedJoints([1.0, 0.0, 0.0]), 1.0)


def two_link_problem(**changes: Any) -> MotionProblem:
    arm = replace(SCARA_1M, gravity=9.81)
    problem = MotionProblem(arm, [0.3, -0.5], FixedJoints([1.1, 0.4]), 0.8, qd=[0.6, -0.9], payload=0.7)
    return replace(problem, **changes)


def test_nodes_are_those_of_equation_7() -> None:
    for count in (1, 2, 5, 8):
        assert_allclose(chebyshev_nodes(count), (1.0 + chebpts1(count)) / 2.0, atol=1e-15)
    assert_allclose(chebyshev_nodes(5), [0.0245, 0.2061, 0.5, 0.7939, 0.9755], atol=5e-5)


@pytest.mark.parametrize("nodes", [PUBLISHED_TIMES, LOBATTO, (0.1, 0.7)])
def test_basis_agrees_with_scipys_interpolation(nodes: tuple[float, ...]) -> None:
    t = np.linspace(-0.1, 1.1, 50)
    reference = BarycentricInterpolator(nodes, np.eye(len(nodes)))
    basis = lagrange_basis(nodes)
    assert_allclose(np.stack([p(t) for p in basis], axis=1), reference(t), atol=1e-12)
    assert_allclose(np.stack([p.deriv()(t) for p in basis], axis=1), reference.derivative(t), atol=1e-11)


@pytest.mark.parametrize("nodes", [5, LOBATTO, (0.0, 0.3, 1.0)])
def test_clamped_lagrange_is_hermite_interpolation(nodes: int | tuple[float, ...]) -> None:
    problem, rng = two_link_problem(), np.random.default_rng(0)
    times = 0.8 * (chebyshev_nodes(5) if nodes == 5 else np.asarray(nodes))
    angles = rng.normal(size=(2, len(times) - 2))
    curves = lagrange_family(problem, nodes, clamped=True).member(angles.tolist())
    knots = np.array([0.0, 0.0, *times[1:-1], 0.8, 0.8])
    t = np.linspace(0.0, 0.8, 40)
    for j, (start, velocity, goal) in enumerate([(0.3, 0.6, 1.1), (-0.5, -0.9, 0.4)]):
        reference = KroghInterpolator(knots, [start, velocity, *angles[j], goal, 0.0])
        for order in range(3):
            expected = reference(t) if order == 0 else reference.derivative(t, order)
            assert_allclose(curves[j].deriv(order)(t), expected, atol=1e-9)


@settings(deadline=None, max_examples=60)
@given(
    horizon=st.floats(0.2, 4.0),
    ends=st.lists(st.floats(-3.0, 3.0), min_size=6, max_size=6),
    free=st.lists(st.floats(-5.0, 5.0), min_size=6, max_size=6),
    clamped=st.booleans(),
    method=st.sampled_from(["lagrange", "polynomial"]),
)
def test_every_member_meets_the_ends(
    horizon: float, ends: list[float], free: list[float], clamped: bool, method: str
) -> None:
    problem = MotionProblem(SCARA_1M, ends[:2], FixedJoints(ends[2:4]), horizon, qd=ends[4:])
    if method == "lagrange":
        family = lagrange_family(problem, clamped=clamped)
    else:
        family = polynomial_family(problem, 6 if clamped else 4, clamped=clamped)
    curves = family.member([free[:3], free[3:]])
    assert_allclose([curve(0.0) for curve in curves], ends[:2], atol=1e-9)
    assert_allclose([curve(horizon) for curve in curves], ends[2:4], atol=1e-8 * max(1.0, horizon**6))
    if clamped:
        assert_allclose([curve.deriv()(0.0) for curve in curves], ends[4:], atol=1e-9 / horizon)
        assert_allclose([curve.deriv()(horizon) for curve in curves], 0.0, atol=1e-7 * max(1.0, horizon**5) / horizon)


def test_coefficients_of_equation_12_are_the_free_numbers() -> None:
    for clamped, degree, first in ((False, 3, 2), (True, 5, 4)):
        family = polynomial_family(two_link_problem(), degree, clamped=clamped)
        curves = family.member([[1.5, -2.5], [0.5, 3.5]])
        assert_allclose([curve.coef[first:] for curve in curves], [[1.5, -2.5], [0.5, 3.5]], atol=1e-12)


def brute_force(problem: MotionProblem, curves: list[list[Polynomial]], steps: int) -> tuple[tuple[int, ...], float]:
    """Which curve of each joint has the least PI by the trapezoidal rule, and that PI."""
    t = np.linspace(0.0, problem.horizon, steps + 1)
    best, least = (), math.inf
    for choice in itertools.product(*(range(len(joint)) for joint in curves)):
        chosen = [joint[index] for joint, index in zip(curves, choice, strict=True)]
        q, qd, qdd = (np.stack([p.deriv(d)(t) for p in chosen], axis=1) for d in range(3))
        pi = float(np.trapezoid(np.abs(problem.loaded_arm.inverse_dynamics(q, qd, qdd)).sum(axis=1), t))
        if pi < least:
            best, least = choice, pi
    return best, least


def pendulum() -> MotionProblem:
    arm = Arm("pendulum", (0.5,), (2.0,), JointLimits.unlimited(1), gravity=9.81)
    return MotionProblem(arm, [-1.2], FixedJoints([0.7]), 1.5)


@pytest.mark.parametrize("clamped", [False, True])
@pytest.mark.parametrize(
    ("problem", "grid"),
    [
        (pendulum(), [[-2.0, -1.0, 0.0, 1.0]]),
        (two_link_problem(), [[0.0, 0.4, 0.9], [-1.0, -0.2, 0.5, 1.5]]),
        (paper_problem(9.81), [[0.0, 0.8], [-0.5, 0.25, 1.0], [-0.3, 0.6]]),
    ],
    ids=["1 joint", "2 joints", "3 joints"],
)
def test_search_agrees_with_brute_force(problem: MotionProblem, grid: list[list[float]], clamped: bool) -> None:
    lagrange = lagrange_family(problem, 4, clamped=clamped)
    polynomial = polynomial_family(problem, 5 if clamped else 3, clamped=clamped)
    plans = (
        (lagrange, plan_paper(problem, nodes=4, grid=grid, clamped=clamped, steps=20)),
        (
            polynomial,
            plan_paper(problem, method="polynomial", degree=5 if clamped else 3, grid=grid, clamped=clamped, steps=20),
        ),
    )
    for family, found in plans:
        pairs = [list(itertools.product(values, repeat=2)) for values in grid]
        curves = [
            [base + x * family.basis[0] + y * family.basis[1] for x, y in rows]
            for base, rows in zip(family.base, pairs, strict=True)
        ]
        choice, least = brute_force(problem, curves, 20)
        for joint, index in enumerate(choice):
            assert_allclose(found.q[:, joint], curves[joint][index](found.t), atol=1e-12)
        times = np.linspace(0.0, problem.horizon, 21)
        tau = problem.loaded_arm.inverse_dynamics(*found.at(times))
        assert torque_integral(times, tau) == pytest.approx(least, rel=1e-12)


def index_by_quadrature(found: list[Any], gravity: float, derivatives: Any) -> float:
    """PI (eq 6) over 1 s by adaptive quadrature."""
    arm = replace(PLANAR_3R, gravity=gravity)

    def rate(t: float) -> float:
        q, qd, qdd = (np.array([derivatives(curve, t, order) for curve in found]) for order in range(3))
        return float(np.abs(arm.inverse_dynamics(q, qd, qdd)).sum())

    return sum(quad(rate, k / 10, (k + 1) / 10, limit=200, epsabs=1e-7)[0] for k in range(10))


def barycentric(curve: BarycentricInterpolator, t: float, order: int) -> float:
    return float(curve(t) if order == 0 else curve.derivative(t, order))


@pytest.mark.parametrize(("gravity", "lagrange", "polynomial"), [(0.0, 8.48198, 9.96543), (9.81, 5.55653, 15.04740)])
def test_index_of_the_printed_motions(gravity: float, lagrange: float, polynomial: float) -> None:
    problem = paper_problem(gravity)
    assert published_motion(problem, "lagrange").cost == pytest.approx(lagrange, abs=5e-5)
    assert published_motion(problem, "polynomial").cost == pytest.approx(polynomial, abs=5e-5)
    interpolated = [BarycentricInterpolator(PUBLISHED_TIMES, np.radians(angles)) for angles in PUBLISHED_ANGLES]
    printed = [np.poly1d(coefficients) for coefficients in PUBLISHED_COEFFICIENTS]
    assert index_by_quadrature(interpolated, gravity, barycentric) == pytest.approx(lagrange, abs=2e-5)
    assert index_by_quadrature(printed, gravity, lambda p, t, d: p.deriv(d)(t)) == pytest.approx(polynomial, abs=2e-5)


def test_printed_motions_are_those_of_the_tables() -> None:
    lagrange, polynomial = (published_motion(paper_problem(), method) for method in ("lagrange", "polynomial"))
    for joint, angles in enumerate(PUBLISHED_ANGLES):
        reference = BarycentricInterpolator(PUBLISHED_TIMES, np.radians(angles))
        assert_allclose(lagrange.q[:, joint], reference(lagrange.t), atol=1e-12)
    assert_allclose(lagrange.q[-1], [1.0145, -0.0391, 0.0157], atol=5e-5)
    assert_allclose(lagrange.qd[0], [-0.8547, 9.4528, -3.3774], atol=5e-5)
    assert lagrange.rendezvous_time == math.inf
    for joint, coefficients in enumerate(PUBLISHED_COEFFICIENTS):
        assert_allclose(polynomial.q[:, joint], np.polyval(coefficients, polynomial.t), atol=1e-12)
    assert_allclose(polynomial.q[-1], [1.0, 0.0, 0.0], atol=1e-12)


def test_printed_motions_are_of_three_joints_by_two_methods() -> None:
    with pytest.raises(ValueError, match="'spline' must be one of"):
        published_motion(paper_problem(), "spline")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="of 3 joints; SCARA_1M has 2"):
        published_motion(two_link_problem(), "lagrange")


def test_table_2_is_not_equation_7() -> None:
    assert_allclose(PUBLISHED_TIMES[:4], np.sin(np.radians([0, 15, 30, 45])), atol=5e-5)
    assert np.abs(np.array(PUBLISHED_TIMES) - chebyshev_nodes(5)).max() > 0.08


@pytest.mark.parametrize(("gravity", "printed", "least"), [(0.0, 8.482, 0.6948), (9.81, 5.557, 2.0579)])
def test_table_3_is_not_the_least_of_its_own_grid(gravity: float, printed: float, least: float) -> None:
    problem = paper_problem(gravity)
    table, grid = np.radians(PUBLISHED_ANGLES), node_angles(problem)
    for angles, values in zip(table, grid, strict=True):
        assert np.abs(angles[:, None] - values).min(axis=1).max() < 1e-6
    assert published_motion(problem, "lagrange").cost == pytest.approx(printed, abs=1e-3)
    assert plan_paper(problem, nodes=PUBLISHED_TIMES).cost == pytest.approx(least, abs=1e-4)


def test_the_stated_problem_has_a_trivial_solution() -> None:
    turning = motion(paper_problem(), [Polynomial([0.0, 1.0]), Polynomial([0.0]), Polynomial([0.0])], "theta1 = t")
    assert turning.cost == 0.0
    found = plan_paper(paper_problem(), method="polynomial")
    assert found.cost == pytest.approx(0.0, abs=1e-12)
    assert_allclose(found.q, np.outer(found.t, [1.0, 0.0, 0.0]), atol=1e-12)


def test_both_algorithms_choose_from_the_same_functions() -> None:
    """A degree-4 interpolant is a degree-4 polynomial: at equal degree only the grids differ."""
    problem = paper_problem(9.81)
    angles = [[0.2, 0.6, 0.8], [1.0, 0.75, 0.5], [0.25, 0.75, 0.5]]
    curves = lagrange_family(problem, 5).member(angles)
    coefficients = polynomial_family(problem, 4).member([curve.coef[2:5].tolist() for curve in curves])
    for one, other in zip(curves, coefficients, strict=True):
        assert_allclose(one.coef, other.coef, atol=1e-10)
    # searched, degree 2 does better than the degree-4 motion the paper prints
    assert plan_paper(problem, method="polynomial").cost < published_motion(problem, "lagrange").cost


@pytest.mark.parametrize(
    ("gravity", "nodes", "pi"), [(0.0, LOBATTO, 3.700), (0.0, 5, 3.563), (9.81, LOBATTO, 14.827), (9.81, 5, 14.508)]
)
def test_search_from_rest_to_rest(gravity: float, nodes: int | tuple[float, ...], pi: float) -> None:
    found = plan_paper(paper_problem(gravity), nodes=nodes, clamped=True)
    assert found.cost == pytest.approx(pi, abs=6e-4)
    assert_allclose(found.qd[[0, -1]], 0.0, atol=1e-12)
    assert_allclose(found.q[[0, -1]], [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], atol=1e-12)
    assert found.rendezvous_time == found.duration == 1.0


def test_a_trajectory_is_what_it_says() -> None:
    problem = two_link_problem()
    found = plan_paper(problem, nodes=4, clamped=True)
    assert_allclose(found.tau, problem.loaded_arm.inverse_dynamics(found.q, found.qd, found.qdd), atol=1e-12)
    assert_allclose(np.gradient(found.q, found.t, axis=0)[1:-1], found.qd[1:-1], atol=1e-4)
    assert_allclose(np.gradient(found.qd, found.t, axis=0)[1:-1], found.qdd[1:-1], atol=1e-3)
    for kind, values in {"torque": found.tau, "velocity": found.qd, "acceleration": found.qdd}.items():
        ratio = (np.abs(values) / getattr(problem.joint_limits, kind)).max()
        assert found.limit_ratios[kind] == pytest.approx(ratio, rel=1e-3)
    assert found.limit_ratio > 1.0  # nothing is scaled to fit
    assert plan_paper(problem, nodes=4).rendezvous_time == math.inf  # not at rest


@pytest.mark.parametrize("method", ["lagrange", "polynomial"])
def test_without_gravity_the_index_is_inverse_to_the_time(method: Method) -> None:
    options: dict[str, Any] = {"method": method, "clamped": True, "nodes": 4, "degree": 4}
    plans: list[Trajectory] = []
    for horizon in (1.0, 2.0):
        coefficients = [np.linspace(-8.0, 8.0, 5) / horizon**4] * 3
        grid = node_angles(paper_problem()) if method == "lagrange" else coefficients
        plans.append(plan_paper(replace(paper_problem(), horizon=horizon), grid=grid, **options))
    assert plans[1].cost == pytest.approx(plans[0].cost / 2.0, rel=1e-12)
    assert_allclose(plans[1].q, plans[0].q, atol=1e-12)


def test_default_grid_lies_between_start_and_goal() -> None:
    first, second = node_angles(two_link_problem(target=FixedJoints([1.1, -0.5])))
    assert_allclose(first, [0.3, 0.46, 0.62, 0.78, 0.94, 1.1], atol=1e-12)
    assert_allclose(second, [-0.5, -0.25, 0.0, 0.25, 0.5], atol=1e-12)


def test_plans_repeat_bit_for_bit_and_leave_arguments_alone() -> None:
    nodes: Array = np.array([0.1, 0.5, 0.9])
    first, second = (plan_paper(paper_problem(), nodes=nodes, clamped=True) for _ in range(2))
    assert first.tau.tobytes() == second.tau.tobytes()
    assert nodes.tolist() == [0.1, 0.5, 0.9]


@pytest.mark.parametrize(
    ("changes", "options", "message"),
    [
        ({"target": FixedHand([0.5, 0.5])}, {}, "of kind joints, not hand; .* can"),
        ({}, {"method": "spline"}, "'spline' must be one of 'lagrange', 'polynomial'"),
        ({}, {"nodes": 1}, "nodes 1: give a number from 2"),
        ({}, {"nodes": (0.0, 0.6, 0.4, 1.0)}, "rising fractions"),
        ({}, {"nodes": (0.0, 0.5, 1.2)}, "rising fractions"),
        ({}, {"method": "polynomial", "degree": 0}, "degree 0 must be from 1"),
        ({}, {"method": "polynomial", "degree": 2, "clamped": True}, "degree 2 must be from 3, .* 4 conditions"),
        ({}, {"steps": 1}, "steps 1"),
        ({}, {"grid": [[0.0]]}, "each of the 2 joints"),
        ({}, {"grid": [[0.0], []]}, "each of the 2 joints"),
        ({}, {"grid": [[0.0], [math.nan]]}, "each of the 2 joints"),
        ({}, {"grid": [np.linspace(0.0, 1.0, 40)] * 2}, r"grid has 4.1e\+09 points, 6.4e\+04 for one joint"),
    ],
)
def test_what_cannot_be_searched_is_refused(changes: dict[str, Any], options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        plan_paper(two_link_problem(**changes), **options)
