"""The page on algorithms of one's own does what it says; needs the `rl` extra."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from pages import follow

from agents import load_agent
from agents.training.recipe import TrainingConfig
from agents.yaml_config import SHIPPED, load_config

pytestmark = pytest.mark.rl


def test_the_page_is_followed_from_a_folder_without_planarm(tmp_path: Path) -> None:
    printed = follow("extend/algorithm.md", tmp_path)
    assert "follower" in printed
    assert "SAC alone" in printed
    agent = load_agent(tmp_path / "runs" / "mine")
    assert agent.document["training"]["config"]["algorithm"] == "sac"
    assert agent.squashed
    about = json.loads((tmp_path / "runs" / "mine" / "run.json").read_text())["machine"]
    assert (about["device"], about["threads"]) == ("cpu", 1)


def test_the_recipe_of_sac_is_short() -> None:
    recipe = SHIPPED / "sac" / "ConveyorTrack-v0.yaml"
    lines = [line for line in recipe.read_text().splitlines() if line.strip() and not line.startswith("#")]
    assert len(lines) <= 15
    assert load_config("sac/ConveyorTrack-v0", TrainingConfig).algorithm == "sac"
