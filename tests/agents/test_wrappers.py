"""Gymnasium's own wrappers around every environment, with every expert."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers import RecordEpisodeStatistics, RecordVideo
from gymnasium.wrappers.vector import RecordEpisodeStatistics as RecordBatchStatistics

import envs
from envs.experts import expert_names

every_expert = pytest.mark.parametrize(
    ("env_id", "name"), [(env_id, name) for env_id in envs.env_ids() for name in expert_names(env_id)]
)
FIRST, SNIPPET = 4, 15
"""Step with which a film begins, and its frames if the episode has as many."""


def play(env: gym.Env[Any, Any], name: str, seed: int) -> tuple[float, int, dict[str, Any]]:
    """An episode's return, length and last info."""
    expert = envs.make_expert(name, env)
    observation, _ = env.reset(seed=seed)
    state, begins, total, steps, ended = None, np.ones(1, dtype=bool), 0.0, 0, False
    while not ended:
        actions, state = expert.predict(observation[None], state, begins)
        observation, reward, terminated, truncated, info = env.step(actions[0])
        begins, total, steps, ended = np.zeros(1, dtype=bool), total + float(reward), steps + 1, terminated or truncated
    return total, steps, info


@every_expert
def test_episode_statistics(env_id: str, name: str) -> None:
    with RecordEpisodeStatistics(gym.make(env_id)) as env:
        for number, seed in enumerate((3, 4), start=1):
            total, steps, info = play(env, name, seed)
            assert info["episode"]["r"] == pytest.approx(total)
            assert info["episode"]["l"] == steps
            assert "is_success" in info
            assert env.episode_count == number


@every_expert
def test_environment_statistics(env_id: str, name: str) -> None:
    venv = gym.make_vec(env_id, num_envs=3, autoreset_mode="SameStep")
    env = RecordBatchStatistics(venv)
    expert = envs.make_expert(name, venv)
    observation, _ = env.reset(seed=5)
    state, begins = None, np.ones(3, dtype=bool)
    totals, lengths, seen = np.zeros(3), np.zeros(3, dtype=int), np.zeros(3, dtype=bool)
    while not seen.all():
        actions, state = expert.predict(observation, state, begins)
        observation, rewards, terminated, truncated, infos = env.step(actions)
        begins = terminated | truncated
        totals += rewards
        lengths += 1
        if begins.any():
            np.testing.assert_array_equal(infos["_episode"], begins)
            np.testing.assert_allclose(infos["episode"]["r"][begins], totals[begins])
            np.testing.assert_array_equal(infos["episode"]["l"][begins], lengths[begins])
        totals[begins], lengths[begins] = 0.0, 0
        seen |= begins
    assert env.episode_count >= 3
    env.close()


@pytest.mark.moviepy
@every_expert
def test_videos(env_id: str, name: str, tmp_path: Path) -> None:
    import imageio_ffmpeg

    folder = tmp_path / "films"
    inner = gym.make(env_id, render_mode="rgb_array")
    with RecordVideo(inner, str(folder), step_trigger=lambda step: step == FIRST, video_length=SNIPPET) as env:
        _, steps, _ = play(env, name, 3)
        height, width, _ = env.render().shape
    (film,) = folder.iterdir()
    with closing(imageio_ffmpeg.read_frames(str(film))) as frames:
        about = next(frames)
    assert about["size"] == (width, height)
    assert about["fps"] == inner.metadata["render_fps"]
    frames_expected = min(SNIPPET, steps - FIRST)
    # The wrapper stops once there are more frames than were asked for.
    assert imageio_ffmpeg.count_frames_and_secs(str(film))[0] in (frames_expected, frames_expected + 1)
