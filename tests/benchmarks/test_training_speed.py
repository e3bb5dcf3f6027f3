"""How fast PPO's update is beside that of Stable-Baselines3, on the same rollout in the same run."""

from __future__ import annotations

import os
import time
from contextlib import closing

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason='needs pip install "planarm[rl]"')

import torch
from stable_baselines3 import PPO
from stable_baselines3.common.logger import Logger

from agents.environments import make_batch
from agents.policies.files import layout_of
from agents.training.algorithms.ppo import SegmentedPPO
from agents.training.recipe import PPOConfig
from agents.training.vec_env import NativeVecEnv
from agents.yaml_config import load_config

pytestmark = pytest.mark.rl

ROUNDS = 6


@pytest.mark.skipif("not config.getoption('--benchmark-enable')", reason="a ratio of times; needs --benchmark-enable")
@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="needs two processors")
def test_an_update_on_two_threads_takes_less_time_than_stable_baselines3s_on_one() -> None:
    config = load_config("ppo/ObstacleDodge-v0", PPOConfig).overridden(["epochs=1", "threads=2"])
    assert isinstance(config, PPOConfig)
    torch.set_num_threads(1)
    with closing(NativeVecEnv(make_batch(config.env_id, config.num_envs, config.env_config))) as env:
        model = SegmentedPPO(config, env, layout_of(config.env_id, config.env_config))
    model.set_logger(Logger(None, []))
    buffer, generator = model.rollout_buffer, np.random.default_rng(0)
    names = ("observations", "actions", "values", "log_probs", "advantages", "returns")
    rollout = {name: 0.1 * generator.standard_normal(getattr(buffer, name).shape, np.float32) for name in names}
    buffer.full = True
    times: dict[str, list[float]] = {"ours": [], "theirs": []}
    for _ in range(ROUNDS):
        for name, update in (("ours", SegmentedPPO.train), ("theirs", PPO.train)):
            buffer.generator_ready = False
            vars(buffer).update({key: values.copy() for key, values in rollout.items()})
            begun = time.perf_counter()
            update(model)
            times[name].append(time.perf_counter() - begun)
    ours, theirs = min(times["ours"]), min(times["theirs"])
    print(
        f"a pass over 32,768 samples {1e3 * ours:.0f} ms, Stable-Baselines3 {1e3 * theirs:.0f} ms: {theirs / ours:.2f}"
    )
    assert theirs / ours >= 1.2
