"""`planarm train`: runs that can be repeated and resumed bit for bit; needs the `rl` extra."""

from __future__ import annotations

import csv
import json
import multiprocessing
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason='needs pip install "planarm[rl]"')

import torch

from agents import Agent, evaluate, load_agent
from agents.cli import main
from agents.environments import make_batch
from agents.policies.agent import FORMAT
from agents.training.algorithms import make_model
from agents.training.recipe import TrainingConfig
from agents.training.run import TrainingRun, Watcher
from agents.training.seeding import TRAINING_SEEDS, env_seed
from agents.training.vec_env import NativeVecEnv
from agents.training.warm_start.dagger import collect, dagger, returns_to_go
from agents.yaml_config import load_config, shipped_configs
from envs.conveyor_track.env import LAYOUT

pytestmark = pytest.mark.rl

SMALL: dict[str, Any] = {
    "env": "ConveyorTrack-v0",
    "env_config": {"control_mode": "jerk", "horizon": 2.0},
    "seed": 3,
    "total_steps": 1200,
    "num_envs": 4,
    "rollout_steps": 50,
    "batch_size": 100,
    "epochs": 2,
    "hidden": [8, 8],
    "fine": {"part_error": 20.0},
    "final_log_std": -2.0,
    "checkpoint_steps": 400,
    "evaluation_episodes": 3,
    "baselines": ["apf"],
}

CLONED: dict[str, Any] = {
    "total_steps": 2800,
    "checkpoint_steps": 200,
    "warm_start": {"expert": "apf", "episodes": 8, "rounds": 3, "updates": 200, "batch_size": 64},
}
KILLS = 6


def small(**changes: Any) -> TrainingConfig:
    return TrainingConfig.parse({**SMALL, **changes}, "training setting")


def trained(folder: Path, **changes: Any) -> TrainingRun:
    run = TrainingRun.begin(folder, small(**changes), "test")
    assert run.train()
    return run


def weights(folder: Path) -> bytes:
    return (folder / "last.safetensors").read_bytes()


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    trained(folder)
    return folder


def test_the_same_seed_gives_the_same_weights_and_another_others(finished: Path, tmp_path: Path) -> None:
    trained(tmp_path / "again")
    trained(tmp_path / "other", seed=4)
    assert weights(tmp_path / "again") == weights(finished)
    assert weights(tmp_path / "other") != weights(finished)


def test_a_run_stopped_within_any_segment_goes_on_as_if_it_had_not_been(finished: Path, tmp_path: Path) -> None:
    folder = tmp_path / "stopped"
    run = TrainingRun.begin(folder, small(), "test")
    for stop_at in (100, 500, 900):
        seen = [0]
        assert not run.train(Watcher(step=seen.append, stop=lambda seen=seen, end=stop_at: seen[-1] >= end))  # type: ignore[misc]
        assert seen[-1] == stop_at
        run = TrainingRun.resume(folder)
    assert run.train()
    assert weights(folder) == weights(finished)
    before, after = (torch.load(one / "checkpoint.pt", weights_only=True) for one in (finished, folder))
    assert str(before["parameters"]) == str(after["parameters"])
    assert [row["return"] for row in before["rows"]] == [row["return"] for row in after["rows"]]


def without_clock(folder: Path, agent: str) -> dict[str, Any]:
    """What an agent's JSON says, but for the time it took."""
    document: dict[str, Any] = json.loads((folder / f"{agent}.json").read_text())
    del document["training"]["seconds"]
    return document


def same_run(one: Path, other: Path) -> bool:
    return all(
        (one / f"{agent}.safetensors").read_bytes() == (other / f"{agent}.safetensors").read_bytes()
        and without_clock(one, agent) == without_clock(other, agent)
        for agent in ("last", "best")
    )


@pytest.fixture(scope="module")
def start() -> Callable[[Path], Any]:
    """Begins to go on with a run in a process of its own, which need not import everything again."""
    processes = multiprocessing.get_context("forkserver")
    processes.set_forkserver_preload(["agents.training.run", "agents.commands.train"])

    def resume(folder: Path) -> Any:
        process = processes.Process(target=main, args=(["train", "--resume", str(folder)],))
        process.start()
        return process

    return resume


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory: pytest.TempPathFactory, start: Callable[[Path], Any]) -> tuple[Path, float]:
    """A run with a warm start and many checkpoints, and the seconds it took in a process of its own."""
    folder = tmp_path_factory.mktemp("uninterrupted")
    TrainingRun.begin(folder, small(**CLONED), "test")
    before = time.perf_counter()
    start(folder).join()
    return folder, time.perf_counter() - before


