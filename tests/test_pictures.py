"""Every picture of the site has a command that draws it, named on a page, and is used."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.pages import ROOT, pages
from tools.site.pictures import LONG, PICTURES, PicturesOptions, listed, main, table

STORED = sorted((ROOT / "docs" / "pictures").iterdir())


@pytest.mark.parametrize("picture", STORED, ids=lambda path: path.name)
def test_a_stored_picture_has_a_command_and_is_shown(picture: Path) -> None:
    assert listed(picture)
    shown = re.compile(rf"!\[[^\]]*\]\([./\w]*pictures/{re.escape(picture.name)}\)")
    assert any(shown.search((ROOT / page).read_text()) for page in pages())
    if picture.name.startswith("paper_"):
        assert picture.stat().st_size < 60_000


def test_every_command_draws_a_stored_picture() -> None:
    assert [name for name in (*PICTURES, *LONG) if not any(path.match(name) for path in STORED)] == []


def test_the_page_of_pictures_has_the_table() -> None:
    assert table() in (ROOT / "docs" / "pictures.md").read_text(), "run python -m tools.site.pictures --table"


def test_an_unknown_picture_is_refused() -> None:
    with pytest.raises(SystemExit, match=r"must be one of conveyor_track\.gif"):
        main(PicturesOptions(names=("conveyor.gif",)))


@pytest.mark.parametrize("page", sorted(path.name for path in (ROOT / "docs" / "papers").glob("*.md")))
def test_numbers_below_a_papers_figure_are_in_the_tables_that_its_command_prints(page: str) -> None:
    text = (ROOT / "docs" / "papers" / page).read_text()
    printed = "".join(table for _, table in re.findall(r"<!-- (.+?) -->\n(.*?)<!-- end of \1 -->", text, re.S))
    known = {float(number) for number in re.findall(r"\d*\.\d+", printed)}
    for line in re.findall(r"^!\[[^\n]*\n\n(Figure.*?)\n\n", text, re.M | re.S):
        assert [number for number in re.findall(r"\d*\.\d+", line) if float(number) not in known] == [], line
