"""Trained agents: kept as safetensors and JSON, run without torch."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from safetensors.numpy import load, save

from agents import Agent, evaluate, load_agent, save_agent
from agents.policies.agent import FORMAT, NORMALIZED, SQUASHED_FORMAT
from agents.policies.files import describe_layout, layout_of, shipped_agents
from agents.training.recipe import EVALUATION_SEED, TrainingConfig

ENV = "ConveyorTrack-v0"


def agent(env_id: str = ENV, hidden: int = 5, activation: str = "tanh") -> Agent:
    """An agent with weights at random."""
    size = layout_of(env_id, {}).size
    outputs = gym.make(env_id).action_space.shape[0]  # type: ignore[index]
    generator = np.random.default_rng(2)
    shapes = {
        "layer0.weight": (hidden, size + 2),
        "layer0.bias": (hidden,),
        "layer1.weight": (outputs, hidden),
        "layer1.bias": (outputs,),
        "log_std": (outputs,),
    }
    tensors: dict[str, Any] = {
        name: generator.standard_normal(shape, dtype=np.float32) for name, shape in shapes.items()
    }
    tensors["fine.index"], tensors["fine.gain"] = np.array([1, 3]), np.array([20.0, 5.0], dtype=np.float32)
    document = {
        "format": FORMAT,
        "env": env_id,
        "env_config": {},
        **describe_layout(layout_of(env_id, {})),
        "activation": activation,
        "hidden": [hidden],
    }
    return Agent(document, tensors)


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    path = tmp_path / "agent.safetensors"
    save_agent(agent(), path)
    return path


@pytest.mark.parametrize("activation", ["tanh", "relu"])
def test_the_mean_action_is_the_networks(activation: str) -> None:
    one = agent(activation=activation)
    observation = np.random.default_rng(0).uniform(-1.0, 1.0, (7, one.observation_size)).astype(np.float32)
    actions, state = one.predict(observation, deterministic=True)
    weights = {name: tensor.astype(np.float64) for name, tensor in one.tensors.items()}
    for row, seen in zip(actions, observation.astype(np.float64), strict=True):
        features = [*seen, np.tanh(20.0 * seen[1]), np.tanh(5.0 * seen[3])]
        inner = weights["layer0.weight"] @ features + weights["layer0.bias"]
        inner = np.tanh(inner) if activation == "tanh" else np.maximum(inner, 0.0)
        expected = np.clip(weights["layer1.weight"] @ inner + weights["layer1.bias"], -1.0, 1.0)
        np.testing.assert_allclose(row, expected, atol=1e-5)
    assert (actions.dtype, state) == (np.float32, None)


def test_one_observation_gives_one_action() -> None:
    one = agent()
    batch = np.random.default_rng(1).uniform(-1.0, 1.0, (4, one.observation_size)).astype(np.float32)
    together = one.predict(batch, deterministic=True)[0]
    np.testing.assert_allclose(one.predict(batch[2], deterministic=True)[0], together[2], atol=1e-6)
    with pytest.raises(ValueError, match=r"or \(num_envs, 18\), found shape \(3,\)"):
        one.predict(np.zeros(3))


def test_drawn_actions_spread_around_the_mean_as_log_std_says() -> None:
    one = agent()
    quiet = {
        **one.tensors,
        "log_std": np.array([-3.0, -5.0], np.float32),
        "layer1.weight": np.zeros((2, 5), np.float32),
    }
    one = Agent(one.document, {**quiet, "layer1.bias": np.zeros(2, np.float32)})
    actions = one.predict(np.zeros((20_000, one.observation_size)))[0]
    np.testing.assert_allclose(actions.std(axis=0), np.exp([-3.0, -5.0]), rtol=0.03)
    np.testing.assert_allclose(actions.mean(axis=0), 0.0, atol=2e-3)


def squashed(noisy: bool = True) -> Agent:
    """An agent as SAC leaves it, or without noise as TD3 does."""
    clipped = agent()
    tensors = {name: tensor for name, tensor in clipped.tensors.items() if name != "log_std"}
    if noisy:
        weight = np.zeros((2, 5), np.float32)
        tensors |= {"log_std.weight": weight, "log_std.bias": np.array([-3.0, -50.0], np.float32)}
    return Agent({**clipped.document, "format": SQUASHED_FORMAT}, tensors)


def test_squashed_actions_are_the_tanh_of_the_networks_output(tmp_path: Path) -> None:
    one, clipped = squashed(), agent()
    observations = np.random.default_rng(0).uniform(-1.0, 1.0, (50, one.observation_size)).astype(np.float32)
    actions = one.predict(observations, deterministic=True)[0]
    inside = np.abs(clipped.predict(observations, deterministic=True)[0]) < 1.0
    expected = np.tanh(clipped.predict(observations, deterministic=True)[0])
    assert inside.any()
    np.testing.assert_allclose(actions[inside], expected[inside], atol=1e-6)
    save_agent(one, tmp_path / "one.safetensors")
    np.testing.assert_array_equal(
        load_agent(tmp_path / "one.safetensors").predict(observations, deterministic=True)[0], actions
    )
    spread = np.arctanh(one.predict(np.tile(observations[inside.all(axis=1)][:1], (20_000, 1)))[0]).std(axis=0)
    np.testing.assert_allclose(spread, [np.exp(-3.0), 0.0], rtol=0.03, atol=1e-4)


def test_an_agent_without_noise_draws_nothing() -> None:
    one = squashed(noisy=False)
    observations = np.random.default_rng(0).uniform(-1.0, 1.0, (5, one.observation_size)).astype(np.float32)
    np.testing.assert_array_equal(one.predict(observations)[0], one.predict(observations, deterministic=True)[0])


def test_half_of_the_noise_is_refused() -> None:
    one = squashed()
    with pytest.raises(ValueError, match=r"lacks the tensors log_std\.bias"):
        Agent(one.document, {name: tensor for name, tensor in one.tensors.items() if name != "log_std.bias"})


def test_what_is_saved_is_loaded(saved: Path) -> None:
    loaded = load_agent(saved)
    for name, tensor in agent().tensors.items():
        np.testing.assert_array_equal(loaded.tensors[name], tensor)
    assert loaded.env_id == ENV
    folder = saved.parent
    save_agent(agent(), folder / "best.safetensors")
    assert load_agent(str(folder)).env_id == ENV


def test_an_agent_is_evaluated_like_an_expert(saved: Path) -> None:
    loaded = load_agent(saved)
    first, again = (evaluate(loaded, ENV, range(4), num_envs=num_envs) for num_envs in (4, 4))
    np.testing.assert_array_equal(first.returns, again.returns)
    assert first.policy == "Agent"


def test_running_an_agent_needs_no_torch(saved: Path) -> None:
    program = (
        "import sys, agents\n"
        f"agents.load_agent({str(saved)!r}).predict([0.0] * {agent().observation_size})\n"
        "heavy = {'torch', 'stable_baselines3', 'pickle5'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr


def test_an_agent_can_be_loaded_at_every_moment_of_its_replacement(
    saved: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where a process is killed, or another one reads, between any two of the writes."""
    other = Agent(agent().document, {**agent().tensors, "log_std": np.array([7.0, 7.0], np.float32)})
    seen: list[float] = []
    real_replace = os.replace

    def replace(source: Any, target: Any) -> None:
        real_replace(source, target)
        seen.append(float(load_agent(saved).tensors["log_std"][0]))

    monkeypatch.setattr(os, "replace", replace)
    save_agent(other, saved)
    before = float(agent().tensors["log_std"][0])
    assert seen == [before, 7.0, 7.0]
    assert "replaced" not in json.loads(saved.with_suffix(".json").read_text())


