"""`planarm sweep` without Ray: what --over means, the trials, the folder, the results."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import pytest

from agents.cli import main
from agents.sweeps.axes import Interval, combinations, parse_axes


@pytest.mark.parametrize(
    ("term", "values"),
    [
        ("seed=0..4", [0, 1, 2, 3, 4]),
        ("seed=0..2,7", [0, 1, 2, 7]),
        ("learning_rate=1e-4,3e-4", [1e-4, 3e-4]),
        ("hidden=[64,64],[128]", [[64, 64], [128]]),
        ("activation=tanh,relu", ["tanh", "relu"]),
        ("gamma=0.9..0.99", Interval(0.9, 0.99, log=False, whole=False)),
        ("learning_rate=1e-4..1e-2:log", Interval(1e-4, 1e-2, log=True, whole=False)),
        ("num_envs=16..512:log", Interval(16.0, 512.0, log=True, whole=True)),
    ],
)
def test_a_term_of_over(term: str, values: object) -> None:
    assert parse_axes([term]) == {term.partition("=")[0]: values}


@pytest.mark.parametrize(
    ("terms", "message"),
    [
        (["seed"], "is no key=values"),
        (["seed="], "is no key=values"),
        (["seed=4..0"], "must rise"),
        (["learning_rate=0.0..1.0:log"], "above 0"),
        (["gamma=0.9..0.99,0.5"], "stands alone"),
        (["seed=1,1"], "given 2 times"),
        (["seed=1", "seed=2"], "given 2 times"),
        (["seed=0..100000000"], "integers"),
        (["hidden=[1"], "no YAML"),
    ],
)
def test_a_wrong_term_is_refused(terms: list[str], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        parse_axes(terms)


def test_all_combinations_or_some_of_them() -> None:
    axes = parse_axes(["seed=0..4", "learning_rate=1e-4,3e-4"])
    grid = combinations(axes, None, 0)
    assert len(grid) == 10
    assert grid[:2] == [{"seed": 0, "learning_rate": 1e-4}, {"seed": 0, "learning_rate": 3e-4}]
    some = combinations(axes, 4, 0)
    assert len(some) == 4
    assert all(point in grid for point in some)
    assert some == combinations(axes, 4, 0) != combinations(axes, 4, 1)


def test_points_of_an_interval_are_combined_with_all_values() -> None:
    axes = parse_axes(["learning_rate=1e-4..1e-2:log", "seed=0..2"])
    points = combinations(axes, 5, 0)
    assert len(points) == 15
    assert len({point["learning_rate"] for point in points}) == 5
    assert all(1e-4 <= point["learning_rate"] <= 1e-2 for point in points)
    with pytest.raises(ValueError, match="--samples"):
        combinations(axes, None, 0)


RECIPE = """\
env: MinTorqueMove-v0
env_config: {horizon: 0.5}
total_steps: 400
num_envs: 4
rollout_steps: 10
batch_size: 40
epochs: 1
hidden: [8]
checkpoint_steps: 80
evaluation_episodes: 3
baselines: []
"""


@pytest.fixture
def recipe(tmp_path: Path) -> str:
    path = tmp_path / "tiny.yaml"
    path.write_text(RECIPE)
    return str(path)


@pytest.mark.rl
def test_a_dry_run_lists_the_trials(recipe: str, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    out = tmp_path / "sweep"
    given = ["sweep", recipe, "gamma=0.9", "--over", "seed=0..2", "--dry-run", "--out", str(out)]
    assert main(given) == 0
    printed = capsys.readouterr().out
    assert "3 trials" in printed
    assert "2-seed=2" in printed
    assert not out.exists()


@pytest.mark.rl
@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["--over", "gama=0.9,0.8"], 'did you mean "gamma"'),
        (["--over", "learning_rate=-1,1"], "greater than 0"),
        ([], "nothing to sweep over"),
        (["--over", "seed=0..1", "--grace-steps", "10"], "--scheduler asha"),
        (["--over", "env=ConveyorTrack-v0,ObstacleDodge-v0"], "of ConveyorTrack-v0 and ObstacleDodge-v0, whose scores"),
        (["--over", "seed=0..1", "--scheduler", "asha", "--grace-steps", "4000"], "grace_steps"),
        (["--over", "total_steps=400,800", "--scheduler", "asha"], "same steps"),
        (["--over", "seed=0..1", "--resume", "runs/x"], "keeps the settings"),
    ],
)
def test_a_wrong_sweep_is_refused(
    recipe: str, given: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sweep", recipe, *given, "--dry-run"]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.rl
def test_a_sweep_of_several_environments_does_not_go_on(
    recipe: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from agents.sweeps.command import SweepOptions

    sweep = SweepOptions(recipe, over=("seed=0..1",), out=tmp_path / "sweep").sweep()
    sweep.write()
    path = tmp_path / "sweep" / "sweep.json"
    about = json.loads(path.read_text())
    about["trials"][1]["config"]["env"] = "ObstacleDodge-v0"
    path.write_text(json.dumps(about))
    assert main(["sweep", "--resume", str(tmp_path / "sweep")]) == 2
    assert "make a sweep for each" in capsys.readouterr().err


@pytest.mark.rl
def test_a_trial_is_the_run_of_train_and_goes_on(recipe: str, tmp_path: Path) -> None:
    from agents.cluster import Place
    from agents.sweeps.command import SweepOptions
    from agents.sweeps.results import SweepResults
    from agents.sweeps.sweep import Sweep, Task
    from agents.sweeps.trial import run_trial

    sweep = SweepOptions(recipe, over=("seed=0..1",), out=tmp_path / "sweep").sweep()
    sweep.write()
    assert Sweep.read(sweep.folder) == sweep
    trial = sweep.trials[1]
    task = Task(trial, sweep.folder, sweep.folder_of(trial), "planarm sweep", False, Place.here())

    class WorkerDies(Exception):
        pass

    def report(row: dict[str, Any]) -> None:
        if row["steps"] == 160:
            raise WorkerDies

    with pytest.raises(WorkerDies):
        run_trial(task, report)
    reported: list[dict[str, Any]] = []
    run_trial(task, reported.append)
    assert [row["steps"] for row in reported] == [0, 80, 160, 240, 320, 400]
    assert main(["train", recipe, "--seed", "1", "--out", str(tmp_path / "alone")]) == 0
    weights = (tmp_path / "alone" / "last.safetensors").read_bytes()
    assert (sweep.folder_of(trial) / "last.safetensors").read_bytes() == weights

    results = SweepResults(sweep)
    results.records["0-seed=0"].losses = 2
    results.write()
    assert SweepResults(sweep).document() == results.document()
    assert not results.finished
    rows = list(csv.DictReader((sweep.folder / "results.csv").read_text().splitlines()))
    assert [(row["trial"], row["state"]) for row in rows] == [("1-seed=1", "done"), ("0-seed=0", "waiting")]
