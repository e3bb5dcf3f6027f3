"""The straight move against the closed form of a trapezoid, and the limits it keeps."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planners import (
    SCARA_50CM,
    Arm,
    FixedHand,
    FixedJoints,
    Infeasible,
    JointLimits,
    MotionProblem,
    MovingHand,
    Obstacle,
    trapezoid,
)

angles = st.floats(-2.5, 2.5)


def to_joints(start: object, end: object, horizon: float = 10.0) -> MotionProblem:
    limits = replace(SCARA_50CM.limits, torque=(math.inf, math.inf))
    target = FixedJoints(np.asarray(end, float))
    return MotionProblem(SCARA_50CM, np.asarray(start, float), target, horizon, limits=limits)


def test_a_long_and_a_short_move_take_the_time_of_the_closed_form() -> None:
    limits = SCARA_50CM.limits
    v, a = limits.velocity[0], limits.acceleration[0]
    assert trapezoid.plan(to_joints([0.0, 0.5], [2.0, 0.5])).duration == pytest.approx(2.0 / v + v / a)
    assert trapezoid.plan(to_joints([0.0, 0.5], [0.1, 0.5])).duration == pytest.approx(2.0 * math.sqrt(0.1 / a))


@settings(deadline=None)
@given(st.tuples(angles, angles), st.tuples(angles, angles))
def test_it_is_straight_ends_at_rest_and_keeps_the_limits_one_of_them_just(
    start: tuple[float, float], end: tuple[float, float]
) -> None:
    motion = trapezoid.plan(to_joints(start, end))
    change = np.subtract(end, start)
    np.testing.assert_allclose(motion.q[0], start, atol=1e-12)
    np.testing.assert_allclose(motion.q[-1], end, atol=1e-12)
    np.testing.assert_allclose(motion.qd[[0, -1]], 0.0, atol=1e-9)
    off_line = (motion.q[:, 0] - start[0]) * change[1] - (motion.q[:, 1] - start[1]) * change[0]
    np.testing.assert_allclose(off_line, 0.0, atol=1e-9)
    ratios = motion.limit_ratios
    assert max(ratios["velocity"], ratios["acceleration"]) <= 1.0 + 1e-9
    if np.abs(change).max() > 1e-3:
        assert max(ratios["velocity"], ratios["acceleration"]) == pytest.approx(1.0)


def test_the_samples_fit_together() -> None:
    motion = trapezoid.plan(to_joints([0.0, 0.5], [2.0, -1.0]))
    middle = 0.5 * (motion.t[1:] + motion.t[:-1])
    q, qd, qdd = motion.at(middle)
    smooth = np.diff(motion.t) > 0.0
    step = np.where(smooth, np.diff(motion.t), 1.0)[:, None]
    np.testing.assert_allclose((np.diff(motion.q, axis=0) / step)[smooth], qd[smooth], atol=1e-9)
    np.testing.assert_allclose((np.diff(motion.qd, axis=0) / step)[smooth], qdd[smooth], atol=1e-9)
    assert np.isfinite(q).all()


def test_weak_motors_make_it_slower() -> None:
    task = to_joints([0.0, 0.5], [2.0, 0.5])
    weak = replace(task, limits=replace(task.joint_limits, torque=(0.3, 0.3)))
    slow = trapezoid.plan(weak)
    assert slow.duration > trapezoid.plan(task).duration
    assert 0.8 < slow.limit_ratios["torque"] <= 1.0


def test_it_goes_through_an_obstacle_or_refuses() -> None:
    target = FixedHand(np.array([-0.2, 0.8]))
    free = MotionProblem(SCARA_50CM, np.array([-0.5, 1.0]), target, 8.0)
    parked = Obstacle(np.array([0.57, 0.64]), np.zeros(2), 0.1)
    guarded = MotionProblem(SCARA_50CM, np.array([-0.5, 1.0]), target, 8.0, obstacles=(parked,))
    through = trapezoid.plan(guarded, contact="delay")
    np.testing.assert_array_equal(through.q, trapezoid.plan(free).q)
    assert through.clearance < 0.0
    with pytest.raises(Infeasible, match="collision: the motion of trapezoid touches an obstacle"):
        trapezoid.plan(guarded)
    np.testing.assert_allclose(SCARA_50CM.forward_kinematics(trapezoid.plan(free).q[-1]), [-0.2, 0.8], atol=1e-9)


def test_a_moving_start_brakes_before_the_straight_move() -> None:
    moving, rest = (
        replace(to_joints([0.0, 0.5], [2.0, 0.9]), qd=np.array([-0.3, 0.1])),
        to_joints([0.0, 0.5], [2.0, 0.9]),
    )
    motion, slowest = trapezoid.plan(moving), 0.3 / SCARA_50CM.limits.acceleration[0]
    np.testing.assert_allclose(motion.q[[0, -1]], [[0.0, 0.5], [2.0, 0.9]], atol=1e-12)
    np.testing.assert_allclose(motion.qd[[0, -1]], [[-0.3, 0.1], [0.0, 0.0]], atol=1e-9)
    np.testing.assert_allclose(motion.at(slowest)[1], 0.0, atol=1e-9)
    assert motion.limit_ratio <= 1.0 + 1e-9
    assert trapezoid.plan(rest).duration < motion.duration < trapezoid.plan(rest).duration + 3.0 * slowest


def test_what_it_cannot_do_is_refused() -> None:
    with pytest.raises(Infeasible, match="late: the straight move takes"):
        trapezoid.plan(to_joints([0.0, 0.5], [2.0, 0.5], horizon=0.5))
    belt = MotionProblem(SCARA_50CM, np.zeros(2), MovingHand(np.array([0.5, 0.5]), np.zeros(2)), 3.0)
    with pytest.raises(ValueError, match=r"goes to a target of kind joints or hand, not moving hand; .* can"):
        trapezoid.plan(belt)
    bare = Arm("bare", [0.4, 0.3], 1.0, JointLimits(velocity=2.0))
    without = MotionProblem(bare, np.array([0.0, 0.5]), FixedJoints(np.array([0.0, 1.0])), 3.0)
    with pytest.raises(ValueError, match="needs a finite acceleration limit of every joint; give limits"):
        trapezoid.plan(without)
