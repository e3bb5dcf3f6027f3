"""A benchmark under way: policies x tasks on the same seeds, their bounds and their comparisons in pairs."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import envs
from agents.compile_ahead import CompileAhead, Job
from agents.environments import check_names, make_batch, make_one, task_type
from agents.evaluation.benchmark_config import SHIPPED_CONFIG, BenchmarkConfig, BenchmarkTask
from agents.evaluation.evaluate import Progress, evaluate
from agents.evaluation.leaderboard import TaskResult
from agents.evaluation.replays import record_replays, replays_of
from agents.evaluation.results import Evaluation
from agents.evaluation.scoreboard import Scoreboard, add_settings
from agents.evaluation.spread import BOUNDS, Kind, Piece, Workers
from agents.policies.lookup import AnyPolicy, NamedPolicy, is_shipped, name_policies
from agents.policies.policy import Actor
from agents.yaml_config import load_config
from envs.card import Bound
from envs.experts import expert_names
from planners import Infeasible
from planners.typing import Array

WARM_UP = 2  # episodes that are run before any that counts


@dataclass
class Benchmark:
    """A benchmark: `board` holds what is finished, also after an interruption.

    Attributes:
        config: what to run.
        compared: names of the policies that are compared with all others in pairs; if None, those that are no experts
            and those that are the user's own.
        allow_code: whether models of Stable-Baselines3 may be loaded.
        given: policies that are no names or paths, by the names that ``config`` has for them.
        seeds: of the episodes of tasks, by title, in place of the seeds that follow from ``config``.
        workers: of a cluster, over which everything is spread; this process does it all without. They know what
            ``config`` names, not what is ``given``.
        board: the results.
    """

    config: BenchmarkConfig
    compared: tuple[str, ...] | None = None
    allow_code: bool = False
    given: Mapping[str, AnyPolicy] = field(default_factory=dict)
    seeds: Mapping[str, NDArray[np.int64]] = field(default_factory=dict)
    workers: Workers | None = None
    board: Scoreboard = field(default_factory=Scoreboard)
    _named: dict[tuple[str, ...], list[NamedPolicy]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.board.config = self.config.model_dump(mode="json")

    @property
    def total_episodes(self) -> int:
        """Episodes to run, and episodes to bound."""
        return sum(
            self._episodes(task) * len(task.policies or self.config.policies) + self._bounded(task)
            for task in self.config.tasks
        )

    @property
    def total_replays(self) -> int:
        """Episodes to record."""
        return sum(
            min(self._episodes(task), self.config.replays) * len(task.policies or self.config.policies)
            for task in self.config.tasks
            if task_type(task.env) is not None
        )

    def policies(self, task: BenchmarkTask) -> list[NamedPolicy]:
        """The policies of a task; raises as `find_policy`."""
        names = task.policies or self.config.policies
        key = (task.env, *names)
        if key not in self._named:
            policies = [self.given.get(name, name) for name in names]
            found = name_policies(policies, task.env, allow_code=self.allow_code)
            self._named[key] = [
                replace(each, name=name) if name in self.given else each
                for name, each in zip(names, found, strict=True)
            ]
        modes = task.control_modes
        return [
            replace(each, action_config={"control_mode": modes[str(each.policy)]})
            if each.is_expert and each.policy in modes
            else each
            for each in self._named[key]
        ]

    def check(self, *, replays: bool = False) -> None:
        """Make every environment and policy once, so that errors come before the first episode.

        Those of the shipped configuration are known to work, and compiled later. With ``replays`` policies also act in
        a single environment, as they will for these.
        """
        shipped = [_starts(task) for task in load_config(SHIPPED_CONFIG, BenchmarkConfig).tasks]
        for task in self.config.tasks:
            envs.task_card(task.env)
            check_names(task.env, task.env_config, task.options)
            known = _starts(task) in shipped
            recorded = replays and self.config.replays > 0 and task_type(task.env) is not None
            for named in self.policies(task):
                named.require_same_episodes(task.env, task.env_config)
                if known and self._comes_with_planarm(task, named):
                    continue
                self._act_once(task, named, single=False)
                if recorded and not named.is_expert:
                    self._act_once(task, named, single=True)

    def _act_once(self, task: BenchmarkTask, named: NamedPolicy, *, single: bool) -> None:
        """Make the environment and the policy, and let it act unless it is an expert; raises what is wrong."""
        settings = named.settings(task.env_config)
        env: Any = make_one(task.env, settings) if single else make_batch(task.env, 1, settings)
        with closing(env):
            observation, _ = env.reset(seed=self.config.seed, options=dict(task.options))
            actor = Actor(named.policy, env, named.name)
            if not named.is_expert:
                actor.act(observation[None] if single else observation, None, np.ones(1, dtype=bool))

    def jobs(self, progress: Progress) -> list[Job]:
        """A little of everything, so that no timing includes compilation; a group a task.

        One environment and several are compiled apart, because their arrays differ in layout.
        """
        jobs = []
        for task in self.config.tasks:
            seeds, bound = self._seeds(task)[:WARM_UP], envs.task_card(task.env).bound
            for named in self.policies(task):
                text = self._job_text(task, named.name, 0) if self._comes_with_planarm(task, named) else None
                jobs.append(Job(task.title, partial(self._evaluate, task, named, seeds, progress), text))
            if bound is not None and self._bounded(task):
                run = partial(self._best_known, task, bound, seeds[:1].tolist(), lambda ended: progress(0))
                jobs.append(Job(task.title, run, self._job_text(task, "random", 1)))
        return jobs

    def fill(
        self,
        begin: Callable[[str], object],
        progress: Progress,
        finished: Callable[[TaskResult], object] = lambda result: None,
        ahead: CompileAhead | None = None,
    ) -> None:
        """Run everything.

        Args:
            begin: called with a description of each evaluation and bound.
            progress: called with the number of episodes that have just ended.
            finished: called with the results of a task when they are whole.
            ahead: compiles the `jobs` of each task before its first episode; times include compilation without it.
        """
        ahead = ahead or CompileAhead([])
        if self.workers is not None:
            self.workers.start([piece for task in self.config.tasks for piece in self._pieces(task)])
        for task in self.config.tasks:
            named = self.policies(task)
            begin(task.title)
            ahead.prepare(task.title, progress)
            compared = [each.name for each in named if each.own or not each.is_expert]
            result = TaskResult(
                task, self._seeds(task), compared=tuple(compared) if self.compared is None else self.compared
            )
            self.board.results.append(result)
            for each in named:
                begin(f"{task.title}: {each.name}")
                with ahead.paused():
                    result.evaluations.append(Evaluation.joined(self._results(self._episodes_of(task, each), progress)))
                add_settings(result, each)
            if self._bounded(task):
                begin(f"{task.title}: bound")
                result.bounds, result.lower = np.concatenate(self._results(self._bounds_of(task), progress)).T
                result.bound_by_policies()
            finished(result)
        self.board.complete = True

    def record(self, begin: Callable[[str], object], progress: Progress) -> None:
        """Record replays of what `fill` has scored, of the seeds that `seeds_to_record` chooses."""
        for result in self.board.results:
            begin(f"{result.task.title}: replays")
            result.replays = record_replays(
                result, self.config.replays, partial(self._replays_on, result.task, progress=progress)
            )

    def do(self, piece: Piece, progress: Progress = lambda ended: None) -> Any:
        """Do a piece in this process: an `Evaluation`, bounds, or the documents of replays."""
        task = next(task for task in self.config.tasks if task.title == piece.task)
        seeds = np.array(piece.seeds, dtype=np.int64)
        if piece.kind == "bounds":
            bound = envs.task_card(task.env).bound
            assert bound is not None
            return self._best_known(task, bound, seeds.tolist(), progress)
        named = next(each for each in self.policies(task) if each.name == piece.policy)
        if piece.kind == "replay":
            return replays_of(task, named, seeds.tolist(), progress)
        return self._evaluate(task, named, seeds, progress)

    def _results(self, pieces: Sequence[Piece], progress: Progress) -> list[Any]:
        """What pieces give, in their order."""
        if self.workers is not None:
            return self.workers.results(pieces, progress)
        return [self.do(piece, progress) for piece in pieces]

    def _pieces(self, task: BenchmarkTask) -> list[Piece]:
        """The pieces of a task without its replays, in the order in which they are needed."""
        episodes = [piece for named in self.policies(task) for piece in self._episodes_of(task, named)]
        return episodes + self._bounds_of(task)

    def _episodes_of(self, task: BenchmarkTask, named: NamedPolicy) -> list[Piece]:
        """The episodes of a policy, a piece a batch; one piece where this process does them all."""
        return self._cut("episodes", task, named.name, self._seeds(task), self.config.num_envs)

    def _bounds_of(self, task: BenchmarkTask) -> list[Piece]:
        return self._cut("bounds", task, "", self._seeds(task)[: self._bounded(task)], BOUNDS)

    def _replays_on(self, task: BenchmarkTask, seeds: Sequence[int], progress: Progress) -> list[dict[str, Any]]:
        """The replays of every policy of a task on some seeds."""
        pieces = [
            piece
            for named in self.policies(task)
            for piece in self._cut("replay", task, named.name, np.array(seeds), 1)
        ]
        return [episode for episodes in self._results(pieces, progress) for episode in episodes]

    def _cut(self, kind: Kind, task: BenchmarkTask, policy: str, seeds: NDArray[np.int64], size: int) -> list[Piece]:
        """Pieces of so many episodes; a single one without workers."""
        numbers = seeds.tolist()
        size = size if self.workers is not None else max(1, len(numbers))
        return [
            Piece(kind, task.title, policy, tuple(numbers[first : first + size]))
            for first in range(0, len(numbers), size)
        ]

    def _comes_with_planarm(self, task: BenchmarkTask, named: NamedPolicy) -> bool:
        """Whether a policy is one of the task's experts or its shipped agent, by name."""
        if named.name in self.given or named.own:
            return False
        return is_shipped(named.name) or (named.policy == named.name and named.name in expert_names(task.env))

    def _job_text(self, task: BenchmarkTask, policy: str, bounds: int) -> str:
        """A job for another process: a policy on a task, and its bound."""
        alone = {**task.model_dump(mode="json"), "policies": [policy], "bound_episodes": None}
        episodes = min(WARM_UP, self._episodes(task))
        config = {"policies": [policy], "tasks": [{**alone, "episodes": episodes}], "bound_episodes": bounds}
        seed = {"episodes": episodes, "seed": self.config.seed, "num_envs": self.config.num_envs}
        return f"{__name__}:run_job {json.dumps({**config, **seed})}"

    def _evaluate(
        self, task: BenchmarkTask, named: NamedPolicy, seeds: NDArray[np.int64], progress: Progress
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

    def _best_known(self, task: BenchmarkTask, bound: Bound, seeds: list[int], progress: Progress) -> Array:
        """Best known value and lower bound of the metric for each seed's start, ``(episodes, 2)``.

        inf where no value is known, NaN where no lower bound is.
        """
        with closing(make_batch(task.env, len(seeds), task.env_config)) as env:
            batch: Any = env.unwrapped
            batch.reset(seed=seeds, options=dict(task.options))
            values = np.tile([np.inf, np.nan], (len(seeds), 1))
            for env_index, seed in enumerate(seeds):
                if bound.lower is not None:
                    values[env_index, 1] = bound.lower(batch, env_index, seed)
                with suppress(Infeasible):
                    values[env_index, 0] = bound.optimum(batch, env_index, seed)
                progress(1)
        return values

    def _seeds(self, task: BenchmarkTask) -> NDArray[np.int64]:
        return self.seeds.get(task.title, self.config.seed + np.arange(self._episodes(task)))

    def _episodes(self, task: BenchmarkTask) -> int:
        return task.episodes or self.config.episodes

    def _bounded(self, task: BenchmarkTask) -> int:
        """Number of episodes whose bound is computed."""
        wanted = self.config.bound_episodes if task.bound_episodes is None else task.bound_episodes
        return min(self._episodes(task), wanted) if envs.task_card(task.env).bound is not None else 0


def run_job(text: str) -> None:
    """Run a small benchmark, given as JSON, for what it compiles: its bounds, or else its policies."""
    benchmark = Benchmark(BenchmarkConfig.parse(json.loads(text), "benchmark setting"))
    for job in benchmark.jobs(lambda ended: None)[-1:]:
        job.run()


def _starts(task: BenchmarkTask) -> tuple[Any, ...]:
    """What decides which starts a task has."""
    return task.env, task.env_config, task.options
