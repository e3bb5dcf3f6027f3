"""Motions among discs whose future is known, checked again from outside at every millisecond."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planners import PLANAR_3R, SCARA_50CM, UnreachableTarget
from planners.motion.spacetime import Answer, search
from planners.typing import Array

STEP, HORIZON, RADIUS, TOLERANCE, HOLD = 0.01, 8.0, 0.1, 0.03, 0.5
SAMPLES = round(HORIZON / STEP) + 1
START = np.array([-0.6, 0.9])
GOAL = SCARA_50CM.forward_kinematics([0.9, 1.2])
PLANNING = replace(SCARA_50CM.limits, acceleration=(4.5, 8.0))


def parked(x: float, y: float) -> Array:
    return np.tile([[[x, y]]], (SAMPLES, 1, 1))


def straight(origin: Array, velocity: Array) -> Array:
    return (origin + STEP * np.arange(SAMPLES)[:, None] * velocity)[:, None, :]


def crossing(seed: int, discs: int = 1) -> tuple[Array, Array, Array]:
    """A start, a goal, and discs that go straight through the workspace, clear of the arm at the start."""
    generator = np.random.default_rng(seed)
    arm = SCARA_50CM
    while True:
        q, end = generator.uniform(-1.0, 1.0, (2, 2)) * [2.8, 2.5]
        goal = arm.forward_kinematics(end)
        if np.hypot(*(goal - arm.forward_kinematics(q))) > 0.4:
            break
    paths: list[Array] = []
    while len(paths) < discs:
        turn, aside, speed = generator.uniform([-np.pi, -0.8, 0.2], [np.pi, 0.8, 1.0])
        way = np.array([np.cos(turn), np.sin(turn)])
        path = straight(aside * np.array([-way[1], way[0]]) - 1.3 * way, speed * way)
        if arm.clearance(q, path[0, 0], RADIUS) > 0.3 and np.hypot(*path[:, 0].T).min() > 0.3:
            paths.append(path)
    return q, goal, np.concatenate(paths, axis=1)


def capsule_samples(q: Array) -> Array:
    """Points on both links' axes, 5 mm apart, ``(..., points, 2)``."""
    share = np.linspace(0.0, 1.0, 101)[:, None]
    inner = 0.5 * np.stack([np.cos(q[..., 0]), np.sin(q[..., 0])], axis=-1)
    phi = q[..., 0] + q[..., 1]
    outer = 0.5 * np.stack([np.cos(phi), np.sin(phi)], axis=-1)
    return np.concatenate([share * inner[..., None, :], inner[..., None, :] + share * outer[..., None, :]], axis=-2)


def check(answer: Answer, q: Array, goal: Array, path: Array) -> None:
    """Everything that was asked, at every millisecond, by means of its own."""
    motion = answer.trajectory
    assert answer.verdict == "found"
    assert motion is not None
    t = np.linspace(0.0, motion.duration, round(motion.duration / 1e-3) + 1)
    angles, speeds, _ = motion.at(t)
    np.testing.assert_allclose(motion.q[0], q)
    assert not motion.qd[0].any()
    assert np.abs(angles).max(axis=0) == pytest.approx(np.minimum(np.abs(angles).max(axis=0), PLANNING.angle))
    # velocity and acceleration from the angles alone
    assert np.all(np.abs(np.diff(angles, axis=0)) <= 1e-3 * np.array(PLANNING.velocity) * (1.0 + 1e-6))
    assert np.all(np.abs(np.diff(angles, 2, axis=0)) <= 1e-6 * np.array(PLANNING.acceleration) * 1.01)
    assert np.abs(speeds - np.gradient(angles, 1e-3, axis=0)).max() < 0.01
    assert motion.limit_ratio <= 1.0 + 1e-9
    # the hand
    hand = capsule_samples(angles)[:, -1]
    away = np.hypot(*(hand - goal).T)
    held = t >= motion.rendezvous_time - 1e-9
    assert away[held].max() <= TOLERANCE + 1e-9
    assert motion.duration == pytest.approx(motion.rendezvous_time + HOLD)
    assert motion.duration <= HORIZON + 1e-9
    assert answer.time_to_goal == motion.rendezvous_time
    assert away[t <= motion.rendezvous_time - STEP - 1e-9].min(initial=np.inf) > 0.0
    # the discs
    place = t / STEP
    for k in range(path.shape[1]):
        x, y = (np.interp(place, np.arange(len(path)), path[:, k, axis]) for axis in (0, 1))
        center = np.stack([x, y], axis=1)[:, None, :]
        distance = np.hypot(*np.moveaxis(capsule_samples(angles) - center, -1, 0)).min(axis=1)
        assert distance.min() >= RADIUS + SCARA_50CM.link_radius


def dodge(q: Array, goal: Array, path: Array, **options: Any) -> Answer:
    return search(SCARA_50CM, q, goal, path, STEP, [RADIUS] * path.shape[1], **options)


@pytest.mark.parametrize("seed", range(12))
def test_motions_keep_what_was_asked(seed: int) -> None:
    q, goal, path = crossing(seed)
    answer = dodge(q, goal, path, nodes=400_000)
    check(answer, q, goal, path)


