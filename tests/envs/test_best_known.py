"""Stored best known motions: the environment scores them as stored, and they are better than what planners do."""

from __future__ import annotations

import math
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from agents.evaluation.evaluate import evaluate
from envs.best_known import PAPER, best_known, file_of, load, read, write
from envs.card import task_card
from planners import dpct

BELT = "ConveyorTrack-v0"
STORED = (BELT, "MinTorqueMove-v0")


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
    ("env_id", "policies"), [(BELT, ("dpct", "apf", "agent")), ("MinTorqueMove-v0", ("lagrange", "dpct", "agent"))]
)
def test_no_policy_is_better(env_id: str, policies: tuple[str, ...]) -> None:
    known = load(env_id)
    seeds = [key for key in known.keys if key != PAPER]
    values = np.array([known.values[known.keys.index(seed)] for seed in seeds])
    for name in policies:
        scored = evaluate(name, env_id, np.array(seeds))
        assert (values <= scored.metrics[metric_of(env_id)] + 1e-9)[scored.success].all()


def metric_of(env_id: str) -> str:
    bound = task_card(env_id).bound
    assert bound is not None
    return bound.metric


def test_the_papers_own_start_settles_sooner_than_the_line_allows() -> None:
    vector = started({"scenario": "paper"})
    on_the_line = dpct.settling_bound(vector.motion_problem(0), 1e-3, 2e-3, 0.005)
    assert best_known(vector, 0) < 1.1 < 1.4 < on_the_line


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
