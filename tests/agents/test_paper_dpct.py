"""The command that regenerates the conveyor-tracking paper's results."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from paper_results import Regenerate

from agents.papers.dpct import CASES, GRIDS, HEADWAYS, paper_problem, plan_records, tracking_cost
from planners.dpct.paper import MASS_SLIPS, plan_paper


@pytest.fixture(scope="module")
def document(regenerate: Regenerate) -> dict[str, Any]:
    return regenerate("paper-dpct").document


def test_every_case_reading_and_grid_is_there(document: dict[str, Any]) -> None:
    plans = document["plans"]
    for planner in ("literal", "exact step"):
        found = {(plan["case"], *plan["grid"]) for plan in plans if plan["planner"] == planner}
        assert found == {(case, *grid) for case in CASES for grid in GRIDS}
    for reading in MASS_SLIPS:
        assert [plan["case"] for plan in plans if plan["planner"] == reading.name] == [1, 2, 3]
    for planner in ("optimal", "optimal, a(t0) free"):
        assert [plan["case"] for plan in plans if plan["planner"] == planner] == [2, 3]
    clocks = [(row["headway"], row["case"]) for row in document["start_clocks"]]
    assert clocks == [(headway, case) for headway in HEADWAYS for case in CASES]


def test_published_numbers_stand_beside_regenerated_ones(document: dict[str, Any]) -> None:
    plans = [plan for plan in document["plans"] if plan["planner"] == "literal" and plan["grid"] == [50, 100]]
    assert [plan["published_rendezvous_time"] for plan in plans] == [0.65, 0.8, 1.1]
    assert [plan["rendezvous_time"] for plan in plans] == pytest.approx([0.65, 0.85, 1.1], abs=1e-12)
    assert [plan["published_peak_torque"] for plan in plans] == [[-1.342, -0.406], [-0.499, -0.14], None]
    coarse = [plan for plan in document["plans"] if plan["planner"] == "literal" and plan["grid"] == [30, 50]]
    assert all(plan["published_rendezvous_time"] is None for plan in coarse)


def test_optimal_plans_keep_their_limits_and_no_plan_beats_the_least_cost(document: dict[str, Any]) -> None:
    for plan in document["plans"]:
        ratios = [math.inf if ratio is None else ratio for ratio in plan["limit_ratios"].values()]  # as JSON has it
        if plan["planner"].startswith("optimal"):
            assert max(ratios) <= 1.0
            assert plan["lag"] == 0.0
        if max(ratios) <= 1.0 and plan["lag"] == 0.0:
            assert plan["cost_ratio"] >= 0.999


def test_tracking_cost_agrees_with_the_planners_own() -> None:
    motion = plan_paper(paper_problem(2))
    assert tracking_cost(motion) == pytest.approx(motion.cost, rel=1e-9)


def test_the_scenario_is_the_papers() -> None:
    problem = paper_problem(3)
    np.testing.assert_allclose(problem.arm.forward_kinematics(problem.q), [-0.8, 1.732], atol=1e-12)
    assert problem.horizon == pytest.approx(3.0)
    assert next(plan_records())["case"] == 1