def checkpoints(folder: Path) -> int:
    metrics = folder / "metrics.csv"
    return len(metrics.read_text().splitlines()) - 1 if metrics.exists() else 0


def test_a_run_killed_again_and_again_ends_as_if_it_had_not_been(
    uninterrupted: tuple[Path, float], tmp_path: Path, start: Callable[[Path], Any]
) -> None:
    finished, seconds = uninterrupted
    TrainingRun.begin(tmp_path, small(**CLONED), "test")
    generator = np.random.default_rng(20)
    delays = seconds / 3.0 * generator.permutation((np.arange(KILLS) + generator.random(KILLS)) / KILLS)
    for delay in delays.tolist():
        done, end = checkpoints(tmp_path), time.perf_counter() + delay
        process = start(tmp_path)
        # No kill may come so late that none is left for the next ones.
        while process.is_alive() and time.perf_counter() < end and checkpoints(tmp_path) < done + 2:
            time.sleep(0.002)
        process.kill()
        process.join()
        assert process.exitcode == -signal.SIGKILL
    assert main(["train", "--resume", str(tmp_path)]) == 0
    assert same_run(tmp_path, finished)


def test_a_run_stopped_in_its_warm_start_goes_on_with_its_next_round(
    uninterrupted: tuple[Path, float], tmp_path: Path
) -> None:
    run = TrainingRun.begin(tmp_path, small(**CLONED), "test")
    lines: list[str] = []
    for rounds in (1, 2):
        stopped = Watcher(begin=lines.append, stop=lambda: bool(lines) and "DAgger" in lines[-1])
        assert not run.train(stopped)
        assert (tmp_path / "warm_start.pt").exists()
        assert not (tmp_path / "checkpoint.pt").exists()
        assert sum("DAgger" in line for line in lines) == rounds
        run = TrainingRun.resume(tmp_path)
    assert lines.count("evaluating apf") == 1
    assert main(["train", "--resume", str(tmp_path)]) == 0
    assert same_run(tmp_path, uninterrupted[0])
    assert not (tmp_path / "warm_start.pt").exists()


def test_a_run_killed_in_its_warm_start_ends_as_if_it_had_not_been(
    uninterrupted: tuple[Path, float], tmp_path: Path, start: Callable[[Path], Any]
) -> None:
    TrainingRun.begin(tmp_path, small(**CLONED), "test")
    process = start(tmp_path)
    while process.is_alive() and not (tmp_path / "warm_start.pt").exists():
        time.sleep(0.001)
    process.kill()
    process.join()
    assert not (tmp_path / "checkpoint.pt").exists()
    assert main(["train", "--resume", str(tmp_path)]) == 0
    assert same_run(tmp_path, uninterrupted[0])


@pytest.mark.parametrize("name", [name for name in shipped_configs() if name.startswith("ppo/")])
def test_shipped_configs_give_the_same_weights_twice(name: str, tmp_path: Path) -> None:
    config = load_config(name, TrainingConfig)
    changes = {"num_envs": 8, "epochs": 2, "evaluation_episodes": 3, "baselines": f"[{config.baselines[-1]}]"}
    changes |= {"total_steps": 3200, "rollout_steps": 200, "batch_size": 400, "checkpoint_steps": 1600}
    if config.warm_start is not None:
        changes |= {"warm_start.episodes": 4, "warm_start.rounds": 2, "warm_start.updates": 20}
    if config.amortise is not None:
        changes |= {"amortise.moves": 1024, "amortise.updates": 50}
    if config.forecasts is not None:
        changes |= {"forecasts.episodes": 4, "forecasts.updates": 50}
        changes |= {"total_steps": 800, "rollout_steps": 50, "batch_size": 100, "checkpoint_steps": 400}
    if config.whole_episodes:  # a step takes hundreds of control periods
        changes |= {"total_steps": 64, "rollout_steps": 4, "batch_size": 16, "checkpoint_steps": 32}
    small = config.overridden([f"{key}={value}" for key, value in changes.items()])
    for folder in ("one", "other"):
        assert TrainingRun.begin(tmp_path / folder, small, "test").train()
    assert same_run(tmp_path / "one", tmp_path / "other")


