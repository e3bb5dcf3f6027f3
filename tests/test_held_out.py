"""The held-out comparison: successes bit by bit, the tables of its page, and a share of its episodes run again."""

from __future__ import annotations

import numpy as np
import pytest

from agents.evaluation.benchmark_config import BenchmarkTask
from agents.policies.lookup import is_shipped
from tools.site.held_out import CONFIG, MARK, PAGE, Scored, load, scored, tables, weights_of
from tools.site.marks import replaced

AGAIN = 6
"""Episodes of each policy that are run again."""


def row_of(bits: list[int], returns: list[float] | None = None) -> Scored:
    blank = Scored(began="", versions={}, weights="", episodes=0, successes="")
    row = blank.with_more(np.array(bits, dtype=bool), [0.0] * len(bits) if returns is None else returns)
    return row if returns is not None else row.model_copy(update={"returns": []})


def test_successes_come_back_as_they_were_stored() -> None:
    bits = np.random.default_rng(0).random(21) < 0.5
    returns = np.linspace(-1.0, 1.0, 21).tolist()
    parts = row_of(list(bits[:13]), returns[:13]).with_more(bits[13:], returns[13:])
    assert (parts.episodes, len(parts.successes)) == (21, 6)
    assert np.array_equal(parts.bits, bits)
    np.testing.assert_allclose(parts.returns, returns, atol=5e-5)
    assert row_of(list(bits[:13])).with_more(bits[13:], returns[13:]).returns == []  # of a part is of none


def test_tables_compare_the_episodes_that_all_policies_have_met() -> None:
    rows = {"agent": row_of([1, 1, 0, 1, 0, 0]), "apf": row_of([0, 1, 0, 0]), "dpct": row_of([1, 1, 1, 1, 1])}
    lines = list(tables({"Task-v0/hard": rows}))
    assert lines[1] == "### Task-v0/hard: 4 episodes"
    assert [line.split(" (")[0] for line in lines if line.startswith(("|agent|", "|apf|", "|dpct|"))] == [
        "|dpct|100.0",
        "|agent|75.0",
        "|apf|25.0",
    ]
    assert [line.split(" (")[0] for line in lines if " - " in line] == ["|agent - dpct|-25.0", "|agent - apf|+50.0"]


def test_returns_that_are_kept_of_all_order_the_policies_and_are_compared() -> None:
    rows = {"agent": row_of([1, 1], [0.5, 1.5]), "apf": row_of([1, 1], [1.0, 2.25]), "dpct": row_of([0, 1], [0.0, 1.0])}
    lines = [line for line in tables({"Task-v0/hard": rows}) if line.startswith("|") and "---" not in line]
    assert [line.split("|")[1] for line in lines[:4]] == ["policy", "apf", "agent", "dpct"]
    assert lines[4] == "|difference|success (points)|return|"
    assert [line.split("|")[3].split(" ")[0] for line in lines[5:]] == ["-0.625", "+0.500"]


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
        bits, returns = scored(task, name, 0, AGAIN)
        assert np.array_equal(bits, row.bits[:AGAIN]), name
        if row.returns:
            np.testing.assert_allclose(returns, row.returns[:AGAIN], atol=1e-4)
