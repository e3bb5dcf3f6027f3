"""Potential fields that attract to a moving target of the hand, and to joint angles in a given time."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from envs.min_torque_move.moves import random_move, random_moves
from planners import (
    PLANAR_3R,
    SCARA_1M,
    SCARA_50CM,
    Arm,
    FixedHand,
    JointLimits,
    MotionProblem,
    apf,
    quintic,
)
from planners.apf.attraction import attraction, braking_distance, linear_field
from planners.apf.joint_field import least_acceleration, reach
from planners.apf.moving_target import approach
from planners.control.joint_limits import smooth_bounds
from planners.typing import Array

PERIOD = 0.02
UNLIMITED = JointLimits.unlimited(2)
seeds = st.integers(0, 2**32 - 1)


def damped(w: float, t: Array) -> Array:
    """Solution of x'' = -w^2 x - sqrt 2 w x' from x = 1 at rest, by hand."""
    c = w / math.sqrt(2.0)
    return np.exp(-c * t) * (np.cos(c * t) + np.sin(c * t))


def follow(
    start: Array, target: tuple[Array, Array, Array], steps: int, limits: JointLimits | None = None, **options: float
) -> tuple[Array, Array, Array, Array]:
    """q, qd, qdd at every sample from rest, ``(steps, rows, 2)``, and hand errors, for joints that do as asked."""
    period = options.setdefault("period", PERIOD)
    position, velocity, acceleration = target
    q, qd, qdd = start.copy(), np.zeros_like(start), np.zeros_like(start)
    samples = []
    for k in range(steps):
        t = k * period
        seen = (position + t * velocity + 0.5 * t**2 * acceleration, velocity + t * acceleration, acceleration)
        wanted = approach(SCARA_1M, q, qd, qdd, seen, limits=limits, **options)
        samples.append((q, qd, wanted, SCARA_1M.forward_kinematics(q) - seen[0]))
        q, qd, qdd = q + period * (qd + 0.5 * period * wanted), qd + period * wanted, wanted
    q_all, qd_all, qdd_all, errors = (np.array(column) for column in zip(*samples, strict=True))
    return q_all, qd_all, qdd_all, errors


def belt_start(
    x: float = -0.8, y: float = 1.732, offset: float = 0.1, speed: float = 0.2, acceleration: float = 0.0
) -> tuple[Array, tuple[Array, Array, Array]]:
    """The start of the conveyor-tracking paper unless given."""
    q = SCARA_1M.inverse_kinematics([x, y])[:1]
    return q, (np.array([[x - offset, y]]), np.array([[speed, 0.0]]), np.array([[acceleration, 0.0]]))


# One direction


def test_linear_field_is_sampled_from_the_damped_oscillator() -> None:
    w, x, v = 9.0, 1.0, 0.0
    samples = []
    for _ in range(60):
        samples.append(x)
        s = linear_field(x, v, PERIOD, w)
        x, v = x + PERIOD * (v + 0.5 * PERIOD * s), v + PERIOD * s
    # Any three samples in a row obey the recurrence whose poles are exp((-1 +- i) w T / sqrt 2).
    c = w * PERIOD / math.sqrt(2.0)
    x0, x1, x2 = (np.array(samples[k : len(samples) - 2 + k]) for k in range(3))
    np.testing.assert_allclose(x2, 2.0 * math.exp(-c) * math.cos(c) * x1 - math.exp(-2.0 * c) * x0, atol=1e-13)


@pytest.mark.parametrize("v", [0.3, -0.3, 0.005])
def test_braking_distance_from_even_motion(v: float) -> None:
    limit, jerk = 0.2, 2.0
    # By symmetry the mean velocity is v / 2; the time is that of the trapezoid or triangle of deceleration.
    time = abs(v) / limit + limit / jerk if abs(v) >= limit**2 / jerk else 2.0 * math.sqrt(abs(v) / jerk)
    assert braking_distance(v, 0.0, (-limit, limit), jerk) == pytest.approx(0.5 * v * time, rel=1e-12)
    assert braking_distance(v, 0.0, (-limit, limit), math.inf) == pytest.approx(0.5 * v * abs(v) / limit)


