"""Stored scores of every expert and every shipped agent, so that none of them changes unnoticed.

``python -m tools.stored_scores`` evaluates them all on the same seeds, apart from the leaderboard's and from those that
select agents, and writes ``tests/agents/stored_scores.json``; with ``--check`` it compares instead. On one machine a
score is reproduced to the bit. The tolerances are for processors and libraries that round differently:
`COUNT_TOLERANCE` episodes of those that are counted, `LIMIT_TOLERANCE` of the worst limit ratio, `TOLERANCE` of all
else, medians and interquartile means, which one episode cannot move far; and `FLOOR`, for errors that are zero but for
rounding. The expert ``random`` is left out: its motion is chaotic, so that the last digit decides.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

import envs
from agents.console import note, progress_bar
from agents.evaluation.evaluate import evaluate
from agents.evaluation.summarise import LIMIT_TOLERANCE, summarise
from agents.files import write_json
from agents.policies.files import shipped_agents
from agents.policies.lookup import SHIPPED, find_policy
from agents.policies.policy import Policy, PolicyMaker
from agents.provenance import machine, versions
from envs.experts import expert_names

FILE = Path(__file__).parent.parent / "tests" / "agents" / "stored_scores.json"
FIRST_SEED, EPISODES = 500_000, 50

COUNT_TOLERANCE = 1  # episodes by which a count may differ
TOLERANCE = 0.02  # share by which a median or mean may differ
FLOOR = 1e-5  # differences that are none, in the unit of the value: a hundredth of what the strictest task tolerates

Score = Mapping[str, float | None]
"""By name: counts of boolean metrics, the interquartile mean of the return, medians of the task's other metrics, the
worst limit ratio of all episodes. None in place of a time: never."""


@dataclass(frozen=True)
class ScoresOptions:
    """Score every expert and every shipped agent in every environment, and store the scores (half a minute)."""

    check: bool = False
    """Compare with the stored scores rather than store; the exit code is 1 if something differs."""
    out: Path = FILE
    """Where the scores are stored."""


def main(options: ScoresOptions) -> int:
    """Score, with a progress bar, then store or compare; the exit code."""
    scores: dict[str, dict[str, Score]] = {}
    with progress_bar("policies") as bar:
        for env_id, name in bar.track(scored_policies(), description="scoring"):
            scores.setdefault(env_id, {})[name] = score(env_id, name)
    if not options.check:
        tolerance = {"counts": COUNT_TOLERANCE, "limit_ratio": LIMIT_TOLERANCE, "share": TOLERANCE, "floor": FLOOR}
        document = {
            "command": "python -m tools.stored_scores",
            "first_seed": FIRST_SEED,
            "episodes": EPISODES,
            "values": "counts of what is true or false; interquartile mean of the return; medians; worst limit ratio",
            "tolerance": tolerance,
            "versions": versions(("safetensors",)),
            "machine": machine(),
            "scores": scores,
        }
        write_json(options.out, document)
        note(f"wrote {options.out}")
        return 0
    complaints = compare(load(options.out), scores)
    for complaint in (*complaints, f"{len(complaints)} differences from {options.out}"):
        note(complaint)
    return 1 if complaints else 0


def scored_policies() -> list[tuple[str, str]]:
    """Environments, and the names of the experts and of the agent that are scored there."""
    return [
        (env_id, name)
        for env_id in envs.env_ids()
        for name in (*expert_names(env_id), *([SHIPPED] if env_id in shipped_agents() else []))
        if name != "random"
    ]


def score(env_id: str, name: str) -> Score:
    """The score of a policy now, in the environment's default settings except for the meaning of its actions."""
    named = find_policy(name, env_id)
    return score_policy(named.policy, env_id, named.settings({}))


def score_policy(policy: Policy | PolicyMaker | str, env_id: str, env_config: Mapping[str, Any] | None = None) -> Score:
    """The score of a policy."""
    seeds = range(FIRST_SEED, FIRST_SEED + EPISODES)
    evaluation = evaluate(policy, env_id, seeds, env_config=env_config, num_envs=EPISODES)
    estimates = summarise(evaluation, bootstrap=False)
    scores: dict[str, float] = {"success": int(evaluation.success.sum()), "return": estimates["return"].value}
    for metric in envs.task_card(env_id).metrics:
        values = evaluation.metrics[metric.key]
        scores[metric.key] = int(values.sum()) if values.dtype == bool else estimates[metric.key].value
    scores["limit_ratio"] = float(evaluation.metrics["limit_ratio"].max())
    return {name: value if math.isfinite(value) else None for name, value in scores.items()}


def load(path: Path = FILE) -> dict[str, dict[str, Score]]:
    """Stored scores, by environment and name."""
    scores: dict[str, dict[str, Score]] = json.loads(path.read_text(encoding="utf-8"))["scores"]
    return scores


def compare(stored: Mapping[str, Mapping[str, Score]], now: Mapping[str, Mapping[str, Score]]) -> list[str]:
    """A line for each value that differs by more than is tolerated, or is present on one side only."""
    pairs = dict.fromkeys((env_id, name) for scores in (stored, now) for env_id in scores for name in scores[env_id])
    return [
        f"{env_id}: {name}: {difference}"
        for env_id, name in pairs
        for difference in differences(*(scores.get(env_id, {}).get(name, {}) for scores in (stored, now)))
    ]


def differences(stored: Score, now: Score) -> Iterator[str]:
    """A line for each value that differs by more than is tolerated."""
    for name in dict.fromkeys([*stored, *now]):
        if name not in stored or name not in now:
            yield f"{name} is {'scored but not stored' if name in now else 'stored but not scored'}"
        elif not _close(name, stored[name], now[name]):
            yield f"{name} was {stored[name]} and is {now[name]}"


def _close(name: str, stored: float | None, now: float | None) -> bool:
    if stored is None or now is None:
        return stored is now
    if isinstance(stored, int):
        return abs(stored - now) <= COUNT_TOLERANCE
    share = LIMIT_TOLERANCE if name == "limit_ratio" else TOLERANCE
    return math.isclose(stored, now, rel_tol=share, abs_tol=FLOOR)


if __name__ == "__main__":
    raise SystemExit(main(tyro.cli(ScoresOptions)))
