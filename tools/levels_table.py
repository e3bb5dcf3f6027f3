"""The tables of docs/benchmark/levels.md, from what ``planarm benchmark --config levels --json FILE`` has written.

    python -m tools.levels_table FILE...

The levels of a task are in the order of its card; a share of successes has its 95 % interval.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

import envs
from planners.files import write_text

PAGE = Path(__file__).parent.parent / "docs" / "benchmark" / "levels.md"
MARKS = "<!-- levels -->\n", "<!-- end of levels -->"


@dataclass(frozen=True)
class LevelsOptions:
    """Write the tables of the levels to their page."""

    files: tyro.conf.Positional[tuple[Path, ...]]
    """What planarm benchmark --config levels --json has written; a task counts where it is last."""


def tables(documents: list[dict[str, Any]]) -> Iterator[str]:
    """Lines of a Markdown table for each task: levels by policies."""
    results = {result["task"]: result for document in documents for result in document["results"]}
    for env_id in envs.env_ids():
        rows = {name: results.get(f"{env_id}/{name}") for name in envs.task_card(env_id).levels}
        scored = {name: result for name, result in rows.items() if result is not None}
        if not scored:
            continue
        policies = list(dict.fromkeys(each["policy"] for result in scored.values() for each in result["policies"]))
        yield from (
            "",
            f"### {env_id}",
            "",
            f"| level | | {' | '.join(policies)} |",
            "|---" * (2 + len(policies)) + "|",
        )
        for name, result in scored.items():
            shares = {each["policy"]: each["summary"]["success"] for each in result["policies"]}
            cells = [_share(shares[policy]) if policy in shares else "" for policy in policies]
            yield f"| `{name}` | {envs.task_card(env_id).levels[name].meaning} | {' | '.join(cells)} |"


def _share(estimate: dict[str, float]) -> str:
    """A share of successes in percent, with its interval."""
    return f"{100.0 * estimate['value']:.0f} ({100.0 * estimate['low']:.0f}-{100.0 * estimate['high']:.0f})"


def updated(text: str, documents: list[dict[str, Any]]) -> str:
    """The page with the tables between its marks; a ValueError if it has none."""
    before, begin, rest = text.partition(MARKS[0])
    _, end, after = rest.partition(MARKS[1])
    if not (begin and end):
        raise ValueError(f"{PAGE} lacks the marks {' and '.join(mark.strip() for mark in MARKS)}")
    return before + begin + "\n".join(tables(documents)).strip() + "\n" + end + after


def main(options: LevelsOptions) -> int:
    """Read, and write the page; the exit code."""
    documents = [json.loads(path.read_text(encoding="utf-8")) for path in options.files]
    write_text(PAGE, updated(PAGE.read_text(encoding="utf-8"), documents))
    return 0


if __name__ == "__main__":
    raise SystemExit(main(tyro.cli(LevelsOptions)))
