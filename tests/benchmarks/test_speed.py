"""How fast the environments are, always beside a yardstick measured in the same run.

Run with ``python -m pytest tests/benchmarks --benchmark-enable``. Without the flag each case runs once, unmeasured.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from numba import njit
from pytest_benchmark.fixture import BenchmarkFixture

import envs  # noqa: F401  (registers the ids)
from envs import make_expert
from envs.batch.pool import Pool, _work_together
from envs.physics import chipmunk
from planners.apf import dodge_accelerations, tuned_gains
from planners.typing import Array

N_ENVS, SUBSTEPS, PERIODS = 256, 10, 100
MID_EPISODE, DODGE_PERIODS = 50, 20
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
    """Control steps of many environments, automatic resets included."""
    vector = gym.make_vec("ConveyorTrack-v0", num_envs=N_ENVS)
    vector.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (N_ENVS, 2)).astype(np.float32)

    def run() -> None:
        for _ in range(PERIODS):
            vector.step(actions)

    return run


@dataclass(frozen=True)
class DodgeEpisode:
    """A batch in the middle of its episodes, as its expert sees it and what that remembers."""

    vector: Any
    task: Any
    seen: dict[str, Array]
    memory: Any


@pytest.fixture
def dodge_episode() -> Iterator[DodgeEpisode]:
    with closing(gym.make_vec("ObstacleDodge-v0", num_envs=N_ENVS)) as vector:
        task = vector.unwrapped.task  # type: ignore[attr-defined]
        expert = make_expert("apf", vector)
        observations, _ = vector.reset(seed=0)
        memory = None
        for _ in range(MID_EPISODE):
            actions, memory = expert.predict(observations, memory)
            observations, *_ = vector.step(actions)
        yield DodgeEpisode(vector, task, task.layout.parse(observations), memory)


def dodging_field(episode: DodgeEpisode) -> Callable[[], None]:
    """An action of the field for every environment, again and again: half of the times it decides, as in control."""
    task, seen, memory = episode.task, episode.seen, episode.memory.copy()
    base, gains = task.arm.base_array, tuned_gains()
    places = seen["obstacle"].reshape(N_ENVS, -1, 2) + base
    rates = seen["obstacle_velocity"].reshape(places.shape)

    def run() -> None:
        for _ in range(DODGE_PERIODS):
            dodge_accelerations(
                task.arm,
                gains,
                seen["joint_position"],
                seen["joint_velocity"],
                seen["goal"] + base,
                places,
                rates,
                seen["obstacle_radius"],
                memory,
                task.config.control_period,
            )

    return run


def dodging_steps(episode: DodgeEpisode) -> Callable[[], None]:
    """Control steps of the same batch, automatic resets included."""
    actions = np.zeros((N_ENVS, 2), dtype=np.float32)

    def run() -> None:
        for _ in range(DODGE_PERIODS):
            episode.vector.step(actions)

    return run


@njit(nogil=True)
def sub_steps(spaces: Any, count: int, step: float) -> None:
    for space in spaces:
        for _ in range(count):
            space_step(space, step)


def bare_chipmunk() -> Callable[[], None]:
    """The physics of `batch_steps` and nothing else, on as many threads."""
    vector = gym.make_vec("ConveyorTrack-v0", num_envs=N_ENVS)
    vector.reset(seed=0)
    halves = np.split(vector.unwrapped.task._batch.records["space"].copy(), 2)  # type: ignore[attr-defined]
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


@pytest.mark.benchmark(group=f"{N_ENVS} environments, {PERIODS} control periods")
@pytest.mark.parametrize("work", [batch_steps, bare_chipmunk])
def test_batch(benchmark: BenchmarkFixture, work: Callable[[], Callable[[], None]]) -> None:
    benchmark(work())


@pytest.mark.benchmark(group=f"the dodging field, {N_ENVS} environments, {DODGE_PERIODS} control periods")
@pytest.mark.parametrize("work", [dodging_field, dodging_steps])
def test_dodging(
    benchmark: BenchmarkFixture, dodge_episode: DodgeEpisode, work: Callable[[DodgeEpisode], Callable[[], None]]
) -> None:
    benchmark(work(dodge_episode))
    if benchmark.stats is not None:  # it is measured
        actions = DODGE_PERIODS * N_ENVS
        benchmark.extra_info["us an action"] = round(1e6 * benchmark.stats.stats.min / actions, 2)


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
def test_a_step_costs_at_most_a_third_of_reacher() -> None:
    ours, reacher = fastest(steps("ConveyorTrack-v0"), steps("Reacher-v5"))
    print(f"ConveyorTrack-v0 {2e3 * ours:.1f} us a step, Reacher-v5 {2e3 * reacher:.1f} us: ratio {reacher / ours:.1f}")
    assert reacher / ours >= 3.0


@pytest.mark.usefixtures("measured")
def test_the_batch_reaches_most_of_what_chipmunk_gives() -> None:
    ours, bare = fastest(batch_steps(), bare_chipmunk())
    rate = N_ENVS * PERIODS / ours
    print(f"{N_ENVS} environments: {rate:,.0f} control steps a second, {bare / ours:.0%} of bare Chipmunk")
    assert bare / ours >= 0.6


# Environment, control mode, and required ratio of the rates of `step`, resets included, and of the physics alone.
RESETS = [
    ("ConveyorTrack-v0", "torque", 0.85),
    ("ConveyorTrack-v0", "acceleration", 0.85),
    ("ConveyorTrack-v0", "jerk", 0.85),
    ("ConveyorTrack-v0", "velocity", 0.85),
    ("MinTorqueMove-v0", "torque", 0.5),
    ("MinTorqueMove-v0", "motion", 0.5),
    ("ObstacleDodge-v0", "torque", 0.85),
    ("ObstacleDodge-v0", "acceleration", 0.85),
    ("ObstacleDodge-v0", "velocity", 0.85),
    ("ExcavatorPayload-v0", "torque", 0.5),
    ("ExcavatorPayload-v0", "residual", 0.85),
]


@pytest.mark.usefixtures("measured")
@pytest.mark.parametrize(("env_id", "control_mode", "required"), RESETS)
def test_a_step_of_the_batch_costs_little_more_than_its_physics(
    env_id: str, control_mode: str, required: float
) -> None:
    """With automatic resets, under a policy that moves every other arm gently; in processor time of all threads."""
    vector: Any = gym.make_vec(env_id, num_envs=N_ENVS, autoreset_mode="SameStep", control_mode=control_mode)
    env, rounds, periods = vector.unwrapped, 12, 40
    shape = (periods, *env.action_space.shape)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, shape).astype(np.float32)
    actions[:, ::2] *= 0.1
    env.reset(seed=0)
    for step in range(min(env.task.horizon_steps, 400)):  # until the environments are at different times
        env.step(actions[step % periods])
    times, resets = np.empty((rounds, 2)), 0
    for each in times:
        began = time.process_time()
        for action in actions:
            _, _, terminated, truncated, _ = env.step(action)
            resets += np.count_nonzero(terminated | truncated)
        each[0] = time.process_time() - began
        state, began = env.get_state(), time.process_time()
        for action in actions:
            env.task.advance(action)
        each[1] = time.process_time() - began
        env.set_state(state)
    whole, physics = np.sort(times, axis=0)[2] / (periods * N_ENVS)
    print(
        f"{env_id} {control_mode}: a step {1e6 * whole:.2f} us an environment, its physics {1e6 * physics:.2f} us: "
        f"{physics / whole:.0%}, {resets / (rounds * periods):.1f} resets a step"
    )
    assert physics / whole >= required


# Environment, and required ratio of the rates without resets: in closed form, and with Pymunk.
CLOSED_FORM = [
    ("ConveyorTrack-v0", 8.0),
    ("MinTorqueMove-v0", 8.0),
    ("ObstacleDodge-v0", 8.0),
    ("ExcavatorPayload-v0", 8.0),
]


@pytest.mark.usefixtures("measured")
@pytest.mark.parametrize(("env_id", "required"), CLOSED_FORM)
def test_closed_form_physics_is_faster(env_id: str, required: float) -> None:
    """In processor time of all threads; printed for whole steps with their resets, too."""
    times = np.empty((8, 2, 2))
    vectors: list[Any] = [gym.make_vec(env_id, num_envs=N_ENVS, physics=one) for one in ("pymunk", "closed_form")]
    shape = (40, *vectors[0].action_space.shape)
    actions = np.random.default_rng(0).uniform(-0.1, 0.1, shape).astype(np.float32)
    for each in times:
        for env, taken in zip((vector.unwrapped for vector in vectors), each, strict=True):
            env.reset(seed=0)
            for kind, work in enumerate((env.step, env.task.advance)):
                began = time.process_time()
                for action in actions:
                    work(action)
                taken[kind] = 1e6 * (time.process_time() - began) / (len(actions) * N_ENVS)
    (pymunk_step, pymunk), (step, physics) = times.min(axis=0)
    print(
        f"{env_id}: Pymunk {pymunk:.2f} us an environment, closed form {physics:.2f} us: ratio {pymunk / physics:.1f}; "
        f"steps {pymunk_step:.2f} and {step:.2f} us: {pymunk_step / step:.1f}"
    )
    assert pymunk / physics >= required


@pytest.mark.usefixtures("measured")
def test_a_thread_that_helps_costs_little() -> None:
    """What threads cost besides the work: a step in which every environment rests, in one slice and in many."""
    env: Any = gym.make_vec("ConveyorTrack-v0", num_envs=N_ENVS).unwrapped
    env.reset(seed=0)
    env.task.advance(np.zeros((N_ENVS, 2)), np.ones(N_ENVS, dtype=np.bool_))
    job, threads = env.task._batch._jobs["advance_batch"], Pool(1)

    def repeated(size: int) -> Callable[[], None]:
        return lambda: [_work_together(threads._words, job, 0, size) for _ in range(100)] and None

    one, many = fastest(repeated(N_ENVS), repeated(1))
    call, slice_time = 1e4 * one, 1e4 * (many - one) / (N_ENVS - 1)
    print(f"a call {call:.2f} us, each slice {1e3 * slice_time:.0f} ns")
    assert slice_time < 0.5
    assert call < 5.0


@pytest.mark.usefixtures("measured")
def test_cold_start() -> None:
    code = "import envs, gymnasium as gym; gym.make('ConveyorTrack-v0').reset(seed=0)"
    yardstick = "import numba, gymnasium, scipy.optimize"

    def run(program: str) -> Callable[[], None]:
        return lambda: subprocess.run([sys.executable, "-c", program], check=True) and None

    ours, imports = fastest(run(code), run(yardstick), rounds=3)
    print(f"gym.make and reset in a new process {ours:.2f} s; importing the libraries alone {imports:.2f} s")
    assert ours / imports <= 5.0


@pytest.mark.usefixtures("measured")
def test_an_action_of_the_dodging_field_costs_at_most_a_step(dodge_episode: DodgeEpisode) -> None:
    field, step = fastest(dodging_field(dodge_episode), dodging_steps(dodge_episode))
    per_action = 1e6 / (DODGE_PERIODS * N_ENVS)
    print(f"the dodging field {per_action * field:.2f} us an action, a step {per_action * step:.2f} us an environment")
    assert step / field >= 1.0


@pytest.mark.usefixtures("measured")
@pytest.mark.parametrize("num_envs", [1, N_ENVS])
def test_a_state_is_kept_and_set_in_little_more_than_a_step(num_envs: int) -> None:
    env: Any = gym.make("ConveyorTrack-v0") if num_envs == 1 else gym.make_vec("ConveyorTrack-v0", num_envs=num_envs)
    env = env.unwrapped
    env.reset(seed=0)
    state, action = env.get_state(), np.zeros(env.action_space.shape, dtype=np.float32)
    calls = 100 if num_envs == 1 else 5

    def repeated(call: Callable[[], Any]) -> Callable[[], None]:
        return lambda: [call() for _ in range(calls)] and None

    def stepped() -> None:
        env.set_state(state)
        env.step(action)

    kept, put, put_and_stepped = fastest(
        repeated(env.get_state), repeated(lambda: env.set_state(state)), repeated(stepped)
    )
    kept, put, step = (1e6 * time / calls for time in (kept, put, put_and_stepped - put))
    print(f"{num_envs} environments: get_state {kept:.0f} us, set_state {put:.0f} us, a step {step:.0f} us")
    assert kept + put <= 3.0 * step
