"""What the classes of `planners.control` are given: lists are arrays, and what cannot be is refused by name."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from planners import SCARA_1M, JointLimits, load_arm
from planners.control import (
    ControlSettings,
    Gains,
    LeastSquaresSums,
    ObserverSettings,
    PayloadEstimator,
    PayloadPrior,
    PDGravity,
    PlanarArmModel,
    SlotineLi,
    held_torque,
    tracking_acceleration,
)
from planners.control.point_filter import WIDTH, PointFilter
from planners.excavator import inverse_kinematics

MODEL, ONE = PlanarArmModel(SCARA_1M), np.zeros((1, 2))
SETTINGS = ControlSettings(0.02, [8, 8], [0.5, 0.1], [10.0, math.inf])  # type: ignore[arg-type]
PRIOR = PayloadPrior([0], [0], [2.0])  # type: ignore[arg-type]
LAW = PDGravity(MODEL, SETTINGS, PRIOR)
SUMS = LeastSquaresSums.before(1, 2)
LIMIT = np.array([10.0, 5.0])


def control_settings(**given: object) -> ControlSettings:
    return ControlSettings(**{**vars(SETTINGS), **given})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("named", "call"),
    [
        ("period", lambda: control_settings(period=np.nan)),
        ("period", lambda: control_settings(period="1")),
        ("bandwidth", lambda: control_settings(bandwidth=[8.0, np.inf])),
        ("inertia", lambda: control_settings(inertia=[True, 1.0])),
        ("torque_limit", lambda: control_settings(torque_limit=[np.nan, 1.0])),
        ("initial", lambda: PayloadPrior([np.nan], [0.0], [1.0])),  # type: ignore[arg-type]
        ("initial", lambda: PayloadPrior([-np.inf], [-np.inf], [1.0])),  # type: ignore[arg-type]
        ("rows", lambda: PDGravity(MODEL, SETTINGS, PRIOR, rows=0)),
        ("rows", lambda: PDGravity(MODEL, SETTINGS, PRIOR, rows=1.0)),  # type: ignore[arg-type]
        ("rows", lambda: LAW.reset(np.array([1]))),  # type: ignore[arg-type]
        ("gain", lambda: SlotineLi(MODEL, SETTINGS, PRIOR, np.array([np.inf]))),
        ("q has shape", lambda: LAW.torque(np.zeros(2), ONE, ONE, ONE, ONE)),
        ("qdd_d has shape", lambda: LAW.torque(ONE, ONE, ONE, ONE, np.zeros((2, 2)))),
        ("q has shape", lambda: LAW.unlimited_torque(*5 * [np.zeros((2, 2))])),
        ("within", lambda: LAW.torque(ONE, ONE, ONE, ONE, ONE, within=(LIMIT, -LIMIT))),
        ("within", lambda: LAW.torque(ONE, ONE, ONE, ONE, ONE, within=(-LIMIT, np.nan * LIMIT))),
        ("position gain", lambda: Gains(-1.0)),
        ("velocity gain", lambda: Gains(velocity=np.inf)),
        ("period", lambda: Gains.sampled(0.0)),
        ("period", lambda: held_torque(SCARA_1M, ONE, ONE, ONE, -0.02)),
        ("period", lambda: tracking_acceleration(ONE, ONE, (ONE, ONE), (ONE, ONE), 0.0)),
        ("velocities ahead", lambda: tracking_acceleration(ONE, ONE, (ONE, ONE), (ONE, np.zeros(2)), 0.02)),
        ("period", lambda: ObserverSettings(0.0, 10, 1.0)),
        ("steps", lambda: ObserverSettings(0.02, 10.0, 1.0)),  # type: ignore[arg-type]
        ("late", lambda: ObserverSettings(0.02, 10, 1.0, late=(2, 1))),
        ("late", lambda: ObserverSettings(0.02, 10, 1.0, late=(-1, 1))),
        ("noise", lambda: ObserverSettings(0.02, 10, 1.0, noise=(1e-3, np.nan))),
        ("payload", lambda: ObserverSettings(0.02, 10, 1.0, payload=-1.0)),
        ("friction", lambda: ObserverSettings(0.02, 10, 1.0, friction=(0.1,))),  # type: ignore[arg-type]
        ("noise of positions", lambda: PointFilter(0.02, (0.0, 0.1))),
        ("manoeuvre", lambda: PointFilter(0.02, (0.1, 0.1), np.nan)),
        ("starts", lambda: PointFilter(0.02, (0.1, 0.1)).update(np.zeros((1, 1, WIDTH)), np.ones(1), ONE, ONE, 0.0)),
        ("torque_limit", lambda: PayloadEstimator(MODEL, np.ones(3), 0.02)),
        ("torque_limit", lambda: PayloadEstimator(MODEL, -LIMIT, 0.02)),
        ("cutoff", lambda: PayloadEstimator(MODEL, LIMIT, 0.02, cutoff=0.0)),
        ("tau has shape", lambda: PayloadEstimator(MODEL, LIMIT, 0.02).update(SUMS, ONE, ONE, ONE, LIMIT)),
        ("rows", lambda: LeastSquaresSums.before(2, 2).restarted(np.array([1, 0]))),  # type: ignore[arg-type]
        ("factor", lambda: JointLimits(torque=(1.0, math.inf)).scaled(math.inf)),
        ("factor", lambda: JointLimits(torque=(1.0, math.inf)).scaled(0.0)),
        ("lengths_m", lambda: load_arm({"lengths_m": None, "masses_kg": [1.0]})),
        ("target", lambda: inverse_kinematics(np.full((2, 3), 1.0), (0.0, 0.0, -1.0)).explain()),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_by_name(named: str, call: Callable[[], object]) -> None:
    with pytest.raises(ValueError, match=f"^(a |arm has no )?{named}"):
        call()


def test_null_in_a_file_of_an_arm_is_as_good_as_left_out() -> None:
    plain = {"lengths_m": [0.4, 0.3], "masses_kg": [1.0, 2.0]}
    null = dict.fromkeys(["gravity_m_s2", "link_radius_m", "base_m", "coms_m", "inertias_kg_m2", "limits", "name"])
    assert load_arm(plain | null) == load_arm(plain)


@pytest.mark.parametrize("limit", [(math.inf, math.inf), (10.0, math.inf)])
def test_a_payload_is_learnt_without_torque_limits(limit: tuple[float, float]) -> None:
    period, mass = 0.02, 0.3
    estimator = PayloadEstimator(MODEL, np.array(limit), period)
    sums, real = LeastSquaresSums.before(1, 2), SCARA_1M.with_payload(mass)
    generator = np.random.default_rng(0)
    for _ in range(50):
        q, qd, qdd = generator.uniform(-1.0, 1.0, (3, 1, 2))
        middle = q - 0.5 * period * (qd - 0.25 * period * qdd)
        tau = real.inverse_dynamics(middle, qd - 0.5 * period * qdd, qdd)
        sums = estimator.update(sums, q, qd, qdd, tau)
    assert sums.mass[0] == pytest.approx(mass, rel=1e-3)
