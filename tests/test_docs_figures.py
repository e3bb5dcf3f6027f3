"""Tables of docs/ are what their commands printed; those of quick commands are printed again."""

from __future__ import annotations

import re

import pytest

import agents
from tools.docs_figures import BLOCKS, ROOT, differences, load, printed, updated, without_times

PAGES = sorted({block.page for block in BLOCKS.values()})
QUICK = ["planarm plan --list", *(name for name in BLOCKS if name.endswith("of planarm paper-dpct"))]


def test_every_table_is_stored_with_its_command_versions_machine_and_date() -> None:
    stored = load()
    assert set(stored) == set(BLOCKS)
    for name, entry in stored.items():
        assert entry["command"] == BLOCKS[name].command
        assert entry["versions"]["planarm"]
        assert entry["machine"]["cpus"] >= 1
        assert re.match(r"\d{4}-\d\d-\d\dT", entry["began"])


@pytest.mark.parametrize("page", PAGES)
def test_the_pages_have_what_the_commands_printed(page: str) -> None:
    assert updated(page) == (ROOT / page).read_text(encoding="utf-8"), "run python -m tools.docs_figures"


@pytest.mark.parametrize("name", BLOCKS)
def test_the_command_of_a_table_is_named_on_its_page(name: str) -> None:
    text = " ".join((ROOT / BLOCKS[name].page).read_text(encoding="utf-8").replace("\\\n", " ").split())
    assert BLOCKS[name].command in text


@pytest.mark.parametrize("name", QUICK)
def test_quick_commands_print_their_tables_again(name: str) -> None:
    assert differences(load()[name]["lines"], printed(name)) == []


def rows(title: str) -> dict[str, list[str]]:
    """The rows of the leaderboard below a title, by policy; ``policy`` is the header."""
    _, _, section = (ROOT / "docs/benchmark/leaderboard.md").read_text(encoding="utf-8").partition(f"### {title}: ")
    table = [line for line in section.split("\n\n")[1].splitlines() if line.startswith("|")]
    return {cells[0]: cells for cells in ([cell.strip() for cell in line.split("|")[1:-1]] for line in table)}


def test_readme_says_who_wins_with_the_numbers_of_the_leaderboard() -> None:
    said = (ROOT / "README.md").read_text(encoding="utf-8").split("<!-- who wins -->")[1].split("<!-- end")[0]
    for task, sentence in re.findall(r"^- \*\*(\w+)\*\*: (.*)$", said, re.M):
        table = rows(f"{task}-v0")
        clauses = sentence.split("; ")
        winner = next(name for name in table if name not in ("policy", "-" * len(name)))
        assert re.findall(r"`(\w+)`", sentence) == [winner, "agent"]
        for clause in clauses:
            policy, *_ = re.findall(r"`(\w+)`", clause)
            cells = [cell.split(" (")[0].split("(")[0].strip() for cell in table[policy]]
            assert [number for number in re.findall(r"\d+(?:\.\d+)?", clause) if number not in cells] == [], clause
    assert said.count("- **") == 4


def test_the_leaderboards_rows_of_quick_policies_come_out() -> None:
    for title, policies in {
        "ConveyorTrack-v0": ["apf", "agent", "follower"],
        "ExcavatorPayload-v0": ["kalman", "adaptive", "agent", "integral_computed_torque"],
    }.items():
        now = str(agents.leaderboard(policies, [title], bound_episodes=0))
        for policy in policies:
            expected = dict(zip(rows(title)["policy"], rows(title)[policy], strict=True))
            header, found = (re.search(rf"^\|{name} *\|.*$", now, re.M) for name in ("policy", policy))
            assert header is not None
            assert found is not None
            cells = [[cell.strip() for cell in match[0].split("|")[1:-1]] for match in (header, found)]
            for column, cell in zip(*cells, strict=True):
                if not column.startswith(("plan", "step", "over best known")):
                    assert cell == expected[column], (title, policy, column)


def test_differences_and_times() -> None:
    before = [
        "|policy|error|step (us)|",
        "|---|---|---|",
        "|dpct|0.1|6.2|",
        "",
        "Medians. Step: of the policy, without",
    ]
    before[-1] += " planning; the environment takes 8.8 us. More"
    shown = ["|policy|error|", "|---|---|", "|dpct|0.1|", "", "Medians. More"]
    assert without_times(before) == shown
    assert differences(shown, ["|policy | error|", "|------|--|", "|dpct   |   0.1|", "", "Medians. More"]) == []
    assert differences(shown, [line.replace("0.1", "0.2") for line in shown]) != []
    assert differences(shown, shown[:-1]) != []
