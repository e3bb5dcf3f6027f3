"""Stored best known motions: the environment scores them as stored, and they are better than what planners do."""

from __future__ import annotations

import math
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from agents.evaluation.evaluate import evaluate
from agents.evaluation.summarise import LIMIT_TOLERANCE
from envs.best_known import PAPER, best_known, file_of, load, read, write
from envs.card import task_card
from envs.obstacle_dodge.bound import as_counted, solve, time_to_goal
from planners import dpct
from tools.best_known.lower import VARIATION, Joint, Ranges, can_be_there
from tools.best_known.playback import play_actions

BELT = "ConveyorTrack-v0"
DODGE = "ObstacleDodge-v0"
STORED = (BELT, "MinTorqueMove-v0", DODGE)


def played(env: Any, key: int, actions: Any) -> dict[str, Any]:
    env.reset(seed=max(key, 0), options={"scenario": "paper"} if key == PAPER else {})
    for action in actions:
        _, _, _, _, info = env.step(action)
    return dict(info)


@pytest.mark.parametrize("env_id", STORED)
def test_the_environment_scores_every_stored_motion_as_stored(env_id: str) -> None:
    env, known, metric = gym.make(env_id), load(env_id), metric_of(env_id)
    assert len(known.keys) == len(set(known.keys)) >= 4
    for key, value, actions in zip(known.keys, known.values, known.actions, strict=True):
        info = played(env, key, actions)
        assert info["is_success"]
        assert info["limit_ratio"] <= 1.0 + env.unwrapped.task.config.limit_tolerance  # type: ignore[attr-defined]
        assert info[metric] == pytest.approx(value)


@pytest.mark.parametrize(
    ("env_id", "policies"),
    [
        (BELT, ("dpct", "apf", "agent")),
        ("MinTorqueMove-v0", ("lagrange", "dpct", "agent")),
        (DODGE, ("apf", "follower", "agent")),
    ],
)
def test_no_policy_is_better(env_id: str, policies: tuple[str, ...]) -> None:
    known = load(env_id)
    seeds = [key for key in known.keys if key != PAPER][:32]
    values = np.array([known.values[known.keys.index(seed)] for seed in seeds])
    for name in policies:
        scored = evaluate(name, env_id, np.array(seeds))
        counted = scored.success & (scored.metrics["limit_ratio"] <= 1.0 + LIMIT_TOLERANCE)
        assert (values <= scored.metrics[metric_of(env_id)] + 1e-9)[counted].all()


@pytest.mark.parametrize("env_id", [BELT, DODGE])
def test_no_stored_motion_is_better_than_its_lower_bound(env_id: str) -> None:
    known = load(env_id)
    lower, values = np.array(known.lower), np.array(known.values)
    assert (lower > 0.0).all()
    assert (lower <= values + 1e-9).all()
    assert (lower > values - 1e-9).sum() >= 8  # some motions are proven to be the best
    pytest.importorskip("casadi")
    from tools.best_known.__main__ import TASKS

    env: Any = gym.make(env_id)
    for key in known.keys[:3]:
        assert TASKS[env_id].lower(env, key) == pytest.approx(known.lower[known.keys.index(key)])


def test_a_joint_moves_and_stops_no_sooner_than_its_acceleration_allows() -> None:
    joint = Joint(start=0.0, velocity=10.0, acceleration=1.0, jerk=math.inf, period=0.02)
    there, at_rest = (np.array([1.0]), np.array([1.0])), (np.zeros(1), np.zeros(1))
    in_two_seconds = [can_be_there(joint, periods, Ranges(there, at_rest)) for periods in (98, 101)]
    passing = Ranges(there, (np.full(1, -10.0), np.full(1, 10.0)))
    in_the_root_of_two = [can_be_there(joint, periods, passing) for periods in (69, 72)]
    assert in_two_seconds == in_the_root_of_two == [False, True]
    smooth = joint._replace(jerk=4.0)  # 2.14 s: 0.25 s for each change of the acceleration by 1
    assert [can_be_there(smooth, periods, Ranges(there, at_rest)) for periods in (104, 109)] == [False, True]


@pytest.mark.parametrize("env_id", [BELT, DODGE])
def test_within_a_control_period_accelerations_vary_less_than_the_lower_bounds_assume(env_id: str) -> None:
    env: Any = gym.make(env_id)
    known, arm, period = load(env_id), env.unwrapped.task.arm, env.unwrapped.task.config.control_period
    for key, actions in list(zip(known.keys, known.actions, strict=True))[:16]:
        q, qd = play_actions(env, key, actions).motion
        drift = np.abs(np.diff(q, axis=0) - period * (qd[1:] + qd[:-1]) / 2.0)
        assert (drift <= VARIATION * arm.limits.array("acceleration") * period**2 / 12.0).all()


def metric_of(env_id: str) -> str:
    bound = task_card(env_id).bound
    assert bound is not None
    return bound.metric


def test_the_papers_own_start_settles_sooner_than_the_line_allows() -> None:
    vector = started({"scenario": "paper"})
    on_the_line = dpct.settling_bound(vector.motion_problem(0), 1e-3, 2e-3, 0.005)
    assert best_known(vector, 0) < 1.1 < 1.4 < on_the_line


def test_a_start_with_another_path_of_the_disc_is_another_start(monkeypatch: pytest.MonkeyPatch) -> None:
    env: Any = gym.make_vec(DODGE, num_envs=1).unwrapped
    env.reset(seed=load(DODGE).keys[1])
    assert math.isfinite(best_known(env, 0))
    other = env.task.table(0) + np.linspace(0.0, 0.1, len(env.task.table(0)))[:, None, None]
    monkeypatch.setattr(env.task, "table", lambda env_index: other)
    assert math.isnan(best_known(env, 0))


def test_motions_are_searched_for_where_none_is_stored() -> None:
    env: Any = gym.make_vec(DODGE, num_envs=1).unwrapped
    env.reset(seed=5, options={"obstacle_kind": "wander", "obstacle_speed": 0.2})
    assert math.isnan(best_known(env, 0))
    assert time_to_goal(env, 0, 5) == as_counted(solve(env, 0), env)


def started(options: dict[str, Any], **settings: Any) -> Any:
    vector = gym.make_vec(BELT, num_envs=2, **settings)
    vector.reset(seed=0, options=options)
    return vector.unwrapped


def test_starts_are_known_by_what_they_are() -> None:
    known = load(BELT)
    assert best_known(started({}), 0) == known.values[known.keys.index(0)]
    assert best_known(started({"scenario": "paper"}), 1) == known.values[known.keys.index(PAPER)]
    assert math.isnan(best_known(started({"belt_speed": 0.15}), 0))
    assert math.isnan(best_known(started({}, payload=0.1), 0))


def test_a_file_holds_what_was_written(tmp_path: Any) -> None:
    known = read(file_of(BELT))
    write(tmp_path / "again.npz", known)
    again = read(tmp_path / "again.npz")
    assert (again.recipe, again.keys, again.values) == (known.recipe, known.keys, known.values)
    assert all(np.array_equal(one, other) for one, other in zip(again.actions, known.actions, strict=True))
    assert read(tmp_path / "none.npz").keys == []
