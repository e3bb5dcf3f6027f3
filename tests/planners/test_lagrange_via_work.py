"""The searches of the dodging Lagrange planner end after a share of work, however many candidates there are."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from planners import Arm, FixedHand, FixedJoints, Infeasible, JointLimits, MotionProblem, Obstacle, lagrange
from planners.lagrange.via import planner


def long_arm(weakness: float) -> MotionProblem:
    """Six links that are too weak to move in time, with a disc far behind them."""
    arm = Arm("six", 6 * [0.3], 6 * [1.0], gravity=0.0)
    limits = JointLimits(velocity=6 * [2.0], acceleration=6 * [weakness * 5.0])
    disc = Obstacle(np.array([-2.5, 0.0]), np.zeros(2), 0.1)
    target = FixedJoints(np.full(6, 0.4))
    return MotionProblem(arm, np.full(6, -0.1), target, 3.0, limits=limits, obstacles=(disc,))


def processor_time(work: Callable[[], object]) -> float:
    """Of this process, s."""
    began = time.process_time()
    work()
    return time.process_time() - began


def test_the_work_bounds_the_time_of_a_refusal(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused() -> None:
        with pytest.raises(Infeasible, match=r"the joints take \d+"):
            lagrange.plan(long_arm(1e-6), variant="via")

    most = planner.MOST_WORK
    monkeypatch.setattr(planner, "MOST_WORK", 0.01 * most)
    refused()  # compiles
    little = processor_time(refused)
    monkeypatch.setattr(planner, "MOST_WORK", 0.1 * most)
    assert little < 0.5 * processor_time(refused)


def test_the_work_bounds_the_search_and_not_the_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """The direct way is among the first candidates, so that little work still finds a motion in free space."""
    whole = lagrange.plan(long_arm(1.0), variant="via")
    monkeypatch.setattr(planner, "MOST_WORK", 1e6)
    hurried = lagrange.plan(long_arm(1.0), variant="via")
    assert hurried.limit_ratio <= 1.0
    assert whole.cost <= hurried.cost <= 1.5 * whole.cost


def test_every_goal_posture_gets_its_share_of_the_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """The way to the nearer posture is blocked; candidates of the other one are tried too."""
    monkeypatch.setattr(planner, "MOST_WORK", 4e5)
    q = np.array([2.0, -0.1])
    arm = Arm("two", [0.4, 0.4], [1.0, 1.0], gravity=0.0, link_radius=0.02)
    limits = JointLimits(velocity=[2.0, 2.0], acceleration=[5.0, 5.0], angle=[3.0, 3.0])
    hand = FixedHand(np.array([-0.1, 0.6]))
    postures = arm.inverse_kinematics(hand.position)
    nearer = postures[int(np.argmin(np.abs(postures - q).sum(axis=1)))]
    elbow = 0.4 * np.array([np.cos(nearer[0]), np.sin(nearer[0])])
    disc = Obstacle(elbow, np.zeros(2), 0.05)
    motion = lagrange.plan(MotionProblem(arm, q, hand, 8.0, limits=limits, obstacles=(disc,)), variant="via")
    assert np.abs(motion.q[-1] - nearer).max() > 0.5
    assert motion.clearance >= 0.0


def test_two_links_among_discs_need_a_hundredth_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    arm = Arm("two", [0.5, 0.5], [2.0, 2.0], gravity=0.0, link_radius=0.03)
    limits = JointLimits(torque=[20.0, 10.0], velocity=[2.4, 2.4], acceleration=[4.5, 8.0])
    disc = Obstacle(np.array([1.25, 0.3]), np.array([-0.6, 0.0]), 0.1)
    problem = MotionProblem(arm, np.array([-0.9, 1.0]), FixedJoints([0.6, 1.0]), 8.0, limits=limits, obstacles=(disc,))
    first = lagrange.plan(problem, variant="via", contact="delay")
    monkeypatch.setattr(planner, "MOST_WORK", 0.01 * planner.MOST_WORK)
    np.testing.assert_array_equal(first.q, lagrange.plan(problem, variant="via", contact="delay").q)


def test_a_refusal_names_a_time_only_where_no_search_has_ended_early(monkeypatch: pytest.MonkeyPatch) -> None:
    arm = Arm("two", [0.5, 0.5], [2.0, 2.0], gravity=0.0, link_radius=0.03)
    limits = JointLimits(velocity=[2.4, 2.4], acceleration=[4.5, 8.0])
    late = MotionProblem(arm, np.array([-0.9, 1.0]), FixedJoints([0.6, 1.0]), 0.3, limits=limits)
    with pytest.raises(Infeasible, match="are enough") as refusal:
        lagrange.plan(late, variant="via")
    enough = refusal.value.details["minimum_time"]
    assert isinstance(enough, float)
    for longer in (1.0, 1.001, 2.0):
        assert lagrange.plan(replace(late, horizon=longer * enough), variant="via").duration <= longer * enough
    monkeypatch.setattr(planner, "MOST_WORK", 2e4)
    with pytest.raises(Infeasible, match="allow more time") as refusal:
        lagrange.plan(late, variant="via")
    assert "minimum_time" not in refusal.value.details
