"""The scores of several policies on one or more tasks: tables, comparisons in pairs, JSON."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any

from rich.console import Console

from agents.evaluation.compare import Pair, as_documents, compare_all, comparison
from agents.evaluation.leaderboard import TaskResult, as_document, leaderboard
from agents.evaluation.results import Evaluation
from agents.policies.lookup import NamedPolicy
from agents.provenance import machine, versions
from agents.tables import Table
from planners.files import write_json


@dataclass
class Scoreboard:
    """Results task by task; ``str`` of it are its tables in Markdown.

    Attributes:
        results: what is finished.
        complete: whether that is all.
        config: what was asked for, for the JSON.
    """

    results: list[TaskResult] = field(default_factory=list)
    complete: bool = False
    config: Mapping[str, Any] = field(default_factory=dict)

    @property
    def evaluations(self) -> list[Evaluation]:
        """The results of each policy, episode by episode."""
        return [evaluation for result in self.results for evaluation in result.evaluations]

    @property
    def pairs(self) -> list[Pair]:
        """The differences between policies on the same episodes."""
        return [pair for result in self.results for pair in pairs_of(result)]

    @property
    def tables(self) -> list[Table]:
        """The leaderboard of each task, and the table of its pairs if it has any."""
        tables = []
        for result in self.results:
            if result.evaluations:
                tables.append(leaderboard(result))
            if pairs := pairs_of(result):
                tables.append(comparison(result.task.env, pairs))
        return tables

    def show(
        self,
        console: Console | None = None,
        *,
        markdown: bool = False,
        wide: bool = False,
        explained: set[str] | None = None,
    ) -> None:
        """Print the tables, as `Table.show`, each legend once."""
        explained = set() if explained is None else explained
        for table in self.tables:
            table.show(console, markdown=markdown, wide=wide, explained=explained)

    def csv(self) -> str:
        """Every number in SI units with its interval, one a line: of a policy, or of a difference to another."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(("task", "policy", "against", "number", "value", "low", "high"))
        for result in self.results:
            for each in result.ranked:
                for name, estimate in result.summarise(each).items():
                    writer.writerow((result.task.title, each.policy, "", name, *vars(estimate).values()))
                for name in ("planning_ms", "policy_us"):
                    writer.writerow((result.task.title, each.policy, "", name, getattr(each.timing, name), "", ""))
            for pair in pairs_of(result):
                for name in ("success", "metric", "returns", "improvement"):
                    if (estimate := getattr(pair, name)) is not None:
                        writer.writerow((result.task.title, pair.policy, pair.against, name, *vars(estimate).values()))
        return text.getvalue()

    def document(self) -> dict[str, Any]:
        """Everything, for JSON."""
        return {
            "complete": self.complete,
            "versions": versions(),
            "machine": machine(),
            "config": self.config,
            "results": [{**as_document(result), "pairs": as_documents(pairs_of(result))} for result in self.results],
        }

    def to_json(self, path: str | PathLike[str]) -> None:
        """Write every episode, with versions and seeds, to a file; infinite numbers are null."""
        write_json(Path(path), self.document())

    def __str__(self) -> str:
        text = io.StringIO()
        self.show(Console(file=text, force_terminal=False))
        return text.getvalue()


def add_settings(result: TaskResult, named: NamedPolicy) -> None:
    """Record in the results of a task the settings that a policy brings, and what is assumed about it."""
    result.sources[named.name] = named.source
    if named.action_config:
        result.action_configs[named.name] = named.action_config
    if assumption := named.assumption(result.task.env, result.task.env_config):
        result.assumptions.append(assumption)


def pairs_of(result: TaskResult) -> list[Pair]:
    """The comparisons in pairs of a task, of what is finished."""
    return compare_all(result.evaluations, result.compared)
