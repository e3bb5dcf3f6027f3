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

MODES: dict[str, tuple[str, ...]] = {
    "ConveyorTrack-v0": CONTROL_MODES,
    "MinTorqueMove-v0": ("torque",),
    "ObstacleDodge-v0": ("torque", "acceleration"),
}
every_env = pytest.mark.parametrize("env_id", MODES)


@pytest.mark.parametrize(
    ("env_id", "control_mode"), [(env_id, mode) for env_id, modes in MODES.items() for mode in modes]
)
def test_environment_check(env_id: str, control_mode: str) -> None:
    check_env(gym.make(env_id, control_mode=control_mode, render_mode="rgb_array").unwrapped)


@every_env
def test_an_expert_is_evaluated_like_a_policy(env_id: str) -> None:
    env = Monitor(gym.make(env_id), info_keywords=("is_success", "limit_ratio"))
    expert: Any = envs.make_expert("dpct", env)
    env.reset(seed=0)
    successes = []
    evaluate_policy(expert, env, n_eval_episodes=3, callback=lambda local, _: successes.append(local["info"]))
    assert sum(info["is_success"] for info in successes if "limit_ratio" in info) == 3


@every_env
def test_training_twice_gives_the_same_weights(env_id: str) -> None:
    def weights() -> np.ndarray[Any, Any]:
        model = PPO("MlpPolicy", gym.make(env_id), n_steps=64, batch_size=32, seed=3, device="cpu")
        model.learn(128)
        return np.concatenate([value.numpy().ravel() for value in model.policy.state_dict().values()])

    np.testing.assert_array_equal(weights(), weights())
