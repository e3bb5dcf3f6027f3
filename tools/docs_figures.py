"""The tables of docs/ that commands print, between marks such as ``<!-- leaderboard -->``.

``python -m tools.docs_figures NAME...`` runs the commands of some tables, stores what they print in
``tools/data/docs_figures.json`` with versions, machine and date, and writes it to the pages. Without names it writes
the stored tables to the pages. ``--check`` runs the commands and compares instead.
"""

from __future__ import annotations

import io
import json
import re
import shlex
from contextlib import redirect_stdout
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from time import perf_counter
from typing import Annotated, Any

import tyro

from agents.cli import main as planarm
from agents.console import note
from agents.provenance import machine, versions
from planners.files import write_json, write_text
from tools.site.marks import marked, replaced

ROOT = Path(__file__).parent.parent
STORED = Path(__file__).parent / "data" / "docs_figures.json"
TIMES = ("plan (ms)", "step (us)")
"""Columns of times, which differ from run to run and are left out."""
_STEP = re.compile(r" Step: of the policy, without planning; the environment takes [\d.]+ us\.")


@dataclass(frozen=True)
class Block:
    """A table of a page, and the command that prints it."""

    page: str
    command: str
    part: int | None = None  # which of its tables, from 0, without the heading; if None, all that it prints
    times: bool = False  # whether the page shows measured times too: those of idle cores, which are put in by hand


BLOCKS = {
    "leaderboard": Block("docs/benchmark/leaderboard.md", "planarm benchmark --full", times=True),
    "dodge leaderboard": Block(
        "docs/planners/experts.md", "planarm benchmark --tasks ObstacleDodge-v0 --episodes 1000 --bound-episodes 0"
    ),
    "planarm paper-excavator": Block("docs/papers/excavator.md", "planarm paper-excavator"),
    "excavator leaderboard": Block(
        "docs/papers/excavator.md", "planarm benchmark --tasks ExcavatorPayload-v0 --episodes 200"
    ),
    "excavator level 2": Block(
        "docs/papers/excavator.md",
        "planarm evaluate kalman --env ExcavatorPayload-v0 --episodes 200 --settings level=2 --against "
        "adaptive integral_computed_torque computed_torque adaptive_computed_torque agent",
    ),
    "planarm plan --list": Block("docs/planners/index.md", "planarm plan --list", 0),
    "plans of planarm paper-dpct": Block("docs/papers/dpct.md", "planarm paper-dpct", 0),
    "starts of planarm paper-dpct": Block("docs/papers/dpct.md", "planarm paper-dpct", 1),
    "figures of planarm paper-dpct": Block("docs/papers/dpct.md", "planarm paper-dpct", 2),
    "table 1 of planarm paper-dpct": Block("docs/papers/dpct.md", "planarm paper-dpct", 3),
    "belts of planarm paper-dpct": Block("docs/papers/dpct.md", "planarm paper-dpct", 4),
    "published by planarm paper-lagrange": Block("docs/papers/lagrange.md", "planarm paper-lagrange", 0),
    "searches of planarm paper-lagrange": Block("docs/papers/lagrange.md", "planarm paper-lagrange", 1),
    "moves of planarm paper-lagrange": Block("docs/papers/lagrange.md", "planarm paper-lagrange", 2),
    "figures of planarm paper-lagrange": Block("docs/papers/lagrange.md", "planarm paper-lagrange", 3),
    "nodes of planarm paper-lagrange": Block("docs/papers/lagrange.md", "planarm paper-lagrange", 4),
    "readings of planarm paper-lagrange": Block("docs/papers/lagrange.md", "planarm paper-lagrange", 5),
    "scenes of planarm paper-apf": Block("docs/papers/apf.md", "planarm paper-apf", 0),
    "random moves of planarm paper-apf": Block("docs/papers/apf.md", "planarm paper-apf", 1),
    "norms of planarm paper-apf": Block("docs/papers/apf.md", "planarm paper-apf", 2),
}


