"""Ship one of several trained agents, by a rule that does not look at the episodes it is then judged by.

``python -m tools.release_agent runs/conveyor-*``, with the finished runs of one recipe, one a training seed, scores
the best
agent of each run on two sets of episodes: those that choose, and held-out ones, the leaderboard's, which choose
nothing. The chosen agent goes to ``trained/`` with both scores and those of all training seeds in its JSON, and a table
of them is printed as Markdown.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from rich import box
from rich.console import Console
from rich.table import Table

from agents.evaluation.evaluate import Evaluation, evaluate
from agents.evaluation.leaderboard import METRICS, shown_number
from agents.evaluation.statistics import Estimate, rate
from agents.policies.agent import Agent
from agents.policies.files import load_agent, save_agent
from agents.training.learning_curves import Curve, check_alike, differing, read_curve

TRAINED = Path(__file__).parent.parent / "agents" / "policies" / "trained"
SELECTION_SEED = 2_000_000
"""Of the first episode that chooses among runs: apart from the leaderboard's, and from those that trained the agents or
chose their checkpoints."""
HELD_OUT_SEED = 0
"""Of the first episode that an agent is judged by: the leaderboard's."""
LIMIT_RATIO = 1.05
"""Largest ratio of a value to its limit in an episode that counts as one within the limits."""
SIZE = 300_000
"""Bytes of weights at most."""


@dataclass(frozen=True)
class ShipOptions:
    """Choose one of several trained agents, score it on held-out episodes and ship it."""

    runs: tyro.conf.Positional[tuple[Path, ...]]
    """Folders of finished runs of one recipe, one a training seed."""
    out: Path = TRAINED
    """Folder for the agent, which replaces that of the same environment."""
    episodes: int = 1000
    """In each of the two sets."""


@dataclass(frozen=True)
class Scores:
    """What an agent achieved on a set of episodes.

    Attributes:
        shares: of success, of episodes within the limits and of whatever else is true or false, by name.
        numbers: the mean return, and medians of all else, by name; +inf: never.
    """

    shares: dict[str, Estimate]
    numbers: dict[str, float]

    @property
    def values(self) -> dict[str, float]:
        """All of them, shares without their intervals."""
        return {**{name: share.value for name, share in self.shares.items()}, **self.numbers}

    @property
    def document(self) -> dict[str, Any]:
        """All of them, shares with their intervals, for JSON."""
        return {**{name: vars(share) for name, share in self.shares.items()}, **self.numbers}


@dataclass(frozen=True)
class Candidate:
    """The best agent of a run, and how it does.

    Attributes:
        curve: of its run.
        agent: the agent.
        selection: scores on the episodes that choose.
        held_out: scores on those that do not.
    """

    curve: Curve
    agent: Agent
    selection: Scores
    held_out: Scores

    @property
    def seed(self) -> int:
        """Of the training."""
        return self.curve.config.seed

    @property
    def merit(self) -> tuple[float, float]:
        """What chooses: success, then return."""
        return self.selection.values["success"], self.selection.values["return"]


def main(options: ShipOptions) -> int:
    """Score, choose, write the agent and print the table; the exit code.

    Raises:
        ValueError: for runs that cannot be compared or are not finished, or an agent too large to ship, before
            anything is scored.
    """
    if options.episodes < 1:
        raise ValueError(f"episodes {options.episodes} must be at least 1")
    curves = sorted(read_finished(options.runs), key=lambda curve: curve.config.seed)
    agents = [load_agent(curve.folder) for curve in curves]
    told = Console(stderr=True, soft_wrap=True)
    candidates = []
    for curve, agent in zip(curves, agents, strict=True):
        told.print(f"scoring {curve.folder} on twice {options.episodes} episodes")
        candidates.append(score(curve, agent, options.episodes))
    chosen = choose(candidates)
    path = options.out / f"{chosen.agent.env_id}.safetensors"
    save_agent(Agent(document(candidates, chosen, options.episodes), chosen.agent.tensors), path)
    wide = Console(width=1000)  # a line of Markdown must not be broken
    wide.print(seeds_table(candidates, chosen), caption(chosen, options.episodes), sep="\n", soft_wrap=True)
    told.print(f"wrote {path}, the agent of {chosen.curve.folder}")
    return 0


