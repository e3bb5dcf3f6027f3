"""The observed motion of the part relative to the hand: what follows from the other entries, however it is observed."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import envs
from planners.typing import Array

ENV, JOINTS = "ConveyorTrack-v0", ("position", "velocity", "acceleration")
SETTINGS: list[dict[str, Any]] = [
    {},
    {"control_mode": "jerk"},
    {"physics": "closed_form"},
    {"control_mode": "jerk", "belt_acceleration": 0.05, "encoder_noise": 1e-4, "camera_noise": 1e-3},
    {"arm": "epson_t3b", "control_mode": "acceleration"},
]


def hand_rates(arm: Any, q: Array, qd: Array, qdd: Array) -> tuple[Array, Array]:
    """Velocity and acceleration of the hand by differences along the motion of the joints."""
    step = 1e-4

    def at(time: float) -> Array:
        hand: Array = arm.forward_kinematics(q + time * qd + 0.5 * time * time * qdd)
        return hand

    return (at(step) - at(-step)) / (2.0 * step), (at(step) - 2.0 * at(0.0) + at(-step)) / step**2


@pytest.mark.parametrize("settings", SETTINGS, ids=str)
def test_follows_from_joints_and_part(settings: dict[str, Any]) -> None:
    vector: Any = gym.make_vec(ENV, num_envs=3, relative_motion=True, **settings)
    task = vector.unwrapped.task
    vector.reset(seed=0)
    vector.action_space.seed(0)
    for _ in range(20):
        observations = vector.step(vector.action_space.sample())[0]
    seen = task.layout.parse(observations)
    velocity, acceleration = hand_rates(task.arm, *(seen[f"joint_{name}"] for name in JOINTS))
    scale = {entry.name: entry.scale for entry in task.layout.entries}
    np.testing.assert_allclose(
        seen["relative_velocity"], seen["part_velocity"] - velocity, atol=1e-5 * scale["relative_velocity"]
    )
    np.testing.assert_allclose(
        seen["relative_acceleration"],
        seen["part_acceleration"] - acceleration,
        rtol=1e-5,
        atol=1e-4 * scale["relative_acceleration"],
    )


@pytest.mark.parametrize("settings", SETTINGS, ids=str)
def test_only_adds_to_the_observation(settings: dict[str, Any]) -> None:
    plain, more = (gym.make(ENV, relative_motion=also, **settings) for also in (False, True))
    assert more.observation_space.shape == (plain.observation_space.shape[0] + 4,)  # type: ignore[index]
    found = [env.reset(seed=5)[0] for env in (plain, more)]
    plain.action_space.seed(1)
    for _ in range(10):
        np.testing.assert_array_equal(found[0], found[1][:-4])
        assert more.observation_space.contains(found[1])
        action = plain.action_space.sample()
        (first, *one, _), (second, *other, _) = plain.step(action), more.step(action)
        assert one == other
        found = [first, second]


@pytest.mark.parametrize("expert", ["apf", "dpct"])
def test_experts_act_as_without_it(expert: str) -> None:
    actions = []
    for relative_motion in (False, True):
        env = gym.make(ENV, relative_motion=relative_motion)
        policy: Any = envs.make_expert(expert, env)
        observation, state = env.reset(seed=2)[0], None
        for step in range(5):
            action, state = policy.predict(observation, state, episode_start=step == 0)
            observation = env.step(action)[0]
            actions.append(action)
    np.testing.assert_array_equal(actions[:5], actions[5:])
