"""Compiled steps that every task's kernels share: beginning an episode, and finishing an observation."""

from __future__ import annotations

from typing import Any

from numba import njit

from envs.physics.chipmunk import array_at
from envs.physics.rigid_bodies import place_arm
from planners.typing import Array


@njit(cache=True, nogil=True)
def begin_episode(env: Any, shared: Any) -> None:
    """Place the arm at rest at ``env.q``, with all counters cleared."""
    clear_episode(env)
    place_arm(env, shared)


@njit(cache=True, nogil=True)
def clear_episode(env: Any) -> None:
    """Clear the counters of the last episode; the joints are at rest."""
    env.qd[:] = 0.0
    env.qdd[:] = 0.0
    env.tau[:] = 0.0
    env.commanded_qdd[:] = 0.0
    env.limit_ratios[:] = 0.0
    env.reward_terms[:] = 0.0
    env.reward = 0.0
    env.peak_torque = 0.0
    env.terminated = env.truncated = env.success = False
    env.step = 0


@njit(cache=True, nogil=True)
def table_of(env: Any, shape: Any) -> Array:
    """The table of an environment's episode (`Task.write_table`), with the shape that the task has declared."""
    return array_at(env.table, shape)


@njit(cache=True, nogil=True)
def sum_reward(env: Any) -> None:
    """Write the reward, the sum of its terms."""
    total = 0.0
    for term in range(env.reward_terms.shape[0]):
        total += env.reward_terms[term]
    env.reward = total


@njit(cache=True, nogil=True)
def limit_cost(ratio: float, tolerance: float) -> float:
    """0 where the limits are kept, -1 to -2 where one is broken by more than the tolerance."""
    return 0.0 if ratio <= 1.0 + tolerance else -1.0 - min(1.0, ratio - 1.0)


@njit(cache=True, nogil=True)
def finish_observation(env: Any, shared: Any) -> None:
    """Scale and clip the physical values ``env.seen`` into ``env.observation``."""
    seen = env.seen.flat
    for element in range(seen.shape[0]):
        value = seen[element] / shared.scales[element]
        env.observation[element] = min(shared.bounds[element], max(-shared.bounds[element], value))


def restart_clock(record: Any) -> None:
    """Give the running episode of an environment's record its whole time again; the arm moves on."""
    record["step"] = 0
    record["terminated"] = record["truncated"] = record["success"] = False
