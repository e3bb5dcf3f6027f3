"""The command that regenerates the potential-field paper's results."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from paper_results import Regenerate

from agents.papers.apf.facts import stable_distance
from agents.papers.apf.runs import (
    DISTANCES,
    GOAL,
    NORMS,
    SCENES,
    START,
    WALLS,
    paper_problem,
    random_problems,
    scene_records,
)
from planners.apf.hand_field import make_field
from planners.apf.khatib import wall


@pytest.fixture(scope="module")
def document(regenerate: Regenerate) -> dict[str, Any]:
    return regenerate("paper-apf").document


def test_every_table_is_complete(document: dict[str, Any]) -> None:
    kinds = [(distance, wall) for distance in DISTANCES for wall in WALLS.values()]
    scenes = [(row["scene"], row["distance"], row["wall"]) for row in document["scenes"]]
    assert scenes == [(scene, *kind) for scene in SCENES for kind in kinds]
    assert [(row["distance"], row["wall"]) for row in document["random"]] == kinds
    for row in document["scenes"] + document["random"] + document["facts"]:
        assert all(value is not None for value in row.values())


def test_scenes_show_what_their_titles_say(document: dict[str, Any]) -> None:
    rows = {(row["scene"], row["distance"], row["wall"]): row for row in document["scenes"]}
    for name in WALLS.values():
        static, table = (rows["crossing", distance, name] for distance in DISTANCES)
        assert static["outcome"] == table["outcome"] == "reached"
        assert table["hand_clearance"] > static["hand_clearance"] + 0.05
        assert table["time"] > static["time"]
        outcomes = [rows["crossing, other elbow", distance, name]["outcome"] for distance in DISTANCES]
        assert outcomes == ["collision", "reached"]
        for distance in DISTANCES:
            hit, stuck = rows["elbow", distance, name], rows["gate", distance, name]
            assert hit["outcome"] == "collision"
            assert hit["arm_clearance"] < 0.0 < 0.2 < hit["hand_clearance"]
            assert stuck["outcome"] == "local_minimum"
            assert stuck["goal_distance"] > 0.4


def test_clearances_are_the_scenes_over_time(document: dict[str, Any]) -> None:
    rows = [row for row in document["scenes"] if row["scene"] == "crossing"]
    for row, curves in zip(rows, document["clearances"], strict=True):
        assert (curves["distance"], curves["wall"]) == (row["distance"], row["wall"])
        assert len(curves["t"]) == len(curves["hand"]) == len(curves["arm"])
        np.testing.assert_allclose(np.diff(curves["t"]), 0.02)
        assert min(curves["arm"]) == pytest.approx(row["arm_clearance"], abs=0.003)
        assert min(curves["hand"]) == pytest.approx(row["hand_clearance"], abs=0.003)
        assert np.subtract(curves["hand"], curves["arm"]).min() >= -1e-12


def test_random_shares_add_up_and_it_is_the_links_that_are_hit(document: dict[str, Any]) -> None:
    for row in document["random"]:
        shares = [row[ending] for ending in ("reached", "hand_hit", "link_hit", "local_minimum", "late")]
        assert sum(shares) == pytest.approx(1.0)
        assert 0.0 < row["in_range"] < row["reached"]
        plain = next(other for other in document["random"] if other["wall"] == row["wall"])
        assert row["reached"] == pytest.approx(plain["reached"] + row["gained"] - row["lost"])
        assert row["link_hit"] > 10.0 * row["hand_hit"]


def test_the_norms_are_those_of_the_plain_distance_and_a_small_p_lets_the_disc_come_near(
    document: dict[str, Any],
) -> None:
    rows = {float(row["norm"] or "inf"): row for row in document["norms"]}  # JSON has no infinity
    assert list(rows) == list(NORMS)
    plain = next(row for row in document["random"] if (row["distance"], row["wall"]) == ("static", "Khatib"))
    assert [rows[2.0][name] for name in ("reached", "hand_hit", "link_hit")] == [
        plain[name] for name in ("reached", "hand_hit", "link_hit")
    ]
    crossing = next(row for row in document["scenes"] if (row["distance"], row["wall"]) == ("static", "Khatib"))
    assert rows[2.0]["hand_clearance"] == crossing["hand_clearance"]
    assert rows[1.0]["outcome"] == "collision"
    clearances = [row["hand_clearance"] for row in rows.values()]
    assert clearances == sorted(clearances)
    for norm, row in rows.items():
        corner = np.full(2, row["diagonal"] / np.sqrt(2.0))
        assert np.linalg.norm(corner, norm) == pytest.approx(1.0)


def test_steps_are_timed(document: dict[str, Any]) -> None:
    step = document["facts"][0]["values"]
    assert step["published_budget"] == 1e-4
    assert step["planner"] > 0.0


def test_facts_are_what_their_numbers_show(document: dict[str, Any]) -> None:
    square, inverse, singular, start, measured, sampling = (fact["values"] for fact in document["facts"][1:])
    gains = make_field(square=False).gains
    assert square == {"printed": pytest.approx(gains.repulsion / (2.0 * gains.influence**2)), "khatib": 0.0}
    assert inverse["printed_within_1_mm"] < 0.01
    assert inverse["repaired_worst"] < 1e-12
    # the exact inverse of a stretched arm of half a metre each: rates grow as 4 / theta_2
    assert singular["exact"] == pytest.approx([4.0 / angle for angle in singular["theta_2"][:-1]], rel=0.01)
    assert max(singular["damped"][1:]) < 1.0
    assert singular["damped"][-1] == 0.0
    assert start["hand_speed"] == pytest.approx(2.0 * np.hypot(*np.subtract(GOAL, START)))
    assert measured["over_10_ms"] < 0.1 < 100.0 < measured["last_sample"]
    assert sampling["0.1 ms"] < sampling["20 ms"] < 0.3


def test_stable_distance_is_where_steps_stop_to_settle() -> None:
    gains, period = make_field().gains, 0.02
    nearest = stable_distance(gains, period)
    curvature = (wall(gains, nearest + 1e-6)[1] - wall(gains, nearest - 1e-6)[1]) / 2e-6
    assert period * (curvature + gains.attraction) == pytest.approx(2.0, rel=1e-6)


def test_random_problems_are_fair_and_repeat() -> None:
    problems = list(random_problems(40, seed=5))
    assert len(problems) == 40
    for problem, again in zip(problems, random_problems(40, seed=5), strict=True):
        (disc,), arm = problem.obstacles, problem.arm
        assert problem.q.tobytes() == again.q.tobytes()
        assert 0.2 <= np.hypot(*disc.velocity) <= 1.0
        assert arm.clearance(problem.q, disc.position, disc.radius) >= 0.3
        nearest = disc.position - disc.velocity * (disc.position @ disc.velocity) / (disc.velocity @ disc.velocity)
        passed = disc.position @ disc.velocity > 0.0
        assert passed or np.hypot(*nearest) >= 0.319
    headings = [np.arctan2(*disc.velocity) for problem in problems for disc in problem.obstacles]
    assert np.ptp(headings) > 5.0


def test_the_scene_is_the_one_described() -> None:
    problem = paper_problem("crossing, other elbow")
    np.testing.assert_allclose(problem.arm.forward_kinematics(problem.q), START, atol=1e-12)
    assert problem.q[1] < 0.0 < paper_problem("crossing").q[1]
    assert next(scene_records())["scene"] == "crossing"
