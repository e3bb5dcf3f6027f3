"""What is remembered of a disc, and the features of it: against discs whose legs are known."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import envs  # noqa: F401  # registers the ids
from agents.policies.forecasting.features import FEATURES, disc_features
from agents.policies.forecasting.futures import going_on
from agents.policies.forecasting.policy import aimed_move
from agents.policies.forecasting.track import MOVE, PERIOD, RESTLESS, follow_disc, new_tracks
from envs.obstacle_dodge.paths import LAG, PATH_STEP
from planners import SCARA_50CM
from planners.typing import Array

ARM = SCARA_50CM
MOVE_HERE = aimed_move(ARM, ARM.limits, np.array([-0.5, 1.0]), ARM.forward_kinematics([1.2, 1.4]))
FOLLOW = 1.0 - math.exp(-PATH_STEP / LAG)

Leg = tuple[tuple[float, float], float, float]
"""Where a leg ends, m; at which pace it is followed, m/s; and until when, s."""


def led_disc(place: tuple[float, float], velocity: tuple[float, float], legs: list[Leg]) -> Array:
    """A disc that homes on the end of one leg after the other, with a lag; ``(samples, 2)``."""
    at, v, path = np.array(place), np.array(velocity), []
    for sample in range(round(legs[-1][2] / PATH_STEP) + 1):
        path.append(at)
        end, pace, _ = next(leg for leg in legs if leg is legs[-1] or sample * PATH_STEP < leg[2])
        way = np.array(end) - at
        v = v + FOLLOW * (pace * way / np.hypot(*way) - v)
        at = at + PATH_STEP * v
    return np.array(path)


def watched(path: Array, move: Any = MOVE_HERE) -> Iterator[tuple[float, Any]]:
    """The time and the track after each observation of a disc that begins as an episode does."""
    track = new_tracks(1)[0]
    for now in range(0, len(path), 2):
        since = max(now, 1)
        follow_disc(track, move, path[now], (path[since] - path[since - 1]) / PATH_STEP)
        yield now * PATH_STEP, track


def at_last(path: Array, move: Any = MOVE_HERE) -> Any:
    return [track for _, track in watched(path, move)][-1]


def drawn(episodes: int, **options: Any) -> tuple[NDArray[Any], Array]:
    """Moves and discs of random episodes, ``(episodes,)`` and ``(episodes, samples, 2)``."""
    with closing(gym.make_vec("ObstacleDodge-v0", num_envs=episodes)) as env:
        observations = env.reset(seed=[7000 + i for i in range(episodes)], options=options)[0]  # type: ignore[arg-type]
        task = env.unwrapped.task  # type: ignore[attr-defined]
        moves, paths = np.zeros(episodes, MOVE), []
        for env_index, observation in enumerate(observations):
            problem = task.motion_problem(observation)
            moves[env_index] = aimed_move(ARM, problem.joint_limits, problem.q, problem.target.position)
            paths.append(task.obstacle_path(env_index)[:, 0] - ARM.base_array)
    return moves, np.array(paths)


def test_the_wanted_velocity_of_a_disc_is_recovered_while_it_takes_it_on() -> None:
    wanted, at, v, path = np.array([-0.3, 0.45]), np.array([0.9, -0.4]), np.array([0.2, 0.1]), []
    for _ in range(101):
        path.append(at)
        v = v + FOLLOW * (wanted - v)
        at = at + PATH_STEP * v
    for t, track in watched(np.array(path)):
        if t > 0.0:
            np.testing.assert_allclose(track["wanted"], wanted, atol=1e-6)
    assert track["turns"] == track["paces"] == 0.0
    assert track["age"] == pytest.approx(t - PERIOD)  # the first change is seen in the second observation


def test_going_on_is_where_a_disc_with_that_wanted_velocity_goes() -> None:
    wanted, at, v, path = np.array([-0.3, 0.45]), np.array([0.9, -0.4]), np.array([0.2, 0.1]), []
    for _ in range(181):
        path.append(at)
        v = v + FOLLOW * (wanted - v)
        at = at + PATH_STEP * v
    track = at_last(np.array(path[:21]))
    for t in (0.1, 0.5, 1.5):
        # The lag is followed in steps of 10 ms there, and continuously here.
        np.testing.assert_allclose(going_on(track, t), path[20 + round(t / PATH_STEP)], atol=2e-3)


@pytest.mark.parametrize("end", [(-0.5, 0.9), (0.6, -0.9), (1.0, 0.7), (-0.9, -0.6)])
@pytest.mark.parametrize("pace", [0.2, 0.5, 1.0])
def test_the_end_of_a_leg_is_found_where_the_lines_towards_it_cross(end: tuple[float, float], pace: float) -> None:
    """Begun at right angles, so the direction to the end changes as the disc comes round."""
    place = np.array([0.5, 0.4])
    way = np.array(end) - place
    across = 0.7 * np.array([-way[1], way[0]]) / np.hypot(*way)
    path = led_disc((0.5, 0.4), (float(across[0]), float(across[1])), [(end, pace, 0.4)])
    track = at_last(path)
    assert track["crossing"] > 0.0
    np.testing.assert_allclose(track["end"], end, atol=0.01)
    assert track["turns"] == track["paces"] == 0.0


def test_a_turn_is_counted_and_told_from_a_change_of_pace() -> None:
    first: Leg = ((0.9, 0.9), 0.5, 0.4)
    same = at_last(led_disc((0.5, -0.4), (0.0, 0.5), [first, ((-1.0, 0.2), 0.5, 0.8)]))
    assert (same["turns"], same["paces"]) == (1.0, 0.0)
    np.testing.assert_allclose(same["end"], (-1.0, 0.2), atol=0.01)
    other = at_last(led_disc((0.5, -0.4), (0.0, 0.5), [first, ((-1.0, 0.2), 0.8, 0.8)]))
    assert (other["turns"], other["paces"]) == (0.0, 1.0)
    assert same["age"] == other["age"] == pytest.approx(0.4, abs=1.5 * PERIOD)
    twice = at_last(led_disc((0.5, -0.4), (0.0, 0.5), [first, ((-1.0, 0.2), 0.8, 0.8), ((0.5, -0.8), 0.8, 1.2)]))
    assert (twice["turns"], twice["paces"]) == (1.0, 1.0)


def test_a_leg_that_has_just_begun_has_no_known_end() -> None:
    path = led_disc((0.5, -0.4), (-0.5, 0.0), [((0.9, 0.9), 0.5, 0.4), ((-1.0, 0.2), 0.5, 0.8)])
    known = {round(t, 2): track["crossing"] > 0.0 for t, track in watched(path)}
    assert known[0.38]
    assert not known[0.42]
    assert known[0.6]


@pytest.mark.parametrize(("pace", "error"), [(0.2, math.inf), (0.5, 0.1), (1.0, 0.05)])
@pytest.mark.parametrize("heading", [(0.8, 0.3), (-0.9, -0.1)])
def test_rounded_observations_do_not_look_like_turns(pace: float, error: float, heading: tuple[float, float]) -> None:
    """Observations have single precision; of a slow disc they tell little of where its leg ends."""
    path, track = (
        led_disc((0.9, -0.7), (pace * heading[0], pace * heading[1]), [((0.4, 1.0), pace, 0.8)]),
        new_tracks(1)[0],
    )
    for now in range(0, len(path), 2):
        since = max(now, 1)
        seen = np.array([path[now], (path[since] - path[since - 1]) / PATH_STEP], dtype=np.float32)
        follow_disc(track, MOVE_HERE, *seen.astype(float))
    assert track["turns"] == track["paces"] == 0.0
    assert track["crossing"] > 0.0
    assert np.hypot(*(track["end"] - (0.4, 1.0))) < error


def test_discs_that_wander_become_restless_and_those_on_legs_do_not() -> None:
    """A wandering disc at its top speed looks as if it followed a leg, but not for long."""
    for kind in ("wander", "waypoints", "passes"):
        seen = np.array(
            [
                [float(track["restlessness"]) for _, track in watched(path[:161], move)]
                for move, path in zip(*drawn(40, obstacle_kind=kind), strict=True)
            ]
        )
        if kind == "wander":
            assert (seen.max(axis=1) > RESTLESS).all()
            assert (seen[:, 20:] > RESTLESS).mean() > 0.75
        else:
            assert seen.max() < 0.5 * RESTLESS


def test_a_drawn_disc_is_aimed_at_the_moving_arm() -> None:
    """When and how close it comes, if it goes on: against the arm's clearance from it, in small steps of time."""
    moves, paths = drawn(40, obstacle_kind="passes", obstacle_speed=0.6)
    t = np.arange(0.0, 3.0, 0.01)
    close = 0
    for move, path in zip(moves, paths, strict=True):
        track = at_last(path[:2], move)
        velocity = (path[1] - path[0]) / PATH_STEP
        ramped = np.array([straight_share(move, at) for at in t])
        q = move["start"] + ramped[:, None] * move["change"]
        gaps = ARM.clearance(q, ARM.base_array + path[0] + t[:, None] * velocity, 0.0) + ARM.link_radius
        assert track["aim_gap"] >= gaps.min() - 0.02
        if gaps.min() < 0.01:
            close += 1
            meets = t[gaps < 0.07]
            assert meets.min() - 0.1 <= track["aim_time"] <= meets.max() + 0.1
            assert track["aim_gap"] < 0.05
    assert close >= 30


