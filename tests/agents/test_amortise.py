"""Fitting a policy to the cost of motions, and steps that are whole episodes; needs the `rl` extra."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from agents import evaluate, load_agent

pytest.importorskip("stable_baselines3", reason='needs pip install "planarm[rl]"')

import torch

from agents.environments import make_batch
from agents.training.recipe import TrainingConfig
from agents.training.run import TrainingRun
from agents.training.vec_env import NativeVecEnv
from agents.training.warm_start.amortise import MoveCost
from agents.training.whole_episodes import WholeEpisodes

pytestmark = pytest.mark.rl

ENV = "MinTorqueMove-v0"
MOTION = {"control_mode": "motion"}
SMALL: dict[str, Any] = {
    "env": ENV,
    "env_config": MOTION,
    "whole_episodes": True,
    "total_steps": 64,
    "num_envs": 16,
    "rollout_steps": 2,
    "batch_size": 32,
    "epochs": 1,
    "log_std": -6.0,
    "hidden": [64, 64],
    "activation": "relu",
    "amortise": {"moves": 2000, "updates": 150, "batch_size": 128},
    "checkpoint_steps": 32,
    "evaluation_episodes": 20,
    "baselines": ["follower"],
}


class Given:
    """One action an environment, decided beforehand."""

    def __init__(self, actions: Any) -> None:
        self.actions = actions

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = False
    ) -> tuple[Any, Any]:
        return self.actions, None


@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_the_cost_is_what_the_physics_spends(gravity: float) -> None:
    settings = {**MOTION, "gravity": gravity}
    env = gym.make_vec(ENV, num_envs=64, **settings)
    observations, _ = env.reset(seed=0)
    actions = np.random.default_rng(0).normal(scale=0.004, size=(64, env.single_action_space.shape[0]))  # type: ignore[index]
    cost = MoveCost(env.unwrapped.task)(torch.from_numpy(observations), torch.from_numpy(actions.astype(np.float32)))
    spent = evaluate(Given(actions.astype(np.float32)), ENV, range(64), env_config=settings, num_envs=64)
    gentle = spent.metrics["limit_ratio"] < 0.9  # no price for what exceeds a limit
    assert gentle.sum() >= 10
    np.testing.assert_allclose(cost.numpy()[gentle], spent.metrics["quintic_ratio"][gentle], rtol=0.02)


def test_what_exceeds_a_limit_costs_more() -> None:
    env = gym.make_vec(ENV, num_envs=8, **MOTION)
    observations, _ = env.reset(seed=0)
    cost = MoveCost(env.unwrapped.task)
    wild = torch.full((8, env.single_action_space.shape[0]), 0.5)  # type: ignore[index]
    assert (cost(torch.from_numpy(observations), wild) > 100.0).all()


def test_a_run_amortises_and_can_be_repeated(tmp_path: Path) -> None:
    config = TrainingConfig.parse(SMALL, "training setting")
    for name in ("one", "two"):
        run = TrainingRun.begin(tmp_path / name, config, "test")
        assert run.train()
        ratio = run.state.rows[0]["quintic_ratio"]
        assert ratio < 0.9  # the quintic, with which it begins, is 1
        assert run.state.rows[0]["success"] > 0.5
        assert [row["steps"] for row in run.state.rows] == [0, 32, 64]
    first, second = ((tmp_path / name / "last.safetensors").read_bytes() for name in ("one", "two"))
    assert first == second
    agent = load_agent(tmp_path / "one")
    assert agent.action_config == MOTION


def test_other_environments_are_refused(tmp_path: Path) -> None:
    config = TrainingConfig.parse({**SMALL, "env_config": {}, "whole_episodes": False}, "training setting")
    with pytest.raises(ValueError, match="amortise needs MinTorqueMove-v0 with control_mode motion"):
        TrainingRun.begin(tmp_path / "run", config, "test")
    assert not (tmp_path / "run").exists()


def test_a_step_is_an_episode_in_every_environment() -> None:
    venv = NativeVecEnv(WholeEpisodes(make_batch(ENV, 6, MOTION)))
    venv.seed(3)
    first = venv.reset()
    actions = np.zeros((6, venv.action_space.shape[0]), np.float32)  # type: ignore[index]
    observations, returns, ended, infos = venv.step(actions)
    expected = evaluate(Given(actions), ENV, range(3, 9), env_config=MOTION, num_envs=6)
    np.testing.assert_allclose(returns, expected.returns, rtol=1e-6)
    assert ended.all()
    assert not np.array_equal(first, observations)
    for env_index, info in enumerate(infos):
        assert info["torque_l1"] == expected.metrics["torque_l1"][env_index]
        assert info["terminal_observation"].shape == (observations.shape[1],)
        assert info["TimeLimit.truncated"] is False
