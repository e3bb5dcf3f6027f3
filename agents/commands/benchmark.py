"""`planarm benchmark`: policies x tasks on the same seeds, a progress bar, and the leaderboard."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from agents.console import INTERRUPTED, catch_interrupt, note, progress_bar
from agents.evaluation.benchmark import Benchmark
from agents.evaluation.benchmark_config import BenchmarkConfig
from agents.evaluation.compare import comparison
from agents.evaluation.leaderboard import leaderboard
from agents.files import write_json
from agents.yaml_config import load_config
from envs.experts import ADAPTIVE, expert_names, is_expert
from envs.settings import refuse_unknown


@dataclass(frozen=True)
class BenchmarkOptions:
    """Score policies on tasks and print the leaderboard, beside the best known optimum and published figures.

    Learnt policies are compared with each expert in pairs, on the same episodes. Takes some minutes. Ctrl-C prints
    what is finished. Where the output is no terminal, tables are Markdown.

    For example:

        $ planarm benchmark
        $ planarm benchmark --policies dpct follower --episodes 1000 --json runs/leaderboard.json
        $ planarm benchmark --policies agent apf runs/mine --tasks ObstacleDodge-v0
    """

    config: str = "benchmark"
    """Name of a shipped configuration (configs/), or a path to a YAML file of the same form."""
    episodes: int | None = None
    """Episodes of each policy on each task."""
    bound_episodes: int | None = None
    """Number of episodes whose best known optimum is computed."""
    seed: int | None = None
    """Seed of the first episode; each further episode has the next."""
    policies: tuple[str, ...] | None = None
    """Names of experts; agent for the trained agent that comes with planarm; the path of a run or an agent."""
    tasks: tuple[str, ...] | None = None
    """Names of tasks of the configuration, to run these alone."""
    num_envs: int | None = None
    """Episodes that run at once."""
    json: Path | None = None
    """Write every episode, with versions and seeds, to this file."""

    def resolve(self) -> BenchmarkConfig:
        """The configuration with the changes of the command line."""
        config = load_config(self.config, BenchmarkConfig)
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
            own = [(task, _without_other_experts(self.policies, task.env)) for task in tasks]
            acting = [task.model_copy(update={"policies": policies}) for task, policies in own if policies]
            tasks = tuple(acting) or tuple(task.model_copy(update={"policies": None}) for task in tasks)
        return BenchmarkConfig.parse({**dict(config), **changes, "tasks": tasks}, "benchmark setting")


def _without_other_experts(policies: Sequence[str], env_id: str) -> tuple[str, ...]:
    """The policies that are not experts of other tasks only."""
    here = expert_names(env_id)
    return tuple(name for name in policies if name.removesuffix(ADAPTIVE) in here or not is_expert(name))


def run(options: BenchmarkOptions) -> int:
    """Run the benchmark, print the leaderboard, write the JSON; the exit code."""
    return run_and_print(Benchmark(options.resolve()), options.json)


def run_and_print(benchmark: Benchmark, json: Path | None) -> int:
    """Run a benchmark with a progress bar, print its tables, write every episode to ``json``; the exit code."""
    started = datetime.now(UTC)
    if json is not None:
        json.parent.mkdir(parents=True, exist_ok=True)
    try:
        _run_with_bar(benchmark)
    except KeyboardInterrupt:
        note("interrupted: what follows is what was finished", "yellow")
    for result in benchmark.results:
        if result.evaluations:
            leaderboard(result).show()
        if pairs := benchmark.pairs(result):
            comparison(result.task.env, pairs).show()
    if json is not None:
        origin = {"command": shlex.join(["planarm", *sys.argv[1:]]), "started": started.isoformat("T", "seconds")}
        write_json(json, {**origin, **benchmark.document()})
        note(f"wrote {json}")
    return 0 if benchmark.complete else INTERRUPTED


def _run_with_bar(benchmark: Benchmark) -> None:
    with catch_interrupt(at_once=True) as interrupts, progress_bar("episodes") as bar:
        task = bar.add_task("compiling, on the first run only", total=benchmark.total_episodes)

        def check(ended: int = 0) -> None:
            if interrupts:  # one that fell into a callback from C was printed there and lost
                raise KeyboardInterrupt

        def advance(ended: int) -> None:
            check()
            bar.advance(task, ended)

        benchmark.check()
        benchmark.warm_up(check)
        benchmark.fill(begin=lambda description: bar.update(task, description=description), progress=advance)
        check()
