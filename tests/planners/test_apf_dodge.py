"""The field that dodges discs: limits, the ways round, both elbows, and the mathematics behind it."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planners import PLANAR_3R, SCARA_50CM
from planners.apf.dodge import (
    STEP,
    DodgeGains,
    dodge_accelerations,
    look_ahead_steps,
    new_memory,
    tuned_gains,
    whole_arm,
)
from planners.apf.dodge.discs import observe_discs, predict_discs
from planners.apf.dodge.gains import GAINS_FILE, as_record, make_instants
from planners.motion.double_integrator import rest_time
from planners.typing import Array

ARM = SCARA_50CM
PERIOD, RADIUS = 0.02, 0.1
FAR = np.array([50.0, 50.0])
LIMITS = ARM.limits


class Run(NamedTuple):
    q: Array
    qd: Array
    qdd: Array
    clearance: Array


def drive(
    start: list[float],
    goal: Array,
    seconds: float,
    disc: Callable[[float], Array] = lambda t: FAR,
    hold_time: float = 0.5,
    gains: DodgeGains | None = None,
) -> Run:
    """Perfect joints under the field; the disc's velocity is observed."""
    memory, q, qd = new_memory(1, 1), np.array(start), np.zeros(2)
    rows = []
    for step in range(round(seconds / PERIOD)):
        place = disc(step * PERIOD)
        velocity = (disc(step * PERIOD + 1e-4) - place) / 1e-4
        qdd = dodge_accelerations(
            ARM,
            gains or tuned_gains(),
            q[None],
            qd[None],
            goal[None],
            place[None, None],
            velocity[None, None],
            np.full((1, 1), RADIUS),
            memory,
            PERIOD,
            hold_time=hold_time,
        )[0]
        q, qd = q + PERIOD * (qd + 0.5 * PERIOD * qdd), qd + PERIOD * qdd
        rows.append((q, qd, qdd, ARM.clearance(q, disc((step + 1) * PERIOD), RADIUS)))
    return Run(*(np.array(column) for column in zip(*rows, strict=True)))


def distance(run: Run, goal: Array) -> Array:
    return np.hypot(*(ARM.forward_kinematics(run.q) - goal).T)


angle1 = st.floats(-2.8, 2.8)
angle2 = st.floats(-2.55, 2.55)
speed = st.floats(-2.4, 2.4)
place = st.floats(-1.2, 1.2)
pace = st.floats(-1.0, 1.0)


@settings(max_examples=300, deadline=None)
@given(angle1, angle2, speed, speed, place, place, pace, pace, st.integers(1, 4))
def test_accelerations_velocities_and_torques_keep_the_limits(
    q1: float, q2: float, v1: float, v2: float, x: float, y: float, vx: float, vy: float, discs: int
) -> None:
    q, qd = np.array([q1, q2]), np.array([v1, v2])
    places = np.array([x, y]) + 0.3 * np.arange(discs)[:, None]
    qdd = dodge_accelerations(
        ARM,
        tuned_gains(),
        q[None],
        qd[None],
        ARM.forward_kinematics([0.3, 1.0])[None],
        places[None],
        np.broadcast_to([vx, vy], (1, discs, 2)),
        np.full((1, discs), RADIUS),
        new_memory(1, discs),
        PERIOD,
    )[0]
    assert (np.abs(qdd) <= np.array(LIMITS.acceleration) * (1 + 1e-12)).all()
    assert (np.abs(qd + PERIOD * qdd) <= np.array(LIMITS.velocity) + 1e-12).all()
    half = 0.5 * PERIOD
    tau = ARM.inverse_dynamics(q + half * (qd + 0.5 * half * qdd), qd + half * qdd, qdd)
    # Accelerations are scaled along a straight line; the torques along it bend by far less than this.
    assert (np.abs(tau) <= 1.002 * np.array(LIMITS.torque)).all()


def decision(place: Array, forecast: Array | None) -> Array:
    """The field's decision with a standing disc, and with a forecast of it."""
    return dodge_accelerations(
        ARM,
        tuned_gains(),
        np.array([[-0.6, 1.2]]),
        np.zeros((1, 2)),
        ARM.forward_kinematics([0.9, 1.2])[None],
        place[None, None],
        np.zeros((1, 1, 2)),
        np.full((1, 1), RADIUS),
        new_memory(1, 1),
        PERIOD,
        forecast=forecast,
    )[0]


