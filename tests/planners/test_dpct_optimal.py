from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from dpct_cases import HAND, conveyor
from hypothesis import given, settings
from hypothesis import strategies as st

from planners import (
    PLANAR_3R,
    SCARA_1M,
    FixedHand,
    FixedJoints,
    Infeasible,
    JointLimits,
    MotionProblem,
    MovingHand,
    Trajectory,
    dpct,
)
from planners.motion.line import reduce_to_line
from planners.motion.rides import ride_windows

LINE_END = 0.4
TORQUE_ONLY = JointLimits(torque=SCARA_1M.limits.torque)
KINDS = ("torque", "velocity", "acceleration", "jerk", "angle")


def worst_ratios(problem: MotionProblem, plan: Trajectory) -> dict[str, float]:
    """Limit ratios from the joint angles alone: derivatives by differences, torque from those."""
    limits = problem.joint_limits
    meeting = plan.rendezvous_time
    edges = np.linspace(0.0, meeting, 4001 if meeting > 0.0 else 1)
    if plan.duration > meeting + 1e-6:
        edges = np.append(edges, np.linspace(meeting, plan.duration, 501)[1:])
    before, after, h = edges[:-1], edges[1:], np.diff(edges)[:, None]
    q, qd, qdd = plan.at(0.5 * (before + after))
    rate = (plan.at(after)[0] - plan.at(before)[0]) / h
    np.testing.assert_allclose(rate, qd, atol=1e-3 * np.abs(qd).max() + 1e-7)
    tau = problem.loaded_arm.inverse_dynamics(q, rate, (plan.at(after)[1] - plan.at(before)[1]) / h)
    apart = np.diff(plan.t) > 1e-6
    jerk = np.diff(plan.qdd, axis=0)[apart] / np.diff(plan.t)[apart, None]
    motion = {"torque": tau, "velocity": rate, "acceleration": qdd, "jerk": jerk, "angle": q}
    return {kind: float(np.max(np.abs(x) / np.array(getattr(limits, kind)))) for kind, x in motion.items()}


def end_error(problem: MotionProblem, plan: Trajectory) -> float:
    """Largest distance of hand and target from the rendezvous on, m."""
    assert isinstance(problem.target, MovingHand)
    riding = plan.t >= plan.rendezvous_time - 1e-9
    hand = problem.arm.forward_kinematics(plan.q[riding])
    return float(np.abs(hand - problem.target.at(plan.t[riding])[0]).max())


def assert_sound(problem: MotionProblem, plan: Trajectory) -> None:
    assert plan.t[0] == 0.0
    assert (np.diff(plan.t) >= 0.0).all()
    assert plan.duration == pytest.approx(min(problem.horizon, plan.rides_until))
    assert plan.limit_ratio <= 1.0
    for kind, ratio in worst_ratios(problem, plan).items():
        assert ratio <= 1.0 + 1e-4, kind  # differences of interpolated samples are good to this
        assert ratio == pytest.approx(plan.limit_ratios[kind], abs=0.1), kind  # short peaks are blunted
    np.testing.assert_allclose(plan.q[0], problem.q, atol=5e-6)  # up to 1e-6 m from the part counts as with it
    np.testing.assert_allclose(plan.qd[0], problem.start[1], atol=5e-6)


def plan_or_reason(problem: MotionProblem, **options: Any) -> Trajectory | str:
    try:
        return dpct.plan(problem, **options)
    except Infeasible as refusal:
        return refusal.reason


# the paper's scenario


@pytest.mark.parametrize(
    ("limits", "options", "latest"),
    [
        (TORQUE_ONLY, {"free_initial_acceleration": True}, 0.845),
        (SCARA_1M.limits, {}, 1.60),
        (SCARA_1M.limits, {"free_initial_acceleration": True}, 1.125),
        (TORQUE_ONLY, {"free_initial_acceleration": True, "elbow": "-"}, 0.665),
        (SCARA_1M.limits, {"elbow": "best"}, 1.475),
    ],
)
def test_rendezvous_of_the_papers_cases(limits: JointLimits, options: dict[str, Any], latest: float) -> None:
    problem = conveyor(limits=limits)
    plan = dpct.plan(problem, **options)
    assert 0.9 * latest < plan.rendezvous_time <= latest
    assert end_error(problem, plan) <= 1e-6
    assert plan.limit_ratio <= 1.0
    assert max(worst_ratios(problem, plan).values()) <= 1.0 + 1e-4
    if "elbow" not in options:
        assert_sound(problem, plan)


def test_no_rendezvous_is_earlier_than_the_proven_minimum() -> None:
    """0.8419 s is the minimum under the torque limits of eq 36 for a hand that does not move backwards."""
    plan = dpct.plan(conveyor(limits=TORQUE_ONLY), free_initial_acceleration=True, stages=120)
    assert 0.8417 <= plan.rendezvous_time <= 0.8432


