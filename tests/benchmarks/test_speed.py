"""How fast the environments are, always beside a yardstick measured in the same run.

Run with ``python -m pytest tests/benchmarks --benchmark-enable``. Without the flag each case runs once, unmeasured.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from numba import njit
from pytest_benchmark.fixture import BenchmarkFixture

import envs  # noqa: F401  (registers the ids)
from envs import chipmunk

LANES, SUBSTEPS, PERIODS = 256, 10, 100
space_step = chipmunk.space_step


def steps(env_id: str, count: int = 500) -> Callable[[], None]:
    """Single steps through `gym.make`, resets included."""
    env = gym.make(env_id)
    env.action_space.seed(0)
    action = env.action_space.sample()
    env.reset(seed=0)

    def run() -> None:
        for _ in range(count):
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()

    return run


def batch_steps() -> Callable[[], None]:
    """Control steps of many lanes, automatic resets included."""
    vector = gym.make_vec("ConveyorTrack-v0", num_envs=LANES)
    vector.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (LANES, 2)).astype(np.float32)

    def run() -> None:
        for _ in range(PERIODS):
            vector.step(actions)

    return run


@njit(nogil=True)
def sub_steps(spaces: Any, count: int, step: float) -> None:
    for space in spaces:
        for _ in range(count):
            space_step(space, step)


def bare_chipmunk() -> Callable[[], None]:
    """The physics of `batch_steps` and nothing else, on as many threads."""
    vector = gym.make_vec("ConveyorTrack-v0", num_envs=LANES)
    vector.reset(seed=0)
    halves = np.split(vector.unwrapped.task.lanes["space"].copy(), 2)  # type: ignore[attr-defined]
    pool = ThreadPoolExecutor(2)

    def run() -> None:
        assert vector is not None  # keeps the spaces alive
        for _ in range(PERIODS):
            list(pool.map(lambda half: sub_steps(half, SUBSTEPS, 0.002), halves))

    return run


@pytest.mark.benchmark(group="single step")
@pytest.mark.parametrize("env_id", ["ConveyorTrack-v0", "Reacher-v5"])
def test_single_step(benchmark: BenchmarkFixture, env_id: str) -> None:
    benchmark(steps(env_id))


@pytest.mark.benchmark(group=f"{LANES} lanes, {PERIODS} control periods")
@pytest.mark.parametrize("work", [batch_steps, bare_chipmunk])
def test_batch(benchmark: BenchmarkFixture, work: Callable[[], Callable[[], None]]) -> None:
    benchmark(work())


def fastest(*candidates: Callable[[], None], rounds: int = 15) -> list[float]:
    """Shortest time of each, taken in turns so that a busy moment strikes all alike, s."""
    times = np.empty((rounds, len(candidates)))
    for each in times:
        for index, candidate in enumerate(candidates):
            began = time.perf_counter()
            candidate()
            each[index] = time.perf_counter() - began
    return times.min(axis=0).tolist()  # type: ignore[no-any-return]


@pytest.fixture
def measured(request: pytest.FixtureRequest) -> None:
    if not request.config.getoption("--benchmark-enable"):
        pytest.skip("a ratio of times; needs --benchmark-enable")


@pytest.mark.usefixtures("measured")
def test_a_step_costs_at_most_half_of_reacher() -> None:
    ours, reacher = fastest(steps("ConveyorTrack-v0"), steps("Reacher-v5"))
    print(f"ConveyorTrack-v0 {2e3 * ours:.1f} us a step, Reacher-v5 {2e3 * reacher:.1f} us: ratio {reacher / ours:.1f}")
    assert reacher / ours >= 2.0


@pytest.mark.usefixtures("measured")
def test_the_batch_reaches_most_of_what_chipmunk_gives() -> None:
    ours, bare = fastest(batch_steps(), bare_chipmunk())
    rate = LANES * PERIODS / ours
    print(f"{LANES} lanes: {rate:,.0f} control steps a second, {bare / ours:.0%} of bare Chipmunk")
    assert bare / ours >= 0.6


@pytest.mark.usefixtures("measured")
def test_cold_start() -> None:
    code = "import envs, gymnasium as gym; gym.make('ConveyorTrack-v0').reset(seed=0)"
    yardstick = "import numba, gymnasium, scipy.optimize"

    def run(program: str) -> Callable[[], None]:
        return lambda: subprocess.run([sys.executable, "-c", program], check=True) and None

    ours, imports = fastest(run(code), run(yardstick), rounds=3)
    print(f"gym.make and reset in a new process {ours:.2f} s; importing the libraries alone {imports:.2f} s")
    assert ours / imports <= 5.0
