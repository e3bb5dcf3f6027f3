"""The tables of the difficulty levels: levels in the order of the card, policies beside each other."""

from __future__ import annotations

import pytest

import envs
from tools.levels_table import MARKS, PAGE, tables, updated

LEVELS = list(envs.task_card("MinTorqueMove-v0").levels)


def result(level: str, policy: str, share: float) -> dict[str, object]:
    summary = {"success": {"value": share, "low": share - 0.1, "high": share + 0.1}}
    return {"task": f"MinTorqueMove-v0/{level}", "policies": [{"policy": policy, "summary": summary}]}


def test_rows_are_levels_and_columns_are_policies() -> None:
    one = {"results": [result(LEVELS[2], "dpct", 0.25), result(LEVELS[0], "agent", 0.5)]}
    again = {"results": [result(LEVELS[0], "agent", 0.75)]}
    lines = list(tables([one, again]))
    assert lines[3] == "| level | | agent | dpct |"
    assert lines[5].endswith("| 75 (65-85) |  |")
    assert lines[6].startswith(f"| `{LEVELS[2]}` |")
    assert lines[6].endswith("|  | 25 (15-35) |")


def test_a_page_without_marks_is_refused() -> None:
    with pytest.raises(ValueError, match="lacks the marks"):
        updated("no marks", [])


def test_the_page_has_levels_of_the_cards_in_their_order() -> None:
    shown = PAGE.read_text(encoding="utf-8").partition(MARKS[0])[2].partition(MARKS[1])[0]
    for env_id in envs.env_ids():
        rows = shown.partition(f"### {env_id}\n")[2].partition("###")[0]
        names = [line.split("`")[1] for line in rows.splitlines() if "`" in line]
        assert len(names) > 2
        assert names == [name for name in envs.task_card(env_id).levels if name in names]
