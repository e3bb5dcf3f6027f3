"""`planarm payload`: what a user types and reads."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from agents import evaluate
from agents.cli import main

FEW = ["payload", "--episodes", "3", "--policies", "apf"]


def test_every_mass_without_and_with_the_law(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = tmp_path / "rows.json"
    assert main([*FEW, "--seed", "5", "--masses", "0", "0.3", "--json", str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "### ConveyorTrack-v0: 3 episodes each, from seed 5"
    cells = [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines if line.startswith("|")]
    assert cells[0] == ["payload (kg)", "policy", "success (%)", "settled (s)", "error (mm)", "limit ratio", "kept (%)"]
    assert [row[:2] for row in cells[2:]] == [[mass, name] for mass in ("0", "0.3") for name in ("apf", "apf+adaptive")]
    rows = json.loads(path.read_text())["rows"]
    wanted = evaluate("apf+adaptive", "ConveyorTrack-v0", range(5, 8), env_config={"payload": 0.3})
    assert (rows[3]["payload"], rows[3]["policy"]) == (0.3, "apf+adaptive")
    assert rows[3]["episodes"]["return"] == wanted.returns.tolist()
    assert cells[5][2] == f"{100.0 * wanted.success.mean():.1f}"


def test_what_is_true_or_false_is_a_share(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*FEW, "--env", "ObstacleDodge-v0", "--masses", "0.1"]) == 0
    out = capsys.readouterr().out
    assert "collided (%)" in out
    assert "True" not in out


def test_evaluate_takes_the_name(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["evaluate", "apf+adaptive", "--env", "ConveyorTrack-v0", "--against", "apf", "--episodes", "3"]
    assert main([*arguments, "--settings", "payload=0.3"]) == 0
    assert "apf+adaptive - apf" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ([*FEW, "--env", "ConveyorTrak-v0"], 'did you mean "ConveyorTrack-v0"'),
        (["payload", "--policies", "dcpt"], 'did you mean "dpct"'),
        ([*FEW, "--masses", "-0.1"], "payload = -0.1"),
        (["payload", "--episodes", "0"], "episodes 0 must be at least 1"),
        (
            ["evaluate", "apf+adaptive", "--env", "ConveyorTrack-v0", "--settings", "control_mode=jerk"],
            "use control_mode",
        ),
        (["evaluate", "apf+adaptive"], "on which environment"),
    ],
)
def test_what_is_wrong_is_said(capsys: pytest.CaptureFixture[str], arguments: list[str], complaint: str) -> None:
    assert main(arguments) == 2
    assert complaint in capsys.readouterr().err
