"""DPCT as a dodger: time-optimal where nothing is near, clear of what is predicted, and within the limits."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planners import (
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
    dpct,
)
from planners.typing import Array

LIMITS = replace(SCARA_50CM.limits, acceleration=(4.5, 8.0))
STRONG = replace(LIMITS, torque=(math.inf, math.inf))
ONE_LINK = Arm(
    name="ONE_LINK",
    lengths=(0.5,),
    masses=(1.0,),
    limits=JointLimits(torque=(10.0,), velocity=(2.0,), acceleration=(4.0,), angle=(3.0,)),
    link_radius=0.04,
)
MARGIN, PREDICTION = 0.04, 1.5


def problem(
    q: tuple[float, ...],
    target: FixedHand | FixedJoints,
    *discs: Obstacle,
    qd: tuple[float, ...] | None = None,
    arm: Arm = SCARA_50CM,
) -> MotionProblem:
    limits = LIMITS if arm is SCARA_50CM else arm.limits
    start = None if qd is None else np.array(qd)
    return MotionProblem(arm=arm, q=np.array(q), qd=start, target=target, horizon=8.0, limits=limits, obstacles=discs)


def joints(*q: float) -> FixedJoints:
    return FixedJoints(np.array(q))


def disc(x: float, y: float, vx: float = 0.0, vy: float = 0.0, radius: float = 0.1) -> Obstacle:
    return Obstacle(np.array([x, y]), np.array([vx, vy]), radius)


def plan(task: MotionProblem, **options: object) -> Trajectory:
    return dpct.plan(task, variant="timing", **options)


def predicted_clearance(task: MotionProblem, trajectory: Trajectory, t: Array) -> Array:
    """Clearance from the closest disc at times ``t``."""
    q = trajectory.at(t)[0]
    gaps = [task.arm.clearance(q, d.position + t[:, None] * d.velocity, d.radius) for d in task.obstacles]
    return np.min(gaps, axis=0)


def least_clearance(task: MotionProblem, trajectory: Trajectory, until: float = PREDICTION) -> float:
    """Worst predicted clearance on a grid finer than any of the planner's."""
    return float(predicted_clearance(task, trajectory, np.arange(0.0, until, 0.001)).min())


def first_touch(task: MotionProblem, trajectory: Trajectory) -> float:
    t = np.arange(0.0, PREDICTION, 0.001)
    touching = predicted_clearance(task, trajectory, t) < 0.0
    return float(t[touching][0])


def straight_duration(task: MotionProblem, goal: Array) -> float:
    """Least time of a straight move from rest to rest, in closed form: a trapezoid or a triangle of speed."""
    change = np.abs(goal - task.q)
    moving = change > 0.0
    top = float(np.min(np.array(task.joint_limits.velocity)[moving] / change[moving]))
    rise = float(np.min(np.array(task.joint_limits.acceleration)[moving] / change[moving]))
    return 1.0 / top + top / rise if top * top < rise else 2.0 / math.sqrt(rise)


def assert_sound(task: MotionProblem, trajectory: Trajectory) -> None:
    """From the start, continuous in angle and velocity, to rest at the target, within every limit but of jerk."""
    q0, qd0, _ = task.start
    np.testing.assert_allclose(trajectory.q[0], q0, atol=1e-12)
    np.testing.assert_allclose(trajectory.qd[0], qd0, atol=1e-12)
    np.testing.assert_allclose(trajectory.qd[-1], 0.0, atol=1e-9)
    if isinstance(task.target, FixedJoints):
        np.testing.assert_allclose(trajectory.q[-1], task.target.q, atol=1e-9)
    elif isinstance(task.target, FixedHand):
        hand = task.arm.forward_kinematics(trajectory.q[-1])
        np.testing.assert_allclose(hand, task.target.position, atol=1e-9)
    h = np.diff(trajectory.t)[:, None]
    mean = 0.5 * (trajectory.qd[1:] + trajectory.qd[:-1])  # exact where the acceleration is constant
    np.testing.assert_allclose(np.diff(trajectory.q, axis=0), h * mean, atol=1e-8)
    assert np.all(np.abs(np.diff(trajectory.qd, axis=0)) <= h * np.array(task.joint_limits.acceleration) + 1e-8)
    limits = task.joint_limits
    assert np.max(np.abs(trajectory.qd) / np.array(limits.velocity)) <= 1.0 + 1e-8
    assert np.max(np.abs(trajectory.qdd) / np.array(limits.acceleration)) <= 1.0 + 1e-8
    assert np.max(np.abs(trajectory.tau) / np.array(limits.torque), initial=0.0) <= 1.0 + 1e-8
    assert np.max(np.abs(trajectory.q) / np.array(limits.angle)) <= 1.005


