"""Search for the gains of the field that dodges discs: ``python -m tools.tune_apf``.

Differential evolution (R. Storn and K. Price, 1997) on the environment itself, with seeds far from the benchmark's. It
uses only the seeds on which the expert that moves straight to the goal fails, the same ones for every candidate. The
best of many candidates is partly the luckiest on its seeds, so it is stored only if it is better on other seeds, too.
Ctrl-C ends the search and keeps the best gains so far.
"""

from __future__ import annotations

import json
import math
import sys
import warnings
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import tyro
from numpy.typing import NDArray
from scipy.optimize import Bounds, differential_evolution

from agents.console import note
from agents.evaluation.evaluate import evaluate
from agents.evaluation.results import Evaluation
from agents.provenance import versions
from envs.obstacle_dodge.experts import DodgingExpert
from planners.apf.dodge.gains import GAINS_FILE, DodgeGains, tuned_gains
from planners.files import write_json
from planners.typing import Array

ENV_ID = "ObstacleDodge-v0"

FIRST_SEED, FIRST_TO_CONFIRM = 100_000, 500_000  # the benchmark's seeds start at 0

COLLISION = 1.3  # weight of a collision, in late arrivals
SPREAD = 1.5  # the search stays within this factor of the gains it starts from
FIXED = ("nearest", "farthest", "success")  # not searched: the workspace's, and a value that only has to be positive
MOST = {"evade": 1.0, "horizon": 2.5}  # upper bounds of some gains


@dataclass(frozen=True)
class TuneOptions:
    """Search for better gains than the stored ones, and store them if there are any."""

    seeds: int = 4000
    """How many seeds are drawn, from 100000; those on which moving straight succeeds are left out."""
    generations: int = 20
    """Of the search; each evaluates ``population`` candidates."""
    confirm: int = 4000
    """How many other seeds, from 500000, must confirm that the gains are better."""
    population: int = 24
    """Number of candidates."""
    seed: int = 0
    """Of the search."""
    out: Path = GAINS_FILE
    """Where to store the gains and how they were found."""


class Search:
    """The best gains so far, ``gains``, their ``score``, and the number of candidates ``tried``."""

    def __init__(self, start: DodgeGains, seeds: NDArray[np.int64]) -> None:
        self.start = self.gains = start
        self.seeds, self.score, self.tried = seeds, math.inf, 0
        self.names = [name for name in asdict(start) if name not in FIXED]

    def candidate(self, exponents: Array) -> DodgeGains:
        """The gains that differ from those at the start by factors ``SPREAD ** exponent``."""
        changed = {}
        for name, factor in zip(self.names, SPREAD**exponents, strict=True):
            changed[name] = min(MOST.get(name, math.inf), getattr(self.start, name) * factor)
        return replace(self.start, **changed)

    def cost(self, exponents: Array) -> float:
        """The score of a candidate, to be minimised; keeps the best."""
        gains = self.candidate(exponents)
        value = score(run_field(gains, self.seeds))
        self.tried += 1
        if value < self.score:
            self.gains, self.score = gains, value
        return value


def main(options: TuneOptions) -> None:
    """Search, and store what other seeds confirm."""
    drawn = np.arange(FIRST_SEED, FIRST_SEED + options.seeds)
    search = Search(tuned_gains(), drawn[~evaluate("follower", ENV_ID, drawn).success])
    before = score(run_field(search.start, search.seeds))
    note(f"{len(search.seeds)} of {options.seeds} seeds are not trivial; the stored gains score {before}")
    try:
        evolve(search, options)
    except KeyboardInterrupt:
        note("stopped; the best so far is kept")
    others = np.arange(FIRST_TO_CONFIRM, FIRST_TO_CONFIRM + options.confirm)
    confirmed, confirmed_before = (score(run_field(gains, others)) for gains in (search.gains, search.start))
    note(f"score {confirmed} on other seeds, {confirmed_before} with the stored gains")
    if confirmed >= confirmed_before:
        note("not better: nothing is stored")
        return
    recipe = {
        "command": " ".join(["python -m tools.tune_apf", *sys.argv[1:]]),
        "seeds": [FIRST_SEED, FIRST_SEED + options.seeds - 1],
        "not_trivial": len(search.seeds),
        "tried": search.tried,
        "collision_counts": COLLISION,
        "score": search.score,
        "confirmed_score": confirmed,
        "confirmed_score_before": confirmed_before,
        "versions": versions(),
    }
    stored = json.loads(GAINS_FILE.read_text())
    write_json(options.out, stored | {"recipe": recipe, "gains": asdict(search.gains)})
    note(f"stored in {options.out}")


def evolve(search: Search, options: TuneOptions) -> None:
    """Differential evolution over exponents in [-1, 1], from a population around 0."""
    generator, dimensions = np.random.default_rng(options.seed), len(search.names)
    first = np.clip(0.4 * generator.standard_normal((options.population, dimensions)), -1.0, 1.0)
    first[0] = 0.0

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that it has not converged
        differential_evolution(
            search.cost,
            Bounds(-np.ones(dimensions), np.ones(dimensions)),
            init=first,
            maxiter=options.generations,
            rng=generator,
            polish=False,
            tol=0.0,
            callback=lambda intermediate_result: note(f"{search.tried} candidates, best score {search.score:g}"),
        )


def run_field(gains: DodgeGains, seeds: NDArray[np.int64]) -> Evaluation:
    """The episodes of some seeds under the field with these gains."""
    with closing(gym.make_vec(ENV_ID, num_envs=1)) as env:
        batch: Any = env.unwrapped
        return evaluate(DodgingExpert(batch.task, gains), ENV_ID, seeds, num_envs=500)


def score(evaluation: Evaluation) -> float:
    """Number of failures, with collisions weighted by `COLLISION`; to be minimised."""
    collisions = evaluation.metrics["collision"].astype(bool)
    late = ~evaluation.success & ~collisions
    return float(late.sum() + COLLISION * collisions.sum())


if __name__ == "__main__":
    main(tyro.cli(TuneOptions))
