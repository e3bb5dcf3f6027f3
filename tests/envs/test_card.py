"""Cards declare what environments do, and a user's own package registers a task with its card."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import envs
from envs.card import TaskCard
from envs.conveyor_track.env import ConveyorTrack
from envs.experts import expert_names, is_expert

ROOT = Path(__file__).parents[2]

every_env = pytest.mark.parametrize("env_id", envs.env_ids())


@every_env
def test_an_episode_has_what_the_card_declares(env_id: str) -> None:
    card, env = envs.task_card(env_id), gym.make(env_id)
    names = {entry.name for entry in env.unwrapped.task.layout.entries}  # type: ignore[attr-defined]
    assert card.constant_entries <= names
    env.reset(seed=0)
    info: dict[str, Any] = {}
    over = False
    while not over:
        _, _, terminated, truncated, info = env.step(np.zeros(env.action_space.shape, dtype=np.float32))
        over = terminated or truncated
    assert {metric.key for metric in card.metrics} <= info.keys()
    assert [metric for metric in card.metrics if metric.primary] == [card.primary]
    assert card.bound is None or card.bound.metric in info
    assert card.picture is not None
    task: Any = env.unwrapped.task  # type: ignore[attr-defined]
    assert np.shape(card.picture.target(task, task.batch[0])) == (2,)
    assert np.isfinite(card.picture.measure(task.batch[0]))
    assert isinstance(card.picture.outcome(info, 1.0), str)


@every_env
def test_the_first_control_mode_is_the_default(env_id: str) -> None:
    task: Any = gym.make(env_id).unwrapped.task  # type: ignore[attr-defined]
    assert envs.task_card(env_id).control_modes[0] == task.config.control_mode


def test_an_unknown_task_is_refused_with_the_nearest_id() -> None:
    with pytest.raises(ValueError, match='unknown environment "ConveyorTrak-v0"; did you mean "ConveyorTrack-v0"'):
        envs.task_card("ConveyorTrak-v0")


def test_a_task_is_registered_under_its_own_id() -> None:
    with pytest.raises(ValueError, match=r"ConveyorTrack\.env_id is 'ConveyorTrack-v0', not 'Belt-v0'"):
        envs.register("Belt-v0", ConveyorTrack, TaskCard((), {}))
    assert "Belt-v0" not in envs.env_ids()


def test_what_is_no_card_is_not_registered() -> None:
    with pytest.raises(TypeError, match=r"the card of Belt-v0 is None; give a TaskCard"):
        envs.register("Belt-v0", type("Belt", (ConveyorTrack,), {"env_id": "Belt-v0"}), None)  # type: ignore[arg-type]
    assert "Belt-v0" not in envs.env_ids()


def test_experts_are_those_of_the_cards() -> None:
    assert expert_names("ObstacleDodge-v0") == ["dpct", "lagrange", "apf", "follower", "random"]
    assert "dpct" not in expert_names("ExcavatorPayload-v0")
    assert is_expert("adaptive")
    assert not is_expert("agent")


def test_importing_envs_loads_no_card() -> None:
    code = "import sys, envs; print([name for name in sys.modules if name.startswith(('envs.experts', 'planners'))])"
    assert subprocess.check_output([sys.executable, "-c", code], cwd=ROOT, text=True) == "[]\n"


@every_env
def test_a_control_takes_what_it_says_and_refuses_the_rest(env_id: str) -> None:
    env: Any = gym.make(env_id).unwrapped
    env.reset(seed=0)
    for control in envs.task_card(env_id).controls:
        bad: list[tuple[Any, ...]] = [("x",), (None,), (np.nan,), ([np.inf, 0.0],), ([[0.1, 0.1]],)]
        if control.span is None:
            bad += [(0.1,), ([0.1, 0.1], -1), ([0.1, 0.1], 9), ([0.1, 0.1], 0.5)]
        else:
            bad += [([0.1, 0.1],), (control.span[0] - 1.0,), (1e300,)]
        for given in bad:
            before = env.task.batch.tobytes()
            with pytest.raises(ValueError, match=re.escape(control.title)):
                env.task.change(0, control, *given)
            assert env.task.batch.tobytes() == before
        assert env.task.change(0, control, [0.3, 0.2] if control.span is None else np.float32(0.5 * sum(control.span)))


def test_a_task_that_is_registered_again_replaces_the_class_too() -> None:
    first, second = (type(name, (ConveyorTrack,), {"env_id": "Again-v0"}) for name in ("First", "Second"))
    card = envs.task_card("ConveyorTrack-v0")
    try:
        for task in (first, second):
            envs.register("Again-v0", task, card)
            with gym.make("Again-v0") as env:
                assert type(env.unwrapped.task) is task  # type: ignore[attr-defined]
    finally:
        gym.registry.pop("Again-v0", None)
        envs.card._CARDS.pop("Again-v0", None)


@every_env
def test_no_own_task_takes_the_id_of_a_shipped_one(env_id: str) -> None:
    with pytest.raises(ValueError, match="give your own another id"):
        envs.register(env_id, type("Own", (ConveyorTrack,), {"env_id": env_id}), envs.task_card(env_id))
    assert type(gym.make(env_id).unwrapped.task).__name__ != "Own"  # type: ignore[attr-defined]
