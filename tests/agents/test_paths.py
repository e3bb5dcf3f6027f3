"""`planarm paths`: the outcomes it prints, the picture it draws, and what it refuses."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import agents
import envs
from agents import cli
from agents.commands.outputs import check_outputs
from agents.commands.paths import PathsOptions, run
from agents.figures.episode_record import record_episode
from agents.policies.lookup import find_policy
from agents.tables import number_text

POLICIES = ("follower", "dpct")
DODGE = "ObstacleDodge-v0"


@pytest.mark.parametrize(
    ("env_id", "seed", "key", "decimals", "factor"),
    [
        ("ConveyorTrack-v0", 0, "settling_time", 2, 1.0),
        ("MinTorqueMove-v0", 18, "quintic_ratio", 0, 100.0),
        (DODGE, 29, "min_clearance", 0, 1000.0),
    ],
)
def test_the_outcomes_are_the_evaluators(
    capsys: pytest.CaptureFixture[str], env_id: str, seed: int, key: str, decimals: int, factor: float
) -> None:
    assert run(PathsOptions(env=env_id, policies=POLICIES, seed=seed)) == 0
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("|")]
    rows = {line.split("|")[1].strip(): line.strip("|").replace("|", " ") for line in lines}
    for policy in POLICIES:
        evaluation = agents.evaluate(policy, env_id, [seed])
        assert rows[policy].split()[-1] == number_text(evaluation.returns[0])
        if evaluation.success[0]:
            assert f" {factor * evaluation.metrics[key][0]:.{decimals}f} " in rows[policy]


@pytest.mark.parametrize("env_id", envs.env_ids())
def test_the_default_is_the_first_three_experts_of_the_environment(
    capsys: pytest.CaptureFixture[str], env_id: str
) -> None:
    assert run(PathsOptions(env=env_id)) == 0
    shown = [line.split("|")[1].strip() for line in capsys.readouterr().out.splitlines() if line.startswith("|")]
    assert shown[2:] == list(envs.task_card(env_id).experts)[:3]


def test_a_record_holds_the_episode_step_by_step() -> None:
    record = record_episode(DODGE, find_policy("follower", DODGE), 29, {})
    evaluation = agents.evaluate("follower", DODGE, [29])
    assert len(record.t) == evaluation.lengths[0] + 1
    assert record.joints.shape == (len(record.t), 3, 2)
    assert record.outcome == f"collided at {record.t[-1]:.2f} s"
    # The disc touches the arm in the last period only.
    assert (record.measure[:-1] > 0.0).all()
    assert 1e3 * evaluation.metrics["min_clearance"][0] <= record.measure[-1] + 1e-9


def test_the_torque_over_time_sums_to_what_is_spent() -> None:
    record = record_episode("MinTorqueMove-v0", find_policy("dpct", "MinTorqueMove-v0"), 18, {})
    spent = record.measure[:-1] @ np.diff(record.t)
    assert spent == pytest.approx(record.info["torque_l1"], rel=1e-12)


@pytest.mark.parametrize(
    ("env_id", "policies"), [("ConveyorTrack-v0", ("dpct",)), ("MinTorqueMove-v0", ("dpct",)), (DODGE, POLICIES)]
)
def test_the_picture_is_as_wide_as_asked_and_not_empty(tmp_path: Path, env_id: str, policies: tuple[str, ...]) -> None:
    path = tmp_path / "pictures" / "paths.png"
    run(PathsOptions(env=env_id, policies=policies, seed=29, plot=path, dpi=60))
    with Image.open(path) as picture:
        assert picture.width == 600
        assert len(np.unique(np.asarray(picture.convert("RGB")).reshape(-1, 3), axis=0)) > 20
    assert list(path.parent.iterdir()) == [path]


def test_the_paper_start_as_a_vector_drawing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "paths.svg"
    arguments = ["paths", DODGE, "--policies", "dpct", "--scenario", "paper", "--plot", str(path), "--dpi", "60"]
    assert cli.main(arguments) == 0
    assert "the paper's start" in capsys.readouterr().out
    assert "<svg" in path.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"env": "ObstacleDogde-v0"}, 'did you mean "ObstacleDodge-v0"'),
        ({"policies": ("dpct", "folower")}, 'did you mean "follower"'),
        ({"policies": ()}, "0 policies"),
        ({"policies": ("dpct",) * 5}, "5 policies"),
        ({"seed": -1}, "seed -1"),
        ({"dpi": 3, "plot": Path("paths.png")}, "dpi 3"),
        ({"dpi": 100}, "give --plot too"),
        ({"plot": Path("paths.jpg")}, r"\.pdf, \.png, \.svg"),
        ({"policies": ("dpct", "dpct")}, "given 2 times"),
    ],
)
def test_what_is_wrong_is_said_before_anything_runs(
    monkeypatch: pytest.MonkeyPatch, options: dict[str, Any], complaint: str
) -> None:
    monkeypatch.setattr("agents.commands.paths.record_episode", lambda *arguments: pytest.fail("ran an episode"))
    given = PathsOptions(**{"env": DODGE, **options})
    with pytest.raises(ValueError, match=complaint):  # noqa: PT012
        check_outputs(given)
        run(given)


def test_missing_matplotlib_is_said_before_anything_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(ModuleNotFoundError, match=r"planarm\[viz\]"):
        check_outputs(PathsOptions(env=DODGE, plot=Path("paths.png")))