@given(
    v=st.floats(-1.0, 1.0),
    a=st.floats(-0.5, 0.5),
    share=st.floats(0.0, 1.0),
)
def test_braking_distance_adds_up_along_the_motion(v: float, a: float, share: float) -> None:
    down, up, jerk = 0.5, 0.6, 2.0
    # A first stretch of the motion to rest: jerk against the velocity that would be left with no acceleration.
    sign = math.copysign(1.0, v + 0.5 * a * abs(a) / jerk)
    peak = min(down if sign > 0.0 else up, math.sqrt(max(0.0, jerk * sign * v + 0.5 * a * a)))
    t = share * max(0.0, (sign * a + peak) / jerk)
    way = t * (v + t * (0.5 * a - sign * jerk * t / 6.0))
    v_then, a_then = v + t * (a - 0.5 * sign * jerk * t), a - sign * jerk * t
    whole = braking_distance(v, a, (-down, up), jerk)
    assert whole == pytest.approx(way + braking_distance(v_then, a_then, (-down, up), jerk), abs=1e-9)


@settings(max_examples=50, deadline=None)
@given(
    distance=st.floats(0.01, 2.0),
    side=st.sampled_from([-1.0, 1.0]),
    limit=st.floats(0.2, 5.0),
    growth=st.floats(5.0, 40.0),
    w=st.floats(2.0, 20.0),
)
def test_attraction_ends_at_the_goal_within_its_limits(
    distance: float, side: float, limit: float, growth: float, w: float
) -> None:
    x, v, a, jerk, passed = side * distance, 0.0, 0.0, growth * limit, 0.0
    for _ in range(int((4.0 * math.sqrt(distance / limit) + 20.0 / w + 1.0) / PERIOD)):
        possible = max(-limit, a - jerk * PERIOD), min(limit, a + jerk * PERIOD)
        a = attraction(x, v, possible, (-limit, limit), jerk, PERIOD, w)
        assert possible[0] <= a <= possible[1]
        x, v = x + PERIOD * (v + 0.5 * PERIOD * a), v + PERIOD * a
        passed = max(passed, -side * x)
        if v * x < 0.0:  # never faster than the depth of the conic well allows, but for half a period
            assert 0.5 * v * v <= limit * (abs(x) + 0.5 * PERIOD * abs(v))
    assert abs(x) < 1e-3 * distance
    assert abs(v) < 1e-5
    assert passed < 0.02 * distance  # the linear field alone: exp(-pi) = 4.3 %


def test_attraction_takes_the_least_time_when_the_well_is_steep() -> None:
    x, v, limit, steps = -1.0, 0.0, 1.0, 0
    while abs(x) > 1e-3 or abs(v) > 2e-3:
        a = attraction(x, v, (-limit, limit), (-limit, limit), math.inf, PERIOD, 12.0)
        x, v, steps = x + PERIOD * (v + 0.5 * PERIOD * a), v + PERIOD * a, steps + 1
    bang_bang = 2.0 * math.sqrt(1.0 / limit)
    assert bang_bang - 0.1 < steps * PERIOD < 1.15 * bang_bang


# A moving target of the hand


def test_without_limits_the_hand_comes_as_the_damped_oscillator() -> None:
    start, (position, _, _) = belt_start(offset=0.05)
    at_rest = position, np.zeros((1, 2)), np.zeros((1, 2))
    period, w = 2e-3, 6.0
    *_, errors = follow(start, at_rest, 500, UNLIMITED, period=period, bandwidth=w)
    t = period * np.arange(500)
    there = t > 0.75 * math.pi * math.sqrt(2.0) / w  # when the oscillator has passed the goal, by up to exp(-pi)
    np.testing.assert_allclose(errors[~there, 0, 0], 0.05 * damped(w, t[~there]), atol=0.05 * 1e-2)
    assert np.abs(errors[there, 0, 0]).max() < 0.05 * 0.02
    assert np.abs(errors[:, 0, 1]).max() < 1e-6


