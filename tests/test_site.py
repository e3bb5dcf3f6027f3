"""The site of docs/: its pages are what the code says, and it builds without a warning."""

from __future__ import annotations

from pathlib import Path

import pytest

from tools.site import environments


@pytest.mark.parametrize("path", environments.pages(), ids=lambda path: path.stem)
def test_the_page_of_an_environment_is_what_its_docstring_card_and_leaderboard_say(path: Path) -> None:
    assert path.read_text(encoding="utf-8") == environments.pages()[path], "run python -m tools.site.environments"
