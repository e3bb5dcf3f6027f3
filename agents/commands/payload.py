"""`planarm payload`: what a mass on the hand does to the experts, without the adaptive law and with it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from rich import box
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

import envs
from agents.evaluation.evaluate import Evaluation, evaluate, known_env_ids
from agents.evaluation.leaderboard import METRICS, shown_number
from agents.files import write_json
from agents.provenance import machine, versions
from envs.experts import ADAPTIVE, expert_names
from envs.settings import refuse_unknown

WITHIN = 1.05
"""Limit ratio up to which an episode counts as one that keeps the limits of an arm whose load nobody told."""


@dataclass(frozen=True)
class PayloadOptions:
    """Score experts with masses on the hand that nobody tells them, without and with the adaptive law.

    All meet the same episodes, but for starts that no motion solves with the mass. Takes a minute or two. Where the
    output is no terminal, the table is Markdown.

    For example:

        $ planarm payload
        $ planarm payload --env ObstacleDodge-v0 --masses 0 0.3 --episodes 100
    """

    env: str = "ConveyorTrack-v0"
    """Id of the environment."""
    masses: tuple[float, ...] = (0.0, 0.1, 0.3)
    """Point masses at the hand, kg."""
    policies: tuple[str, ...] = ("dpct", "lagrange", "apf", "follower")
    """Names of experts."""
    episodes: int = 200
    """Episodes of each of them."""
    seed: int = 0
    """Seed of the first episode; the next episode has the next."""
    json: Path | None = None
    """Write every episode, with versions and seeds, to this file."""


@dataclass(frozen=True)
class Row:
    """What one expert achieves with one mass (kg) on the hand."""

    mass: float
    evaluation: Evaluation


def run(options: PayloadOptions) -> int:
    """Print the table, and write the JSON if asked for; the exit code.

    Raises:
        ValueError: for anything unknown or impossible, before the first episode.
    """
    _check(options)
    rows: list[Row] = []
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
        total = 2 * len(options.masses) * len(options.policies)
        rows.extend(bar.track(_rows(options), total=total, description="evaluating"))
    print_table(Console(), options, rows)
    if options.json is not None:
        write_json(options.json, _document(options, rows))
        console.print(f"wrote {options.json}")
    return 0


def print_table(console: Console, options: PayloadOptions, rows: list[Row]) -> None:
    """Print the table with what is to be known of it; as Markdown where the console is no terminal."""
    metrics = METRICS.get(options.env, ())
    table = Table("payload (kg)", "policy", box=box.SIMPLE_HEAD, padding=0)
    for title in ("success (%)", *(metric.title for metric in metrics), "limit ratio", "kept (%)"):
        table.add_column(title, justify="right")
    for row in rows:
        values = row.evaluation.metrics
        table.add_row(
            f"{row.mass:g}",
            row.evaluation.policy,
            _percent(row.evaluation.success),
            *(_cell(values[metric.key], metric.factor) for metric in metrics),
            _cell(values["limit_ratio"], 1.0),
            _percent(values["limit_ratio"] <= WITHIN),
        )
    heading = f"{options.env}: {options.episodes} episodes each, from seed {options.seed}"
    caption = (
        "Medians, but for shares in %. Limit ratio: worst value over its limit in an episode; kept: episodes in which "
        f"it is at most {WITHIN:g}."
    )
    if console.is_terminal:
        console.print(f"[bold]{heading}[/bold]", table, caption, sep="\n", highlight=False)
        return
    table.box = box.MARKDOWN
    wide = Console(file=console.file, width=1000)  # a line of Markdown must not be broken
    wide.print(f"### {heading}", table, caption, sep="\n")


def _check(options: PayloadOptions) -> None:
    """Make everything once, so that what is wrong is said before the first episode."""
    refuse_unknown([options.env], known_env_ids(), "environment")
    refuse_unknown(options.policies, expert_names(options.env), "expert")
    if options.episodes < 1:
        raise ValueError(f"episodes {options.episodes} must be at least 1")
    if not options.masses or not options.policies:
        raise ValueError("give at least one mass and one policy")
    for mass in options.masses:
        with closing(gym.make_vec(options.env, num_envs=1, payload=mass)) as env:
            for name in options.policies:
                envs.make_expert(name, env, adaptive=True)


def _rows(options: PayloadOptions) -> Iterator[Row]:
    seeds = range(options.seed, options.seed + options.episodes)
    for mass in options.masses:
        for name in options.policies:
            for full_name in (name, name + ADAPTIVE):
                yield Row(mass, evaluate(full_name, options.env, seeds, env_config={"payload": mass}))


def _percent(told: NDArray[Any]) -> str:
    return f"{100.0 * np.mean(told):.1f}"


def _cell(values: NDArray[Any], factor: float) -> str:
    return _percent(values) if values.dtype == bool else shown_number(float(np.median(values)) * factor)


def _document(options: PayloadOptions, rows: list[Row]) -> dict[str, Any]:
    return {
        "command": "planarm payload",
        "options": {**vars(options), "json": None},
        "versions": versions(),
        "machine": machine(),
        "rows": [
            {
                "payload": row.mass,
                "policy": row.evaluation.policy,
                "episodes": {
                    "seed": row.evaluation.seeds,
                    "return": row.evaluation.returns,
                    "length": row.evaluation.lengths,
                    **row.evaluation.metrics,
                },
            }
            for row in rows
        ],
    }
