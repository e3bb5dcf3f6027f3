"""Dynamics of the excavator against MuJoCo, against the planar arms' and against the laws of mechanics."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from excavator_cases import acceleration, planar_chain
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from planners import PLANAR_3R
from planners.excavator import EXCAVATOR, Excavator, forward_kinematics, frames
from planners.excavator.dynamics import (
    ChainDynamics,
    PayloadModel,
    inertial_parameters,
    payload,
    payload_basis,
)
from planners.excavator.plane import HELD_ROLL, JOINTS, planar_model, planar_payload
from planners.typing import Array

DYNAMICS = ChainDynamics.of_excavator()
MASSES = (0.0, 70.0, 350.0)
N = len(EXCAVATOR.links)


def random_states(count: int, seed: int = 0) -> tuple[Array, Array, Array, Array]:
    """Angles over the whole circle; velocities, reference velocities and accelerations of a few units."""
    rng = np.random.default_rng(seed)
    return rng.uniform(-np.pi, np.pi, (count, N)), *rng.normal(0.0, 2.0, (3, count, N))


def mujoco_model(machine: Excavator, mass: float, offset: tuple[float, float, float]) -> mujoco.MjModel:
    """The same chain: a body's frame is the Denavit-Hartenberg frame before it, turned by the joint."""

    def numbers(values: Array) -> str:
        return " ".join(f"{value:.17g}" for value in values)

    def shifted(i: int, point: Array) -> Array:
        """A point of frame i in the frame of body i."""
        a, d, alpha = (column[i] for column in geometry.table)
        sine, cosine = np.sin(alpha), np.cos(alpha)
        return np.array([a + point[0], cosine * point[1] - sine * point[2], d + sine * point[1] + cosine * point[2]])

    def twist(i: int) -> str:
        half = 0.5 * geometry.table[2][i]
        return numbers(np.array([np.cos(half), np.sin(half), 0.0, 0.0]))

    geometry, body = machine.geometry, ""
    if mass:
        center = shifted(N - 1, np.add(machine.payload.com, offset))
        inertia = numbers(np.full(3, mass * machine.payload.gyration_square(mass)))
        body = f'<body pos="{numbers(center)}"><inertial pos="0 0 0" mass="{mass}" diaginertia="{inertia}"/></body>'
    for i in reversed(range(N)):
        link = machine.links[i]
        place = f'pos="{numbers(shifted(i - 1, np.zeros(3)))}" quat="{twist(i - 1)}"' if i else ""
        body = (
            f'<body {place}><joint type="hinge" axis="0 0 1" armature="{link.actuator_inertia}" '
            f'damping="{link.friction}"/><inertial pos="{numbers(shifted(i, np.array(link.com)))}" quat="{twist(i)}" '
            f'mass="{link.mass}" diaginertia="{numbers(np.array(link.inertia))}"/>{body}</body>'
        )
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><option gravity="0 0 {-machine.gravity}"/><worldbody>{body}</worldbody></mujoco>'
    )


@pytest.mark.parametrize("mass", MASSES)
def test_dynamics_are_those_of_mujoco(mass: float) -> None:
    offset = (0.05, -0.08, 0.03)
    model = mujoco_model(EXCAVATOR, mass, offset)
    data = mujoco.MjData(model)
    q, qd, qdd, _ = random_states(100)
    load = np.tile(payload(mass, offset=offset), (len(q), 1))
    tau = DYNAMICS.torque(q, qd, qd, qdd, load)
    for row in range(len(q)):
        data.qpos, data.qvel, data.qacc = q[row], qd[row], qdd[row]
        mujoco.mj_inverse(model, data)
        # its passive forces hold the friction, which the motors have to overcome
        np.testing.assert_allclose(tau[row], data.qfrc_inverse, rtol=1e-9, atol=1e-9 * np.abs(tau[row]).max())
    np.testing.assert_allclose(acceleration(DYNAMICS, q, qd, tau, load), qdd, atol=1e-10)


def test_columns_of_the_mass_matrix_are_torques() -> None:
    q, *_ = random_states(50)
    load, still = np.tile(payload(350.0), (len(q), 1)), np.zeros_like(q)
    weight = DYNAMICS.torque(q, still, still, still, load)
    columns = [DYNAMICS.torque(q, still, still, still + unit, load) - weight for unit in np.eye(N)]
    np.testing.assert_allclose(DYNAMICS.mass_matrix(q, load), np.stack(columns, axis=-1), rtol=1e-10, atol=1e-8)