def test_the_field_dodges_by_where_a_disc_is_said_to_be() -> None:
    steps, beside, way = look_ahead_steps(tuned_gains()), np.array([-0.6, -0.3]), ARM.forward_kinematics([0.2, 1.2])
    assert steps * STEP == pytest.approx(tuned_gains().horizon)
    free, blocked = decision(beside, np.broadcast_to(FAR, (1, steps, 1, 2))), decision(way, None)
    assert not np.allclose(free, blocked)
    np.testing.assert_array_equal(decision(way, np.broadcast_to(FAR, (1, steps, 1, 2))), free)
    np.testing.assert_array_equal(decision(beside, np.broadcast_to(way, (1, steps, 1, 2))), blocked)
    with pytest.raises(ValueError, match="shape"):
        decision(way, np.zeros((1, steps + 1, 1, 2)))


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000))
def test_joints_stay_within_their_ranges_whatever_a_disc_does(seed: int) -> None:
    generator = np.random.default_rng(seed)
    phase, rate, reach = generator.uniform(0, 7, 2), generator.uniform(0.3, 2.0, 2), generator.uniform(0.4, 1.1)
    start = generator.uniform([-2.7, -2.4], [2.7, 2.4])
    run = drive(
        start.tolist(),
        ARM.forward_kinematics(generator.uniform([-2.8, -2.5], [2.8, 2.5])),
        3.0,
        lambda t: reach * np.cos(phase + rate * t),
    )
    assert (np.abs(run.q) <= np.array(LIMITS.angle)).all()


@pytest.mark.parametrize(
    ("start", "end"), [([0.0, 1.0], [1.2, 0.5]), ([-2.0, -1.5], [2.0, -0.6]), ([1, 2], [0.9, 0.6])]
)
def test_without_discs_it_goes_to_the_goal_in_little_more_than_the_least_time(
    start: list[float], end: list[float]
) -> None:
    goal = ARM.forward_kinematics(end)
    run = drive(start, goal, 4.0)
    times = [
        max(
            rest_time(b - a, 0.0, top, 0.5 * hardest)
            for a, b, top, hardest in zip(start, posture, LIMITS.velocity, LIMITS.acceleration, strict=True)
        )
        for posture in ARM.inverse_kinematics(goal)
    ]
    quicker = int(np.argmin(times))
    arrival = PERIOD * (1 + np.flatnonzero(distance(run, goal) > 0.03)[-1])
    assert 0.7 * times[quicker] < arrival < 1.1 * times[quicker]
    np.testing.assert_allclose(run.q[-1], ARM.inverse_kinematics(goal)[quicker], atol=1e-6)
    np.testing.assert_allclose(run.qd[-1], 0.0, atol=1e-6)


def test_a_parked_disc_on_the_straight_way_is_gone_round() -> None:
    start, end = [-1.0, 0.8], [1.0, 0.8]
    goal, middle = ARM.forward_kinematics(end), ARM.forward_kinematics([0.0, 0.8])
    straight = np.linspace(start, end, 200)
    assert min(ARM.clearance(straight, middle, RADIUS)) < 0.0
    run = drive(start, goal, 6.0, lambda t: middle)
    assert run.clearance.min() > 0.0
    assert distance(run, goal)[-1] < 0.03


@pytest.mark.parametrize("heading", [0.0, 2.0, -0.8, 1.4])
def test_a_disc_head_on_is_dodged_and_the_goal_taken_again(heading: float) -> None:
    q = [0.2, 1.1]
    hand = ARM.forward_kinematics(q)
    direction = np.array([math.cos(heading), math.sin(heading)])
    way = hand + 1.2 * direction

    def disc(t: float) -> Array:
        return way - min(0.6 * t, 3.6) * direction

    stayed = [float(ARM.clearance(q, disc(t), RADIUS)) for t in np.arange(0.0, 7.0, 0.02)]
    assert min(stayed) < 0.0
    run = drive(q, hand, 7.0, disc, hold_time=10.0)
    assert run.clearance.min() > 0.0
    assert distance(run, hand)[-1] < 0.03


