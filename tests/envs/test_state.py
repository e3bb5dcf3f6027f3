"""`get_state` and `set_state`, copies and pickles: what follows is the same to the bit."""

from __future__ import annotations

import copy
import dataclasses
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import envs
from envs.obstacle_dodge import kernels
from tests.pages import follow

every_env = pytest.mark.parametrize("env_id", envs.env_ids())
every_kind = pytest.mark.parametrize("num_envs", [0, 3])
Env = Any


def made(env_id: str, num_envs: int = 0, **settings: Any) -> Env:
    return gym.make_vec(env_id, num_envs=num_envs, **settings) if num_envs else gym.make(env_id, **settings)


def moved(env: Env, seed: int = 3, steps: int = 7) -> Env:
    """An environment in the middle of an episode."""
    env.reset(seed=seed)
    for action in actions(env, steps):
        env.step(action)
    return env


def actions(env: Env, count: int) -> list[Any]:
    draw = np.random.default_rng(count)
    return [0.2 * draw.uniform(-1.0, 1.0, env.action_space.shape).astype(np.float32) for _ in range(count)]


def future(env: Env, steps: int = 12) -> bytes:
    """Everything that an environment returns from now on, over the next reset too."""
    seen: list[Any] = [env.step(action) for action in actions(env, steps)]
    seen.append(env.reset())
    seen += [env.step(action) for action in actions(env, 3)]
    return repr(seen).encode() + pickle.dumps(env.unwrapped.get_state())


@every_env
@every_kind
def test_a_state_is_continued_to_the_bit_as_often_as_wanted(env_id: str, num_envs: int) -> None:
    env = moved(made(env_id, num_envs))
    state = env.unwrapped.get_state()
    expected = future(env)
    assert env.unwrapped.get_state() != state
    other = moved(made(env_id, num_envs), seed=8, steps=2)
    for one in (env, env, other):
        one.unwrapped.set_state(pickle.loads(pickle.dumps(state)))
        assert one.unwrapped.get_state() == state
        assert future(one) == expected


@every_env
@every_kind
@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))], ids=["deep", "pickle"])
def test_copies_go_on_with_the_episode(env_id: str, num_envs: int, copied: Callable[[Env], Env]) -> None:
    env = moved(made(env_id, num_envs))
    other = copied(env)
    assert other.unwrapped.task is not env.unwrapped.task
    assert other.unwrapped.spec == env.unwrapped.spec
    assert future(other) == future(env)


def test_a_shallow_copy_is_an_environment_of_its_own() -> None:
    for num_envs in (0, 2):
        env = moved(made("MinTorqueMove-v0", num_envs)).unwrapped
        other = copy.copy(env)
        assert future(other) == future(env)
        task = copy.copy(env.task)
        assert task.get_state() == env.task.get_state()
        task.advance()
        assert task.get_state() != env.task.get_state()


def test_the_load_of_the_bucket_and_its_changes_are_kept() -> None:
    env, other = (made("ExcavatorPayload-v0", level=2, control_mode="residual") for _ in range(2))
    env.reset(seed=0)
    other.reset(seed=1)
    task = env.unwrapped.task
    still = np.zeros(3, dtype=np.float32)
    while not task.batch["load"][0]:
        if env.step(still)[2]:
            pytest.fail("the episode ended before the payload was picked up")
    other.unwrapped.set_state(env.unwrapped.get_state())
    assert other.unwrapped.task.batch["load"][0] > 0.0
    for _ in range(5):
        np.testing.assert_array_equal(env.step(still)[0], other.step(still)[0])