def limit_ratios(q: Array, qd: Array, qdd: Array) -> dict[str, float]:
    """The largest values of the first row of `follow`, as shares of the limits."""
    limits = SCARA_1M.limits
    tau = SCARA_1M.inverse_dynamics(q[:, 0], qd[:, 0], qdd[:, 0])
    jerk = np.diff(qdd, axis=0, prepend=0.0) / PERIOD
    return {
        "torque": np.abs(tau / limits.torque).max(),
        "velocity": np.abs(qd / limits.velocity).max(),
        "acceleration": np.abs(qdd / limits.acceleration).max(),
        "jerk": np.abs(jerk / limits.jerk).max(),
    }


def test_the_papers_part_is_met_within_limits_that_bind() -> None:
    q, qd, qdd, errors = follow(*belt_start(), 125)
    ratios = limit_ratios(q, qd, qdd)
    assert max(ratios.values()) <= 1.005, ratios
    assert max(ratios.values()) >= 0.95, ratios
    settled = np.abs(errors[:, 0]).max(axis=1) < 1e-3
    assert settled[90:].all()
    assert not settled[:40].any()


@pytest.mark.parametrize("beside", [0.12, -0.12])
def test_a_hand_beside_the_path_comes_to_it_within_all_limits(beside: float) -> None:
    start, (position, velocity, acceleration) = belt_start(offset=0.05, speed=0.1)
    q, qd, qdd, errors = follow(start, (position + np.array([0.0, beside]), velocity, acceleration), 220)
    across = -errors[:, 0, 1] / beside  # from 1 to 0
    assert max(limit_ratios(q, qd, qdd).values()) <= 1.005
    assert across.min() >= -0.1
    assert np.abs(errors[200:, 0]).max() < 1e-3


@pytest.mark.parametrize("acceleration", [0.05, -0.05, 0.0])
def test_a_hand_on_the_part_stays_on_it(acceleration: float) -> None:
    start, (position, velocity, a) = belt_start(offset=0.0, speed=0.0, acceleration=acceleration)
    *_, errors = follow(start, (position, velocity, a), 60, replace(SCARA_1M.limits, jerk=()))
    assert np.abs(errors).max() < 2e-6


@settings(max_examples=25, deadline=None)
@given(seed=seeds)
def test_smoothness_limits_are_kept_whatever_the_target(seed: int) -> None:
    generator = np.random.default_rng(seed)
    start = generator.uniform(-np.pi, np.pi, (8, 2))
    target = tuple(generator.uniform(-scale, scale, (8, 2)) for scale in (2.5, 0.4, 0.2))
    _, qd, qdd, _ = follow(start, target, 80)
    limits = SCARA_1M.limits
    assert np.abs(qd / limits.velocity).max() <= 1.0 + 1e-9
    assert np.abs(qdd / limits.acceleration).max() <= 1.0 + 1e-9
    jerk = np.diff(qdd, axis=0, prepend=0.0) / PERIOD
    assert np.abs(jerk / limits.jerk).max() <= 1.0 + 1e-9


@settings(max_examples=25, deadline=None)
@given(seed=seeds)
def test_every_answer_is_within_the_smooth_bounds(seed: int) -> None:
    generator = np.random.default_rng(seed)
    limits = SCARA_1M.limits
    q = generator.uniform(-np.pi, np.pi, (64, 2))
    qd, qdd = generator.uniform(-0.25, 0.25, (64, 2)), generator.uniform(-0.3, 0.3, (64, 2))
    target = tuple(generator.uniform(-scale, scale, (64, 2)) for scale in (2.5, 0.4, 0.2))
    answer = approach(SCARA_1M, q, qd, qdd, target, PERIOD)
    for row, i in np.ndindex(64, 2):
        low, high = smooth_bounds(
            qd[row, i], qdd[row, i], PERIOD, limits.velocity[i], limits.acceleration[i], limits.jerk[i]
        )
        assert low <= answer[row, i] <= high