def test_a_goal_whose_near_elbow_is_blocked_is_reached_by_the_other() -> None:
    start, near = [2.2, 1.6], np.array([0.4, 1.2])
    goal = ARM.forward_kinematics(near)
    far = ARM.inverse_kinematics(goal)[1]
    _, elbow, hand = ARM.joint_positions(near)
    outward = np.array([hand[1] - elbow[1], elbow[0] - hand[0]]) / 0.5
    parked = 0.5 * (elbow + hand) + 0.06 * outward
    assert ARM.clearance(near, parked, RADIUS) < 0.0 < ARM.clearance(far, parked, RADIUS)
    without = drive(start, goal, 4.0)
    np.testing.assert_allclose(without.q[-1], near, atol=1e-6)
    run = drive(start, goal, 6.0, lambda t: parked)
    assert run.clearance.min() > 0.0
    np.testing.assert_allclose(run.q[-1], far, atol=1e-6)


def test_a_goal_out_of_reach_brings_the_arm_to_rest() -> None:
    run = drive([0.5, 0.5], np.array([1.4, 0.3]), 2.0)
    np.testing.assert_allclose(run.qd[-1], 0.0, atol=1e-6)


def random_batch(rows: int, discs: int) -> tuple[Array, ...]:
    generator = np.random.default_rng(4)
    return (
        generator.uniform(-2.2, 2.2, (rows, 2)),
        generator.uniform(-2.0, 2.0, (rows, 2)),
        ARM.forward_kinematics(generator.uniform(-2.2, 2.2, (rows, 2))),
        generator.uniform(-1.0, 1.0, (rows, discs, 2)),
        generator.uniform(-1.0, 1.0, (rows, discs, 2)),
        np.full((rows, discs), RADIUS),
    )


@pytest.mark.parametrize("discs", [0, 1, 3])
def test_a_row_of_a_batch_is_bit_for_bit_that_row_alone(discs: int) -> None:
    rows = random_batch(16, discs)
    memory, alone = new_memory(16, discs), [new_memory(1, discs) for _ in range(16)]
    for _ in range(3):
        batch = dodge_accelerations(ARM, tuned_gains(), *rows, memory, PERIOD)
        for row in range(16):
            single = [array[row : row + 1] for array in rows]
            np.testing.assert_array_equal(
                dodge_accelerations(ARM, tuned_gains(), *single, alone[row], PERIOD)[0], batch[row]
            )
            assert alone[row][0] == memory[row]


def test_a_row_whose_memory_is_reset_begins_anew() -> None:
    rows = random_batch(8, 1)
    memory = new_memory(8, 1)
    first = dodge_accelerations(ARM, tuned_gains(), *rows, memory, PERIOD)
    dodge_accelerations(ARM, tuned_gains(), *random_batch(8, 1)[:4], -rows[4], rows[5], memory, PERIOD)
    memory[3] = np.zeros((), memory.dtype)
    again = dodge_accelerations(ARM, tuned_gains(), *rows, memory, PERIOD)
    np.testing.assert_array_equal(again[3], first[3])


def test_the_repulsion_is_the_gradient_of_the_clearance() -> None:
    generator = np.random.default_rng(0)
    body, step = whole_arm.make_body(ARM), 1e-6
    for _ in range(200):
        q, at = generator.uniform(-2.5, 2.5, 2), generator.uniform(-1.2, 1.2, 2)
        if abs(ARM.clearance(q, at, 0.0)) < 0.02:
            continue
        ahead = [float(ARM.clearance(q + step * np.eye(2)[i], at, 0.0)) for i in range(2)]
        behind = [float(ARM.clearance(q - step * np.eye(2)[i], at, 0.0)) for i in range(2)]
        slopes = (np.array(ahead) - np.array(behind)) / (2.0 * step)
        distance, *gradient = whole_arm.repulsion(body, *q, *at)
        np.testing.assert_allclose(gradient, slopes, atol=1e-5)
        assert distance == pytest.approx(ARM.clearance(q, at, 0.0) + ARM.link_radius)


