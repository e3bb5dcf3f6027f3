"""Other libraries on the environments: Gymnasium's wrappers always, the rest where it is installed."""

from __future__ import annotations

import re
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import envs

ENV_ID = "MinTorqueMove-v0"
SHORT = {"horizon": 0.5, "max_episode_steps": 12}
N = 3

every_env = pytest.mark.parametrize("env_id", envs.env_ids())
every_mode = pytest.mark.parametrize("mode", AutoresetMode)

VECTOR_WRAPPERS: dict[str, Any] = {
    name: getattr(gym.wrappers.vector, name)
    for name in ("RecordEpisodeStatistics", "NormalizeObservation", "NormalizeReward", "ClipAction", "DictInfoToList")
}
VECTOR_WRAPPERS |= {
    "RescaleAction": lambda env: gym.wrappers.vector.RescaleAction(env, np.float32(-5.0), np.float32(5.0)),
    "TransformObservation": lambda env: gym.wrappers.vector.TransformObservation(env, lambda seen: 2.0 * seen),
    "TransformReward": lambda env: gym.wrappers.vector.TransformReward(env, lambda reward: 2.0 * reward),
    "FlattenObservation": lambda env: gym.wrappers.vector.FlattenObservation(env),
}
"""Each is put around the batch and around Gymnasium's loop."""


def run(env: Any, steps: int = 30) -> list[Any]:
    """Everything that resets and steps of a vector environment return."""
    mode = env.metadata["autoreset_mode"]
    rng, shown = np.random.default_rng(0), [env.reset(seed=0)]
    for _ in range(steps):
        shown.append(env.step(rng.uniform(-1.0, 1.0, env.action_space.shape).astype(np.float32)))
        over = np.asarray(shown[-1][2] | shown[-1][3])
        if mode == AutoresetMode.DISABLED and over.any():
            shown.append(env.reset(options={"reset_mask": over}))
    env.close()
    return shown


def same(ours: Any, theirs: Any) -> bool:
    """Equal to the bit, times of day left out."""
    if isinstance(theirs, dict):
        keys = theirs.keys() - {"t", "_t"}
        return bool(ours.keys() == theirs.keys()) and all(same(ours[key], theirs[key]) for key in keys)
    if isinstance(theirs, (list, tuple)) or (isinstance(theirs, np.ndarray) and theirs.dtype == object):
        return len(ours) == len(theirs) and all(same(*both) for both in zip(ours, theirs, strict=True))
    if theirs is None or ours is None:
        return ours is theirs
    return bool(np.array_equal(np.asarray(ours), np.asarray(theirs), equal_nan=True))


@every_mode
@pytest.mark.parametrize("name", VECTOR_WRAPPERS)
def test_a_vector_wrapper_gives_what_it_gives_around_a_loop(name: str, mode: AutoresetMode) -> None:
    wrap, shown = VECTOR_WRAPPERS[name], []
    loop = SyncVectorEnv([lambda: gym.make(ENV_ID, disable_env_checker=True, **SHORT)] * N, autoreset_mode=mode)
    try:
        theirs = wrap(loop)
    except (AssertionError, ValueError):
        with pytest.raises((AssertionError, ValueError)):
            wrap(gym.make_vec(ENV_ID, N, autoreset_mode=mode, **SHORT))
        return
    for env in (wrap(gym.make_vec(ENV_ID, N, autoreset_mode=mode, **SHORT)), theirs):
        try:
            shown.append(run(env))
        except (TypeError, ValueError) as error:  # some wrappers do not handle every mode
            shown.append([type(error).__name__])
    if (name, mode) == ("RecordEpisodeStatistics", AutoresetMode.DISABLED):
        # The loop takes the mask out of the options before the wrapper looks for it, which then counts from 0.
        lengths = [infos["episode"]["l"] for *_, infos in shown[0] if "episode" in infos]
        assert {length for step in lengths for length in step.tolist()} == {12}
    else:
        assert same(*shown)


