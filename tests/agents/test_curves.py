"""`planarm curves`: the table, the groups, the picture, and what it refuses."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from run_folders import CONVEYOR, make_run

from agents.cli import main
from agents.commands.curves import _pictures, chosen_metrics
from agents.figures.curves import draw_curves, median_curve
from agents.training.learning_curves import Curve, differing, grouped, read_curve

NEVER = float("inf")
WARM_START = {"expert": "apf", "episodes": 8}
ROWS = {
    0: [(0, 40.0, 0.9, 1.20, 1.30), (100, 50.0, 0.99, 1.26, 1.10), (200, 60.0, 0.97, 1.25, 1.20)],
    1: [(0, 60.0, 0.7, 1.00, 1.70), (100, 80.0, 0.90, 1.10, 1.50), (200, 90.0, 0.95, 1.15, 1.30)],
    2: [(0, 50.0, 0.8, 1.10, 1.40), (100, 60.0, 0.95, 1.20, 1.20), (200, 70.0, 0.93, 1.21, 1.25)],
}
ALONE = [(0, 0.0, 0.0, -9.0, NEVER), (100, 12.0, 0.2, 0.1, NEVER), (200, 23.0, 0.6, 0.5, 2.0)]


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    """Three seeds with a warm start and one without."""
    for seed, rows in ROWS.items():
        make_run(tmp_path / "runs" / f"clone-{seed}", rows, seed=seed, warm_start=WARM_START)
    make_run(tmp_path / "runs" / "scratch", ALONE)
    return tmp_path / "runs"


def folders(runs: Path) -> list[str]:
    return [str(folder) for folder in sorted(runs.iterdir())]


def cells(output: str) -> dict[str, list[str]]:
    """Cells of the rows of a Markdown table, by the first of them."""
    rows = [[cell.strip() for cell in line.strip("| ").split("|")] for line in output.splitlines() if line[:1] == "|"]
    return {row[0]: row[1:] for row in rows}


def test_the_table_says_how_each_group_ended(runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["curves", *folders(runs)]) == 0
    output = capsys.readouterr().out
    assert output.startswith(f"### {CONVEYOR}\n")
    table = cells(output)
    assert table["runs"][:4] == ["seeds", "steps", "seconds", "best success (%)"]
    assert table["cloning apf, then PPO"] == [
        "3",
        "200",
        "73 (60 to 90)",
        "96.3 (95 to 99)",
        "95 (93 to 97)",
        "1.203 (1.150 to 1.250)",
        "1.250 (1.200 to 1.300)",
    ]
    assert table["PPO alone"] == ["1", "200", "23", "60", "60", "0.500", "2.000"]
    assert table["dpct (expert)"][4:] == ["100", "1.300", "1.060"]
    assert "differ" not in output


def test_runs_under_way_are_shown_as_far_as_they_are(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    make_run(tmp_path / "a", ROWS[0], seed=0)
    make_run(tmp_path / "b", ROWS[1][:2], seed=1)
    make_run(tmp_path / "c", [], seed=2)
    assert main(["curves", *folders(tmp_path)]) == 0
    output = capsys.readouterr().out
    assert cells(output)["PPO alone"][:3] == ["2 (1 under way)", "150", "70 (60 to 80)"]
    assert f"Left out: {tmp_path / 'c'} has no evaluation yet" in output
    assert main(["curves", str(tmp_path / "c")]) == 1
    assert "no evaluation yet" in capsys.readouterr().err


def test_a_time_that_is_never_stays_never(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    make_run(tmp_path / "a", ALONE, seed=0)
    make_run(tmp_path / "b", ALONE[:2], seed=1)
    assert main(["curves", *folders(tmp_path)]) == 0
    assert cells(capsys.readouterr().out)["PPO alone"][-1] == "never (2.000 to never)"


def test_groups_by_any_setting(runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    curves = [read_curve(Path(folder)) for folder in folders(runs)]
    assert {label: len(group) for label, group in grouped(curves, "warm_start.episodes").items()} == {
        "warm_start.episodes=8": 3,
        "warm_start.episodes=null": 1,
    }
    assert list(grouped(curves, "activation")) == ["activation=tanh"]
    assert differing(curves) == ["warm_start"]
    assert differing(curves[:3]) == []
    assert main(["curves", *folders(runs), "--by", "activation"]) == 0
    assert 'The runs of "activation=tanh" differ in more than the seed: warm_start.' in capsys.readouterr().out


def test_other_settings_of_the_environment_are_pointed_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    make_run(tmp_path / "a", ALONE, env_config={"limit_penalty": 1.0})
    make_run(tmp_path / "b", ALONE)
    assert main(["curves", *folders(tmp_path), "--by", "env_config.limit_penalty"]) == 0
    output = capsys.readouterr().out
    assert {"env_config.limit_penalty=1.0", "env_config.limit_penalty=null"} < set(cells(output))
    assert "returns may not compare" in output


def test_the_best_checkpoint_is_the_one_the_run_keeps(tmp_path: Path) -> None:
    rows = [(0, 1.0, 0.9, 1.5, 1.1), (100, 2.0, 0.95, 1.1, 1.1), (200, 3.0, 0.95, 1.2, 1.1), (300, 4.0, 0.95, 1.2, 1.1)]
    assert read_curve(make_run(tmp_path / "run", rows)).best == 2


def curve_of(folder: Path, rows: Sequence[tuple[float, ...]], seed: int = 0) -> Curve:
    return read_curve(make_run(folder, rows, seed=seed))


def test_seeds_are_put_together_at_the_same_steps(tmp_path: Path) -> None:
    """The second has half the checkpoints, and the third has not come so far."""
    curves = [
        curve_of(tmp_path / "a", ROWS[0], 0),
        curve_of(tmp_path / "b", [ROWS[1][0], ROWS[1][2]], 1),
        curve_of(tmp_path / "c", ROWS[2][:2], 2),
    ]
    seconds, middle, low, high = median_curve(curves, "success", "seconds")
    np.testing.assert_allclose(seconds, [50.0, 60.0])  # of 40, 60, 50 and of 50, (60 + 90) / 2, 60
    np.testing.assert_allclose(middle, [0.8, 0.95])  # of 0.99, (0.7 + 0.95) / 2, 0.95
    np.testing.assert_allclose(low, [0.7, 0.825])
    np.testing.assert_allclose(high, [0.9, 0.99])
    np.testing.assert_allclose(median_curve(curves, "success", "steps")[0], [0.0, 100.0])


def test_between_checkpoints_never_does_not_become_a_number(tmp_path: Path) -> None:
    fine = [(0, 1.0, 0.0, 0.0, 2.0), (50, 2.0, 0.0, 0.0, 2.0), (100, 3.0, 0.0, 0.0, 1.8), (200, 4.0, 0.0, 0.0, 1.6)]
    curves = [curve_of(tmp_path / "a", ALONE, 0), curve_of(tmp_path / "b", fine, 1)]
    _, middle, low, high = median_curve(curves, "settling_time", "steps")
    assert middle.tolist() == [NEVER, NEVER, NEVER, 1.8]
    assert high.tolist() == [NEVER, NEVER, NEVER, 2.0]
    assert low.tolist() == [2.0, 2.0, 1.8, 1.6]


def test_a_panel_shows_each_seed_their_median_and_the_expert(runs: Path) -> None:
    curves = [read_curve(Path(folder)) for folder in folders(runs)]
    metrics = chosen_metrics(curves, ())
    assert [metric.key for metric in metrics] == ["success", "return", "settling_time"]
    sheet = draw_curves(grouped(curves, "warm_start"), metrics, "seconds")
    success, _, settled = sheet.axes
    lines = {line.get_label(): np.asarray(line.get_ydata(), dtype=float) for line in success.lines}
    np.testing.assert_allclose(lines["cloning apf, then PPO (3 seeds)"], [80.0, 95.0, 95.0])
    np.testing.assert_allclose(lines["PPO alone (1 seed)"], [0.0, 20.0, 60.0])
    assert set(lines["best expert: dpct"]) == {100.0}
    drawn = [np.asarray(line.get_ydata(), dtype=float).tolist() for line in success.lines]
    for rows in ROWS.values():
        assert [pytest.approx(100.0 * row[2]) for row in rows] in drawn
    alone = next(line for line in settled.lines if line.get_label() == "PPO alone (1 seed)")
    np.testing.assert_array_equal(alone.get_ydata(), [np.nan, np.nan, 2.0])
    assert settled.get_title() == "settled (s); gaps: never"


@pytest.mark.parametrize("more", [[], ["--against", "steps"], ["--metrics", "return"]])
def test_the_picture_is_written_whole(runs: Path, tmp_path: Path, more: list[str]) -> None:
    path = tmp_path / "pictures" / "curves.png"
    assert main(["curves", *folders(runs), *more, "--plot", str(path), "--dpi", "60"]) == 0
    with Image.open(path) as picture:
        assert picture.width == 600
        assert len(np.unique(np.asarray(picture.convert("RGB")).reshape(-1, 3), axis=0)) > 20
    assert list(path.parent.iterdir()) == [path]


def test_a_run_of_one_row_as_a_vector_drawing(tmp_path: Path) -> None:
    folder = make_run(tmp_path / "run", ALONE[:1])
    path = tmp_path / "curves.svg"
    assert main(["curves", str(folder), "--plot", str(path)]) == 0
    assert "<svg" in path.read_text()


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ([], "no runs"),
        (["a", "--by", "lerning_rate"], 'did you mean "learning_rate"'),
        (["a", "--metrics", "settling_tme"], 'did you mean "settling_time"'),
        (["a", "--metrics", "seconds"], 'unknown metric "seconds"'),
        (["a", "--plot", "curves.gif"], "file format"),
        (["a", "--plot", "curves.png", "--dpi", "5"], "dpi 5"),
        ([*(f"seed-{seed}" for seed in range(7)), "--by", "seed", "--plot", "curves.png"], "room for 6"),
    ],
)
def test_what_cannot_be_drawn_is_refused(
    arguments: list[str],
    complaint: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, seed in (("a", 0), *((f"seed-{seed}", seed) for seed in range(7))):
        make_run(tmp_path / name, ALONE, seed=seed)
    assert main(["curves", *arguments]) == 2
    assert complaint in capsys.readouterr().err
    assert not list(tmp_path.glob("curves*"))


HEAD = "steps,seconds,success,return,settling_time,expert,expert_success,expert_return,expert_settling_time\n"


@pytest.mark.parametrize(
    ("metrics", "complaint"),
    [
        ("", "metrics.csv is damaged"),
        (HEAD, "metrics.csv is damaged"),
        ("steps,expert\n", "metrics.csv is damaged"),
        ("steps,seconds,success,return,expert\n1,2,x,4,apf\n", "metrics.csv is damaged"),
        (f"{HEAD}0,1,1,1,1,apf,1,1,1\n0,2,1,1,1,apf,1,1,1\n", "steps must grow"),
        (f"{HEAD}0,1,nan,1,1,apf,1,1,1\n", "success and return must be numbers"),
        (f"{HEAD}0,inf,1,1,1,apf,1,1,1\n", "seconds must be finite"),
        (f"{HEAD}0,1,1,1,1,apf,1,1,1,7,8\n", "metrics.csv is damaged"),
        (f"{HEAD}0,1,1\n", "metrics.csv is damaged"),
        ("\0\0\0", "metrics.csv is damaged"),
    ],
)
def test_damaged_metrics_are_named_and_nothing_else_to_show_is_an_exit_code_of_one(
    metrics: str, complaint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = make_run(tmp_path / "damaged", ALONE)
    (folder / "metrics.csv").write_text(metrics)
    assert main(["curves", str(folder)]) == 1
    said = capsys.readouterr().err
    assert said.startswith("planarm curves: no run to show: ")
    assert complaint in said
    assert len(said.splitlines()) == 1


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes in the file system")
@pytest.mark.parametrize("name", ["metrics.csv", "config.yaml"])
def test_a_pipe_in_place_of_a_file_is_not_waited_for(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = make_run(tmp_path / "run", ALONE)
    (folder / name).unlink()
    os.mkfifo(folder / name)
    assert main(["curves", str(folder), str(tmp_path / "none")]) == 1
    said = capsys.readouterr().err
    assert f"{name}" in said
    assert "is no file" in said
    assert f"{tmp_path / 'none'} is no folder" in said


def test_copies_and_runs_without_a_metric_are_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    make_run(tmp_path / "a", ALONE[:2])
    make_run(tmp_path / "copy", ALONE)  # of the same seed, and further
    bare = make_run(tmp_path / "bare", ALONE, seed=1)
    lines = (bare / "metrics.csv").read_text().replace("settling_time", "settled").splitlines()
    (bare / "metrics.csv").write_text("\n".join(lines))
    assert main(["curves", *folders(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert cells(out)["PPO alone"][:2] == ["1", "200"]
    assert f"{tmp_path / 'a'} has the same settings and seed 0 as {tmp_path / 'copy'}: the same run twice" in out
    assert f"{bare} has no column settling_time, expert_settling_time in its metrics.csv" in out


def test_a_metric_of_one_environment_alone_leaves_the_others_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    make_run(tmp_path / "belt", ALONE)
    dodge = make_run(tmp_path / "dodge", ALONE, env="ObstacleDodge-v0")
    text = (dodge / "metrics.csv").read_text().replace("settling_time", "time_to_goal")
    (dodge / "metrics.csv").write_text(text)
    assert main(["curves", *folders(tmp_path), "--metrics", "settling_time"]) == 0
    out = capsys.readouterr().out
    assert "### ConveyorTrack-v0" in out
    assert "### ObstacleDodge-v0" not in out
    assert 'the runs of ObstacleDodge-v0: unknown metric "settling_time"' in out
    assert main(["curves", *folders(tmp_path), "--metrics", "settling_tme"]) == 2


def test_what_is_no_run_is_named_and_left_out_and_environments_are_told_apart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    make_run(tmp_path / "belt", ALONE)
    make_run(tmp_path / "dodge", ALONE, env="ObstacleDodge-v0")
    make_run(tmp_path / "damaged", ALONE, seed=5)
    (tmp_path / "damaged" / "metrics.csv").write_text("steps,expert\n")
    (tmp_path / "mk[/b]run").mkdir(parents=True)
    (tmp_path / "notes.txt").write_text("no run")
    names = ["belt", "damaged", "dodge", "mk[/b]run", "notes.txt"]
    assert main(["curves", *names, "--metrics", "success", "--plot", "curves.svg"]) == 0
    out = capsys.readouterr().out
    assert "### ConveyorTrack-v0" in out
    assert "### ObstacleDodge-v0" in out
    for name, complaint in (("damaged", "is damaged"), ("mk[/b]run", "is no run"), ("notes.txt", "is no folder")):
        assert name in out
        assert complaint in out
    assert sorted(path.name for path in tmp_path.glob("*.svg")) == [
        "curves-ConveyorTrack-v0.svg",
        "curves-ObstacleDodge-v0.svg",
    ]


def test_pictures_of_own_tasks_have_names_of_files() -> None:
    names = _pictures(Path("c.png"), ["ConveyorTrack-v0", "mymod:my/Conveyor-v0"])
    assert names == [Path("c-ConveyorTrack-v0.png"), Path("c-mymod-my-Conveyor-v0.png")]
    with pytest.raises(ValueError, match="given 2 times"):
        _pictures(Path("c.png"), ["my/Conveyor-v0", "my:Conveyor-v0"])
