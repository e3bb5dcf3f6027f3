"""Random steps for every environment and control mode, and environments made and closed, with what must not grow.

``python -m tools.soak --steps 10000000 --closes 2000`` steps a batch of every environment in every control mode:
random, bang-bang, constant, sinusoidal and huge actions (up to 1e38), no action, and single kicks. Between blocks of
steps all environments are reset now and then with a random seed, or some with random options. Observations and rewards
must be finite and inside the observation space, a refused reset must leave the observations as they are, after a reset
with a seed one environment must equal, bit for bit, the same environment alone, and memory must not grow. Then
environments are made, reset, stepped and closed: single, in batches with threads, and with rendering; memory, threads
and file descriptors must not grow. It prints a line for each, and ends with 1 if something was found.
"""

from __future__ import annotations

import gc
import os
import resource
import sys
import threading
import time
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

import gymnasium as gym
import numpy as np
import tyro
from numpy.typing import NDArray

import envs
from envs.card import load

BLOCK = 64
"""Control steps of a block, with the same pattern of actions in each environment."""

MOST_GROWTH_MIB = 24.0
"""Growth of memory over the second half of the steps, or of the cycles, that is no leak."""

OPTIONS: dict[str, tuple[str, float, float]] = {
    "ConveyorTrack-v0": ("belt_speed", 0.05, 0.5),
    "MinTorqueMove-v0": ("duration", 0.3, 2.5),
    "ExcavatorPayload-v0": ("payload", 0.0, 350.0),
}
"""A number among the reset options of a task, and the range from which it is drawn."""


@dataclass
class Soak:
    """Options of the command."""

    steps: int = 1_000_000
    """control steps of each environment in each control mode"""
    closes: int = 200
    """environments made and closed of each kind: single, in a batch, rendered"""
    num_envs: int = 256
    """environments of the batch"""
    seed: int = 0
    autoreset_mode: Literal["SameStep", "NextStep"] = "SameStep"
    """when the next episode begins: in the step that ends one, or in the following step"""
    env: str | None = None
    """only this one"""