def read_finished(folders: Sequence[Path]) -> list[Curve]:
    """The curves of runs among which one can be chosen.

    Raises:
        ValueError: if there are none, one is not finished or its agent too large, or they differ in more than the seed.
    """
    if not folders:
        raise ValueError("no runs: give the folders of finished ones, one a training seed")
    curves = [read_curve(folder) for folder in folders]
    check_alike(curves)
    if names := differing(curves):
        raise ValueError(
            f"the runs differ in {', '.join(names)}: the spread over training seeds is that of one recipe; "
            "give runs that differ in nothing but the seed"
        )
    for curve in curves:
        if not curve.finished:
            done, total = int(curve.columns["steps"][-1]), curve.config.total_steps
            raise ValueError(
                f"{curve.folder} is not finished ({done} of {total} steps): wait, or planarm train --resume it"
            )
        weights = curve.folder / "best.safetensors"
        if weights.exists() and weights.stat().st_size > SIZE:
            raise ValueError(
                f"{weights} has {weights.stat().st_size} bytes, more than the {SIZE} that may be shipped; "
                "train narrower hidden layers"
            )
    return curves


def score(curve: Curve, agent: Agent, episodes: int) -> Candidate:
    """The best agent of a run on both sets of episodes, in the environment's default settings but for its actions."""
    selection, held_out = (
        summary(evaluate(agent, agent.env_id, range(first, first + episodes), env_config=agent.action_config))
        for first in (SELECTION_SEED, HELD_OUT_SEED)
    )
    return Candidate(curve, agent, selection, held_out)


def summary(evaluation: Evaluation) -> Scores:
    """The scores of an evaluation."""
    told = {name: values for name, values in evaluation.metrics.items() if name != "is_success" and "/" not in name}
    shares = {
        "success": rate(evaluation.success),
        "limits_kept": rate(evaluation.metrics["limit_ratio"] <= LIMIT_RATIO),
        **{name: rate(values) for name, values in told.items() if values.dtype == bool},
    }
    medians = {name: float(np.nanmedian(values)) for name, values in told.items() if values.dtype != bool}
    return Scores(shares, {"return": float(evaluation.returns.mean()), **medians})


def choose(candidates: Sequence[Candidate]) -> Candidate:
    """The candidate with the most success, then the highest return, on the episodes that choose; of equals the first.

    Held-out scores take no part.
    """
    return max(candidates, key=lambda candidate: candidate.merit)


def rule(episodes: int) -> str:
    """How the agent is chosen, in a sentence."""
    first, last = _ends(SELECTION_SEED, episodes)
    return (
        "Of all training seeds, the agent with the highest success, then the highest mean return, on "
        f"{episodes} episodes (seeds {first} to {last}) that neither trained an agent nor chose its checkpoint; of "
        "equals the lowest training seed."
    )


def document(candidates: Sequence[Candidate], chosen: Candidate, episodes: int) -> dict[str, Any]:
    """The JSON of the chosen agent: its own, and how it was chosen and did, beside the other training seeds."""
    settings = chosen.agent.action_config
    selection = {"rule": rule(episodes), "seeds": _ends(SELECTION_SEED, episodes), "env_config": settings}
    held_out = {"seeds": _ends(HELD_OUT_SEED, episodes), "env_config": settings, "limit_ratio_kept": LIMIT_RATIO}
    return {
        **chosen.agent.document,
        "selection": {**selection, **chosen.selection.document},
        "held_out": {**held_out, **chosen.held_out.document},
        "seeds": [
            {
                "seed": candidate.seed,
                "seconds": float(candidate.curve.columns["seconds"][-1]),
                "steps": int(candidate.curve.columns["steps"][-1]),
                "best_steps": int(candidate.curve.columns["steps"][candidate.curve.best]),
                "selection": candidate.selection.values,
                "held_out": candidate.held_out.values,
            }
            for candidate in candidates
        ],
        "over_seeds": {
            name: spread([candidate.held_out.values[name] for candidate in candidates])
            for name in chosen.held_out.values
        },
    }


