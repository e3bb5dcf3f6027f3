"""`evaluate`: one episode a seed, batched; every policy meets the same starts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from itertools import islice
from time import perf_counter
from typing import Any
from warnings import warn

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from agents.environments import MOST_EPISODES, VectorEnv, check_names, check_seed, import_env, make_batch
from agents.evaluation.results import Evaluation, Timing
from agents.policies.lookup import AnyPolicy, name_policy
from agents.policies.policy import Actor, CountsPlans, EstimatesPayload, Policy, is_maker
from envs.experts import Expert
from envs.physics.actuation import LIMIT_KINDS
from planners.checks import checked_count
from planners.typing import Array

Info = Mapping[str, Any]
Progress = Callable[[int], object]  # called with the number of episodes that have just ended


def evaluate(
    policy: AnyPolicy,
    env_id: str,
    seeds: Sequence[int] | NDArray[np.int64],
    *,
    env_config: Info | None = None,
    options: Info | None = None,
    num_envs: int = 256,
    progress: Progress | None = None,
    name: str | None = None,
    allow_code: bool = False,
) -> Evaluation:
    """Run exactly one episode for each seed, with deterministic actions.

    The start of an episode depends on its seed alone, not on the policy, the other seeds or the number of
    environments, so policies that are evaluated on the same seeds can be compared in pairs.

    A policy acts in its own control mode: what it carries (`agents.policies.lookup.NamedPolicy`) is applied, and a
    contradiction is refused. If neither a model of Stable-Baselines3 nor ``env_config`` says what its actions mean,
    there is a warning.

    Args:
        policy: a name or a path as on the command line (``"dpct"``, ``"agent"``, ``"runs/mine"``, ``"model.zip"``,
            ``"my_module:make_policy"``), anything with Stable-Baselines3's ``predict``, or a function or class that
            makes one, with the environment or without arguments.
        env_id: an environment whose vector form resets in the step that ends an episode (SAME_STEP), as planarm's do;
            ``"my_module:MyTask-v0"`` imports the module first.
        seeds: one an episode.
        env_config: settings of the environment; if left out, those that the policy carries.
        options: of each ``reset``.
        num_envs: largest number of episodes that run at once.
        progress: called with the number of episodes that have just ended.
        name: of the policy; if left out, that by which it was found, or of its class.
        allow_code: whether to load a model of Stable-Baselines3 from a .zip, which can run any code in it.

    Raises:
        ValueError: for an unknown policy, one that was trained for something else or gives actions of a wrong shape, no
            seeds, or settings and options the environment refuses.
    """
    numbers = checked_seeds(seeds)
    num_envs = checked_count("num_envs", num_envs)
    env_id = import_env(env_id)
    named = name_policy(policy, env_id, name=name, allow_code=allow_code)
    check_names(env_id, {} if env_config is None else env_config, {} if options is None else options)
    settings = named.own_settings({}) if env_config is None else named.settings(env_config)
    check_names(env_id, settings, {})
    if env_config is None and (assumption := named.assumption(env_id, settings)):
        warn(f"{assumption}, such as env_config={{'control_mode': 'jerk'}}", stacklevel=2)
    name, acting = named.name, named.policy
    parts: list[Evaluation] = []
    for first in range(0, len(numbers), num_envs):
        batch = numbers[first : first + num_envs]
        with closing(make_batch(env_id, len(batch), settings)) as env:
            if env.metadata.get("autoreset_mode") != AutoresetMode.SAME_STEP:
                raise ValueError(f"{env_id} does not reset in the step that ends an episode (SAME_STEP)")
            actor = Actor(acting, env, name)
            if not is_maker(acting):
                acting = actor.policy  # an expert goes on with the next episodes
            results = _run_batch(actor, env, batch, dict(options or {}), progress or (lambda ended: None))
            parts.append(Evaluation(name, env_id, batch, *results))
    return Evaluation.joined(parts)


def _run_batch(
    actor: Actor, env: VectorEnv, seeds: NDArray[np.int64], options: dict[str, Any], progress: Progress
) -> tuple[Array, NDArray[np.int64], dict[str, NDArray[Any]], Timing]:
    """Returns, lengths, metrics and timing of one episode in every environment; finished ones step on, ignored."""
    n = env.num_envs
    returns, lengths = np.zeros(n), np.zeros(n, dtype=np.int64)
    metrics: dict[str, NDArray[Any]] = {}
    policy_seconds = env_seconds = 0.0
    steps = 0
    policy = actor.policy
    planned_before = _planned(policy)
    estimator = policy if isinstance(policy, EstimatesPayload) else None
    observation, _ = env.reset(seed=seeds.tolist(), options=options)
    state, begins, running = None, np.ones(n, dtype=bool), np.ones(n, dtype=bool)
    while running.any():
        if isinstance(policy, Expert):
            policy.idle = ~running
        before = perf_counter()
        actions, state = actor.act(observation, state, begins)
        between = perf_counter()
        estimate = None if estimator is None else estimator.mass_estimate
        observation, rewards, terminated, truncated, infos = env.step(actions)
        after = perf_counter()
        policy_seconds, env_seconds, steps = policy_seconds + between - before, env_seconds + after - between, steps + 1
        returns[running] += rewards[running]
        lengths += running
        begins = terminated | truncated
        ended = running & begins
        if ended.any():
            _collect(metrics, infos["final_info"], ended)
            if estimate is not None:
                metrics.setdefault("mass_estimate", np.full(n, np.nan))[ended] = estimate[ended]
            running &= ~ended
            progress(int(ended.sum()))
    if isinstance(policy, Expert):
        policy.idle = None
    plans, planning_seconds, infeasible = np.subtract(_planned(policy), planned_before).tolist()
    timing = Timing(
        env_steps=steps * n,
        plans=int(plans),
        planning_seconds=planning_seconds,
        policy_seconds=policy_seconds - planning_seconds,
        env_seconds=env_seconds,
        infeasible=int(infeasible),
    )
    return returns, lengths, metrics, timing


def _collect(metrics: dict[str, NDArray[Any]], final: Info, ended: NDArray[np.bool_], prefix: str = "") -> None:
    """Put the numbers of the environments that ended into ``metrics``.

    Reward terms are left out: they are of the last step, not of the episode.
    """
    for key, values in final.items():
        if key.startswith(("_", "reward_")):
            continue
        if isinstance(values, dict):
            _collect(metrics, values, ended, f"{prefix}{key}/")
        elif key == "limit_ratios":
            present = dict.fromkeys((f"_{kind}" for kind in LIMIT_KINDS), final["_limit_ratios"])
            _collect(metrics, {**dict(zip(LIMIT_KINDS, values.T, strict=True)), **present}, ended, "limit_ratios/")
        elif np.issubdtype(values.dtype, np.number) or values.dtype == bool:
            missing = np.nan if np.issubdtype(values.dtype, np.floating) else 0
            given = ended & final[f"_{key}"]
            metrics.setdefault(prefix + key, np.full(len(ended), missing, values.dtype))[given] = values[given]


def _planned(policy: Policy) -> tuple[int, float, int]:
    """Plans made so far, the seconds they took and how many were infeasible."""
    if isinstance(policy, CountsPlans):
        return policy.plans_made, policy.planning_seconds, policy.infeasible
    return 0, 0.0, 0


def checked_seeds(seeds: Iterable[int]) -> NDArray[np.int64]:
    """The seeds of episodes as an array; a ValueError if these are none."""
    if isinstance(seeds, str | bytes) or not isinstance(seeds, Iterable):
        raise ValueError(f"seeds {seeds!r:.80} must be whole numbers, one an episode, for example range(100)")
    numbers = list(islice(seeds, MOST_EPISODES + 1))
    if not 1 <= len(numbers) <= MOST_EPISODES:
        raise ValueError(f"{'too many' if numbers else 'no'} seeds: give 1 to {MOST_EPISODES}, for example range(100)")
    return np.array([check_seed(seed) for seed in numbers], dtype=np.int64)
