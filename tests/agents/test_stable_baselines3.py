"""The environments and experts as Stable-Baselines3 sees them; needs the `rl` extra."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import envs
from envs.actuation import CONTROL_MODES

pytest.importorskip("stable_baselines3", reason='needs pip install "planarm[rl]"')

from stable_baselines3 import PPO
from stable_baselines3.common.env_checker import check_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor

ENV_IDS = ["ConveyorTrack-v0"]

pytestmark = pytest.mark.parametrize("env_id", ENV_IDS)


@pytest.mark.parametrize("control_mode", CONTROL_MODES)
def test_environment_check(env_id: str, control_mode: str) -> None:
    check_env(gym.make(env_id, control_mode=control_mode, render_mode="rgb_array").unwrapped)


def test_an_expert_is_evaluated_like_a_policy(env_id: str) -> None:
    env = Monitor(gym.make(env_id))
    expert: Any = envs.make_expert("dpct", env)
    env.reset(seed=0)
    returns, lengths = evaluate_policy(expert, env, n_eval_episodes=3, return_episode_rewards=True)
    assert min(returns) > 1.0
    assert lengths == [150, 150, 150]


def test_training_twice_gives_the_same_weights(env_id: str) -> None:
    def weights() -> np.ndarray[Any, Any]:
        model = PPO("MlpPolicy", gym.make(env_id, control_mode="jerk"), n_steps=64, batch_size=32, seed=3, device="cpu")
        model.learn(128)
        return np.concatenate([value.numpy().ravel() for value in model.policy.state_dict().values()])

    np.testing.assert_array_equal(weights(), weights())
