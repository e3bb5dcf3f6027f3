"""Rigid-body dynamics against a symbolic Lagrangian, a published arm and the laws of mechanics."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from planners import PLANAR_3R, SCARA_1M, Arm, JointLimits
from planners.robot.dynamics import solve_mass_matrix
from planners.typing import Array


@st.composite
def arms(draw: st.DrawFn) -> Arm:
    """Arms of one to six links with anything a real link may have."""
    n = draw(st.integers(1, 6))

    def per_link(low: float, high: float) -> tuple[float, ...]:
        return tuple(draw(st.lists(st.floats(low, high), min_size=n, max_size=n)))

    return Arm(
        name="random",
        lengths=per_link(0.1, 2.0),
        masses=per_link(0.1, 5.0),
        coms=per_link(0.0, 2.0),
        inertias=per_link(0.01, 2.0),
        gravity=draw(st.floats(-20.0, 20.0)),
        limits=JointLimits.unlimited(n),
    )


def random_state(arm: Arm, seed: int, *rows: int) -> tuple[Array, Array, Array]:
    """Angles over the whole circle, and velocities and a third quantity of a few units."""
    rng = np.random.default_rng(seed)
    shape = (*rows, arm.n_joints)
    return rng.uniform(-np.pi, np.pi, shape), rng.normal(0.0, 2.0, shape), rng.normal(0.0, 5.0, shape)


def hanging(arm: Arm) -> Arm:
    return replace(arm, gravity=9.81)


LOPSIDED_2R = Arm(
    name="lopsided 2R",
    lengths=(0.7, 0.45),
    masses=(2.3, 0.9),
    coms=(0.21, 0.5),
    inertias=(0.13, 0.04),
    gravity=9.81,
    limits=JointLimits.unlimited(2),
)
LOPSIDED_3R = Arm(
    name="lopsided 3R",
    lengths=(0.7, 0.45, 0.3),
    masses=(2.3, 0.9, 1.7),
    coms=(0.21, 0.5, 0.0),
    inertias=(0.13, 0.04, 0.02),
    gravity=9.81,
    limits=JointLimits.unlimited(3),
)


@cache
def lagrange_torques(n: int) -> Callable[..., list[float]]:
    """tau(q, qd, qdd, lengths, masses, coms, inertias, gravity) as d/dt dL/dqd - dL/dq, derived by sympy."""
    q, qd, qdd, lengths, masses, coms, inertias = (
        sp.symbols(f"{name}:{n}", real=True) for name in ("q", "v", "a", "l", "m", "c", "I")
    )
    gravity = sp.Symbol("g", real=True)
    joint, phi, lagrangian = sp.zeros(2, 1), sp.Integer(0), sp.Integer(0)
    for i in range(n):
        phi += q[i]
        along = sp.Matrix([sp.cos(phi), sp.sin(phi)])
        com = joint + coms[i] * along
        velocity = com.jacobian(q) * sp.Matrix(qd)
        kinetic = masses[i] * velocity.dot(velocity) / 2 + inertias[i] * sum(qd[: i + 1]) ** 2 / 2
        lagrangian += kinetic - masses[i] * gravity * com[1]
        joint += lengths[i] * along
    momenta = [sp.diff(lagrangian, speed) for speed in qd]
    torques = [
        sum(sp.diff(momenta[i], q[j]) * qd[j] + sp.diff(momenta[i], qd[j]) * qdd[j] for j in range(n))
        - sp.diff(lagrangian, q[i])
        for i in range(n)
    ]
    return sp.lambdify((q, qd, qdd, lengths, masses, coms, inertias, gravity), torques, cse=True)


@pytest.mark.parametrize("arm", [LOPSIDED_2R, LOPSIDED_3R], ids=lambda arm: arm.name)
def test_inverse_dynamics_is_the_lagrangian_one(arm: Arm) -> None:
    torques = lagrange_torques(arm.n_joints)
    for q, qd, qdd in zip(*random_state(arm, 1, 50), strict=True):
        expected = torques(q, qd, qdd, arm.lengths, arm.masses, arm.coms, arm.inertias, arm.gravity)
        np.testing.assert_allclose(arm.inverse_dynamics(q, qd, qdd), expected, rtol=1e-11, atol=1e-11)


def test_two_metre_arm_has_the_published_equation_of_motion() -> None:
    """Table 1 of "Motion Planning of a Robot Manipulator for Conveyor Tracking"."""
    for q, qd, qdd in zip(*random_state(SCARA_1M, 2, 20), strict=True):
        c2, s2 = np.cos(q[1]), np.sin(q[1])
        mass = np.array([[5 / 3 + c2, 1 / 3 + c2 / 2], [1 / 3 + c2 / 2, 1 / 3]])
        coriolis = np.array([-s2 / 2 * qd[1] ** 2 - s2 * qd[0] * qd[1], s2 / 2 * qd[0] ** 2])
        np.testing.assert_allclose(SCARA_1M.mass_matrix(q), mass, rtol=1e-13, atol=1e-14)
        np.testing.assert_allclose(SCARA_1M.bias(q, qd), coriolis, rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(SCARA_1M.inverse_dynamics(q, qd, qdd), mass @ qdd + coriolis, rtol=1e-12, atol=1e-13)


@given(arms(), st.integers(0, 10_000))
@settings(deadline=None, max_examples=60)
def test_mass_matrix_is_symmetric_positive_definite(arm: Arm, seed: int) -> None:
    q, _, _ = random_state(arm, seed)
    mass = arm.mass_matrix(q)
    np.testing.assert_array_equal(mass, mass.T)
    assert np.linalg.eigvalsh(mass).min() > 0.0


@given(arms(), st.integers(0, 10_000))
@settings(deadline=None, max_examples=60)
def test_inverse_dynamics_is_mass_matrix_times_acceleration_plus_bias(arm: Arm, seed: int) -> None:
    q, qd, qdd = random_state(arm, seed)
    expected = arm.mass_matrix(q) @ qdd + arm.bias(q, qd)
    scale = np.abs(arm.mass_matrix(q)) @ np.abs(qdd) + np.abs(arm.bias(q, qd))
    assert np.all(np.abs(arm.inverse_dynamics(q, qd, qdd) - expected) <= 1e-11 * (1.0 + scale))


@given(arms(), st.integers(0, 10_000))
@settings(deadline=None, max_examples=60)
def test_forward_dynamics_undoes_inverse_dynamics(arm: Arm, seed: int) -> None:
    q, qd, qdd = random_state(arm, seed)
    mass = arm.mass_matrix(q)
    found = arm.forward_dynamics(q, qd, arm.inverse_dynamics(q, qd, qdd))
    # a linear solve loses as many digits as the condition number has
    scale = np.linalg.cond(mass) * (np.abs(qdd).max() + np.abs(arm.bias(q, qd)).max() / np.linalg.norm(mass, 2))
    np.testing.assert_allclose(found, qdd, rtol=0.0, atol=1e-14 * scale + 1e-12)


@given(arms(), st.integers(0, 10_000))
@settings(deadline=None, max_examples=40)
def test_coriolis_torques_are_the_christoffel_symbols_of_the_mass_matrix(arm: Arm, seed: int) -> None:
    """With C built from Christoffel symbols dM/dt - 2C is skew: the bias follows from the mass matrix alone."""
    arm = replace(arm, gravity=0.0)
    q, qd, _ = random_state(arm, seed)
    step = 1e-5
    # dmass[i, j, k] = dM_ij / dq_k
    dmass = np.stack(
        [(arm.mass_matrix(q + e) - arm.mass_matrix(q - e)) / (2 * step) for e in step * np.eye(arm.n_joints)], axis=-1
    )
    coriolis = 0.5 * np.einsum("ijk,k->ij", dmass + dmass.transpose(0, 2, 1) - dmass.transpose(2, 1, 0), qd)
    rate = dmass @ qd
    tolerance = 1e-8 * (1.0 + np.abs(arm.mass_matrix(q)).max() * np.sum(np.abs(qd)) ** 2)
    skew = rate - 2.0 * coriolis
    np.testing.assert_allclose(skew, -skew.T, rtol=0.0, atol=tolerance)
    np.testing.assert_allclose(arm.bias(q, qd), coriolis @ qd, rtol=0.0, atol=tolerance)


@pytest.mark.parametrize("arm", [SCARA_1M, LOPSIDED_2R, LOPSIDED_3R], ids=lambda arm: arm.name)
def test_energy_grows_by_the_power_of_the_joints(arm: Arm) -> None:
    step = 1e-5
    for q, qd, tau in zip(*random_state(arm, 3, 20), strict=True):
        qdd = arm.forward_dynamics(q, qd, tau)

        def energy_at(t: float, q: Array = q, qd: Array = qd, qdd: Array = qdd) -> Array:
            return arm.energy(q + t * qd + 0.5 * t**2 * qdd, qd + t * qdd)

        rate = (energy_at(step) - energy_at(-step)) / (2 * step)
        assert rate == pytest.approx(tau @ qd, rel=1e-6, abs=1e-5)


def test_free_triple_pendulum_keeps_its_energy() -> None:
    arm = hanging(PLANAR_3R)
    start = np.array([0.3, -1.1, 0.8, 0.5, -1.0, 2.0])
    still = np.zeros(3)

    def fall(_: float, state: Array) -> Array:
        return np.concatenate([state[3:], arm.forward_dynamics(state[:3], state[3:], still)])

    swing = solve_ivp(fall, (0.0, 3.0), start, method="DOP853", rtol=1e-10, atol=1e-12)
    energy = arm.energy(swing.y[:3].T, swing.y[3:].T)
    kinetic = energy - arm.energy(swing.y[:3].T, np.zeros_like(swing.y[3:].T))
    assert np.ptp(kinetic) > 10.0, "the pendulum hardly moved"
    assert np.abs(energy - energy[0]).max() < 1e-7


def test_gravity_is_the_slope_of_the_potential() -> None:
    q, still, _ = random_state(LOPSIDED_3R, 4)
    still = np.zeros_like(still)
    step = 1e-6
    slope = [
        (LOPSIDED_3R.energy(q + e, still) - LOPSIDED_3R.energy(q - e, still)) / (2 * step) for e in step * np.eye(3)
    ]
    np.testing.assert_allclose(LOPSIDED_3R.bias(q, still), slope, rtol=1e-8, atol=1e-8)


def test_stretched_arm_is_held_by_its_weight_times_its_lever() -> None:
    arm = hanging(SCARA_1M)
    held = arm.inverse_dynamics([0.0, 0.0], [0.0, 0.0], [0.0, 0.0])
    np.testing.assert_allclose(held, [9.81 * (0.5 + 1.5), 9.81 * 0.5], rtol=1e-14)
    np.testing.assert_allclose(arm.bias([np.pi / 2, 0.0], [0.0, 0.0]), 0.0, atol=1e-14)
    assert arm.energy([np.pi / 2, 0.0], [0.0, 0.0]) == pytest.approx(9.81 * 2.0, rel=1e-14)


@pytest.mark.parametrize("arm", [SCARA_1M, LOPSIDED_2R, LOPSIDED_3R], ids=lambda arm: arm.name)
def test_payload_adds_the_force_that_moves_a_point_mass(arm: Arm) -> None:
    """tau_loaded - tau = J^T m (hand acceleration + gravity), the acceleration from the complex form of the chain."""
    mass = 1.3
    for q, qd, qdd in zip(*random_state(arm, 5, 20), strict=True):
        phi, speed, acceleration = np.cumsum(q), np.cumsum(qd), np.cumsum(qdd)
        hand = np.sum(np.array(arm.lengths) * np.exp(1j * phi) * (1j * acceleration - speed**2))
        force = mass * np.array([hand.real, hand.imag + arm.gravity])
        expected = arm.inverse_dynamics(q, qd, qdd) + arm.jacobian(q).T @ force
        np.testing.assert_allclose(
            arm.with_payload(mass).inverse_dynamics(q, qd, qdd), expected, rtol=1e-11, atol=1e-10
        )


@pytest.mark.parametrize("method", ["inverse_dynamics", "forward_dynamics", "mass_matrix", "bias", "energy"])
@pytest.mark.parametrize("arm", [SCARA_1M, LOPSIDED_3R], ids=lambda arm: arm.name)
def test_a_environment_of_a_batch_equals_the_single_call_bit_for_bit(arm: Arm, method: str) -> None:
    count = {"mass_matrix": 1, "bias": 2, "energy": 2}.get(method, 3)
    arguments = random_state(arm, 6, 101)[:count]
    batch = getattr(arm, method)(*arguments)
    singles = [getattr(arm, method)(*row) for row in zip(*arguments, strict=True)]
    np.testing.assert_array_equal(batch, singles)


@pytest.mark.parametrize(
    ("q", "qd", "qdd"),
    [
        ([0.0], [0.0], [0.0]),
        ([0.0, 0.0], [0.0, 0.0], [0.0]),
        (np.zeros((3, 2)), np.zeros((4, 2)), np.zeros((3, 2))),
        (np.zeros((1, 3, 2)), np.zeros((1, 3, 2)), np.zeros((1, 3, 2))),
        (0.0, 0.0, 0.0),
    ],
)
def test_wrong_shapes_are_refused_by_name(q: Array, qd: Array, qdd: Array) -> None:
    for method in (SCARA_1M.inverse_dynamics, SCARA_1M.forward_dynamics):
        with pytest.raises(ValueError, match=r"got shapes .*SCARA_1M wants \(2,\) or \(batch, 2\)"):
            method(q, qd, qdd)


def test_a_singular_matrix_gives_what_is_not_finite_and_no_exception() -> None:
    right = np.array([1.0, 2.0])
    solve_mass_matrix(np.array([[1.0, 1.0], [1.0, 1.0]]), right)
    assert not np.isfinite(right).all()
