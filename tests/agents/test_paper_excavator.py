"""The command that regenerates the excavator paper's results."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from paper_results import Regenerate

from agents.papers.excavator.runs import CASES, CONTROLLERS, MISMATCHED_PAYLOADS, NOMINAL, PUSH, Trial


@pytest.fixture(scope="module")
def document(regenerate: Regenerate) -> dict[str, Any]:
    return regenerate("paper-excavator").document


def test_every_table_is_complete(document: dict[str, Any]) -> None:
    titles = [entry.title for entry in CONTROLLERS]
    assert len(set(titles)) == len(titles)
    assert [(row["controller"], row["mass"]) for row in document["payloads"]] == [
        (title, mass) for title in titles for mass in (0.0, 350.0)
    ]
    assert [(row["controller"], row["percent"], row["case"]) for row in document["rough"]] == [
        (title, percent, case.title) for title in titles for percent in MISMATCHED_PAYLOADS for case in CASES
    ]


def test_errors_agree_with_one_another(document: dict[str, Any]) -> None:
    for row in document["payloads"] + document["rough"]:
        assert row["first"] == row["last"]  # of one cycle
        errors = row["first"]
        assert errors["joints"] == pytest.approx(np.sqrt(np.mean(np.square(errors["position"]))))
        assert errors["tip"] <= errors["tip_peak"]
        assert 0.0 < row["torque_ratio"] <= 1.0
        assert abs(errors["mass_estimate"] - row["mass"]) <= errors["mass_error"]


def test_the_nominal_case_is_the_payload_table_again(document: dict[str, Any]) -> None:
    heavy = {row["controller"]: row for row in document["payloads"] if row["percent"] == 10.0}
    for row in document["rough"]:
        if row["percent"] == 10.0 and row["case"] == "nominal":
            assert row["last"]["joints"] == pytest.approx(heavy[row["controller"]]["last"]["joints"], rel=1e-9)


def test_facts_are_what_their_numbers_show(document: dict[str, Any]) -> None:
    gain, mass, accuracy, rough, centre, forces, kinematics, sign = (fact["values"] for fact in document["facts"])
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
    for case in ("push", "pull"):
        row = {(row["controller"], row["mass"]): row for row in document["rough"] if row["case"] == case}
        assert forces[case] == {
            title: pytest.approx(np.degrees(row[title, 70.0]["last"]["joints"]))
            for title in ("computed torque + I", "the paper's, mass", ours)
        }
    assert forces["pull"]["the paper's, mass"] > 2.0 * forces["pull"]["computed torque + I"]
    assert kinematics["all_branches"] == pytest.approx(0.76, abs=0.02)
    assert kinematics["recovered"] == 1.0
    assert max(kinematics["position"], kinematics["direction"]) < 1e-12
    assert sign == {"printed": pytest.approx(0.0, abs=1e-3), "repaired": 1.0}


def test_a_push_to_the_left_moves_the_slew_to_the_left_while_it_lasts() -> None:
    run = Trial(cycles=1, period=0.02).follow(CONTROLLERS[2], [(2.0, NOMINAL), (2.0, PUSH)])
    before, during = run.t < PUSH.acting[0] + 0.01, (run.t > 0.6) & (run.t < PUSH.acting[1])
    np.testing.assert_array_equal(run.q[before, 0], run.q[before, 1])
    pushed = run.q[during, 1] - run.q[during, 0]
    assert pushed[:, 0].min() > 0.0
    assert pushed[:, 0].max() > 5e-4