def test_a_physical_start_has_no_jump_of_acceleration() -> None:
    plan = dpct.plan(conveyor())
    np.testing.assert_allclose(plan.qdd[0], 0.0, atol=1e-9)
    free = dpct.plan(conveyor(), free_initial_acceleration=True)
    assert np.abs(free.qdd[0]).max() > 0.1
    assert free.rendezvous_time < plan.rendezvous_time


@pytest.mark.parametrize(("time", "index"), [(1.0, 0.0581), (1.2, 0.0545), (3.0, 0.0512)])
def test_tracking_index_at_a_given_time(time: float, index: float) -> None:
    plan = dpct.plan(conveyor(limits=TORQUE_ONLY), rendezvous_time=time, free_initial_acceleration=True, stages=100)
    assert plan.rendezvous_time == time
    assert plan.cost == pytest.approx(index, rel=5e-3)


def test_cost_is_the_papers_index_of_the_samples() -> None:
    problem = conveyor()
    plan = dpct.plan(problem)
    assert isinstance(problem.target, MovingHand)
    position, velocity = problem.target.at(plan.t)
    hand = problem.arm.forward_kinematics(plan.q)
    speed = np.einsum("tij,tj->ti", problem.arm.jacobian(plan.q), plan.qd)
    square = ((hand - position)[:, 0] ** 2 + (speed - velocity)[:, 0] ** 2) / 0.5**2
    assert plan.cost == pytest.approx(np.trapezoid(square, plan.t), rel=1e-3)


def test_time_weight_trades_time_for_index() -> None:
    plans = [dpct.plan(conveyor(limits=TORQUE_ONLY), time_weight=weight) for weight in (10.0, 0.1, 0.02)]
    times, costs = [plan.rendezvous_time for plan in plans], [plan.cost for plan in plans]
    assert times == sorted(times)
    assert costs == sorted(costs, reverse=True)
    for weight, plan in zip((0.1, 0.02), plans[1:], strict=True):
        for other in (0.98, 1.1):
            time = other * plan.rendezvous_time
            alternative = dpct.plan(conveyor(limits=TORQUE_ONLY), rendezvous_time=time)
            assert weight * plan.rendezvous_time + plan.cost <= weight * time + alternative.cost + 1e-5


def test_reverse_may_be_allowed() -> None:
    problem = conveyor(lead=0.2, speed=0.1, horizon=5.0)
    forward, free = dpct.plan(problem), dpct.plan(problem, allow_reverse=True)
    assert free.rendezvous_time < forward.rendezvous_time - 0.3
    assert_sound(problem, free)
    x = problem.arm.forward_kinematics(forward.q)[:, 0]
    assert (np.maximum.accumulate(x) - x).max() < 1e-5


FEASIBLE = {
    0.10: (2.88, 2.17, 1.28, 1.30, 2.30),
    0.20: (4.82, 4.31, 3.52, 1.60, 1.62),
    0.25: (None, None, None, 4.26, 2.36),
    0.30: (None,) * 5,
}
LEADS = (-0.2, -0.1, 0.0, 0.1, 0.2)


@pytest.mark.parametrize(
    ("speed", "lead", "expected"),
    [(speed, lead, time) for speed, row in FEASIBLE.items() for lead, time in zip(LEADS, row, strict=True)],
)
def test_what_is_feasible(speed: float, lead: float, expected: float | None) -> None:
    """The part leaves the line at x = 0.4 m; the expected times are of an independent solution with 40 stages."""
    problem = conveyor(lead=lead, speed=speed, horizon=(LINE_END - HAND[0] + lead) / speed)
    if expected is None:
        with pytest.raises(Infeasible, match="late") as caught:
            dpct.plan(problem)
        assert caught.value.reason == "late"
    else:
        plan = dpct.plan(problem)
        assert plan.rendezvous_time == pytest.approx(expected, abs=0.03)
        assert end_error(problem, plan) <= 1e-6


# any belt


@given(
    lead=st.floats(-0.2, 0.2),
    speed=st.floats(-0.3, 0.3),
    acceleration=st.just(0.0) | st.floats(-0.05, 0.05),
    horizon=st.floats(1.0, 6.0),
    elbow=st.integers(0, 1),
    limited=st.booleans(),
    free=st.booleans(),
)
@settings(max_examples=60, deadline=None)
def test_any_belt_is_planned_within_limits_or_refused_with_a_reason(
    lead: float, speed: float, acceleration: float, horizon: float, elbow: int, limited: bool, free: bool
) -> None:
    limits = SCARA_1M.limits if limited else TORQUE_ONLY
    problem = conveyor(lead, speed, acceleration, horizon, limits, elbow)
    plan = plan_or_reason(problem, free_initial_acceleration=free)
    if isinstance(plan, str):
        assert plan in {"late", "no_window", "unreachable"}
    else:
        assert_sound(problem, plan)
        assert end_error(problem, plan) <= 1e-6


