"""The command that regenerates the excavator paper's results."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents.cli import COMMANDS, main
from agents.papers.excavator.command import PaperExcavatorOptions, run
from agents.papers.excavator.figures import draw
from agents.papers.excavator.runs import CASES, CONTROLLERS, ROUGH_PAYLOADS

QUICK = {"payloads": (0.0, 10.0), "cycles": 1, "rate": 40.0}


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the JSON and the figures of a short run."""
    folder = tmp_path_factory.mktemp("paper")
    run(PaperExcavatorOptions(json=folder / "table.json", plot=folder / "figures.png", dpi=20, **QUICK))
    return folder


@pytest.fixture(scope="module")
def document(written: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((written / "table.json").read_text())
    return content


def test_the_command_is_there() -> None:
    assert COMMANDS["paper-excavator"].options_type() is PaperExcavatorOptions


def test_every_table_is_complete(document: dict[str, Any]) -> None:
    assert list(document) == ["payloads", "rough", "facts"]
    titles = [entry.title for entry in CONTROLLERS]
    assert len(set(titles)) == len(titles)
    assert [(row["controller"], row["mass"]) for row in document["payloads"]] == [
        (title, mass) for title in titles for mass in (0.0, 350.0)
    ]
    assert [(row["controller"], row["percent"], row["case"]) for row in document["rough"]] == [
        (title, percent, case.title) for title in titles for percent in ROUGH_PAYLOADS for case in CASES
    ]
    assert len(document["facts"]) == 7


def test_errors_agree_with_one_another(document: dict[str, Any]) -> None:
    for row in document["payloads"] + document["rough"]:
        assert row["first"] == row["last"]  # of one cycle
        errors = row["first"]
        assert errors["joints"] == pytest.approx(np.sqrt(np.mean(np.square(errors["position"]))))
        assert errors["tip"] <= errors["tip_peak"]
        assert 0.0 < row["torque_ratio"] <= 1.0
        assert abs(errors["mass_estimate"] - row["mass"]) <= errors["mass_error"]


def test_nothing_unknown_is_the_payload_table_again(document: dict[str, Any]) -> None:
    heavy = {row["controller"]: row for row in document["payloads"] if row["percent"] == 10.0}
    for row in document["rough"]:
        if row["percent"] == 10.0 and row["case"] == "nothing":
            assert row["last"]["joints"] == pytest.approx(heavy[row["controller"]]["last"]["joints"], rel=1e-9)


def test_facts_are_what_their_numbers_show(document: dict[str, Any]) -> None:
    gain, mass, accuracy, rough, centre, kinematics, sign = (fact["values"] for fact in document["facts"])
    rows = {(row["controller"], row["mass"]): row["last"] for row in document["payloads"]}
    ours, fixed = CONTROLLERS[-1].title, "computed torque"
    assert gain["last_of_fixed"] == pytest.approx(rows[ours, 350.0]["joints"] / rows[fixed, 350.0]["joints"])
    assert gain["first_of_fixed"] < gain["integral_of_fixed"] < 0.2
    assert mass["after_first_cycle"] == pytest.approx(abs(rows[ours, 350.0]["mass_estimate"] / 350.0 - 1.0))
    assert accuracy["joints"] == max(rows[ours, 0.0]["joints"], rows[ours, 350.0]["joints"])
    together = {
        (row["controller"], row["mass"]): row["last"] for row in document["rough"] if row["case"] == "all together"
    }
    assert rough["last_of_integral"] == pytest.approx(
        max(together[ours, mass]["joints"] / together["computed torque + I", mass]["joints"] for mass in (70.0, 350.0))
    )
    assert rough["tip"] == max(together[ours, mass]["tip"] for mass in (70.0, 350.0))
    assert list(centre) == ["the paper's, mass", "computed torque + I", ours]
    assert kinematics["all_branches"] == pytest.approx(0.76, abs=0.02)
    assert kinematics["recovered"] == 1.0
    assert max(kinematics["position"], kinematics["direction"]) < 1e-12
    assert sign == {"printed": pytest.approx(0.0, abs=1e-3), "repaired": 1.0}


def test_figures_are_written(written: Path) -> None:
    assert (written / "figures.png").read_bytes().startswith(b"\x89PNG")
    assert sorted(path.name for path in written.iterdir()) == ["figures.png", "table.json"]


def test_tables_and_facts_are_printed_as_markdown(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["paper-excavator", "--payloads", "0", "--cycles", "1", "--rate", "20"]) == 0
    printed = capsys.readouterr().out
    assert printed.count("### ") == 6
    assert "0 %, 0 kg" in printed
    assert printed.count("\n- ") == 5  # there is no payload to be weighed


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--payloads", "-2"], "none negative"),
        (["--cycles", "0"], "cycles 0 must be positive"),
        (["--rated-load", "nan"], "rated_load nan must be positive"),
        (["--rate", "33.3"], "does not divide a cycle"),
    ],
)
def test_what_cannot_be_is_refused(arguments: list[str], complaint: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["paper-excavator", *arguments]) == 2
    assert complaint in capsys.readouterr().err


@pytest.mark.usefixtures("without_matplotlib")
def test_plot_without_matplotlib_says_what_to_install() -> None:
    options = PaperExcavatorOptions(**QUICK)
    with pytest.raises(ModuleNotFoundError, match=r"planarm\[viz\]"):
        draw(options.trial(), options.payloads, "png", 20)
