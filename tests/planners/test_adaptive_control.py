"""Controllers that do not know the payload, against their Lyapunov functions, closed forms and one another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from excavator_cases import acceleration, planar_chain
from scipy.integrate import solve_ivp
from scipy.linalg import solve_continuous_lyapunov

from planners import PLANAR_3R
from planners.control import (
    AdaptiveComputedTorque,
    ComputedTorque,
    Controller,
    ControlSettings,
    IntegralComputedTorque,
    IntegralSlotineLi,
    PayloadPrior,
    PDGravity,
    SlotineLi,
)
from planners.excavator import EXCAVATOR
from planners.excavator.controllers import ADAPTIVE, BANDWIDTH, FIXED, make_controller
from planners.excavator.dynamics import ChainDynamics, PayloadModel, payload, payload_basis
from planners.excavator.motion import WORK_CYCLE, Cycle
from planners.excavator.plane import JOINTS, planar_dynamics, planar_payload
from planners.excavator.simulation import Plant, Run, simulate
from planners.typing import Array

DYNAMICS = ChainDynamics.of_excavator()
N = len(EXCAVATOR.links)
NAMES = (*FIXED, *ADAPTIVE)
POSTURE = WORK_CYCLE.postures[:1]


def loads(masses: Sequence[float], offset: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Array:
    return np.array([payload(mass, offset=offset) for mass in masses])


def follow(name: str, plant: Plant, cycles: int = 1, period: float = 0.005, moments: bool = True) -> Run:
    controller = make_controller(name, moments=moments, rows=plant.rows, period=period)
    return simulate(controller, plant, WORK_CYCLE, cycles)


def rms(run: Run, cycles: int = 1) -> Array:
    """Of all joints in the last cycle, for each row, deg."""
    errors = np.degrees(run.q - run.q_d[:, None])[-(len(run.t) // cycles) :]
    return np.sqrt(np.square(errors).mean(axis=(0, 2)))


def settings_of(controller: Controller, period: float) -> ControlSettings:
    return replace(controller.settings, period=period, torque_limit=np.full(N, np.inf))


def error_from(controller: Controller, offset: Array, mass: float, until: float) -> tuple[Array, Array]:
    """Times and errors of an arm that is released away from a posture it should rest in."""
    period, plant = controller.settings.period, Plant.loaded(DYNAMICS, loads([mass]))
    q, qd, applied, still = POSTURE - offset, np.zeros((1, N)), np.zeros((1, N)), np.zeros((1, N))
    errors = []
    for _ in range(round(until / period)):
        errors.append(POSTURE[0] - q[0])
        plant.advance(q, qd, applied, controller.torque(q, qd, POSTURE, still, still), period)
    return period * np.arange(len(errors)), np.array(errors)


@pytest.mark.parametrize(
    ("kind", "shape"),
    [
        (ComputedTorque, lambda x: 1.0 + x),
        (IntegralComputedTorque, lambda x: 1.0 + x - x**2),
    ],
)
def test_with_the_right_payload_errors_decay_as_the_poles_say(
    kind: type[Controller], shape: Callable[[Array], Array]
) -> None:
    model, known = make_controller().model, np.array([140.0, 0.0, 0.0, 0.0])
    prior = PayloadPrior(initial=known, lower=known, upper=known)
    offset = np.array([0.02, -0.01, 0.015, 0.03, -0.02])
    # the mass matrix of this ball, not of the typical one
    model = PayloadModel(DYNAMICS, np.vstack([payload(140.0) / 140.0, payload_basis(moments=True)[1:]]))
    controller = kind(model, settings_of(make_controller(), 5e-4), prior)
    t, errors = error_from(controller, offset, 140.0, 1.5)
    x = t[:, None] * np.array(BANDWIDTH)
    np.testing.assert_allclose(errors, offset * shape(x) * np.exp(-x), atol=3e-3 * np.abs(offset).max())


def adapting(kind: type[SlotineLi] | type[AdaptiveComputedTorque], gain: float, period: float) -> Controller:
    """With two parameters of which the payload is made exactly, so that nothing but the law is tested."""
    basis = np.stack([payload(200.0) / 200.0, np.eye(10)[1]])
    prior = PayloadPrior(initial=np.array([50.0, 0.0]), lower=np.full(2, -1e9), upper=np.full(2, 1e9))
    settings = settings_of(make_controller(), period)
    return kind(PayloadModel(DYNAMICS, basis), settings, prior, gain * np.array([1.0, 0.1]))


def storage(
    controller: Controller, gain: float, function: Callable[[Array, Array, Array, Array], tuple[float, float]]
) -> tuple[Array, Array]:
    """What is stored over time in a loop with a payload of 200 kg, and the integral of what is said to be lost."""
    period, true = controller.settings.period, np.array([200.0, 6.0])
    plant = Plant.loaded(DYNAMICS, (true @ controller.model.basis)[None])
    q_d, qd_d, qdd_d = WORK_CYCLE.sample(period * np.arange(round(0.4 / period)) + 0.3)
    q, qd, applied = q_d[:1] - 0.01, qd_d[:1].copy(), np.zeros((1, N))
    stored, lost = [], [0.0]
    for k in range(len(q_d)):
        error, rate = q_d[k] - q[0], qd_d[k] - qd[0]
        value, loss = function(error, rate, q, qd)
        missing = true - controller.parameters[0]
        stored.append(value + missing @ (missing / (gain * np.array([1.0, 0.1]))))
        lost.append(lost[-1] + period * loss)
        tau = controller.torque(q, qd, q_d[k : k + 1], qd_d[k : k + 1], qdd_d[k : k + 1])
        plant.advance(q, qd, applied, tau, period)
    return np.array(stored), np.array(lost[:-1])


def test_slotine_and_lis_function_falls_by_what_is_damped() -> None:
    """V = s^T M s + p^T Gamma^-1 p loses 2 s^T (K + b) s, exactly: the law of adaptation cancels the rest."""
    gain, bandwidth = 100.0, np.array(BANDWIDTH)
    controller = adapting(SlotineLi, gain, 2e-4)
    damping = bandwidth * controller.settings.inertia + DYNAMICS.drives[:, 1]
    load = (np.array([200.0, 6.0]) @ controller.model.basis)[None]

    def function(error: Array, rate: Array, q: Array, _qd: Array) -> tuple[float, float]:
        s = rate + bandwidth * error
        return float(s @ DYNAMICS.mass_matrix(q, load)[0] @ s), float(2.0 * s @ (damping * s))

    stored, lost = storage(controller, gain, function)
    np.testing.assert_allclose(stored[0] - stored, lost, atol=0.01 * lost[-1])
    assert stored[-1] < 0.9 * stored[0]


def test_the_papers_function_falls_by_what_q_says() -> None:
    """Eq 3-11 to 3-17: V = x^T P x + p^T Gamma^-1 p loses x^T Q x, with P from eq 3-16."""
    gain = 1e4
    controller = adapting(AdaptiveComputedTorque, gain, 2e-4)
    p, q_matrix = [], []
    for bandwidth in BANDWIDTH:
        a = np.array([[0.0, 1.0], [-(bandwidth**2), -2.0 * bandwidth]])
        q_matrix.append(np.diag([2.0 * bandwidth**3, 2.0 * bandwidth]))
        p.append(solve_continuous_lyapunov(a.T, -q_matrix[-1]))
        np.testing.assert_allclose(p[-1][1], [bandwidth, 1.0])

    def function(error: Array, rate: Array, _q: Array, _qd: Array) -> tuple[float, float]:
        x = np.stack([error, rate], axis=-1)
        return float(np.einsum("ji,jik,jk", x, p, x)), float(np.einsum("ji,jik,jk", x, q_matrix, x))

    stored, lost = storage(controller, gain, function)
    np.testing.assert_allclose(stored[0] - stored, lost, atol=0.02 * lost[-1])
    assert stored[-1] < 0.9 * stored[0]


@pytest.fixture(scope="module")
def nominal() -> dict[str, Run]:
    """Three cycles with 0, 70 and 350 kg."""
    plant = Plant.loaded(DYNAMICS, loads([0.0, 70.0, 350.0]))
    return {
        name: follow(name, plant, cycles=3)
        for name in ("computed-torque", "integral-computed-torque", "integral-slotine-li")
    }


def test_adapting_beats_what_does_not(nominal: dict[str, Run]) -> None:
    fixed, integral, ours = (rms(run, 3)[1:] for run in nominal.values())
    assert (ours <= 0.005 * fixed).all()
    assert (ours <= 0.05 * integral).all()
    first = [np.sqrt(np.square((run.q - run.q_d[:, None])[:1600, 1:]).mean(axis=(0, 2))) for run in nominal.values()]
    assert (first[2] <= 0.08 * first[0]).all()


def test_adapting_reaches_the_floor_of_sampling(nominal: dict[str, Run]) -> None:
    assert rms(nominal["integral-slotine-li"], 3).max() <= 0.02


def test_the_payload_is_weighed_in_one_cycle(nominal: dict[str, Run]) -> None:
    estimates = nominal["integral-slotine-li"].mass[1599]
    np.testing.assert_allclose(estimates, [0.0, 70.0, 350.0], rtol=0.01, atol=0.1)


def test_adapting_beats_an_integral_with_everything_wrong() -> None:
    plant = Plant.loaded(
        DYNAMICS,
        loads([70.0, 350.0], offset=(0.05, 0.08, 0.03)),
        link_scale=np.array([1.05, 0.95, 1.05, 0.95, 1.05]),
        friction_scale=1.5,
        lag=0.03,
        noise=(1e-4, 5e-3),
    )
    integral, ours = (rms(follow(name, plant, 2), 2) for name in ("integral-computed-torque", "integral-slotine-li"))
    assert (ours <= integral / 3.0).all()


@pytest.mark.parametrize("name", NAMES)
def test_environments_know_nothing_of_each_other(name: str) -> None:
    masses = (0.0, 140.0, 350.0)
    together = follow(name, Plant.loaded(DYNAMICS, loads(masses)), period=0.05)
    for row, mass in enumerate(masses):
        alone = follow(name, Plant.loaded(DYNAMICS, loads([mass])), period=0.05)
        np.testing.assert_allclose(together.q[:, row], alone.q[:, 0], rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(together.mass[:, row], alone.mass[:, 0], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_reset_forgets_the_chosen_environments_only(name: str) -> None:
    controller, fresh = make_controller(name, rows=2), make_controller(name, rows=2)
    rng = np.random.default_rng(0)
    samples = rng.normal(0.0, 0.01, (30, 5, 2, N)) + POSTURE
    for sample in samples:
        controller.torque(*sample)
    remembered = controller.parameters[1].copy()
    controller.reset(np.array([True, False]))
    np.testing.assert_array_equal(controller.parameters[1], remembered)
    probe = samples[0]
    after, first = controller.torque(*probe), fresh.torque(*probe)
    np.testing.assert_array_equal(after[0], first[0])
    if name not in ("pd-gravity", "computed-torque"):
        assert np.abs(after[1] - first[1]).max() > 1.0
    controller.reset()
    np.testing.assert_array_equal(controller.torque(*probe), first)


@pytest.mark.parametrize("name", NAMES)
def test_the_memory_is_all_that_a_controller_carries(name: str) -> None:
    used, fresh = make_controller(name, rows=2), make_controller(name, rows=2)
    samples = np.random.default_rng(0).normal(0.0, 0.01, (40, 5, 2, N)) + POSTURE
    for sample in samples[:20]:
        used.torque(*sample)
    memory = used.memory
    kept = memory.copy()
    fresh.memory = memory
    ahead = [used.torque(*sample) for sample in samples[20:]]
    np.testing.assert_array_equal([fresh.torque(*sample) for sample in samples[20:]], ahead)
    np.testing.assert_array_equal(memory, kept)
    used.memory = memory
    np.testing.assert_array_equal([used.torque(*sample) for sample in samples[20:]], ahead)


@pytest.mark.parametrize("name", NAMES)
def test_to_ask_what_is_wanted_teaches_nothing(name: str) -> None:
    controller, limit = make_controller(name), np.array(EXCAVATOR.limits.torque)
    for sample in np.random.default_rng(0).normal(0.0, 0.05, (10, 5, 1, N)) + POSTURE:
        before = controller.memory
        wanted = controller.unlimited_torque(*sample)
        np.testing.assert_array_equal(controller.memory, before)
        np.testing.assert_array_equal(controller.torque(*sample), np.clip(wanted, -limit, limit))


@pytest.mark.parametrize("name", NAMES)
def test_nothing_winds_up_at_the_torque_limit(name: str) -> None:
    """A slew that is stuck a radian and a half off, its torque at the limit, leaves no trace after ten seconds."""
    controller, fresh = make_controller(name), make_controller(name)
    stuck, still = POSTURE - np.array([1.5, 0.0, 0.0, 0.0, 0.0]), np.zeros((1, N))
    for _ in range(2000):
        tau = controller.torque(stuck, still, POSTURE, still, still)
        assert tau[0, 0] == EXCAVATOR.limits.torque[0]
        assert (np.abs(tau) <= np.array(EXCAVATOR.limits.torque)).all()
    after, first = (one.torque(POSTURE, still, POSTURE, still, still) for one in (controller, fresh))
    np.testing.assert_array_equal(after, first)


@pytest.mark.parametrize("name", NAMES)
def test_less_torque_can_be_had_than_the_limits_say(name: str) -> None:
    """Then the least and the largest of the sample are the limits: what they cut off is not learnt from."""
    one, other = make_controller(name), make_controller(name)
    narrow = replace(one.settings, torque_limit=0.3 * one.settings.torque_limit)
    other.settings = narrow
    within = -narrow.torque_limit[None], narrow.torque_limit[None]
    for sample in np.random.default_rng(0).normal(0.0, 0.03, (20, 5, 1, N)) + POSTURE:
        tau = one.torque(*sample, within=within)
        np.testing.assert_array_equal(tau, other.torque(*sample))
        assert (np.abs(tau) <= narrow.torque_limit).all()
    np.testing.assert_array_equal(one.memory, other.memory)


def test_estimates_stay_within_their_bounds() -> None:
    for name in ADAPTIVE:
        run = follow(name, Plant.loaded(DYNAMICS, loads([0.0, 700.0])), period=0.02)
        assert run.mass.min() >= 0.0
        assert run.mass.max() == 500.0


def test_pd_with_gravity_rests_without_error_where_nothing_hangs() -> None:
    model, prior = make_controller("pd-gravity").model, make_controller("pd-gravity").prior
    controller = PDGravity(model, settings_of(make_controller(), 5e-3), prior)
    _, errors = error_from(controller, np.full(N, 0.02), 0.0, 4.0)
    np.testing.assert_allclose(errors[-1], 0.0, atol=1e-6)


def test_a_planar_arm_learns_what_its_hand_holds() -> None:
    arm = replace(PLANAR_3R, gravity=9.81)
    dynamics = planar_chain(arm)
    point = np.eye(10)[:1]
    cycle = Cycle(np.array([[0.2, 0.4, -0.3], [1.0, -0.5, 0.6]]), np.array([1.0, 1.0]))
    settings = ControlSettings(0.005, np.full(3, 8.0), np.array([0.8, 0.3, 0.05]), np.full(3, np.inf))
    prior = PayloadPrior(np.zeros(1), np.zeros(1), np.full(1, 5.0))
    plant = Plant.loaded(dynamics, np.outer([0.5, 1.5], point[0]))
    controller = IntegralSlotineLi(PayloadModel(dynamics, point), settings, prior, np.array([20.0]), rows=2)
    run = simulate(controller, plant, cycle, 3)
    np.testing.assert_allclose(controller.mass_estimate, [0.5, 1.5], rtol=0.02)
    assert rms(run, 3).max() < 0.1


def test_boom_arm_and_bucket_alone_weigh_their_load() -> None:
    masses = np.array([0.0, 140.0, 350.0])
    plant = Plant.loaded(planar_dynamics(), np.array([planar_payload(mass) for mass in masses]))
    cycle = replace(WORK_CYCLE, postures=WORK_CYCLE.postures[:, JOINTS])
    runs = {
        name: simulate(make_controller(name, planar=True, rows=3), plant, cycle, 2)
        for name in ("computed-torque", "integral-computed-torque", "integral-slotine-li")
    }
    np.testing.assert_allclose(runs["integral-slotine-li"].mass[-1], masses, rtol=0.01, atol=1.0)
    fixed, integral, ours = (rms(run, 2) for run in runs.values())
    assert fixed[0] < 0.1  # an empty bucket is what it takes it for
    assert (ours[1:] < 0.05 * integral[1:]).all()
    assert (integral[1:] < 0.15 * fixed[1:]).all()


def test_the_work_cycle_is_smooth_and_comes_back() -> None:
    t, step = np.linspace(0.0, 16.0, 3201), 1e-5
    q, qd, qdd = WORK_CYCLE.sample(t)
    (q_ahead, qd_ahead, _), (q_behind, qd_behind, _) = WORK_CYCLE.sample(t + step), WORK_CYCLE.sample(t - step)
    np.testing.assert_allclose(qd, (q_ahead - q_behind) / (2.0 * step), atol=1e-7)
    np.testing.assert_allclose(qdd, (qd_ahead - qd_behind) / (2.0 * step), atol=1e-4)
    np.testing.assert_allclose(q[:1600], q[1600:3200], atol=1e-12)
    for time, posture in zip((0.0, 2.0, 5.0), WORK_CYCLE.postures, strict=True):
        np.testing.assert_allclose(WORK_CYCLE.sample(np.array([time]))[0][0], posture)


def test_a_loaded_work_cycle_is_within_the_machines_limits() -> None:
    q, qd, qdd = WORK_CYCLE.sample(np.linspace(0.0, 8.0, 801))
    tau = DYNAMICS.torque(q, qd, qd, qdd, np.tile(payload(350.0), (len(q), 1)))
    assert (np.abs(tau) / np.array(EXCAVATOR.limits.torque)).max() == pytest.approx(0.95, abs=0.01)
    assert (np.abs(qd) <= np.array(EXCAVATOR.limits.velocity)).all()
    assert (np.abs(q) <= np.array(EXCAVATOR.limits.angle)).all()


@pytest.mark.parametrize("outside", [0.0, 700.0])
@pytest.mark.parametrize("lag", [0.0, 0.02])
def test_the_plant_moves_as_its_equations_say(lag: float, outside: float) -> None:
    load, period = payload(140.0)[None], 0.02
    plant = Plant.loaded(DYNAMICS, load, friction_scale=1.3, lag=lag)
    friction = np.array([1.0, 1.3])
    true = replace(DYNAMICS, drives=DYNAMICS.drives * friction)
    q, qd = POSTURE.copy(), np.full((1, N), 0.2)
    held = DYNAMICS.torque(q, qd, qd, np.full((1, N), 0.5))
    command = held + 0.1 * np.array(EXCAVATOR.limits.torque)

    def rates(t: float, y: Array) -> Array:
        tau = command + (held - command) * np.exp(-t / lag) if lag else command
        return np.concatenate([y[N:], acceleration(true, y[None, :N], y[None, N:], tau + outside, load)[0]])

    y = solve_ivp(rates, (0.0, period), np.concatenate([q[0], qd[0]]), rtol=1e-12, atol=1e-13).y[:, -1]
    applied = held.copy()
    plant.advance(q, qd, applied, command, period, outside)
    np.testing.assert_allclose(np.concatenate([q[0], qd[0]]), y, atol=1e-9)
    left = np.exp(-period / lag) if lag else 0.0
    np.testing.assert_allclose(applied, command + left * (held - command))


def test_noise_is_measured_and_not_real() -> None:
    plain, noisy = (
        follow("computed-torque", Plant.loaded(DYNAMICS, loads([0.0]), noise=noise), period=0.05)
        for noise in ((0.0, 0.0), (1e-4, 5e-3))
    )
    assert 0.0 < np.abs(noisy.q - plain.q).max() < 0.02


def refused(match: str, call: Callable[[], object]) -> None:
    with pytest.raises(ValueError, match=match):
        call()


def test_what_cannot_be_is_refused() -> None:
    controller = make_controller()
    model, settings, prior = controller.model, controller.settings, controller.prior
    refused("'pid' must be one of 'pd-gravity', ", lambda: make_controller("pid"))
    refused("bandwidth has shape", lambda: PDGravity(model, replace(settings, bandwidth=np.ones(3)), prior))
    refused("period -1", lambda: replace(settings, period=-1.0))
    refused("must lie within", lambda: replace(prior, initial=prior.upper + 1.0))
    refused("give \\(4,\\)", lambda: PDGravity(model, settings, PayloadPrior(*np.zeros((3, 1)))))
    refused("memory has shape \\(2, 9\\)", lambda: setattr(controller, "memory", np.zeros((2, 9))))
    refused("'pid' must be", lambda: make_controller("pid", planar=True))
    refused("gain", lambda: SlotineLi(model, settings, prior, np.ones(1)))
    refused(
        "2 rows, the plant 1",
        lambda: simulate(make_controller(rows=2), Plant.loaded(DYNAMICS, loads([0.0])), WORK_CYCLE, 1),
    )
    refused("does not divide", lambda: follow("pd-gravity", Plant.loaded(DYNAMICS, loads([0.0])), period=0.03))
    refused("as many durations as postures", lambda: Cycle(np.zeros((2, 5)), np.ones(3)))
    refused("must be positive", lambda: Cycle(np.zeros((2, 5)), np.zeros(2)))
