"""`planarm evaluate`: what a user types and reads."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from agents import evaluate, load_agent, save_agent
from agents.cli import main

FEW = ["--episodes", "4"]


def test_an_expert_is_scored(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = tmp_path / "scores.json"
    arguments = ["evaluate", "dpct", "--env", "ConveyorTrack-v0", "--seed", "7", "--json", str(path), *FEW]
    assert main([*arguments, "--settings", "payload=0.1", "horizon=2.0"]) == 0
    out = capsys.readouterr().out
    assert "ConveyorTrack-v0: 4 episodes" in out
    assert "difference" not in out
    (task,) = json.loads(path.read_text())["results"]
    wanted = evaluate("dpct", "ConveyorTrack-v0", range(7, 11), env_config={"payload": 0.1, "horizon": 2.0})
    assert task["policies"][0]["episodes"]["return"] == wanted.returns.tolist()
    assert task["pairs"] == []


def test_an_agent_knows_its_environment_and_is_compared_in_pairs(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    save_agent(load_agent("ConveyorTrack-v0"), tmp_path / "mine" / "best.safetensors")
    path = tmp_path / "scores.json"
    assert main(["evaluate", str(tmp_path / "mine"), "--against", "dpct", "apf", "--json", str(path), *FEW]) == 0
    out = capsys.readouterr().out
    assert "mine - dpct" in out
    assert "mine - apf" in out
    assert "Actions of mine: control_mode jerk" in out
    (task,) = json.loads(path.read_text())["results"]
    assert [(pair["policy"], pair["against"]) for pair in task["pairs"]] == [("mine", "dpct"), ("mine", "apf")]
    assert [policy["action_config"] for policy in task["policies"]] == [{"control_mode": "jerk"}, {}, {}]
    own, theirs = (policy["episodes"]["return"] for policy in task["policies"][:2])
    assert task["pairs"][0]["returns"]["value"] == pytest.approx(sum(map(float.__sub__, own, theirs)) / 4, abs=0.05)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["dpct"], "no environment: give --env, one of ConveyorTrack-v0"),
        (["dpct", "--env", "ConveyorTrak-v0"], 'did you mean "ConveyorTrack-v0"'),
        (["dpc", "--env", "ConveyorTrack-v0"], 'did you mean "dpct"'),
        (["dpct", "--env", "ConveyorTrack-v0", "--settings", "paylod=1"], 'did you mean "payload"'),
        (["dpct", "--env", "ConveyorTrack-v0", "--settings", "payload"], "no key=value"),
        (["dpct", "--env", "ConveyorTrack-v0", "--episodes", "0"], "episodes"),
        (["model.zip", "--env", "ConveyorTrack-v0"], "no file model.zip"),
        (["runs/mine"], "no folder runs/mine"),
        (["dpct", "--env", "ConveyorTrack-v0", "--settings", "belt_speed=0.2"], "--options belt_speed"),
        (["dpct", "--env", "ConveyorTrack-v0", "--options", "payload=0.2"], "--settings payload"),
        (
            ["dpct", "--env", "ConveyorTrack-v0", "--settings", "num_envs=10"],
            'unknown ConveyorTrack-v0 setting "num_envs"',
        ),
        (["dpct", "--env", "ConveyorTrack-v0", "--settings", "id=x"], 'unknown ConveyorTrack-v0 setting "id"'),
        (["dpct", "--env", "ConveyorTrack-v0", "--seed", str(2**64)], "seed"),
        (["agent", "--env", "ConveyorTrack-v0", "--settings", "control_mode=torque"], "leave control_mode out"),
    ],
)
def test_what_is_wrong_is_said(capsys: pytest.CaptureFixture[str], arguments: list[str], complaint: str) -> None:
    assert main(["evaluate", *arguments]) == 2
    assert complaint in capsys.readouterr().err
