"""What the Lagrange planner refuses, and what it keeps between the samples."""

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
    lagrange,
)

VERTICAL = replace(PLANAR_3R, gravity=9.81)
DOWN = np.array([-0.5 * np.pi, 0.0, 0.0])


def loads(problem: MotionProblem, motion: Trajectory) -> dict[str, float]:
    """Worst |value| / limit of each kind on a dense grid."""
    q, qd, qdd = motion.at(np.linspace(0.0, motion.duration, 20_001))
    tau, limits = problem.loaded_arm.inverse_dynamics(q, qd, qdd), problem.joint_limits
    values = {"torque": tau, "velocity": qd, "acceleration": qdd, "angle": q - limits.angle_middle}
    return {kind: float((np.abs(values[kind]) / limits.array(kind)).max()) for kind in values}  # type: ignore[arg-type]


def test_a_disc_on_the_way_of_a_belt_is_refused_with_who_avoids_discs() -> None:
    hand = np.array([-0.8, 1.732])
    free = MotionProblem(
        SCARA_1M, SCARA_1M.inverse_kinematics(hand)[0], MovingHand(hand - (0.1, 0.0), np.array([0.2, 0.0])), 3.0
    )
    ride = lagrange.plan(free)
    on_the_way = SCARA_1M.forward_kinematics(ride.q[-1])
    blocked = replace(free, obstacles=(Obstacle(on_the_way, np.zeros(2), 0.08),))
    with pytest.raises(Infeasible, match=r"touches an obstacle, .* mm deep at .* s") as refusal:
        lagrange.plan(blocked)
    assert refusal.value.reason == "collision"
    assert refusal.value.details["clearance"] < 0.0
    beside = replace(free, obstacles=(Obstacle(np.array([1.5, -1.5]), np.zeros(2), 0.08),))
    assert lagrange.plan(beside).clearance > 0.0


def test_nothing_exceeds_a_limit_just_before_the_rendezvous() -> None:
    target = MovingHand(np.array([-0.16544597, 0.89181124]), np.zeros(2))
    problem = MotionProblem(SCARA_50CM, np.array([1.273914928, 0.925407387]), target, 1.0)
    motion = lagrange.plan(problem)
    for kind, load in loads(problem, motion).items():
        assert load <= motion.limit_ratios[kind] + 1e-6 <= 1.0 + 2e-6


def test_a_motor_too_weak_for_gravity_is_named() -> None:
    weak = replace(VERTICAL, limits=JointLimits(torque=(5.0, 10.0, 5.0)))
    with pytest.raises(Infeasible, match=r"joint 1 needs 15\.7 N m against gravity to hold the target") as refusal:
        lagrange.plan(MotionProblem(weak, DOWN, FixedJoints(np.zeros(3)), 1.0))
    assert refusal.value.details["ratio"] == pytest.approx(15.696 / 5.0)
    pendulum = Arm("pendulum", (0.5,), (2.0,), JointLimits(torque=3.0, velocity=0.2), gravity=9.81)
    over = MotionProblem(pendulum, np.array([-0.5 * np.pi]), FixedJoints(np.array([0.5 * np.pi])), 1.0)
    with pytest.raises(Infeasible, match=r"needs 4\.905 N m against gravity to pass slowly on the straight way"):
        lagrange.plan(over)


def test_a_heavy_payload_is_named_too() -> None:
    goal = FixedJoints(np.zeros(3))
    assert lagrange.plan(MotionProblem(VERTICAL, DOWN, goal, 1.5)).limit_ratio <= 1.0
    with pytest.raises(
        Infeasible, match=r"joint 2 needs 26\.49 N m against gravity to hold the target, .* reduce the payload"
    ):
        lagrange.plan(MotionProblem(VERTICAL, DOWN, goal, 1.5, payload=3.0))