angle = st.floats(-2.4, 2.4).map(lambda value: round(value, 4))
speed = st.floats(-1.5, 1.5).map(lambda value: round(value, 4))  # less than 1e-9 rad/s counts as rest
postures = st.tuples(angle, angle)
discs = st.builds(
    lambda distance, direction, speed, course: disc(
        distance * math.cos(direction),
        distance * math.sin(direction),
        speed * math.cos(course),
        speed * math.sin(course),
    ),
    st.floats(0.35, 1.3),
    st.floats(-math.pi, math.pi),
    st.floats(0.0, 1.0),
    st.floats(-math.pi, math.pi),
)


@settings(deadline=None)
@given(start=postures, end=postures)
def test_with_no_disc_it_is_the_time_optimal_straight_move(
    start: tuple[float, float], end: tuple[float, float]
) -> None:
    task = replace(problem(start, joints(*end)), limits=STRONG)
    trajectory = plan(task)
    if np.abs(np.subtract(start, end)).max() > 1e-5:
        assert trajectory.duration == pytest.approx(straight_duration(task, np.array(end)), rel=1e-6)
        assert trajectory.cost == pytest.approx(trajectory.duration, rel=1e-9)
    assert_sound(task, trajectory)


@settings(deadline=None)
@given(start=postures, end=postures, share=st.floats(0.05, 0.95))
def test_replanned_on_its_way_it_arrives_when_it_would_have(
    start: tuple[float, float], end: tuple[float, float], share: float
) -> None:
    task = replace(problem(start, joints(*end)), limits=STRONG)
    first = plan(task)
    if first.duration < 0.3:
        return
    now = share * first.duration
    q, qd, _ = first.at(now)
    second = plan(replace(task, q=q, qd=qd))
    assert now + second.duration == pytest.approx(first.duration, rel=1e-3)


def test_limits_are_those_of_the_problem() -> None:
    slow = replace(LIMITS, velocity=(0.5, 0.5))
    task = replace(problem((0.0, 1.0), joints(1.5, 0.5)), limits=slow)
    trajectory = plan(task)
    assert np.abs(trajectory.qd).max() == pytest.approx(0.5, rel=1e-9)
    assert trajectory.limit_ratio <= 1.0 + 1e-9


def test_torque_is_kept_where_it_binds() -> None:
    """A slow arm with weak motors: the torque limit is what bounds its acceleration."""
    limits = JointLimits(torque=(0.5, 0.2), velocity=(2.0, 2.0), acceleration=(5.0, 5.0))
    task = MotionProblem(arm=SCARA_1M, q=np.array([0.2, 0.8]), target=joints(1.4, -0.5), horizon=20.0, limits=limits)
    trajectory = plan(task)
    assert 0.8 < trajectory.limit_ratios["torque"] <= 1.0 + 1e-9
    assert trajectory.limit_ratios["acceleration"] < 0.5


