"""`planarm plan`, and the page that teaches planning and a planner of one's own."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from agents.cli import main
from planners import SCARA_50CM, Trajectory
from tests.pages import follow

MOVE = ["plan", "--arm", "SCARA_50CM", "--start", "0.2", "1.5", "--to-joints", "1.2", "0.8", "--horizon", "2"]


@pytest.mark.docs
def test_the_page_can_be_followed(tmp_path: Path) -> None:
    printed = follow("planners/index.md", tmp_path)
    assert {"out.csv", "out.png", "out.npz", "out.gif", "motion.csv", "motion.npz", "motion.png"} <= {
        path.name for path in tmp_path.iterdir()
    }
    assert "mine" in printed


def test_files_hold_the_motion(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    csv, npz = tmp_path / "out.csv", tmp_path / "out.npz"
    assert main([*MOVE, "--planner", "lagrange", "--csv", str(csv), "--save", str(npz)]) == 0
    assert "lagrange" in capsys.readouterr().out
    motion = Trajectory.load(npz)
    assert motion.problem.arm == SCARA_50CM
    table = np.genfromtxt(csv, delimiter=",", names=True)
    assert table.dtype.names is not None
    assert table.dtype.names[:3] == ("t_s", "q1_rad", "q2_rad")
    np.testing.assert_array_equal(table["tau2_N_m"], motion.tau[:, 1])
    np.testing.assert_array_equal(motion.q[-1], [1.2, 0.8])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["plan", "--start", "0", "0", "--to", "1", "0"], "no arm: give --arm"),
        (["plan", "--arm", "SCARA_1M", "--to", "1", "0"], "give either --start"),
        (["plan", "--arm", "SCARA_1M", "--start", "0", "1"], "give either --to"),
        (["plan", "--arm", "SCARA_1M", "--start", "0", "1", "2", "--to", "1", "0"], r"shape \(3,\)"),
        ([*MOVE, "--planner", "dptc"], 'did you mean "dpct"'),
        ([*MOVE, "--planner", "dpct", "--variant", "tming"], "variant 'tming' must be one of"),
        ([*MOVE, "--planner", "dpct", "--options", "elbo=+"], "has no option elbo"),
        ([*MOVE, "--obstacle", "1", "0"], "must be x, y and radius"),
        ([*MOVE, "--plot", "out.doc"], "file format of out.doc"),
        ([*MOVE[:-1], "0.05"], "allow"),
    ],
)
def test_what_is_missing_or_wrong_is_said(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    assert re.search(message, capsys.readouterr().err)