def test_agents_are_read_beside_a_busy_writer(saved: Path) -> None:
    others = [Agent(agent().document, {**agent().tensors, "log_std": np.full(2, k, np.float32)}) for k in range(2)]
    running = True

    def write() -> None:
        while running:
            for other in others:
                save_agent(other, saved)

    writer = threading.Thread(target=write)
    writer.start()
    try:
        for _ in range(60):
            load_agent(saved)
    finally:
        running = False
        writer.join()


def change(path: Path, **changes: Any) -> None:
    document = path.with_suffix(".json")
    document.write_text(json.dumps({**json.loads(document.read_text()), **changes}))


def test_other_observations_are_refused_and_the_entries_named(saved: Path) -> None:
    layout = json.loads(saved.with_suffix(".json").read_text())["layout"]
    layout[5]["scale"] = 0.2
    change(saved, layout=layout, layout_hash="0" * 64)
    with pytest.raises(ValueError, match=f"other observations of {ENV}.*changed: part_error"):
        load_agent(saved)


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"format": 99}, "format 99"),
        ({"sha256": "0"}, "do not belong together"),
        ({"env": "ConveyorTrak-v0"}, 'did you mean "ConveyorTrack-v0"'),
        ({"activation": "tahn"}, 'did you mean "tanh"'),
        ({"hidden": [5, 5]}, "lacks the tensors layer2.weight"),
        ({"env_config": {"horizn": 2.0}}, 'did you mean "horizon"'),
        ({"env_config": {"task_type": "antigravity:Task"}}, 'unknown .* "task_type"'),
        ({"env_config": {"id": "x"}}, 'unknown .* "id"'),
        ({"env_config": [1]}, r"must be names and values, not \[1\]"),
        ({"env_config": {"horizon": 10**400}}, "an integer of 1329 bits"),
        ({"env": ["ConveyorTrack-v0"]}, "unknown environment"),
        ({"env": "antigravity:Task-v0"}, "unknown environment"),
        ({"activation": ["tanh"]}, "unknown activation"),
        ({"hidden": None}, "hidden None of an agent must list the widths"),
        ({"hidden": 5}, "hidden 5 of an agent must list the widths"),
        ({"layout": [3, {}], "layout_hash": 0}, "was trained on other observations"),
        ({"more": [[[[[[[[[[[[[0]]]]]]]]]]]]]}, "more than 12 levels"),
    ],
)
def test_what_is_wrong_with_an_agent_is_said(saved: Path, changes: dict[str, Any], complaint: str) -> None:
    change(saved, **changes)
    with pytest.raises(ValueError, match=complaint):
        load_agent(saved)


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"fine.index": np.array([1, 10**6])}, "fine.index of an agent must name elements of observations of 18"),
        ({"fine.index": np.array([-1, 3])}, "fine.index of an agent must name elements"),
        ({"fine.index": np.array([1])}, "fine.index of an agent must name elements"),
        ({"fine.index": np.array([1.0, 3.0])}, "expected 1 dimensions of integers"),
        ({"fine.gain": np.array([[1.0, 2.0]])}, r"shape \(1, 2\) of float64; expected 1 dimensions of floats"),
        ({"layer0.weight": np.zeros((5, 1))}, "observations of 0"),
        ({"layer0.weight": np.zeros((5, 30))}, "takes observations of 28 elements; ConveyorTrack-v0 gives 18"),
        ({"layer0.bias": np.array(1.0)}, "layer0.bias of an agent has shape"),
        ({"layer1.weight": np.full((2, 5), np.nan)}, "layer1.weight of an agent holds values that are not finite"),
        ({"log_std": np.zeros(3)}, r"log_std of an agent has shape \(3,\); expected \(2,\)"),
    ],
)
def test_weights_that_do_not_fit_are_refused(saved: Path, changes: dict[str, Any], complaint: str) -> None:
    content = save(load(saved.read_bytes()) | changes)
    saved.write_bytes(content)
    change(saved, sha256=hashlib.sha256(content).hexdigest())
    with pytest.raises(ValueError, match=f"cannot read .*{complaint}|{complaint}"):
        load_agent(saved)