@pytest.mark.parametrize("speed", [0.3, 0.5, 0.8])
@pytest.mark.parametrize("point", [0.5, 0.75, 1.0])
@pytest.mark.parametrize("course", [-2.0, -0.5, 0.1, 2.8])
def test_a_disc_aimed_at_the_moving_arm_is_passed_with_the_margin(speed: float, point: float, course: float) -> None:
    """It is aimed at a point of the forearm where the straight move would be when the disc gets there."""
    free = problem((-0.6, 1.2), joints(1.2, 0.8))
    straight = plan(free)
    meeting = 0.7
    elbow, hand = SCARA_50CM.joint_positions(straight.at(meeting)[0])[1:]
    velocity = speed * np.array([math.cos(course), math.sin(course)])
    place = elbow + point * (hand - elbow) - meeting * velocity
    task = replace(free, obstacles=(Obstacle(place, velocity, 0.1),), horizon=12.0)
    assert float(SCARA_50CM.clearance(free.q, place, 0.1)) > MARGIN
    assert least_clearance(task, straight) < 0.0
    trajectory = plan(task)
    assert least_clearance(task, trajectory) >= MARGIN
    assert trajectory.cost > straight.duration
    assert_sound(task, trajectory)


@settings(deadline=None, max_examples=150)
@given(start=postures, end=postures, first=discs, second=st.none() | discs)
def test_a_plan_is_never_predicted_to_touch(
    start: tuple[float, float], end: tuple[float, float], first: Obstacle, second: Obstacle | None
) -> None:
    task = problem(start, joints(*end), *(d for d in (first, second) if d is not None))
    try:
        trajectory = plan(task)
    except Infeasible as error:
        if error.reason != "collision" and not error.details["minimum_time"] > task.horizon:
            raise
        return
    assert trajectory.clearance >= 0.0
    assert least_clearance(task, trajectory, until=trajectory.duration) >= -1e-3
    assert_sound(task, trajectory)


@settings(deadline=None, max_examples=100)
@given(start=postures, end=postures, velocity=st.tuples(speed, speed), threat=discs)
def test_a_start_in_motion_is_continued(
    start: tuple[float, float], end: tuple[float, float], velocity: tuple[float, float], threat: Obstacle
) -> None:
    task = problem(tuple(0.7 * np.array(start)), joints(*end), threat, qd=velocity)
    assert_sound(task, plan(task, contact="delay"))


@pytest.mark.parametrize(
    ("start", "end", "velocity"),
    [((0.0, 0.0), (0.0, 0.0), (0.0, 0.0625)), ((0.0, 0.13125), (0.0625, 0.0), (0.0625, 0.0))],
)
def test_a_short_way_does_not_end_in_motion(
    start: tuple[float, float], end: tuple[float, float], velocity: tuple[float, float]
) -> None:
    task = problem(start, joints(*end), disc(1.0, 0.0), qd=velocity)
    assert_sound(task, plan(task, contact="delay"))


@pytest.mark.parametrize("across", [0.001, 0.02, 0.2, 1.0])
def test_a_velocity_across_the_line_is_shed(across: float) -> None:
    direction = np.array([1.0, -0.5])
    qd = 0.8 * direction + across * np.array([0.5, 1.0])
    task = problem((-0.5, 1.0), joints(*(np.array([-0.5, 1.0]) + 1.5 * direction)), qd=tuple(qd))
    trajectory = plan(task)
    assert_sound(task, trajectory)
    ahead = plan(problem((-0.5, 1.0), task.target, qd=tuple(0.8 * direction)))  # type: ignore[arg-type]
    assert trajectory.duration <= ahead.duration + 0.1 + across


def test_it_waits_for_a_disc_to_pass() -> None:
    """A fast disc crosses far out on the way; a one-link arm can only choose when to go."""
    task = problem((0.0,), joints(1.5), disc(0.1, 0.75, 0.6, -0.6), arm=ONE_LINK)
    trajectory = plan(task)
    assert least_clearance(task, trajectory) >= MARGIN
    assert trajectory.duration > straight_duration(task, np.array([1.5])) + 0.1