def spread(values: Sequence[float]) -> dict[str, float]:
    """Mean, standard deviation (of the population that the seeds are drawn from; NaN for one seed) and extremes."""
    array = np.array(values)
    several = len(array) > 1 and bool(np.isfinite(array).all())
    deviation = float(array.std(ddof=1)) if several else np.nan
    return {"mean": float(array.mean()), "std": deviation, "min": float(array.min()), "max": float(array.max())}


def seeds_table(candidates: Sequence[Candidate], chosen: Candidate) -> Table:
    """A row a training seed, the chosen one in bold, and their mean and spread, in Markdown."""
    metrics = METRICS.get(chosen.agent.env_id, ())
    table = Table("training seed", box=box.MARKDOWN)
    for title in ("seconds", "best at step", "selection (%)", "its return", "held-out (%)", "return"):
        table.add_column(title, justify="right")
    for title in (*(metric.title for metric in metrics), "within limits (%)"):
        table.add_column(title, justify="right")
    columns = [list(_cells(candidate)) for candidate in candidates]
    for candidate, values in zip(candidates, columns, strict=True):
        name = f"**{candidate.seed}**, shipped" if candidate is chosen else str(candidate.seed)
        table.add_row(name, *(shown_number(value).removesuffix(".0") for value in values))
    over_seeds = [spread(values) for values in zip(*columns, strict=True)]
    table.add_row("mean ± std", *(_with_deviation(told["mean"], told["std"]) for told in over_seeds))
    table.add_row("least", *(shown_number(told["min"]).removesuffix(".0") for told in over_seeds))
    table.add_row("greatest", *(shown_number(told["max"]).removesuffix(".0") for told in over_seeds))
    return table


def caption(chosen: Candidate, episodes: int) -> str:
    """What is to be known of the table."""
    success = chosen.held_out.shares["success"]
    first, last = _ends(HELD_OUT_SEED, episodes)
    return (
        f"Shipped: {rule(episodes)[0].lower()}{rule(episodes)[1:]} Held-out: seeds {first} to {last}, which chose "
        f"nothing; there the shipped agent succeeds in {100.0 * success.value:.1f} % (95 % interval "
        f"{100.0 * success.low:.1f} to {100.0 * success.high:.1f}). Return: mean; all else: medians. Within limits: "
        f"no value above {LIMIT_RATIO} of its limit. Seconds: of training, without evaluations."
    )


def _cells(candidate: Candidate) -> Iterator[float]:
    """The numbers of a row, as they are shown."""
    curve, selection, held_out = candidate.curve, candidate.selection.values, candidate.held_out.values
    yield round(float(curve.columns["seconds"][-1]))
    yield float(curve.columns["steps"][curve.best])
    yield 100.0 * selection["success"]
    yield selection["return"]
    yield 100.0 * held_out["success"]
    yield held_out["return"]
    for metric in METRICS.get(candidate.agent.env_id, ()):
        factor = 100.0 if metric.key in candidate.held_out.shares else metric.factor
        yield factor * held_out[metric.key]
    yield 100.0 * held_out["limits_kept"]


def _with_deviation(mean: float, deviation: float) -> str:
    shown = shown_number(mean).removesuffix(".0")
    return shown if np.isnan(deviation) else f"{shown} ± {deviation:{',.0f' if deviation >= 100.0 else '.2g'}}"


def _ends(first: int, episodes: int) -> list[int]:
    """The first and the last seed of a set of episodes."""
    return [first, first + episodes - 1]


if __name__ == "__main__":
    try:
        sys.exit(main(tyro.cli(ShipOptions)))
    except ValueError as error:
        sys.exit(f"ship: {error}")
