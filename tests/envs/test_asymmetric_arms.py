"""Arms with joint ranges that are not around zero, in the environments: starts, brakes, measured use of the ranges."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

import envs
from envs.physics.actuation import LIMIT_KINDS
from planners import load_arm

ARMS = ("epson_t3b", "epson_gx4_351_left")


@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize("env_id", ["MinTorqueMove-v0", "ObstacleDodge-v0"])
def test_episodes_start_within_the_ranges_and_all_over_them(env_id: str, arm: str) -> None:
    limits = load_arm(arm).limits
    batch = gym.make_vec(env_id, num_envs=256, arm=arm)
    batch.reset(seed=0)
    q = batch.unwrapped.task.batch["q"]  # type: ignore[attr-defined]
    assert limits.within(q).all()
    share = (q - limits.angle_middle) / limits.angle_half
    assert (share.max(axis=0) > 0.9).all()
    assert (share.min(axis=0) < -0.9).all()


@pytest.mark.parametrize("arm", ARMS)
def test_the_ratio_of_the_angle_is_measured_from_the_middle_of_the_range(arm: str) -> None:
    limits = load_arm(arm).limits
    env = gym.make("MinTorqueMove-v0", arm=arm)
    env.reset(seed=1)
    worst, over = 0.0, False
    generator = np.random.default_rng(0)
    while not over:
        *_, terminated, truncated, info = env.step(generator.uniform(-0.2, 0.3, 2).astype(np.float32))
        q, _ = env.unwrapped.joint_state()  # type: ignore[attr-defined]
        worst = max(worst, float(np.max(np.abs(q - limits.angle_middle) / limits.angle_half)))
        over = terminated or truncated
    assert info["limit_ratios"][LIMIT_KINDS.index("angle")] == pytest.approx(worst, rel=1e-12)
    assert worst > 0.1


@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize("way", [(1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)])
def test_velocity_commands_brake_before_either_end_of_a_range(arm: str, way: tuple[float, float]) -> None:
    limits = load_arm(arm).limits
    env = gym.make("ObstacleDodge-v0", arm=arm, control_mode="velocity", horizon=3.0)
    middle = limits.angle_middle.tolist()
    env.reset(seed=0, options={"start": middle, "obstacle_paths": [[[4.0, 4.0]]], "obstacle_radius": 0.01})
    q, over = np.array(middle), False
    while not over:
        *_, terminated, truncated, _ = env.step(np.array(way, dtype=np.float32))
        q, _ = env.unwrapped.joint_state()  # type: ignore[attr-defined]
        assert limits.within(q)
        over = terminated or truncated
    ends = np.where(np.array(way) > 0.0, limits.angle_upper, limits.angle_lower)
    np.testing.assert_allclose(q, ends, atol=0.03)


def test_a_belt_on_the_side_to_which_the_first_joint_turns_further_can_be_followed() -> None:
    env = gym.make("ConveyorTrack-v0", arm="epson_gx4_351_left")
    expert = envs.make_expert("apf", env)
    observation, info = env.reset(seed=3)
    over, begins = False, np.ones(1, dtype=bool)
    state = None
    while not over:
        action, state = expert.predict(observation[None], state, begins)
        begins[:] = False
        observation, _, terminated, truncated, info = env.step(action[0])
        over = terminated or truncated
    assert info["is_success"]
    assert info["limit_ratios"][LIMIT_KINDS.index("angle")] < 1.0