def test_it_goes_back_before_a_disc_that_comes_its_way() -> None:
    task = problem((0.0,), joints(1.5), disc(0.45, 0.35, 0.0, -0.5), arm=ONE_LINK)
    trajectory = plan(task)
    assert least_clearance(task, trajectory) >= 0.0
    assert trajectory.q.min() < -0.3
    assert trajectory.q[-1] == pytest.approx(1.5)


def test_a_disc_parked_on_the_only_way_is_waited_for_as_long_as_it_is_believed_in_or_refused() -> None:
    task = problem((0.0,), joints(1.5), disc(0.35, 0.35), arm=ONE_LINK)
    trajectory = plan(task, contact="delay")
    assert least_clearance(task, trajectory) >= 0.0
    assert trajectory.clearance < 0.0
    assert trajectory.at(PREDICTION)[0][0] < math.pi / 4
    longer = plan(task, prediction=3.0, contact="delay")
    assert least_clearance(task, longer, until=3.0) >= 0.0
    with pytest.raises(Infeasible, match="every timing found touches a disc"):
        plan(task)


def test_a_disc_that_stays_longer_than_it_is_looked_ahead_for_is_waited_for() -> None:
    task = problem((0.0,), joints(1.5), disc(0.35, 0.35, 0.04, 0.04), arm=ONE_LINK)
    assert plan(task, contact="delay").clearance < 0.0
    trajectory = plan(task)
    assert trajectory.clearance >= 0.0
    assert least_clearance(task, trajectory, until=trajectory.duration) >= 0.0
    assert PREDICTION < trajectory.duration <= task.horizon
    assert_sound(task, trajectory)


def test_a_disc_parked_on_the_straight_way_is_never_driven_through() -> None:
    """From (-0.6, 0.6) to (0.8, 0.6) rad; the disc is where the hand would be half way."""
    hand = SCARA_50CM.forward_kinematics([0.1, 0.6])
    task = problem((-0.6, 0.6), joints(0.8, 0.6), disc(*hand, radius=0.08))
    assert plan(task, contact="delay").clearance < -0.1
    with pytest.raises(Infeasible, match="touches a disc") as caught:
        plan(task)
    assert caught.value.reason == "collision"


def test_a_motion_longer_than_the_horizon_is_refused_or_delayed() -> None:
    task = replace(problem((0.0, 1.0), joints(1.5, 0.5)), horizon=0.3)
    with pytest.raises(Infeasible, match=r"arrives at .* s; the horizon is 0.3 s, allow more time") as caught:
        plan(task)
    assert caught.value.reason == "late"
    assert plan(task, contact="delay").duration > 0.3


def test_a_slow_motion_takes_few_samples() -> None:
    slow = replace(LIMITS, velocity=(1e-5, 1e-5), acceleration=(1e-5, 1e-5))
    trajectory = plan(replace(problem((0.0, 1.0), joints(1.5, 0.5)), limits=slow, horizon=1e6))
    assert trajectory.duration > 1e5
    assert len(trajectory.t) < 10_000


def test_a_collision_that_cannot_be_avoided_is_refused_or_delayed() -> None:
    task = problem((0.0, 0.3), joints(1.5, 0.3), disc(0.3, 0.7, 0.0, -1.0), disc(0.3, -0.7, 0.0, 1.0))
    with pytest.raises(Infeasible, match="touches a disc") as caught:
        plan(task)
    assert caught.value.reason == "collision"
    delayed, straight = plan(task, contact="delay"), plan(replace(task, obstacles=()))
    assert first_touch(task, delayed) > first_touch(task, straight) + 0.05
    assert caught.value.details["time"] == pytest.approx(first_touch(task, delayed), abs=0.02)


