"""ExcavatorPayload-v0 with the Kalman filter inside: control mode "estimated"."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import envs
from planners.typing import Array

ENV_ID = "ExcavatorPayload-v0"
UNCERTAIN = {"mass_error": (-0.1, 0.1), "latency": (0.0, 0.02), "encoder_noise": 3e-4}


def make(**config: Any) -> Any:
    return gym.make(ENV_ID, control_mode="estimated", horizon=6.0, **config).unwrapped


def entry(env: Any, observation: Array, name: str) -> Array:
    values: Array = env.task.layout.parse(observation)[name]
    return values


@pytest.mark.parametrize("config", [{"level": 2}, UNCERTAIN])
def test_an_action_of_zero_is_the_expert(config: dict[str, Any]) -> None:
    inside, outside = make(**config), gym.make(ENV_ID, horizon=6.0, **config).unwrapped
    expert, still = envs.make_expert("kalman", outside), np.zeros(3, np.float32)
    observation, seen = inside.reset(seed=1)[0], outside.reset(seed=1)[0]
    for _ in range(120):
        action, _ = expert.predict(seen)
        np.testing.assert_allclose(entry(inside, observation, "estimated_torque"), action, atol=2e-4)
        assert expert.mass_estimate is not None
        assert entry(inside, observation, "estimated_payload")[0] == pytest.approx(expert.mass_estimate[0], abs=0.5)
        observation, *_ = inside.step(still)
        seen, *_ = outside.step(action)
    np.testing.assert_allclose(inside.joint_state()[0], outside.joint_state()[0], atol=1e-5)


def test_the_expert_adds_nothing_to_itself() -> None:
    env = make()
    expert, observation = envs.make_expert("kalman", env), env.reset(seed=2)[0]
    for _ in range(30):
        action, _ = expert.predict(observation)
        assert np.abs(action).max() < 1e-4
        observation, *_ = env.step(action)


def test_the_filter_knows_the_torques_that_an_action_adds() -> None:
    env, rng = make(), np.random.default_rng(0)
    observation, _ = env.reset(seed=3, options={"payload": 200.0})
    assert entry(env, observation, "payload_deviation")[0] == pytest.approx(100.0, rel=0.02)
    for _ in range(150):
        observation, *_ = env.step(rng.uniform(-0.05, 0.05, 3).astype(np.float32))
    assert entry(env, observation, "estimated_payload")[0] == pytest.approx(200.0, abs=2.0)
    assert entry(env, observation, "payload_deviation")[0] < 2.0
    q, _ = env.joint_state()
    reference = entry(env, observation, "reference_error") + entry(env, observation, "joint_position")
    np.testing.assert_allclose(reference - entry(env, observation, "estimated_error"), q, atol=1e-4)


def test_an_action_adds_its_share_of_the_limits() -> None:
    env = make(encoder_noise=0.0)
    observation, _ = env.reset(seed=4)
    base = entry(env, observation, "estimated_torque")
    observation, *_ = env.step(np.array([0.1, -0.1, 0.2], np.float32))
    added = entry(env, observation, "last_torque") - base
    np.testing.assert_allclose(added, [0.04, -0.04, 0.06], atol=1e-5)


def test_other_modes_observe_no_estimate() -> None:
    plain, estimated = gym.make(ENV_ID).unwrapped, make()
    assert plain.observation_space.shape == (35,)
    assert estimated.observation_space.shape == (47,)
    np.testing.assert_array_equal(plain.reset(seed=5)[0][:30], estimated.reset(seed=5)[0][:30])
