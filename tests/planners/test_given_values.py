"""Values of other kinds than numbers are refused by name; copies are like what they are of; rims are reached."""

from __future__ import annotations

import copy
import dataclasses
import pickle
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import agents
from envs.experts import make_expert
from planners import (
    SCARA_1M,
    Arm,
    FixedHand,
    FixedJoints,
    JointLimits,
    MotionProblem,
    MovingHand,
    Obstacle,
    Trajectory,
    UnreachableTarget,
    load_arm,
    plan,
    sampled_trajectory,
)
from planners.apf import dodge_accelerations, new_memory, tuned_gains
from planners.control import ArmObserver, ControlSettings, ObserverSettings, PayloadPrior, PlanarArmModel, SlotineLi
from planners.dpct.settling import settling_bound
from planners.excavator import EXCAVATOR, ChainGeometry, Excavator, Link, PayloadShape, inverse_kinematics

ONE = np.zeros((1, 2))
MOVE = MotionProblem(SCARA_1M, [0.0, 0.0], FixedJoints([1.0, 1.0]), 10.0)  # type: ignore[arg-type]
RIDE = MotionProblem(SCARA_1M, [0.3, 0.9], MovingHand([0.5, 1.0], [0.1, 0.0]), 5.0)  # type: ignore[arg-type]
OBSERVER = ArmObserver(SCARA_1M, ObserverSettings(0.02, 10, 1.0))
MASKED = np.ma.array([0.3, 0.4], mask=[0, 1])


def motion() -> Trajectory:
    return plan(MOVE, "quintic")


def empty_motion() -> Trajectory:
    nothing = np.zeros((0, 2))
    return dataclasses.replace(motion(), t=np.zeros(0), q=nothing, qd=nothing, qdd=nothing, tau=nothing)


def dodge(memory: Any, q: Any = ONE, radius: float = 0.1) -> object:
    disc = np.full((1, 1, 2), 9.0), np.zeros((1, 1, 2)), np.full((1, 1), radius)
    return dodge_accelerations(SCARA_1M, tuned_gains(), q, ONE, ONE + 0.5, *disc, memory, 0.02)


def read_only(array: Any) -> Any:
    array.setflags(write=False)
    return array


@pytest.mark.parametrize(
    "wrong", [MASKED, ["0.3", "0.4"], [True, False], np.array([1j, 0.0]), [None, 0.4], [10**400, 1]]
)
@pytest.mark.parametrize(
    "call",
    [
        SCARA_1M.forward_kinematics,
        SCARA_1M.inverse_kinematics,
        lambda given: SCARA_1M.inverse_dynamics(given, given, given),
        lambda given: SCARA_1M.clearance([0.0, 0.0], given, 0.1),
        SCARA_1M.limits.within,
        RIDE.target.at,  # type: ignore[union-attr]
        motion().at,
        lambda given: Arm("wrong", given, 1.0),
        lambda given: dataclasses.replace(MOVE, q=given),
    ],
)
def test_numbers_are_numbers(call: Callable[[Any], object], wrong: Any) -> None:
    with pytest.raises(ValueError, match=r"must be numbers, as in \(0\.4, 0\.3\)"):
        call(wrong)


