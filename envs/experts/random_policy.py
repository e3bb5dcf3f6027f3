"""Random policy, a lower bound for every leaderboard."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from envs.experts.base import Expert
from envs.hashing import to_unit
from envs.observation import Observation
from envs.task import Task
from planners.typing import Array


class RandomExpert(Expert):
    """Uniformly random actions.

    Actions are a hash of the observation, so that an episode does not depend on the batch it runs in.

    Args:
        task: the environment's task.
        seed: of the constants of the hash.
    """

    def __init__(self, task: Task, seed: int = 0) -> None:
        super().__init__(task)
        generator = np.random.default_rng(seed)
        shape = (task.layout.size, task.arm.n_joints)
        self._multipliers = generator.integers(0, 2**64, shape, dtype=np.uint64, endpoint=False) | np.uint64(1)

    def _act(self, observations: Observation, state: Any, starts: NDArray[np.bool_]) -> tuple[Array, tuple[()]]:
        words = np.ascontiguousarray(observations, dtype=np.float32).view(np.uint32).astype(np.uint64)
        bits = (words[:, :, None] * self._multipliers).sum(axis=1, dtype=np.uint64)
        return 2.0 * to_unit(bits) - 1.0, ()
