"""docs/extend/arms.md: what it says runs, its keys are those that are read, its presets are all there are."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from pages import follow

from planners.robot.arm_files import KEYS, LIMIT_KEYS
from tools.arm_table import PAGE, page


@pytest.mark.docs
def test_the_page_runs_in_a_readers_folder(tmp_path: Path) -> None:
    reach, ratios, _, same = follow("extend/arms.md", tmp_path).strip().splitlines()
    assert reach.startswith("0.73 ")
    assert "'torque': 0" in ratios
    assert same == "True"


def test_the_page_describes_every_key() -> None:
    keys = set(re.findall(r"`(\w+)`", "".join(re.findall(r"^\| `.*? \|", PAGE.read_text(), re.M))))
    assert {*KEYS, *LIMIT_KEYS, "name", "source", "limits"} <= keys


def test_the_table_of_presets_is_that_of_the_files() -> None:
    """``python -m tools.arm_table`` writes it."""
    assert PAGE.read_text() == page()
