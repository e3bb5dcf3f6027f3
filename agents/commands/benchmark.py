"""`planarm benchmark`: policies x tasks on the same seeds, a progress bar, and the leaderboard."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import tyro

from agents.cluster import connected
from agents.evaluation.benchmark import Benchmark
from agents.evaluation.benchmark_config import SHIPPED_CONFIG, BenchmarkConfig, configure
from agents.evaluation.worker import workers_of
from agents.report.outputs import ScoreOutputs, run_and_print
from agents.yaml_config import assigned


@dataclass(frozen=True)
class BenchmarkOptions(ScoreOutputs):
    """Score policies on tasks and print the leaderboard, beside the best known optimum and published figures.

    Learnt policies and your own are compared with each other one in pairs, on the same episodes. Without --full these
    are the first episodes of the published leaderboard, with wider intervals. Each task is printed when it is
    finished; Ctrl-C prints what is. A terminal shows as many columns as it is wide; a pipe or a file gets Markdown.

    For example:

        $ planarm benchmark
        $ planarm benchmark --full
        $ planarm benchmark --report report.html
        $ planarm benchmark --policies dpct follower --episodes 1000 --json runs/leaderboard.json
        $ planarm benchmark --policies agent apf runs/mine --tasks ObstacleDodge-v0
        $ planarm benchmark --policies my_module:make_policy model.zip dpct --tasks ConveyorTrack-v0 --allow-code
        $ planarm benchmark --tasks my_module:MyTask-v0 --options distance=0.3
        $ planarm benchmark --config levels --tasks ObstacleDodge-v0/fast
        $ planarm benchmark --config levels --tasks MinTorqueMove-v0
        $ planarm benchmark --tasks MinTorqueMove-v0 --level vertical
        $ planarm benchmark --full --num-envs 25 --address auto --json runs/leaderboard.json
    """

    config: str = SHIPPED_CONFIG
    """Name of a shipped configuration (configs/), or a path to a YAML file of the same form."""
    full: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Run the whole configuration, as in the published leaderboard, and not its quick part."""
    episodes: int | None = None
    """Episodes of each policy on each task; if left out, those of the configuration: 32 in the leaderboard's, or 128
    with --full."""
    bound_episodes: int | None = None
    """Number of episodes whose best known optimum is computed; if left out, 16 in the leaderboard's, or 128 with
    --full."""
    seed: int | None = None
    """Seed of the first episode; each further episode has the next. If left out, that of the configuration, 0."""
    policies: tuple[str, ...] | None = None
    """Names of experts; agent for the trained agent that comes with planarm; the path of a run, an agent or a .zip;
    module:name for your own planner, policy, or function that makes one."""
    tasks: tuple[str, ...] | None = None
    """Names of tasks of the configuration, to run these alone; an environment's id for all of its levels in a
    configuration of levels; or ids of other environments, module:id for yours."""
    level: str | None = None
    """Difficulty level of every task, from its card (docs/benchmark/levels.md)."""
    settings: tuple[str, ...] = ()
    """key=value for each setting of the environments to change from its default, such as payload=0.3."""
    options: tuple[str, ...] = ()
    """key=value for each option of the reset, such as belt_speed=0.2."""
    num_envs: int | None = None
    """Episodes that run at once; if left out, 64 in the leaderboard's configuration."""
    address: str | None = None
    """Spread the episodes over the workers of Ray: local for one a processor of this machine, auto for the cluster that
    it belongs to, host:port of a cluster's head. Scores are the same to the bit; needs pip install
    "planarm[cluster]"."""
    allow_code: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Load a Stable-Baselines3 .zip, and the statistics beside it, although any code in them is run."""

    def resolve(self) -> BenchmarkConfig:
        """The configuration with the changes of the command line."""
        changes: dict[str, Any] = {
            name: getattr(self, name)
            for name in ("episodes", "bound_episodes", "seed", "policies", "level", "num_envs", "replays")
            if getattr(self, name) is not None
        }
        changes |= {"env_config": assigned({}, self.settings), "options": assigned({}, self.options)}
        return configure(self.config, changes, self.tasks, full=self.full)

    def shortness(self, config: BenchmarkConfig) -> str:
        """A sentence that says of which benchmark this is a part; empty if it is a whole one or one of its own."""
        quick = config.quick
        if self.full or quick is None or self.episodes is not None:
            return ""
        whole = configure(self.config, {}, full=True).episodes
        return (
            f"A quick benchmark: the first {config.episodes} of {whole} episodes, so the intervals are wider; "
            "planarm benchmark --full runs them all."
        )


def run(options: BenchmarkOptions) -> int:
    """Run the benchmark, print the leaderboard, write what is asked for; the exit code."""
    config = options.resolve()
    benchmark = Benchmark(config, allow_code=options.allow_code)
    if options.address is None:
        return run_and_print(benchmark, options, options.shortness(config))
    with connected(options.address) as ray:
        benchmark.workers = workers_of(ray, benchmark)
        return run_and_print(benchmark, options, options.shortness(config))