@dataclass(frozen=True)
class FiguresOptions:
    """Write the tables of the docs; with names, run their commands first."""

    names: tyro.conf.Positional[tuple[str, ...]] = ()
    """Marks of tables whose commands to run."""
    check: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Compare what the commands of these tables, or of all, print with what is stored."""


def main(options: FiguresOptions) -> int:
    """Run, store and write, or compare; the exit code."""
    stored = load()
    if options.check:
        names = options.names or tuple(BLOCKS)
        complaints = [f"{name}: {line}" for name in names for line in differences(stored[name]["lines"], printed(name))]
        for complaint in complaints:
            note(complaint)
        return 1 if complaints else 0
    for name in options.names:
        began, start = datetime.now(UTC), perf_counter()
        lines = printed(name)
        stored[name] = {
            "command": BLOCKS[name].command,
            "began": began.isoformat("T", "seconds"),
            "seconds": round(perf_counter() - start),
            "versions": versions(),
            "machine": machine(),
            "lines": lines,
        }
    write_json(STORED, {name: stored[name] for name in BLOCKS if name in stored})
    for page in sorted({block.page for block in BLOCKS.values()}):
        write_text(ROOT / page, updated(page))
    return 0


def load() -> dict[str, Any]:
    """What the commands have printed, by the name of the table, with its origin."""
    stored: dict[str, Any] = json.loads(STORED.read_text(encoding="utf-8")) if STORED.exists() else {}
    return stored


def printed(name: str) -> list[str]:
    """The lines that the command of a table prints for it."""
    text, part = _output(BLOCKS[name].command), BLOCKS[name].part
    if part is not None:
        _, _, text = text.split("### ")[1 + part].partition("\n")
        text = text.partition("\n- ")[0]  # facts behind the tables
    plain = re.sub(r"[ \t]+$", "", text.strip(), flags=re.MULTILINE)
    return without_times(re.sub(r"\n{3,}", "\n\n", plain).splitlines())


@cache
def _output(command: str) -> str:
    """What a command prints."""
    with redirect_stdout(io.StringIO()) as output:
        code = planarm(shlex.split(command)[1:])
    if code != 0:
        raise RuntimeError(f"{command} ended with {code}")
    return output.getvalue()


def updated(page: str) -> str:
    """A page with the stored tables; a ValueError if it lacks the marks of one, or shows other figures beside times."""
    text = (ROOT / page).read_text(encoding="utf-8")
    for name, entry in load().items():
        if BLOCKS[name].page != page:
            continue
        if not BLOCKS[name].times:
            text = replaced(text, name, "\n".join(entry["lines"]))
        elif complaints := differences(entry["lines"], without_times(marked(text, name).strip().splitlines())):
            raise ValueError(f"{page}, {name}: {'; '.join(complaints)}")
    return text


def differences(stored: list[str], now: list[str]) -> list[str]:
    """A line for each line of two that differ, apart from the widths of columns."""
    pairs = zip(map(_plain, stored), map(_plain, now), strict=False)
    found = [f"was {before!r}, is {after!r}" for before, after in pairs if before != after]
    return [*found, f"{len(stored)} lines, now {len(now)}"] if len(stored) != len(now) else found


def without_times(lines: list[str]) -> list[str]:
    """Tables without what is measured anew in every run: times of the policies and of the environment."""
    left, timed = [], set[int]()
    for line in lines:
        cells = line.split("|")
        if not line.startswith("|"):
            timed = set()
            left.append(_STEP.sub("", line))
            continue
        timed |= {place for place, cell in enumerate(cells) if cell.strip() in TIMES}
        left.append("|".join(cell for place, cell in enumerate(cells) if place not in timed))
    return left


def _plain(line: str) -> str:
    """A line without the spaces and dashes that make a table's columns wide."""
    return re.sub(r"-{2,}", "--", re.sub(r" *\| *", "|", line))


if __name__ == "__main__":
    raise SystemExit(main(tyro.cli(FiguresOptions)))
