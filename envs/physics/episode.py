"""What the episodes of every task share: fields of a record, how one begins, reward and observation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from envs.physics.chipmunk import array_at
from envs.physics.rigid_bodies import begin_commands
from planners.compiled.calls import Kernel, call, clear_array, copy_array, inlined, private
from planners.typing import Array

EPISODE_FIELDS: list[tuple[Any, ...]] = [
    ("step", "i8"),
    ("reward", "f8"),
    ("terminated", "?"),
    ("truncated", "?"),
    ("success", "?"),
    ("begun", "?"),
    ("table", "i8"),
    ("env_index", "i8"),
]
"""Fields of an environment's record."""

ADVANCE, BEGIN, REFRESH = range(3)
"""What a kernel of `entry_points` does with the environments it is given."""


class EntryPoint(NamedTuple):
    """A kernel with its purpose, as a number.

    Attributes:
        kernel: ``kernel(batch, model, first, last, work)``, for environments ``first`` to ``last - 1``.
        work: `ADVANCE`, `BEGIN` or `REFRESH`.
    """

    kernel: Kernel
    work: int


def entry_points(kernel: Callable[..., None]) -> tuple[EntryPoint, EntryPoint, EntryPoint]:
    """``reset_env``, ``advance_batch`` and ``refresh_env`` of a task, all by one function, which is compiled once.

    Args:
        kernel: ``kernel(batch, model, first, last, work)``, to compile: advances environments ``first`` to ``last - 1``
            by one control period (`ADVANCE`), begins their episodes (`BEGIN`), or lets their bodies and observations
            follow what was written into their records (`REFRESH`). It divides as NumPy does, without errors.
    """
    compiled = Kernel(kernel, error_model="numpy")
    return EntryPoint(compiled, BEGIN), EntryPoint(compiled, ADVANCE), EntryPoint(compiled, REFRESH)


@inlined
def begin_episode(env: Any, shared: Any) -> None:
    """Place the arm at rest at ``env.q``, with all counters cleared."""
    clear_episode(env)
    begin_commands(env)
    call(shared.place_kernel, env, shared)


@inlined
def clear_episode(env: Any) -> None:
    """Clear the counters of the last episode; the joints are at rest."""
    clear_array(env.qd)
    clear_array(env.qdd)
    clear_array(env.tau)
    clear_array(env.commanded_qdd)
    clear_array(env.limit_ratios)
    env.limit_ratio = 0.0
    clear_array(env.reward_terms)
    env.reward = 0.0
    env.peak_torque = 0.0
    env.terminated = env.truncated = env.success = False
    env.step = 0


@inlined
def table_of(env: Any, shape: Any) -> Array:
    """The table of an environment's episode (`Task.write_table`), with the shape that the task has declared."""
    table: Array = array_at(env.table, shape)
    return table


@inlined
def sum_reward(env: Any) -> None:
    """Write the reward, the sum of its terms."""
    total = 0.0
    for term in range(env.reward_terms.shape[0]):
        total += env.reward_terms[term]
    env.reward = total


@inlined
def limit_cost(ratio: float, tolerance: float) -> float:
    """0 where the limits are kept, -1 to -2 where one is broken by more than the tolerance."""
    return 0.0 if ratio <= 1.0 + tolerance else -1.0 - min(1.0, ratio - 1.0)


@inlined
def observe_joints(env: Any) -> None:
    """Write positions, velocities and accelerations of the joints into the observation."""
    seen = env.seen
    copy_array(seen.joint_position, env.q)
    copy_array(seen.joint_velocity, env.qd)
    copy_array(seen.joint_acceleration, env.qdd)


@inlined
def finish_observation(env: Any, shared: Any) -> None:
    """Scale and clip the physical values ``env.seen`` into ``env.observation``."""
    seen, observation, scales, bounds = env.seen.flat, env.observation, shared.scales, shared.bounds
    for element in range(seen.shape[0]):
        bound = bounds[element]
        observation[element] = min(bound, max(-bound, seen[element] / scales[element]))


@private
def observed_through(env: Any, copies: Any) -> None:
    """Give an environment the observation of a copy of its record, ``(1,)``, in which values are as measured."""
    copy_array(env.seen.flat, copies[0].seen.flat)
    copy_array(env.observation, copies[0].observation)


def restart_clock(record: Any) -> None:
    """Give the running episode of an environment's record its whole time again; the arm moves on.

    Its noise, which is that of a key and a step, goes on with another key.
    """
    known = np.random.SeedSequence([int(record["noise_key"]), int(record["step"])])
    record["noise_key"] = known.generate_state(1, np.uint64)[0]
    record["step"] = 0
    record["terminated"] = record["truncated"] = record["success"] = False
