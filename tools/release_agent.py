"""Release the best of several trained agents, selected on other episodes than those of the reported scores.

``python -m tools.release_agent runs/conveyor-*``, with the finished runs of one recipe, one a training seed, scores
the best agent of each run on two sets of episodes: those that select, and held-out ones, the leaderboard's. The
selected agent goes to ``agents/policies/trained/`` with the scores of all training seeds in its JSON.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from agents.console import note
from agents.evaluation.statistics import Estimate, rate
from agents.evaluation.summarise import training_scores, values_of
from agents.policies.agent import Agent
from agents.policies.files import load_agent, save_agent
from agents.training.learning_curves import Curve, differing, read_curve, without_copies
from agents.training.recipe import TrainingConfig
from agents.training.scores import evaluation_of
from tools.site.training_seeds import meaning, result, spread, training_seeds

TRAINED = Path(__file__).parent.parent / "agents" / "policies" / "trained"
SELECTION_SEED, HELD_OUT_SEED = 2_000_000, 0
"""Of the first episode that selects an agent, which neither training nor the choice of checkpoints used, and of the
first held-out one, which is the leaderboard's."""
LIMIT_RATIO = 1.05  # largest ratio of a value to its limit in an episode that counts as one within the limits
SIZE = 300_000  # bytes of weights at most

Scores = dict[str, Estimate]
"""Success, episodes within the limits and other shares, with their intervals; the mean return and medians, without."""


@dataclass(frozen=True)
class ReleaseOptions:
    """Select one of several trained agents, score it on held-out episodes and release it."""

    runs: tyro.conf.Positional[tuple[Path, ...]]
    """Folders of finished runs of one recipe, one a training seed."""
    out: Path = TRAINED
    """Folder for the agent, which replaces that of the same environment and variant."""
    episodes: int = 1000
    """In each of the two sets."""
    variant: str | None = None
    """Name of an agent for harder episodes, which is shipped beside that of the environment as policy agent:NAME. It is
    scored in the settings and at the levels that it was trained in, not in the default ones."""


@dataclass(frozen=True)
class Candidate:
    """The best agent of a run."""

    curve: Curve  # of its run
    agent: Agent  # the agent
    config: TrainingConfig  # settings and levels at which it is scored
    selection: Scores  # scores on the episodes that select
    held_out: Scores  # scores on those that do not

    @property
    def document(self) -> dict[str, Any]:
        """What the JSON says of each training seed."""
        return {
            "seed": self.curve.config.seed,
            "seconds": float(self.curve.columns["seconds"][-1]),
            "steps": int(self.curve.columns["steps"][-1]),
            "best_steps": int(self.curve.columns["steps"][self.curve.best]),
            "selection": values_of(self.selection),
            "held_out": values_of(self.held_out),
        }


def main(options: ReleaseOptions) -> int:
    """Score, select, write the agent and print the table; the exit code. Raises as `read_finished`."""
    if options.episodes < 1:
        raise ValueError(f"episodes {options.episodes} must be at least 1")
    curves = sorted(read_finished(options.runs), key=lambda curve: curve.config.seed)
    agents = [load_agent(curve.folder) for curve in curves]
    candidates = []
    for curve, agent in zip(curves, agents, strict=True):
        note(f"scoring {curve.folder} on twice {options.episodes} episodes")
        update: dict[str, Any] = {"evaluation_episodes": options.episodes}
        if options.variant is None:
            update |= {"env_config": agent.action_config, "levels": ()}
        config = curve.config.model_copy(update=update)
        selection, held_out = (score(agent, config, first) for first in (SELECTION_SEED, HELD_OUT_SEED))
        candidates.append(Candidate(curve, agent, config, selection, held_out))
    chosen = choose(candidates)
    name = chosen.agent.env_id if options.variant is None else f"{chosen.agent.env_id}.{options.variant}"
    path = options.out / f"{name}.safetensors"
    released = document(candidates, chosen, options.episodes)
    save_agent(Agent(released, chosen.agent.tensors), path)
    training_seeds(released, f"{meaning(released)} {result(released)}").show()
    note(f"wrote {path}, the agent of {chosen.curve.folder}")
    return 0


def read_finished(folders: Sequence[Path]) -> list[Curve]:
    """The curves of runs among which one can be selected.

    Raises:
        ValueError: if there are none, one is not finished or its agent too large, or they differ in more than the seed.
    """
    if not folders:
        raise ValueError("no runs: give the folders of finished ones, one a training seed")
    curves = [read_curve(folder) for folder in folders]
    if len(tasks := sorted({curve.config.env_id for curve in curves})) > 1:
        raise ValueError(f"runs of {' and of '.join(tasks)}: give runs of one environment")
    if copies := without_copies(curves)[1]:
        raise ValueError("; ".join(copies))
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
                f"{weights} has {weights.stat().st_size} bytes, more than the {SIZE} that may be released; "
                "train narrower hidden layers"
            )
    return curves


def score(agent: Agent, config: TrainingConfig, first: int) -> Scores:
    """Scores on the episodes of an evaluation of a recipe, from a first seed on."""
    evaluation = evaluation_of(agent, config, first)
    return {**training_scores(evaluation), "limits_kept": rate(evaluation.metrics["limit_ratio"] <= LIMIT_RATIO)}


def choose(candidates: Sequence[Candidate]) -> Candidate:
    """The candidate with the most success, then the highest return, on the selection episodes; of equals the first."""
    return max(candidates, key=lambda each: (each.selection["success"].value, each.selection["return"].value))


def rule(episodes: int) -> str:
    """How the agent is selected, in a sentence."""
    first, last = _ends(SELECTION_SEED, episodes)
    return (
        "Of all training seeds, the agent with the highest success, then the highest mean return, on "
        f"{episodes} episodes (seeds {first} to {last}) that neither trained an agent nor chose its checkpoint; of "
        "equals the lowest training seed."
    )


def document(candidates: Sequence[Candidate], chosen: Candidate, episodes: int) -> dict[str, Any]:
    """The JSON of the selected agent: its own, how it was selected, its scores and those of the other seeds."""
    settings: dict[str, Any] = {"env_config": dict(chosen.config.env_config)}
    if chosen.config.levels:
        settings["levels"] = list(chosen.config.levels)
    selection: dict[str, Any] = {"rule": rule(episodes), "seeds": _ends(SELECTION_SEED, episodes), **settings}
    held_out: dict[str, Any] = {"seeds": _ends(HELD_OUT_SEED, episodes), **settings, "limit_ratio_kept": LIMIT_RATIO}
    for part, scores in ((selection, chosen.selection), (held_out, chosen.held_out)):
        part |= {name: vars(each) if _is_share(each) else each.value for name, each in scores.items()}
    return {
        **chosen.agent.document,
        "selection": selection,
        "held_out": held_out,
        "seeds": [candidate.document for candidate in candidates],
        "over_seeds": {
            name: spread([candidate.held_out[name].value for candidate in candidates]) for name in chosen.held_out
        },
    }


def _is_share(estimate: Estimate) -> bool:
    return not math.isnan(estimate.low)


def _ends(first: int, episodes: int) -> list[int]:
    """The first and the last seed of a set of episodes."""
    return [first, first + episodes - 1]


if __name__ == "__main__":
    try:
        sys.exit(main(tyro.cli(ReleaseOptions)))
    except ValueError as error:
        sys.exit(f"release: {error}")
