"""The command that regenerates the conveyor-tracking paper's results."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from paper_results import Regenerate

from agents.papers.dpct.equations import line_states, state_equation
from agents.papers.dpct.runs import (
    BELT_ACCELERATIONS,
    BELT_SPEED,
    CASES,
    GRIDS,
    HEADWAYS,
    LINE,
    SLIP,
    belt_problem,
    paper_problem,
    plan_records,
    tracking_cost,
)
from planners import dpct
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


def test_the_reading_beside_the_figures_meets_every_published_rendezvous(document: dict[str, Any]) -> None:
    assert SLIP.name == "M11 = 5/3 + c2/2"
    rows = [row for row in document["figures"] if row["figure"] == 6]
    assert [row["slip"] for row in rows] == pytest.approx([row["published"] for row in rows], abs=1e-12)
    assert [row["literal"] - row["slip"] for row in rows] == pytest.approx([0.0, 0.05, 0.0], abs=1e-12)
    changes = [row["literal"] for row in document["figures"] if row["quantity"].startswith("mean change")]
    assert changes[1] < 0.5 * changes[0]


def test_the_state_equation_gives_the_acceleration_of_the_arm_along_the_line() -> None:
    arm, line = paper_problem(1).arm, line_states(20)
    rng = np.random.default_rng(0)
    rate, change = rng.uniform(0.0, 0.5, 20), rng.uniform(-1.0, 1.0, 20)
    qd = line.slope * rate[:, None]
    torque = arm.inverse_dynamics(line.q, qd, line.curvature * rate[:, None] ** 2 + line.slope * change[:, None])
    np.testing.assert_allclose(state_equation(arm, line).acceleration(rate, torque), change, atol=1e-12)


def test_table_1_is_right_but_for_its_offset_its_half_turn_and_one_entry_of_the_mass_matrix(
    document: dict[str, Any],
) -> None:
    differences = {row["row"].split(",")[0].split(" at")[0]: row["difference"] for row in document["table_1"]}
    assert differences["x"] == pytest.approx(0.3)
    assert differences["q1"] == pytest.approx(math.pi)
    assert [name for name, difference in differences.items() if difference < 1e-12] == ["q2", "f'", "f''", "M", "h"]
    arm, line = paper_problem(1).arm, line_states()
    inertia = arm.mass_matrix(line.q)
    slipped = inertia.copy()
    slipped[:, 0, 0] = 5.0 / 3.0 * np.cos(line.q[:, 1])
    row = np.einsum("pij,pj->pi", slipped, line.slope)
    right = state_equation(arm, line)
    squares = np.einsum("pi,pi->p", row, row)
    assert np.abs(squares - right.a).max() == pytest.approx(differences["a"], rel=1e-9)
    assert np.abs(row / squares[:, None] - right.d).max() == pytest.approx(differences["d"], rel=1e-9)
    bends = np.einsum("pij,pj->pi", inertia, line.curvature)
    assert np.abs(-np.einsum("pi,pi->p", row, bends) - right.b).max() == pytest.approx(differences["b"], rel=1e-9)


def test_the_hand_rides_on_accelerating_belts_or_the_plan_is_refused(document: dict[str, Any]) -> None:
    rows = document["belts"]
    assert [row["acceleration"] for row in rows] == list(BELT_ACCELERATIONS)
    assert [row["reason"] for row in rows] == ["", "", "", "", "late"]
    times = [row["rendezvous_time"] for row in rows[:-1]]
    assert times == sorted(times)
    motion = dpct.plan(belt_problem(0.01))
    after = motion.t >= motion.rendezvous_time
    hand = np.einsum("sj,sj->s", belt_problem(0.01).arm.jacobian(motion.q)[:, 0], motion.qd)
    np.testing.assert_allclose(hand[after], BELT_SPEED + 0.01 * motion.t[after], atol=1e-6)
    assert motion.limit_ratio <= 1.0


def test_facts_are_what_their_numbers_show(document: dict[str, Any]) -> None:
    turn, across = (fact["values"] for fact in document["facts"])
    ends = [paper_problem(1).arm.inverse_kinematics([x, 1.732])[0].sum() for x in np.linspace(-0.8, -0.8 + LINE, 50)]
    assert turn["turn"] == pytest.approx(np.degrees(np.ptp(ends)), rel=1e-3)
    assert across["across"] > 1e-3
