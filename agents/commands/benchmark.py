"""`planarm benchmark`: policies x tasks on the same seeds, a progress bar, and the leaderboard."""

from __future__ import annotations

import shlex
import sys
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import tyro

from agents.console import INTERRUPTED, catch_interrupt, note, progress_bar
from agents.evaluation.benchmark import Benchmark
from agents.evaluation.benchmark_config import SHIPPED_CONFIG, BenchmarkConfig, configure
from agents.yaml_config import assigned
from planners.files import write_json


@dataclass(frozen=True)
class BenchmarkOptions:
    """Score policies on tasks and print the leaderboard, beside the best known optimum and published figures.

    Learnt policies and your own are compared with each other one in pairs, on the same episodes. Takes some minutes.
    Ctrl-C prints what is finished. Where the output is no terminal, tables are Markdown.

    For example:

        $ planarm benchmark
        $ planarm benchmark --policies dpct follower --episodes 1000 --json runs/leaderboard.json
        $ planarm benchmark --policies agent apf runs/mine --tasks ObstacleDodge-v0
        $ planarm benchmark --policies my_module:make_policy model.zip dpct --tasks ConveyorTrack-v0 --allow-code
        $ planarm benchmark --tasks my_module:MyTask-v0 --options distance=0.3
    """

    config: str = SHIPPED_CONFIG
    """Name of a shipped configuration (configs/), or a path to a YAML file of the same form."""
    episodes: int | None = None
    """Episodes of each policy on each task."""
    bound_episodes: int | None = None
    """Number of episodes whose best known optimum is computed."""
    seed: int | None = None
    """Seed of the first episode; each further episode has the next."""
    policies: tuple[str, ...] | None = None
    """Names of experts; agent for the trained agent that comes with planarm; the path of a run, an agent or a .zip;
    module:name for your own planner, policy, or function that makes one."""
    tasks: tuple[str, ...] | None = None
    """Names of tasks of the configuration, to run these alone; or ids of other environments, module:id for yours."""
    settings: tuple[str, ...] = ()
    """key=value for each setting of the environments to change from its default, such as payload=0.3."""
    options: tuple[str, ...] = ()
    """key=value for each option of the reset, such as belt_speed=0.2."""
    num_envs: int | None = None
    """Episodes that run at once."""
    json: Path | None = None
    """Write every episode, with versions and seeds, to this file."""
    allow_code: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Load a Stable-Baselines3 .zip, and the statistics beside it, although any code in them is run."""

    def resolve(self) -> BenchmarkConfig:
        """The configuration with the changes of the command line."""
        changes: dict[str, Any] = {
            name: getattr(self, name)
            for name in ("episodes", "bound_episodes", "seed", "policies", "num_envs")
            if getattr(self, name) is not None
        }
        changes |= {"env_config": assigned({}, self.settings), "options": assigned({}, self.options)}
        return configure(self.config, changes, self.tasks)


def run(options: BenchmarkOptions) -> int:
    """Run the benchmark, print the leaderboard, write the JSON; the exit code."""
    return run_and_print(Benchmark(options.resolve(), allow_code=options.allow_code), options.json)


def run_and_print(benchmark: Benchmark, json: Path | None) -> int:
    """Run a benchmark with a progress bar, write every episode to ``json``, print its tables; the exit code."""
    started, board = datetime.now(UTC), benchmark.board
    if code := _run_with_bar(benchmark):
        note("interrupted: what follows is what was finished", "yellow")
    if json is not None:
        origin = {"command": shlex.join(["planarm", *sys.argv[1:]]), "started": started.isoformat("T", "seconds")}
        write_json(json, {**origin, **board.document()})
        note(f"wrote {json}")
    for assumption in dict.fromkeys(line for result in board.results for line in result.assumptions):
        note(f"{assumption}, such as --settings control_mode=jerk", "yellow")
    board.show()
    return code


def _run_with_bar(benchmark: Benchmark) -> int:
    """Run a benchmark until all is done, or Ctrl-C or SIGTERM stops it; the exit code."""
    with suppress(KeyboardInterrupt), catch_interrupt(at_once=True) as interrupts, progress_bar("episodes") as bar:
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
        return 0
    return (interrupts or [INTERRUPTED])[0]
