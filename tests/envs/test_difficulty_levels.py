"""Difficulty levels: each can be made and begun, differs from the default, and commands take it."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import envs

LEVELS = [(env_id, name) for env_id in envs.env_ids() for name in envs.task_card(env_id).levels]


@pytest.mark.parametrize(("env_id", "name"), LEVELS)
def test_a_level_begins_and_is_no_default_episode(env_id: str, name: str) -> None:
    level = envs.task_card(env_id).levels[name]
    shown = []
    for settings, options in ((level.settings, level.options), ({}, {})):
        env: Any = gym.make_vec(env_id, num_envs=1, **settings)
        observation, _ = env.reset(seed=1, options=dict(options))
        action = np.full(env.action_space.shape, 0.3, np.float32)
        steps = [env.step(action)[:2] for _ in range(3)]
        shown.append((observation.tolist(), [(seen.tolist(), reward.tolist()) for seen, reward in steps]))
    assert shown[0] != shown[1]
    assert level.meaning


BELTS = [name for name, level in envs.task_card("ConveyorTrack-v0").levels.items() if level.options]


@pytest.mark.parametrize("name", BELTS)
def test_most_starts_on_a_belt_of_a_level_can_be_solved(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """So that of thousands of seeds each has an episode: a start that cannot be solved is drawn again, not for ever."""
    monkeypatch.setattr("envs.conveyor_track.starts._TRIES", 10)
    level = envs.task_card("ConveyorTrack-v0").levels[name]
    env = gym.make_vec("ConveyorTrack-v0", num_envs=24, **level.settings)
    env.reset(seed=1_000_000, options=dict(level.options))


@pytest.mark.parametrize("env_id", sorted({env_id for env_id, _ in LEVELS}))
def test_every_task_has_a_level_of_model_error_latency_noise_and_all_of_them(env_id: str) -> None:
    levels = envs.task_card(env_id).levels
    parts = [levels[name].settings for name in ("model_error", "latency", "noise")]
    together = levels["uncertain"].settings
    for part in parts:
        assert part.items() <= together.items()


def test_what_is_given_has_precedence_over_a_level() -> None:
    card = envs.task_card("ConveyorTrack-v0")
    assert card.at_level("fast", {}, {"belt_speed": 0.1})[1]["belt_speed"] == 0.1
    assert card.at_level(None, {"payload": 0.2}, {}) == ({"payload": 0.2}, {})
    with pytest.raises(ValueError, match='unknown level "latensy"; did you mean "latency"'):
        card.at_level("latensy", {}, {})


def test_noise_stays_below_the_tolerances_of_its_level() -> None:
    for env_id, place, rate in (
        ("ConveyorTrack-v0", "position_tolerance", "velocity_tolerance"),
        ("MinTorqueMove-v0", "angle_tolerance", "velocity_tolerance"),
    ):
        task: Any = gym.make(env_id, **envs.task_card(env_id).levels["noise"].settings).unwrapped.task  # type: ignore[attr-defined]
        reach = task.arm.reach if env_id == "ConveyorTrack-v0" else 1.0
        noise = {name: high for name, (_, high) in task.uncertainty.ends.items()}
        assert getattr(task.config, place) >= 5.0 * (reach * noise["encoder_noise"] + noise["camera_noise"])
        assert getattr(task.config, rate) >= reach * noise["velocity_noise"] + noise["camera_noise"] / 0.02