@settings(max_examples=200, deadline=None)
@given(angle1, angle2, speed, speed, angle1, angle2)
def test_the_time_to_a_posture_is_that_of_the_slower_joint(
    q1: float, q2: float, v1: float, v2: float, end1: float, end2: float
) -> None:
    times = [
        rest_time(end - q, v, top, 0.5 * hardest)
        for q, v, end, top, hardest in zip(
            (q1, q2), (v1, v2), (end1, end2), LIMITS.velocity, LIMITS.acceleration, strict=True
        )
    ]
    found = whole_arm.time_to(whole_arm.make_body(ARM), q1, q2, v1, v2, np.array([end1, end2]))
    assert found == pytest.approx(max(times), abs=1e-6)


def test_held_torques_are_the_inverse_dynamics_half_a_period_ahead() -> None:
    hanging = replace(ARM, gravity=9.81)
    q, qd, qdd, half = np.array([0.4, -1.3]), np.array([1.1, -2.0]), np.array([5.0, -9.0]), 0.01
    found = whole_arm.held_torques(whole_arm.make_body(hanging), q, qd, *qdd, 2.0 * half)
    wanted = hanging.inverse_dynamics(q + half * (qd + 0.5 * half * qdd), qd + half * qdd, qdd)
    np.testing.assert_allclose(found, wanted, rtol=1e-12)


def predicted(gains: DodgeGains, observed: list[Array], at: Array) -> Array:
    """Predicted places of a disc at ``at`` whose velocities were ``observed`` one period apart."""
    memory, instants, trends = new_memory(1, 1), make_instants(gains), np.empty((1, 4))
    values = as_record(gains)
    for velocity in observed:
        observe_discs(values, memory[0], at[None], velocity[None], PERIOD, trends)
        memory[0]["begun"] = True
    places = np.empty((len(instants), 1, 2))
    predict_discs(values, instants, at[None], trends, places)
    return places[:, 0]


def test_the_prediction_of_a_disc_that_takes_on_a_velocity_is_its_closed_form() -> None:
    gains = replace(tuned_gains(), lag=0.2, confidence=1e6, nearest=0.0, farthest=math.inf)
    at, now, wanted = np.array([0.9, -0.2]), np.array([0.5, 0.1]), np.array([-0.3, 0.6])
    before = now - PERIOD / 0.2 * (wanted - now)  # the lag's own slope
    t = 0.05 * np.arange(1, round(gains.horizon / 0.05) + 1)[:, None]
    exact = at + wanted * t - (wanted - now) * 0.2 * (1.0 - np.exp(-t / 0.2))
    np.testing.assert_allclose(predicted(gains, [before, now], at), exact, atol=1e-5)


def test_the_prediction_keeps_out_of_the_ring_round_the_base() -> None:
    gains = replace(tuned_gains(), nearest=0.32, farthest=1.3)
    at = np.array([0.8, 0.05])
    places = predicted(gains, [np.array([-1.0, 0.0])], at)
    away = np.hypot(*places.T)
    assert away.min() == pytest.approx(0.32)
    assert away.max() <= 1.3 + 1e-12


def test_the_tuned_gains_were_not_found_on_the_benchmark() -> None:
    recipe = json.loads(GAINS_FILE.read_text())["recipe"]
    assert recipe["seeds"][0] >= 100_000


@pytest.mark.parametrize(
    "wrong", [{"margin": -0.1}, {"lag": 0.0}, {"evade": 1.5}, {"horizon": 60.0}, {"push": math.nan}, {"nearest": 2.0}]
)
def test_gains_without_sense_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        replace(tuned_gains(), **wrong)


def test_shapes_and_arms_that_do_not_fit_are_refused() -> None:
    rows = random_batch(4, 1)
    with pytest.raises(ValueError, match="shape"):
        dodge_accelerations(ARM, tuned_gains(), *rows, new_memory(5, 1), PERIOD)
    with pytest.raises(ValueError, match="two links"):
        dodge_accelerations(PLANAR_3R, tuned_gains(), *rows, new_memory(4, 1), PERIOD)
