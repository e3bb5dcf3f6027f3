"""The files of a run, damaged, exchanged and replaced: refused in a sentence or of no effect, and never unpickled."""

from __future__ import annotations

import os
import pickle
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason='needs pip install "planarm[rl]"')

import torch

from agents.cli import main
from agents.training.recipe import TrainingConfig
from agents.training.run import TrainingRun, Watcher

pytestmark = pytest.mark.rl

SMALL: dict[str, Any] = {
    "env": "ConveyorTrack-v0",
    "env_config": {"control_mode": "jerk", "horizon": 2.0},
    "algorithm": "sac",
    "total_steps": 80,
    "num_envs": 2,
    "rollout_steps": 5,
    "batch_size": 10,
    "learning_starts": 10,
    "gradient_steps": 1,
    "buffer_size": 200,
    "hidden": [4],
    "checkpoint_steps": 40,
    "evaluation_episodes": 2,
    "baselines": [],
}


def trained(folder: Path, **changes: Any) -> Path:
    run = TrainingRun.begin(folder, TrainingConfig.parse({**SMALL, **changes}, "training setting"), "test")
    assert run.train()
    return folder


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return trained(tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="module")
def other(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that differs in nothing but the seed."""
    return trained(tmp_path_factory.mktemp("other"), seed=1)


@pytest.fixture
def run(finished: Path, tmp_path: Path) -> Path:
    shutil.copytree(finished, tmp_path / "run")
    return tmp_path / "run"


def refusal(run: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """What a resumed run is refused with."""
    assert main(["train", "--resume", str(run)]) == 2
    said = capsys.readouterr().err
    assert len(said.splitlines()) == 1
    assert "weights_only" not in said
    return said


def weights(run: Path) -> bytes:
    return (run / "last.safetensors").read_bytes()


@pytest.mark.parametrize("name", ["checkpoint.pt", "replay-80.npz"])
def test_a_file_cut_anywhere_is_refused(name: str, run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    content = (run / name).read_bytes()
    for size in np.random.default_rng(0).integers(len(content), size=8).tolist():
        (run / name).write_bytes(content[:size])
        assert str(run / name) in refusal(run, capsys)


@pytest.mark.parametrize("name", ["checkpoint.pt", "replay-80.npz"])
def test_a_bit_flipped_anywhere_is_noticed_or_has_no_effect(
    name: str, run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole, content = torch.load(run / "checkpoint.pt", weights_only=True), (run / name).read_bytes()
    refused = 0
    for place in np.random.default_rng(1).integers(len(content), size=16).tolist():
        (run / name).write_bytes(content[:place] + bytes([content[place] ^ 4]) + content[place + 1 :])
        if main(["train", "--resume", str(run)]) == 2:
            refused += 1
            assert str(run / name) in capsys.readouterr().err
        else:  # between the parts of the archive
            assert str(torch.load(run / "checkpoint.pt", weights_only=True)) == str(whole)
    assert refused > 4


@pytest.mark.parametrize("name", ["checkpoint.pt", "replay-80.npz"])
def test_a_file_of_a_run_with_another_seed_is_refused(
    name: str, run: Path, other: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copy(other / name, run / name)
    assert "of another run" in (said := refusal(run, capsys)) or "of this run" in said
    assert str(run / name) in said


def test_a_warm_start_of_another_run_is_refused(run: Path, other: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for path in (*run.glob("*.pt"), *run.glob("*.npz")):
        path.unlink()
    shutil.copy(other / "checkpoint.pt", run / "warm_start.pt")
    said = refusal(run, capsys)
    assert f"{run / 'warm_start.pt'} is damaged, or of another run" in said
    assert "begin again" in said


@pytest.mark.parametrize("name", ["checkpoint.pt", "run.json", "config.yaml", "metrics.csv", "replay-80.npz", "lock"])
@pytest.mark.parametrize("kind", ["folder", "pipe", "broken link"])
def test_what_is_no_file_is_named(name: str, kind: str, run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (run / name).unlink()
    if kind == "folder":
        (run / name).mkdir()
    elif kind == "pipe":
        if not hasattr(os, "mkfifo"):
            pytest.skip("no pipes in the file system")
        os.mkfifo(run / name)
    else:
        (run / name).symlink_to(run / "nowhere")
    assert f"{run / name} is no file" in refusal(run, capsys)


def test_files_behind_links_are_as_good(run: Path, finished: Path, tmp_path: Path) -> None:
    for name in ("checkpoint.pt", "config.yaml", "run.json", "metrics.csv"):
        (run / name).rename(tmp_path / name)
        (run / name).symlink_to(tmp_path / name)
    assert TrainingRun.resume(run).train()
    assert weights(run) == weights(finished)


def test_without_its_last_checkpoint_a_run_goes_on_from_the_one_before_and_ends_alike(
    run: Path, finished: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (run / "checkpoint.pt").write_bytes(b"")
    assert "delete it to go on from the checkpoint before it, previous.pt" in refusal(run, capsys)
    (run / "checkpoint.pt").unlink()
    begun: list[int] = []
    assert TrainingRun.resume(run).train(Watcher(step=begun.append))
    assert min(begun) > 40
    assert weights(run) == weights(finished)
    assert (run / "replay-80.npz").read_bytes() == (finished / "replay-80.npz").read_bytes()


def test_nested_changes_of_settings_are_named_and_another_format_is_none(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (run / "config.yaml").read_text()
    (run / "config.yaml").write_text(f"# mine\n{text.replace('horizon: 2.0', 'horizon:   2')}\n")
    assert main(["train", "--resume", str(run)]) == 0
    capsys.readouterr()
    (run / "config.yaml").write_text(text.replace("horizon: 2.0", "horizon: 3.0"))
    assert "env_config.horizon: 3.0, which was 2.0" in refusal(run, capsys)


class Trap:
    """Runs code when it is unpickled."""

    def __reduce__(self) -> Any:
        return Path.touch, (Path("sprung"),)


@pytest.mark.parametrize("command", [["train", "--resume"], ["evaluate", "--episodes", "2"], ["curves"]])
def test_no_file_of_a_run_is_unpickled(
    command: list[str], run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    real: dict[str, Callable[..., Any]] = {"torch": torch.load, "numpy": np.load}

    def torch_load(*args: Any, **more: Any) -> Any:
        assert more.get("weights_only") is True
        return real["torch"](*args, **more)

    def numpy_load(*args: Any, **more: Any) -> Any:
        assert more.get("allow_pickle") is False
        return real["numpy"](*args, **more)

    def forbid(name: str) -> Callable[..., Any]:
        own = getattr(pickle, name)

        def guarded(*args: Any, **more: Any) -> Any:
            caller = str(sys._getframe(1).f_globals.get("__name__"))
            assert not caller.startswith(("agents", "envs", "planners", "torch", "stable_baselines3")), caller
            return own(*args, **more)

        return guarded

    monkeypatch.setattr(torch, "load", torch_load)
    monkeypatch.setattr(np, "load", numpy_load)
    for name in ("load", "loads"):
        monkeypatch.setattr(pickle, name, forbid(name))
    (run / "checkpoint.pt").unlink()  # train the last segment again, from previous.pt
    where = [command[0], str(run), *command[1:]] if command[0] == "evaluate" else [*command, str(run)]
    assert main(where) == 0
    for name in [path.name for path in run.iterdir() if path.is_file()]:
        kept = (run / name).read_bytes()
        (run / name).write_bytes(pickle.dumps(Trap()))
        main(where)
        (run / name).write_bytes(kept)
    assert not (tmp_path / "sprung").exists()
