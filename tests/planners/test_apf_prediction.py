"""`planners.apf.plan`: where the fields lead."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planners import (
    PLANAR_3R,
    SCARA_1M,
    SCARA_50CM,
    Arm,
    FixedHand,
    FixedJoints,
    Infeasible,
    JointLimits,
    MotionProblem,
    MovingHand,
    Obstacle,
    Trajectory,
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


def test_a_field_that_is_stuck_is_given_up_and_not_simulated_to_the_horizon() -> None:
    on_goal = Obstacle(GOAL.position, np.zeros(2), 0.1)
    with pytest.raises(Infeasible, match=r"local_minimum: after .* the arm rests 1\.42 m") as caught:
        apf.plan(MotionProblem(SCARA_50CM, START, GOAL, 1e6, obstacles=(on_goal,)))
    assert 10.0 < caught.value.details["time"] < 60.0  # type: ignore[operator]


def test_a_field_waits_for_a_disc_that_comes() -> None:
    """The goal is free once the disc has passed, after more periods at rest than a field gets without a disc."""
    passing = Obstacle(GOAL.position - [0.0, 0.1], np.array([0.0, 0.012]), 0.12)
    motion = apf.plan(MotionProblem(SCARA_50CM, START, GOAL, 200.0, obstacles=(passing,)), period=0.02)
    assert motion.rendezvous_time > 12.0
    assert motion.clearance >= 0.0


def test_more_periods_than_are_simulated_are_refused_with_a_period_that_is_long_enough() -> None:
    belt = MovingHand([0.3, 0.5], [1e-5, 0.0])
    problem = MotionProblem(SCARA_50CM, START, belt, 4000.0)
    with pytest.raises(
        Infeasible, match=r"200000 periods of 0\.02 s, more than 50000; .* longer period, 0\.08008 s"
    ) as caught:
        apf.plan(problem)
    assert caught.value.reason == "limits"


def test_the_first_contact_of_a_motion_is_the_one_that_is_named() -> None:
    """Contact is looked for in many periods together, and its time says in which."""
    slow = Obstacle(np.array([1.5, 0.05]), np.array([-0.4, 0.0]), 0.1)
    later = Obstacle(np.array([3.0, 0.05]), np.array([-0.4, 0.0]), 0.1)
    still = MotionProblem(SCARA_50CM, np.zeros(2), FixedJoints([0.0, 0.1]), 20.0)
    times = []
    for discs in ((slow,), (later, slow)):
        with pytest.raises(Infeasible, match="collision: after") as caught:
            apf.plan(replace(still, obstacles=discs))
        times.append(caught.value.details["time"])
    assert times[0] == times[1]
    assert times[0] < 5.0  # type: ignore[operator]


INDUSTRIAL = Arm(
    "three",
    (0.4, 0.3, 0.12),
    (6.0, 3.0, 1.0),
    JointLimits(torque=(60.0, 25.0, 10.0), velocity=(6.0, 8.0, 10.0), acceleration=(30.0, 40.0, 60.0), angle=2.6),
)


def worst_load(problem: MotionProblem, motion: Trajectory) -> float:
    """Worst |value| / limit on a dense grid, jerk by differences."""
    t = np.linspace(0.0, motion.duration, 30_001)
    q, qd, qdd = motion.at(t)
    limits = problem.joint_limits
    values = {
        "torque": problem.loaded_arm.inverse_dynamics(q, qd, qdd),
        "velocity": qd,
        "acceleration": qdd,
        "angle": q - limits.angle_middle,
    }
    if np.isfinite(limits.jerk).all():
        values["jerk"] = np.diff(qdd, axis=0) / t[1]
    return max(float((np.abs(array) / limits.array(kind)).max()) for kind, array in values.items())  # type: ignore[arg-type]


@pytest.mark.parametrize("acceleration", [(0.0, 0.0), (0.02, 0.01)])
def test_jerk_is_limited_on_the_continuous_motion(acceleration: tuple[float, float]) -> None:
    hand = SCARA_1M.inverse_kinematics([-0.8, 1.732])[0]
    part = MovingHand(np.array([-0.9, 1.732]), np.array([0.2, 0.0]), np.array(acceleration))
    problem = MotionProblem(SCARA_1M, hand, part, 3.0)
    motion = apf.plan(problem)
    assert worst_load(problem, motion) <= 1.0 + 1e-6
    assert 0.5 < motion.limit_ratios["jerk"] <= 1.0 + 1e-6
    riding = np.linspace(motion.rendezvous_time, 3.0, 500)
    distance = SCARA_1M.forward_kinematics(motion.at(riding)[0]) - part.at(riding)[0]
    assert np.hypot(*distance.T).max() <= 1.1e-3


def test_accelerations_that_are_held_jump_between_periods() -> None:
    motion = apf.plan(MotionProblem(SCARA_50CM, np.array([0.0, 1.0]), FixedHand(np.array([0.4, 0.4])), 3.0))
    assert (np.diff(motion.t) >= 0.0).all()
    assert not ((np.diff(motion.t) > 0.0) & (np.diff(motion.t) < 1e-6)).any()
    assert np.abs(motion.at(np.arange(45) / 50)[2]).max() <= 16.0


@pytest.mark.parametrize("horizon", [1.0, 3.0, 3.01])
def test_joint_targets_keep_velocities_and_accelerations(horizon: float) -> None:
    problem = MotionProblem(SCARA_50CM, np.array([0.2, 1.5]), FixedJoints(np.array([1.2, 0.8])), horizon)
    motion = apf.plan(problem)
    assert worst_load(problem, motion) <= 1.0 + 1e-6
    assert motion.duration == pytest.approx(horizon, rel=1e-12)


def test_limits_of_the_problem_are_kept() -> None:
    slow = replace(SCARA_50CM.limits, velocity=(0.8, 0.8))
    motion = apf.plan(MotionProblem(SCARA_50CM, START, GOAL, 8.0, limits=slow))
    assert np.abs(motion.qd).max() <= 0.8


def test_the_short_way_is_taken_across_half_a_turn() -> None:
    hand = FixedHand(SCARA_1M.forward_kinematics(np.array([3.2, 1.05])))
    limits = replace(SCARA_1M.limits, jerk=(np.inf, np.inf))
    motion = apf.plan(MotionProblem(SCARA_1M, np.array([3.1, 1.0]), hand, 20.0, limits=limits))
    assert motion.q[-1, 0] == pytest.approx(3.2, abs=0.01)
    bounded = replace(limits, angle=(3.15, 2.6))
    back = apf.plan(MotionProblem(SCARA_1M, np.array([3.1, 1.0]), hand, 60.0, limits=bounded))
    np.testing.assert_allclose(SCARA_1M.forward_kinematics(back.q[-1]), hand.position, atol=1e-3)
    assert back.limit_ratios["angle"] <= 1.0


def test_a_field_without_limits_of_velocity_never_ends_in_nan() -> None:
    generator, limits, solved = np.random.default_rng(5), JointLimits(torque=500.0), 0
    for _ in range(60):
        place = SCARA_1M.forward_kinematics(generator.uniform(-3.0, 3.0, 2))
        target = MovingHand(place, generator.uniform(-0.4, 0.4, 2))
        problem = MotionProblem(
            SCARA_1M, generator.uniform(-3.0, 3.0, 2), target, generator.uniform(0.5, 6.0), limits=limits
        )
        try:
            motion = apf.plan(problem)
        except Infeasible:
            continue
        solved += 1
        assert worst_load(problem, motion) <= 1.0 + 1e-6
    assert solved > 10


@pytest.mark.parametrize("jerk", [np.inf, 300.0])
def test_three_links_follow_a_part(jerk: float) -> None:
    q = np.array([0.5, 1.0, 0.2])
    target = MovingHand(INDUSTRIAL.forward_kinematics(q) + np.array([-0.05, 0.05]), np.array([-0.1, -0.05]))
    problem = MotionProblem(INDUSTRIAL, q, target, 3.0, limits=replace(INDUSTRIAL.limits, jerk=(jerk,) * 3))
    motion = apf.plan(problem)
    assert worst_load(problem, motion) <= 1.0 + 1e-6
    np.testing.assert_allclose(INDUSTRIAL.forward_kinematics(motion.q[-1]), target.at(3.0)[0], atol=1e-4)
    np.testing.assert_allclose(motion.q.sum(axis=1), q.sum(), atol=0.01)  # the last link hardly turns


def test_what_it_does_not_take_is_refused_with_who_does() -> None:
    with pytest.raises(ValueError, match=r"apf \(field\) keeps no jerk limits; .*lagrange \(optimal\)"):
        apf.plan(MotionProblem(SCARA_1M, START, GOAL, 3.0))
    with pytest.raises(ValueError, match=r"takes 2 links, and three has 3; .*lagrange \(via\)"):
        apf.plan(MotionProblem(INDUSTRIAL, np.array([0.5, 1.0, 0.2]), GOAL, 3.0))
    with pytest.raises(ValueError, match=r"1e\+05 s has 5000000 periods of 0\.02 s, more than 100000"):
        apf.plan(MotionProblem(PLANAR_3R, np.zeros(3), FixedJoints(np.ones(3)), 1e5))
    with pytest.raises(Infeasible, match=r"still 1\.\d+ rad from the target"):
        apf.plan(MotionProblem(SCARA_50CM, np.array([0.2, 1.5]), FixedJoints(np.array([1.6, 0.8])), 0.1))
