"""Who takes part: experts, shipped agents, runs, and models of Stable-Baselines3, which are not opened unasked."""

from __future__ import annotations

import zipfile
from importlib import import_module
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from agents import Agent, evaluate, load_agent, save_agent
from agents.commands.evaluate import EvaluateOptions
from agents.policies.files import shipped_agents, shipped_variants
from agents.policies.lookup import NamedPolicy, find_policy, shipped_policies

ENV = "ConveyorTrack-v0"


def test_an_expert_brings_no_settings() -> None:
    expert = find_policy("apf", ENV)
    assert (expert.name, expert.policy, expert.settings({"payload": 0.1})) == ("apf", "apf", {"payload": 0.1})
    assert expert.is_expert


def test_an_agent_brings_the_meaning_of_its_actions_and_no_other_setting(tmp_path: Path) -> None:
    shipped = load_agent(ENV)
    trained = {**shipped.document, "env_config": {"control_mode": "jerk", "limit_penalty": 0.5}}
    save_agent(Agent(trained, shipped.tensors), tmp_path / "run" / "best.safetensors")
    for source, name in (
        ("agent", "agent"),
        (str(tmp_path / "run"), "run"),
        (str(tmp_path / "run" / "best.safetensors"), "best"),
    ):
        named = find_policy(source, ENV)
        assert (named.name, named.is_expert) == (name, False)
        assert named.settings({"payload": 0.1}) == {"payload": 0.1, "control_mode": "jerk"}


def test_an_agent_for_harder_episodes_is_found_by_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shipped = load_agent(ENV)
    harder = Agent({**shipped.document, "env_config": {"control_mode": "jerk", "horizon": 4.0}}, shipped.tensors)
    save_agent(shipped, tmp_path / f"{ENV}.safetensors")
    save_agent(harder, tmp_path / f"{ENV}.long.safetensors")
    monkeypatch.setattr("agents.policies.files._SHIPPED", tmp_path)
    assert (shipped_agents(), shipped_variants(ENV), shipped_policies(ENV)) == (
        [ENV],
        ["long"],
        ["agent", "agent:long"],
    )
    assert load_agent(ENV, "long").env_config["horizon"] == 4.0
    named = find_policy("agent:long", ENV)
    assert (named.name, named.own, named.settings({})) == ("agent:long", False, {"control_mode": "jerk"})
    evaluation = EvaluateOptions("agent:long", env=ENV, against=("agent",)).resolve().config
    assert (evaluation.policies, evaluation.tasks[0].env_config) == (("agent:long", "agent"), {})
    with pytest.raises(ValueError, match="no environment: give --env"):
        EvaluateOptions("agent:long").resolve()
    for refused in (lambda: load_agent(ENV, "lang"), lambda: find_policy("agent:lang", ENV)):
        with pytest.raises(ValueError, match=f'unknown agent of {ENV} for harder episodes "lang"; did you mean "long"'):
            refused()


def test_a_task_of_other_actions_is_refused() -> None:
    named = NamedPolicy("mine", "dpct", {"control_mode": "jerk"})
    assert named.settings({"control_mode": "jerk"}) == {"control_mode": "jerk"}
    with pytest.raises(ValueError, match=r"mine was made for control_mode 'jerk'.*'torque'.*leave control_mode out"):
        named.settings({"control_mode": "torque"})


def test_an_agent_that_does_not_observe_the_relative_motion_says_so_by_name() -> None:
    message = r"agent was made for relative_motion False and cannot act with True; leave relative_motion out"
    with pytest.raises(ValueError, match=message):
        find_policy("agent", ENV).settings({"relative_motion": True})


@pytest.mark.parametrize(
    ("source", "env_id", "complaint"),
    [
        ("agnt", ENV, 'did you mean "agent"'),
        ("agent", "Elsewhere-v0", "unknown environment with an agent of its own"),
        ("no_such_run.safetensors", ENV, "no file no_such_run"),
        ("model.zip", ENV, "no file model.zip"),
        ("runs/mine", ENV, "no folder runs/mine"),
    ],
)
def test_what_is_wrong_is_said(source: str, env_id: str, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        find_policy(source, env_id)


def test_an_agent_of_another_environment_is_refused(tmp_path: Path) -> None:
    shipped = load_agent(ENV)
    save_agent(shipped, tmp_path / "mine.safetensors")
    with pytest.raises(ValueError, match="mine was trained on ConveyorTrack-v0, not on ObstacleDodge-v0"):
        find_policy(str(tmp_path / "mine.safetensors"), "ObstacleDodge-v0")


def test_what_is_no_model_is_said_even_when_code_is_allowed(tmp_path: Path) -> None:
    (tmp_path / "text.zip").write_text("no zip")
    with zipfile.ZipFile(tmp_path / "other.zip", "w") as archive:
        archive.writestr("data", '{"gamma": 0.9}')
    for name, complaint in (("text", "no model of Stable-Baselines3"), ("other", "no algorithm known here")):
        with pytest.raises(ValueError, match=complaint):
            find_policy(str(tmp_path / f"{name}.zip"), ENV, allow_code=True)


@pytest.mark.rl
@pytest.mark.parametrize("algorithm", ["PPO", "A2C", "SAC", "TD3", "DDPG"])
def test_a_model_of_stable_baselines3_is_evaluated(tmp_path: Path, algorithm: str) -> None:
    library: Any = import_module("stable_baselines3")
    sizes: dict[str, Any] = {"policy_kwargs": {"net_arch": [8]}, "seed": 1, "device": "cpu"}
    if algorithm in {"SAC", "TD3", "DDPG"}:
        sizes["buffer_size"] = 10
    model = getattr(library, algorithm)("MlpPolicy", gym.make(ENV), **sizes)
    model.save(tmp_path / "mine.zip")
    named = find_policy(str(tmp_path / "mine.zip"), ENV, allow_code=True)
    assert (named.name, named.is_expert, named.action_config) == ("mine", False, {})
    loaded, original = (evaluate(policy, ENV, range(3)) for policy in (named.policy, model))
    np.testing.assert_array_equal(loaded.returns, original.returns)