def test_smooth_bounds_stop_a_joint_at_its_velocity_limit() -> None:
    speed, a, fastest = 0.0, 0.0, 0.0
    for _ in range(200):
        _, a = smooth_bounds(speed, a, PERIOD, 0.2, 0.3, 2.0)
        speed += PERIOD * a
        fastest = max(fastest, speed)
    assert 0.2 - 1e-6 < fastest <= 0.2 + 1e-12
    assert smooth_bounds(0.1, 0.0, PERIOD, math.inf, math.inf, math.inf) == (-math.inf, math.inf)
    assert smooth_bounds(0.1, 0.0, PERIOD, 0.2, math.inf, math.inf) == pytest.approx((-15.0, 5.0))


def test_environments_do_not_touch_each_other_and_the_base_is_respected() -> None:
    generator = np.random.default_rng(1)
    q, qd, qdd = (generator.uniform(-scale, scale, (16, 2)) for scale in (2.0, 0.1, 0.2))
    target = tuple(generator.uniform(-scale, scale, (16, 2)) for scale in (1.5, 0.2, 0.1))
    batch = approach(SCARA_1M, q, qd, qdd, target, PERIOD)
    for row in range(16):
        one = slice(row, row + 1)
        single = approach(SCARA_1M, q[one], qd[one], qdd[one], tuple(part[one] for part in target), PERIOD)
        np.testing.assert_array_equal(single[0], batch[row])
    moved = replace(SCARA_1M, base=(0.5, -2.0))
    elsewhere = approach(moved, q, qd, qdd, (target[0] + [0.5, -2.0], *target[1:]), PERIOD)
    np.testing.assert_allclose(elsewhere, batch, atol=1e-9)


def test_a_third_link_keeps_its_orientation_on_the_way_to_a_moving_target() -> None:
    limits = JointLimits(torque=(40, 20, 8), velocity=4.0, acceleration=20.0, jerk=400.0)
    arm = Arm("three", (0.3, 0.25, 0.12), (3.0, 2.0, 1.0), limits)
    q, qd = arm.inverse_kinematics([-0.1, 0.5], 1.5)[:1], np.zeros((1, 3))
    position, velocity, qdd = np.array([[-0.2, 0.52]]), np.array([[0.1, 0.0]]), np.zeros((1, 3))
    for _ in range(100):
        before, qdd = qdd, approach(arm, q, qd, qdd, (position, velocity, np.zeros((1, 2))), PERIOD)
        tau = arm.inverse_dynamics(q, qd, qdd)
        assert (np.abs(qdd) <= 20.0 + 1e-9).all()
        assert (np.abs(qdd - before) <= 400.0 * PERIOD + 1e-9).all()
        assert (np.abs(tau) <= [[40, 20, 8]]).all()
        q, qd = q + PERIOD * (qd + 0.5 * PERIOD * qdd), qd + PERIOD * qdd
        position = position + PERIOD * velocity
        assert q.sum() == pytest.approx(1.5, abs=1e-3)
    np.testing.assert_allclose(arm.forward_kinematics(q), position, atol=1e-4)