@pytest.mark.parametrize(
    ("named", "call"),
    [
        ("torque limits", lambda: JointLimits(torque={1.0: 5, 2.0: 6})),  # type: ignore[arg-type]
        ("torque limits", lambda: JointLimits(torque={5.0, 3.0})),  # type: ignore[arg-type]
        ("torque limits", lambda: JointLimits(torque=bytearray(b"ab"))),
        ("angle limits", lambda: JointLimits(angle=(b"ab",))),
        ("n_joints", lambda: JointLimits.unlimited(-1)),
        ("n_joints", lambda: JointLimits(torque=1.0).for_joints(0)),
        ("q has shape", lambda: SCARA_1M.limits.within(0.5)),
        ("near", lambda: SCARA_1M.inverse_kinematics([1.0, 1.0], near=[1e200, 0.0])),
        ("2 centres", lambda: SCARA_1M.clearance([0.0, 0.0], [[1.0, 1.0], [2.0, 2.0]], 0.1)),
        ("memory", lambda: OBSERVER.update(np.zeros((1, OBSERVER.width), int), np.ones(1, bool), ONE, ONE)),
        ("memory", lambda: OBSERVER.update(read_only(np.zeros((1, OBSERVER.width))), np.ones(1, bool), ONE, ONE)),
        ("memory", lambda: OBSERVER.send(np.zeros((1, 2 * OBSERVER.width))[:, ::2], ONE)),
        ("memory", lambda: dodge(read_only(new_memory(1, 1)))),
        ("memory", lambda: dodge(np.zeros(1))),
        ("q", lambda: dodge(new_memory(1, 1), q=ONE * np.nan)),
        ("radii", lambda: dodge(new_memory(1, 1), radius=-1.0)),
        ("discs", lambda: tuned_gains(-1)),
        ("parameters", lambda: PlanarArmModel(SCARA_1M).torque(ONE, ONE, ONE, ONE, np.zeros((1, 2)))),
        ("q has shape", lambda: PlanarArmModel(SCARA_1M).mass_matrix(np.ones((1, 1)), np.ones((1, 1)))),
        ("initial", lambda: PayloadPrior([1.0, 9.0], [0.0, 5.0], [2.0, 3.0])),  # type: ignore[arg-type]
        ("the times", empty_motion),
        ("cost", lambda: dataclasses.replace(motion(), cost="x")),  # type: ignore[arg-type]
        ("planner", lambda: dataclasses.replace(motion(), planner=None)),  # type: ignore[arg-type]
        ("position_tolerance", lambda: settling_bound(RIDE, True, 0.1)),
        ("stages", lambda: settling_bound(RIDE, 0.1, 0.1, stages=0)),
        ("com of a link", lambda: Link(1.0, "123", (1.0, 1.0, 1.0), 0.0, 0.0)),  # type: ignore[arg-type]
        ("d1", lambda: ChainGeometry("1", 1.0, 1.0, 0.0, 0.0, 1.0)),  # type: ignore[arg-type]
        ("x: link 1", lambda: Excavator("x", EXCAVATOR.geometry, (1, 2, 3, 4, 5), JointLimits())),  # type: ignore[arg-type]
        ("percent", lambda: PayloadShape().mass(-5.0)),
        ("MinTorqueMove-v0 setting: horizon = True", lambda: gym.make("MinTorqueMove-v0", horizon=True)),
        ("cannot write a.json", lambda: agents.save_agent(agents.load_agent("MinTorqueMove-v0"), "a.json")),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_by_name(named: str, call: Callable[[], object]) -> None:
    with pytest.raises(ValueError, match=rf"^{named}\b"):
        call()


def test_numbers_of_other_kinds_are_converted() -> None:
    assert SCARA_1M.clearance([0.0, 0.0], (1.0, 1.0), Fraction(1, 10)) == SCARA_1M.clearance(
        [0.0, 0.0], (1.0, 1.0), 0.1
    )
    samples = [np.array([0.0, 1.0]), *3 * [np.zeros((2, 2))]]
    made = sampled_trajectory(MOVE, *samples, planner="mine", cost=np.float32(1.0), rendezvous_time=np.int64(1))
    assert type(made.cost) is type(made.rendezvous_time) is float
    arm = {"lengths_m": [1.0, 1.0], "masses_kg": [1.0, 1.0]}
    for limit in (np.array([90.0, 90.0]), np.float32(90.0), [np.int64(90), np.float32(90.0)]):
        limits = load_arm({**arm, "limits": {"angle_deg": limit, "velocity_deg_s": limit}}).limits
        assert limits.angle == limits.velocity == (np.pi / 2.0, np.pi / 2.0)


@pytest.mark.parametrize("again", [copy.deepcopy, lambda given: pickle.loads(pickle.dumps(given))])
def test_a_copy_is_like_its_original(again: Callable[[Any], Any]) -> None:
    hand = FixedHand([0.5, 0.5], 1.0)  # type: ignore[arg-type]
    for original in (MOVE, RIDE, hand, Obstacle([1.0, 1.0], [0.0, 0.0], 0.1), motion()):  # type: ignore[arg-type]
        assert again(original) == original
    with pytest.raises(ValueError, match="read-only"):
        again(MOVE).q[0] = 0.5
    settings = ControlSettings(0.01, *np.array([[8.0, 8.0], [3.0, 1.0], [200.0, 100.0]]))
    law = SlotineLi(
        PlanarArmModel(SCARA_1M), settings, PayloadPrior(*np.array([[0.5], [0.0], [5.0]])), np.array([10.0])
    )
    copied = again(law)
    for controller in (law, copied):
        for _ in range(3):
            controller.torque(ONE + 0.2, ONE + 0.5, ONE + 0.3, ONE, ONE + 0.1)
    np.testing.assert_array_equal(copied.memory, law.memory)
    np.testing.assert_array_equal(copied.memory[:, :1], copied.parameters)
    assert law.parameters[0, 0] != 0.5
    again(make_expert("dpct", gym.make("ConveyorTrack-v0")))
    assert settings != dataclasses.replace(settings)


def test_arrays_of_an_arm_are_the_callers_own() -> None:
    before = SCARA_1M.forward_kinematics([0.3, 0.4]), SCARA_1M.mass_matrix([0.3, 0.4])
    SCARA_1M.base_array[0] = SCARA_1M.length_array[0] = SCARA_1M.chain_constants[0][0, 0] = 5.0
    EXCAVATOR.geometry.kernel_array[0] = EXCAVATOR.drives[0, 0] = 5.0
    np.testing.assert_array_equal(SCARA_1M.forward_kinematics([0.3, 0.4]), before[0])
    np.testing.assert_array_equal(SCARA_1M.mass_matrix([0.3, 0.4]), before[1])
    assert EXCAVATOR.geometry.kernel_array[0] == EXCAVATOR.geometry.d1


@pytest.mark.parametrize("base", [0.0, 1e4, -1e6])
@pytest.mark.parametrize("lengths", [(1.0, 0.7), (1.0, 1e-4), (1e-6, 1.0), (0.3, 0.3, 0.2), (0.3, 0.3, 0.2, 0.1)])
def test_an_arm_reaches_its_own_stretched_and_folded_postures(base: float, lengths: tuple[float, ...]) -> None:
    arm = Arm("rim", lengths, 1.0, base=(base, base))
    for turn in np.linspace(-3.0, 3.0, 25):
        for fold in (0.0, np.pi) if len(lengths) == 2 else (0.0,):
            q = np.array([turn, fold, *[0.0] * (len(lengths) - 2)])
            hand = arm.forward_kinematics(q)
            found = arm.inverse_kinematics(hand, float(q.sum()) if len(lengths) == 3 else None)
            assert np.abs(arm.forward_kinematics(found) - hand).max() <= 1e-7 * arm.reach


def test_every_target_out_of_reach_is_named() -> None:
    targets = [[1.0, 1.0], [2.0, 0.0], [9.0, 9.0], [1.0, 0.0], [8.0, 8.0]]
    for lengths in ([2.0, 2.0], [1.0] * 4):
        with pytest.raises(UnreachableTarget, match=r"\(and 1 more targets\)") as refused:
            Arm("several", lengths, 1.0).inverse_kinematics(targets)
        assert refused.value.rows == (2, 4)


def test_the_length_of_a_direction_does_not_matter() -> None:
    found = [inverse_kinematics((3.0, 0.0, 1.0), [size, 0.0, 0.0]).q for size in (1.0, 1e200, 1e-200, 3.0)]
    for q in found[1:]:
        np.testing.assert_array_equal(q, found[0])
