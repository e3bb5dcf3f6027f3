"""What a run refuses in a sentence: damaged, foreign and edited files, a second process, divergence; needs `rl`."""

from __future__ import annotations

import errno
import json
import os
import pickle
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

pytest.importorskip("stable_baselines3", reason='needs pip install "planarm[rl]"')

import torch

from agents import evaluate, load_agent
from agents.cli import main
from agents.training.recipe import TrainingConfig
from agents.training.run import TrainingRun, Watcher

pytestmark = pytest.mark.rl

SMALL: dict[str, Any] = {
    "env": "ConveyorTrack-v0",
    "env_config": {"control_mode": "jerk", "horizon": 2.0},
    "total_steps": 80,
    "num_envs": 2,
    "rollout_steps": 20,
    "batch_size": 40,
    "epochs": 1,
    "hidden": [4],
    "checkpoint_steps": 40,
    "evaluation_episodes": 2,
    "baselines": [],
}


def small(**changes: Any) -> TrainingConfig:
    return TrainingConfig.parse({**SMALL, **changes}, "training setting")


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    assert TrainingRun.begin(folder, small(), "test").train()
    return folder


@pytest.fixture
def run(finished: Path, tmp_path: Path) -> Path:
    shutil.copytree(finished, tmp_path / "run")
    return tmp_path / "run"


def changed(**changes: Any) -> Callable[[Path], None]:
    def change(path: Path) -> None:
        torch.save({**torch.load(path, weights_only=True), **changes}, path)

    return change