def test_what_the_hands_field_cannot_do_is_refused() -> None:
    zero4, zero = np.zeros((1, 4)), np.zeros((1, 2))
    with pytest.raises(ValueError, match="4 links; the field of the hand is for arms with two or three"):
        approach(Arm("four", (0.2,) * 4, (1.0,) * 4), zero4, zero4, zero4, (zero, zero, zero), PERIOD)
    with pytest.raises(ValueError, match="must be positive"):
        approach(SCARA_1M, zero, zero, zero, (zero, zero, zero), 0.0)
    with pytest.raises(ValueError, match="must be positive"):
        approach(SCARA_1M, zero, zero, zero, (zero, zero, zero), PERIOD, bandwidth=-1.0)


# Joint angles in a given time


@given(
    error=st.floats(-3.0, 3.0),
    speed=st.floats(-5.0, 5.0),
    periods=st.integers(2, 60),
    period=st.sampled_from([0.005, 0.02, 0.1]),
)
def test_least_acceleration_begins_the_least_square_sequence(
    error: float, speed: float, periods: int, period: float
) -> None:
    # velocity and angle gained by a unit acceleration in each period
    effect = np.stack([np.full(periods, period), period**2 * (periods - np.arange(periods) - 0.5)])
    wanted = np.array([-speed, error - periods * period * speed])
    first = (np.linalg.pinv(effect) @ wanted)[0]
    scale = abs(error) / period**2 + abs(speed) / period + 1.0
    assert least_acceleration(error, speed, float(periods), period) == pytest.approx(first, abs=1e-9 * scale)


def test_the_well_alone_moves_along_the_cubic() -> None:
    period, n = 1e-3, 1000
    e, v, errors = 1.0, 0.0, []
    for k in range(n):
        errors.append(e)
        a = least_acceleration(e, v, float(n - k), period)
        e, v = e - period * (v + 0.5 * period * a), v + period * a
    s = np.arange(n) / n
    np.testing.assert_allclose(errors, 1.0 - 3.0 * s**2 + 2.0 * s**3, atol=5e-6)
    assert (abs(e), abs(v)) < (1e-12, 1e-9)


def move(start: Array, goal: Array, duration: float, period: float = 0.005) -> tuple[Array, Array, Array]:
    """q, qd, qdd at every sample and after the last, for joints that do as asked."""
    steps = round(duration / period)
    q, qd = start[None].copy(), np.zeros((1, len(start)))
    samples = []
    for k in range(steps):
        qdd = reach(PLANAR_3R, q, qd, goal[None], duration - k * period, period)
        samples.append((q[0], qd[0], qdd[0]))
        q, qd = q + period * (qd + 0.5 * period * qdd), qd + period * qdd
    samples.append((q[0], qd[0], np.zeros(len(start))))
    q_all, qd_all, qdd_all = (np.array(column) for column in zip(*samples, strict=True))
    return q_all, qd_all, qdd_all


@settings(max_examples=20, deadline=None)
@given(seed=seeds)
def test_a_move_ends_at_rest_in_time_within_torques_and_ranges(seed: int) -> None:
    drawn = random_move(np.random.default_rng(seed), PLANAR_3R, 0.005)
    q, qd, qdd = move(drawn.start, drawn.goal, drawn.duration)
    np.testing.assert_allclose(q[-1], drawn.goal, atol=1e-6)
    np.testing.assert_allclose(qd[-1], 0.0, atol=1e-4)
    ahead = q + 0.0025 * (qd + 0.00125 * qdd), qd + 0.0025 * qdd
    tau = PLANAR_3R.inverse_dynamics(*ahead, qdd)[:-1]
    assert np.abs(tau / PLANAR_3R.limits.torque).max() <= 1.0
    low, high = np.minimum(drawn.start, drawn.goal), np.maximum(drawn.start, drawn.goal)
    assert (q >= low - 1e-6).all()
    assert (q <= high + 1e-6).all()


