"""`evaluate`: one episode a seed, batched, so that every policy meets the same starts."""

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
PolicyMaker = Callable[[Any], "Policy"]
"""Makes a policy for an environment, single or vector."""
Progress = Callable[[int], object]
"""Is told how many episodes have just ended."""


@runtime_checkable
class Policy(Protocol):
    """What Stable-Baselines3 calls a policy: batched observations in, batched actions out."""

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[Any, Any]:
        """Actions ``(num_envs, n)`` for observations ``(num_envs, size)``, and the state for the next call."""


@dataclass(frozen=True)
class Timing:
    """Where the time went, all environments together.

    Attributes:
        env_steps: control steps taken, environments counted one by one.
        plans: plans made; 0 for policies that do not plan.
        planning_seconds: spent on them.
        policy_seconds: spent in the policy beside planning.
        env_seconds: spent in the environment's steps.
        infeasible: plans for which there was no solution.
    """

    env_steps: int = 0
    plans: int = 0
    planning_seconds: float = 0.0
    policy_seconds: float = 0.0
    env_seconds: float = 0.0
    infeasible: int = 0

    @property
    def planning_ms(self) -> float:
        """Milliseconds a plan; NaN for policies that do not plan."""
        return 1e3 * self.planning_seconds / self.plans if self.plans else np.nan

    @property
    def policy_us(self) -> float:
        """Microseconds of the policy, beside planning, for each step of an environment."""
        return 1e6 * self.policy_seconds / self.env_steps

    @property
    def env_us(self) -> float:
        """Microseconds of the environment for each step of an environment."""
        return 1e6 * self.env_seconds / self.env_steps

    def __add__(self, other: Timing) -> Timing:
        return Timing(*(getattr(self, name) + getattr(other, name) for name in self.__dataclass_fields__))


@dataclass(frozen=True)
class Evaluation:
    """What a policy achieved, episode by episode.

    Attributes:
        policy: its name.
        env_id: where.
        seeds: one an episode, ``(episodes,)``.
        returns: sum of rewards, ``(episodes,)``.
        lengths: control steps, ``(episodes,)``.
        metrics: each number that `info` holds at the end of an episode, ``(episodes,)`` by its key; numbers in a nested
            dict have both keys, as in ``limit_ratios/velocity``. And ``mass_estimate``, what the policy takes the
            payload to weigh then, kg, if it has such an attribute.
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


def known_env_ids() -> list[str]:
    """Ids of planarm's environments."""
    return sorted(spec.id for spec in gym.registry.values() if str(spec.entry_point).startswith("envs."))


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
    """Run exactly one episode for each seed.

    An episode starts as its seed alone says, whatever the policy, the other seeds and the number of environments, so
    policies that are evaluated on the same seeds can be compared in pairs.

    Args:
        policy: the name of an expert, anything with Stable-Baselines3's ``predict``, or a function that makes one for
            the environment; it is asked for deterministic actions.
        env_id: an environment whose vector form resets an environment in the step that ends its episode: any of
        planarm's.
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
    batches: list[_Batch] = []
    for first in range(0, len(numbers), num_envs):
        batch = numbers[first : first + num_envs]
        with closing(gym.make_vec(env_id, num_envs=len(batch), **(env_config or {}))) as env:
            if env.metadata.get("autoreset_mode") != AutoresetMode.SAME_STEP:
                raise ValueError(
                    f"{env_id} does not reset an environment in the step that ends its episode (SAME_STEP)"
                )
            policy = acting = as_policy(policy, env)
            batches.append(_run_batch(acting, env, batch, dict(options or {}), progress or (lambda ended: None)))
    return Evaluation(
        policy=name,
        env_id=env_id,
        seeds=np.array(numbers),
        returns=np.concatenate([batch.returns for batch in batches]),
        lengths=np.concatenate([batch.lengths for batch in batches]),
        metrics={key: np.concatenate([batch.metrics[key] for batch in batches]) for key in batches[0].metrics},
        timing=sum((batch.timing for batch in batches), Timing()),
    )


@dataclass(frozen=True)
class _Batch:
    returns: Array
    lengths: NDArray[np.int64]
    metrics: dict[str, NDArray[Any]]
    timing: Timing


def _run_batch(
    policy: Policy,
    env: VectorEnv,
    seeds: list[int],
    options: dict[str, Any],
    progress: Progress,
) -> _Batch:
    """One episode in every environment. An environment that ends sooner than others goes on, unheeded."""
    n = env.num_envs
    returns, lengths = np.zeros(n), np.zeros(n, dtype=np.int64)
    metrics: dict[str, NDArray[Any]] = {}
    policy_seconds = env_seconds = 0.0
    steps = 0
    planning_before = _planning(policy)
    observation, _ = env.reset(seed=seeds, options=options)  # type: ignore[arg-type]  # a seed an environment
    state, begins, running = None, np.ones(n, dtype=bool), np.ones(n, dtype=bool)
    while running.any():
        before = perf_counter()
        actions, state = policy.predict(observation, state=state, episode_start=begins, deterministic=True)
        between = perf_counter()
        estimate = getattr(policy, "mass_estimate", None)
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
    planning = tuple(after - before for after, before in zip(_planning(policy), planning_before, strict=True))
    timing = Timing(
        env_steps=steps * n,
        plans=int(planning[0]),
        planning_seconds=planning[1],
        policy_seconds=policy_seconds - planning[1],
        env_seconds=env_seconds,
        infeasible=int(planning[2]),
    )
    return _Batch(returns, lengths, metrics, timing)


def _collect(metrics: dict[str, NDArray[Any]], final: Info, ended: NDArray[np.bool_], prefix: str = "") -> None:
    """Put the numbers of the environments that ended into ``metrics``.

    Reward terms are left out: they speak of the last step, not of the episode.
    """
    for key, values in final.items():
        if key.startswith("_") or key == "reward_terms":
            continue
        if isinstance(values, dict):
            _collect(metrics, values, ended, f"{prefix}{key}/")
        elif np.issubdtype(values.dtype, np.number) or values.dtype == bool:
            missing = np.nan if np.issubdtype(values.dtype, np.floating) else 0
            told = ended & final[f"_{key}"]
            metrics.setdefault(prefix + key, np.full(len(ended), missing, values.dtype))[told] = values[told]


def _planning(policy: Policy) -> tuple[float, float, float]:
    """Plans made so far, the seconds they took and how many were infeasible, if the policy counts them."""
    return tuple(getattr(policy, name, 0.0) for name in ("plans_made", "planning_seconds", "infeasible"))  # type: ignore[return-value]


def as_policy(policy: Policy | PolicyMaker | str, env: VectorEnv | gym.Env[Any, Any]) -> Policy:
    """A policy for an environment: an expert by its name, what a function makes, any other as it is.

    Raises:
        ValueError: for an unknown expert, or what has no ``predict``.
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


def _checked_seeds(seeds: Sequence[int] | NDArray[np.int64]) -> list[int]:
    numbers = [int(seed) for seed in seeds]
    if not numbers:
        raise ValueError("no seeds: give at least one, for example range(100)")
    if min(numbers) < 0:
        raise ValueError(f"seed {min(numbers)} must not be negative")
    return numbers
