"""PPO of Stable-Baselines3 for runs in segments, and its networks as tensors of an `Agent`."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

from agents.training.recipe import TrainingConfig
from agents.training.vec_env import NativeVecEnv
from envs.observation import Layout
from envs.settings import refuse_unknown

ACTIVATIONS = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU}


class FineFeatures(BaseFeaturesExtractor):  # type: ignore[misc]
    """An observation x, and beside it tanh(gain * x) of some of its elements."""

    def __init__(self, observation_space: gym.spaces.Box, index: list[int], gain: list[float]) -> None:
        super().__init__(observation_space, observation_space.shape[0] + len(index))
        self.register_buffer("index", torch.tensor(index, dtype=torch.int64))
        self.register_buffer("gain", torch.tensor(gain, dtype=torch.float32))

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Features ``(num_envs, features)``."""
        return torch.cat([observations, torch.tanh(observations[:, self.index] * self.gain)], dim=1)


class SegmentedPPO(PPO):  # type: ignore[misc]
    """PPO whose schedules follow the whole run, over any number of calls of ``learn``."""

    def __init__(self, config: TrainingConfig, env: NativeVecEnv, layout: Layout) -> None:
        self.config = config
        index, gain = fine_elements(config, layout)
        super().__init__(
            "MlpPolicy",
            env,
            n_steps=config.rollout_steps,
            batch_size=config.batch_size,
            n_epochs=config.epochs,
            learning_rate=lambda left: between(config.learning_rate, config.final_learning_rate, left),
            gamma=config.gamma,
            gae_lambda=config.gae_lambda,
            clip_range=config.clip_range,
            ent_coef=config.entropy_weight,
            vf_coef=config.value_weight,
            max_grad_norm=config.max_grad_norm,
            policy_kwargs={
                "net_arch": list(config.hidden),
                "activation_fn": ACTIVATIONS[config.activation],
                "log_std_init": config.log_std,
                "features_extractor_class": FineFeatures,
                "features_extractor_kwargs": {"index": index, "gain": gain},
            },
            seed=config.seed,
            device="cpu",
        )
        self.policy.log_std.requires_grad_(config.final_log_std is None)

    def _update_current_progress_remaining(self, num_timesteps: int, total_timesteps: int) -> None:
        super()._update_current_progress_remaining(num_timesteps, self.config.total_steps)

    def train(self) -> None:
        """One update; then sets the noise of the actions to its schedule, if it has one."""
        super().train()
        if self.config.final_log_std is not None:
            left = self._current_progress_remaining
            self.policy.log_std.data.fill_(between(self.config.log_std, self.config.final_log_std, left))


def between(start: float, end: float, left: float) -> float:
    """A value that changes linearly from ``start`` to ``end``, when a share ``left`` of the run remains."""
    return end + (start - end) * max(left, 0.0)


def fine_elements(config: TrainingConfig, layout: Layout) -> tuple[list[int], list[float]]:
    """Indices and gains of the observation's elements that the networks also see magnified.

    Raises:
        ValueError: if the observation has no such entry.
    """
    places = {entry.name: range(place.start, place.stop) for entry, place in layout.slices()}
    refuse_unknown(config.fine, places, "entry of the observation (in fine)")
    elements = [(index, gain) for name, gain in config.fine.items() for index in places[name]]
    return [index for index, _ in elements], [gain for _, gain in elements]


def agent_tensors(policy: Any) -> dict[str, NDArray[Any]]:
    """The tensors of an `Agent` from the networks of a policy of PPO; copies."""
    linear = [layer for layer in policy.mlp_extractor.policy_net if isinstance(layer, torch.nn.Linear)]
    layers = [*linear, policy.action_net]
    tensors = {
        "fine.index": policy.features_extractor.index,
        "fine.gain": policy.features_extractor.gain,
        "log_std": policy.log_std,
    }
    for number, layer in enumerate(layers):
        tensors[f"layer{number}.weight"], tensors[f"layer{number}.bias"] = layer.weight, layer.bias
    return {name: np.array(tensor.detach().numpy()) for name, tensor in tensors.items()}
