"""The paths of the discs: where they may be, how fast, what they are aimed at."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from envs.obstacle_dodge.paths import (
    FARTHEST,
    FASTEST,
    KINDS,
    NEAREST,
    PATH_STEP,
    SPAWN_CLEARANCE,
    follow_points,
)
from envs.obstacle_dodge.scale import Scale
from envs.obstacle_dodge.starts import LEAST_ELBOW, DodgeStarts, ObstacleDodgeOptions
from planners import SCARA_50CM, FixedJoints, MotionProblem, trapezoid

START, END = np.array([-0.5, 1.0]), np.array([1.2, 1.4])


def drawn(seed: int, kind: int, speed: float | None = None) -> np.ndarray:
    goal = SCARA_50CM.forward_kinematics(END)
    options = ObstacleDodgeOptions(
        start=tuple(START), goal=tuple(goal), obstacle_kind=KINDS[kind], obstacle_speed=speed
    )
    starts = DodgeStarts(SCARA_50CM, SCARA_50CM.limits, 801, 1, Scale(1.0, 1.0))
    (episode,) = starts.draw([np.random.default_rng(seed)], options)
    return np.frombuffer(episode.path).reshape(801, 2)


@given(st.integers(0, 10**6), st.sampled_from(range(len(KINDS))))
@settings(max_examples=60, deadline=None)
def test_every_path_keeps_to_the_rules(seed: int, kind: int) -> None:
    path = drawn(seed, kind)
    away = np.hypot(*path.T)
    assert away.min() >= NEAREST - 1e-12
    assert away.max() <= FARTHEST + 1e-12
    steps = np.hypot(*np.diff(path, axis=0).T) / PATH_STEP
    assert steps.max() <= FASTEST * (1.0 + 1e-9)
    assert steps.max() > 0.1
    assert SCARA_50CM.clearance(START, path[0], 0.1) >= SPAWN_CLEARANCE
    goal = SCARA_50CM.forward_kinematics(END)
    assert np.hypot(*(path[0] - goal)) - 0.1 - SCARA_50CM.link_radius >= SPAWN_CLEARANCE


@pytest.mark.parametrize("kind", range(len(KINDS)))
def test_a_generator_fixes_the_path(kind: int) -> None:
    np.testing.assert_array_equal(drawn(5, kind), drawn(5, kind))
    assert (drawn(5, kind) != drawn(6, kind)).any()


def test_a_velocity_lags_behind_its_leg() -> None:
    """The turn from one leg to the next takes time: no jump of the velocity, beyond what the lag allows."""
    velocity = np.diff(drawn(3, KINDS.index("waypoints"), 0.5), axis=0) / PATH_STEP
    jump = np.hypot(*np.diff(velocity, axis=0).T)
    inside = np.hypot(*drawn(3, 0, 0.5).T)
    free = (inside[1:-1] > NEAREST + 0.01) & (inside[1:-1] < FARTHEST - 0.01)
    assert jump[free].max() <= 2.0 * 0.5 * (1.0 - math.exp(-PATH_STEP / 0.2)) * (1.0 + 1e-9)


def test_a_pass_hits_an_arm_that_moves_straight() -> None:
    """Aimed at a point inside of the arm, so it touches it on the way, unless the base hides the arm."""
    limits = SCARA_50CM.limits
    plan = trapezoid.plan(MotionProblem(SCARA_50CM, START, FixedJoints(END), 8.0, limits=limits))
    hits = 0
    for seed in range(40):
        path = drawn(seed, KINDS.index("passes"), 0.6)
        q = plan.at(PATH_STEP * np.arange(len(path)))[0]
        hits += bool((SCARA_50CM.clearance(q, path, 0.1) < 0.0).any())
    assert hits >= 36  # now and then the base is in the way


def test_a_given_speed_is_kept() -> None:
    steps = np.hypot(*np.diff(drawn(1, KINDS.index("passes"), 0.4), axis=0).T) / PATH_STEP
    assert steps[:20] == pytest.approx(0.4)
    wandering = [np.hypot(*np.diff(drawn(s, KINDS.index("wander"), 0.3), axis=0).T) / PATH_STEP for s in range(30)]
    assert math.sqrt(np.mean(np.square(wandering))) == pytest.approx(0.3, rel=0.2)


def test_points_are_followed_at_constant_speed_up_to_the_last() -> None:
    path = follow_points(np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 0.5]]), 0.5, 801)
    np.testing.assert_allclose(path[100], [0.5, 1.0], atol=1e-12)
    np.testing.assert_allclose(path[250], [1.0, 0.75], atol=1e-12)
    np.testing.assert_allclose(path[301:], np.tile([1.0, 0.5], (500, 1)), atol=1e-12)


def test_starts_drawn_together_equal_those_drawn_one_by_one() -> None:
    starts, options = DodgeStarts(SCARA_50CM, SCARA_50CM.limits, 801, 2, Scale(1.0, 1.0)), ObstacleDodgeOptions()
    together = starts.draw([np.random.default_rng(seed) for seed in range(20)], options)
    for seed, episode in enumerate(together):
        generator = np.random.default_rng(seed)
        (alone,) = starts.draw([generator], options)
        assert alone.path == episode.path
        np.testing.assert_array_equal(alone.goal, episode.goal)


def test_the_random_numbers_are_those_of_numpy() -> None:
    """The first that are drawn are two joint angles, uniform over the ranges, and drawn again for a straight elbow."""
    starts = DodgeStarts(SCARA_50CM, SCARA_50CM.limits, 801, 1, Scale(1.0, 1.0))
    limits = SCARA_50CM.limits
    for seed in range(10):
        (episode,) = starts.draw([np.random.default_rng(seed)], ObstacleDodgeOptions(goal=(0.3, 0.5)))
        generator = np.random.default_rng(seed)
        q = np.zeros(2)
        while abs(q[1]) < LEAST_ELBOW:
            q = generator.uniform(np.maximum(limits.angle_lower, -np.pi), np.minimum(limits.angle_upper, np.pi))
        np.testing.assert_array_equal(episode.start, q)