def test_missing_and_damaged_files(saved: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"no file .*none\.safetensors"):
        load_agent(tmp_path / "none.safetensors")
    with pytest.raises(ValueError, match=r"no folder .*mine"):
        load_agent(tmp_path / "mine")
    with pytest.raises(ValueError, match="unknown agent"):
        load_agent("ConveyorTrack-v7")
    saved.write_bytes(saved.read_bytes()[:40])
    with pytest.raises(ValueError, match="cannot read "):
        load_agent(saved)
    saved.with_suffix(".json").write_text("{}")
    save_agent(agent(), tmp_path / "other.safetensors")
    saved.write_bytes((tmp_path / "other.safetensors").read_bytes())
    with pytest.raises(ValueError, match="lacks format, sha256, env"):
        load_agent(saved)


@pytest.mark.parametrize("name", shipped_agents())
def test_shipped_agents_score_what_their_json_says(name: str) -> None:
    shipped = load_agent(name)
    config = TrainingConfig.parse(shipped.document["training"]["config"], "training setting")
    assert name == shipped.env_id == config.env
    seeds = EVALUATION_SEED + np.arange(config.evaluation_episodes)
    now, stored = evaluate(shipped, name, seeds, env_config=shipped.env_config), shipped.document["scores"]
    assert now.success.mean() == pytest.approx(stored["success"], abs=0.01)
    assert now.returns.mean() == pytest.approx(stored["return"], abs=0.01)
    assert (now.metrics["limit_ratio"] <= 1.05).mean() >= 0.95


