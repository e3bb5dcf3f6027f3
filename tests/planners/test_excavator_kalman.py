"""The Kalman filter of payload, friction and state, on a machine integrated by SciPy."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from planners.excavator.kalman import FilterSettings, KalmanComputedTorque
from planners.excavator.plane import planar_dynamics, planar_payload
from planners.typing import Array

PERIOD = 0.02
MASS, SHIFT, FRICTION = 240.0, (-0.06, 0.05), 1.4
SETTINGS = FilterSettings()


def reference(time: float) -> tuple[Array, Array, Array]:
    """A motion through typical postures, ``(1, n)`` each: angle, velocity, acceleration."""
    middle, swing, rate = np.array([[0.4, -1.3, 0.4]]), np.array([[0.3, 0.4, 0.5]]), np.array([[1.1, 1.5, 1.9]])
    wave, slope = np.cos(rate * time) - 1.0, np.sin(rate * time)
    return middle + swing * wave, -swing * rate * slope, -swing * rate**2 * np.cos(rate * time)


def accelerate(state: Array, torque: Array, mass: float, heavier: Array) -> Array:
    """The machine with its payload and friction, by matrices of `ChainDynamics`."""
    dynamics, (q, qd) = planar_dynamics(), state.reshape(2, 1, 3)
    dynamics = replace(dynamics, inertia=dynamics.inertia * (1.0 + heavier[:, None]))
    load = planar_payload(mass, offset=SHIFT)[None]
    bias = dynamics.torque(q, qd, qd, np.zeros((1, 3)), load) + (FRICTION - 1.0) * dynamics.drives[:, 1] * qd
    rate = np.linalg.solve(dynamics.mass_matrix(q, load)[0], torque - bias[0])
    return np.concatenate([qd[0], rate])


def track(
    controller: KalmanComputedTorque,
    periods: int,
    noise: tuple[float, float],
    masses: Any = lambda step: MASS,
    *,
    heavier: tuple[float, float, float] = (0.0, 0.0, 0.0),
    late: float = 0.0,
) -> dict[str, Array]:
    """Track the reference under a controller whose drives have its lag; what it knew and how far it was off.

    The links are ``heavier`` by these shares, and a command arrives ``late``, s, by at most a period.
    """
    rng, lag = np.random.default_rng(5), controller.settings.lag
    state = np.concatenate([reference(0.0)[0][0], np.zeros(3)])
    drive = planar_dynamics().torque(state[None, :3], *3 * [np.zeros((1, 3))])[0]
    known, error, before = [], [], drive
    for step in range(periods):
        measured = state.reshape(2, 1, 3) + np.array(noise)[:, None, None] * rng.standard_normal((2, 1, 3))
        command = controller.torque(*measured, *reference(PERIOD * step))[0]

        for torque, duration in ((before, late), (command, PERIOD - late)):

            def slope(time: float, values: Array, torque: Array = torque, step: int = step) -> Array:
                force = values[6:] if lag else torque
                rates = accelerate(values[:6], force, masses(step), np.array(heavier))
                return np.concatenate([rates, (torque - force) / (lag or 1.0)])

            if duration > 0.0:
                solved = solve_ivp(slope, (0.0, duration), np.concatenate([state, drive]), rtol=1e-7, atol=1e-9)
                state, drive = solved.y[:6, -1], solved.y[6:, -1]
        before = command
        known.append(controller.memory[0, : controller.settings.size])
        error.append(np.abs(state[:3] - reference(PERIOD * (step + 1))[0][0]).max())
    return {"known": np.array(known), "error": np.array(error), "memory": controller.memory[0]}


@pytest.mark.parametrize("lag", [0.0, 0.03])
def test_payload_friction_and_motion_are_found(lag: float) -> None:
    controller = KalmanComputedTorque(replace(SETTINGS, lag=lag))
    found = track(controller, 200, SETTINGS.noise)
    mass, *shift, friction = found["known"][-1, :4]
    assert controller.mass_estimate == mass
    assert mass == pytest.approx(MASS, abs=1.0)
    np.testing.assert_allclose(shift, SHIFT, atol=0.01)
    assert np.exp(friction) == pytest.approx(FRICTION, rel=0.02)
    assert found["error"][100:].max() < 1e-3


def test_link_masses_and_latency_are_found() -> None:
    heavier, late = (0.08, -0.06, 0.05), 0.013
    settings = replace(SETTINGS, lag=0.03, masses=0.1, latency=(0.01, 0.006, 0.02))
    found = track(KalmanComputedTorque(settings), 300, SETTINGS.noise, heavier=heavier, late=late)
    x, covariance = found["known"][-1], found["memory"][14 : 14 * 15].reshape(14, 14)
    assert x[13] == pytest.approx(late, abs=5e-4)
    np.testing.assert_allclose(x[10:12], heavier[:2], atol=0.02)
    # Four squared normalised errors: 99.99 % of samples of a consistent filter are below 23.5.
    off = x[10:] - [*heavier, late]
    assert off @ np.linalg.solve(covariance[10:, 10:], off) < 23.5
    # The torques show the masses of boom and arm; that of the bucket they hardly show beside its payload.
    assert np.sqrt(covariance.diagonal()[10:12]).max() < 0.3 * settings.masses
    assert found["error"][100:].max() < 1e-3


def test_a_nominal_machine_that_is_uncertain_is_followed_as_well() -> None:
    uncertain = replace(SETTINGS, masses=0.1, latency=(0.01, 0.006, 0.02))
    found = track(KalmanComputedTorque(uncertain), 120, SETTINGS.noise)
    assert found["error"][80:].max() < 1e-3
    np.testing.assert_allclose(found["known"][-1, 10:12], 0.0, atol=0.1)
    assert found["known"][-1, 13] < 5e-4


def test_a_known_latency_costs_no_accuracy() -> None:
    late = replace(SETTINGS, latency=(PERIOD, 0.0, PERIOD))
    found = track(KalmanComputedTorque(late), 120, SETTINGS.noise, late=PERIOD)
    np.testing.assert_array_equal(found["known"][:, 13], PERIOD)
    assert found["known"][-1, 0] == pytest.approx(MASS, abs=2.0)
    assert found["error"][80:].max() < 1e-3


def test_the_filter_knows_how_well_it_knows() -> None:
    found = track(KalmanComputedTorque(SETTINGS), 250, SETTINGS.noise)
    truth = [MASS, *SHIFT, np.log(FRICTION)]
    covariance = found["memory"][10:110].reshape(10, 10)
    np.testing.assert_allclose(covariance, covariance.T, atol=1e-9 * covariance.max())
    assert np.linalg.eigvalsh(covariance).min() > -1e-12
    off = found["known"][-1, :4] - truth
    # Four squared normalised errors: 99.99 % of samples of a consistent filter are below 23.5.
    assert off @ np.linalg.solve(covariance[:4, :4], off) < 23.5


def test_without_noise_the_motion_is_followed_exactly() -> None:
    found = track(KalmanComputedTorque(replace(SETTINGS, noise=(0.0, 0.0), unmodelled=1e-4)), 150, (0.0, 0.0))
    np.testing.assert_allclose(found["known"][-1, :4], [MASS, *SHIFT, np.log(FRICTION)], rtol=1e-3)


def test_a_payload_that_is_dropped_and_picked_up_is_weighed_again() -> None:
    controller = KalmanComputedTorque(SETTINGS)
    found = track(controller, 240, SETTINGS.noise, lambda step: 0.0 if 80 <= step < 160 else MASS)
    np.testing.assert_allclose(found["known"][[79, 159, 239], 0], [MASS, 0.0, MASS], atol=3.0)
    # The friction does not change with the payload, and is not forgotten with it.
    assert np.abs(found["known"][80:, 3] - np.log(FRICTION)).max() < 0.1


def test_a_payload_that_is_set_is_certain() -> None:
    controller = KalmanComputedTorque(SETTINGS)
    q, qd, qdd = reference(0.0)
    controller.torque(q, qd, q, qd, qdd)
    controller.set_payload(np.array([MASS]), np.array([SHIFT]), np.array([FRICTION]))
    controller.torque(q, qd, q, qd, qdd)
    np.testing.assert_array_equal(controller.memory[0, :4], [MASS, *SHIFT, np.log(FRICTION)])


def test_rows_and_resets_are_independent() -> None:
    (q, qd, qdd), rng = reference(0.3), np.random.default_rng(0)
    measured = [(q + 1e-3 * rng.standard_normal((3, 3)), qd + 1e-2 * rng.standard_normal((3, 3))) for _ in range(6)]
    wanted = [np.repeat(one, 3, axis=0) for one in (q, qd, qdd)]
    together, alone = KalmanComputedTorque(SETTINGS, rows=3), KalmanComputedTorque(SETTINGS)
    for step, sample in enumerate(measured):
        if step == 3:
            together.reset(np.array([False, True, False]))
            alone.reset()
        batch = together.torque(*sample, *wanted)
        one = alone.torque(*(row[1:2] for row in sample), q, qd, qdd)
        np.testing.assert_array_equal(batch[1:2], one)
    np.testing.assert_array_equal(together.memory[1:2], alone.memory)


def test_torques_keep_the_limits_that_are_given() -> None:
    controller = KalmanComputedTorque(SETTINGS)
    q, qd, qdd = reference(0.0)
    far = controller.torque(q, qd, q + 2.0, qd, qdd)
    assert np.abs(far).max() <= 45e3
    least, most = np.full((1, 3), -10.0), np.full((1, 3), 20.0)
    assert set(controller.torque(q, qd, q + 2.0, qd, qdd, within=(least, most))[0]) <= {-10.0, 20.0}


def test_a_memory_of_another_shape_is_refused() -> None:
    controller = KalmanComputedTorque(SETTINGS, rows=2)
    with pytest.raises(ValueError, match=r"memory has shape \(3,\); this controller's has \(2, 119\)"):
        controller.memory = np.zeros(3)
