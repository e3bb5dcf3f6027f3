"""Control laws against the equations of motion, integrated by scipy."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from planners import PLANAR_3R, SCARA_1M, Arm, JointLimits
from planners.control import Gains, held_torque, tracking_acceleration, within_torque
from planners.control.joint_limits import (
    RANGE_MARGIN,
    project_off_limit,
    scale_into_torque,
    stoppable_velocities,
    worst_excess,
)
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
    assert (gains.position, gains.velocity) == pytest.approx((64.0, 16.0))
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


@settings(deadline=None)
@given(values=st.tuples(*4 * [st.floats(-1.0, 1.0)]))
def test_a_stoppable_velocity_lets_the_joint_stop_in_its_range(values: tuple[float, ...]) -> None:
    q, qd, end, braking, period = 2.0 * values[0], 3.0 * values[1], 2.5, 9.0 + 4.0 * values[2], 0.02
    for direction, v in zip((-1.0, 1.0), stoppable_velocities(q, qd, end, braking, period), strict=True):
        stop = q + 0.5 * (qd + v) * period + 0.5 * v * abs(v) / braking
        assert direction * stop == pytest.approx(end - RANGE_MARGIN) or direction * v <= 0.0


@settings(max_examples=30, deadline=None)
@given(values=states)
def test_scaled_accelerations_keep_the_torque_limits(values: list[float]) -> None:
    q, qd, qdd = np.array(values).reshape(3, 3) * [[1.0], [0.5], [20.0]]
    arm, tau, scaled = PLANAR_3R, np.empty(3), qdd.copy()
    limit = np.array(arm.limits.torque)
    scale_into_torque(*arm.chain_constants, q, qd, 0.005, limit, 0.98, 8, scaled, tau)
    assert np.all(np.abs(tau) <= limit)
    assert np.linalg.matrix_rank(np.stack([scaled, qdd]), tol=1e-9) <= 1
    assert np.dot(scaled, qdd) >= 0.0


@pytest.mark.parametrize("unit", [1.0, 1e-170, 1e-300, 1e170])
def test_projection_takes_the_excess_off_one_joint(unit: float) -> None:
    mass, qdd = unit * PLANAR_3R.mass_matrix([0.3, 1.0, -0.4]), np.array([30.0, -10.0, 20.0])
    limit, free = 0.9 * np.abs(mass @ qdd), np.full(3, np.inf)
    joint, excess = worst_excess(mass @ qdd, limit)
    assert excess == pytest.approx((mass @ qdd)[joint] * 0.1)
    project_off_limit(mass[joint], excess, -free, free, qdd)
    assert abs(mass[joint] @ qdd) == pytest.approx(limit[joint])
    assert worst_excess(mass @ qdd, np.abs(mass @ qdd))[1] == 0.0


def test_projection_leaves_a_joint_alone_that_no_acceleration_loads() -> None:
    qdd, free = np.array([3.0, -1.0]), np.full(2, np.inf)
    project_off_limit(np.zeros(2), 5.0, -free, free, qdd)
    np.testing.assert_array_equal(qdd, [3.0, -1.0])


@pytest.mark.parametrize(("gravity", "limit"), [(0.0, (40.0, 15.0)), (9.81, 60.0), (9.81, 15.0), (-9.81, 15.0)])
@pytest.mark.parametrize("period", [0.005, 0.05])
def test_torques_of_scaled_accelerations_fit_or_exceed_no_limit_by_more_than_at_rest(
    gravity: float, limit: Any, period: float
) -> None:
    arm = Arm("upright", [1.0, 0.7], [2.0, 1.0], gravity=gravity, limits=JointLimits(torque=limit))
    random = np.random.default_rng(0)
    q, qd, qdd = random.uniform(-1.0, 1.0, (3, 500, 2)) * np.array([3.0, 4.0, 100.0])[:, None, None]
    scaled = within_torque(arm, q, qd, qdd, period)
    most, zero = arm.limits.array("torque"), np.abs(held_torque(arm, q, qd, 0.0 * qdd, period))
    assert (np.abs(held_torque(arm, q, qd, scaled, period)) <= np.maximum(most, zero) * (1.0 + 1e-6)).all()
    assert (scaled * qdd >= 0.0).all()
    assert (np.abs(scaled) <= np.abs(qdd)).all()
