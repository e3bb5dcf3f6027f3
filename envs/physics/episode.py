"""Compiled steps that every task's kernels share: beginning an episode, and finishing an observation."""

from __future__ import annotations

from typing import Any

from numba import njit

from envs.physics.world import place_arm


@njit(cache=True, nogil=True)
def begin_episode(lane: Any, shared: Any) -> None:
    """Put the arm at rest at ``lane.q``, and forget the last episode."""
    clear_episode(lane)
    place_arm(lane, shared)


@njit(cache=True, nogil=True)
def clear_episode(lane: Any) -> None:
    """Forget the last episode; joints are at rest."""
    lane.qd[:] = 0.0
    lane.qdd[:] = 0.0
    lane.tau[:] = 0.0
    lane.commanded_qdd[:] = 0.0
    lane.limit_ratios[:] = 0.0
    lane.reward_terms[:] = 0.0
    lane.reward = 0.0
    lane.peak_torque = 0.0
    lane.terminated = lane.truncated = lane.success = False
    lane.step = 0


@njit(cache=True, nogil=True)
def sum_reward(lane: Any) -> None:
    """The reward is the sum of its terms."""
    lane.reward = 0.0
    for term in lane.reward_terms:
        lane.reward += term


@njit(cache=True, nogil=True)
def limit_cost(ratio: float, tolerance: float) -> float:
    """0 where the limits are kept, -1 to -2 where one is broken by more than the tolerance."""
    return 0.0 if ratio <= 1.0 + tolerance else -1.0 - min(1.0, ratio - 1.0)


@njit(cache=True, nogil=True)
def finish_observation(lane: Any, shared: Any) -> None:
    """Scale and clip the physical values in ``lane.seen`` into ``lane.observation``."""
    for element in range(lane.seen.shape[0]):
        value = lane.seen[element] / shared.scales[element]
        lane.observation[element] = min(shared.bounds[element], max(-shared.bounds[element], value))