def test_moves_take_less_torque_than_the_quintic_and_the_cubic() -> None:
    shares = []
    for problem in random_moves(25, 0):
        duration, goal = 0.005 * math.ceil(problem.horizon / 0.005), problem.target.q
        q, qd, qdd = move(problem.q, goal, duration)
        tau = PLANAR_3R.inverse_dynamics(q + 0.0025 * (qd + 0.00125 * qdd), qd + 0.0025 * qdd, qdd)
        smooth = quintic.plan(replace(problem, horizon=duration))
        shares.append(0.005 * np.abs(tau).sum() / smooth.cost)
    # Without coupling: the largest velocity, in units of the mean one; 15 / 8 for the quintic, 3 / 2 for the cubic.
    assert 1.0 / (15.0 / 8.0) < np.median(shares) < 0.9 * (3.0 / 2.0) / (15.0 / 8.0)


def test_a_move_coasts_and_then_brakes_along_the_second_half_of_a_cubic() -> None:
    start, goal, period = np.zeros(3), np.array([1.0, 0.0, 0.0]), 0.005
    _, qd, qdd = move(start, goal, 1.0)
    coasting = np.abs(qdd[:, 0]) < 1e-6
    coasting[-1] = False
    assert coasting.sum() > 100
    last = np.flatnonzero(coasting)[-1] + 1
    left = period * (200 - last)
    v = qd[last, 0]
    # From there q'' = 0 at first and -2 v / left at last: v(t) = v (1 - (t / left)^2).
    s = period * np.arange(201 - last) / left
    np.testing.assert_allclose(qd[last:, 0], v * (1.0 - s**2), atol=0.02 * v)
    torques = PLANAR_3R.mass_matrix(goal)[:, 0] * 2.0 * v / left
    assert np.max(torques / PLANAR_3R.limits.torque) == pytest.approx(0.9, rel=0.05)


def test_a_move_there_is_no_time_for_uses_all_the_torque_and_no_more() -> None:
    start, goal = np.array([0.3, -0.4, 0.2]), np.array([2.0, 1.0, -1.0])
    q, qd, qdd = move(start, goal, 0.1)
    tau = PLANAR_3R.inverse_dynamics(q + 0.0025 * (qd + 0.00125 * qdd), qd + 0.0025 * qdd, qdd)[:-1]
    ratios = np.abs(tau / PLANAR_3R.limits.torque).max(axis=1)
    assert ratios.max() <= 1.0
    assert ratios[0] == pytest.approx(0.999, abs=1e-3)


def test_the_weight_is_held() -> None:
    arm = replace(PLANAR_3R, gravity=9.81)
    q = np.array([[0.5, 0.4, -0.3]])
    np.testing.assert_allclose(reach(arm, q, np.zeros((1, 3)), q, 0.5, 0.005), 0.0, atol=1e-12)


def test_environments_may_have_different_times_left() -> None:
    generator = np.random.default_rng(3)
    q, qd, goal = (generator.uniform(-1.0, 1.0, (8, 3)) for _ in range(3))
    left = 0.005 * generator.integers(1, 200, 8)
    batch = reach(PLANAR_3R, q, qd, goal, left, 0.005)
    for row in range(8):
        one = slice(row, row + 1)
        single = reach(PLANAR_3R, q[one], qd[one], goal[one], float(left[row]), 0.005)
        np.testing.assert_array_equal(single[0], batch[row])
    with pytest.raises(ValueError, match="must be positive"):
        reach(PLANAR_3R, q, qd, goal, left, 0.0)


@pytest.mark.parametrize("options", [{}, {"tolerance": 2e-3}, {"period": 0.01}])
def test_a_place_of_the_hand_is_held_until_the_arm_is_at_rest(options: dict[str, float]) -> None:
    """The hand keeps within the tolerance for the time to hold while the joints still move around it."""
    problem = MotionProblem(SCARA_50CM, np.array([0.2, 1.5]), FixedHand(np.array([0.3, 0.2])), 3.0)
    motion = apf.plan(problem, **options)
    assert np.abs(motion.qd[-1]).max() <= 10.0 * options.get("tolerance", 1e-3)
    assert motion.duration < 2.0
