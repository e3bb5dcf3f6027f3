"""A benchmark under way: policies x tasks on the same seeds, their bounds and their comparisons in pairs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import closing, suppress
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import envs
from agents.environments import check_names, make_batch, task_type
from agents.evaluation.benchmark_config import BenchmarkConfig, BenchmarkTask
from agents.evaluation.evaluate import Progress, evaluate
from agents.evaluation.leaderboard import TaskResult
from agents.evaluation.replays import record_replays
from agents.evaluation.results import Evaluation
from agents.evaluation.scoreboard import Scoreboard, add_settings
from agents.policies.lookup import AnyPolicy, NamedPolicy, name_policies
from agents.policies.policy import Actor
from envs.card import Bound
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
        board: the results.
    """

    config: BenchmarkConfig
    compared: tuple[str, ...] | None = None
    allow_code: bool = False
    given: Mapping[str, AnyPolicy] = field(default_factory=dict)
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
                each if isinstance(policy, str) and policy == name else replace(each, name=name)
                for name, policy, each in zip(names, policies, found, strict=True)
            ]
        return self._named[key]

    def check(self) -> None:
        """Make every environment and policy once, so that errors come before the first episode."""
        for task in self.config.tasks:
            envs.task_card(task.env)
            check_names(task.env, task.env_config, task.options)
            for named in self.policies(task):
                with closing(make_batch(task.env, 1, named.settings(task.env_config))) as env:
                    observation, _ = env.reset(seed=self.config.seed, options=dict(task.options))
                    actor = Actor(named.policy, env, named.name)
                    if not named.is_expert:
                        actor.act(observation, None, np.ones(1, dtype=bool))

    def warm_up(self, progress: Progress) -> None:
        """Run a little of everything, so that no timing includes compilation.

        One environment and several are compiled apart, because their arrays differ in layout.
        """
        for task in self.config.tasks:
            for named in self.policies(task):
                self._evaluate(task, named, self._seeds(task)[:WARM_UP], progress)

    def fill(self, begin: Callable[[str], object], progress: Progress) -> None:
        """Run everything; ``begin`` is called with a description of each evaluation and bound."""
        for task in self.config.tasks:
            seeds, bound = self._seeds(task), envs.task_card(task.env).bound
            named = self.policies(task)
            compared = [each.name for each in named if each.own or not each.is_expert]
            result = TaskResult(task, seeds, compared=tuple(compared) if self.compared is None else self.compared)
            self.board.results.append(result)
            for each in named:
                begin(f"{task.title}: {each.name}")
                result.evaluations.append(self._evaluate(task, each, seeds, progress))
                add_settings(result, each)
            if bound is not None and self._bounded(task):
                begin(f"{task.title}: bound")
                result.bounds = self._best_known(task, bound, seeds[: self._bounded(task)].tolist(), progress)
        self.board.complete = True

    def record(self, begin: Callable[[str], object], progress: Progress) -> None:
        """Record replays of what `fill` has scored, of the seeds that `seeds_to_record` chooses."""
        for result in self.board.results:
            begin(f"{result.task.title}: replays")
            result.replays = record_replays(result, self.policies(result.task), self.config.replays, progress)

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
        """The best known value of the bounded metric for each seed's start, ``(episodes,)``; inf if none is known."""
        with closing(make_batch(task.env, len(seeds), task.env_config)) as env:
            batch: Any = env.unwrapped
            batch.reset(seed=seeds, options=dict(task.options))
            values = np.full(len(seeds), np.inf)
            for env_index, seed in enumerate(seeds):
                with suppress(Infeasible):
                    values[env_index] = bound.optimum(batch, env_index, seed)
                progress(1)
        return values

    def _seeds(self, task: BenchmarkTask) -> NDArray[np.int64]:
        return self.config.seed + np.arange(self._episodes(task))

    def _episodes(self, task: BenchmarkTask) -> int:
        return task.episodes or self.config.episodes

    def _bounded(self, task: BenchmarkTask) -> int:
        """Number of episodes whose bound is computed."""
        wanted = self.config.bound_episodes if task.bound_episodes is None else task.bound_episodes
        return min(self._episodes(task), wanted) if envs.task_card(task.env).bound is not None else 0
