"""`planarm train`."""

from __future__ import annotations

import shlex
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import tyro
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from agents.training.recipe import TrainingConfig
from agents.yaml_config import load_experiment

if TYPE_CHECKING:
    from agents.training.run import TrainingRun
    from agents.training.scores import Row

INTERRUPTED = 130
"""Exit code of a command that Ctrl-C ended."""


@dataclass(frozen=True)
class TrainOptions:
    """Train an agent with PPO; needs pip install "planarm[rl]".

    Ctrl-C ends the run, which --resume takes up at its last checkpoint; so does it after a crash.

    For example:

        $ planarm train ppo/ConveyorTrack-v0 --seed 1
        $ planarm train mine.yaml gamma=0.99 warm_start.episodes=512 --out runs/mine
        $ planarm train --resume runs/mine
    """

    config: tyro.conf.Positional[str | None] = None
    """Name of a shipped experiment (in configs/), or a path to a YAML file of the same form."""
    changes: tyro.conf.Positional[tuple[str, ...]] = ()
    """key=value for each setting to change; dots lead into nested ones, values are YAML."""
    seed: int | None = None
    """Of everything."""
    total_steps: int | None = None
    """Control steps of all environments together."""
    out: Path | None = None
    """Folder of the run; by default runs/ENV-DATE-seedN."""
    resume: Path | None = None
    """Folder of a run to go on with; nothing about it can be changed."""

    def resolve(self) -> TrainingConfig:
        """The experiment with what the command line changes.

        Raises:
            ValueError: for an unknown experiment, setting or value.
        """
        if self.config is None:
            raise ValueError("name an experiment, such as ppo/ConveyorTrack-v0, or a run to --resume")
        named = [f"{name}={value}" for name in ("seed", "total_steps") if (value := getattr(self, name)) is not None]
        return load_experiment(self.config, TrainingConfig).overridden([*self.changes, *named])

    def make_run(self) -> TrainingRun:
        """The run to go on with, or a new one.

        Raises:
            ValueError: for options that do not go together, or that a run cannot begin with.
            ModuleNotFoundError: without the `rl` extra.
        """
        if self.resume is not None:
            if self.config is not None or self.seed is not None or self.total_steps is not None or self.out is not None:
                raise ValueError("--resume takes no other options: a run goes on with what it began with")
            return _runs().resume(self.resume)
        config = self.resolve()
        name = f"{config.env}-{datetime.now():%Y%m%d-%H%M%S}-seed{config.seed}"
        return _runs().begin(self.out or Path("runs") / name, config, shlex.join(["planarm", *sys.argv[1:]]))


def run(options: TrainOptions) -> int:
    """Train; the exit code.

    Raises:
        ValueError: for anything unknown or impossible, before the first step.
        ModuleNotFoundError: without the `rl` extra.
    """
    training = options.make_run()
    with _stoppable() as stopped:
        finished = _train_with_bar(training, stopped)
    console = Console(stderr=True)
    if not finished:
        console.print(
            f"stopped; continue from {training.steps:,} steps: planarm train --resume {training.folder}",
            soft_wrap=True,
        )
        return INTERRUPTED
    console.print(f"{training.steps:,} steps; the best agent is {training.folder}/best.safetensors", soft_wrap=True)
    return 0


def _runs() -> type[TrainingRun]:
    try:
        from agents.training.run import TrainingRun
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(f'training needs pip install "planarm[rl]" ({error})') from None
    return TrainingRun


@contextmanager
def _stoppable() -> Iterator[list[bool]]:
    """Ctrl-C as a wish, which holds until the current step is done; a second one interrupts at once."""
    wishes: list[bool] = []

    def wish(signal_number: int, frame: object) -> None:
        if wishes:
            raise KeyboardInterrupt
        wishes.append(True)

    before = signal.signal(signal.SIGINT, wish)
    try:
        yield wishes
    finally:
        signal.signal(signal.SIGINT, before)


def _train_with_bar(training: TrainingRun, stopped: list[bool]) -> bool:
    from agents.training.run import Watcher

    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("steps, {task.fields[rate]}/s"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[scores]}"),
    )
    bar = Progress(*columns, console=console, disable=not console.is_terminal)
    task = bar.add_task("beginning", total=training.config.total_steps, rate="-", scores="")

    def step(steps: int) -> None:
        speed = bar.tasks[0].speed
        bar.update(task, completed=steps, rate=f"{speed:,.0f}" if speed else "-")

    def evaluated(row: Row) -> None:
        bar.update(task, scores=_scores(row))
        if not console.is_terminal:
            console.print(f"{row['steps']:,} steps, {row['seconds']:.0f} s: {_scores(row)}", soft_wrap=True)

    watcher = Watcher(
        begin=lambda line: bar.update(task, description=line),
        step=step,
        evaluated=evaluated,
        stop=lambda: bool(stopped),
    )
    with bar:
        return training.train(watcher)


def _scores(row: Row) -> str:
    """The agent's success and return, beside the best expert's on the same seeds."""
    expert = row["expert"]
    return (
        f"success {row['success']:.0%} ({expert} {row['expert_success']:.0%}), "
        f"return {row['return']:.3f} ({expert} {row['expert_return']:.3f})"
    )