@given(
    q=st.tuples(st.floats(-3.0, 3.0), st.floats(0.5, 2.3), st.floats(-2.0, 2.0)),
    heading=st.floats(-3.1, 3.1),
    offset=st.floats(-0.05, 0.05),
    speed=st.floats(0.02, 0.3),
    gravity=st.sampled_from([0.0, 9.81]),
    payload=st.sampled_from([0.0, 0.5]),
)
@settings(max_examples=25, deadline=None)
def test_three_links_and_weight(
    q: tuple[float, ...], heading: float, offset: float, speed: float, gravity: float, payload: float
) -> None:
    limits = JointLimits(torque=(40.0, 20.0, 5.0), velocity=(2.0,) * 3, acceleration=(20.0,) * 3, jerk=(300.0,) * 3)
    arm = replace(PLANAR_3R, gravity=gravity)
    direction = np.array([np.cos(heading), np.sin(heading)])
    target = MovingHand(arm.forward_kinematics(np.array(q)) + offset * direction, speed * direction)
    problem = MotionProblem(arm, np.array(q), target, 1.5, limits=limits, payload=payload)
    plan = plan_or_reason(problem)
    if isinstance(plan, str):
        assert plan in {"late", "no_window", "unreachable", "start"}
    else:
        assert_sound(problem, plan)
        assert end_error(problem, plan) <= 1e-6
        np.testing.assert_allclose(plan.q.sum(axis=1), sum(q), atol=1e-9)


@pytest.mark.parametrize(
    ("offset", "velocity", "acceleration"),
    [(0.1, -0.05, 0.0), (0.1, 0.0, 0.0), (-0.1, 0.0, 0.0), (0.1, 0.0, -0.02), (0.0, 0.0, 0.05), (0.0, 0.1, -0.05)],
)
def test_reversed_standing_and_accelerating_parts(offset: float, velocity: float, acceleration: float) -> None:
    problem = conveyor(-offset, velocity, acceleration, horizon=4.0)
    plan = dpct.plan(problem)
    assert_sound(problem, plan)
    assert end_error(problem, plan) <= 1e-6


def test_the_ride_ends_with_its_window() -> None:
    problem = conveyor(limits=SCARA_1M.limits, horizon=20.0)
    plan = dpct.plan(problem)
    (window,) = [window for window in ride_windows(reduce_to_line(problem)) if window.opens < plan.rendezvous_time]
    assert plan.rides_until == plan.duration == window.closes < 20.0
    assert window.opens <= plan.rendezvous_time
    assert plan.limit_ratio > 0.999


def test_replanning_on_the_way_changes_nothing() -> None:
    """The principle of optimality: the rest of the best motion is the best motion from there."""
    problem = conveyor()
    plan = dpct.plan(problem)
    for t in (0.2, 0.6, 1.0, 1.4):
        q, qd, qdd = plan.at(t)
        assert isinstance(problem.target, MovingHand)
        rest = replace(problem, q=q, qd=qd, qdd=qdd, target=MovingHand(*problem.target.at(t)), horizon=3.0 - t)
        again = dpct.plan(rest)
        assert t + again.rendezvous_time == pytest.approx(plan.rendezvous_time, abs=0.004)
        assert again.limit_ratio <= 1.0
        np.testing.assert_allclose(again.qdd[0], qdd, atol=1e-6)


def test_a_hand_that_is_with_the_part_rides_at_once() -> None:
    problem = conveyor()
    plan = dpct.plan(problem)
    q, qd, qdd = plan.at(2.0)
    assert isinstance(problem.target, MovingHand)
    riding = replace(problem, q=q, qd=qd, qdd=qdd, target=MovingHand(*problem.target.at(2.0)), horizon=1.0)
    assert dpct.plan(riding).rendezvous_time == 0.0


@given(st.lists(st.floats(-1e-6, 1e-6), min_size=6, max_size=6))
@settings(max_examples=15, deadline=None)
def test_rounding_of_an_observation_is_tolerated(noise: list[float]) -> None:
    problem = conveyor()
    noisy = replace(
        problem,
        q=problem.q + noise[:2],
        qd=np.array(noise[2:4]),
        target=MovingHand(HAND - (0.1, 0.0) + noise[4:], np.array([0.2, 0.0])),
    )
    plan = dpct.plan(noisy)
    assert plan.rendezvous_time == pytest.approx(1.58, abs=0.01)
    assert end_error(noisy, plan) <= 1e-9
    np.testing.assert_allclose(plan.q[0], noisy.q, atol=1e-5)


# fixed targets


