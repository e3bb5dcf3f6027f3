"""The dodging Lagrange planner, by what its plans do."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.interpolate import BarycentricInterpolator

from planners import (
    PLANAR_3R,
    SCARA_50CM,
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
from planners.lagrange.interpolation import lobatto_nodes
from planners.lagrange.via.candidates import CONTACT
from planners.lagrange.via.curve import interpolate
from planners.typing import Array

LIMITS = JointLimits(torque=(10.0, 4.0), velocity=(2.4, 2.4), acceleration=(4.5, 8.0), angle=SCARA_50CM.limits.angle)
START = np.array([-0.9, 1.0])
GOAL = np.array([0.6, 1.0])
MARGIN, PREDICTION = 0.03, 1.6


def move(*obstacles: Obstacle, **changes: Any) -> MotionProblem:
    """A turn of the first joint, with discs in the way."""
    problem = MotionProblem(SCARA_50CM, START, FixedJoints(GOAL), 8.0, limits=LIMITS, obstacles=obstacles)
    return replace(problem, **changes)


def disc(x: float, y: float, vx: float = 0.0, vy: float = 0.0, radius: float = 0.1) -> Obstacle:
    return Obstacle(np.array([x, y]), np.array([vx, vy]), radius)


def predicted_clearance(problem: MotionProblem, plan: Trajectory, until: float = PREDICTION) -> Array:
    """Clearance from the nearest obstacle every 2 ms; the arm stays where the plan ends."""
    t = np.arange(0.0, until, 0.002)
    q = plan.at(t)[0]
    return np.min(
        [problem.arm.clearance(q, o.position + t[:, None] * o.velocity, o.radius) for o in problem.obstacles], axis=0
    )


def contact_predicted(plan: Trajectory) -> bool:
    return plan.cost >= CONTACT


def assert_sound(problem: MotionProblem, plan: Trajectory) -> None:
    """Start met, end at rest, and all limits kept, on a grid denser than the plan's own."""
    np.testing.assert_allclose(plan.q[0], problem.q, atol=1e-12)
    np.testing.assert_allclose(plan.qd[0], problem.start[1], atol=1e-12)
    np.testing.assert_allclose(plan.qd[-1], 0.0, atol=1e-10)
    assert plan.duration <= problem.horizon
    assert plan.limit_ratio <= 1.0
    t = np.linspace(0.0, plan.duration, 2001)
    q, qd, qdd = plan.at(t)
    tau = problem.loaded_arm.inverse_dynamics(q, qd, qdd)
    for kind, values in {"torque": tau, "velocity": qd, "acceleration": qdd, "angle": q}.items():
        assert (np.abs(values) <= getattr(problem.joint_limits, kind)).all(), kind


def trapezoid_time(change: Array) -> float:
    """Least time from rest to rest when nothing but velocity and acceleration is limited, in closed form."""
    top, rise = np.array(LIMITS.velocity), np.array(LIMITS.acceleration)
    way = np.abs(change)
    return float(np.where(way < top**2 / rise, 2.0 * np.sqrt(way / rise), way / top + top / rise).max())


@given(st.integers(0, 2**32 - 1))
@settings(deadline=None)
def test_interpolant_is_scipys(seed: int) -> None:
    generator = np.random.default_rng(seed)
    q, qd, end, duration = *generator.normal(size=(3, 2)), generator.uniform(0.2, 4.0)
    c = np.empty((2, 6))
    interpolate(q, qd, end, generator.normal(size=(2, 2)), duration, c)
    nodes, s = lobatto_nodes(5), np.linspace(0.0, 1.0, 41)
    for joint in range(2):
        polynomial = np.polynomial.Polynomial(c[joint])
        expected = BarycentricInterpolator(nodes, polynomial(nodes))(s)
        np.testing.assert_allclose(polynomial(s), expected, atol=1e-11)
        rate = polynomial.deriv()
        found = [polynomial(0.0), rate(0.0) / duration, polynomial(1.0), rate(1.0)]
        np.testing.assert_allclose(found, [q[joint], qd[joint], end[joint], 0.0], atol=1e-11)


