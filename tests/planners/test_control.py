"""Control laws against the equations of motion, integrated by scipy."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from planners import PLANAR_3R, SCARA_1M, Arm
from planners.control import Gains, computed_torque, held_torque, tracking_acceleration, within_torque
from planners.typing import Array

HEAVY = replace(PLANAR_3R, gravity=9.81)


def after(arm: Arm, q: Array, qd: Array, tau: Array, period: float) -> tuple[Array, Array]:
    """The state after torques held for a period."""
    n = arm.n_joints

    def rhs(_t: float, y: Array) -> Array:
        return np.concatenate([y[n:], arm.forward_dynamics(y[:n], y[n:], tau)])

    end = solve_ivp(rhs, (0.0, period), np.concatenate([q, qd]), rtol=1e-11, atol=1e-12).y[:, -1]
    return end[:n], end[n:]


states: Any = st.lists(st.floats(-2.0, 2.0), min_size=9, max_size=9)


@settings(max_examples=30, deadline=None)
@given(values=states)
def test_held_torque_gives_the_mean_acceleration(values: list[float]) -> None:
    q, qd, qdd = np.array(values).reshape(3, 3) * [[1.0], [2.0], [10.0]]
    period = 0.005
    tau = held_torque(HEAVY, q[None], qd[None], qdd[None], period)[0]
    _, reached = after(HEAVY, q, qd, tau, period)
    assert (reached - qd) / period == pytest.approx(qdd, abs=2e-3)


def test_held_torque_is_third_order_in_the_period() -> None:
    q, qd, qdd = np.array([0.4, -1.2, 0.8]), np.array([2.0, -5.0, 6.0]), np.array([30.0, -60.0, 90.0])
    errors = []
    for period in (0.02, 0.01):
        tau = held_torque(HEAVY, q[None], qd[None], qdd[None], period)[0]
        errors.append(np.abs((after(HEAVY, q, qd, tau, period)[1] - qd) / period - qdd).max())
    assert errors[0] / errors[1] >= 6.0


def test_computed_torque_makes_the_error_a_damped_oscillator() -> None:
    """From any start the error follows its own linear equation exactly: critically damped at 8 rad/s."""
    arm, goal, gains = HEAVY, np.array([0.5, -0.3, 0.2]), Gains(64.0, 16.0)
    still = np.zeros(3)

    def rhs(_t: float, y: Array) -> Array:
        tau = computed_torque(arm, y[:3], y[3:], (goal, still, still), gains)
        return np.concatenate([y[3:], arm.forward_dynamics(y[:3], y[3:], tau)])

    t = np.linspace(0.0, 1.0, 11)
    y = solve_ivp(rhs, (0.0, 1.0), np.zeros(6), t_eval=t, rtol=1e-10, atol=1e-12).y
    expected = goal[:, None] * (1.0 - (1.0 + 8.0 * t) * np.exp(-8.0 * t))
    np.testing.assert_allclose(y[:3], expected, atol=1e-7)


def test_tracking_acceleration_reaches_the_next_velocity() -> None:
    now = (np.array([[0.1, 0.2]]), np.array([[0.3, -0.1]]))
    ahead = (np.array([[0.106, 0.198]]), np.array([[0.31, -0.12]]))
    qdd = tracking_acceleration(*now, now, ahead, 0.02)
    assert now[1] + 0.02 * qdd == pytest.approx(ahead[1])


def test_tracking_acceleration_feeds_errors_back() -> None:
    zero = np.zeros((1, 2))
    qdd = tracking_acceleration(zero + 0.01, zero - 0.02, (zero, zero), (zero, zero), 0.02, Gains(100.0, 20.0))
    assert qdd == pytest.approx(np.full((1, 2), -100.0 * 0.01 + 20.0 * 0.02))


def test_sampled_gains_are_critically_damped() -> None:
    gains = Gains.sampled(0.02)
    assert gains == Gains(pytest.approx(64.0), pytest.approx(16.0))
    fast = Gains.sampled(0.005)
    assert fast.velocity**2 == pytest.approx(4.0 * fast.position)


@settings(max_examples=30, deadline=None)
@given(values=states)
def test_within_torque_fits_the_limits_and_keeps_the_direction(values: list[float]) -> None:
    q, qd, qdd = np.array(values)[:6].reshape(3, 2) * [[1.0], [0.1], [1.0]]
    fitted = within_torque(SCARA_1M, q[None], qd[None], qdd[None], 0.02)
    tau = held_torque(SCARA_1M, q[None], qd[None], fitted, 0.02)
    assert (np.abs(tau) <= np.array(SCARA_1M.limits.torque) * 1.01 + 1e-9).all()
    share = fitted[0] @ qdd / max(qdd @ qdd, 1e-300)
    assert fitted[0] == pytest.approx(share * qdd, abs=1e-12)
    assert -1e-12 <= share <= 1.0 + 1e-12


def test_within_torque_takes_the_smallest_acceleration() -> None:
    qdd = np.array([[0.0, 2.2250738585e-313]])
    np.testing.assert_array_equal(within_torque(SCARA_1M, np.zeros((1, 2)), np.zeros((1, 2)), qdd, 0.02), qdd)


def test_within_torque_leaves_what_fits() -> None:
    q, qd, qdd = np.array([[0.3, 0.5]]), np.zeros((1, 2)), np.array([[0.01, -0.02]])
    np.testing.assert_array_equal(within_torque(SCARA_1M, q, qd, qdd, 0.02), qdd)