def test_a_disc_is_aimed_at_the_outer_half_of_the_arm() -> None:
    """At one that stands still: it crosses the inner half of the first link, 0.15 m from the middle of it."""
    move = MOVE_HERE.copy()
    move["start"], move["change"] = (0.0, 1.5), 0.0
    track = at_last(np.array([(0.1, -0.9), (0.1, -0.895)]), move)
    assert track["aim_gap"] == pytest.approx(0.15, abs=1e-3)
    assert track["aim_time"] == pytest.approx(1.8, abs=0.06)


def straight_share(move: Any, t: float) -> float:
    """Share of the straight move that is done: the integral of a trapezoid of speed."""
    top, ramp = float(move["top"]), float(move["ramp"])
    speed = np.interp(np.linspace(0.0, t, 400), [0.0, ramp, 1.0 / top, 1.0 / top + ramp], [0.0, top, top, 0.0])
    return float(np.trapezoid(speed, dx=t / 399.0))


def test_a_goal_out_of_reach_is_moved_to_nowhere() -> None:
    move = aimed_move(ARM, ARM.limits, np.array([0.2, 1.0]), np.array([3.0, 0.0]))
    np.testing.assert_array_equal(move["change"], 0.0)
    features = np.empty(FEATURES)
    disc_features(at_last(led_disc((0.9, -0.7), (-0.2, 0.3), [((0.4, 1.0), 0.4, 0.5)]), move), move, features)
    assert np.isfinite(features).all()


