"""`planners.apf.plan`: where the fields lead."""

from __future__ import annotations

import numpy as np
import pytest

from planners import (
    PLANAR_3R,
    SCARA_1M,
    SCARA_50CM,
    FixedHand,
    FixedJoints,
    Infeasible,
    MotionProblem,
    MovingHand,
    Obstacle,
    apf,
    quintic,
)

START = np.array([-0.5, 1.0])
GOAL = FixedHand(np.array([-0.2, 0.8]))


def clearance_of(motion: object, problem: MotionProblem) -> float:
    t = np.arange(0.0, motion.duration, 0.001)  # type: ignore[attr-defined]
    q = motion.at(t)[0]  # type: ignore[attr-defined]
    gaps = [
        problem.arm.clearance(q, disc.position + t[:, None] * disc.velocity, disc.radius) for disc in problem.obstacles
    ]
    return float(np.min(gaps))


def test_it_goes_to_a_place_and_round_a_disc_that_comes() -> None:
    coming = Obstacle(np.array([0.9, 0.75]), np.array([-0.58, -0.16]), 0.1)
    problem = MotionProblem(SCARA_50CM, START, GOAL, 8.0, obstacles=(coming,))
    motion = apf.plan(problem)
    assert clearance_of(motion, problem) > 0.0
    assert motion.limit_ratio <= 1.0 + 1e-3
    np.testing.assert_allclose(SCARA_50CM.forward_kinematics(motion.q[-1]), GOAL.position, atol=1e-3)
    free = apf.plan(MotionProblem(SCARA_50CM, START, GOAL, 8.0))
    assert free.cost <= motion.cost
    assert clearance_of(free, problem) < 0.0


def test_it_rides_with_a_part_within_the_limits() -> None:
    hand = SCARA_1M.inverse_kinematics([-0.8, 1.732])[0]
    part = MovingHand(np.array([-0.9, 1.732]), np.array([0.2, 0.0]))
    motion = apf.plan(MotionProblem(SCARA_1M, hand, part, 3.0))
    assert motion.limit_ratio <= 1.0 + 1e-3
    assert motion.duration == pytest.approx(3.0)
    end = SCARA_1M.forward_kinematics(motion.q[-1])
    np.testing.assert_allclose(end, part.at(3.0)[0], atol=1e-4)


def test_it_rests_at_joint_angles_in_time() -> None:
    goal = np.array([1.0, -0.5, 0.3])
    problem = MotionProblem(PLANAR_3R, np.zeros(3), FixedJoints(goal), 1.5)
    motion = apf.plan(problem, period=0.005)
    np.testing.assert_allclose(motion.q[-1], goal, atol=1e-6)
    np.testing.assert_allclose(motion.qd[-1], 0.0, atol=1e-4)
    torque = np.trapezoid(np.abs(motion.tau).sum(axis=1), motion.t)
    assert torque < quintic.plan(problem).cost


def test_where_it_does_not_lead_there_it_says_why() -> None:
    on_goal = Obstacle(GOAL.position, np.zeros(2), 0.1)
    with pytest.raises(Infeasible, match="late: after 3 s the field is still"):
        apf.plan(MotionProblem(SCARA_50CM, START, GOAL, 3.0, obstacles=(on_goal,)))
    fast = Obstacle(np.array([0.9, 0.3]), np.array([0.0, -5.0]), 0.1)
    with pytest.raises(Infeasible, match="collision: after") as caught:
        apf.plan(MotionProblem(SCARA_50CM, START, GOAL, 8.0, obstacles=(fast,)))
    assert caught.value.details["clearance"] < 0.0
    with pytest.raises(ValueError, match="variant 'optimal' must be one of 'field', 'paper'"):
        apf.plan(MotionProblem(SCARA_50CM, START, GOAL, 3.0), variant="optimal")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"period 0\.0 s must be finite and positive"):
        apf.plan(MotionProblem(SCARA_50CM, START, GOAL, 3.0), period=0.0)
