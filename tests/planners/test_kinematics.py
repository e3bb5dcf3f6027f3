"""Forward and inverse kinematics against the complex form of a planar chain, finite differences and round trips."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planners import PLANAR_3R, SCARA_1M, Arm, JointLimits, UnreachableTarget
from planners.typing import Array

angles = st.floats(-math.pi, math.pi)
link_lengths = st.floats(0.1, 2.0)


def make_arm(*lengths: float, base: tuple[float, float] = (0.0, 0.0)) -> Arm:
    n = len(lengths)
    return Arm("test arm", lengths=lengths, masses=(1.0,) * n, limits=JointLimits.unlimited(n), base=base)


def turn(angle: Array) -> Array:
    """A point of the unit circle: equal for equal directions whatever the number of turns."""
    return np.exp(1j * np.asarray(angle))


@pytest.mark.parametrize("n", range(1, 7))
def test_forward_kinematics_is_a_sum_of_complex_exponentials(n: int) -> None:
    rng = np.random.default_rng(n)
    arm = make_arm(*rng.uniform(0.1, 1.0, n), base=(0.3, -1.2))
    q = rng.uniform(-np.pi, np.pi, (40, n))
    steps = np.array(arm.lengths) * np.exp(1j * np.cumsum(q, axis=1))
    chain = complex(*arm.base) + np.concatenate([np.zeros((40, 1)), np.cumsum(steps, axis=1)], axis=1)
    points = arm.joint_positions(q)
    assert points.shape == (40, n + 1, 2)
    np.testing.assert_allclose(points[..., 0] + 1j * points[..., 1], chain, rtol=0.0, atol=1e-14)
    np.testing.assert_array_equal(arm.forward_kinematics(q), points[:, -1])


def test_zero_angles_stretch_the_arm_along_x() -> None:
    np.testing.assert_allclose(SCARA_1M.joint_positions([0.0, 0.0]), [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]], atol=1e-15)
    np.testing.assert_allclose(SCARA_1M.forward_kinematics([np.pi / 2, -np.pi / 2]), [1.0, 1.0], atol=1e-15)


@pytest.mark.parametrize("n", range(1, 7))
def test_jacobian_is_the_slope_of_forward_kinematics(n: int) -> None:
    rng = np.random.default_rng(10 + n)
    arm = make_arm(*rng.uniform(0.1, 1.0, n), base=(0.3, -1.2))
    q = rng.uniform(-np.pi, np.pi, (20, n))
    step = 1e-6
    slope = np.stack(
        [(arm.forward_kinematics(q + e) - arm.forward_kinematics(q - e)) / (2 * step) for e in step * np.eye(n)], -1
    )
    assert slope.shape == (20, 2, n)
    np.testing.assert_allclose(arm.jacobian(q), slope, rtol=0.0, atol=1e-8)


@given(link_lengths, link_lengths, angles, angles)
@settings(deadline=None)
def test_two_links_come_back_on_both_branches(l1: float, l2: float, q1: float, q2: float) -> None:
    arm = make_arm(l1, l2, base=(-0.4, 0.7))
    hand = arm.forward_kinematics([q1, q2])
    postures = arm.inverse_kinematics(hand)
    assert postures.shape == (2, 2)
    assert postures[0, 1] >= 0.0 >= postures[1, 1]
    np.testing.assert_allclose(arm.forward_kinematics(postures), [hand, hand], rtol=0.0, atol=1e-11)
    if 1e-3 < abs(q2) < math.pi - 1e-3:  # near a straight or folded elbow the angle is less certain than the hand
        same_elbow = postures[0 if q2 >= 0.0 else 1]
        np.testing.assert_allclose(turn(same_elbow), turn([q1, q2]), rtol=0.0, atol=1e-9)


@given(st.tuples(link_lengths, link_lengths, link_lengths), st.tuples(angles, angles, angles))
@settings(deadline=None)
def test_three_links_come_back_on_both_branches(lengths: tuple[float, ...], q: tuple[float, ...]) -> None:
    arm = make_arm(*lengths, base=(-0.4, 0.7))
    hand = arm.forward_kinematics(q)
    postures = arm.inverse_kinematics(hand, orientation=sum(q))
    assert postures.shape == (2, 3)
    assert postures[0, 1] >= 0.0 >= postures[1, 1]
    np.testing.assert_allclose(arm.forward_kinematics(postures), [hand, hand], rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(turn(postures.sum(axis=1)), turn([sum(q)] * 2), rtol=0.0, atol=1e-12)
    if 1e-3 < abs(q[1]) < math.pi - 1e-3:
        same_elbow = postures[0 if q[1] >= 0.0 else 1]
        np.testing.assert_allclose(turn(same_elbow), turn(q), rtol=0.0, atol=1e-9)


def test_conveyor_line_is_reached_by_the_known_posture() -> None:
    """(1, sqrt 3) is the tip of two unit links along 60 degrees; on (-1, sqrt 3) they are straight at 120 degrees."""
    hand = np.array([0.0, math.sqrt(3.0)])
    postures = SCARA_1M.inverse_kinematics(hand)
    expected = np.radians([[60.0, 60.0], [120.0, -60.0]])
    np.testing.assert_allclose(postures, expected, rtol=1e-14)


@pytest.mark.parametrize("direction", np.radians([0.0, 37.0, 90.0, -150.0]))
def test_both_branches_meet_on_the_outer_rim(direction: float) -> None:
    hand = 2.0 * np.array([np.cos(direction), np.sin(direction)])
    postures = SCARA_1M.inverse_kinematics(hand)
    np.testing.assert_allclose(postures, [[direction, 0.0]] * 2, rtol=0.0, atol=1e-7)
    np.testing.assert_allclose(SCARA_1M.forward_kinematics(postures), [hand, hand], rtol=0.0, atol=1e-15)


def test_inner_rim_is_reached_folded() -> None:
    arm = make_arm(0.4, 0.2)
    postures = arm.inverse_kinematics([0.0, 0.2])
    np.testing.assert_allclose(turn(postures), turn([[np.pi / 2, np.pi]] * 2), rtol=0.0, atol=1e-7)
    np.testing.assert_allclose(arm.forward_kinematics(postures), [[0.0, 0.2]] * 2, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("distance", [0.0, 1e-12, 1e-9, 1e-6, 1e-3, 2.0 - 1e-9, 2.0 - 1e-13, 2.0 + 1e-13])
def test_hand_is_exact_close_to_the_rims(distance: float) -> None:
    hand = distance * np.array([0.6, 0.8])
    found = SCARA_1M.forward_kinematics(SCARA_1M.inverse_kinematics(hand))
    np.testing.assert_allclose(found, [hand, hand], rtol=0.0, atol=1e-12)


def test_base_shifts_the_workspace() -> None:
    moved = make_arm(1.0, 1.0, base=(5.0, -2.0))
    np.testing.assert_allclose(
        moved.inverse_kinematics([6.0, -1.5]), SCARA_1M.inverse_kinematics([1.0, 0.5]), rtol=0.0, atol=1e-14
    )


def test_batch_equals_single_bit_for_bit() -> None:
    rng = np.random.default_rng(20)
    q = rng.uniform(-np.pi, np.pi, (101, 3))
    hand, orientation = PLANAR_3R.forward_kinematics(q), q.sum(axis=1)
    np.testing.assert_array_equal(hand, [PLANAR_3R.forward_kinematics(row) for row in q])
    np.testing.assert_array_equal(PLANAR_3R.jacobian(q), [PLANAR_3R.jacobian(row) for row in q])
    np.testing.assert_array_equal(
        PLANAR_3R.inverse_kinematics(hand, orientation),
        [PLANAR_3R.inverse_kinematics(*row) for row in zip(hand, orientation, strict=True)],
    )
    hand = SCARA_1M.forward_kinematics(q[:, :2])
    np.testing.assert_array_equal(SCARA_1M.inverse_kinematics(hand), [SCARA_1M.inverse_kinematics(p) for p in hand])


def test_one_orientation_serves_every_environment() -> None:
    hand = np.array([[0.4, 0.3], [0.1, 0.5]])
    np.testing.assert_array_equal(
        PLANAR_3R.inverse_kinematics(hand, 0.7), PLANAR_3R.inverse_kinematics(hand, [0.7, 0.7])
    )


def test_target_too_far_is_named() -> None:
    wanted = r"position \(3, -4\) m is 5 m from the base; links of 1 m and 1 m reach from 0 m to 2 m$"
    with pytest.raises(UnreachableTarget, match=wanted) as caught:
        SCARA_1M.inverse_kinematics([3.0, -4.0])
    assert caught.value.rows == (0,)


def test_target_too_near_is_named() -> None:
    arm = make_arm(0.4, 0.1, base=(1.0, 1.0))
    with pytest.raises(UnreachableTarget, match=r"\(1.05, 1\) m is 0.05 m from the base.*reach from 0.3 m to 0.5 m"):
        arm.inverse_kinematics([1.05, 1.0])


def test_unreachable_wrist_names_the_hand_the_orientation_and_the_wrist() -> None:
    wanted = r"hand position \(0.75, 0\) m with the last link along 3.142 rad .* wrist position \(0.95, .*to 0.6 m"
    with pytest.raises(UnreachableTarget, match=wanted):
        PLANAR_3R.inverse_kinematics([0.75, 0.0], orientation=np.pi)
    PLANAR_3R.inverse_kinematics([0.75, 0.0], orientation=0.0)


def test_every_unreachable_environment_is_counted() -> None:
    hand = [[1.0, 0.0], [9.0, 0.0], [0.0, 1.0], [0.0, 8.0]]
    with pytest.raises(UnreachableTarget, match=r"\(9, 0\).*1 more target") as caught:
        SCARA_1M.inverse_kinematics(hand)
    assert caught.value.rows == (1, 3)


def test_unreachable_target_survives_pickling() -> None:
    with pytest.raises(UnreachableTarget) as caught:
        SCARA_1M.inverse_kinematics([3.0, -4.0])
    copy = pickle.loads(pickle.dumps(caught.value))
    assert type(copy) is UnreachableTarget
    assert (str(copy), copy.rows) == (str(caught.value), (0,))


@pytest.mark.parametrize("hand", [[math.nan, 0.0], [0.0, math.inf], [-math.inf, math.nan]])
def test_targets_that_are_no_numbers_are_unreachable(hand: list[float]) -> None:
    with pytest.raises(UnreachableTarget, match=r"nan|inf"):
        SCARA_1M.inverse_kinematics(hand)


def test_orientation_that_is_no_number_is_unreachable() -> None:
    with pytest.raises(UnreachableTarget, match="nan"):
        PLANAR_3R.inverse_kinematics([0.4, 0.0], orientation=math.nan)


@pytest.mark.parametrize("hand", [1.0, [1.0], [1.0, 0.0, 0.0], np.zeros((4, 3)), np.zeros((1, 1, 2))])
def test_wrong_target_shapes_are_refused(hand: Array) -> None:
    with pytest.raises(ValueError, match=r"hand position has shape .* give \(2,\) or \(batch, 2\)"):
        SCARA_1M.inverse_kinematics(hand)


@pytest.mark.parametrize("q", [0.0, [0.0], [0.0, 0.0, 0.0], np.zeros((4, 3)), np.zeros((1, 1, 2))])
def test_wrong_posture_shapes_are_refused(q: Array) -> None:
    for method in (SCARA_1M.joint_positions, SCARA_1M.forward_kinematics, SCARA_1M.jacobian):
        with pytest.raises(ValueError, match=r"SCARA_1M wants \(2,\) or \(batch, 2\)"):
            method(q)


def test_orientation_is_asked_of_three_links_only() -> None:
    with pytest.raises(ValueError, match="leave it out"):
        SCARA_1M.inverse_kinematics([1.0, 0.0], orientation=0.0)
    with pytest.raises(ValueError, match="give the hand's orientation"):
        PLANAR_3R.inverse_kinematics([0.5, 0.0])


@given(st.floats(0.1, 2.0), angles)
@settings(deadline=None)
def test_one_link_comes_back_from_its_circle(length: float, q: float) -> None:
    arm = make_arm(length, base=(-0.4, 0.7))
    hand = arm.forward_kinematics([q])
    posture = arm.inverse_kinematics(hand)
    assert posture.shape == (1, 1)
    np.testing.assert_allclose(turn(posture[0]), turn([q]), rtol=0.0, atol=1e-13 / length + 1e-13)


def test_a_single_link_refuses_what_is_off_its_circle() -> None:
    arm = make_arm(0.5)
    with pytest.raises(UnreachableTarget, match=r"\(0.4, 0.4\) m is 0.5657 m from the base; one link reaches 0.5 m"):
        arm.inverse_kinematics([0.4, 0.4])
    with pytest.raises(ValueError, match="1 link cannot choose the orientation"):
        arm.inverse_kinematics([0.5, 0.0], 0.0)


@given(seed=st.integers(0, 10**6), n=st.integers(4, 6), oriented=st.booleans())
@settings(max_examples=40, deadline=None)
def test_more_links_come_back_within_their_ranges(seed: int, n: int, oriented: bool) -> None:
    rng = np.random.default_rng(seed)
    middle, half = rng.uniform(-2.0, 2.0, n), rng.uniform(0.5, 3.0, n)
    limits = JointLimits(angle=list(zip(middle - half, middle + half, strict=True)))
    arm = Arm("test arm", rng.uniform(0.1, 1.0, n), 1.0, limits, base=rng.uniform(-1.0, 1.0, 2))
    there = rng.uniform(limits.angle_lower, limits.angle_upper)
    hand, along = arm.forward_kinematics(there), float(there.sum())
    postures = arm.inverse_kinematics(hand, along if oriented else None, near=there + 0.05)
    assert 1 <= len(postures) <= 8
    assert limits.within(postures).all()
    np.testing.assert_allclose(arm.forward_kinematics(postures), [hand] * len(postures), rtol=0.0, atol=1e-10)
    if oriented:
        np.testing.assert_allclose(turn(postures.sum(axis=1)), turn([along] * len(postures)), rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("distance", [0.0, 1e-9, 1e-3, 0.8, 2.0 - 1e-6, 2.0 - 1e-12, 2.0])
@pytest.mark.parametrize("n", [4, 5, 6])
def test_more_links_reach_up_to_the_rims(n: int, distance: float) -> None:
    arm = make_arm(*(2.0 / n,) * n, base=(0.2, -0.3))
    hand = arm.base_array + distance * np.array([0.6, 0.8])
    postures = arm.inverse_kinematics(hand)
    np.testing.assert_allclose(arm.forward_kinematics(postures), [hand] * len(postures), rtol=0.0, atol=1e-10)


def test_a_long_link_leaves_a_hole_that_is_reached_to_its_rim() -> None:
    arm = make_arm(0.2, 1.0, 0.2, 0.1)
    for distance in (0.5, 0.5 + 1e-12, 0.50001):
        postures = arm.inverse_kinematics([0.0, distance])
        np.testing.assert_allclose(arm.forward_kinematics(postures), [[0.0, distance]] * len(postures), atol=1e-10)
    with pytest.raises(UnreachableTarget, match=r"is 0.49 m .* 0.2 m, 1 m, 0.2 m and 0.1 m reach from 0.5 m to 1.5 m"):
        arm.inverse_kinematics([0.0, 0.49])


def test_more_links_take_batches_and_give_the_same_every_time() -> None:
    arm = make_arm(0.5, 0.4, 0.3, 0.2)
    hands = np.array([[0.7, 0.5], [-0.9, 0.2], [1.4, 0.0]])
    postures = arm.inverse_kinematics(hands, [0.1, 0.2, 0.0])
    assert postures.shape == (3, postures.shape[1], 4)
    np.testing.assert_allclose(arm.forward_kinematics(postures[0]), [hands[0]] * postures.shape[1], atol=1e-10)
    np.testing.assert_allclose(postures.sum(axis=2)[1] % (2.0 * np.pi), 0.2, atol=1e-9)
    np.testing.assert_array_equal(arm.inverse_kinematics(hands, [0.1, 0.2, 0.0]), postures)
    single = arm.inverse_kinematics(hands[0], 0.1)
    np.testing.assert_array_equal(postures[0, : len(single)], single)
    with pytest.raises(ValueError, match=r"has shape \(2,\); test arm wants \(4,\)"):
        arm.inverse_kinematics(hands[0], near=[0.1, 0.2])


def test_the_closest_posture_comes_first() -> None:
    arm, near = make_arm(0.5, 0.4, 0.3, 0.2), np.array([0.3, 0.4, -0.2, 0.5])
    postures = arm.inverse_kinematics(arm.forward_kinematics(near), near=near)
    np.testing.assert_array_equal(postures[0], near)
    changes = np.abs(postures - near).sum(axis=1)
    assert (np.diff(changes) >= 0.0).all()


def test_shapes_that_do_not_fit_are_refused() -> None:
    three, hand = make_arm(0.5, 0.4, 0.3), [0.6, 0.2]
    for orientation in ([0.1, 0.2], [0.1], [[0.1]]):
        with pytest.raises(ValueError, match=r"orientation has shape .*; give one number, or one per hand position"):
            three.inverse_kinematics(hand, orientation)
    with pytest.raises(ValueError, match=r"centre of the disc has shape \(3,\); give \(2,\) or \(batch, 2\)"):
        three.clearance([0.1, 0.2, 0.3], [0.1, 0.2, 0.3], 0.1)
    with pytest.raises(ValueError, match="disc radius nan m must be finite and not negative"):
        three.clearance([0.1, 0.2, 0.3], hand, math.nan)
    with pytest.raises(ValueError, match="payload mass 'much' must be a finite number"):
        three.with_payload("much")  # type: ignore[arg-type]


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_more_links_find_nothing_for_what_is_no_number(bad: float) -> None:
    four = make_arm(0.5, 0.4, 0.3, 0.2)
    with pytest.raises(UnreachableTarget):
        four.inverse_kinematics([bad, 0.2])
    with pytest.raises(UnreachableTarget):
        four.inverse_kinematics([0.6, 0.2], bad)
