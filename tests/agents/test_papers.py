"""What the commands that regenerate a paper's results share: files, tables, facts and figures."""

from __future__ import annotations

import re
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import pytest
from paper_results import Regenerate

from agents.cli import COMMANDS
from agents.papers.apf import figures as apf_figures
from agents.papers.dpct import figures as dpct_figures
from agents.papers.excavator.figures import figures as excavator_figures
from agents.papers.excavator.runs import Trial
from agents.papers.lagrange import figures as lagrange_figures
from agents.papers.report import Fact, Part, Parts, Report, ReportOptions, publish, tabulate, whole_sheet

RECORDS = {
    "paper-dpct": ["plans", "start_clocks", "figures", "table_1", "belts", "facts"],
    "paper-lagrange": ["published", "searches", "moves", "figures", "nodes", "readings", "facts"],
    "paper-apf": ["scenes", "clearances", "random", "norms", "facts"],
    "paper-excavator": ["payloads", "rough", "facts"],
}
TABLES = {"paper-dpct": 5, "paper-lagrange": 6, "paper-apf": 3, "paper-excavator": 6}
FACTS = {"paper-dpct": 2, "paper-lagrange": 6, "paper-apf": 7, "paper-excavator": 8}
FIGURES = [
    dpct_figures.figures,
    lagrange_figures.figures,
    apf_figures.figures,
    lambda: excavator_figures(Trial(), [0.0]),
]
NUMBER = re.compile(r"\d*\.?\d+(?:e-\d+)?")
every_paper = pytest.mark.parametrize("command", RECORDS)


def small_report(facts: list[Fact]) -> Report:
    squares = [{"side": 1.0}, {"side": 2.0}]
    table = tabulate("Squares", squares, {"side": "{side:g}", "area": lambda one: f"{one['side'] ** 2:g}"})
    return Report("squares", [table], facts, {"squares": squares}, small_figures)


def small_figures() -> Parts:
    return {f"figure_{number}": Part(lambda sheet: sheet.subplots().plot([0, 1]), 2.0, 1.0) for number in (1, 2)}


def test_every_paper_has_a_command() -> None:
    assert set(RECORDS) == {name for name in COMMANDS if name.startswith("paper-")}
    commands = [COMMANDS[name] for name in RECORDS]
    assert all(issubclass(getattr(import_module(one.module), one.options), ReportOptions) for one in commands)


@every_paper
def test_the_files_are_written_and_no_draft_is_left(regenerate: Regenerate, command: str) -> None:
    results = regenerate(command)
    assert sorted(path.name for path in results.folder.iterdir()) == ["figures.png", "results.json"]
    assert (results.folder / "figures.png").read_bytes().startswith(b"\x89PNG")
    assert list(results.document) == RECORDS[command]
    assert all(results.document.values())
    assert len(results.document.get("facts", [])) == FACTS[command]


@every_paper
def test_tables_and_facts_are_printed_as_markdown(regenerate: Regenerate, command: str) -> None:
    results = regenerate(command)
    assert results.printed.count("### ") == TABLES[command]
    for fact in results.document.get("facts", []):
        assert f"\n- {fact['statement']}\n" in results.printed
        assert fact["values"]


@pytest.mark.parametrize("paper", ["dpct", "lagrange", "apf"])
def test_the_page_of_a_paper_says_what_its_facts_say(regenerate: Regenerate, paper: str) -> None:
    page = (Path(__file__).parents[2] / "docs" / "papers" / f"{paper}.md").read_text().replace(",000", "000")
    said = set(map(float, NUMBER.findall(page)))
    for fact in regenerate(f"paper-{paper}").document["facts"]:
        if "sample takes" not in fact["statement"]:  # a measured time
            assert [number for number in NUMBER.findall(fact["statement"]) if float(number) not in said] == []


@pytest.mark.usefixtures("without_matplotlib")
@pytest.mark.parametrize("figures", FIGURES)
def test_figures_without_matplotlib_say_what_to_install(figures: Callable[[], Parts]) -> None:
    with pytest.raises(ModuleNotFoundError, match=r"planarm\[viz\]"):
        whole_sheet(figures())


def test_each_figure_goes_to_a_file_of_its_own(tmp_path: Path) -> None:
    publish(small_report([]), ReportOptions(figures=tmp_path / "new"))
    names = ["paper_squares_figure_1.png", "paper_squares_figure_2.png"]
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == names


@pytest.mark.parametrize(("suffix", "magic"), [(".png", b"\x89PNG"), (".pdf", b"%PDF"), (".svg", b"<?xml")])
def test_the_suffix_decides_the_format_of_the_figures(tmp_path: Path, suffix: str, magic: bytes) -> None:
    publish(small_report([]), ReportOptions(plot=tmp_path / f"figures{suffix}", dpi=20))
    assert (tmp_path / f"figures{suffix}").read_bytes().startswith(magic)


def test_a_figure_is_drawn_only_if_asked_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    report = small_report([Fact("The second is larger.", {"ratio": 4.0})])
    publish(
        Report("squares", report.tables, report.facts, report.records, lambda: pytest.fail("drawn")),
        ReportOptions(json=tmp_path / "results.json"),
    )
    printed = capsys.readouterr().out
    assert "|2   |   4|" in printed
    assert printed.endswith("- The second is larger.\n")
