"""`evaluate`: one episode a seed, batched; every policy meets the same starts."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from time import perf_counter
from typing import Any, Protocol, runtime_checkable

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

import envs
from planners.typing import Array

Info = Mapping[str, Any]
VectorEnv = gym.vector.VectorEnv[Any, Any, Any]
PolicyMaker = Callable[[Any], "Policy"]  # makes a policy for an environment, single or vector
Progress = Callable[[int], object]  # called with the number of episodes that have just ended


@runtime_checkable
class Policy(Protocol):
    """A policy as in Stable-Baselines3: batched observations in, batched actions out.

    One that is a `CountsPlans` or an `EstimatesPayload` too has more of it recorded.
    """

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[Any, Any]:
        """Actions ``(num_envs, n)`` for observations ``(num_envs, size)``, and the state for the next call."""


@runtime_checkable
class CountsPlans(Protocol):
    """A policy that counts its plans, so that planning is timed apart from its other work.

    Attributes:
        plans_made: so far.
        planning_seconds: time they took.
        infeasible: how many of them had no solution.
    """

    plans_made: int
    planning_seconds: float
    infeasible: int


@runtime_checkable
class EstimatesPayload(Protocol):
    """A policy that estimates the payload."""

    @property
    def mass_estimate(self) -> Array | None:
        """After the last call, ``(num_envs,)``, kg; None without an estimate."""


@dataclass(frozen=True)
class Timing:
    """Where the time went, all environments together."""

    env_steps: int = 0  # control steps, summed over environments
    plans: int = 0  # plans made; 0 for policies that do not plan
    planning_seconds: float = 0.0  # spent on them
    policy_seconds: float = 0.0  # spent in the policy without planning
    env_seconds: float = 0.0  # spent in the environment's steps
    infeasible: int = 0  # plans for which there was no solution

    @property
    def planning_ms(self) -> float:
        """Milliseconds a plan; NaN for policies that do not plan."""
        return 1e3 * self.planning_seconds / self.plans if self.plans else np.nan

    @property
    def policy_us(self) -> float:
        """Microseconds of the policy, without planning, per step of an environment."""
        return 1e6 * self.policy_seconds / self.env_steps

    @property
    def env_us(self) -> float:
        """Microseconds of the environment per step of an environment."""
        return 1e6 * self.env_seconds / self.env_steps

    def __add__(self, other: Timing) -> Timing:
        return Timing(*(getattr(self, name) + getattr(other, name) for name in self.__dataclass_fields__))


@dataclass(frozen=True)
class Evaluation:
    """Results of a policy, episode by episode.

    Attributes:
        policy: its name.
        env_id: where.
        seeds: one an episode, ``(episodes,)``.
        returns: sum of rewards, ``(episodes,)``.
        lengths: control steps, ``(episodes,)``.
        metrics: each number that `info` holds at the end of an episode, ``(episodes,)`` by its key; numbers in a nested
            dict have both keys, as in ``limit_ratios/velocity``. Also ``mass_estimate`` of a policy that
            `EstimatesPayload`, kg.
        timing: where the time went.
    """

    policy: str
    env_id: str
    seeds: NDArray[np.int64]
    returns: Array
    lengths: NDArray[np.int64]
    metrics: dict[str, NDArray[Any]]
    timing: Timing

    @property
    def success(self) -> NDArray[np.bool_]:
        """Whether each episode ended in success."""
        return self.metrics["is_success"].astype(bool)


def evaluate(
    policy: Policy | PolicyMaker | str,
    env_id: str,
    seeds: Sequence[int] | NDArray[np.int64],
    *,
    env_config: Info | None = None,
    options: Info | None = None,
    num_envs: int = 256,
    progress: Progress | None = None,
    name: str | None = None,
) -> Evaluation:
    """Run exactly one episode for each seed, with deterministic actions.

    The start of an episode depends on its seed alone, not on the policy, the other seeds or the number of
    environments, so policies that are evaluated on the same seeds can be compared in pairs.

    Args:
        policy: the name of an expert, anything with Stable-Baselines3's ``predict``, or a function that makes one for
            the environment.
        env_id: an environment whose vector form resets in the step that ends an episode (SAME_STEP), as planarm's do.
        seeds: one an episode.
        env_config: settings of the environment.
        options: of each ``reset``.
        num_envs: largest number of episodes that run at once.
        progress: called with the number of episodes that have just ended.
        name: of the policy; if left out, that of the expert or of its class.

    Raises:
        ValueError: for an unknown expert, no seeds, or settings and options the environment refuses.
    """
    numbers = _checked_seeds(seeds)
    if num_envs < 1:
        raise ValueError(f"num_envs {num_envs} must be at least 1")
    name = name or (policy if isinstance(policy, str) else type(policy).__name__)
    parts: list[Evaluation] = []
    for first in range(0, len(numbers), num_envs):
        batch = numbers[first : first + num_envs]
        with closing(gym.make_vec(env_id, num_envs=len(batch), **(env_config or {}))) as env:
            if env.metadata.get("autoreset_mode") != AutoresetMode.SAME_STEP:
                raise ValueError(f"{env_id} does not reset in the step that ends an episode (SAME_STEP)")
            policy = acting = as_policy(policy, env)
            results = _run_batch(acting, env, batch, dict(options or {}), progress or (lambda ended: None))
            parts.append(Evaluation(name, env_id, batch, *results))
    return Evaluation(
        policy=name,
        env_id=env_id,
        seeds=numbers,
        returns=np.concatenate([part.returns for part in parts]),
        lengths=np.concatenate([part.lengths for part in parts]),
        metrics={key: np.concatenate([part.metrics[key] for part in parts]) for key in parts[0].metrics},
        timing=sum((part.timing for part in parts), Timing()),
    )


def _run_batch(
    policy: Policy, env: VectorEnv, seeds: NDArray[np.int64], options: dict[str, Any], progress: Progress
) -> tuple[Array, NDArray[np.int64], dict[str, NDArray[Any]], Timing]:
    """Returns, lengths, metrics and timing of one episode in every environment; finished ones step on, ignored."""
    n = env.num_envs
    returns, lengths = np.zeros(n), np.zeros(n, dtype=np.int64)
    metrics: dict[str, NDArray[Any]] = {}
    policy_seconds = env_seconds = 0.0
    steps = 0
    planned_before = _planned(policy)
    estimator = policy if isinstance(policy, EstimatesPayload) else None
    observation, _ = env.reset(seed=seeds.tolist(), options=options)
    state, begins, running = None, np.ones(n, dtype=bool), np.ones(n, dtype=bool)
    while running.any():
        before = perf_counter()
        actions, state = policy.predict(observation, state=state, episode_start=begins, deterministic=True)
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
        if key.startswith("_") or key == "reward_terms":
            continue
        if isinstance(values, dict):
            _collect(metrics, values, ended, f"{prefix}{key}/")
        elif np.issubdtype(values.dtype, np.number) or values.dtype == bool:
            missing = np.nan if np.issubdtype(values.dtype, np.floating) else 0
            given = ended & final[f"_{key}"]
            metrics.setdefault(prefix + key, np.full(len(ended), missing, values.dtype))[given] = values[given]


def _planned(policy: Policy) -> tuple[int, float, int]:
    """Plans made so far, the seconds they took and how many were infeasible."""
    if isinstance(policy, CountsPlans):
        return policy.plans_made, policy.planning_seconds, policy.infeasible
    return 0, 0.0, 0


def as_policy(policy: Policy | PolicyMaker | str, env: VectorEnv | gym.Env[Any, Any]) -> Policy:
    """A policy for an environment: an expert by its name, what a function makes, any other as it is.

    Raises:
        ValueError: for an unknown expert, or an object without ``predict``.
    """
    if isinstance(policy, str):
        expert: Policy = envs.make_expert(policy, env)
        return expert
    if not isinstance(policy, Policy) and callable(policy):
        policy = policy(env)
    if not isinstance(policy, Policy):
        raise ValueError(
            f"policy {policy!r} has no predict(observation, state, episode_start, deterministic); "
            "give the name of an expert, or an object with Stable-Baselines3's predict"
        )
    return policy


def _checked_seeds(seeds: Sequence[int] | NDArray[np.int64]) -> NDArray[np.int64]:
    numbers = np.array([int(seed) for seed in seeds], dtype=np.int64)
    if not numbers.size:
        raise ValueError("no seeds: give at least one, for example range(100)")
    if numbers.min() < 0:
        raise ValueError(f"seed {numbers.min()} must not be negative")
    return numbers