@pytest.mark.parametrize("elbow", ["best", "start", "+", "-"])
def test_a_target_on_the_rim_is_reached_with_any_elbow(elbow: str) -> None:
    rim = np.array([0.0, 1.0])
    for variant in ("optimal", "via"):
        problem = MotionProblem(SCARA_50CM, np.array([0.5, 1.0]), FixedHand(rim), 3.0)
        motion = lagrange.plan(problem, variant=variant, elbow=elbow)
        np.testing.assert_allclose(SCARA_50CM.forward_kinematics(motion.q[-1]), rim, atol=1e-9)
    with pytest.raises(Infeasible, match="straight or folded") as refusal:
        lagrange.plan(replace(problem, target=MovingHand(rim, np.zeros(2))), elbow=elbow)
    assert refusal.value.reason == "unreachable"


@pytest.mark.parametrize("links", [1, 2, 3, 4, 5, 6])
@pytest.mark.parametrize("variant", ["optimal", "via"])
def test_one_to_six_links_go_to_joint_angles_and_to_places_of_the_hand(links: int, variant: str) -> None:
    limits = JointLimits(torque=60.0, velocity=3.0, acceleration=10.0, angle=2.6)
    arm = Arm("chain", (1.0 / links,) * links, (1.0,) * links, limits)
    goal = np.full(links, -0.2)
    place = arm.forward_kinematics(goal)
    for target in (FixedJoints(goal), FixedHand(place)):
        problem = MotionProblem(arm, np.full(links, 0.3), target, 2.0)
        motion = lagrange.plan(problem, variant=variant)
        np.testing.assert_allclose(arm.forward_kinematics(motion.q[-1]), place, atol=1e-8)
        assert max(loads(problem, motion).values()) <= 1.0 + 1e-6


def test_the_least_time_is_found_from_a_tiny_horizon() -> None:
    problem = MotionProblem(SCARA_50CM, np.array([0.0, 0.5]), FixedJoints(np.array([1.0, 1.0])), 1e-3)
    with pytest.raises(Infeasible, match="allow at least") as refusal:
        lagrange.plan(problem)
    minimum = refusal.value.details["minimum_time"]
    assert lagrange.plan(replace(problem, horizon=minimum)).limit_ratio <= 1.0


def test_a_later_rendezvous_is_tried_where_the_chosen_one_fails() -> None:
    """The quick probe of the least time finds 1.315 s, in which no motion keeps the limits between its samples."""
    limits = JointLimits(
        velocity=(4.224987407373404, 1.2580078738520564, 4.643778410660804),
        jerk=(115.27401272433711, 83.82569695672416, 54.18536406430581),
    )
    lengths = 0.5191752830342246, 0.3636085150044166, 0.5905813102331076
    arm = Arm("arm", lengths, (2.5140796, 0.60915089, 1.39908519), limits, gravity=9.81)
    target = MovingHand((0.83569043, -0.0653228), (0.15611778, -0.02928711))
    problem = MotionProblem(arm, (0.33693446, 0.51922616, -1.99932711), target, 1.683170721943362)
    motion = lagrange.plan(problem)
    assert max(loads(problem, motion).values()) <= 1.0 + 1e-6
    riding = np.linspace(motion.rendezvous_time, motion.duration, 301)
    hands = arm.forward_kinematics(motion.at(riding)[0])
    np.testing.assert_allclose(hands, target.at(riding)[0], atol=1e-6)


@pytest.mark.parametrize(("horizon", "asked"), [(0.8, None), (3.0, 1.4)])
def test_the_time_that_a_late_rendezvous_is_refused_with_is_enough(horizon: float, asked: float | None) -> None:
    hand = np.array([-0.8, 1.732])
    moving = MovingHand(hand - (0.1, 0.0), np.array([0.2, 0.0]))
    problem = MotionProblem(SCARA_1M, SCARA_1M.inverse_kinematics(hand)[0], moving, horizon)
    with pytest.raises(Infeasible, match="allow at least") as refusal:
        lagrange.plan(problem, rendezvous_time=asked)
    minimum = refusal.value.details["minimum_time"]
    assert isinstance(minimum, float)
    for longer in (1.0, 1.001, 1.5):
        assert lagrange.plan(replace(problem, horizon=max(problem.horizon, longer * minimum))).limit_ratio <= 1.0
