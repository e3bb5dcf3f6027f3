"""The stored bound of ObstacleDodge-v0: that of today's episodes, and reached in the environment itself."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from envs.experts.planning import PlanningExpert
from envs.obstacle_dodge import bound as dodge_bound
from envs.obstacle_dodge.bound import ENV_ID, FILE, stored_bound
from tools import dodge_bound as search
from tools.dodge_bound import DodgeBoundOptions, fingerprint, main

QUICK = [1, 4, 5, 6]
"""Seeds that take little time."""


@pytest.fixture
def env() -> Any:
    return gym.make_vec(ENV_ID, num_envs=max(QUICK) + 1)


def test_it_is_of_todays_episodes() -> None:
    stored = dodge_bound.load()
    assert stored.recipe["episodes"] == fingerprint()
    assert {name: stored.recipe[name] for name in dodge_bound.SETTINGS} == dodge_bound.SETTINGS
    assert len(stored.verdicts) == len(stored.time_to_goal) == len(stored.lower_bound) == 1000
    assert FILE.stat().st_size < 60_000


def test_times_are_between_their_bound_and_the_horizon() -> None:
    stored = dodge_bound.load()
    times = stored_bound(range(1000))
    letters = np.array(list(stored.verdicts))
    assert np.all(np.isinf(times) == (letters == "x"))
    assert np.all(np.isnan(times) == (letters == "?"))
    found = letters == "f"
    lower = np.array([math.nan if value is None else value for value in stored.lower_bound])
    assert np.all(times[found] >= lower[found])
    assert np.all(times[found] + 0.5 <= 8.0 + 0.02)
    assert np.isnan(stored_bound([-1, 1000])).all()


def test_searching_again_gives_what_is_stored(env: Any) -> None:
    env.reset(seed=0)
    for seed in QUICK:
        answer = dodge_bound.solve(env.unwrapped, seed)
        assert stored_bound([seed])[0] == pytest.approx(answer.time_to_goal, abs=0.02 + 1e-9)


def test_the_leaderboards_bound_is_stored_for_the_standard_episodes_and_searched_for_in_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked = []
    solve = dodge_bound.solve
    monkeypatch.setattr(dodge_bound, "solve", lambda env, env_index: asked.append(env_index) or solve(env, env_index))
    batch: Any = gym.make_vec(ENV_ID, num_envs=2)
    batch.reset(seed=4)
    assert dodge_bound.time_to_goal(batch.unwrapped, 1, 5) == stored_bound([5])[0]
    assert not asked
    batch.reset(seed=4, options={"obstacle_kind": "wander", "obstacle_speed": 0.2})
    assert math.isfinite(dodge_bound.time_to_goal(batch.unwrapped, 1, 5))
    assert asked == [1]


def test_motions_succeed_in_the_environment(env: Any) -> None:
    env.reset(seed=0)
    for seed in QUICK:
        motion = dodge_bound.solve(env.unwrapped, seed).trajectory
        assert motion is not None
        info = replay(seed, motion)
        assert info["is_success"]
        assert info["time_to_goal"] == pytest.approx(stored_bound([seed])[0])


def replay(seed: int, motion: Any) -> dict[str, Any]:
    """The info at the end of an episode in which a motion is tracked."""
    single = gym.make(ENV_ID)
    observation, info = single.reset(seed=seed)
    expert = PlanningExpert(single.unwrapped.task, lambda problem: motion)  # type: ignore[attr-defined]
    state, ended = None, False
    while not ended:
        action, state = expert.predict(observation, state)
        observation, _, terminated, truncated, info = single.step(action)
        ended = terminated or truncated
    return info


def test_it_goes_on_from_what_was_made_in_the_same_way(tmp_path: Path) -> None:
    path = tmp_path / "bound.json"
    main(DodgeBoundOptions(seeds=1, out=path))
    document = json.loads(path.read_text())
    document["time_to_goal"][0] = 7.0
    path.write_text(json.dumps(document))
    main(DodgeBoundOptions(seeds=2, out=path))
    assert json.loads(path.read_text())["time_to_goal"] == [7.0, stored_bound([1])[0]]
    document["recipe"]["gap"] = 1.0
    path.write_text(json.dumps(document))
    main(DodgeBoundOptions(seeds=1, out=path))
    assert json.loads(path.read_text())["time_to_goal"] == [stored_bound([0])[0]]


def test_ctrl_c_keeps_what_is_done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "bound.json"
    solve = dodge_bound.solve

    def interrupted(env: Any, env_index: int) -> Any:
        if env_index == 1:
            raise KeyboardInterrupt
        return solve(env, env_index)

    monkeypatch.setattr(search, "solve", interrupted)
    main(DodgeBoundOptions(seeds=3, out=path))
    assert json.loads(path.read_text())["time_to_goal"] == [stored_bound([0])[0]]
