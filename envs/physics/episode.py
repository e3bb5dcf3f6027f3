"""Compiled steps that every task's kernels share: beginning an episode, and finishing an observation."""

from __future__ import annotations

from typing import Any

from numba import njit

from envs.physics.world import place_arm


@njit(cache=True, nogil=True)
def begin_episode(env: Any, shared: Any) -> None:
    """Put the arm at rest at ``environment.q``, and forget the last episode."""
    clear_episode(env)
    place_arm(env, shared)


@njit(cache=True, nogil=True)
def clear_episode(env: Any) -> None:
    """Forget the last episode; joints are at rest."""
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
def sum_reward(env: Any) -> None:
    """The reward is the sum of its terms."""
    env.reward = 0.0
    for term in env.reward_terms:
        env.reward += term


@njit(cache=True, nogil=True)
def limit_cost(ratio: float, tolerance: float) -> float:
    """0 where the limits are kept, -1 to -2 where one is broken by more than the tolerance."""
    return 0.0 if ratio <= 1.0 + tolerance else -1.0 - min(1.0, ratio - 1.0)


@njit(cache=True, nogil=True)
def finish_observation(env: Any, shared: Any) -> None:
    """Scale and clip the physical values in ``environment.seen`` into ``environment.observation``."""
    for element in range(env.seen.shape[0]):
        value = env.seen[element] / shared.scales[element]
        env.observation[element] = min(shared.bounds[element], max(-shared.bounds[element], value))
