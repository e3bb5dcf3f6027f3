"""Learnt policies beside every planner on held-out seeds: shares of success, and their differences in pairs.

    python -m tools.site.held_out ObstacleDodge-v0/uncertain --policies agent apf

scores policies on a task of ``configs/held_out.yaml``, stores one bit an episode in ``tools/data/held_out.json``, and
writes the tables to ``docs/agents/harder.md``; without a task it writes the tables only. The bits are those of
``planarm benchmark --config held_out``. A run that is stopped goes on from there;
policies whose behaviour has changed are scored again after their entry has been deleted from the file.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import tyro
from numpy.typing import NDArray
from pydantic import BaseModel

from agents.console import note
from agents.evaluation import statistics
from agents.evaluation.benchmark_config import BenchmarkTask, configure
from agents.evaluation.evaluate import evaluate
from agents.evaluation.statistics import Estimate
from agents.policies.agent import Agent
from agents.policies.lookup import find_policy, is_shipped
from agents.provenance import versions
from planners.files import write_json, write_text
from tools.site.marks import replaced

STORED = Path(__file__).parent.parent / "data" / "held_out.json"
PAGE = Path(__file__).parent.parent.parent / "docs" / "agents" / "harder.md"
MARK = "held out"
CONFIG = configure("held_out", {})
PART = 250
"""Episodes between two writes of the file."""

Bits = NDArray[np.bool_]


class Scored(BaseModel):
    """A policy's successes on the first held-out seeds.

    Attributes:
        began: when the first episode was run.
        versions: of Python and its packages.
        weights: SHA-256 of the agent's weights; empty for a planner.
        episodes: number of episodes.
        successes: a bit an episode, in hexadecimal.
    """

    began: str
    versions: dict[str, str]
    weights: str
    episodes: int
    successes: str

    @property
    def bits(self) -> Bits:
        """Whether each episode ended in success, ``(episodes,)``."""
        packed = np.frombuffer(bytes.fromhex(self.successes), dtype=np.uint8)
        return np.unpackbits(packed, count=self.episodes).astype(bool)

    def with_more(self, bits: Bits) -> Scored:
        """These successes with those of further episodes."""
        joined = np.concatenate([self.bits, bits])
        update = {"episodes": len(joined), "successes": np.packbits(joined).tobytes().hex()}
        return self.model_copy(update=update)


Scores = dict[str, dict[str, Scored]]
"""By title of the task and name of the policy."""


class HeldOutOptions(BaseModel):
    """Score policies on held-out seeds, and write the tables."""

    task: tyro.conf.Positional[str | None] = None
    """Title of a task of the configuration held_out."""
    policies: tuple[str, ...] = ()
    """Policies to score; all of the task if left out."""


def load() -> Scores:
    """What is stored."""
    document = json.loads(STORED.read_text(encoding="utf-8")) if STORED.exists() else {}
    return {task: {name: Scored(**entry) for name, entry in scored.items()} for task, scored in document.items()}


def weights_of(policy: str, env_id: str) -> str:
    """SHA-256 of the weights of a shipped agent; empty for a planner."""
    found = find_policy(policy, env_id).policy
    return str(found.document["sha256"]) if isinstance(found, Agent) else ""


def successes(task: BenchmarkTask, policy: str, first: int, episodes: int) -> Bits:
    """Whether a policy succeeds in each of some episodes of a task."""
    seeds = CONFIG.seed + np.arange(first, first + episodes)
    return evaluate(
        policy, task.env, seeds, env_config=task.env_config, options=task.options, num_envs=CONFIG.num_envs
    ).success


def score_part(task: BenchmarkTask, policy: str) -> bool:
    """Score a policy on some of the episodes that it has not met, and store them; whether any are left."""
    kept, weights = load().get(task.title, {}).get(policy), weights_of(policy, task.env)
    if kept is None or kept.weights != weights:
        began = datetime.now(UTC).isoformat("T", "seconds")
        kept = Scored(began=began, versions=versions(), weights=weights, episodes=0, successes="")
    total = task.episodes or CONFIG.episodes
    if kept.episodes < total:
        kept = kept.with_more(successes(task, policy, kept.episodes, min(PART, total - kept.episodes)))
        store(task.title, policy, kept)
        note(f"{task.title}, {policy}: {kept.bits.mean():.1%} of {kept.episodes} episodes")
    return kept.episodes < total


def store(title: str, policy: str, scored: Scored) -> None:
    """Put the successes of a policy into the file."""
    scores = load()
    scores.setdefault(title, {})[policy] = scored
    rows = {task: {name: each.model_dump() for name, each in named.items()} for task, named in scores.items()}
    write_json(STORED, rows)


def difference(policy: Bits, against: Bits) -> Estimate:
    """Mean difference of success in pairs, in points."""
    return statistics.mean(policy.astype(float) - against).times(100.0)


def tables(scores: Mapping[str, Mapping[str, Scored]]) -> Iterator[str]:
    """Lines of two Markdown tables for each task: shares of success, and each agent minus each planner.

    They are of the episodes that all policies of the task have met.
    """
    for title, rows in scores.items():
        episodes = min(row.episodes for row in rows.values())
        bits = {name: row.bits[:episodes] for name, row in rows.items()}
        ordered = sorted(bits, key=lambda name: -float(bits[name].mean()))
        yield from ("", f"### {title}: {episodes} episodes", "", "|policy|success (%)|", "|---|---|")
        for name in ordered:
            share = statistics.rate(bits[name]).times(100.0)
            yield f"|{name}|{share.value:.1f} ({share.low:.1f} to {share.high:.1f})|"
        yield from ("", "|difference|success (points)|", "|---|---|")
        for agent in filter(is_shipped, ordered):
            for other in (name for name in ordered if not is_shipped(name)):
                gap = difference(bits[agent], bits[other])
                yield f"|{agent} - {other}|{gap.value:+.1f} ({gap.low:+.1f} to {gap.high:+.1f})|"


def main(options: HeldOutOptions) -> int:
    """Score, store and write; the exit code."""
    if options.task is not None:
        (task,) = configure("held_out", {}, [options.task]).tasks
        left = list(options.policies or task.policies or CONFIG.policies)
        while left:
            left = [policy for policy in left if score_part(task, policy)]
    write_text(PAGE, replaced(PAGE.read_text(encoding="utf-8"), MARK, "\n".join(tables(load()))))
    return 0


if __name__ == "__main__":
    raise SystemExit(main(tyro.cli(HeldOutOptions)))
