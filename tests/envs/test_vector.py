"""The vector environment: environment i is the single one with seed + i, for any batch size and threads."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import envs  # noqa: F401  (registers the ids)
from envs.vector_environment import PlanarArmVectorEnv

ENV_ID = "ConveyorTrack-v0"


def actions_of(env_index: int, steps: int, n_joints: int) -> np.ndarray[Any, Any]:
    return np.random.default_rng(env_index).uniform(-1.2, 1.2, (steps, n_joints)).astype(np.float32)


def single(env_id: str, seed: int, env_index: int, steps: int, **config: Any) -> list[Any]:
    env = gym.make(env_id, **config)
    observation, _ = env.reset(seed=seed)
    shown = [observation]
    for action in actions_of(env_index, steps, env.action_space.shape[0]):  # type: ignore[index]
        observation, reward, terminated, truncated, info = env.step(action)
        final = observation
        if terminated or truncated:
            observation, _ = env.reset()
        shown.append((observation, reward, terminated, truncated, final, info))
    return shown


@pytest.mark.parametrize("num_envs", [1, 3, 70])  # 70 environments run on two threads
@pytest.mark.parametrize(
    ("env_id", "control_mode"), [(ENV_ID, "torque"), (ENV_ID, "jerk"), ("MinTorqueMove-v0", "torque")]
)
def test_environments_equal_single_environments_bit_for_bit(num_envs: int, env_id: str, control_mode: str) -> None:
    steps, checked = 170, sorted({0, num_envs // 2, num_envs - 1})
    vector = gym.make_vec(env_id, num_envs=num_envs, autoreset_mode="SameStep", control_mode=control_mode)
    observations, _ = vector.reset(seed=20)
    shown = {env_index: [observations[env_index]] for env_index in checked}
    n_joints = vector.single_action_space.shape[0]  # type: ignore[index]
    all_actions = np.stack([actions_of(env_index, steps, n_joints) for env_index in range(num_envs)], axis=1)
    for actions in all_actions:
        observations, rewards, terminated, truncated, infos = vector.step(actions)
        for env_index in checked:
            final = (
                infos["final_obs"][env_index]
                if terminated[env_index] or truncated[env_index]
                else observations[env_index]
            )
            shown[env_index].append(
                (observations[env_index], rewards[env_index], terminated[env_index], truncated[env_index], final, infos)
            )
    for env_index in checked:
        alone = single(env_id, 20 + env_index, env_index, steps, control_mode=control_mode)
        np.testing.assert_array_equal(shown[env_index][0], alone[0])
        for ours, theirs in zip(shown[env_index][1:], alone[1:], strict=True):
            np.testing.assert_array_equal(ours[0], theirs[0])
            assert ours[1:4] == theirs[1:4]
            np.testing.assert_array_equal(ours[4], theirs[4])
            if theirs[2] or theirs[3]:
                final_info = ours[5]["final_info"]
                for key, value in theirs[5].items():
                    np.testing.assert_array_equal(final_info[key][env_index], value, err_msg=key)


def test_seeds_one_a_environment() -> None:
    vector = gym.make_vec(ENV_ID, num_envs=3)
    observations, _ = vector.reset(seed=[7, 7, 9])
    np.testing.assert_array_equal(observations[0], observations[1])
    assert (observations[0] != observations[2]).any()
    with pytest.raises(ValueError, match="2 seeds for 3 environments"):
        vector.reset(seed=[1, 2])


def test_reset_mask_resets_only_those() -> None:
    vector = gym.make_vec(ENV_ID, num_envs=3)
    before, _ = vector.reset(seed=0)
    after, _ = vector.reset(seed=[None, 5, None], options={"reset_mask": np.array([False, True, False])})
    np.testing.assert_array_equal(after[[0, 2]], before[[0, 2]])
    np.testing.assert_array_equal(after[1], gym.make(ENV_ID).reset(seed=5)[0])
    with pytest.raises(ValueError, match="bool array of shape"):
        vector.reset(options={"reset_mask": [1, 0]})


def test_options_apply_to_every_environment() -> None:
    vector = gym.make_vec(ENV_ID, num_envs=2)
    observations, _ = vector.reset(seed=0, options={"scenario": "paper"})
    np.testing.assert_array_equal(observations[0], observations[1])


def test_max_episode_steps_ends_earlier() -> None:
    vector = gym.make_vec(ENV_ID, num_envs=2, autoreset_mode="SameStep", max_episode_steps=10)
    vector.reset(seed=0)
    for step in range(1, 21):
        *_, truncated, infos = vector.step(np.zeros((2, 2), dtype=np.float32))
        assert truncated.all() == (step % 10 == 0)
        assert ("final_obs" in infos) == truncated.all()


def test_nothing_returned_shares_memory() -> None:
    vector = gym.make_vec(ENV_ID, num_envs=1)
    first, infos = vector.reset(seed=0)
    second, rewards, *_ = vector.step(np.ones((1, 2), dtype=np.float32))
    batch = vector.unwrapped.task.batch  # type: ignore[attr-defined]
    for array in (first, second, rewards, infos["is_success"]):
        assert not np.shares_memory(array, batch)


def test_a_environment_with_a_bad_action_is_named() -> None:
    vector = gym.make_vec(ENV_ID, num_envs=4)
    vector.reset(seed=0)
    actions = np.zeros((4, 2), dtype=np.float32)
    actions[2, 0] = np.nan
    q = vector.unwrapped.joint_state()[0]  # type: ignore[attr-defined]
    with pytest.raises(ValueError, match=r"environment 2.*not finite"):
        vector.step(actions)
    np.testing.assert_array_equal(vector.unwrapped.joint_state()[0], q)  # type: ignore[attr-defined]


def test_step_before_reset() -> None:
    with pytest.raises(gym.error.ResetNeeded, match="call reset"):
        gym.make_vec(ENV_ID, num_envs=2).step(np.zeros((2, 2), dtype=np.float32))


def test_rendering_gives_a_frame_a_environment() -> None:
    vector = gym.make_vec(ENV_ID, num_envs=2, render_mode="rgb_array")
    vector.reset(seed=0)
    frames = vector.render()
    assert frames is not None
    assert len(frames) == 2
    assert (frames[0] != frames[1]).any()
    vector.close()


@pytest.mark.parametrize(
    ("arguments", "complaint"), [({"num_envs": 0}, "at least 1"), ({"render_mode": "human"}, "rgb")]
)
def test_bad_arguments(arguments: dict[str, Any], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        PlanarArmVectorEnv(task_type="envs.conveyor_track.env:ConveyorTrack", **arguments)
