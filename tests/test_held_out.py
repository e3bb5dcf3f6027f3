"""The held-out comparison: successes bit by bit, the tables of its page, and a share of its episodes run again."""

from __future__ import annotations

import numpy as np
import pytest

from agents.evaluation.benchmark_config import BenchmarkTask
from agents.policies.lookup import is_shipped
from tools.site.held_out import CONFIG, MARK, PAGE, Scored, load, successes, tables, weights_of
from tools.site.marks import replaced

AGAIN = 6
"""Episodes of each policy that are run again."""


def scored(bits: list[int], weights: str = "") -> Scored:
    blank = Scored(began="", versions={}, weights=weights, episodes=0, successes="")
    return blank.with_more(np.array(bits, dtype=bool))


def test_successes_come_back_as_they_were_stored() -> None:
    bits = np.random.default_rng(0).random(21) < 0.5
    parts = scored(list(bits[:13])).with_more(bits[13:])
    assert (parts.episodes, len(parts.successes)) == (21, 6)
    assert np.array_equal(parts.bits, bits)


def test_tables_compare_the_episodes_that_all_policies_have_met() -> None:
    rows = {"agent": scored([1, 1, 0, 1, 0, 0]), "apf": scored([0, 1, 0, 0]), "dpct": scored([1, 1, 1, 1, 1])}
    lines = list(tables({"Task-v0/hard": rows}))
    assert lines[1] == "### Task-v0/hard: 4 episodes"
    assert [line.split(" (")[0] for line in lines if line.startswith(("|agent|", "|apf|", "|dpct|"))] == [
        "|dpct|100.0",
        "|agent|75.0",
        "|apf|25.0",
    ]
    assert [line.split(" (")[0] for line in lines if " - " in line] == ["|agent - dpct|-25.0", "|agent - apf|+50.0"]


def test_the_page_has_what_is_stored() -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert replaced(text, MARK, "\n".join(tables(load()))) == text, "run python -m tools.site.held_out"


def test_every_policy_of_the_configuration_is_stored_with_the_weights_that_are_shipped() -> None:
    stored = load()
    assert set(stored) == {task.title for task in CONFIG.tasks}
    for task in CONFIG.tasks:
        assert set(stored[task.title]) == set(task.policies or CONFIG.policies)
        for name, row in stored[task.title].items():
            assert row.weights == weights_of(name, task.env)
            assert bool(row.weights) == is_shipped(name)


@pytest.mark.parametrize("task", CONFIG.tasks, ids=lambda task: task.title)
def test_the_first_episodes_end_as_stored(task: BenchmarkTask) -> None:
    for name, row in load()[task.title].items():
        assert np.array_equal(successes(task, name, 0, AGAIN), row.bits[:AGAIN]), name
