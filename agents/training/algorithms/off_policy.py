"""SAC and TD3 of Stable-Baselines3 for runs in segments."""

from __future__ import annotations

from typing import Any

import numpy as np
from stable_baselines3 import SAC, TD3
from stable_baselines3.common.noise import NormalActionNoise

from agents.training.algorithms.segmented import Segmented, Tensors, layer_tensors, network_settings
from agents.training.recipe import OffPolicyConfig, SACConfig, TD3Config
from agents.training.vec_env import NativeVecEnv
from envs.observation import Layout


class SegmentedSAC(Segmented, SAC):  # type: ignore[misc]
    """SAC whose schedules follow the whole run, over any number of calls of ``learn``."""

    config: SACConfig
    squashed = True

    def __init__(self, config: SACConfig, env: NativeVecEnv, layout: Layout, device: str = "cpu") -> None:
        self.config = config
        learned = f"auto_{config.initial_entropy_weight!r}"
        super().__init__(
            "MlpPolicy",
            env,
            learning_rate=self.linear_rate,
            ent_coef=learned if config.entropy_weight == "auto" else config.entropy_weight,
            target_entropy=config.target_entropy,
            **_shared(config, layout, device),
        )

    def actor_tensors(self) -> Tensors:
        """The tensors of an `Agent` from the actor; copies."""
        actor = self.actor
        noise = {"log_std.weight": actor.log_std.weight, "log_std.bias": actor.log_std.bias}
        return layer_tensors(actor.features_extractor, [*actor.latent_pi, actor.mu], noise)


class SegmentedTD3(Segmented, TD3):  # type: ignore[misc]
    """TD3 whose schedules follow the whole run, over any number of calls of ``learn``."""

    config: TD3Config
    squashed = True

    def __init__(self, config: TD3Config, env: NativeVecEnv, layout: Layout, device: str = "cpu") -> None:
        self.config = config
        n = env.action_space.shape[0]
        super().__init__(
            "MlpPolicy",
            env,
            learning_rate=self.linear_rate,
            action_noise=NormalActionNoise(np.zeros(n), np.full(n, config.action_noise)),
            policy_delay=config.policy_delay,
            target_policy_noise=config.target_noise,
            target_noise_clip=config.target_noise_clip,
            **_shared(config, layout, device),
        )

    def actor_tensors(self) -> Tensors:
        """The tensors of an `Agent` from the actor; copies."""
        return layer_tensors(self.actor.features_extractor, self.actor.mu, {})


def _shared(config: OffPolicyConfig, layout: Layout, device: str) -> dict[str, Any]:
    """The arguments that both algorithms take."""
    return {
        "buffer_size": config.buffer_size,
        "learning_starts": config.learning_starts,
        "batch_size": config.batch_size,
        "tau": config.tau,
        "gamma": config.gamma,
        "train_freq": config.rollout_steps,
        "gradient_steps": config.gradient_steps,
        "policy_kwargs": network_settings(config, layout),
        "seed": config.seed,
        "device": device,
    }
