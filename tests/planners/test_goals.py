"""Goal postures: the nearest whole turns within the joint ranges, elbow branches, and arms of one to six links."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planners import SCARA_1M, SCARA_50CM, Arm, FixedHand, FixedJoints, Infeasible, JointLimits, MotionProblem
from planners.goals import goal_postures, nearest_turns, whole_turns
from planners.typing import Array

TURN = 2.0 * math.pi
PAIR = Arm("pair", [0.42, 0.31], [3.0, 2.0], JointLimits(angle=[(-0.7, 3.9), (-2.4, 2.6)]))


def problem(arm: Arm, q: object, target: FixedHand | FixedJoints) -> MotionProblem:
    return MotionProblem(arm, np.asarray(q, dtype=float), target, 3.0)


def hand_of(arm: Arm, q: object) -> FixedHand:
    return FixedHand(arm.forward_kinematics(np.asarray(q, dtype=float)))


def test_the_nearest_turn_crosses_the_cut_at_half_a_turn() -> None:
    """From 3.1 rad to where the hand is at 3.2 rad is 0.1 rad, not a turn the other way."""
    target = hand_of(SCARA_1M, [3.2, 1.05])
    goals = goal_postures(problem(SCARA_1M, [3.1, 1.0], target), target, "start")
    np.testing.assert_allclose(goals[0], [3.2, 1.05], atol=1e-12)


def test_a_joint_without_a_range_takes_the_closest_of_all_turns() -> None:
    near = np.array([20.0, -7.0])
    turned = nearest_turns(np.array([0.1, 0.2]), near, JointLimits.unlimited(2))
    np.testing.assert_allclose(turned, [0.1 + 3.0 * TURN, 0.2 - TURN], atol=1e-12)


def test_turns_stay_within_a_range_that_does_not_contain_zero() -> None:
    limits = JointLimits(angle=[(4.0, 9.0)])
    np.testing.assert_allclose(nearest_turns(np.array([0.0]), np.array([4.5]), limits), [TURN])
    assert np.isnan(nearest_turns(np.array([-2.5]), np.array([4.5]), JointLimits(angle=[(4.0, 8.0)])))[0]


def test_a_range_of_more_than_a_turn_allows_the_closest_of_several() -> None:
    limits = JointLimits(angle=[(-2.0 * TURN, TURN)])
    for near, turns in ((5.0, 0), (-11.0, -2), (0.0, 0), (-5.5, -1)):  # 0.3 + a turn is beyond the range
        found = nearest_turns(np.array([0.3]), np.array([near]), limits)[0]
        assert found == pytest.approx(0.3 + turns * TURN)


@given(
    posture=st.floats(-10.0, 10.0),
    near=st.floats(-12.0, 12.0),
    middle=st.floats(-8.0, 8.0),
    half=st.floats(0.1, 10.0),
)
@settings(deadline=None)
def test_nearest_turns_is_the_best_of_all_turns(posture: float, near: float, middle: float, half: float) -> None:
    lower, upper = middle - half, middle + half
    near = min(max(near, lower), upper)  # a start within its range
    found = nearest_turns(np.array([posture]), np.array([near]), JointLimits(angle=[(lower, upper)]))[0]
    allowed = [posture + k * TURN for k in range(-6, 7) if lower + 1e-9 < posture + k * TURN < upper - 1e-9]
    if allowed:
        assert lower <= found <= upper
        assert abs(found - near) <= min(abs(angle - near) for angle in allowed) + 1e-9
    elif not math.isnan(found):
        assert math.remainder(found - posture, TURN) == pytest.approx(0.0, abs=1e-9)


def test_the_first_joint_is_tried_both_ways_round() -> None:
    start = problem(SCARA_1M, [1.0, 0.5], hand_of(SCARA_1M, [-2.0, 0.5]))
    goals = whole_turns(np.array([-2.0, 0.5]), start)
    np.testing.assert_allclose(sorted(goal[0] for goal in goals), [-2.0, -2.0 + TURN])


@pytest.mark.parametrize("elbow", ["+", "-", "start", "best"])
def test_a_target_on_the_rim_is_on_both_elbow_branches(elbow: str) -> None:
    target = FixedHand([1.2, 1.6])
    goals = goal_postures(problem(SCARA_1M, [0.3, -0.4], target), target, elbow)  # type: ignore[arg-type]
    np.testing.assert_allclose(SCARA_1M.forward_kinematics(goals[0]), [1.2, 1.6], atol=1e-10)


def test_targets_out_of_reach_or_range_are_refused_with_numbers() -> None:
    far, behind = FixedHand([3.0, 0.0]), hand_of(PAIR, [-1.5, 0.2])
    with pytest.raises(Infeasible, match=r"unreachable: position \(3, 0\) m is 3 m .* reach from 0 m to 2 m"):
        goal_postures(problem(SCARA_1M, [0.3, 0.4], far), far, "best")
    with pytest.raises(Infeasible, match=r"leaves a joint's range, -0.7 to 3.9, -2.4 to 2.6 rad"):
        goal_postures(problem(PAIR, [0.3, 0.4], behind), behind, "best")
    joints = FixedJoints([0.5, 2.9])
    with pytest.raises(Infeasible, match=r"limits: .* joint 2 at 2.9 rad; the joint ranges are \+-2.88, \+-2.62 rad"):
        goal_postures(problem(SCARA_50CM, [0.3, 0.4], joints), joints, "best")


def test_a_single_link_has_no_elbow() -> None:
    arm = Arm("link", 0.5, 1.0)
    target = hand_of(arm, [2.0])
    assert goal_postures(problem(arm, [1.0], target), target, "start")[0] == pytest.approx([2.0])
    with pytest.raises(ValueError, match="one link and no elbow"):
        goal_postures(problem(arm, [1.0], target), target, "+")


def test_three_links_at_the_rim_point_to_the_target() -> None:
    """None of the orientations that are tried first reaches it."""
    arm = Arm("three", [0.4, 0.3, 0.2], [1.0, 1.0, 1.0])
    target = FixedHand(0.9 * np.array([math.cos(0.123), math.sin(0.123)]))
    goals = goal_postures(problem(arm, [0.5, 0.4, 0.3], target), target, "best")
    np.testing.assert_allclose(goals[0], [0.123, 0.0, 0.0], atol=1e-4)
    np.testing.assert_allclose(arm.forward_kinematics(goals[0]), target.position, atol=1e-10)


@given(seed=st.integers(0, 10**6), n=st.integers(1, 6))
@settings(max_examples=40, deadline=None)
def test_goals_reach_the_target_within_ranges_anywhere(seed: int, n: int) -> None:
    """Random arms of one to six links, with ranges around any angle, some of more than a turn and some of none."""
    rng = np.random.default_rng(seed)
    middle, half = rng.uniform(-4.0, 4.0, n), rng.uniform(0.6, 4.5, n)
    ranges = [math.inf if rng.random() < 0.2 else (m - h, m + h) for m, h in zip(middle, half, strict=True)]
    limits = JointLimits(angle=ranges)
    arm = Arm("any", rng.uniform(0.1, 1.0, n), rng.uniform(0.5, 3.0, n), limits, base=rng.uniform(-1.0, 1.0, 2))
    low, high = np.maximum(limits.angle_lower, -9.0), np.minimum(limits.angle_upper, 9.0)
    start, there = rng.uniform(low, high), rng.uniform(low, high)
    if n == 3 and rng.random() < 0.5:
        target = FixedHand(arm.forward_kinematics(there), float(there.sum()))
    else:
        target = hand_of(arm, there)
    goals = goal_postures(problem(arm, start, target), target, "best")
    assert all(limits.within(goal) for goal in goals)
    np.testing.assert_allclose(arm.forward_kinematics(np.array(goals)), [target.position] * len(goals), atol=1e-9)
    changes = [np.abs(goal - start).sum() for goal in goals]
    assert changes == sorted(changes)
    if n < 3:
        assert changes[0] <= np.abs(there - start).sum() + 1e-6


def same(goals: list[Array], others: list[Array]) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(goals, others, strict=True))


def test_goals_of_redundant_arms_are_the_same_every_time_and_in_the_problems_own_ranges() -> None:
    arm = Arm("six", [0.3, 0.25, 0.2, 0.15, 0.1, 0.1], 1.0)
    target = FixedHand([0.5, 0.4], 1.0)
    one = problem(arm, np.full(6, 0.2), target)
    goals = goal_postures(one, target, "best")
    assert same(goals, goal_postures(one, target, "best"))
    assert len(goals) > 1
    np.testing.assert_allclose(np.cos(np.array(goals).sum(axis=1) - 1.0), 1.0, atol=1e-12)
    tight = replace(one, limits=JointLimits(angle=[1.6] * 6))
    assert all(np.abs(goal).max() <= 1.6 for goal in goal_postures(tight, target, "best"))