def test_undisplaced_interpolant_is_the_cubic() -> None:
    q, qd, end, duration = np.array([0.3]), np.array([-0.7]), np.array([1.1]), 1.7
    c = np.empty((1, 6))
    interpolate(q, qd, end, np.zeros((2, 1)), duration, c)
    rate, change = qd[0] * duration, end[0] - q[0]
    np.testing.assert_allclose(c[0], [q[0], rate, 3 * change - 2 * rate, rate - 2 * change, 0, 0], atol=1e-12)


@given(
    start=st.tuples(st.floats(-2.5, 2.5), st.floats(-2.3, 2.3)),
    goal=st.tuples(st.floats(-2.5, 2.5), st.floats(-2.3, 2.3)),
)
@settings(deadline=None, max_examples=40)
def test_without_obstacles_it_is_nearly_as_quick_as_can_be(
    start: tuple[float, float], goal: tuple[float, float]
) -> None:
    change = np.array(goal) - start
    assume(np.abs(change).max() > 0.2)
    problem = move(q=np.array(start), target=FixedJoints(np.array(goal)))
    plan = lagrange.plan(problem, variant="via")
    assert_sound(problem, plan)
    np.testing.assert_allclose(plan.q[-1], goal, atol=1e-10)
    assert plan.rendezvous_time == plan.duration
    assert trapezoid_time(change) <= plan.duration <= 1.35 * trapezoid_time(change)


def test_hand_target_is_met_with_the_nearer_elbow() -> None:
    problem = move(target=FixedHand(SCARA_50CM.forward_kinematics(GOAL)))
    plan = lagrange.plan(problem, variant="via")
    assert_sound(problem, plan)
    np.testing.assert_allclose(plan.q[-1], GOAL, atol=1e-9)
    other = lagrange.plan(problem, variant="via", elbow="-")
    np.testing.assert_allclose(SCARA_50CM.forward_kinematics(other.q[-1]), problem.target.position, atol=1e-9)
    assert other.q[-1, 1] < 0.0


def test_start_in_motion_goes_on_without_a_jump() -> None:
    problem = move(disc(0.9, 0.0), q=np.array([-0.6, 1.0]), qd=np.array([1.5, -1.0]))
    plan = lagrange.plan(problem, variant="via", contact="delay")
    assert_sound(problem, plan)


def test_a_disc_that_crosses_is_avoided_with_the_margin() -> None:
    problem = move(disc(1.25, 0.3, -0.6, 0.0))
    straight = lagrange.plan(move(), variant="via")
    assert predicted_clearance(problem, straight).min() < 0.0
    plan = lagrange.plan(problem, variant="via")
    assert_sound(problem, plan)
    assert predicted_clearance(problem, plan).min() >= MARGIN


def test_a_parked_disc_is_gone_round() -> None:
    problem = move(disc(0.75, 0.3))
    straight = lagrange.plan(move(), variant="via")
    assert predicted_clearance(problem, straight, 3.0).min() < 0.0
    plan = lagrange.plan(problem, variant="via", prediction=3.0)
    assert_sound(problem, plan)
    np.testing.assert_allclose(plan.q[-1], GOAL, atol=1e-10)
    assert predicted_clearance(problem, plan, 3.0).min() >= MARGIN


def test_a_disc_that_passes_over_the_goal_is_waited_for() -> None:
    """It would get there as the arm holds the goal, and is gone a little later."""
    x, y = SCARA_50CM.forward_kinematics(GOAL)
    problem = move(disc(x + 0.5, y + 0.5, -0.4, -0.4), q=GOAL - (0.3, 0.3))
    plan = lagrange.plan(problem, variant="via", contact="delay", prediction=2.0, hold=2.0)
    assert_sound(problem, plan)
    assert math.isinf(plan.rendezvous_time)
    assert predicted_clearance(problem, plan, 2.0).min() >= MARGIN


