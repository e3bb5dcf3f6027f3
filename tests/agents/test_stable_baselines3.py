"""The environments and experts as Stable-Baselines3 sees them; needs the `rl` extra."""

from __future__ import annotations

from contextlib import closing
from typing import Any, get_args

import gymnasium as gym
import numpy as np
import pytest

import envs
from envs.experts import expert_names
from tools.config_tables import documented

pytest.importorskip("stable_baselines3", reason='needs pip install "planarm[rl]"')

from stable_baselines3 import PPO
from stable_baselines3.common.env_checker import check_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv

pytestmark = pytest.mark.rl

MODES = [
    (env_id, mode)
    for env_id in envs.env_ids()
    for mode in get_args(documented()[env_id].model_fields["control_mode"].annotation)
]
every_env = pytest.mark.parametrize("env_id", envs.env_ids())
EPISODES = 2


def returns_by_hand(env_id: str, name: str) -> list[float]:
    """Of episodes one after the other, of which the first alone is given a seed."""
    with closing(gym.make(env_id)) as env:
        totals = []
        for episode in range(EPISODES):
            expert = envs.make_expert(name, env)
            observation, _ = env.reset(seed=None if episode else 0)
            state, begins, total, ended = None, np.ones(1, dtype=bool), 0.0, False
            while not ended:
                actions, state = expert.predict(observation[None], state, begins, deterministic=True)
                observation, reward, terminated, truncated, _ = env.step(actions[0])
                begins, total, ended = np.zeros(1, dtype=bool), total + float(reward), terminated or truncated
            totals.append(total)
        return totals


@pytest.mark.parametrize(("env_id", "control_mode"), MODES)
def test_environment_check(env_id: str, control_mode: str) -> None:
    check_env(gym.make(env_id, control_mode=control_mode, render_mode="rgb_array").unwrapped)


@pytest.mark.parametrize(
    ("env_id", "name"),
    [(env_id, name) for env_id in envs.env_ids() for name in expert_names(env_id) if name != "random"],
)
def test_an_expert_is_evaluated_like_a_policy(env_id: str, name: str) -> None:
    venv = DummyVecEnv([lambda: Monitor(gym.make(env_id), info_keywords=("is_success", "limit_ratio"))])
    expert: Any = envs.make_expert(name, venv.envs[0])
    venv.seed(0)
    ends: list[dict[str, Any]] = []

    def watch(local: dict[str, Any], _: Any) -> None:
        if local["done"]:
            ends.append(local["info"])

    returns, lengths = evaluate_policy(
        expert, venv, n_eval_episodes=EPISODES, callback=watch, return_episode_rewards=True
    )
    assert returns == pytest.approx(returns_by_hand(env_id, name), abs=1e-6)
    assert [info["episode"]["l"] for info in ends] == lengths
    assert [info["episode"]["is_success"] for info in ends] == [info["is_success"] for info in ends]


@every_env
def test_training_twice_gives_the_same_weights(env_id: str) -> None:
    def weights() -> np.ndarray[Any, Any]:
        model = PPO("MlpPolicy", gym.make(env_id), n_steps=64, batch_size=32, seed=3, device="cpu")
        model.learn(128)
        return np.concatenate([value.numpy().ravel() for value in model.policy.state_dict().values()])

    np.testing.assert_array_equal(weights(), weights())
