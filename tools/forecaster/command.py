"""`planarm train-forecaster`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import tyro
from rich import box
from rich.console import Console
from rich.table import Table

from agents.evaluation.evaluate import evaluate
from agents.evaluation.leaderboard import METRICS, shown_number
from agents.policies.forecasting.forecaster import ENV_ID, Forecaster, save_forecaster
from agents.policies.forecasting.policy import ForecastingDodger
from agents.provenance import machine, versions
from agents.yaml_config import assigned
from tools.forecaster.config import ForecastConfig
from tools.release_agent import HELD_OUT_SEED, SELECTION_SEED, Scores, rule, spread, summary


@dataclass(frozen=True)
class ForecasterOptions:
    """Train the forecaster of ObstacleDodge-v0, once a seed, and keep the best; needs pip install "planarm[rl]".

    Takes two minutes a seed, and half of that again to score it.

    For example:

        $ planarm train-forecaster
        $ planarm train-forecaster hidden=128 epochs=20 --seeds 0 1 --out runs/wide
        $ planarm evaluate runs/wide/ObstacleDodge-v0.safetensors --env ObstacleDodge-v0 --against apf
    """

    changes: tyro.conf.Positional[tuple[str, ...]] = ()
    """key=value for each setting of the training that is not to have its default."""
    seeds: tuple[int, ...] = (0, 1, 2, 3, 4)
    """Of the training."""
    episodes: int = 1000
    """In each of two sets: those that choose among the seeds, and held-out ones."""
    out: Path = Path("runs/forecaster")
    """Folder for a forecaster a seed, and for the best of them."""


@dataclass(frozen=True)
class Candidate:
    """A trained forecaster, and how it does.

    Attributes:
        seed: of the training.
        forecaster: trained.
        selection: scores on the episodes that choose.
        held_out: scores on those that do not.
    """

    seed: int
    forecaster: Forecaster
    selection: Scores
    held_out: Scores

    @property
    def merit(self) -> tuple[float, float]:
        """What chooses: success, then return."""
        return self.selection.values["success"], self.selection.values["return"]


def run(options: ForecasterOptions) -> int:
    """Train, score, choose and print the table; the exit code.

    Raises:
        ValueError: for a setting that is unknown or out of bounds, no seeds or no episodes.
        ModuleNotFoundError: without the `rl` extra.
    """
    config = ForecastConfig.parse(assigned({}, options.changes), "forecaster setting")
    if not options.seeds or min(options.seeds) < 0:
        raise ValueError("give at least one training seed, none of them negative")
    if options.episodes < 1:
        raise ValueError(f"episodes {options.episodes} must be at least 1")
    told = Console(stderr=True, soft_wrap=True)
    candidates = []
    for seed in options.seeds:
        forecaster = _train(config, seed, told)
        save_forecaster(forecaster, options.out / f"seed-{seed}.safetensors")
        told.print(f"seed {seed}: scoring on twice {options.episodes} episodes")
        candidates.append(score(seed, forecaster, options.episodes))
    chosen = max(candidates, key=lambda candidate: candidate.merit)
    path = options.out / f"{ENV_ID}.safetensors"
    save_forecaster(_with_scores(candidates, chosen, options.episodes), path)
    wide = Console(width=1000)  # a line of Markdown must not be broken
    wide.print(seeds_table(candidates, chosen), rule(options.episodes), sep="\n", soft_wrap=True)
    told.print(f"wrote {path}, of training seed {chosen.seed}")
    return 0


def score(seed: int, forecaster: Forecaster, episodes: int) -> Candidate:
    """A forecaster on both sets of episodes, in the environment's default settings."""
    selection, held_out = (
        summary(evaluate(lambda env: ForecastingDodger(env.unwrapped.task, forecaster), ENV_ID, seeds))
        for seeds in (range(first, first + episodes) for first in (SELECTION_SEED, HELD_OUT_SEED))
    )
    return Candidate(seed, forecaster, selection, held_out)


def seeds_table(candidates: Sequence[Candidate], chosen: Candidate) -> Table:
    """A row a training seed, the chosen one in bold, and their mean and spread, in Markdown."""
    table = Table("training seed", box=box.MARKDOWN)
    titles = ("seconds", "likeliest path (m)", "best path (m)", "selection (%)", "held-out (%)", "return")
    for title in (*titles, *(metric.title for metric in METRICS[ENV_ID])):
        table.add_column(title, justify="right")
    columns = [list(_cells(candidate)) for candidate in candidates]
    for candidate, values in zip(candidates, columns, strict=True):
        name = f"**{candidate.seed}**, shipped" if candidate is chosen else str(candidate.seed)
        table.add_row(name, *map(shown_number, values))
    over_seeds = [spread(values) for values in zip(*columns, strict=True)]
    table.add_row("mean", *(shown_number(told["mean"]) for told in over_seeds))
    table.add_row("standard deviation", *(shown_number(told["std"]) for told in over_seeds))
    return table


def _train(config: ForecastConfig, seed: int, told: Console) -> Forecaster:
    try:
        import torch

        from tools.forecaster.training import draw_samples, fit
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(f'training needs pip install "planarm[rl]" ({error})') from None
    torch.set_num_threads(1)
    began = perf_counter()
    told.print(f"seed {seed}: watching the discs of {config.episodes:,} episodes")
    samples = draw_samples(config, seed)
    forecaster = fit(config, samples, seed, lambda line: told.print(f"seed {seed}: {line}"))
    made = {"seconds": perf_counter() - began, "versions": versions(("torch",)), "machine": machine()}
    training = {**forecaster.document["training"], **made}
    return Forecaster({**forecaster.document, "training": training}, forecaster.tensors)


def _with_scores(candidates: Sequence[Candidate], chosen: Candidate, episodes: int) -> Forecaster:
    document = {
        **chosen.forecaster.document,
        "selection": {"rule": rule(episodes), **chosen.selection.document},
        "held_out": {"seeds": [HELD_OUT_SEED, HELD_OUT_SEED + episodes - 1], **chosen.held_out.document},
        "seeds": [
            {"seed": candidate.seed, "selection": candidate.selection.values, "held_out": candidate.held_out.values}
            for candidate in candidates
        ],
    }
    return Forecaster(document, chosen.forecaster.tensors)


def _cells(candidate: Candidate) -> Iterator[float]:
    """The numbers of a row, as they are shown."""
    training, held_out = candidate.forecaster.document["training"], candidate.held_out.values
    yield training["seconds"]
    yield training["errors"]["likeliest"]
    yield training["errors"]["best"]
    yield 100.0 * candidate.selection.values["success"]
    yield 100.0 * held_out["success"]
    yield held_out["return"]
    for metric in METRICS[ENV_ID]:
        yield (100.0 if metric.key in candidate.held_out.shares else metric.factor) * held_out[metric.key]