@every_env
def test_gymnasium_wrappers_of_single_environments(env_id: str) -> None:
    env: Any = gym.make(env_id, max_episode_steps=8)
    for wrap in (
        gym.wrappers.RecordEpisodeStatistics,
        gym.wrappers.ClipAction,
        gym.wrappers.FlattenObservation,
        lambda inner: gym.wrappers.FrameStackObservation(inner, 3),
        gym.wrappers.TimeAwareObservation,
        gym.wrappers.Autoreset,
    ):
        env = wrap(env)
    _, info = env.reset(seed=0)
    keys, episodes = info.keys() | {"episode"}, 0
    for _ in range(20):
        _, _, terminated, truncated, info = env.step(np.zeros(env.action_space.shape, dtype=np.float32))
        assert info.keys() - {"episode"} == keys - {"episode"}
        if terminated or truncated:
            episodes += 1
            assert info["episode"]["l"] <= 8
            assert np.isfinite(info["limit_ratio"])
    assert episodes >= 2


def test_a_loop_as_cleanrl_writes_it() -> None:
    """The collection of ppo_continuous_action.py, with its wrappers, over the native batch."""
    env: Any = gym.make_vec(ENV_ID, N, **SHORT)
    env = gym.wrappers.vector.RecordEpisodeStatistics(env)
    env = gym.wrappers.vector.ClipAction(env)
    env = gym.wrappers.vector.NormalizeObservation(env)
    env = gym.wrappers.vector.TransformObservation(env, lambda seen: np.clip(seen, -10.0, 10.0))
    env = gym.wrappers.vector.NormalizeReward(env, gamma=0.99)
    env = gym.wrappers.vector.TransformReward(env, lambda reward: np.clip(reward, -10.0, 10.0))
    following, _ = env.reset(seed=1)
    rng, lengths, waste = np.random.default_rng(0), [], 0
    begins = np.zeros(N, dtype=bool)
    for _ in range(40):
        assert np.isfinite(following).all()
        waste += int(begins.sum())  # the step that begins the next episode is no transition
        following, reward, terminations, truncations, infos = env.step(rng.normal(size=env.action_space.shape))
        begins = terminations | truncations
        assert np.isfinite(reward).all()
        if "episode" in infos:
            lengths += infos["episode"]["l"][infos["_episode"]].tolist()
    assert lengths == [12] * len(lengths)
    assert waste == len(lengths) == N * 3
    env.close()


@pytest.mark.clients
def test_torchrl() -> None:
    pytest.importorskip("torchrl")
    from torchrl.envs import GymEnv, GymWrapper, check_env_specs

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        single = GymEnv(ENV_ID, **{"horizon": 0.5})
        check_env_specs(single)
        assert single.rollout(100)["next", "done"][-1].item()
        for mode in (AutoresetMode.DISABLED, AutoresetMode.SAME_STEP):
            batch = GymWrapper(gym.make_vec(ENV_ID, N, autoreset_mode=mode, **SHORT))
            check_env_specs(batch)
            rollout = batch.rollout(30, break_when_any_done=False)
            assert rollout["next", "done"].sum() == 2 * N
            assert rollout["next", "observation"].isfinite().all()


@pytest.mark.clients
@pytest.mark.parametrize("mode", ["sync", "vector_entry_point"])
def test_rllib(mode: str) -> None:
    pytest.importorskip("ray.rllib")
    from ray.rllib.algorithms.ppo import PPOConfig

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        config = (
            PPOConfig()
            .environment(f"envs:{ENV_ID}", env_config=SHORT)
            .env_runners(num_env_runners=0, num_envs_per_env_runner=N, gym_env_vectorize_mode=mode)
            .training(train_batch_size_per_learner=120, minibatch_size=60, num_epochs=1)
        )
        algorithm = config.build_algo()
        results = [algorithm.train() for _ in range(3)]
        episodes = algorithm.env_runner.sample(num_episodes=2 * N, random_actions=True)
        algorithm.stop()
    assert [result["training_iteration"] for result in results] == [1, 2, 3]
    # of an episode that spans two iterations RLlib counts 13, of any environment
    assert [result["env_runners"]["episode_len_min"] for result in results] == [12, 12, 12]
    assert results[0]["env_runners"]["episode_len_mean"] == 12
    task: Any = gym.make(ENV_ID).unwrapped.task  # type: ignore[attr-defined]
    for episode in episodes:
        seen, actions = episode.get_observations(), episode.get_actions()
        assert len(actions) == len(episode) == len(seen) - 1 == 12
        # the last observation is the episode's own: time goes on to the end
        time = task.layout.parse(np.array(seen))["time_left"][:, 0]
        np.testing.assert_allclose(np.diff(time), -task.config.control_period, atol=1e-5)