def test_four_discs_are_kept_clear_of() -> None:
    q, goal, path = crossing(3, discs=4)
    check(dodge(q, goal, path, nodes=400_000), q, goal, path)


def least_rest_time(distance: float, top: float, a: float) -> float:
    """From rest to rest: a triangle of speed, or a trapezoid."""
    return 2.0 * np.sqrt(distance / a) if distance <= top**2 / a else distance / top + top / a


@settings(max_examples=25, deadline=None)
@given(st.tuples(st.floats(-2.7, 2.7), st.floats(-2.6, 2.6)), st.tuples(*2 * [st.floats(-2.4, 2.4)]))
def test_alone_it_is_as_fast_as_the_closed_form(q: tuple[float, float], end: tuple[float, float]) -> None:
    goal = SCARA_50CM.forward_kinematics(end)
    answer = search(SCARA_50CM, q, goal, np.empty((SAMPLES, 0, 2)), STEP, [])
    assert answer.trajectory is not None
    rests = []
    for posture in SCARA_50CM.inverse_kinematics(goal):
        if np.all(np.abs(posture) <= PLANNING.angle):
            ways = zip(np.abs(posture - q), PLANNING.velocity, PLANNING.acceleration, strict=True)
            rests.append(max(least_rest_time(*way) for way in ways))
    # it may enter the tolerance before it would be at rest in its middle, and is seen to at the next sample only
    assert answer.time_to_goal <= min(rests) + STEP
    assert answer.time_to_goal >= answer.lower_bound
    assert answer.time_to_goal - answer.lower_bound <= 0.05 + STEP


def test_a_disc_parked_on_the_goal_makes_it_impossible() -> None:
    answer = dodge(START, GOAL, parked(*GOAL))
    assert answer.verdict == "exhausted"
    assert answer.trajectory is None
    assert answer.time_to_goal == answer.lower_bound == np.inf


def test_a_disc_that_leaves_the_goal_late_is_waited_for() -> None:
    leaves = round(3.0 / STEP)
    path = parked(*GOAL)
    path[leaves:, 0] = GOAL + np.minimum(STEP * np.arange(SAMPLES - leaves), 1.0)[:, None] * GOAL / np.hypot(*GOAL)
    answer = dodge(START, GOAL, path)
    check(answer, START, GOAL, path)
    # hand and disc cannot both be there before the disc has gone by the sum of radii, less the tolerance
    gone = 3.0 + RADIUS + SCARA_50CM.link_radius - TOLERANCE
    assert gone - STEP <= answer.time_to_goal <= gone + 0.5


def test_a_search_that_may_keep_too_few_states_says_so() -> None:
    # beside the goal: the hand could be there, but not the forearm
    answer = dodge(START, GOAL, parked(*(0.85 * GOAL)), nodes=2_000)
    assert answer.verdict == "gave up"
    assert answer.trajectory is None
    assert 0.0 < answer.lower_bound < HORIZON


def test_a_disc_parked_far_away_changes_nothing() -> None:
    alone = search(SCARA_50CM, START, GOAL, np.empty((SAMPLES, 0, 2)), STEP, [])
    beside = dodge(START, GOAL, parked(-3.0, 3.0))
    assert alone.trajectory is not None
    assert beside.trajectory is not None
    assert alone.expanded == beside.expanded
    np.testing.assert_array_equal(alone.trajectory.q, beside.trajectory.q)


@pytest.mark.parametrize("seed", [1, 4])
def test_the_mirrored_problem_takes_as_long(seed: int) -> None:
    q, goal, path = crossing(seed)
    flip = np.array([1.0, -1.0])
    answer, mirrored = dodge(q, goal, path), dodge(-q, flip * goal, flip * path)
    # states are tried in another order, so both are only within the gap of the lattice's best
    assert abs(answer.time_to_goal - mirrored.time_to_goal) <= 0.05 + STEP


def test_it_is_deterministic() -> None:
    first, second = (dodge(*crossing(0)) for _ in range(2))
    assert first.trajectory is not None
    assert second.trajectory is not None
    assert (first.expanded, first.lower_bound) == (second.expanded, second.lower_bound)
    np.testing.assert_array_equal(first.trajectory.q, second.trajectory.q)


def test_more_acceleration_is_no_slower() -> None:
    q, goal, path = crossing(2)
    assert dodge(q, goal, path, limits=SCARA_50CM.limits).time_to_goal <= dodge(q, goal, path).time_to_goal + STEP


def test_what_makes_no_sense_is_refused() -> None:
    path = parked(1.0, 1.0)
    with pytest.raises(ValueError, match="two"):
        search(PLANAR_3R, START, GOAL, path, STEP, [RADIUS])
    with pytest.raises(ValueError, match="must not end before 8"):
        dodge(START, GOAL, path[:100])
    with pytest.raises(ValueError, match="path has shape"):
        search(SCARA_50CM, START, GOAL, path, STEP, [RADIUS, RADIUS])
    with pytest.raises(ValueError, match="multiples of"):
        dodge(START, GOAL, path, time_steps=[0.025])
    with pytest.raises(ValueError, match="out of the joints' ranges"):
        dodge(np.array([3.0, 0.0]), GOAL, path)
    with pytest.raises(UnreachableTarget):
        dodge(START, np.array([1.2, 0.0]), path)