def test_planar_chain_is_the_planar_arm() -> None:
    arm = replace(PLANAR_3R, gravity=9.81, coms=(0.05, 0.3, 0.2))
    chain, rng = planar_chain(arm), np.random.default_rng(1)
    q, qd, qdd = rng.normal(0.0, 2.0, (3, 50, 3))
    np.testing.assert_allclose(chain.torque(q, qd, qd, qdd), arm.inverse_dynamics(q, qd, qdd), atol=1e-12)
    point = np.tile(inertial_parameters(0.7, np.zeros(3), np.zeros((3, 3))), (50, 1))
    loaded = arm.with_payload(0.7)
    np.testing.assert_allclose(chain.torque(q, qd, qd, qdd, point), loaded.inverse_dynamics(q, qd, qdd), atol=1e-12)


@pytest.mark.parametrize("moments", [False, True])
def test_plane_is_the_attachment_with_slew_and_roll_held(moments: bool) -> None:
    rng = np.random.default_rng(2)
    q, qd, qd_r, qdd_r = rng.normal(0.0, 1.0, (4, 50, 3))

    def held(values: Array, roll: float = 0.0) -> Array:
        return np.pad(values, ((0, 0), (1, 1)), constant_values=((0.0, 0.0), (0.0, roll)))

    plane, whole = planar_model(moments=moments), PayloadModel(DYNAMICS, payload_basis(moments=moments))
    parameters = np.tile([140.0, 5.0, -8.0][: plane.n_parameters], (50, 1))
    # the whole attachment has a moment more, across the plane
    all_parameters = np.insert(parameters, 1, 3.0, axis=1) if moments else parameters
    expected = whole.torque(held(q, HELD_ROLL), held(qd), held(qd_r), held(qdd_r), all_parameters)[:, JOINTS]
    expected -= DYNAMICS.drives[JOINTS, 0] * qdd_r
    found = plane.torque(q, qd, qd_r, qdd_r, parameters)
    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-8)
    np.testing.assert_allclose(planar_payload(175.0), 175.0 * plane.basis[0], rtol=1e-12, atol=1e-9)


def coriolis(q: Array, qd: Array, load: Array) -> Array:
    """The matrix C of every row, column by column."""
    still = np.zeros_like(q)
    gravity = DYNAMICS.torque(q, qd, still, still, load)
    columns = [DYNAMICS.torque(q, qd, still + unit, still, load) - gravity for unit in np.eye(N)]
    return np.stack(columns, axis=-1) - np.diag(DYNAMICS.drives[:, 1])


def test_mass_rate_minus_twice_coriolis_is_skew() -> None:
    q, qd, _, _ = random_states(100)
    load, step = np.tile(payload(350.0), (len(q), 1)), 1e-5
    ahead, behind = (DYNAMICS.mass_matrix(q + sign * step * qd, load) for sign in (1.0, -1.0))
    skew = (ahead - behind) / (2.0 * step) - 2.0 * coriolis(q, qd, load)
    np.testing.assert_allclose(skew, -skew.swapaxes(1, 2), atol=1e-7 * np.abs(skew).max())


def test_torque_is_linear_in_both_velocities() -> None:
    q, qd, qd_r, qdd_r = random_states(50)
    load = np.tile(payload(140.0), (len(q), 1))
    m, c, friction = DYNAMICS.mass_matrix(q, load), coriolis(q, qd, load), DYNAMICS.drives[:, 1]
    still = np.zeros_like(q)
    expected = np.einsum("lij,lj->li", m, qdd_r) + np.einsum("lij,lj->li", c, qd_r) + friction * qd_r
    expected += DYNAMICS.torque(q, still, still, still, load)
    np.testing.assert_allclose(DYNAMICS.torque(q, qd, qd_r, qdd_r, load), expected, rtol=1e-11, atol=1e-7)


@settings(max_examples=20, deadline=None)
@given(parameters=st.lists(st.floats(-200.0, 400.0), min_size=4, max_size=4), moments=st.booleans())
def test_torque_is_linear_in_the_parameters(parameters: list[float], moments: bool) -> None:
    model = PayloadModel(DYNAMICS, payload_basis(moments=moments))
    q, qd, qd_r, qdd_r = random_states(10)
    given_parameters = np.tile(parameters[: model.n_parameters], (len(q), 1))
    nothing = np.zeros_like(given_parameters)
    added = model.torque(q, qd, qd_r, qdd_r, given_parameters) - model.torque(q, qd, qd_r, qdd_r, nothing)
    expected = np.einsum("lnp,lp->ln", model.regressor(q, qd, qd_r, qdd_r), given_parameters)
    np.testing.assert_allclose(added, expected, rtol=1e-9, atol=1e-7)


