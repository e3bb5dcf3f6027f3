"""The tables of the difficulty levels: levels in the order of what planners reach, policies beside each other."""

from __future__ import annotations

from typing import Any

import envs
from agents.evaluation.benchmark_config import configure
from tools.levels_table import MARK, PAGE, load, scores, tables
from tools.site.marks import replaced

LEVELS = list(envs.task_card("MinTorqueMove-v0").levels)


def document(level: str, shares: dict[str, float], mode: str = "") -> dict[str, Any]:
    policies = [
        {
            "policy": policy,
            "episodes": {"is_success": [index < round(20 * share) for index in range(20)]},
            "summary": {"success": {"value": share, "low": share - 0.1, "high": share + 0.1}},
            "action_config": {"control_mode": "motion" if policy == "agent" else mode},
        }
        for policy, share in shares.items()
    ]
    bound = {"seeds": [0, 1, 2], "effort": [0.1, None, 0.2]}
    return {"versions": {}, "results": [{"task": f"MinTorqueMove-v0/{level}", "policies": policies, "bound": bound}]}


def test_levels_are_in_the_order_of_what_the_best_planner_reaches() -> None:
    stored = {
        **scores(document(LEVELS[0], {"agent": 0.9, "dpct": 0.5})),
        **scores(document(LEVELS[2], {"dpct": 0.25, "apf": 0.75})),
        **scores(document(LEVELS[1], {"dpct": 0.5, "apf": 0.75}, "velocity")),
    }
    lines = list(tables(stored))
    assert lines[3] == "| level | | agent (motion) | dpct | apf | best known |"
    assert [line.split("`")[1] for line in lines[5:]] == [LEVELS[1], LEVELS[2], LEVELS[0]]
    assert lines[5].endswith(" |  | 50 (40-60), velocity | 75 (65-85), velocity | 75 |")
    assert lines[6].endswith(" |  | 25 (15-35) | 75 (65-85) | 75 |")
    assert lines[7].endswith(" | 90 (80-100) | 50 (40-60) |  | 90 |")


def test_the_page_has_what_is_stored() -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert replaced(text, MARK, "\n".join(tables(load()))) == text, "run python -m tools.levels_table"


def test_every_level_is_scored_with_the_policies_and_control_modes_of_the_configuration() -> None:
    config, stored = configure("levels", {}), load()
    assert set(stored) == {task.title for task in config.tasks}
    for task in config.tasks:
        policies = task.policies or config.policies
        scored = stored[task.title]["policies"]
        assert set(scored) == set(policies)
        assert {name: scored[name]["mode"] for name in task.control_modes} == task.control_modes