LONG = {"total_steps": 100_000_000, "checkpoint_steps": 100_000_000}


@pytest.mark.parametrize(
    ("number", "changes", "until"),
    [
        (signal.SIGINT, LONG, "checkpoint.pt"),
        (signal.SIGTERM, {**LONG, "epochs": 10_000, "rollout_steps": 400}, "checkpoint.pt"),
        (signal.SIGINT, {"warm_start": {"expert": "apf", "episodes": 2, "updates": 10**9}}, "warm_start.pt"),
        (signal.SIGTERM, {"evaluation_episodes": 4000, "baselines": ["lagrange"]}, "tensorboard"),
    ],
    ids=["in a rollout", "in an update", "in the warm start", "while baselines are scored"],
)
def test_ctrl_c_and_sigterm_end_a_run_at_once_and_say_how_to_go_on(
    number: signal.Signals, changes: dict[str, Any], until: str, tmp_path: Path
) -> None:
    folder = tmp_path / "run"
    TrainingRun.begin(folder, small(**changes), "test")
    command = [sys.executable, "-m", "agents.cli", "train", "--resume", str(folder)]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    while process.poll() is None and not (folder / until).exists():
        time.sleep(0.01)
    time.sleep(1.0)
    process.send_signal(number)
    _, printed = process.communicate(timeout=20.0)  # under a second where nothing else runs, and minutes if it waited
    assert process.returncode == 128 + number
    assert f"--resume {folder}" in printed
    if until == "checkpoint.pt":
        assert load_agent(folder / "last.safetensors").env_id == "ConveyorTrack-v0"


