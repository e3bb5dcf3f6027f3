"""`planarm benchmark`: policies x tasks on the same seeds, a progress bar, and the leaderboard."""

from __future__ import annotations

import shlex
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

import envs
from agents.bounds import BOUNDS, best_known
from agents.evaluation import Evaluation, evaluate, known_env_ids
from agents.experiment import BenchmarkConfig, BenchmarkTask, load_experiment
from agents.files import write_json
from agents.leaderboard import TaskResult, as_document, print_leaderboard
from agents.provenance import machine, versions
from envs.settings import refuse_unknown

INTERRUPTED = 130
"""Exit code of a command that Ctrl-C ended."""

WARM_UP = 2
"""Episodes that are run before any that counts."""


@dataclass(frozen=True)
class BenchmarkOptions:
    """Score policies on tasks and print the leaderboard, beside the best known optimum and published figures.

    Takes about a minute. Ctrl-C prints what is finished. Where the output is no terminal, tables are Markdown.

    For example:

        $ planarm benchmark
        $ planarm benchmark --policies dpct follower --episodes 1000 --json runs/leaderboard.json
    """

    config: str = "benchmark"
    """Name of a shipped experiment (configs/), or a path to a YAML file of the same form."""
    episodes: int | None = None
    """Episodes of each policy on each task."""
    bound_episodes: int | None = None
    """For how many of them the best known optimum is computed."""
    seed: int | None = None
    """Seed of the first episode; the next episode has the next."""
    policies: tuple[str, ...] | None = None
    """Names of experts."""
    tasks: tuple[str, ...] | None = None
    """Names of tasks of the experiment, to run these alone."""
    lanes: int | None = None
    """Episodes that run at once."""
    json: Path | None = None
    """Write every episode, with versions and seeds, to this file."""

    def resolve(self) -> BenchmarkConfig:
        """The experiment with what the command line changes.

        Raises:
            ValueError: for an unknown experiment, task or value.
        """
        config = load_experiment(self.config, BenchmarkConfig)
        changes: dict[str, Any] = {
            name: getattr(self, name)
            for name in ("episodes", "bound_episodes", "seed", "policies", "lanes")
            if getattr(self, name) is not None
        }
        if self.tasks is not None:
            titles = {task.title: task for task in config.tasks}
            refuse_unknown(self.tasks, titles, "task")
            changes["tasks"] = tuple(titles[name] for name in self.tasks)
        return BenchmarkConfig.parse({**dict(config), **changes}, "benchmark setting")


@dataclass
class Benchmark:
    """A benchmark under way: `results` holds what is finished, also after an interruption."""

    config: BenchmarkConfig
    results: list[TaskResult] = field(default_factory=list)
    complete: bool = False

    @property
    def total_episodes(self) -> int:
        """Episodes to run, and episodes to bound."""
        policies = len(self.config.policies)
        return sum(self._episodes(task) * policies + self._bounded(task) for task in self.config.tasks)

    def check(self) -> None:
        """Make every environment and policy once, so that what is wrong with any is said before the first episode."""
        for task in self.config.tasks:
            refuse_unknown([task.env], known_env_ids(), "environment")
            with closing(gym.make_vec(task.env, num_envs=1, **task.env_config)) as env:
                env.reset(seed=self.config.seed, options=dict(task.options))
                for policy in self.config.policies:
                    envs.make_expert(policy, env)

    def warm_up(self, progress: Callable[[int], object]) -> None:
        """Run a little of everything: the first time compiles, and no timing shall hold that.

        One lane and several are compiled apart, because their arrays differ in layout.
        """
        for task in self.config.tasks:
            for policy in self.config.policies:
                self._evaluate(task, policy, self._seeds(task)[:WARM_UP], progress)

    def fill(self, begin: Callable[[str], object], progress: Callable[[int], object]) -> None:
        """Run everything.

        Args:
            begin: called with a description of what begins.
            progress: called with the number of episodes that have just ended.
        """
        for task in self.config.tasks:
            seeds = self._seeds(task)
            result = TaskResult(task, seeds)
            self.results.append(result)
            for policy in self.config.policies:
                begin(f"{task.title}: {policy}")
                result.evaluations.append(self._evaluate(task, policy, seeds, progress))
            if self._bounded(task):
                begin(f"{task.title}: bound")
                result.bounds = best_known(
                    task.env,
                    seeds[: self._bounded(task)].tolist(),
                    env_config=task.env_config,
                    options=task.options,
                    progress=progress,
                )
        self.complete = True

    def document(self) -> dict[str, Any]:
        """Everything, for JSON."""
        return {
            "complete": self.complete,
            "versions": versions(),
            "machine": machine(),
            "config": self.config.model_dump(mode="json"),
            "results": [as_document(result) for result in self.results],
        }

    def _evaluate(
        self, task: BenchmarkTask, policy: str, seeds: NDArray[np.int64], progress: Callable[[int], object]
    ) -> Evaluation:
        return evaluate(
            policy,
            task.env,
            seeds,
            env_config=task.env_config,
            options=task.options,
            lanes=self.config.lanes,
            progress=progress,
        )

    def _seeds(self, task: BenchmarkTask) -> NDArray[np.int64]:
        return self.config.seed + np.arange(self._episodes(task))

    def _episodes(self, task: BenchmarkTask) -> int:
        return task.episodes or self.config.episodes

    def _bounded(self, task: BenchmarkTask) -> int:
        wanted = self.config.bound_episodes if task.bound_episodes is None else task.bound_episodes
        return min(self._episodes(task), wanted) if task.env in BOUNDS else 0


def run(options: BenchmarkOptions) -> int:
    """Run the benchmark, print the leaderboard, write the JSON; the exit code.

    Raises:
        ValueError: for anything unknown or impossible, before the first episode.
    """
    started = datetime.now(UTC)
    benchmark = Benchmark(options.resolve())
    if options.json is not None:
        options.json.parent.mkdir(parents=True, exist_ok=True)
    try:
        _run_with_bar(benchmark)
    except KeyboardInterrupt:
        Console(stderr=True).print("[yellow]interrupted: what follows is what was finished[/yellow]")
    console = Console()
    for result in benchmark.results:
        if result.evaluations:
            print_leaderboard(console, result)
    if options.json is not None:
        origin = {"command": shlex.join(["planarm", *sys.argv[1:]]), "started": started.isoformat("T", "seconds")}
        write_json(options.json, {**origin, **benchmark.document()})
        Console(stderr=True).print(f"wrote {options.json}")
    return 0 if benchmark.complete else INTERRUPTED


@contextmanager
def _lasting_interrupt() -> Iterator[Callable[[], None]]:
    """Ctrl-C as ever, and a check that raises it again: one that falls into a callback from C is printed and lost."""
    interrupted = False

    def interrupt(signal_number: int, frame: object) -> None:
        nonlocal interrupted
        interrupted = True
        raise KeyboardInterrupt

    def check() -> None:
        if interrupted:
            raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, interrupt)
    try:
        yield check
    finally:
        signal.signal(signal.SIGINT, before)


def _run_with_bar(benchmark: Benchmark) -> None:
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("episodes"),
        TimeElapsedColumn(),
    )
    console = Console(stderr=True)
    bar = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
    with _lasting_interrupt() as check, bar:
        task = bar.add_task("compiling, on the first run only", total=benchmark.total_episodes)

        def advance(ended: int) -> None:
            check()
            bar.advance(task, ended)

        benchmark.check()
        benchmark.warm_up(lambda ended: check())
        benchmark.fill(begin=lambda description: bar.update(task, description=description), progress=advance)
        check()