@pytest.mark.parametrize("move", [(0.5, -0.4), (-0.3, 0.8), (0.0, 0.1)])
def test_rest_to_rest_in_joint_space(move: tuple[float, float]) -> None:
    start = np.array([0.3, 0.9])
    problem = MotionProblem(SCARA_1M, start, FixedJoints(start + move), 8.0)
    plan = dpct.plan(problem)
    assert_sound(problem, plan)
    np.testing.assert_allclose(plan.q[-1], start + move, atol=1e-9)
    np.testing.assert_allclose(plan.qd[-1], 0.0, atol=1e-12)
    along = (plan.q - start) @ move / np.dot(move, move)
    np.testing.assert_allclose(plan.q, start + along[:, None] * move, atol=1e-12)
    assert np.isinf(plan.rides_until)


def test_joint_space_time_of_a_double_integrator_with_limited_jerk() -> None:
    """Without limits of torque or velocity: rest to rest takes (32 d / j)^(1/3), Kyriakopoulos and Saridis."""
    limits = JointLimits(torque=(np.inf, np.inf), jerk=(2.0, np.inf))
    start = np.array([0.3, 0.9])
    problem = MotionProblem(SCARA_1M, start, FixedJoints(start + np.array([0.5, 0.0])), 8.0, limits=limits)
    exact = (32.0 * 0.5 / 2.0) ** (1.0 / 3.0)
    plan = dpct.plan(problem)
    assert exact <= plan.rendezvous_time <= 1.005 * exact


def test_rest_to_rest_at_the_wanted_time() -> None:
    start = np.array([0.3, 0.9])
    problem = MotionProblem(SCARA_1M, start, FixedJoints(start + np.array([0.5, -0.4])), 6.0)
    plan = dpct.plan(problem, rendezvous_time=6.0)
    assert plan.rendezvous_time == plan.duration == 6.0
    with pytest.raises(Infeasible, match="at 1 s"):
        dpct.plan(problem, rendezvous_time=1.0)


@pytest.mark.parametrize("arm", [SCARA_1M, PLANAR_3R])
def test_fixed_hand_on_a_straight_line(arm: Any) -> None:
    start = np.array([0.3, 0.9, -0.5])[: arm.n_joints]
    hand = arm.forward_kinematics(start)
    goal = hand + 0.1 * arm.reach * np.array([-0.6, 0.4])
    problem = MotionProblem(arm, start, FixedHand(goal), 8.0)
    plan = dpct.plan(problem)
    assert_sound(problem, plan)
    path = arm.forward_kinematics(plan.q)
    np.testing.assert_allclose(path[-1], goal, atol=1e-9)
    offset, line = path - hand, goal - hand
    np.testing.assert_allclose(offset[:, 0] * line[1] - offset[:, 1] * line[0], 0.0, atol=1e-12)


def test_a_new_orientation_is_reached_in_joint_space() -> None:
    start = np.array([0.3, 0.9, -0.5])
    goal = PLANAR_3R.forward_kinematics(start) + np.array([0.1, -0.1])
    plan = dpct.plan(MotionProblem(PLANAR_3R, start, FixedHand(goal, orientation=1.0), 3.0))
    np.testing.assert_allclose(PLANAR_3R.forward_kinematics(plan.q[-1]), goal, atol=1e-9)
    assert plan.q[-1].sum() == pytest.approx(1.0)


# the bound


@pytest.mark.parametrize("free", [True, False])
def test_settling_bound_approaches_the_rendezvous_time_and_falls_with_tolerance(free: bool) -> None:
    problem = conveyor()
    plan = dpct.plan(problem, free_initial_acceleration=free, allow_reverse=True, stages=100)

    def bound(position: float, velocity: float, limit: float = 0.0) -> float:
        return dpct.settling_bound(problem, position, velocity, limit, free_initial_acceleration=free)

    times = [bound(1e-7, 1e-7), bound(1e-3, 2e-3), bound(5e-3, 1e-2), bound(2e-2, 2e-2)]
    assert times[0] == pytest.approx(plan.rendezvous_time, rel=6e-3)
    assert times == sorted(times, reverse=True)
    assert times[-1] < 0.8 * times[0]
    assert bound(1e-3, 2e-3, 0.05) < times[1]


def test_settling_bound_of_a_settled_and_of_a_hopeless_start() -> None:
    problem = conveyor(lead=0.0, speed=0.01)
    assert dpct.settling_bound(problem, 0.02, 0.02) == 0.0
    assert dpct.settling_bound(conveyor(lead=-0.2, speed=0.25), 1e-3, 1e-3) == np.inf
    with pytest.raises(ValueError, match="position_tolerance"):
        dpct.settling_bound(problem, 0.0, 0.02)
    with pytest.raises(ValueError, match="moving target"):
        dpct.settling_bound(replace(problem, target=FixedJoints(problem.q)), 0.1, 0.1)
