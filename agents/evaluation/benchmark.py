"""A benchmark under way: policies x tasks on the same seeds, their bounds and their comparisons in pairs."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import dataclass, field
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import envs
from agents.evaluation.benchmark_config import BenchmarkConfig, BenchmarkTask
from agents.evaluation.compare import Pair, as_documents, compare_all
from agents.evaluation.evaluate import Evaluation, Progress, as_policy, evaluate
from agents.evaluation.leaderboard import TaskResult, as_document
from agents.policies.lookup import NamedPolicy, find_policy
from agents.provenance import machine, versions
from envs.card import Bound
from planners import Infeasible
from planners.typing import Array

WARM_UP = 2  # episodes that are run before any that counts


@dataclass
class Benchmark:
    """A benchmark: `results` holds what is finished, also after an interruption.

    ``compared`` names the policies that are compared with all others in pairs; if None, those that are no experts.
    """

    config: BenchmarkConfig
    compared: tuple[str, ...] | None = None
    allow_code: bool = False  # whether models of Stable-Baselines3 may be loaded
    results: list[TaskResult] = field(default_factory=list)
    complete: bool = False

    @property
    def total_episodes(self) -> int:
        """Episodes to run, and episodes to bound."""
        return sum(
            self._episodes(task) * len(task.policies or self.config.policies) + self._bounded(task)
            for task in self.config.tasks
        )

    def policies(self, task: BenchmarkTask) -> list[NamedPolicy]:
        """The policies of a task; raises as `find_policy`."""
        names = task.policies or self.config.policies
        return [find_policy(name, task.env, allow_code=self.allow_code) for name in names]

    def check(self) -> None:
        """Make every environment and policy once, so that errors come before the first episode."""
        for task in self.config.tasks:
            envs.task_card(task.env)
            for named in self.policies(task):
                with closing(gym.make_vec(task.env, num_envs=1, **named.settings(task.env_config))) as env:
                    observation, _ = env.reset(seed=self.config.seed, options=dict(task.options))
                    policy = as_policy(named.policy, env)
                    if not named.is_expert:
                        policy.predict(observation, deterministic=True)

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
            result = TaskResult(task, seeds)
            self.results.append(result)
            for named in self.policies(task):
                begin(f"{task.title}: {named.name}")
                result.evaluations.append(self._evaluate(task, named, seeds, progress))
                if named.action_config:
                    result.action_configs[named.name] = named.action_config
            if bound is not None and self._bounded(task):
                begin(f"{task.title}: bound")
                result.bounds = self._best_known(task, bound, seeds[: self._bounded(task)].tolist(), progress)
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

    def pairs(self, result: TaskResult) -> list[Pair]:
        """The comparisons of a task, of what is finished."""
        learnt = [named.name for named in self.policies(result.task) if not named.is_expert]
        return compare_all(result.evaluations, learnt if self.compared is None else self.compared)

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
        with closing(gym.make_vec(task.env, num_envs=len(seeds), **task.env_config)) as env:
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
