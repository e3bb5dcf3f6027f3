"""Every expert and every shipped agent scores what is stored; one that is a little worse does not."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from agents.policies.lookup import find_policy
from agents.policies.policy import Policy, as_policy
from tools import stored_scores as scores
from tools.stored_scores import FILE, ScoresOptions, differences, load, main, score, score_policy, scored_policies

Change = Callable[[Any], Any]
STORED = load()
QUICK = [(env_id, name) for env_id, name in scored_policies() if name in ("apf", "follower", "agent")]


class Changed:
    """A policy whose actions are changed on their way."""

    def __init__(self, policy: Policy, change: Change) -> None:
        self.policy, self.change = policy, change

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = False
    ) -> tuple[Any, Any]:
        actions, state = self.policy.predict(observation, state, episode_start, deterministic)
        return self.change(actions), state


def changed_differences(env_id: str, name: str, change: Change) -> list[str]:
    named = find_policy(name, env_id)
    settings = named.settings({})
    with closing(gym.make_vec(env_id, num_envs=scores.EPISODES, **settings)) as env:
        policy = named.policy
        changed = Changed(as_policy(policy, env), change)
        return list(differences(STORED[env_id][name], score_policy(changed, env_id, settings)))


def rounded_otherwise() -> Change:
    generator = np.random.default_rng(0)
    return lambda actions: (actions * (1.0 + 1e-6 * generator.uniform(-1.0, 1.0, actions.shape))).astype(np.float32)


def weak() -> Change:
    return lambda actions: 0.9 * actions


def late() -> Change:
    """By one control period."""
    held: list[Any] = []

    def change(actions: Any) -> Any:
        held.append(actions.copy())
        return held.pop(0) if len(held) > 1 else np.zeros_like(actions)

    return change


def test_what_is_stored_is_all_there_is() -> None:
    assert [(env_id, name) for env_id, entries in STORED.items() for name in entries] == scored_policies()


@pytest.mark.parametrize(("env_id", "name"), scored_policies())
def test_scores_are_what_is_stored(env_id: str, name: str) -> None:
    assert list(differences(STORED[env_id][name], score(env_id, name))) == []


@pytest.mark.parametrize(("env_id", "name"), QUICK)
def test_other_rounding_is_tolerated(env_id: str, name: str) -> None:
    assert changed_differences(env_id, name, rounded_otherwise()) == []


@pytest.mark.parametrize("change", [weak, late])
@pytest.mark.parametrize(("env_id", "name"), QUICK)
def test_a_policy_a_little_worse_is_found_out(env_id: str, name: str, change: Callable[[], Change]) -> None:
    assert changed_differences(env_id, name, change())


@pytest.mark.parametrize(
    ("stored", "now", "complaints"),
    [
        ({"success": 50}, {"success": 49}, []),
        ({"success": 50}, {"success": 48}, ["success was 50 and is 48"]),
        ({"return": -2.0}, {"return": -1.961}, []),
        ({"return": -2.0}, {"return": -1.959}, ["return was -2.0 and is -1.959"]),
        ({"limit_ratio": 1.0}, {"limit_ratio": 1.0049}, []),
        ({"limit_ratio": 1.0}, {"limit_ratio": 1.0051}, ["limit_ratio was 1.0 and is 1.0051"]),
        ({"angle_error": 1e-9}, {"angle_error": 1e-5}, []),
        ({"time_to_goal": None}, {"time_to_goal": None}, []),
        ({"time_to_goal": 1.0}, {"time_to_goal": None}, ["time_to_goal was 1.0 and is None"]),
        ({"success": 1}, {}, ["success is stored but not scored"]),
        ({}, {"success": 1}, ["success is scored but not stored"]),
    ],
)
def test_what_is_tolerated(stored: Mapping[str, Any], now: Mapping[str, Any], complaints: list[str]) -> None:
    assert list(differences(stored, now)) == complaints


@pytest.fixture
def follower_alone(monkeypatch: pytest.MonkeyPatch) -> str:
    env_id = scored_policies()[0][0]
    monkeypatch.setattr(scores, "scored_policies", lambda: [(env_id, "follower")])
    return env_id


def test_scores_are_written_and_checked(
    follower_alone: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "scores.json"
    assert main(ScoresOptions(out=path)) == 0
    document, shipped = json.loads(path.read_text()), json.loads(FILE.read_text())
    assert document.keys() == shipped.keys()
    assert document["versions"].keys() == shipped["versions"].keys()
    for name in ("command", "first_seed", "episodes", "values", "tolerance"):
        assert document[name] == shipped[name]
    assert main(ScoresOptions(check=True, out=path)) == 0
    document["scores"][follower_alone]["follower"]["success"] -= 10
    document["scores"][follower_alone]["gone"] = {"success": 1}
    path.write_text(json.dumps(document))
    before = path.read_bytes()
    capsys.readouterr()
    assert main(ScoresOptions(check=True, out=path)) == 1
    printed = capsys.readouterr().err
    assert f"{follower_alone}: follower: success was" in printed
    assert f"{follower_alone}: gone: success is stored but not scored" in printed
    assert path.read_bytes() == before
