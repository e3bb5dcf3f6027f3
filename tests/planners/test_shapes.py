"""Arrays of another shape or type are refused, or converted, before compiled code reads them without looking."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from planners import SCARA_1M, FixedJoints, MotionProblem, quintic
from planners.apf import dodge_accelerations, new_memory, tuned_gains
from planners.apf.distance_table import DistanceTable
from planners.apf.joint_field import reach
from planners.apf.moving_target import approach
from planners.control import ArmObserver, ObserverSettings, held_torque, within_torque
from planners.excavator.plane import planar_dynamics, planar_model
from tests.planners.test_network import network

ONE, MANY, HALF = np.zeros((1, 2)), np.zeros((3_000_000, 2)), np.full((1, 2), 0.3)
OBSERVER = ArmObserver(SCARA_1M, ObserverSettings(0.02, 10, 1.0))
MEMORY, STARTS = np.zeros((1, OBSERVER.width)), np.ones(1, bool)
THREE, LONG = np.zeros((1, 3)), np.zeros((99, 3))
PLANE = planar_dynamics()
TARGET = ONE, ONE, ONE


@pytest.mark.parametrize(
    "call",
    [
        lambda: held_torque(SCARA_1M, MANY, ONE, ONE, 0.02),
        lambda: held_torque(SCARA_1M, THREE, THREE, THREE, 0.02),
        lambda: within_torque(SCARA_1M, ONE, MANY, MANY, 0.02),
        lambda: OBSERVER.update(MEMORY, STARTS, np.zeros((40, 2)), np.zeros((40, 2))),
        lambda: OBSERVER.update(MEMORY[:, :-1].copy(), STARTS, ONE, ONE),
        lambda: OBSERVER.update(MEMORY, np.ones(2, bool), ONE, ONE),
        lambda: OBSERVER.update(MEMORY.copy(), STARTS, ONE, ONE).held_torque(MANY, 0.02),
        lambda: OBSERVER.send(MEMORY, np.zeros((4, 2))),
        lambda: reach(SCARA_1M, MANY, ONE, ONE, 1.0, 0.02),
        lambda: approach(SCARA_1M, MANY, ONE, ONE, TARGET, 0.02),
        lambda: approach(SCARA_1M, np.zeros((9, 2)), np.zeros((9, 2)), np.zeros((9, 2)), TARGET, 0.02),
        lambda: PLANE.torque(LONG, THREE, THREE, THREE),
        lambda: PLANE.mass_matrix(np.zeros((1, 2))),
        lambda: planar_model().regressor(LONG, THREE, THREE, THREE),
        lambda: network("tanh")[0].run(np.zeros((4, 50_000), np.float32)),
        lambda: network("tanh")[0].run(np.zeros((4, 2), np.float32)),
    ],
)
def test_a_wrong_shape_is_refused(call: Callable[[], object]) -> None:
    with pytest.raises(ValueError, match=r"has shape \(.*\); it must have \("):
        call()


def test_integers_and_lists_are_converted() -> None:
    whole = held_torque(SCARA_1M, np.zeros((1, 2), int), ONE, HALF, 0.02)
    np.testing.assert_array_equal(whole, held_torque(SCARA_1M, ONE, ONE, HALF, 0.02))
    np.testing.assert_array_equal(held_torque(SCARA_1M, [[0, 0]], [[0, 0]], HALF, 0.02), whole)  # type: ignore[arg-type]
    np.testing.assert_array_equal(within_torque(SCARA_1M, ONE, ONE, ONE.astype(int), 0.02), ONE)
    estimate = OBSERVER.update(MEMORY.copy(), STARTS, ONE.astype(int), ONE)
    ones = np.ones((1, 2))
    np.testing.assert_array_equal(estimate.held_torque(ones.astype(int), 0.02), estimate.held_torque(ones, 0.02))
    np.testing.assert_array_equal(
        PLANE.torque(THREE.astype(int), THREE, THREE, THREE), PLANE.torque(THREE, THREE, THREE, THREE)
    )
    assert approach(SCARA_1M, ONE, ONE, ONE.astype(int), TARGET, 0.02).dtype == float


def test_a_memory_from_elsewhere_is_not_read_as_an_index() -> None:
    memory = new_memory(1, 1)
    memory["elbow"], memory["begun"] = 10**12, True
    disc = np.full((1, 1, 2), 9.0), np.zeros((1, 1, 2)), np.full((1, 1), 0.1)
    far = dodge_accelerations(SCARA_1M, tuned_gains(), HALF, ONE, np.full((1, 2), 5.0), *disc, memory, 0.02)
    assert np.isfinite(far).all()
    assert memory["elbow"][0] in (0, 1)
    with pytest.raises(ValueError, match=r"goal has shape \(1, 3\); it must have \(1, 2\)"):
        dodge_accelerations(SCARA_1M, tuned_gains(), HALF, ONE, THREE, *disc, memory, 0.02)
    numbers = np.full((1, OBSERVER.width), 1e12)
    OBSERVER.update(numbers, np.zeros(1, bool), ONE, ONE)


def test_the_table_of_distances_is_not_read_outside() -> None:
    table = DistanceTable.looking_ahead(0.4)
    for speed in (-1e12, np.nan):
        with pytest.raises(ValueError, match=r"speed .* must be finite"):
            table.shift(speed, 0.0)


def test_a_trajectory_has_samples_of_one_shape() -> None:
    motion = quintic.plan(MotionProblem(SCARA_1M, np.zeros(2), FixedJoints(np.full(2, 0.03)), 2.0))
    for part in ("q", "qd", "qdd", "tau"):
        with pytest.raises(ValueError, match=rf"{part} has shape \(3, 2\); it must have \({len(motion.t)}, 2\)"):
            replace(motion, **{part: getattr(motion, part)[:3]})
    with pytest.raises(ValueError, match=r"q has shape .* it must have \(5000000, 2\)"):
        replace(motion, t=np.linspace(0.0, 1.0, 5_000_000))
