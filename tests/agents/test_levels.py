"""Commands take a difficulty level: the settings and options of the card, under those that are given."""

from __future__ import annotations

import pytest

import envs
from agents.commands.train import TrainOptions
from agents.evaluation.benchmark_config import BenchmarkTask, configure


def test_a_task_of_a_benchmark_has_the_settings_of_its_level() -> None:
    task = BenchmarkTask.parse({"env": "ConveyorTrack-v0", "level": "fast", "options": {"belt_speed": 0.28}}, "task")
    assert task.title == "ConveyorTrack-v0/fast"
    assert task.options == {**envs.task_card("ConveyorTrack-v0").levels["fast"].options, "belt_speed": 0.28}
    (one,) = configure("benchmark", {"level": "latency"}, ["MinTorqueMove-v0"]).tasks
    assert (one.title, one.env_config) == ("MinTorqueMove-v0/latency", {"latency": (0.0, 0.005)})


def test_the_shipped_levels_are_those_of_the_cards() -> None:
    shipped = [task.title for task in configure("levels", {}).tasks]
    cards = {f"{env_id}/{name}" for env_id in envs.env_ids() for name in envs.task_card(env_id).levels}
    assert set(shipped) == cards
    assert len(shipped) == len(cards)


def test_a_run_trains_at_a_level_of_settings() -> None:
    config = TrainOptions("ppo/MinTorqueMove-v0", level="uncertain").resolve()
    assert config.env_config["mass_error"] == [-0.1, 0.1]
    assert config.env_config["latency"] == [0.0, 0.005]
    with pytest.raises(ValueError, match=r"level slow is made of reset options.*which a training run"):
        TrainOptions("ppo/MinTorqueMove-v0", level="slow").resolve()


def test_the_id_of_an_environment_stands_for_all_of_its_levels() -> None:
    chosen = configure("levels", {}, ["MinTorqueMove-v0", "ObstacleDodge-v0/fast"]).tasks
    levels = envs.task_card("MinTorqueMove-v0").levels
    assert [task.title for task in chosen] == [
        *(f"MinTorqueMove-v0/{name}" for name in levels),
        "ObstacleDodge-v0/fast",
    ]
    (plain,) = configure("benchmark", {}, ["MinTorqueMove-v0"]).tasks  # a title comes first
    assert plain.title == "MinTorqueMove-v0"
