"""Search for the gains of the field that dodges discs: ``python -m tools.tune_apf``.

The search (differential evolution, R. Storn and K. Price, 1997) runs the environment itself, on seeds far from those of
the benchmark. Only seeds count that are not trivial: those on which the expert that goes straight to the goal fails.
Every candidate meets the same ones. Ctrl-C ends the search and keeps the best gains so far.

The best of many is partly the luckiest on those seeds: it is stored only if it is better on other seeds, too.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import tyro
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from scipy.optimize import Bounds, differential_evolution

from agents.evaluation.evaluate import Evaluation, evaluate
from agents.files import write_json
from agents.provenance import versions
from envs.obstacle_dodge.experts import DodgingExpert
from planners.apf.dodge.gains import GAINS_FILE, DodgeGains, tuned_gains
from planners.typing import Array

ENV_ID = "ObstacleDodge-v0"

FIRST_SEED, FIRST_TO_CONFIRM = 100_000, 500_000
"""The benchmark's seeds are those from 0."""

COLLISION = 1.3
"""What a collision counts, in failures by time."""

SPREAD = 1.5
"""The search stays within this factor of the gains that it begins with."""

FIXED = ("nearest", "farthest", "success")
"""Not searched for: what is known of the workspace, and a worth that only has to be positive."""

MOST = {"evade": 1.0, "horizon": 2.5}
"""Upper bounds of some gains."""


@dataclass(frozen=True)
class TuneOptions:
    """Search for better gains than the stored ones, and store them if there are any."""

    seeds: int = 4000
    """How many seeds are drawn, from 100000; the trivial ones among them are left out."""
    generations: int = 20
    """Of the search; each tries ``population`` candidates."""
    confirm: int = 4000
    """How many other seeds, from 500000, have to agree that the gains found are better."""
    population: int = 24
    """Number of candidates."""
    seed: int = 0
    """Of the search."""
    out: Path = GAINS_FILE
    """Where to store the gains and how they were found."""


@dataclass
class Search:
    """The best so far.

    Attributes:
        start: the gains that the search begins with.
        seeds: those that are not trivial.
        gains: the best so far.
        score: theirs; see `score`.
        tried: how many have been evaluated.
    """

    start: DodgeGains
    seeds: NDArray[np.int64]
    gains: DodgeGains = field(init=False)
    score: float = math.inf
    tried: int = 0

    def __post_init__(self) -> None:
        self.gains = self.start

    @property
    def names(self) -> list[str]:
        """Of the gains that are searched for."""
        return [name for name in asdict(self.start) if name not in FIXED]

    def candidate(self, exponents: Array) -> DodgeGains:
        """The gains that differ from the first ones by factors ``SPREAD ** exponent``."""
        now = asdict(self.start)
        factors = zip(self.names, SPREAD**exponents, strict=True)
        return replace(
            self.start, **{name: min(MOST.get(name, math.inf), now[name] * factor) for name, factor in factors}
        )

    def cost(self, exponents: Array) -> float:
        """What is minimised; remembers the best."""
        gains = self.candidate(exponents)
        value = score(run_field(gains, self.seeds))
        self.tried += 1
        if value < self.score:
            self.gains, self.score = gains, value
        return value


def main(options: TuneOptions) -> None:
    """Search, with a progress bar, and store."""
    console = Console(stderr=True)
    drawn = np.arange(FIRST_SEED, FIRST_SEED + options.seeds)
    search = Search(tuned_gains(), drawn[~evaluate("follower", ENV_ID, drawn).success])
    begun_with = score(run_field(search.start, search.seeds))
    console.print(f"{len(search.seeds)} of {options.seeds} seeds are not trivial; the gains score {begun_with}")
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console) as progress:
        task = progress.add_task("candidates", total=options.population * (options.generations + 1))

        def tell(exponents: Array) -> float:
            value = search.cost(exponents)
            progress.update(task, advance=1, description=f"best {search.score:g}")
            return value

        try:
            _evolve(tell, len(search.names), options)
        except KeyboardInterrupt:
            console.print("stopped; the best so far is kept")
    others = np.arange(FIRST_TO_CONFIRM, FIRST_TO_CONFIRM + options.confirm)
    confirmed = {
        name: score(run_field(gains, others)) for name, gains in (("of", search.gains), ("before", search.start))
    }
    if confirmed["of"] < confirmed["before"]:
        write_json(options.out, document(search, options, confirmed))
        console.print(
            f"score {confirmed['of']} instead of {confirmed['before']} on other seeds: stored in {options.out}"
        )
    else:
        console.print("no gains were found that are better on other seeds; nothing is stored")


def _evolve(cost: Callable[[Array], float], dimensions: int, options: TuneOptions) -> None:
    """Differential evolution over the exponents in [-1, 1], from a population around 0."""
    generator = np.random.default_rng(options.seed)
    first = np.clip(0.4 * generator.standard_normal((options.population, dimensions)), -1.0, 1.0)
    first[0] = 0.0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that it has not converged
        differential_evolution(
            cost,
            Bounds(-np.ones(dimensions), np.ones(dimensions)),
            init=first,
            maxiter=options.generations,
            rng=generator,
            polish=False,
            tol=0.0,
        )


def run_field(gains: DodgeGains, seeds: NDArray[np.int64]) -> Evaluation:
    """The episodes of some seeds under the field with these gains."""
    with closing(gym.make_vec(ENV_ID, num_envs=1)) as env:
        batch: Any = env.unwrapped
        return evaluate(DodgingExpert(batch.task, gains), ENV_ID, seeds, num_envs=500)


def score(evaluation: Evaluation) -> float:
    """Failures, collisions counted a little more: the less, the better."""
    collisions = evaluation.metrics["collision"].astype(bool)
    late = ~evaluation.success & ~collisions
    return float(late.sum() + COLLISION * collisions.sum())


def document(search: Search, options: TuneOptions, confirmed: Mapping[str, float]) -> Mapping[str, Any]:
    """What the file holds."""
    return {
        "recipe": {
            "command": "python -m tools.tune_apf",
            "seeds": [FIRST_SEED, FIRST_SEED + options.seeds - 1],
            "not_trivial": len(search.seeds),
            "generations": options.generations,
            "population": options.population,
            "seed": options.seed,
            "tried": search.tried,
            "collision_counts": COLLISION,
            "score": search.score,
            "confirmed_on": [FIRST_TO_CONFIRM, FIRST_TO_CONFIRM + options.confirm - 1],
            "confirmed_score": confirmed["of"],
            "confirmed_score_before": confirmed["before"],
            "versions": versions(),
        },
        "gains": asdict(search.gains),
    }


if __name__ == "__main__":
    main(tyro.cli(TuneOptions))