@pytest.mark.clients
def test_minari() -> None:
    pytest.importorskip("minari")
    pytest.importorskip("jax")  # DataCollector needs it; planarm dataset does not
    from minari.data_collector import EpisodeBuffer
    from minari.data_collector.callbacks import StepDataCallback

    env, record = gym.make(ENV_ID, **SHORT), StepDataCallback()
    seen, info = env.reset(seed=0)
    buffer = EpisodeBuffer(id=0).add_step_data(record(env, obs=seen, info=info))
    over = False
    while not over:
        action = env.action_space.sample()
        seen, reward, terminated, truncated, info = env.step(action)
        over = terminated or truncated
        step = record(env, obs=seen, info=info, action=action, rew=reward, terminated=terminated, truncated=truncated)
        buffer = buffer.add_step_data(step)
    assert len(buffer.actions) == 12
    assert len(buffer.infos["reward_effort"]) == len(buffer.infos["limit_ratios"]) == 13


@pytest.mark.rl
def test_stable_baselines3_makes_its_own_batch() -> None:
    from stable_baselines3 import PPO
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor, VecNormalize

    keywords = ("is_success", "limit_ratio", "torque_l1")
    monitored = make_vec_env(ENV_ID, N, env_kwargs=SHORT, monitor_kwargs={"info_keywords": keywords})
    plain = DummyVecEnv([lambda: gym.make(ENV_ID, **SHORT)] * N)
    for env in (monitored, VecMonitor(plain, info_keywords=keywords)):
        model = PPO("MlpPolicy", VecNormalize(env), n_steps=20, batch_size=30, n_epochs=1, device="cpu")
        model.learn(60)
        assert [episode["l"] for episode in model.ep_info_buffer] == [12] * N
        for episode in model.ep_info_buffer:
            assert np.isfinite([episode[key] for key in ("r", "limit_ratio")]).all()
            assert {"is_success", "torque_l1"} <= episode.keys()


@pytest.mark.clients
def test_a_batch_of_tensors_holds_the_numbers_of_the_batch() -> None:
    torch = pytest.importorskip("torch")
    pytest.importorskip("array_api_compat", reason="pip install gymnasium[array-api]")
    plain: Any = gym.make_vec(ENV_ID, N, **SHORT)
    tensors: Any = gym.wrappers.vector.NumpyToTorch(gym.make_vec(ENV_ID, N, **SHORT))
    for env in (plain, tensors):
        env.reset(seed=0)
    rng = np.random.default_rng(0)
    for _ in range(30):
        action = rng.uniform(-1.0, 1.0, plain.action_space.shape).astype(np.float32)
        ours, theirs = plain.step(action), tensors.step(torch.as_tensor(action))
        for numbers, tensor in zip(ours[:4], theirs[:4], strict=True):
            np.testing.assert_array_equal(numbers, tensor.numpy())
        np.testing.assert_array_equal(ours[4]["limit_ratio"], theirs[4]["limit_ratio"].numpy())


@pytest.mark.moviepy
@pytest.mark.filterwarnings("ignore:.*Recorded episodes will not contain the last frame")
@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_a_batch_is_filmed(mode: AutoresetMode, tmp_path: Path) -> None:
    import imageio_ffmpeg

    batch = gym.make_vec(ENV_ID, N, autoreset_mode=mode, render_mode="rgb_array", **SHORT)
    folder = tmp_path / "films"
    env: Any = gym.wrappers.vector.RecordVideo(batch, str(folder), step_trigger=lambda step: step == 3, video_length=6)
    env.reset(seed=0)
    for _ in range(20):
        env.step(env.action_space.sample())
    env.close()
    (film,) = folder.glob("*.mp4")
    assert imageio_ffmpeg.count_frames_and_secs(str(film))[0] in (6, 7)


PAGE = (Path(__file__).parent.parent.parent / "docs" / "extend" / "clients.md").read_text()
SNIPPETS = re.findall(r"^## (\w+)[^#]*?^```python\n(.*?)^```", PAGE, re.S | re.M)


@pytest.mark.clients
@pytest.mark.parametrize(("client", "code"), SNIPPETS, ids=[client for client, _ in SNIPPETS])
def test_a_snippet_of_the_page_on_clients(client: str, code: str, tmp_path: Path) -> None:
    modules = {"RLlib": "ray.rllib", "TorchRL": "torchrl", "Minari": "h5py", "Stable": "stable_baselines3"}
    modules |= {"SAC": "stable_baselines3", "A": "torch"}
    pytest.importorskip(modules.get(client, "gymnasium"))
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True)
