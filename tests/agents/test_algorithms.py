"""SAC and TD3 beside PPO: recipes, runs that resume bit for bit, agents that ship; needs the `rl` extra."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason='needs pip install "planarm[rl]"')

import torch

from agents import evaluate, load_agent
from agents.cli import main
from agents.environments import make_batch
from agents.policies.agent import SQUASHED_FORMAT
from agents.training.algorithms import make_model
from agents.training.recipe import TrainingConfig
from agents.training.run import TrainingRun, Watcher
from agents.training.vec_env import NativeVecEnv
from envs.conveyor_track.env import LAYOUT

pytestmark = pytest.mark.rl

ENV = "ConveyorTrack-v0"
SMALL: dict[str, Any] = {
    "env": ENV,
    "env_config": {"control_mode": "jerk", "horizon": 2.0},
    "seed": 3,
    "total_steps": 240,
    "num_envs": 4,
    "batch_size": 16,
    "gradient_steps": 1,
    "learning_starts": 40,
    "hidden": [8, 8],
    "fine": {"part_error": [5.0, 20.0]},
    "checkpoint_steps": 80,
    "evaluation_episodes": 3,
    "baselines": [],
}
both = pytest.mark.parametrize("algorithm", ["sac", "td3"])


def small(algorithm: str, **changes: Any) -> TrainingConfig:
    return TrainingConfig.parse({**SMALL, "algorithm": algorithm, **changes}, "training setting")


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """The folder of a finished run of an algorithm."""
    root = tmp_path_factory.mktemp("runs")

    def folder(algorithm: str) -> Path:
        if not (root / algorithm).exists():
            assert TrainingRun.begin(root / algorithm, small(algorithm), "test").train()
        return root / algorithm

    return folder


@both
def test_a_run_stopped_anywhere_goes_on_as_if_it_had_not_been(
    algorithm: str, finished: Callable[[str], Path], tmp_path: Path
) -> None:
    run = TrainingRun.begin(tmp_path / "run", small(algorithm), "test")
    for end in (20, 100, 200):
        seen = [0]
        assert not run.train(Watcher(step=seen.append, stop=lambda seen=seen, end=end: seen[-1] >= end))  # type: ignore[misc]
        run = TrainingRun.resume(run.folder)
    assert run.train()
    whole = finished(algorithm)
    assert (run.folder / "last.safetensors").read_bytes() == (whole / "last.safetensors").read_bytes()
    before, after = (torch.load(one / "checkpoint.pt", weights_only=True) for one in (whole, run.folder))
    assert str(before["parameters"]) == str(after["parameters"])
    assert str(before["variables"]) == str(after["variables"])
    with np.load(whole / "replay-240.npz") as one, np.load(run.folder / "replay-240.npz") as other:
        assert all(np.array_equal(one[name], other[name]) for name in one.files)
    assert {path.name for path in run.folder.glob("replay-*")} == {"replay-160.npz", "replay-240.npz"}


@both
def test_training_twice_gives_the_same_weights_and_another_seed_others(
    algorithm: str, finished: Callable[[str], Path], tmp_path: Path
) -> None:
    weights = [(finished(algorithm) / "last.safetensors").read_bytes()]
    for seed in (3, 4):
        run = TrainingRun.begin(tmp_path / str(seed), small(algorithm, seed=seed), "test")
        assert run.train()
        weights.append((run.folder / "last.safetensors").read_bytes())
    assert weights[0] == weights[1] != weights[2]


@both
def test_an_agent_acts_as_the_network_it_was_trained_as(algorithm: str) -> None:
    config = small(algorithm, hidden=[32, 32])
    env = NativeVecEnv(make_batch(ENV, 4, SMALL["env_config"]))
    model = make_model(config, env, LAYOUT)
    torch.manual_seed(0)
    for parameter in model.policy.parameters():
        parameter.data += 0.1 * torch.randn_like(parameter)
    from agents import Agent

    document = {"format": SQUASHED_FORMAT, "env": ENV, "env_config": {}, "activation": "relu", "hidden": [32, 32]}
    agent = Agent(document, model.actor_tensors())
    observations = np.random.default_rng(0).uniform(-2.0, 2.0, (500, LAYOUT.size)).astype(np.float32)
    expected = model.policy.predict(observations, deterministic=True)[0]
    np.testing.assert_allclose(agent.predict(observations, deterministic=True)[0], expected, rtol=0.0, atol=1e-6)


def test_a_run_ships_and_stands_beside_others(
    finished: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = finished("sac")
    agent = load_agent(folder)
    assert agent.action_config == {"control_mode": "jerk"}
    scores = evaluate(agent, ENV, range(1_000_000, 1_000_003), env_config=agent.env_config)
    assert scores.returns.mean() == agent.document["scores"]["return"]
    page = [
        "benchmark",
        "--policies",
        "random",
        str(folder),
        "--tasks",
        ENV,
        "--episodes",
        "2",
        "--bound-episodes",
        "0",
    ]
    assert main(page) == 0
    assert "sac" in capsys.readouterr().out
    assert main(["evaluate", str(folder), "--env", ENV, "--episodes", "2"]) == 0
    assert main(["curves", str(folder), str(finished("td3"))]) == 0
    printed = capsys.readouterr().out
    assert "SAC alone" in printed
    assert "TD3 alone" in printed
    about = json.loads((folder / "run.json").read_text())["machine"]
    assert about["device"] == "cpu"
    assert about["threads"] == 1


def test_demonstrations_begin_the_replay_buffer(tmp_path: Path) -> None:
    config = small("sac", demonstrations={"expert": "apf", "episodes": 8}, total_steps=4, checkpoint_steps=4)
    assert TrainingRun.begin(tmp_path / "run", config, "test").train()
    with np.load(tmp_path / "run" / "replay-4.npz") as file:
        assert file["position"].tolist() == [201, 201]  # two episodes in each of four environments, and one step
        assert file["dones"][[99, 199]].all()
        assert file["dones"].sum() == 8
        assert file["timeouts"].sum() == 8
        ends = file["next_observations"][99]
    np.testing.assert_allclose(LAYOUT.parse(ends)["part_error"], 0.0, atol=1e-4)  # of the expert's episodes


@pytest.mark.parametrize(
    ("spoil", "complaint"),
    [
        (lambda path: path.unlink(), "replay-240.npz is no replay buffer"),
        (lambda path: path.write_bytes(b""), "replay-240.npz is no replay buffer"),
        (lambda path: path.write_bytes(path.read_bytes()[:-500]), "replay-240.npz is no replay buffer"),
        (lambda path: np.savez(path, position=np.array([60, 60])), "KeyError|is no replay buffer"),
        (lambda path: np.savez(path, rewards=np.zeros((9_000_000, 4), np.float32)), "is no replay buffer"),
        (lambda path: np.savez(path, position=np.array([None])), "is no replay buffer"),
    ],
    ids=["missing", "empty", "cut", "without arrays", "huge", "pickled"],
)
def test_a_damaged_replay_buffer_is_named(
    spoil: Callable[[Path], Any], complaint: str, finished: Callable[[str], Path], tmp_path: Path
) -> None:
    shutil.copytree(finished("sac"), tmp_path / "run")
    spoil(tmp_path / "run" / "replay-240.npz")
    with pytest.raises(ValueError, match=complaint):
        TrainingRun.resume(tmp_path / "run").train()


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        (["algorithm=sca"], 'unknown algorithm "sca"; did you mean "sac"'),
        (["algorithm=sac"], 'unknown training setting "clip_range"'),
        (["clip_rang=0.1"], 'did you mean "clip_range"'),
        (["tau=0.1"], 'unknown training setting "tau"'),
        (["hidden=[-3]"], "hidden.0 = -3"),
        (["threads=0"], "threads"),
        (["device=gpu"], "device = 'gpu'"),
    ],
)
def test_settings_of_another_algorithm_are_refused(
    changes: list[str], complaint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["train", "ppo/ConveyorTrack-v0", *changes]) == 2
    assert complaint in capsys.readouterr().err


def test_settings_that_a_recipe_leaves_out_follow_the_algorithm() -> None:
    recipe = TrainingConfig.parse({"env": ENV, "hidden": [32]}, "training setting")
    changed = recipe.overridden(["algorithm=sac", "tau=0.01"])
    assert (type(changed).__name__, changed.hidden, changed.batch_size) == ("SACConfig", (32,), 256)
    assert recipe.batch_size == 2400
