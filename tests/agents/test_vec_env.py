"""Environments as Stable-Baselines3 sees them; needs the `rl` extra."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import envs  # noqa: F401

pytest.importorskip("stable_baselines3", reason='needs pip install "planarm[rl]"')

from agents.training.vec_env import NativeVecEnv

pytestmark = pytest.mark.rl

N_ENVS = 3


def venv(env_id: str = "ConveyorTrack-v0", **config: Any) -> NativeVecEnv:
    return NativeVecEnv(gym.make_vec(env_id, num_envs=N_ENVS, **config))


def still(env: NativeVecEnv) -> np.ndarray[Any, Any]:
    return np.zeros((N_ENVS, *env.action_space.shape), dtype=np.float32)


def test_only_environments_that_end_are_told_of_and_the_time_limit_is_named() -> None:
    env = venv(horizon=2.0)
    env.seed(5)
    env.reset()
    total = np.zeros(N_ENVS)
    for step in range(1, 101):
        seen, rewards, ended, infos = env.step(still(env))
        total += rewards
        assert ended.tolist() == [step == 100] * N_ENVS
        if step < 100:
            assert infos == [{}] * N_ENVS
    for env_index, info in enumerate(infos):
        assert info["TimeLimit.truncated"] is True
        assert info["episode"]["l"] == 100
        assert info["episode"]["r"] == pytest.approx(total[env_index], abs=1e-5)
        assert {"is_success", "steady_state_error", "limit_ratio"} <= set(info)
        assert not np.array_equal(info["terminal_observation"], seen[env_index])


def test_each_environment_is_the_single_environment_with_its_own_seed() -> None:
    env = venv(horizon=2.0)
    assert env.seed(40) == [40, 41, 42]
    seen = env.reset()
    for env_index in range(N_ENVS):
        single = gym.make("ConveyorTrack-v0", horizon=2.0)
        np.testing.assert_array_equal(single.reset(seed=40 + env_index)[0], seen[env_index])


def test_a_collision_is_no_time_limit() -> None:
    env = venv("ObstacleDodge-v0")
    env.seed(0)
    env.reset()
    generator = np.random.default_rng(0)
    endings = []
    for _ in range(400):
        actions = np.sign(generator.uniform(-1.0, 1.0, (N_ENVS, 1))) * np.ones_like(still(env))
        endings += [info for info in env.step(actions.astype(np.float32))[3] if info]
    collided = [info for info in endings if info["collision"]]
    assert collided
    assert not any(info["TimeLimit.truncated"] for info in collided)


def test_what_resets_in_another_way_is_refused() -> None:
    vector = gym.make_vec("CartPole-v1", num_envs=2, vectorization_mode="sync")
    assert vector.metadata["autoreset_mode"] != AutoresetMode.SAME_STEP
    with pytest.raises(ValueError, match="SAME_STEP"):
        NativeVecEnv(vector)
    vector.close()


def test_environments_have_nothing_of_their_own() -> None:
    env = venv()
    assert env.get_attr("render_mode", [0]) == [None]
    assert env.env_is_wrapped(gym.Wrapper) == [False] * N_ENVS
    with pytest.raises(NotImplementedError, match="share"):
        env.set_attr("render_mode", "human")
    with pytest.raises(NotImplementedError, match="no methods of their own"):
        env.env_method("reset")
