"""`planarm list`: every name that commands take, read from cards, configurations and arms."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import envs
import planners
from agents.cli import main
from agents.policies.files import shipped_agents
from agents.policies.lookup import shipped_policies
from envs.experts import expert_names


def test_every_name_is_there(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["list", "--json", str(tmp_path / "names.json")]) == 0
    out = capsys.readouterr().out
    document = json.loads((tmp_path / "names.json").read_text())
    assert list(document["environments"]) == envs.env_ids()
    assert list(document["arms"]) == planners.arm_names()
    assert document["agents"] == shipped_agents()
    assert "ppo/ConveyorTrack-v0" in document["recipes"]
    assert not [name for name in document["recipes"] if name.startswith("arms/") or name == "benchmark"]
    for env_id in envs.env_ids():
        assert document["environments"][env_id]["experts"] == expert_names(env_id)
        cards = document["environments"][env_id]["agents"]
        assert list(cards) == shipped_policies(env_id)
        assert all(card.startswith("Against ") for card in cards.values())
        assert env_id in out
    assert "optimal" in document["planners"]["dpct"]
    for name in (*planners.arm_names(), *document["planners"], "follower", "computed_torque", "ppo/ObstacleDodge-v0"):
        assert name in out
    assert max(map(len, out.splitlines())) < 200


def test_an_environment_in_full(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list", "ExcavatorPayload-v0"]) == 0
    out = capsys.readouterr().out
    for metric in envs.task_card("ExcavatorPayload-v0").metrics:
        assert metric.key in out
    for words in ("control_mode", "--options", "scenario", "payload"):
        assert words in out
    assert main(["list", "ExcavatorPayloa-v0"]) == 2
    assert 'did you mean "ExcavatorPayload-v0"' in capsys.readouterr().err