@dataclass
class Record:
    """What became of one environment in one control mode, or of one kind of make and close."""

    label: str
    count: int = 0
    episodes: int = 0
    refused: int = 0
    seconds: float = 0.0
    memory: list[float] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)

    @property
    def growth(self) -> float:
        """Growth of memory over the second half, MiB."""
        half = self.memory[len(self.memory) // 2 :]
        return max(0.0, half[-1] - half[0]) if half else 0.0

    def check_growth(self) -> None:
        """Note a fault if memory has grown."""
        if self.growth > MOST_GROWTH_MIB:
            self.faults.append(f"memory grew by {self.growth:.1f} MiB in the second half")

    def __str__(self) -> str:
        rate = self.count / max(self.seconds, 1e-9)
        return (
            f"{self.label}: {self.count:,} ({rate:,.0f}/s), {self.episodes:,} episodes, {self.refused} resets refused, "
            f"memory +{self.growth:.1f} MiB in the second half, {len(self.faults)} faults"
        )


def modes_of(env_id: str) -> tuple[str, ...]:
    """All control modes of an environment."""
    kind: Any = gym.spec(env_id).kwargs["task_type"]
    task = load(kind) if isinstance(kind, str) else kind
    return get_args(task.config_type.model_fields["control_mode"].annotation)


def soak(env_id: str, mode: str, options: Soak) -> Record:
    """Step a batch of an environment in a control mode."""
    record = Record(f"{env_id} {mode}")
    generator = np.random.default_rng([options.seed, len(env_id), len(mode)])
    settings: dict[str, Any] = {"control_mode": mode, "autoreset_mode": options.autoreset_mode}
    batch = gym.make_vec(env_id, num_envs=options.num_envs, **settings)
    alone = gym.make_vec(env_id, num_envs=1, **settings)
    space: Any = batch.single_observation_space
    shape = batch.single_action_space.shape or ()
    began = time.perf_counter()
    batch.reset(seed=int(generator.integers(2**31)))
    while record.count < options.steps and len(record.faults) < 20:
        seed = _reset(batch, env_id, generator, record)
        actions = patterns(generator, options.num_envs, shape)
        watched = int(generator.integers(options.num_envs))
        if seed is not None:
            _compare(alone.reset(seed=seed + watched)[0], batch, watched, record)
        for step in range(BLOCK):
            observations, rewards, terminated, truncated, _ = batch.step(actions[step])
            if not ((observations >= space.low) & (observations <= space.high)).all():
                record.faults.append(f"step {record.count}: an observation outside its space")
            if not np.isfinite(rewards).all():
                record.faults.append(f"step {record.count}: rewards that are not finite")
            record.count += options.num_envs
            record.episodes += int((terminated | truncated).sum())
            if seed is not None:
                single = alone.step(actions[step, watched : watched + 1])
                same = (single[0][0] == observations[watched]).all() and single[1][0] == rewards[watched]
                if not same:
                    record.faults.append(f"step {record.count}: environment {watched} differs from the same one alone")
                    break
        record.memory.append(memory_mib())
    record.seconds = time.perf_counter() - began
    batch.close()
    alone.close()
    record.check_growth()
    return record


def _reset(batch: Any, env_id: str, generator: np.random.Generator, record: Record) -> int | None:
    """Now and then reset all, or some with options; the seed of all environments if all were."""
    chance = generator.random()
    if chance < 0.05:
        seed = int(generator.integers(2**31))
        batch.reset(seed=seed)
        return seed
    if chance < 0.08 and env_id in OPTIONS:
        name, low, high = OPTIONS[env_id]
        mask = generator.random(batch.num_envs) < 0.02
        before = batch.task.batch["observation"].copy()
        value = round(float(generator.uniform(low, high)), 2)
        try:
            batch.reset(options={"reset_mask": mask, name: value})
        except ValueError:
            record.refused += 1
            if not (before == batch.task.batch["observation"]).all():
                record.faults.append(f"step {record.count}: a refused reset changed observations")
    return None


def _compare(observation: NDArray[Any], batch: Any, watched: int, record: Record) -> None:
    if not (observation[0] == batch.task.batch["observation"][watched]).all():
        record.faults.append(f"step {record.count}: environment {watched} begins otherwise than the same one alone")


def patterns(generator: np.random.Generator, num_envs: int, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Actions of a block ``(BLOCK, num_envs, *shape)``, a pattern drawn for each environment."""
    size = (BLOCK, num_envs, *shape)
    uniform = generator.uniform(-1.0, 1.0, size)
    time_of = np.arange(BLOCK).reshape(-1, *(1,) * (len(size) - 1))
    waves = np.sin(time_of * generator.uniform(0.02, 3.0, size[1:]) + generator.uniform(0.0, 6.3, size[1:]))
    constant = np.broadcast_to(generator.uniform(-1.0, 1.0, size[1:]), size)
    huge = uniform * 10.0 ** generator.uniform(0.0, 38.0, size[1:])
    kicks = np.where(generator.random(size) < 0.03, np.sign(uniform), 0.0)
    kinds = (uniform, np.sign(uniform), constant, np.sign(constant), waves, np.sign(waves), huge, kicks, 0.0 * uniform)
    drawn = generator.integers(len(kinds), size=num_envs).reshape(1, num_envs, *(1,) * len(shape))
    return np.choose(drawn, kinds).astype(np.float32)


def make_and_close(kind: str, options: Soak) -> Record:
    """Make, reset, step and close environments of one kind, ``single``, ``batch`` or ``rendered``."""
    record = Record(f"make and close, {kind}")
    ids = [options.env] if options.env else envs.env_ids()
    began, warm, first = time.perf_counter(), 2 * len(ids), (0, 0)
    while record.count < options.closes:
        env_id = ids[record.count % len(ids)]
        env: Any = (
            gym.make_vec(env_id, num_envs=64)
            if kind == "batch"
            else gym.make(env_id, render_mode="rgb_array" if kind == "rendered" else None)
        )
        env.reset(seed=record.count)
        env.step(env.action_space.sample())
        if kind == "rendered":
            env.render()
        env.close()
        record.count += 1
        if record.count == warm:
            first = _held()
        if record.count >= warm and record.count % 20 == 0:
            gc.collect()
            record.memory.append(memory_mib())
    last = _held()
    if record.count >= warm and (last[0] > first[0] or last[1] > first[1]):
        record.faults.append(
            f"{last[0]} threads and {last[1]} descriptors, after {warm} of them {first[0]}, {first[1]}"
        )
    record.seconds = time.perf_counter() - began
    record.check_growth()
    return record


def memory_mib() -> float:
    """Resident memory now, where the system says it, or else the most so far."""
    try:
        with open("/proc/self/statm") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)


def _held() -> tuple[int, int]:
    """Numbers of threads and of open file descriptors."""
    gc.collect()
    return threading.active_count(), len(os.listdir("/dev/fd"))


def main() -> int:
    """Run the soak; 1 if something was found."""
    options = tyro.cli(Soak, prog="python -m tools.soak", description=__doc__)
    found = 0
    runs = [
        (env_id, mode) for env_id in ([options.env] if options.env else envs.env_ids()) for mode in modes_of(env_id)
    ]
    for env_id, mode in runs if options.steps else ():
        found += _shown(soak(env_id, mode, options))
    for kind in ("single", "batch", "rendered") if options.closes else ():
        found += _shown(make_and_close(kind, options))
    return int(found > 0)


def _shown(record: Record) -> int:
    """Print a record with its faults; how many there are."""
    print("\n    ".join([str(record), *record.faults]), flush=True)
    return len(record.faults)
