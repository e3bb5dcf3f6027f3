"""Commands take a difficulty level: the settings and options of the card, under those that are given."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import agents
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
    slow = TrainOptions("ppo/MinTorqueMove-v0", level="slow").resolve()
    assert slow.conditions == [(slow.env_config, {"duration": 3.0})]


def test_the_id_of_an_environment_stands_for_all_of_its_levels() -> None:
    chosen = configure("levels", {}, ["MinTorqueMove-v0", "ObstacleDodge-v0/fast"]).tasks
    levels = envs.task_card("MinTorqueMove-v0").levels
    assert [task.title for task in chosen] == [
        *(f"MinTorqueMove-v0/{name}" for name in levels),
        "ObstacleDodge-v0/fast",
    ]
    (plain,) = configure("benchmark", {}, ["MinTorqueMove-v0"]).tasks  # a title comes first
    assert plain.title == "MinTorqueMove-v0"


def test_experts_act_in_the_control_modes_of_a_task_unless_another_is_given(tmp_path: Path) -> None:
    file = tmp_path / "own.yaml"
    file.write_text(
        "{episodes: 2, bound_episodes: 0, policies: [follower, random, agent], tasks: "
        "[{env: ConveyorTrack-v0, control_modes: {follower: acceleration}}]}"
    )
    (result,) = agents.leaderboard(config=str(file)).results
    assert result.action_configs["follower"] == {"control_mode": "acceleration"}
    assert set(result.action_configs) == {"follower", "agent"}
    alone = agents.evaluate("follower", "ConveyorTrack-v0", range(2), env_config={"control_mode": "acceleration"})
    assert np.array_equal(result.evaluations[0].returns, alone.returns)
    (task,) = configure(str(file), {"env_config": {"control_mode": "jerk"}}).tasks
    assert (task.control_modes, task.env_config) == ({}, {"control_mode": "jerk"})


def test_control_modes_of_no_expert_and_two_modes_of_one_are_refused() -> None:
    task = {"env": "ConveyorTrack-v0", "control_modes": {"dptc": "jerk"}}
    with pytest.raises(ValueError, match='unknown ConveyorTrack-v0 expert "dptc"; did you mean "dpct"'):
        BenchmarkTask.parse(task, "task")
    both = {**task, "control_modes": {"dpct": "jerk"}, "env_config": {"control_mode": "torque"}}
    with pytest.raises(ValueError, match=r"control_mode 'torque' for every policy contradicts control_modes"):
        BenchmarkTask.parse(both, "task")