def test_contact_that_cannot_be_avoided_is_refused_or_delayed() -> None:
    elbow = SCARA_50CM.joint_positions(START)[1]
    problem = move(disc(elbow[0] + 0.16, elbow[1], -1.0, 0.0))
    with pytest.raises(Infeasible, match="touches an obstacle") as refusal:
        lagrange.plan(problem, variant="via")
    assert refusal.value.reason == "collision"
    assert refusal.value.details["clearance"] < 0.0
    plan = lagrange.plan(problem, variant="via", contact="delay")
    assert_sound(problem, plan)
    assert contact_predicted(plan)
    with pytest.raises(ValueError, match="contact 'never' must be one of 'refuse', 'delay'"):
        lagrange.plan(problem, variant="via", contact="never")


def test_a_motion_slows_down_for_a_disc_that_leaves_late() -> None:
    """It stands before the goal for four seconds, twice as long as discs are predicted for planning again."""
    hand = SCARA_50CM.forward_kinematics(GOAL)
    late = disc(*(hand - (0.0, 4.0 * 0.15)), 0.0, 0.15, radius=0.12)
    problem = move(late, target=FixedHand(hand), q=GOAL - (1.2, 0.0), horizon=12.0)
    plan = lagrange.plan(problem, variant="via")
    assert_sound(problem, plan)
    assert predicted_clearance(problem, plan, plan.duration).min() >= 0.0


def test_discs_slide_around_the_base_they_keep_out_of() -> None:
    """Straight on, this disc would go through the base; it cannot be dodged there."""
    problem = move(disc(-0.5, 0.0, 1.0, 0.0), q=np.array([0.5, 0.5]), target=FixedJoints(np.array([0.9, 0.5])))
    options: dict[str, Any] = {"variant": "via", "contact": "delay"}
    assert contact_predicted(lagrange.plan(problem, **options))
    assert not contact_predicted(lagrange.plan(problem, **options, keep_out=0.32))


@given(seed=st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=100)
def test_plans_are_sound_and_free_of_predicted_contact_unless_they_say_otherwise(seed: int) -> None:
    generator = np.random.default_rng(seed)
    q, qd = generator.uniform(-2.0, 2.0, 2), generator.uniform(-1.5, 1.5, 2)
    position = generator.uniform(0.3, 1.2) * np.array([math.cos(a := generator.uniform(-np.pi, np.pi)), math.sin(a)])
    obstacles = (Obstacle(position, generator.uniform(-0.7, 0.7, 2), 0.1),)
    assume(SCARA_50CM.clearance(q, position, 0.1) > 0.1)
    hand = SCARA_50CM.forward_kinematics(generator.uniform(-2.0, 2.0, 2))
    problem = move(*obstacles, q=q, qd=qd, target=FixedHand(hand))
    plan = lagrange.plan(problem, variant="via", contact="delay")
    assert_sound(problem, plan)
    if math.isfinite(plan.rendezvous_time):
        np.testing.assert_allclose(SCARA_50CM.forward_kinematics(plan.q[-1]), hand, atol=1e-9)
        until = min(PREDICTION, plan.duration + 0.4)
    else:
        until = PREDICTION
    if not contact_predicted(plan):
        assert predicted_clearance(problem, plan, until).min() >= 0.0
    try:
        solved = lagrange.plan(problem, variant="via")
    except Infeasible:
        return
    assert_sound(problem, solved)
    np.testing.assert_allclose(SCARA_50CM.forward_kinematics(solved.q[-1]), hand, atol=1e-9)
    assert predicted_clearance(problem, solved, solved.duration).min() >= 0.0
    assert solved.clearance >= 0.0


@pytest.mark.parametrize("share", [0.99, 0.995, 1.0, -0.997])
def test_the_ends_of_the_joint_ranges_are_reached(share: float) -> None:
    angle = np.array(LIMITS.angle)
    goal = np.array([0.0, share * angle[1]])
    plan = lagrange.plan(move(q=np.array([0.0, 2.0]), target=FixedJoints(goal)), variant="via")
    np.testing.assert_allclose(plan.q[-1], goal, atol=1e-12)
    assert plan.limit_ratios["angle"] <= 1.0 + 1e-9
    back = lagrange.plan(move(q=goal, target=FixedJoints(np.array([0.0, 2.0]))), variant="via")
    assert back.limit_ratios["angle"] <= 1.0 + 1e-9