class Trap:
    """Runs code when it is unpickled."""

    def __reduce__(self) -> Any:
        return Path.touch, (Path("sprung"),)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda path: path.write_bytes(b""),
        lambda path: path.write_bytes(path.read_bytes()[:1000]),
        lambda path: path.write_bytes(b"PK" + bytes(500)),
        lambda path: path.write_text("steps: 3"),
        lambda path: path.write_bytes(pickle.dumps(Trap())),
        lambda path: torch.save(Trap(), path),
        lambda path: torch.save([1, 2], path),
        changed(rows=[1, 2]),
        changed(rows=[{"steps": 0}]),
        changed(rows=[{"steps": 0, "seconds": 0.0, "success": "all", "return": 0.0}]),
        changed(steps="many"),
        changed(steps=None),
        changed(seconds={}),
        changed(parameters={}),
        changed(parameters="model.zip"),
        changed(parameters={"policy": {}, "policy.optimizer": {}}),
    ],
)
def test_a_damaged_or_foreign_checkpoint_is_named_in_a_sentence(
    spoil: Callable[[Path], Any],
    run: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    spoil(run / "checkpoint.pt")
    assert main(["train", "--resume", str(run)]) == 2
    said = capsys.readouterr().err
    assert f"{run / 'checkpoint.pt'} is damaged, or of another run" in said
    assert len(said.splitlines()) == 1
    assert "weights_only" not in said
    assert not (tmp_path / "sprung").exists()


def test_a_checkpoint_of_other_networks_is_of_another_run(run: Path, tmp_path: Path) -> None:
    assert TrainingRun.begin(tmp_path / "wide", small(hidden=[5], total_steps=1), "test").train()
    shutil.copy(tmp_path / "wide" / "checkpoint.pt", run / "checkpoint.pt")
    with pytest.raises(ValueError, match="of another run"):
        TrainingRun.resume(run).train()


def test_edited_settings_are_noticed_but_for_device_and_threads(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = run / "config.yaml"
    text = config.read_text()
    config.write_text(text.replace("num_envs: 2\n", "num_envs: 4\n"))
    assert main(["train", "--resume", str(run)]) == 2
    assert "edited since the run began (num_envs: 4, which was 2)" in capsys.readouterr().err
    config.write_text(text.replace("threads: 1\n", "threads: 2\n"))
    assert main(["train", "--resume", str(run)]) == 0
    torch.set_num_threads(1)


def test_a_run_from_before_there_was_a_setting_goes_on_with_its_default(finished: Path, tmp_path: Path) -> None:
    TrainingRun.begin(tmp_path, small(), "test")
    config, about = tmp_path / "config.yaml", tmp_path / "run.json"
    began = json.loads(about.read_text())
    del began["config"]["optimizer"]
    about.write_text(json.dumps(began))
    config.write_text(yaml.safe_dump(began["config"]))
    stopped = Watcher(stop=lambda: (tmp_path / "checkpoint.pt").exists())
    assert not TrainingRun.resume(tmp_path).train(stopped)
    assert TrainingRun.resume(tmp_path).train()
    assert (tmp_path / "last.safetensors").read_bytes() == (finished / "last.safetensors").read_bytes()
    config.write_text(yaml.safe_dump({**began["config"], "optimizer": "muon"}))
    with pytest.raises(ValueError, match="optimizer: muon, which was adam"):
        TrainingRun.resume(tmp_path)


def test_two_processes_do_not_train_in_one_folder(run: Path) -> None:
    (run / "checkpoint.pt").unlink()
    said: list[str] = []

    def second(line: str) -> None:
        if not said:
            with pytest.raises(ValueError, match="another process is training") as caught:
                TrainingRun.resume(run).train()
            said.append(str(caught.value))

    assert TrainingRun.resume(run).train(Watcher(begin=second))
    assert str(run) in said[0]


def test_drafts_of_killed_runs_are_removed(run: Path) -> None:
    draft, mine = run / ".checkpoint.123-4.pt", run / ".eslintrc.base.json"
    for path in (draft, mine):
        path.write_bytes(b"half")
    assert TrainingRun.resume(run).train()
    assert not draft.exists()
    assert mine.exists()


def test_a_folder_that_is_refused_stays_as_it_was(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = [".eslintrc.base.json", ".settings.local.yaml", "readme.txt"]
    for name in names:
        (tmp_path / name).write_text("mine")
    assert main(["train", "ppo/ConveyorTrack-v0", "--out", str(tmp_path)]) == 2
    assert "is not empty" in capsys.readouterr().err
    assert sorted(path.name for path in tmp_path.iterdir()) == names


def test_what_is_written_to_a_run_stays_in_it(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    precious = tmp_path / "precious.txt"
    precious.write_bytes((run / "metrics.csv").read_bytes())
    for name in ("metrics.csv", "last.safetensors"):
        (run / name).unlink()
        (run / name).symlink_to(precious)
    (run / "checkpoint.pt").unlink()
    before = precious.read_bytes()
    assert TrainingRun.resume(run).train()
    assert precious.read_bytes() == before
    shutil.rmtree(run / "tensorboard")
    (run / "tensorboard").symlink_to(tmp_path)
    assert main(["train", "--resume", str(run)]) == 2
    assert f"{run / 'tensorboard'} is a link to a folder elsewhere" in capsys.readouterr().err


def test_a_checkpoint_that_does_not_fit_on_the_disk_is_a_sentence(
    run: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write = Path.write_bytes

    def full(path: Path, content: bytes) -> int:
        if path.suffix == ".pt":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return write(path, content)

    (run / "checkpoint.pt").unlink()
    monkeypatch.setattr(Path, "write_bytes", full)
    assert main(["train", "--resume", str(run)]) == 1
    assert f"cannot write {run / 'checkpoint.pt'}: No space left on device" in capsys.readouterr().err


def test_an_interrupted_evaluation_leaves_the_agent_and_the_steps_of_the_checkpoint(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(agent: Any, config: Any) -> dict[str, float]:
        raise KeyboardInterrupt

    (run / "checkpoint.pt").unlink()  # goes on from that of 40 steps
    (run / "last.safetensors").unlink()
    monkeypatch.setattr("agents.training.run.score", interrupted)
    training = TrainingRun.resume(run)
    with pytest.raises(KeyboardInterrupt):
        training.train()
    assert training.steps == 40
    assert load_agent(run / "last.safetensors")


def test_a_run_is_its_own_whatever_its_name(run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("ConveyorTrack-v0", "agent", "lr-0.1"):
        shutil.copytree(run, tmp_path / name)
    for suffix in (".safetensors", ".json"):
        shutil.copy(run / f"best{suffix}", tmp_path / f"agent{suffix}")
    monkeypatch.chdir(tmp_path)
    expected = evaluate(load_agent(run), "ConveyorTrack-v0", [0, 1])
    assert set(expected.lengths) == {100}  # of its own horizon
    for source in ("ConveyorTrack-v0", "./agent", "agent.safetensors", "lr-0.1"):
        found = evaluate(source, "ConveyorTrack-v0", [0, 1])
        np.testing.assert_array_equal(found.returns, expected.returns)
    assert evaluate("lr-0.1", "ConveyorTrack-v0", [0]).policy == "lr-0.1"
    assert load_agent("ConveyorTrack-v0").shipped


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
@pytest.mark.parametrize("rate", [1e10, 1e30])
def test_divergence_is_a_sentence_and_leaves_the_last_checkpoint(
    algorithm: str, rate: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    changes: dict[str, Any] = {"learning_rate": rate, "final_learning_rate": rate, "total_steps": 400}
    if algorithm == "sac":
        changes |= {"algorithm": "sac", "learning_starts": 4}
    given = {name: value for name, value in SMALL.items() if algorithm == "ppo" or name != "epochs"}
    TrainingRun.begin(tmp_path / "run", TrainingConfig.parse({**given, **changes}, "training setting"), "test")
    assert main(["train", "--resume", str(tmp_path / "run")]) == 2
    said = capsys.readouterr().err
    assert "training diverged" in said
    rows = [line for line in said.splitlines() if "steps, " in line and line[0].isdigit()]
    assert len(said.splitlines()) == len(rows) + 1
    assert load_agent(tmp_path / "run").document["training"]["steps"] < 400


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_a_missing_gpu_is_refused_before_anything_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["train", "ppo/ConveyorTrack-v0", "device=cuda", "--out", str(tmp_path / "run")]) == 2
    assert "finds no GPU" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_any_number_of_threads_gives_the_same_weights(tmp_path: Path) -> None:
    weights = []
    for threads in (1, 2, 2):
        config = small(threads=threads, hidden=[64, 64], seed=5, num_envs=16, batch_size=320)
        run = TrainingRun.begin(tmp_path / f"run-{len(weights)}", config, "test")
        assert run.train()
        weights.append(load_agent(run.folder).tensors)
    for others in weights[1:]:
        for name, tensor in weights[0].items():
            np.testing.assert_array_equal(tensor, others[name])


ARM = """
lengths_m: [0.42, 0.31]
masses_kg: [4.0, 2.0]
limits: {torque_N_m: [40.0, 15.0], velocity_rad_s: 4.0, acceleration_rad_s2: 30.0, angle_rad: 2.5}
"""


def test_another_arm_is_trained_for_and_recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("arm.yaml").write_text(ARM)
    recipe = {**SMALL, "env": "MinTorqueMove-v0", "env_config": {}, "total_steps": 40}
    Path("mine.yaml").write_text(yaml.safe_dump(recipe))
    assert main(["train", "mine.yaml", "arm=arm.yaml", "--out", "run"]) == 0
    Path("arm.yaml").unlink()
    agent = load_agent("run")
    assert agent.env_config["arm"]["lengths_m"] == [0.42, 0.31]
    assert evaluate(agent, agent.env_id, range(2), env_config=agent.env_config).returns.size == 2
    assert main(["train", "--resume", "run"]) == 0


TASK = """
from envs import register
from envs.card import TaskCard
from envs.min_torque_move.env import MinTorqueMove


class Mine(MinTorqueMove):
    env_id = "Mine-v0"


register("Mine-v0", Mine, TaskCard(metrics=(), experts={}))
"""


def test_a_task_of_a_users_module_is_trained_and_resumed_in_other_processes(tmp_path: Path) -> None:
    (tmp_path / "my_tasks.py").write_text(TASK)
    recipe = {**SMALL, "env": "my_tasks:Mine-v0", "env_config": {}, "total_steps": 40}
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(recipe))
    for arguments in (["mine.yaml", "--out", "run"], ["--resume", "run"]):
        command = [sys.executable, "-m", "agents.cli", "train", *arguments]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        (tmp_path / "run" / "checkpoint.pt").unlink()
    about = json.loads((tmp_path / "run" / "best.json").read_text())
    assert about["env"] == "Mine-v0"  # without the module: loading an agent imports nothing
    (tmp_path / "my_tasks.py").unlink()
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert "no module my_tasks for my_tasks:Mine-v0" in done.stderr
