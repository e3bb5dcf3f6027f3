"""Tables, lines and progress as commands print them."""

from __future__ import annotations

import io
import math

import pytest
from rich.console import Console

from agents.console import note, progress_bar, say
from agents.evaluation.statistics import Estimate
from agents.tables import Table, interval_text, number_text, percent_text, share_text, short_text

TABLE = Table("A title", ("a policy", "success rate (%)"), [("[x]", "1.0"), ("y" * 300, "<0.001")], "A caption.")


def printed(table: Table, *, terminal: bool, width: int = 80) -> str:
    file = io.StringIO()
    table.show(Console(file=file, width=width, force_terminal=terminal, color_system=None))
    return file.getvalue()


def test_markdown_in_a_file() -> None:
    lines = [line.rstrip() for line in printed(TABLE, terminal=False).splitlines()]
    assert lines[0] == "### A title"
    assert lines[2].replace(" ", "") == "|apolicy|successrate(%)|"
    assert set(lines[3]) == {"|", "-"}
    assert [cell.strip() for cell in lines[4].split("|")[1:-1]] == ["[x]", "1.0"]
    assert lines[4].endswith(" 1.0|")  # numbers are aligned to the right
    assert "y" * 300 in lines[5]
    assert lines[6:] == ["", "A caption.", ""]
    assert str(TABLE) == "\n".join(lines).strip() + "\n"


def test_a_terminal_shows_every_cell_within_its_width() -> None:
    text = printed(TABLE, terminal=True)
    assert max(map(len, text.splitlines())) <= 80
    assert "…" not in text
    assert text.count("y") > 300
    assert "[x]" in text
    assert "A caption." in text


def test_a_legend_stands_above_the_caption_of_the_first_table_that_has_it() -> None:
    one, two = (Table(title, ("a",), [("x",)], f"Of {title}.", legend="All.") for title in ("one", "two"))
    file, explained = io.StringIO(), set[str]()
    for table in (one, two, Table("", ("a",), [("x",)], legend="Other.")):
        table.show(Console(file=file), explained=explained)
    captions = [line for line in file.getvalue().splitlines() if line.endswith(".")]
    assert captions == ["All. Of one.", "Of two.", "Other."]
    assert "All. Of two." in str(two)


def test_without_title_and_caption_there_is_the_table_alone() -> None:
    lines = printed(Table("", ("a", "b"), [("x", "1")]), terminal=False).split("\n")
    assert [line for line in lines if line.strip()] == ["|a|b|", "|-|-|", "|x|1|"]


def test_a_terminal_shows_the_foremost_columns_that_fit() -> None:
    table = Table(
        "",
        ("name", "one", "two", "three"),
        [("n", "1" * 20, "2" * 20, "3" * 20)],
        "All.",
        foremost=("three",),
        brief="Some.",
    )
    narrow = printed(table, terminal=True, width=50)
    assert "3" * 20 in narrow
    assert "1" * 20 in narrow  # after the foremost ones in their order
    assert "2" * 20 not in narrow
    assert "Some. Not shown: two (--wide)." in narrow
    assert max(map(len, narrow.splitlines())) <= 50
    least = printed(table, terminal=True, width=10)
    assert least.count("3") >= 20  # one column at least, although it is folded
    whole = printed(table, terminal=True, width=80)
    assert "2" * 20 in whole
    assert "Not shown" not in whole
    assert "2" * 20 in printed(table, terminal=False, width=10)
    file = io.StringIO()
    table.show(Console(file=file, width=80, force_terminal=True, color_system=None), markdown=True)
    assert "|name|" in file.getvalue()
    assert "All." in file.getvalue()


@pytest.mark.parametrize(
    ("value", "text"),
    [(1.0, "1.000"), (-9.9994, "-9.999"), (12.34, "12.3"), (1e-5, "<0.001"), (0.0, "0.000"), (math.inf, "never")],
)
def test_numbers(value: float, text: str) -> None:
    assert number_text(value) == text


def test_shares_and_intervals() -> None:
    assert (percent_text(1.0), percent_text(0.123), short_text(73.0)) == ("100", "12.3", "73")
    assert share_text(Estimate(0.5, 0.25, 0.755)) == "50 (25-75.5)"
    assert interval_text(Estimate(1.0, 0.5, math.inf)) == "1.000 (0.500 to never)"
    assert interval_text(Estimate(1.0, math.nan, math.nan), lambda value: f"{value:g}") == "1"


def test_lines_are_not_broken_in_a_pipe(capsys: pytest.CaptureFixture[str]) -> None:
    say("a " * 200)
    note("[b] " * 100)
    captured = capsys.readouterr()
    assert captured.out.splitlines() == ["a " * 200]
    assert captured.err.splitlines() == ["[b] " * 100]
    with progress_bar("episodes") as bar:
        bar.advance(bar.add_task("running", total=3))
    assert capsys.readouterr().err == ""  # no terminal, no bar