def test_what_a_run_leaves(finished: Path) -> None:
    with (finished / "metrics.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["steps"] for row in rows] == ["0", "400", "800", "1200"]
    assert {"success", "return", "steady_state_error", "expert_success", "expert_steady_state_error"} <= set(rows[0])
    assert {row["expert"] for row in rows} == {"apf"}
    about = json.loads((finished / "run.json").read_text())
    assert about["seed"] == 3
    assert {"torch", "stable-baselines3", "planarm"} <= set(about["versions"])
    assert load_config(str(finished / "config.yaml"), TrainingConfig) == small(device="cpu", threads=1)
    assert list((finished / "tensorboard").iterdir())
    best = max(rows, key=lambda row: (float(row["success"]), float(row["return"])))
    agent = load_agent(finished)
    assert agent.document["training"]["steps"] == int(best["steps"])
    scores = evaluate(agent, agent.env_id, range(1_000_000, 1_000_003), env_config=agent.env_config)
    assert scores.returns.mean() == float(best["return"]) == agent.document["scores"]["return"]


def test_an_agent_acts_as_its_torch_network() -> None:
    env = NativeVecEnv(make_batch(SMALL["env"], 4, SMALL["env_config"]))
    model = make_model(small(hidden=[64, 64]), env, LAYOUT)
    torch.manual_seed(0)
    for parameter in model.policy.parameters():
        parameter.data += 0.1 * torch.randn_like(parameter)
    document = {"format": FORMAT, "env": SMALL["env"], "env_config": {}, "activation": "tanh", "hidden": [64, 64]}
    agent = Agent(document, model.actor_tensors())
    observations = np.random.default_rng(0).uniform(-2.0, 2.0, (500, LAYOUT.size)).astype(np.float32)
    expected = model.policy.predict(observations, deterministic=True)[0]
    np.testing.assert_allclose(agent.predict(observations, deterministic=True)[0], expected, rtol=0.0, atol=1e-6)


def test_training_seeds_are_none_of_the_evaluations() -> None:
    seeds = [env_seed(seed, segment) for seed in range(20) for segment in range(20)]
    assert min(seeds) >= TRAINING_SEEDS
    assert max(seeds) < 2**32 - 2**16
    assert len(set(seeds)) == len(seeds)


def test_noise_and_learning_rate_follow_the_whole_run(finished: Path) -> None:
    checkpoint = torch.load(finished / "checkpoint.pt", weights_only=True)
    assert checkpoint["parameters"]["policy"]["log_std"].tolist() == [-2.0, -2.0]
    assert checkpoint["parameters"]["policy.optimizer"]["param_groups"][0]["lr"] == pytest.approx(1e-5)


def test_dagger_makes_a_policy_act_much_like_its_expert() -> None:
    plan = {"expert": "apf", "episodes": 64, "rounds": 1, "updates": 1500, "batch_size": 128}
    config = small(warm_start=plan, hidden=[32, 32])
    with closing(make_batch(SMALL["env"], 16, SMALL["env_config"])) as env:
        model = make_model(config, NativeVecEnv(env), LAYOUT)
        assert dagger(model.policy, config, TRAINING_SEEDS)
        seen, labels, rewards = (np.concatenate(values) for values in collect(env, "apf", None, seed=0))
        own_states, own_labels, _ = (np.concatenate(values) for values in collect(env, "apf", model.policy, seed=0))
    actions = model.policy.predict(seen, deterministic=True)[0]
    assert np.mean((actions - labels) ** 2) < 0.5 * np.mean(labels**2)
    assert seen.shape == own_states.shape == (16 * 100, LAYOUT.size)
    assert rewards.shape == (16 * 100,)
    np.testing.assert_array_equal(own_labels[::100], labels[::100])  # the same starts
    assert not np.array_equal(own_states, seen)


def test_discounted_returns() -> None:
    answers = returns_to_go([np.array([1.0, 2.0, 4.0]), np.array([3.0])], 0.5)
    assert [answer.tolist() for answer in answers] == [[3.0, 4.0, 4.0], [3.0]]


@pytest.mark.parametrize("name", [name for name in shipped_configs() if name.startswith("ppo/")])
def test_shipped_configs_can_begin(name: str, tmp_path: Path) -> None:
    config = load_config(name, TrainingConfig)
    assert name.removeprefix("ppo/").startswith(config.env)  # the rest is the name of an agent for harder episodes
    few = ["total_steps=1", "evaluation_episodes=3", "num_envs=4", "rollout_steps=4", "batch_size=8"]
    few += ["baselines=[random]"]
    few += ["forecasts.episodes=4", "forecasts.updates=2"] if config.forecasts else []
    assert main(["train", name, *few, "warm_start=null", "amortise=null", "--seed", "1", "--out", str(tmp_path)]) == 0
    assert load_agent(tmp_path).document["training"]["seed"] == 1


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["ppo/ConveyorTrack-v1"], 'did you mean "ppo/ConveyorTrack-v0"'),
        (["ppo/ConveyorTrack-v0", "gama=0.9"], 'did you mean "gamma"'),
        (["ppo/ConveyorTrack-v0", "warm_start.episods=9"], 'did you mean "episodes"'),
        (["ppo/ConveyorTrack-v0", "gamma=2"], "gamma = 2"),
        (["ppo/ConveyorTrack-v0", "gamma"], "no key=value"),
        (["ppo/ConveyorTrack-v0", "gamma=[1"], "no YAML value"),
        (["ppo/ConveyorTrack-v0", "env=ConveyorTrak-v0"], 'did you mean "ConveyorTrack-v0"'),
        (["ppo/ConveyorTrack-v0", "env_config.horizn=2"], 'did you mean "horizon"'),
        (["ppo/ConveyorTrack-v0", "fine.part_eror=2"], 'did you mean "part_error"'),
        (["ppo/ConveyorTrack-v0", "baselines=[dptc]"], 'did you mean "dpct"'),
        (["ppo/ConveyorTrack-v0", "warm_start.expert=dptc"], 'did you mean "dpct"'),
        ([], "name a configuration"),
        (["ppo/ConveyorTrack-v0", "--resume", "runs/x"], "--resume takes no other"),
        (["--resume", "runs/none"], "no folder runs/none"),
    ],
)
def test_what_cannot_be_trained_is_refused(
    arguments: list[str],
    complaint: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["train", *arguments]) == 2
    assert complaint in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_folder_in_use_is_refused(finished: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["train", "ppo/ConveyorTrack-v0", "--out", str(finished)]) == 2
    assert "not empty" in capsys.readouterr().err
