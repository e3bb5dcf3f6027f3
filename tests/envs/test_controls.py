"""What changes while an episode runs: each control acts at once, on what is observed, rewarded, counted and drawn."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import envs
from envs.experts import make_expert

BELT, MOVE, DODGE, LOAD = "ConveyorTrack-v0", "MinTorqueMove-v0", "ObstacleDodge-v0", "ExcavatorPayload-v0"


def control(env_id: str, key: str) -> Any:
    return next(each for each in envs.task_card(env_id).controls if each.key == key)


def ended(env: Any, expert: Any, observation: Any) -> dict[str, Any]:
    while True:
        observation, _, terminated, truncated, info = env.step(expert.predict(observation)[0])
        if terminated or truncated:
            found: dict[str, Any] = info
            return found


@pytest.mark.parametrize("physics", ["pymunk", "closed_form"])
def test_a_payload_changed_before_the_first_step_is_picked_up(physics: str) -> None:
    env = gym.make(LOAD, physics=physics, horizon=4.0)
    observation, _ = env.reset(seed=11)
    task: Any = env.unwrapped.task  # type: ignore[attr-defined]
    assert task.change(0, control(LOAD, "payload"), 300.0)
    info = ended(env, make_expert("kalman", env), observation)
    assert info["payload_mass"] == 300.0
    assert task.batch["load"][0] == pytest.approx(300.0)


def test_a_payload_changed_before_it_is_picked_up_is_picked_up_when_it_was_due() -> None:
    env = gym.make(LOAD, level=2)
    observation, _ = env.reset(seed=11)
    task: Any = env.unwrapped.task  # type: ignore[attr-defined]
    due = int(task.batch["pick_step"][0])
    assert due > 0
    task.change(0, control(LOAD, "payload"), 200.0)
    expert, loads = make_expert("kalman", env), []
    for _ in range(due + 2):
        observation = env.step(expert.predict(observation)[0])[0]
        loads.append(float(task.batch["load"][0]))
    assert loads[due - 1] == 0.0
    assert loads[due] == pytest.approx(200.0)


@pytest.mark.parametrize("name", ["dpct", "lagrange", "follower"])
def test_a_plan_ends_with_the_goal_that_it_was_made_for(name: str) -> None:
    env = gym.make(MOVE)
    used, start = make_expert(name, env), (0.1, 0.2, 0.3)
    observation, _ = env.reset(seed=0, options={"start": start, "goal": (1.0, 0.5, 0.3), "duration": 1.0})
    used.predict(observation)
    observation, _ = env.reset(seed=0, options={"start": start, "goal": (-1.0, -0.5, 0.3), "duration": 0.995})
    np.testing.assert_array_equal(used.predict(observation)[0], make_expert(name, env).predict(observation)[0])


def test_a_clock_that_is_restarted_holds_for_the_time_limit_too() -> None:
    single = gym.make(BELT, max_episode_steps=20)
    several = gym.make_vec(BELT, num_envs=1, vectorization_mode="vector_entry_point", max_episode_steps=20)
    single.reset(seed=1)
    several.reset(seed=1)
    for step in range(1, 31):
        one, all_of = single.step(np.zeros(2, np.float32)), several.step(np.zeros((1, 2), np.float32))
        assert one[3] == all_of[3][0] == (step == 30)
        if step == 10:
            for env in (single, several):
                env.unwrapped.task.change(0, control(BELT, "belt_speed"), 0.1)  # type: ignore[union-attr]
            single.unwrapped.resume()  # type: ignore[attr-defined]
    assert set(one[4]) >= {"settling_time", "is_success"}
    assert not np.isnan(one[4]["settling_time"])


def test_noise_does_not_come_again_after_a_change() -> None:
    env = gym.make(BELT, encoder_noise=1e-3)
    env.reset(seed=1)
    task: Any = env.unwrapped.task  # type: ignore[attr-defined]

    def noise() -> Any:
        return task.layout.parse(task.batch["observation"][0])["joint_position"] - task.batch["q"][0]

    before = [noise(), *((env.step(np.zeros(2, np.float32)), noise())[1] for _ in range(4))]
    task.change(0, control(BELT, "belt_speed"), 0.1)
    after = [noise(), *((env.step(np.zeros(2, np.float32)), noise())[1] for _ in range(4))]
    assert not np.isclose(before, after, atol=1e-6).any()


def test_a_change_is_observed_at_once_and_is_no_progress_of_the_arm() -> None:
    env = gym.make(DODGE)
    env.reset(seed=3)
    world: Any = env.unwrapped
    for key, value in (("radius", 0.25), ("disc", (0.9, 0.0))):
        world.task.change(0, control(DODGE, key), value)
        seen = world.task.layout.parse(world.resume())
        assert seen["clearance"][0] == pytest.approx(seen["link_clearance"].min(), abs=1e-4)
    env.step(np.zeros(2, np.float32))
    world.task.change(0, control(DODGE, "goal"), -world.task.batch["goal"][0])
    assert abs(env.step(np.zeros(2, np.float32))[4]["reward_progress"]) < 1e-3
