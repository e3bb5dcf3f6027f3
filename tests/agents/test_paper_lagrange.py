"""The command that regenerates the minimal-torque paper's results."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from paper_results import Regenerate

from agents.papers.lagrange.interpolation import COUNTS, FAMILIES, QUINTIC, node_polynomial
from agents.papers.lagrange.runs import ALGORITHMS, ANGLE_READINGS, MODELS, paper_problem, reading_torques
from planners.lagrange.paper import chebyshev_nodes, lagrange_basis, published_motion


@pytest.fixture(scope="module")
def document(regenerate: Regenerate) -> dict[str, Any]:
    return regenerate("paper-lagrange").document


def test_every_table_is_complete(document: dict[str, Any]) -> None:
    printed = [(row["model"], row["algorithm"]) for row in document["published"]]
    assert printed == [(model, algorithm) for model in MODELS for algorithm in ALGORITHMS.values()]
    for table, plans in (
        ("searches", ["1: Table 2's nodes", "1: 5 nodes (degree 4)", "1: 3 nodes (degree 2)", "2: degree 2"]),
        (
            "moves",
            [
                "cubic",
                "quintic",
                "2: degree 4",
                "1: 5 nodes, eq 7",
                "1: 5 nodes, Lobatto",
                "optimal, PI1",
                "optimal, PI2",
            ],
        ),
    ):
        assert [(row["model"], row["plan"]) for row in document[table]] == [(m, plan) for m in MODELS for plan in plans]
        assert all(value is not None for row in document[table] for value in row.values())


def test_published_numbers_stand_beside_regenerated_ones(document: dict[str, Any]) -> None:
    rows = document["published"]
    assert [row["published_pi"] for row in rows] == [69.6216, 145.4126] * 2
    assert [row["pi1"] for row in rows] == pytest.approx([8.482, 9.965, 5.557, 15.047], abs=6e-4)
    assert rows[0]["end_angle"] == pytest.approx([1.0145, -0.0391, 0.0157], abs=5e-5)
    assert max(map(abs, rows[0]["start_velocity"])) == pytest.approx(9.4528, abs=5e-5)


def test_facts_are_what_their_numbers_show(document: dict[str, Any]) -> None:
    order, times, goal, speeds, grid, degrees = (fact["values"] for fact in document["facts"])
    assert order["published_ratio"] == pytest.approx(2.089, abs=5e-4)
    assert list(order["ratios"].values()) == pytest.approx([1.175, 2.708], abs=5e-4)
    assert all(ratio > 1.0 for ratio in order["ratios"].values())
    assert times["sines"] == pytest.approx(times["table_2"][:4], abs=5e-5)
    assert np.abs(np.subtract(times["equation_7"], times["table_2"])).max() > 0.08
    assert np.abs(np.subtract(goal["end_angle"], [1.0, 0.0, 0.0])).max() > 0.03
    assert min(speeds["start_speeds"].values()) > 9.0
    assert speeds["turning_pi"] == 0.0
    assert all(row["least"] < 0.5 * row["table_3"] for row in grid["own_grid"].values())
    pi = degrees["pi"]
    assert pi["degree_4"] < pi["degree_2"] < pi["table_3"] < pi["table_4"]


def test_moves_are_from_rest_and_the_optimal_planner_keeps_the_limits(document: dict[str, Any]) -> None:
    for model in MODELS:
        moves = {row["plan"]: row for row in document["moves"] if row["model"] == model}
        assert all(row["start_speed"] == pytest.approx(0.0, abs=1e-9) for row in moves.values())
        for index in ("pi1", "pi2"):
            best = moves[f"optimal, {index.upper()}"]
            assert max(best["torque_ratio"], best["angle_ratio"]) <= 1.0
            assert best[index] < 0.8 * min(row[index] for plan, row in moves.items() if "optimal" not in plan)
    horizontal = {row["plan"]: row for row in document["moves"] if row["model"] == "gravity off"}
    # closed forms; sums of trapezoids half a millisecond wide agree with them to that
    assert [horizontal[plan]["pi1"] for plan in ("cubic", "quintic")] == pytest.approx([4.4, 5.5], abs=1e-5)
    assert [horizontal[plan]["pi2"] for plan in ("cubic", "quintic")] == pytest.approx([12.302, 17.574], abs=6e-4)


def test_the_scenario_is_the_papers() -> None:
    arm = paper_problem("gravity on").arm
    assert (arm.lengths, arm.masses, arm.coms) == ((0.2, 0.4, 0.2), (1.0, 2.0, 1.0), (0.1, 0.2, 0.1))
    assert arm.gravity == 9.81
    assert paper_problem().arm.gravity == 0.0
    assert paper_problem().horizon == 1.0


def test_absolute_angles_come_within_three_percent_of_the_published_ratio_in_two_readings(
    document: dict[str, Any],
) -> None:
    rows = {(row["model"], row["reading"]): row for row in document["readings"]}
    relative, motors, generalised = (reading.title for reading in ANGLE_READINGS)
    close = [key for key, row in rows.items() if abs(row["ratio"] / row["published_ratio"] - 1.0) < 0.03]
    assert close == [("gravity off", motors), ("gravity on", generalised)]
    printed = {(row["model"], row["algorithm"]): row["pi1"] for row in document["published"]}
    for model in MODELS:
        assert rows[model, relative]["pi1"] == pytest.approx([printed[model, name] for name in ALGORITHMS.values()])


def test_torques_in_absolute_angles_do_the_same_work_as_those_of_the_motors() -> None:
    (t, motors), (_, generalised) = (
        reading_torques("gravity on", "lagrange", reading) for reading in ANGLE_READINGS[1:]
    )
    speeds = published_motion(paper_problem("gravity on"), "lagrange").qd  # absolute, as printed
    relative = np.diff(speeds, axis=1, prepend=0.0)
    assert len(t) == len(motors)
    np.testing.assert_allclose((motors * relative).sum(1), (generalised * speeds).sum(1), atol=1e-9)


def test_runges_phenomenon_occurs_with_equidistant_nodes_only(document: dict[str, Any]) -> None:
    errors = {(row["nodes"], row["count"]): row["runge_error"] for row in document["nodes"]}
    for name in FAMILIES:
        rising = [errors[name, count] for count in COUNTS]
        assert rising == sorted(rising, reverse=name != "equidistant")
    assert errors["Table 2", 5] > errors["equidistant", 5] > errors["eq 7", 5]


def test_the_error_of_five_nodes_is_what_equations_10_and_11_say(document: dict[str, Any]) -> None:
    for row in document["nodes"]:
        assert row["quintic_error"] == pytest.approx(row["quintic_bound"], rel=1e-6, abs=1e-9)
    t, nodes = np.linspace(0.0, 1.0, 11), chebyshev_nodes(5)
    through = sum(QUINTIC(node) * basis(t) for node, basis in zip(nodes, lagrange_basis(nodes.tolist()), strict=True))
    np.testing.assert_allclose(QUINTIC(t) - through, 6.0 * node_polynomial(nodes, t), atol=1e-12)
    assert abs(node_polynomial(nodes, np.linspace(0.0, 1.0, 1001))).max() == pytest.approx(2.0 * 0.25**5)