def test_an_agents_score_does_not_depend_on_the_number_of_environments() -> None:
    few, many = (evaluate("agent", ENV, range(12), num_envs=num_envs) for num_envs in (5, 256))
    np.testing.assert_array_equal(few.returns, many.returns)


def normalized(**changes: Any) -> Agent:
    """An agent that sees its observations normalised."""
    plain = agent()
    size = plain.observation_size
    normal = {"mean": np.linspace(-0.5, 0.5, size), "std": np.linspace(0.3, 2.0, size), "clip": np.array([1.2])}
    tensors = {f"normal.{name}": value for name, value in {**normal, **changes}.items()}
    return Agent({**plain.document, "format": FORMAT + NORMALIZED}, {**plain.tensors, **tensors})


def test_observations_are_normalised_before_the_network(tmp_path: Path) -> None:
    one, plain = normalized(), agent()
    seen = np.random.default_rng(0).uniform(-1.0, 1.0, (9, one.observation_size)).astype(np.float32)
    by_hand = np.clip((seen - one.tensors["normal.mean"]) / one.tensors["normal.std"], -1.2, 1.2).astype(np.float32)
    save_agent(one, tmp_path / "one.safetensors")
    actions = load_agent(tmp_path / "one.safetensors").predict(seen, deterministic=True)[0]
    np.testing.assert_array_equal(actions, plain.predict(by_hand, deterministic=True)[0])
    assert not np.array_equal(actions, plain.predict(seen, deterministic=True)[0])


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"std": np.zeros(18)}, "normal.std of an agent must lie from 1e-09 to 1e.09"),
        ({"mean": np.zeros(3)}, "normal.mean of an agent has 3 elements; expected 18"),
        ({"clip": np.array([np.inf])}, "normal.clip of an agent holds values that are not finite"),
        ({"clip": np.array([1])}, "normal.clip of an agent has shape .* of int64; expected 1 dimensions of floats"),
    ],
    ids=str,
)
def test_impossible_normalisation_is_refused(changes: dict[str, Any], complaint: str, tmp_path: Path) -> None:
    def saved_and_loaded() -> Agent:
        save_agent(normalized(**changes), tmp_path / "one.safetensors")
        return load_agent(tmp_path / "one.safetensors")

    with pytest.raises(ValueError, match=complaint):
        saved_and_loaded()


def test_what_was_checked_stays_as_it_was() -> None:
    """Otherwise compiled code would read out of bounds."""
    agent = load_agent("ConveyorTrack-v0")
    with pytest.raises(ValueError, match="read-only"):
        agent.tensors["fine.index"][:] = 10**12
    with pytest.raises(ValueError, match=r"inputs of shape \(1, 3\) for a network that takes \(num_envs, 18\)"):
        agent.network_actions(np.zeros((1, 3), np.float32))
