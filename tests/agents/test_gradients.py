"""Gradients on several threads, and PPO's update with them; needs the `rl` extra."""

from __future__ import annotations

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
from agents.training.gradients import CHUNK, SMALLEST, Gradients, chunks
from agents.training.recipe import PPOConfig
from agents.training.vec_env import NativeVecEnv

pytestmark = pytest.mark.rl

ENV = "ConveyorTrack-v0"


@pytest.mark.parametrize("samples", [1, SMALLEST - 1, SMALLEST, 1000, 2400, 8192])
def test_chunks_cover_a_minibatch_once_and_share_it_evenly(samples: int) -> None:
    parts = chunks(samples)
    assert [index for part in parts for index in range(part.start, part.stop)] == list(range(samples))
    sizes = [part.stop - part.start for part in parts]
    assert max(sizes) - min(sizes) <= 1
    assert max(sizes) <= CHUNK
    assert len(sizes) % 2 == 0 or samples < SMALLEST


def test_gradients_are_those_of_the_whole_minibatch_with_the_same_bits_on_any_number_of_threads() -> None:
    torch.manual_seed(0)
    network = torch.nn.Sequential(torch.nn.Linear(5, 32), torch.nn.Tanh(), torch.nn.Linear(32, 2))
    unused = torch.nn.Parameter(torch.ones(3))
    inputs, targets = torch.randn(999, 5), torch.randn(999, 2)
    parameters = [*network.parameters(), unused]

    def loss(where: slice) -> torch.Tensor:
        return torch.nn.functional.mse_loss(network(inputs[where]), targets[where])

    found = []
    for threads in (1, 2, 3):
        with Gradients(threads) as gradients:
            value = gradients.backward(parameters, len(inputs), loss)
        assert unused.grad is None
        found.append([torch.tensor(value), *(parameter.grad for parameter in network.parameters())])
    assert all(torch.equal(one, other) for others in found[1:] for one, other in zip(found[0], others, strict=True))
    whole = loss(slice(None))
    network.zero_grad()
    whole.backward()
    for got, wanted in zip(found[0], [whole, *(each.grad for each in network.parameters())], strict=True):
        torch.testing.assert_close(got, wanted.detach(), rtol=1e-4, atol=1e-6)


def test_an_error_in_a_thread_comes_out() -> None:
    parameter = torch.nn.Parameter(torch.ones(1))

    def loss(where: slice) -> torch.Tensor:
        if where.start:
            raise ValueError("a loss without a value")
        return parameter.sum()

    with Gradients(2) as gradients, pytest.raises(ValueError, match="without a value"):
        gradients.backward([parameter], SMALLEST, loss)


@pytest.mark.parametrize("final_log_std", [None, -1.5])
def test_an_update_of_ppo_is_that_of_stable_baselines3(final_log_std: float | None) -> None:
    config = PPOConfig.parse(
        {
            "env": ENV,
            "num_envs": 16,
            "rollout_steps": 40,
            "batch_size": 320,
            "epochs": 2,
            "entropy_weight": 0.01,
            "fine": {"part_error": [5.0, 20.0]},
            "final_log_std": final_log_std,
            "threads": 2,
        },
        "test",
    )
    ended = []
    for update in (SegmentedPPO.train, PPO.train):
        with closing(NativeVecEnv(make_batch(ENV, config.num_envs, {}))) as env:
            model = SegmentedPPO(config, env, layout_of(ENV, {}))
            model.set_logger(Logger(None, []))
            _, callback = model._setup_learn(640, None)
            assert model.collect_rollouts(env, callback, model.rollout_buffer, config.rollout_steps)
            np.random.seed(0)  # noqa: NPY002  # of the minibatches
            before = [parameter.detach().clone() for parameter in model.policy.parameters()]
            update(model)
        learnt = [parameter for parameter in model.policy.parameters() if parameter.requires_grad]
        moved = [
            not torch.equal(old, new)
            for old, new in zip(before, model.policy.parameters(), strict=True)
            if new.requires_grad
        ]
        assert all(moved)
        ended.append([*learnt, *(torch.tensor(model.logger.name_to_value[f"train/{name}"]) for name in LOGGED)])
    for ours, theirs in zip(*ended, strict=True):
        torch.testing.assert_close(ours, theirs, rtol=2e-3, atol=2e-5, check_dtype=False)


LOGGED = ("policy_gradient_loss", "value_loss", "entropy_loss", "clip_fraction")
