"""The planar arm as a model for controllers, and the payload estimator, against the arm, closed forms, simulation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planners import PLANAR_3R, SCARA_1M, Arm
from planners.control import (
    ArmModel,
    ControlSettings,
    LeastSquaresSums,
    PayloadEstimator,
    PayloadPrior,
    PlanarArmModel,
    SlotineLi,
)
from planners.excavator.plane import planar_model
from planners.typing import Array

UPRIGHT = replace(PLANAR_3R, gravity=9.81)
every_arm = pytest.mark.parametrize("arm", [SCARA_1M, UPRIGHT], ids=lambda arm: arm.name)


def states(arm: Arm, rows: int = 50) -> list[Array]:
    """Angles, velocities and accelerations, ``(batch, n)`` each."""
    generator = np.random.default_rng(0)
    return [scale * generator.standard_normal((rows, arm.n_joints)) for scale in (2.0, 3.0, 5.0)]


@every_arm
def test_it_is_the_arm_with_the_payload(arm: Arm) -> None:
    model: ArmModel = PlanarArmModel(arm)
    q, qd, qdd = states(arm)
    for mass in (0.0, 0.3, 2.0):
        loaded, parameters = arm.with_payload(mass), np.full((len(q), 1), mass)
        np.testing.assert_allclose(
            model.torque(q, qd, qd, qdd, parameters), loaded.inverse_dynamics(q, qd, qdd), rtol=1e-11, atol=1e-11
        )
        np.testing.assert_allclose(model.mass_matrix(q, parameters), loaded.mass_matrix(q), rtol=1e-12, atol=1e-12)


@every_arm
def test_the_regressor_is_the_derivative_of_inverse_dynamics_by_the_mass(arm: Arm) -> None:
    q, qd, qdd = states(arm)
    more, less = (arm.with_payload(0.5 + step).inverse_dynamics(q, qd, qdd) for step in (1e-4, -1e-4))
    regressor = PlanarArmModel(arm).regressor(q, qd, qd, qdd)
    np.testing.assert_allclose(regressor[..., 0], (more - less) / 2e-4, rtol=1e-8, atol=1e-8)


@every_arm
def test_what_velocity_does_is_skew(arm: Arm) -> None:
    """``x^T (dM/dt - 2 C) x = 0`` for every x, with dM/dt by finite differences along the motion."""
    model, (q, qd, x) = PlanarArmModel(arm), states(arm)
    mass, step = np.full((len(q), 1), 0.7), 1e-6
    change = (model.mass_matrix(q + step * qd, mass) - model.mass_matrix(q - step * qd, mass)) / (2.0 * step)
    still = np.zeros_like(q)
    coriolis = model.torque(q, qd, x, still, mass) - model.torque(q, still, still, still, mass)
    power = np.einsum("li,lij,lj->l", x, change, x) - 2.0 * np.einsum("li,li->l", x, coriolis)
    scale = np.abs(np.einsum("li,li->l", x, coriolis)).max()
    np.testing.assert_allclose(power / scale, 0.0, atol=1e-8)


def test_a_controller_learns_the_payload_of_a_planar_arm() -> None:
    arm, mass, period = UPRIGHT, 0.3, 0.002
    settings = ControlSettings(period, np.full(3, 8.0), np.array([0.6, 0.4, 0.05]), np.array(arm.limits.torque))
    prior = PayloadPrior(np.zeros(1), np.zeros(1), np.full(1, 2.0))
    controller = SlotineLi(PlanarArmModel(arm), settings, prior, gain=np.array([2.0]))
    real, t = arm.with_payload(mass), 0.0
    amplitude, rate = np.array([[0.4, -0.5, 0.6]]), np.array([[2.0, 3.0, 4.0]])
    q, qd = np.array([[-1.2, 0.3, 0.2]]), amplitude * rate
    centre = q.copy()
    for _ in range(2000):
        wanted = (
            centre + amplitude * np.sin(rate * t),
            amplitude * rate * np.cos(rate * t),
            -amplitude * rate**2 * np.sin(rate * t),
        )
        tau = controller.torque(q, qd, *wanted)
        qd = qd + period * real.forward_dynamics(q, qd, tau)
        q, t = q + period * qd, t + period
    assert controller.mass_estimate[0] == pytest.approx(mass, rel=0.03)
    assert np.abs(wanted[0] + period * wanted[1] - q).max() < 0.01


class TestPayloadEstimator:
    """A payload on an arm driven by random torques."""

    period = 0.01

    def estimates(
        self, arm: Arm, mass: float, steps: int, noise: float = 0.0, cutoff: float = 2.0
    ) -> list[LeastSquaresSums]:
        generator = np.random.default_rng(1)
        estimator = PayloadEstimator(PlanarArmModel(arm), np.array(arm.limits.torque), self.period, cutoff)
        sums, real = LeastSquaresSums.before(1, arm.n_joints), arm.with_payload(mass)
        q, qd, error = np.ones((1, arm.n_joints)), np.zeros((1, arm.n_joints)), np.zeros((1, arm.n_joints))
        estimates = []
        for step in range(steps):
            if step % 20 == 0:
                tau = 0.3 * np.array(arm.limits.torque) * generator.uniform(-1.0, 1.0, (1, arm.n_joints))
            before = qd + error
            for _ in range(20):  # much finer than the period over which the estimator takes the state as constant
                qd = qd + self.period / 20 * real.forward_dynamics(q, qd, tau)
                q = q + self.period / 20 * qd
            error = noise * generator.standard_normal(q.shape)
            sums = estimator.update(sums, q, qd + error, (qd + error - before) / self.period, tau)
            estimates.append(sums)
        return estimates

    @pytest.mark.parametrize("mass", [0.0, 0.1, 0.3])
    def test_the_mass_is_estimated_after_one_period(self, mass: float) -> None:
        estimates = self.estimates(SCARA_1M, mass, 50)
        assert estimates[0].mass[0] == pytest.approx(mass, abs=1e-3)
        assert estimates[-1].mass[0] == pytest.approx(mass, abs=1e-3)

    def test_the_filter_removes_the_bias_of_noise(self) -> None:
        filtered = self.estimates(SCARA_1M, 0.3, 400, noise=1e-3)[-1].mass[0]
        unfiltered = self.estimates(SCARA_1M, 0.3, 400, noise=1e-3, cutoff=1e6)[-1].mass[0]
        assert filtered == pytest.approx(0.3, abs=0.02)
        assert unfiltered < 0.1

    def test_an_arm_at_rest_keeps_the_estimate_of_zero(self) -> None:
        estimator = PayloadEstimator(PlanarArmModel(SCARA_1M), np.array(SCARA_1M.limits.torque), self.period)
        still = np.zeros((1, 2))
        assert estimator.update(LeastSquaresSums.before(1, 2), still + 0.4, still, still, still).mass[0] == 0.0

    def test_no_mass_is_negative(self) -> None:
        light = replace(SCARA_1M, masses=(1.0, 0.5), coms=(), inertias=())
        estimator = PayloadEstimator(PlanarArmModel(SCARA_1M), np.array(SCARA_1M.limits.torque), self.period)
        q, qd, qdd = states(SCARA_1M, 1)
        qd *= 0.1
        middle = qd - 0.5 * self.period * qdd
        tau = light.inverse_dynamics(q, middle, qdd)
        sums = estimator.update(LeastSquaresSums.before(1, 2), q, qd, qdd, tau)
        assert sums.correlation[0] < 0.0
        assert sums.mass[0] == 0.0

    def test_several_parameters_are_refused(self) -> None:
        with pytest.raises(ValueError, match="parameters; give one with the mass alone"):
            PayloadEstimator(planar_model(moments=True), np.ones(3), self.period)
