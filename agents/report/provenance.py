"""The foot of a report: how, when, where and with what its numbers were made."""

from __future__ import annotations

import json
from collections.abc import Sequence

from agents.report.markup import Node, node
from agents.report.results_file import Results


def provenance(files: Sequence[tuple[str, Results]]) -> Node:
    """Command, date, seeds, machine, versions and settings of each file of results."""
    parts = [node("h2", "Where these numbers come from")]
    for name, results in files:
        if len(files) > 1:
            parts.append(node("h3", name))
        parts.append(
            node("dl", *(part for term, text in _facts(results) for part in (node("dt", term), node("dd", text))))
        )
        settings = json.dumps(results.config, indent=1, sort_keys=True, ensure_ascii=False)
        parts.append(node("details", node("summary", "Settings of the benchmark"), node("pre", settings)))
    return node("footer", *parts)


def _facts(results: Results) -> list[tuple[str, str | Node]]:
    machine = results.machine
    place = ", ".join(str(machine[key]) for key in ("system", "processor", "cpu") if machine.get(key))
    if machine.get("cpus"):
        place += f", {machine['cpus']} processors"
    versions = ", ".join(f"{name} {version}" for name, version in results.versions.items())
    seeds = "; ".join(f"{task.task}: {_range(task.seeds)}" for task in results.results)
    facts: list[tuple[str, str | Node]] = [
        ("Command", node("code", results.command or "not recorded")),
        ("Date", results.started.replace("T", " ") or "not recorded"),
        ("Seeds", seeds),
        ("Replays", "; ".join(_recorded(results)) or "none recorded"),
        ("Machine", place or "not recorded"),
        ("Versions", versions or "not recorded"),
    ]
    return facts


def _recorded(results: Results) -> list[str]:
    return [f"{task.task}: seeds {', '.join(map(str, task.replays.seeds))}" for task in results.results if task.replays]


def _range(seeds: Sequence[int]) -> str:
    """Seeds in few words."""
    whole = list(seeds) == list(range(seeds[0], seeds[0] + len(seeds)))
    return f"{seeds[0]} to {seeds[-1]}" if whole and len(seeds) > 1 else ", ".join(map(str, seeds))
