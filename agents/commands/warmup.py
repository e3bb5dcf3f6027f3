"""`planarm warmup`: compile ahead of the first run."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import tyro

from agents.compile_ahead import CompileAhead
from agents.console import COMPILING, INTERRUPTED, catch_interrupt, progress_bar, say, show_compiling
from agents.environments import import_env
from agents.evaluation.benchmark import Benchmark
from agents.evaluation.benchmark_config import SHIPPED_CONFIG, configure
from planners.compile_cache import cache_place


@dataclass(frozen=True)
class WarmupOptions:
    """Compile what planarm benchmark needs, or some environments with their policies, on two processors.

    Compiled functions are kept for all later runs and programs, until planarm or Numba change. NUMBA_CACHE_DIR chooses
    another folder for them.

    For example:

        $ planarm warmup
        $ planarm warmup ConveyorTrack-v0 ObstacleDodge-v0
    """

    envs: tyro.conf.Positional[tuple[str, ...]] = ()
    """Ids of environments, module:id for your own; by default all that planarm benchmark runs."""


def run(options: WarmupOptions) -> int:
    """Compile, and say how much that was; the exit code."""
    named = tuple(map(import_env, options.envs))
    benchmark = Benchmark(configure(SHIPPED_CONFIG, {}, named or None, full=False))
    code = INTERRUPTED
    with suppress(KeyboardInterrupt), catch_interrupt(at_once=True) as interrupts:
        benchmark.check()
        _compile(benchmark, interrupts)
        code = 0
    count = COMPILING.functions
    done = f"compiled {count} functions" if count or code else "everything is compiled already"
    say(f"{'interrupted: ' if code else ''}{done}, {cache_place()}")
    return (interrupts or [code])[0]


def _compile(benchmark: Benchmark, interrupts: Sequence[int]) -> None:
    """Run the jobs of all tasks, with a progress bar."""

    def check(ended: int = 0) -> None:
        if interrupts:  # one that fell into a callback from C was printed there and lost
            raise KeyboardInterrupt

    with progress_bar("tasks") as bar, show_compiling(bar) as begin:
        task = bar.add_task("", total=len(benchmark.config.tasks))
        with CompileAhead(benchmark.jobs(check), COMPILING.advance) as ahead:
            for each in benchmark.config.tasks:
                begin(each.title)
                ahead.prepare(each.title, check)
                bar.advance(task)
