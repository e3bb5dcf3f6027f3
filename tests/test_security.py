"""What SECURITY.md promises: its limits, no pickle where data is read, pinned actions with few rights."""

from __future__ import annotations

import ast
import pickle
import re
import stat
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from agents import load_agent
from agents.commands.evaluate import EvaluateOptions
from agents.policies import files
from agents.submissions import folder
from planners import documents
from planners.trajectory import files as trajectories

ROOT = Path(__file__).parent.parent
PAGE = " ".join((ROOT / "SECURITY.md").read_text().split())
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
SOURCE = [path for floor in ("planners", "envs", "agents", "tools", "planarm") for path in (ROOT / floor).rglob("*.py")]


@pytest.mark.parametrize(
    "limit",
    [
        f"{files.MOST_BYTES >> 20} MiB of weights",
        f"{files.MOST_JSON_BYTES >> 10} KiB of JSON",
        f"{folder.MOST_WEIGHT_BYTES >> 20} MiB of weights in a submission, {folder.MOST_JSON_BYTES >> 10} KiB of JSON, "
        f"{folder.MOST_LAYERS} layers",
        f"{documents.MOST_BYTES >> 10} KiB, {documents.DEEPEST} levels, integers of {documents.MOST_BITS} bits",
        f"{trajectories.MOST_BYTES >> 20} MiB of arrays",
    ],
)
def test_the_limits_of_the_page_are_those_of_the_code(limit: str) -> None:
    assert limit in PAGE


def calls(path: Path) -> list[tuple[str, ast.Call]]:
    """All calls in a file, by the dotted name of what is called."""
    found = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call)]
    return [(ast.unparse(node.func), node) for node in found]


def argument(call: ast.Call, name: str) -> object:
    values = [one.value for one in call.keywords if one.arg == name]
    return values[0].value if values and isinstance(values[0], ast.Constant) else None


def test_source_unpickles_and_evaluates_nothing_but_models_behind_allow_code() -> None:
    unsafe = re.compile(
        r"(pickle|cloudpickle|dill|joblib|marshal|shelve)\.(loads?|Unpickler|open)|eval|exec|os\.system|os\.popen"
        r"|yaml\.(unsafe_load|full_load)"
    )
    found = {
        (path.relative_to(ROOT).as_posix(), name)
        for path in SOURCE
        for name, _ in calls(path)
        if unsafe.fullmatch(name)
    }
    assert found == {("agents/policies/sb3.py", "pickle.loads")}


def test_arrays_tensors_and_yaml_are_read_by_their_safe_loaders() -> None:
    for path in SOURCE:
        for name, call in calls(path):
            if name in ("np.load", "numpy.load"):
                assert argument(call, "allow_pickle") in (None, False), path
            if name == "torch.load":
                assert argument(call, "weights_only") is True, path
            if name == "yaml.load":
                assert [ast.unparse(one.value) for one in call.keywords] == ["_PlainLoader"], path
            if name.startswith("subprocess."):
                assert argument(call, "shell") in (None, False), path


@pytest.fixture
def no_pickle(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pickle refuses its service to all but Numba, which reads its own cache."""

    def only_for_numba(original: Any) -> Any:
        def service(*args: Any, **options: Any) -> Any:
            assert "numba" in sys._getframe(1).f_globals["__name__"], "something is unpickled"
            return original(*args, **options)

        return service

    for name in ("load", "loads", "Unpickler"):
        monkeypatch.setattr(pickle, name, only_for_numba(getattr(pickle, name)))


@pytest.mark.usefixtures("no_pickle")
def test_an_agent_is_loaded_and_evaluated_without_pickle(tmp_path: Path) -> None:
    shipped = load_agent("ConveyorTrack-v0")
    files.save_agent(shipped, tmp_path / "best.safetensors")
    board = EvaluateOptions(policy=str(tmp_path), episodes=1, num_envs=1).resolve()
    assert board.config.tasks[0].env == "ConveyorTrack-v0"
    observation = np.zeros(shipped.observation_size, np.float32)
    np.testing.assert_array_equal(load_agent(tmp_path).predict(observation, deterministic=True)[0].shape, (2,))


@pytest.mark.parametrize("name", ["m.zip", "folder/m.zip"])
def test_models_that_can_run_code_are_refused_everywhere(name: str, tmp_path: Path) -> None:
    from agents.cli import main

    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(b"PK")
    for command in (
        ["evaluate", str(path), "--env", "ConveyorTrack-v0"],
        ["evaluate", "dpct", "--env", "ConveyorTrack-v0", "--against", str(path)],
        ["benchmark", "--tasks", "ConveyorTrack-v0", "--policies", str(path)],
        ["rollout", "ConveyorTrack-v0", "--policy", str(path)],
        ["paths", "ConveyorTrack-v0", "--policies", str(path)],
    ):
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(tmp_path)
            assert main(command) != 0, command


WRITES = {
    ("release.yml", "build"): {"id-token", "attestations"},
    ("release.yml", "publish"): {"id-token"},
    ("docs.yml", "publish"): {"id-token", "pages"},
}
"""The jobs that may change something, and what."""


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_actions_are_pinned_by_hash_and_have_few_rights(path: Path) -> None:
    uses = re.findall(r"uses: (.*)", path.read_text())
    assert uses
    assert [line for line in uses if not re.fullmatch(r"[\w./-]+@[0-9a-f]{40} # v\d+\.\d+\.\d+", line)] == []
    document = yaml.safe_load(path.read_text())
    assert document["permissions"] == {}
    for name, job in document["jobs"].items():
        writes = {right for right, value in job["permissions"].items() if value == "write"}
        assert writes <= WRITES.get((path.name, name), set()), name
        assert job["timeout-minutes"] <= 60, name
        checkouts = [step for step in job["steps"] if step.get("uses", "").startswith("actions/checkout@")]
        assert all(step["with"]["persist-credentials"] is False for step in checkouts), name


@pytest.mark.skipif(sys.platform == "win32", reason="permissions of POSIX")
def test_a_cache_of_compiled_functions_that_others_can_write_is_not_used(tmp_path: Path) -> None:
    from planners.compile_cache import is_private

    mine = tmp_path / "mine"
    mine.mkdir()
    assert is_private(mine)
    mine.chmod(mine.stat().st_mode | stat.S_IWOTH)
    assert not is_private(mine)
    assert is_private(tmp_path / "not there yet")
