"""The tables of docs/benchmark/levels.md, from what ``planarm benchmark --config levels --json FILE`` has written.

    python -m tools.levels_table FILE...

stores the shares of success in ``tools/data/levels.json``, in place of those of the same levels, and writes the tables;
without a file it writes the tables only. The levels of a task are in the order of what its best planner reaches, then
the second best, and so on, and then of the share of episodes that anything solves.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro

import envs
from agents.evaluation.benchmark_config import configure
from agents.policies.lookup import is_shipped
from planners.files import write_json, write_text
from tools.site.marks import replaced

STORED = Path(__file__).parent / "data" / "levels.json"
PAGE = Path(__file__).parent.parent / "docs" / "benchmark" / "levels.md"
MARK = "levels"

Scores = Mapping[str, Mapping[str, Any]]
"""Of each level by its title: ``versions``, ``known``, the share of episodes that a policy or the search for the best
known motion solves, and for each policy ``success`` with its interval and ``mode``."""


@dataclass(frozen=True)
class LevelsOptions:
    """Store shares of success, and write the tables of the levels to their page."""

    files: tyro.conf.Positional[tuple[Path, ...]] = ()
    """What planarm benchmark --config levels --json has written; a level counts where it is last."""


def load() -> dict[str, Any]:
    """What is stored."""
    stored: dict[str, Any] = json.loads(STORED.read_text(encoding="utf-8")) if STORED.exists() else {}
    return stored


def scores(document: Mapping[str, Any]) -> dict[str, Any]:
    """What is stored of the results of a benchmark: shares of success, and the control mode where it is no default."""
    return {
        result["task"]: {
            "versions": document["versions"],
            "known": _solved(result),
            "policies": {
                each["policy"]: {
                    "success": each["summary"]["success"],
                    "mode": each["action_config"].get("control_mode", ""),
                }
                for each in result["policies"]
            },
        }
        for result in document["results"]
    }


def _solved(result: Mapping[str, Any]) -> float:
    """Share of the episodes that one of the policies solves, or of which a best known motion was found."""
    solved = np.any([each["episodes"]["is_success"] for each in result["policies"]], axis=0)
    for name, values in (result["bound"] or {}).items():
        if name != "seeds":
            solved[: len(values)] |= np.isfinite([math.inf if value is None else value for value in values])
    return float(solved.mean())


def tables(stored: Scores) -> Iterator[str]:
    """Lines of a Markdown table for each task: levels by policies."""
    for env_id in envs.env_ids():
        levels = envs.task_card(env_id).levels
        rows = {name: stored[f"{env_id}/{name}"]["policies"] for name in levels if f"{env_id}/{name}" in stored}
        if not rows:
            continue
        policies = [policy for policy in _policies(env_id) if any(policy in row for row in rows.values())]
        modes = {policy: {row[policy]["mode"] for row in rows.values() if policy in row} for policy in policies}
        heads = [f"{policy} ({mode})" if (mode := _only(modes[policy])) else policy for policy in policies]
        yield from ("", f"### {env_id}", "", f"| level | | {' | '.join(heads)} | best known |")
        yield "|---" * (3 + len(policies)) + "|"
        known = {name: stored[f"{env_id}/{name}"]["known"] for name in rows}
        for name in sorted(rows, key=lambda name: (*_reached(rows[name]), known[name]), reverse=True):
            cells = [_cell(rows[name].get(policy), _only(modes[policy])) for policy in policies]
            yield f"| `{name}` | {levels[name].meaning} | {' | '.join(cells)} | {100.0 * known[name]:.0f} |"


def _policies(env_id: str) -> list[str]:
    """Policies that the configuration has on the levels of a task, agents first."""
    config = configure("levels", {})
    names = dict.fromkeys(
        policy for task in config.tasks if task.env == env_id for policy in task.policies or config.policies
    )
    return sorted(names, key=lambda name: not is_shipped(name))


def _only(modes: set[str]) -> str:
    """The control mode that a policy has on every level; empty if it has none, or several."""
    return next(iter(modes)) if len(modes) == 1 else ""


def _reached(row: Mapping[str, Any]) -> list[float]:
    """Shares of success of the planners at a level, the best first."""
    return sorted((each["success"]["value"] for name, each in row.items() if not is_shipped(name)), reverse=True)


def _cell(scored: Mapping[str, Any] | None, usual: str) -> str:
    """A share of successes in percent, with its interval, and the control mode if it is not the usual one."""
    if scored is None:
        return ""
    share, low, high = (f"{100.0 * scored['success'][name]:.0f}" for name in ("value", "low", "high"))
    return f"{share} ({low}-{high})" + (f", {scored['mode']}" if scored["mode"] != usual else "")


def main(options: LevelsOptions) -> int:
    """Read, store, and write the page; the exit code."""
    stored = load()
    for path in options.files:
        stored |= scores(json.loads(path.read_text(encoding="utf-8")))
    known = [f"{env_id}/{name}" for env_id in envs.env_ids() for name in envs.task_card(env_id).levels]
    write_json(STORED, {title: stored[title] for title in known if title in stored})
    write_text(PAGE, replaced(PAGE.read_text(encoding="utf-8"), MARK, "\n".join(tables(load()))))
    return 0


if __name__ == "__main__":
    raise SystemExit(main(tyro.cli(LevelsOptions)))
