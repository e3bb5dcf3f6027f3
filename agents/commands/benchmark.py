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

from agents.evaluation.bounds import BOUNDS, best_known
from agents.evaluation.compare import Pair, as_documents, compare_all, print_comparison
from agents.evaluation.evaluate import Evaluation, as_policy, evaluate, known_env_ids
from agents.evaluation.leaderboard import TaskResult, as_document, print_leaderboard
from agents.files import write_json
from agents.policies.lookup import NamedPolicy, find_policy
from agents.provenance import machine, versions
from agents.yaml_config import BenchmarkConfig, BenchmarkTask, load_experiment
from envs.settings import refuse_unknown

INTERRUPTED = 130
"""Exit code of a command that Ctrl-C ended."""

WARM_UP = 2
"""Episodes that are run before any that counts."""


@dataclass(frozen=True)
class BenchmarkOptions:
    """Score policies on tasks and print the leaderboard, beside the best known optimum and published figures.

    What is learnt is compared with each expert in pairs, on the same episodes. Takes about two minutes. Ctrl-C prints
    what is finished. Where the output is no terminal, tables are Markdown.

    For example:

        $ planarm benchmark
        $ planarm benchmark --policies dpct follower --episodes 1000 --json runs/leaderboard.json
        $ planarm benchmark --policies agent apf runs/mine --tasks ObstacleDodge-v0
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
    """Names of experts; agent for the trained agent that comes with planarm; the path of a run or an agent."""
    tasks: tuple[str, ...] | None = None
    """Names of tasks of the experiment, to run these alone."""
    num_envs: int | None = None
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
            for name in ("episodes", "bound_episodes", "seed", "policies", "num_envs")
            if getattr(self, name) is not None
        }
        tasks = config.tasks
        if self.tasks is not None:
            titles = {task.title: task for task in tasks}
            refuse_unknown(self.tasks, titles, "task")
            tasks = tuple(titles[name] for name in self.tasks)
        if self.policies is not None:
            tasks = tuple(task.model_copy(update={"policies": None}) for task in tasks)
        changes["tasks"] = tasks
        return BenchmarkConfig.parse({**dict(config), **changes}, "benchmark setting")


@dataclass
class Benchmark:
    """A benchmark under way: `results` holds what is finished, also after an interruption.

    Attributes:
        config: what is to be done.
        compared: policies that are compared with all others in pairs; if left out, those that are no experts.
        allow_code: whether models of Stable-Baselines3 may be loaded.
        results: one a task.
        complete: whether all is done.
    """

    config: BenchmarkConfig
    compared: tuple[str, ...] | None = None
    allow_code: bool = False
    results: list[TaskResult] = field(default_factory=list)
    complete: bool = False

    @property
    def total_episodes(self) -> int:
        """Episodes to run, and episodes to bound."""
        return sum(self._episodes(task) * len(self._policies(task)) + self._bounded(task) for task in self.config.tasks)

    def check(self) -> None:
        """Make every environment and policy once, so that what is wrong with any is said before the first episode."""
        for task in self.config.tasks:
            refuse_unknown([task.env], known_env_ids(), "environment")
            for named in self.policies(task):
                with closing(gym.make_vec(task.env, num_envs=1, **named.settings(task.env_config))) as env:
                    observation, _ = env.reset(seed=self.config.seed, options=dict(task.options))
                    policy = as_policy(named.policy, env)
                    if not named.is_expert:
                        policy.predict(observation, deterministic=True)

    def warm_up(self, progress: Callable[[int], object]) -> None:
        """Run a little of everything: the first time compiles, and no timing shall hold that.

        One environment and several are compiled apart, because their arrays differ in layout.
        """
        for task in self.config.tasks:
            for named in self.policies(task):
                self._evaluate(task, named, self._seeds(task)[:WARM_UP], progress)

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
            for named in self.policies(task):
                begin(f"{task.title}: {named.name}")
                result.evaluations.append(self._evaluate(task, named, seeds, progress))
                if named.action_config:
                    result.action_configs[named.name] = named.action_config
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
            "results": [{**as_document(result), "pairs": as_documents(self.pairs(result))} for result in self.results],
        }

    def policies(self, task: BenchmarkTask) -> list[NamedPolicy]:
        """Who takes part in a task.

        Raises:
            ValueError: for what is no policy, or none of this environment.
        """
        return [find_policy(name, task.env, allow_code=self.allow_code) for name in self._policies(task)]

    def pairs(self, result: TaskResult) -> list[Pair]:
        """The comparisons of a task, of what is finished."""
        learnt = [named.name for named in self.policies(result.task) if not named.is_expert]
        return compare_all(result, learnt if self.compared is None else self.compared)

    def _evaluate(
        self, task: BenchmarkTask, named: NamedPolicy, seeds: NDArray[np.int64], progress: Callable[[int], object]
    ) -> Evaluation:
        return evaluate(
            named.policy,
            task.env,
            seeds,
            env_config=named.settings(task.env_config),
            options=task.options,
            num_envs=self.config.num_envs,
            progress=progress,
            name=named.name,
        )

    def _policies(self, task: BenchmarkTask) -> tuple[str, ...]:
        return task.policies or self.config.policies

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
    return run_and_print(Benchmark(options.resolve()), options.json)


def run_and_print(benchmark: Benchmark, json: Path | None) -> int:
    """Run a benchmark with a progress bar, print its tables, write every episode to ``json``; the exit code.

    Raises:
        ValueError: as `run`.
    """
    started = datetime.now(UTC)
    if json is not None:
        json.parent.mkdir(parents=True, exist_ok=True)
    try:
        _run_with_bar(benchmark)
    except KeyboardInterrupt:
        Console(stderr=True).print("[yellow]interrupted: what follows is what was finished[/yellow]")
    console = Console()
    for result in benchmark.results:
        if result.evaluations:
            print_leaderboard(console, result)
        if pairs := benchmark.pairs(result):
            print_comparison(console, result.task.env, pairs)
    if json is not None:
        origin = {"command": shlex.join(["planarm", *sys.argv[1:]]), "started": started.isoformat("T", "seconds")}
        write_json(json, {**origin, **benchmark.document()})
        Console(stderr=True).print(f"wrote {json}")
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
