"""Environments as Stable-Baselines3 sees them; needs the `rl` extra."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import envs  # noqa: F401

pytest.importorskip("stable_baselines3", reason='needs pip install "planarm[rl]"')

from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize, VecVideoRecorder

from agents import NativeVecEnv

pytestmark = pytest.mark.rl

N_ENVS = 3


def venv(env_id: str = "ConveyorTrack-v0", **config: Any) -> NativeVecEnv:
    return NativeVecEnv(gym.make_vec(env_id, num_envs=N_ENVS, autoreset_mode=AutoresetMode.SAME_STEP, **config))


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
    assert not env.has_attr("colour")
    assert env.env_is_wrapped(gym.Wrapper) == [False] * N_ENVS
    with pytest.raises(NotImplementedError, match="share"):
        env.set_attr("render_mode", "human")
    with pytest.raises(NotImplementedError, match="reset cannot be called for one environment"):
        env.env_method("reset")


def test_methods_of_single_environments_are_answered_for_each() -> None:
    env = venv(render_mode="rgb_array")
    env.seed(40)
    env.reset()
    single = gym.make("ConveyorTrack-v0", render_mode="rgb_array")
    single.reset(seed=41)
    inner: Any = single.unwrapped
    ((q, qd),) = env.env_method("joint_state", indices=1)
    np.testing.assert_array_equal((q, qd), inner.joint_state())
    (problem,) = env.env_method("motion_problem", indices=[1])
    np.testing.assert_array_equal(problem.start, inner.motion_problem().start)
    (frame,) = env.env_method("render", indices=[1])
    np.testing.assert_array_equal(frame, single.render())


def test_all_environments_are_rendered_in_one_picture() -> None:
    env = venv(render_mode="rgb_array")
    env.reset()
    picture = env.render()
    assert picture is not None
    height, width, _ = env.get_images()[0].shape
    assert picture.shape == (2 * height, 2 * width, 3)
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 10


def test_options_hold_for_the_next_reset() -> None:
    env = venv()
    env.set_options({"belt_speed": 0.15})
    env.seed(3)
    assert (env.reset() == env.reset()).all(axis=1).tolist() == [False] * N_ENVS
    env.set_options({"scenario": "paper"})
    seen: Any = env.reset()
    assert (seen == seen[0]).all()
    assert not env.reset_infos[0]["is_success"]
    env.set_options([{"scenario": "paper"}, {}, {}])
    with pytest.raises(ValueError, match="options differ"):
        env.reset()


def test_evaluate_policy_takes_returns_as_from_monitor() -> None:
    env = venv(horizon=2.0)
    env.seed(5)
    returns, lengths = evaluate_policy(
        Still(env),
        env,
        n_eval_episodes=2 * N_ENVS,
        return_episode_rewards=True,  # type: ignore[arg-type]
    )
    assert lengths == [100] * 2 * N_ENVS
    assert len(set(returns)) == 2 * N_ENVS


class Still:
    """Holds every joint."""

    def __init__(self, env: NativeVecEnv) -> None:
        self.env = env

    def predict(self, observation: Any, **_: Any) -> tuple[Any, None]:
        return still(self.env), None


def test_statistics_and_normalisation_of_stable_baselines3_apply() -> None:
    with pytest.warns(UserWarning, match="already wrapped with a `Monitor`"):
        monitored = VecMonitor(venv(horizon=2.0))
    env = VecNormalize(monitored, norm_reward=False)
    env.seed(5)
    seen = [env.reset()]
    ends: list[dict[str, Any]] = []
    for _ in range(100):
        observation, _, _, infos = env.step(np.zeros((N_ENVS, 2), np.float32))
        seen.append(observation)
        ends += [info for info in infos if info]
    assert [info["episode"]["l"] for info in ends] == [100] * N_ENVS
    assert np.abs(np.concatenate(seen)).max() <= env.clip_obs
    original: Any = env.get_original_obs()
    np.testing.assert_allclose(env.normalize_obs(original), seen[-1], atol=1e-5)


@pytest.mark.moviepy
def test_a_video_of_a_batch_is_recorded(tmp_path: Path) -> None:
    env = VecVideoRecorder(
        venv(render_mode="rgb_array"), str(tmp_path), record_video_trigger=lambda step: step == 0, video_length=4
    )
    env.reset()
    for _ in range(6):
        env.step(np.zeros((N_ENVS, 2), np.float32))
    env.close()
    (video,) = tmp_path.glob("*.mp4")
    assert video.stat().st_size > 1000