def test_the_time_limit_of_gymnasium_goes_back_with_the_state() -> None:
    env = made("ConveyorTrack-v0", max_episode_steps=10)
    state = moved(env, steps=6).unwrapped.get_state()
    copies = [env, copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    for one in copies:
        one.step(np.zeros(2))
        one.unwrapped.set_state(state)
        cut = [one.step(np.zeros(2))[3] for _ in range(4)]
        assert cut == [False, False, False, True]


def test_a_state_beyond_the_time_limit_is_of_an_episode_that_is_over() -> None:
    state = moved(made("ConveyorTrack-v0"), steps=4).unwrapped.get_state()
    for limit in (3, 4):
        env = made("ConveyorTrack-v0", max_episode_steps=limit)
        env.reset()
        env.unwrapped.set_state(state)
        with pytest.raises(gym.error.ResetNeeded, match="over"):
            env.step(np.zeros(2))
        many = made("ConveyorTrack-v0", 1, max_episode_steps=limit, autoreset_mode="Disabled")
        many.set_state(state)
        with pytest.raises(gym.error.ResetNeeded, match="over"):
            many.step(np.zeros((1, 2), np.float32))


def test_trails_in_pictures_are_kept() -> None:
    pytest.importorskip("pygame", reason='needs pip install "planarm[viz]"')
    env, other = (made("ConveyorTrack-v0", render_mode="rgb_array") for _ in range(2))
    moved(env, steps=20)
    other.reset(seed=5)
    other.unwrapped.set_state(env.unwrapped.get_state())
    np.testing.assert_array_equal(env.render(), other.render())


def test_the_state_of_one_goes_to_every_environment_of_a_batch() -> None:
    env, many = moved(made("ObstacleDodge-v0")), made("ObstacleDodge-v0", 3)
    many.set_state(env.unwrapped.get_state())
    action = np.array([0.1, -0.2], dtype=np.float32)
    observations = many.step(np.tile(action, (3, 1)))[0]
    np.testing.assert_array_equal(observations, np.tile(env.step(action)[0], (3, 1)))


@pytest.mark.parametrize(
    ("settings", "difference"),
    [
        ({"horizon": 2.5}, r"horizon 3.0, here 2.5"),
        ({"payload": 0.1}, r"payload 0.0, here 0.1"),
        ({"control_mode": "jerk"}, r"control_mode 'torque', here 'jerk'"),
        ({"gravity": 1.0}, r"arm Arm\("),
    ],
)
def test_a_state_of_other_settings_is_refused_with_what_differs(settings: Any, difference: str) -> None:
    state = moved(made("ConveyorTrack-v0")).unwrapped.get_state()
    env = made("ConveyorTrack-v0", **settings).unwrapped
    before = env.get_state()
    with pytest.raises(ValueError, match=difference):
        env.set_state(state)
    assert env.get_state() == before


def test_what_is_no_state_of_it_is_refused() -> None:
    env, many = moved(made("ConveyorTrack-v0")).unwrapped, moved(made("ConveyorTrack-v0", 3))
    other = moved(made("MinTorqueMove-v0")).unwrapped
    for given, reason in [
        (3, r"get_state\(\) returned, found 3"),
        (other.get_state(), "environment 'MinTorqueMove-v0', here 'ConveyorTrack-v0'"),
        (many.get_state(), "the state of a single environment"),
        (env.task.get_state(), r"from its get_state\(\)"),
    ]:
        before = env.get_state()
        with pytest.raises(ValueError, match=reason):
            env.set_state(given)
        assert env.get_state() == before
    with pytest.raises(ValueError, match="2 environments, here are 3"):
        many.task.set_state(made("ConveyorTrack-v0", 2).task.get_state())
    damaged = copy.copy(env.get_state())
    object.__setattr__(damaged, "physics", damaged.physics[:-8])
    with pytest.raises(ValueError, match="damaged"):
        env.set_state(damaged)


def test_nobody_can_make_a_state_of_other_contents() -> None:
    """Compiled code takes places in arrays from the records of a state."""
    state = moved(made("ExcavatorPayload-v0")).unwrapped.get_state()
    contents = {each.name: getattr(state, each.name) for each in dataclasses.fields(state)}
    for attempt in (
        lambda: dataclasses.replace(state, records=bytes(len(state.records))),
        lambda: type(state)(**contents),
        lambda: setattr(state, "records", b""),
    ):
        with pytest.raises((TypeError, dataclasses.FrozenInstanceError)):
            attempt()
    assert pickle.loads(pickle.dumps(state)) == copy.deepcopy(state) == state


def test_bodies_alone_cannot_be_copied() -> None:
    with pytest.raises(TypeError, match="copy or pickle the environment or the task"):
        copy.deepcopy(made("ConveyorTrack-v0").unwrapped.task._batch.world)


@every_env
def test_an_expert_is_copied_with_its_task(env_id: str) -> None:
    env = made(env_id)
    observation, _ = env.reset(seed=0)
    expert = envs.make_expert("random", env)
    other = copy.deepcopy(expert)
    assert other.task is not expert.task
    np.testing.assert_array_equal(other.predict(observation)[0], expert.predict(observation)[0])
    other.task.advance()
    assert pickle.loads(pickle.dumps(expert)).task.get_state() == expert.task.get_state()


@pytest.mark.docs
def test_the_page_on_states_works(tmp_path: Path) -> None:
    total = float(follow("extend/state.md", tmp_path).split()[-1])
    env = made("ConveyorTrack-v0", control_mode="jerk")
    env.reset(seed=0)
    assert total > sum(env.step(np.zeros(2))[1] for _ in range(10)) + 0.001


def test_another_horizon_compiles_nothing() -> None:
    kernel = kernels.advance_batch.kernel._compiled
    moved(made("ObstacleDodge-v0"))
    known = len(kernel.signatures)
    for settings in ({"horizon": 4.0}, {"horizon": 9.0, "control_period": 0.01}, {"tolerance": 0.1}, {"payload": 1}):
        moved(made("ObstacleDodge-v0", **settings))
    assert len(kernel.signatures) == known
