"""What tools write between marks of a page."""

from __future__ import annotations

import pytest

from tools.site.marks import marked, replaced

TEXT = "before\n<!-- table -->\nold\n<!-- end of table -->\nafter\n"


def test_lines_between_the_marks_are_replaced_and_nothing_else() -> None:
    assert marked(TEXT, "table") == "old\n"
    assert replaced(TEXT, "table", "\nnew\nlines\n") == TEXT.replace("old", "new\nlines")


@pytest.mark.parametrize("text", ["no marks", TEXT + TEXT, TEXT.replace("end of ", "")])
def test_a_page_without_the_marks_or_with_two_pairs_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="lacks the marks <!-- table --> and <!-- end of table -->"):
        replaced(text, "table", "new")