def test_of_two_elbows_the_one_that_is_clear_is_taken() -> None:
    start = (0.0, 0.6)
    target = FixedHand(SCARA_50CM.forward_kinematics([0.5, 0.6]))
    near, far = SCARA_50CM.inverse_kinematics(target.position)
    alone = plan(problem(start, target))
    np.testing.assert_allclose(alone.q[-1], near, atol=1e-9)
    elbow = SCARA_50CM.joint_positions(near)[1]
    parked = disc(*(elbow + np.array([0.0, -0.05])), radius=0.05)
    blocked = plan(problem((1.0, -0.6), target, parked))
    np.testing.assert_allclose(blocked.q[-1], far, atol=1e-9)


def test_a_target_behind_the_end_of_a_range_is_reached_the_long_way_round() -> None:
    """With either elbow the short way leads through the first joint's stop."""
    target = FixedHand(SCARA_50CM.forward_kinematics([-2.6, 0.3]))
    task = problem((2.6, 0.3), target)
    assert_sound(task, plan(task))


def test_a_start_too_fast_to_stop_within_the_range_is_refused() -> None:
    with pytest.raises(Infeasible, match="too fast to stop") as caught:
        plan(problem((2.8, 1.0), joints(0.0, 1.0), qd=(2.4, 0.0)))
    assert caught.value.reason == "limits"


def test_an_arm_that_cannot_hold_its_weight_is_refused() -> None:
    limits = JointLimits(torque=(1.0,), velocity=(2.0,), acceleration=(4.0,))
    heavy = replace(ONE_LINK, gravity=9.81)
    with pytest.raises(
        Infeasible, match=r"joint 1 holds the arm's weight at the start with 2.45.* times its torque limit"
    ):
        plan(MotionProblem(arm=heavy, q=np.zeros(1), target=joints(1.0), horizon=8.0, limits=limits))


def test_at_the_target_it_stays_or_dodges() -> None:
    at_rest = plan(problem((0.5, 0.6), joints(0.5, 0.6)))
    np.testing.assert_allclose(at_rest.q, [[0.5, 0.6]] * len(at_rest.t))
    task = problem((0.5, 0.6), joints(0.5, 0.6), disc(0.9, 0.2, -0.3, 0.5))
    assert least_clearance(task, at_rest) < 0.0
    trajectory = plan(task)
    assert least_clearance(task, trajectory) >= 0.0
    assert_sound(task, trajectory)


def test_the_same_problem_gives_the_same_plan() -> None:
    task = problem((-0.6, 1.2), joints(1.2, 0.8), disc(0.9, 0.2, -0.3, 0.2))
    one, other = plan(task), plan(task)
    np.testing.assert_array_equal(one.q, other.q)
    assert one.cost == other.cost


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"margin": 0.0}, "margin 0.0 m must be positive"),
        ({"margin": math.inf}, "margin inf m must be positive and finite"),
        ({"prediction": 0.0}, "prediction 0.0 s must be from 0.1 to 3.0 s"),
        ({"contact": "ignore"}, "contact 'ignore' must be one of 'refuse', 'delay'"),
        ({"stages": 3}, "variant 'timing' has no option stages; it has margin, prediction, contact"),
    ],
)
def test_options_out_of_range_are_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        plan(problem((0.0, 1.0), joints(1.0, 1.0)), **options)


def test_what_it_cannot_do_is_refused() -> None:
    task = problem((0.0, 1.0), joints(1.0, 1.0))
    with pytest.raises(ValueError, match=r"goes to a target of kind joints or hand, not moving hand; .*dpct .optimal"):
        plan(replace(task, target=MovingHand(np.array([0.5, 0.5]), np.zeros(2))))
    with pytest.raises(ValueError, match="needs a finite velocity limit of every joint; give limits"):
        plan(replace(task, limits=JointLimits(torque=(10.0, 4.0))))
    with pytest.raises(Infeasible, match="reach"):
        plan(replace(task, target=FixedHand(np.array([2.0, 0.0]))))
