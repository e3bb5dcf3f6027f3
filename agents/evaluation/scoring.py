"""`agents.compare` and `agents.leaderboard`: several policies on one task, or a whole benchmark, from Python."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.environments import import_env, portable
from agents.evaluation.benchmark import Benchmark
from agents.evaluation.benchmark_config import SHIPPED_CONFIG, BenchmarkTask, configure
from agents.evaluation.evaluate import Info, Progress, checked_seeds, evaluate
from agents.evaluation.leaderboard import TaskResult
from agents.evaluation.scoreboard import Scoreboard, add_settings
from agents.policies.lookup import AnyPolicy, name_policies


def compare(
    policies: Sequence[AnyPolicy] | Mapping[str, AnyPolicy],
    env_id: str,
    seeds: Sequence[int] | NDArray[np.int64] = range(100),
    *,
    env_config: Info | None = None,
    options: Info | None = None,
    num_envs: int = 256,
    progress: Progress | None = None,
    allow_code: bool = False,
) -> Scoreboard:
    """Score several policies on the same episodes of one task, and compare each with each in pairs.

    For example ``print(agents.compare(["agent", "dpct", MyPolicy()], "ConveyorTrack-v0", range(50)))``.

    Args:
        policies: as `agents.evaluate` takes them, or by the names that they get in the tables.
        env_id: of the environment.
        seeds: one an episode.
        env_config: settings of the environment, by default the defaults, with those of each policy's own actions.
        options: of each ``reset``.
        num_envs: largest number of episodes that run at once.
        progress: called with the number of episodes that have just ended.
        allow_code: whether to load models of Stable-Baselines3.

    Raises:
        ValueError: as `agents.evaluate`, if there is no policy, and if one was made for other episodes than the rest.
    """
    given = {"env_config": {} if env_config is None else env_config, "options": {} if options is None else options}
    asked = {"env": import_env(env_id), **{name: portable(values) for name, values in given.items()}}
    task = BenchmarkTask.parse(asked, "comparison")
    named = name_policies(policies, task.env, allow_code=allow_code)
    numbers = checked_seeds(seeds)
    result = TaskResult(task, numbers, compared=tuple(each.name for each in named))
    for each in named if len(named) > 1 else ():
        each.require_same_episodes(task.env, task.env_config)
    for each in named:
        result.evaluations.append(
            evaluate(
                each.policy,
                task.env,
                numbers,
                env_config=each.settings(task.env_config),
                options=task.options,
                num_envs=num_envs,
                progress=progress,
                name=each.name,
            )
        )
        add_settings(result, each)
    return Scoreboard([result], complete=True, config={"tasks": [task.model_dump(mode="json")]})


def score_leaderboard(
    policies: Sequence[AnyPolicy] | Mapping[str, AnyPolicy] | None = None,
    tasks: Sequence[str] | None = None,
    *,
    config: str = SHIPPED_CONFIG,
    env_config: Mapping[str, Any] | None = None,
    options: Mapping[str, Any] | None = None,
    progress: Progress | None = None,
    allow_code: bool = False,
    **changes: Any,
) -> Scoreboard:
    """The leaderboard of `planarm benchmark --full`: ``agents.leaderboard(["dpct", MyPolicy()], episodes=32)``.

    Args:
        policies: as `agents.evaluate` takes them, or by the names that they get; by default those of the configuration.
        tasks: titles of tasks of the configuration, or ids of other environments; by default all of the configuration.
        config: name of a shipped configuration, or path of a YAML file.
        env_config: settings of every environment.
        options: of each ``reset``.
        progress: called with the number of episodes that have just ended.
        allow_code: whether to load models of Stable-Baselines3.
        changes: ``episodes``, ``bound_episodes``, ``seed`` and ``num_envs``.

    Raises:
        ValueError: as `agents.evaluate`, before the first episode.
    """
    given: dict[str, AnyPolicy] = {}
    if policies is not None:
        given = dict(policies) if isinstance(policies, Mapping) else _by_title(policies)
        changes["policies"] = tuple(given)
    changes |= {"env_config": env_config or {}, "options": options or {}}
    benchmark = Benchmark(configure(config, changes, tasks), allow_code=allow_code, given=given)
    benchmark.check()
    benchmark.fill(begin=lambda description: None, progress=progress or (lambda ended: None))
    return benchmark.board


def _by_title(policies: Sequence[AnyPolicy]) -> dict[str, AnyPolicy]:
    """Policies by what a configuration calls them: by their own name or path, or by that of their class."""
    titled: dict[str, AnyPolicy] = {}
    for policy in policies:
        title = name = policy if isinstance(policy, str) else str(getattr(policy, "__name__", type(policy).__name__))
        number = 2
        while name in titled:
            name, number = f"{title} {number}", number + 1
        titled[name] = policy
    return titled