@settings(max_examples=20, deadline=None)
@given(
    mass=st.floats(0.0, 500.0),
    angles=st.lists(st.floats(-np.pi, np.pi), min_size=N, max_size=N),
    offset=st.tuples(*[st.floats(-0.3, 0.3)] * 3),
)
def test_mass_matrix_is_symmetric_and_positive(mass: float, angles: list[float], offset: tuple[float, ...]) -> None:
    m = DYNAMICS.mass_matrix(np.array([angles]), payload(mass, offset=(offset[0], offset[1], offset[2]))[None])[0]
    np.testing.assert_allclose(m, m.T, atol=1e-12 * m.max())
    assert np.linalg.eigvalsh(m).min() > 1.0


def potential_energy(q: Array, mass: float) -> Array:
    """Weight times height of the links and of a payload, ``(batch,)``, J."""
    chain = frames(q)
    bodies = [(i + 1, link.mass, link.com) for i, link in enumerate(EXCAVATOR.links)]
    bodies.append((N, mass, EXCAVATOR.payload.com))
    height: Array = np.sum([m * (chain[:, i] @ np.array([*com, 1.0]))[:, 2] for i, m, com in bodies], axis=0)
    return 9.81 * height


def test_energy_of_a_free_swing_is_kept() -> None:
    free = replace(DYNAMICS, drives=DYNAMICS.drives * [1.0, 0.0])
    load = payload(350.0)[None]

    def rates(_t: float, y: Array) -> Array:
        return np.concatenate([y[N:], acceleration(free, y[None, :N], y[None, N:], np.zeros((1, N)), load)[0]])

    start = np.concatenate([np.radians([-30.0, 40.0, -70.0, 30.0, 60.0]), np.full(N, 0.3)])
    y = solve_ivp(rates, (0.0, 2.0), start, method="DOP853", rtol=1e-10, atol=1e-10, t_eval=np.linspace(0.0, 2.0, 9)).y
    loads = np.tile(load, (9, 1))
    q, qd = np.ascontiguousarray(y[:N].T), y[N:].T
    kinetic = 0.5 * np.einsum("bi,bij,bj->b", qd, free.mass_matrix(q, loads), qd)
    potential = potential_energy(q, 350.0)
    assert np.ptp(potential) > 1e3
    np.testing.assert_allclose(kinetic + potential, kinetic[0] + potential[0], rtol=0.0, atol=1e-7 * np.ptp(potential))


def test_payload_moments_shift_its_centre() -> None:
    """A ball that sits elsewhere is the unit mass plus first moments, but for its moments of inertia."""
    mass, offset = 175.0, np.array([0.02, -0.03, 0.01])
    basis = payload_basis(moments=True)
    guess = np.array([mass, *(mass * offset)]) @ basis
    true = payload(mass, offset=(0.02, -0.03, 0.01))
    np.testing.assert_allclose(guess[:4], true[:4], rtol=1e-12)
    assert np.abs(guess[4:] - true[4:]).max() < 2.5 * mass * 0.3 * 0.03
    np.testing.assert_allclose(payload_basis()[0] * mass, payload(mass), rtol=1e-12)


def test_static_torque_of_a_payload_is_weight_times_lever() -> None:
    q = np.radians([[0.0, 20.0, -40.0, 10.0, 90.0]])
    still = np.zeros_like(q)
    loaded = DYNAMICS.torque(q, still, still, still, payload(350.0)[None])
    added = (loaded - DYNAMICS.torque(q, still, still, still))[0, 1]
    wrist, tip = frames(q)[0, N, :3, 3], forward_kinematics(q)[0][0]
    center = wrist + EXCAVATOR.payload.com[2] / EXCAVATOR.geometry.d6 * (tip - wrist)
    assert added == pytest.approx(350.0 * 9.81 * center[0], rel=1e-9)


def test_what_cannot_be_is_refused() -> None:
    q = np.zeros((2, N))
    with pytest.raises(ValueError, match=r"\(3, 10\); give \(2, 10\)"):
        DYNAMICS.mass_matrix(q, np.zeros((3, 10)))
    with pytest.raises(ValueError, match="must be finite and not negative"):
        payload(-1.0)