def turned(vectors: Array, angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    rotated: Array = vectors @ np.array([[c, s], [-s, c]])
    return rotated


def features_of(path: Array, move: Any) -> Array:
    """At every instant, ``(instants, FEATURES)``."""
    rows = []
    for _, track in watched(path, move):
        rows.append(np.full(FEATURES, np.nan))
        c, s = disc_features(track, move, rows[-1])
        assert math.hypot(c, s) == pytest.approx(1.0)
    return np.array(rows)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 39), st.floats(-3.0, 3.0))
def test_features_do_not_change_when_the_scene_turns_about_the_base(episode: int, angle: float) -> None:
    path, move = PATHS[episode][:61], MOVES[episode]
    other = move.copy()
    other["start"][0] += angle
    np.testing.assert_allclose(features_of(turned(path, angle), other), features_of(path, move), atol=1e-9)


ACROSS = [2, 4, 13, 20, 22, 24, 26, 31, 33, 35]
"""Features that tell left from right."""


@pytest.mark.parametrize("episode", range(12))
def test_in_a_mirror_only_left_and_right_change(episode: int) -> None:
    path, move = PATHS[episode][:61], MOVES[episode]
    other = move.copy()
    other["start"], other["change"] = -move["start"], -move["change"]
    here, there = features_of(path, move), features_of(path * [1.0, -1.0], other)
    signs = np.ones(FEATURES)
    signs[ACROSS] = -1.0
    np.testing.assert_allclose(there, signs * here, atol=1e-9)
    assert np.abs(here[:, ACROSS]).max() > 0.1


def test_features_are_finite_and_of_moderate_size_whatever_is_drawn() -> None:
    for kind in ("wander", "waypoints", "passes"):
        for move, path in zip(*drawn(60, obstacle_kind=kind), strict=True):
            features = features_of(path[:401], move)
            assert np.isfinite(features).all()
            assert np.abs(features).max() < 10.0


MOVES, PATHS = drawn(40)