def test_a_target_beyond_the_joint_range_is_refused_with_the_range() -> None:
    with pytest.raises(Infeasible, match=r"joint 2 at 2\.9 rad; the joint ranges are \+-2\.88") as refusal:
        lagrange.plan(move(target=FixedJoints(np.array([0.5, 2.9]))), variant="via")
    assert refusal.value.reason == "limits"


def test_planning_again_on_the_way_arrives_no_later() -> None:
    """Each plan goes on from the last, and the whole takes hardly longer than the first one said."""
    problem = move(disc(1.25, 0.3, -0.6, 0.0))
    plan = first = lagrange.plan(problem, variant="via")
    t = 0.0
    while plan.duration > 0.25:
        t += 0.1
        q, qd, _ = plan.at(0.1)
        obstacle = disc(1.25 - 0.6 * t, 0.3, -0.6, 0.0)
        plan = lagrange.plan(replace(problem, q=q, qd=qd, obstacles=(obstacle,)), variant="via", contact="delay")
        assert t < 2.0 * first.duration
    np.testing.assert_allclose(plan.q[-1], GOAL, atol=1e-10)
    assert t + plan.duration <= 1.1 * first.duration + 0.1


def test_plans_are_the_same_every_time() -> None:
    problem = move(disc(1.25, 0.3, -0.6, 0.0))
    first, second = (lagrange.plan(problem, variant="via") for _ in range(2))
    np.testing.assert_array_equal(first.q, second.q)


def test_three_links_dodge_too() -> None:
    arm = replace(PLANAR_3R, link_radius=0.02)
    q, goal = np.array([-0.6, 0.5, 0.3]), np.array([0.6, 0.5, 0.3])
    limits = replace(arm.limits, velocity=(2.0,) * 3, acceleration=(5.0,) * 3)
    problem = MotionProblem(arm, q, FixedJoints(goal), 6.0, limits=limits, obstacles=(disc(0.7, 0.2, radius=0.05),))
    plan = lagrange.plan(problem, variant="via", prediction=3.0)
    assert_sound(problem, plan)
    assert predicted_clearance(problem, plan, 3.0).min() >= 0.0
    assert not contact_predicted(plan)


@pytest.mark.parametrize("share", [0.4, 1.01])
def test_too_little_time_is_refused_with_the_time_needed(share: float) -> None:
    with pytest.raises(Infeasible, match="s are enough") as refusal:
        lagrange.plan(move(horizon=share * trapezoid_time(GOAL - START)), variant="via")
    assert refusal.value.reason == "late"
    assert refusal.value.details["at_least"] == pytest.approx(trapezoid_time(GOAL - START), rel=0.02)
    enough = refusal.value.details["minimum_time"]
    assert lagrange.plan(move(horizon=enough), variant="via").duration <= enough


def test_a_start_that_must_leave_the_joint_range_is_refused() -> None:
    with pytest.raises(Infeasible) as refusal:
        lagrange.plan(move(q=np.array([2.87, 0.0]), qd=np.array([2.0, 0.0])), variant="via")
    assert refusal.value.reason == "start"


def test_a_target_out_of_reach_is_refused() -> None:
    with pytest.raises(Infeasible) as refusal:
        lagrange.plan(move(target=FixedHand(np.array([1.5, 0.0]))), variant="via")
    assert refusal.value.reason == "unreachable"


@pytest.mark.parametrize("option", ["margin", "prediction", "keep_out", "hold"])
def test_options_out_of_range_are_refused(option: str) -> None:
    with pytest.raises(ValueError, match=option):
        lagrange.plan(move(), variant="via", **{option: -1.0})


def test_missing_limits_are_refused() -> None:
    with pytest.raises(ValueError, match="needs a finite velocity limit"):
        lagrange.plan(MotionProblem(PLANAR_3R, np.zeros(3), FixedJoints(np.ones(3)), 2.0), variant="via")


def test_a_moving_target_is_refused() -> None:
    with pytest.raises(ValueError, match=r"not moving hand; .*lagrange \(optimal\)"):
        lagrange.plan(move(target=MovingHand(np.array([0.5, 0.5]), np.zeros(2))), variant="via")
