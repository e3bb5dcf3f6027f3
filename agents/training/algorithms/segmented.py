"""What the algorithms share: the inputs of their networks, and schedules and state of runs in segments."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

from agents.training.recipe import TrainingConfig
from envs.observation import Layout
from envs.settings import refuse_unknown

Tensors = dict[str, NDArray[Any]]
_ACTIVATIONS = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU}


class FineFeatures(BaseFeaturesExtractor):  # type: ignore[misc]
    """An observation x, and beside it tanh(gain * x) of some of its elements."""

    def __init__(self, observation_space: gym.spaces.Box, index: list[int], gain: list[float]) -> None:
        super().__init__(observation_space, observation_space.shape[0] + len(index))
        self.register_buffer("index", torch.tensor(index, dtype=torch.int64))
        self.register_buffer("gain", torch.tensor(gain, dtype=torch.float32))

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Features ``(num_envs, features)``."""
        return torch.cat([observations, torch.tanh(observations[:, self.index] * self.gain)], dim=1)


class Segmented(BaseAlgorithm):  # type: ignore[misc]
    """An algorithm whose schedules follow the whole run, over any number of calls of ``learn``.

    Attributes:
        config: the recipe of the run.
        squashed: whether the actor's output goes through tanh.
    """

    config: TrainingConfig
    squashed: bool

    def linear_rate(self, left: float) -> float:
        """The learning rate when a share ``left`` of the run remains."""
        return between(self.config.learning_rate, self.config.final_learning_rate, left)

    def actor_tensors(self) -> Tensors:
        """The tensors of an `Agent` from the actor; copies."""
        raise NotImplementedError

    def finite(self) -> bool:
        """Whether all weights of the networks are finite numbers."""
        return all(bool(torch.isfinite(tensor).all()) for tensor in self.policy.state_dict().values())

    def _update_current_progress_remaining(self, num_timesteps: int, total_timesteps: int) -> None:
        super()._update_current_progress_remaining(num_timesteps, self.config.total_steps)


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
    elements = [(index, gain) for name, gains in config.fine.items() for gain in gains for index in places[name]]
    return [index for index, _ in elements], [gain for _, gain in elements]


def network_settings(config: TrainingConfig, layout: Layout) -> dict[str, Any]:
    """What Stable-Baselines3's policies take: architecture and inputs of the networks."""
    index, gain = fine_elements(config, layout)
    return {
        "net_arch": list(config.hidden),
        "activation_fn": _ACTIVATIONS[config.activation],
        "features_extractor_class": FineFeatures,
        "features_extractor_kwargs": {"index": index, "gain": gain},
    }


def layer_tensors(features: FineFeatures, layers: Iterable[Any], more: dict[str, torch.Tensor]) -> Tensors:
    """The tensors of an `Agent`: inputs, linear layers by number, and others by name; copies."""
    tensors = {"fine.index": features.index, "fine.gain": features.gain, **more}
    for number, layer in enumerate(layer for layer in layers if isinstance(layer, torch.nn.Linear)):
        tensors[f"layer{number}.weight"], tensors[f"layer{number}.bias"] = layer.weight, layer.bias
    return {name: np.array(tensor.detach().cpu().numpy()) for name, tensor in tensors.items()}
