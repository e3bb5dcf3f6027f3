"""The results of a policy, episode by episode, and where the time went."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planners.typing import Array


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
        metrics: each number that `info` holds at the end of an episode, ``(episodes,)`` by its key; those of
            ``limit_ratios`` by their kind, as in ``limit_ratios/velocity``. Also ``mass_estimate`` of a policy that
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

    @classmethod
    def joined(cls, parts: Sequence[Evaluation]) -> Evaluation:
        """Several parts of one evaluation, in the order of their episodes."""
        first = parts[0]
        return cls(
            policy=first.policy,
            env_id=first.env_id,
            seeds=np.concatenate([part.seeds for part in parts]),
            returns=np.concatenate([part.returns for part in parts]),
            lengths=np.concatenate([part.lengths for part in parts]),
            metrics={key: np.concatenate([part.metrics[key] for part in parts]) for key in first.metrics},
            timing=sum((part.timing for part in parts), Timing()),
        )

    @property
    def success(self) -> NDArray[np.bool_]:
        """Whether each episode ended in success."""
        return self.metrics["is_success"].astype(bool)
