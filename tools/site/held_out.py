"""Learnt policies beside every planner on held-out seeds: successes and returns, and their differences in pairs.

    python -m tools.site.held_out ObstacleDodge-v0/uncertain --policies agent apf

scores policies on a task of ``configs/held_out.yaml``, stores success and return of each episode in
``tools/data/held_out.json``, and writes the tables to ``docs/agents/harder.md``; without a task it writes the tables
only. They are those of ``planarm benchmark --config held_out``. A run that is stopped goes on from there;
policies whose behaviour has changed are scored again after their entry has been deleted from the file.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import tyro
from numpy.typing import ArrayLike, NDArray
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
from planners.typing import Array
from tools.site.marks import replaced

STORED = Path(__file__).parent.parent / "data" / "held_out.json"
PAGE = Path(__file__).parent.parent.parent / "docs" / "agents" / "harder.md"
MARK = "held out"
CONFIG = configure("held_out", {})
PART = 250
"""Episodes between two writes of the file."""

Bits = NDArray[np.bool_]


class Scored(BaseModel):
    """A policy's successes and returns on the first held-out seeds.

    Attributes:
        began: when the first episode was run.
        versions: of Python and its packages.
        weights: SHA-256 of the agent's weights; empty for a planner.
        episodes: number of episodes.
        successes: a bit an episode, in hexadecimal.
        returns: to four decimals; empty for policies that were scored before returns were kept.
    """

    began: str
    versions: dict[str, str]
    weights: str
    episodes: int
    successes: str
    returns: list[float] = []

    @property
    def bits(self) -> Bits:
        """Whether each episode ended in success, ``(episodes,)``."""
        packed = np.frombuffer(bytes.fromhex(self.successes), dtype=np.uint8)
        return np.unpackbits(packed, count=self.episodes).astype(bool)

    def with_more(self, bits: Bits, returns: ArrayLike) -> Scored:
        """These episodes with further ones."""
        joined = np.concatenate([self.bits, bits])
        added = np.asarray(returns, dtype=float).round(4).tolist()
        kept = [*self.returns, *added] if len(self.returns) == self.episodes else []
        update = {"episodes": len(joined), "successes": np.packbits(joined).tobytes().hex(), "returns": kept}
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


def scored(task: BenchmarkTask, policy: str, first: int, episodes: int) -> tuple[Bits, Array]:
    """Whether a policy succeeds in each of some episodes of a task, and its returns."""
    seeds = CONFIG.seed + np.arange(first, first + episodes)
    evaluation = evaluate(
        policy, task.env, seeds, env_config=task.env_config, options=task.options, num_envs=CONFIG.num_envs
    )
    return evaluation.success, evaluation.returns


def score_part(task: BenchmarkTask, policy: str) -> bool:
    """Score a policy on some of the episodes that it has not met, and store them; whether any are left."""
    kept, weights = load().get(task.title, {}).get(policy), weights_of(policy, task.env)
    if kept is None or kept.weights != weights:
        began = datetime.now(UTC).isoformat("T", "seconds")
        kept = Scored(began=began, versions=versions(), weights=weights, episodes=0, successes="")
    total = task.episodes or CONFIG.episodes
    if kept.episodes < total:
        kept = kept.with_more(*scored(task, policy, kept.episodes, min(PART, total - kept.episodes)))
        store(task.title, policy, kept)
        note(f"{task.title}, {policy}: {kept.bits.mean():.1%} of {kept.episodes} episodes")
    return kept.episodes < total


def store(title: str, policy: str, row: Scored) -> None:
    """Put the episodes of a policy into the file."""
    scores = load()
    scores.setdefault(title, {})[policy] = row
    rows = {
        task: {name: each.model_dump(exclude_defaults=True) for name, each in named.items()}
        for task, named in scores.items()
    }
    write_json(STORED, rows)


def difference(policy: Bits, against: Bits) -> Estimate:
    """Mean difference of success in pairs, in points."""
    return statistics.mean(policy.astype(float) - against).times(100.0)


def tables(scores: Mapping[str, Mapping[str, Scored]]) -> Iterator[str]:
    """Lines of two Markdown tables for each task: success and return, and each agent minus each planner.

    They are of the episodes that all policies of the task have met. A task's policies are in the order of their
    returns, if these are kept of all, else of their successes.
    """
    for title, rows in scores.items():
        episodes = min(row.episodes for row in rows.values())
        bits = {name: row.bits[:episodes] for name, row in rows.items()}
        returns = {name: np.array(row.returns[:episodes]) for name, row in rows.items() if row.returns}
        all_kept = len(returns) == len(rows)
        middles = {name: statistics.interquartile_mean(each) for name, each in returns.items()} if all_kept else {}
        ordered = sorted(bits, key=lambda name: -(middles[name].value if middles else float(bits[name].mean())))
        more = "return|" if all_kept else ""
        line = "|---|---|---|" if all_kept else "|---|---|"
        yield from ("", f"### {title}: {episodes} episodes", "", f"|policy|success (%)|{more}", line)
        for name in ordered:
            share = _interval(statistics.rate(bits[name]).times(100.0), ".1f")
            yield f"|{name}|{share}|" + (f"{_interval(middles[name], '.3f')}|" if all_kept else "")
        yield from ("", f"|difference|success (points)|{more}", line)
        for agent in filter(is_shipped, ordered):
            for other in (name for name in ordered if not is_shipped(name)):
                gap = _interval(difference(bits[agent], bits[other]), "+.1f")
                of_returns = statistics.interquartile_mean(returns[agent] - returns[other]) if all_kept else None
                yield f"|{agent} - {other}|{gap}|" + (f"{_interval(of_returns, '+.3f')}|" if of_returns else "")


def _interval(estimate: Estimate, form: str) -> str:
    """A value with its interval, as in "1.0 (0.5 to 1.5)"."""
    return f"{estimate.value:{form}} ({estimate.low:{form}} to {estimate.high:{form}})"


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
