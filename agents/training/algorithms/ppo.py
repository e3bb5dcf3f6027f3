"""PPO of Stable-Baselines3 for runs in segments."""

from __future__ import annotations

import warnings

from stable_baselines3 import PPO

from agents.training.algorithms.segmented import Segmented, Tensors, between, layer_tensors, network_settings
from agents.training.recipe import PPOConfig
from agents.training.vec_env import NativeVecEnv
from envs.observation import Layout


class SegmentedPPO(Segmented, PPO):  # type: ignore[misc]
    """PPO whose schedules follow the whole run, over any number of calls of ``learn``."""

    config: PPOConfig
    squashed = False

    def __init__(self, config: PPOConfig, env: NativeVecEnv, layout: Layout, device: str = "cpu") -> None:
        self.config = config
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "You have specified a mini-batch size")  # `PPOConfig.remark` is shorter
            self._set_up(config, env, layout, device)
        self.policy.log_std.requires_grad_(config.final_log_std is None)

    def _set_up(self, config: PPOConfig, env: NativeVecEnv, layout: Layout, device: str) -> None:
        super().__init__(
            "MlpPolicy",
            env,
            n_steps=config.rollout_steps,
            batch_size=config.batch_size,
            n_epochs=config.epochs,
            learning_rate=self.linear_rate,
            gamma=config.gamma,
            gae_lambda=config.gae_lambda,
            clip_range=config.clip_range,
            ent_coef=config.entropy_weight,
            vf_coef=config.value_weight,
            max_grad_norm=config.max_grad_norm,
            policy_kwargs={**network_settings(config, layout), "log_std_init": config.log_std},
            seed=config.seed,
            device=device,
        )

    def train(self) -> None:
        """One update; then sets the noise of the actions to its schedule, if it has one."""
        super().train()
        if self.config.final_log_std is not None:
            left = self._current_progress_remaining
            self.policy.log_std.data.fill_(between(self.config.log_std, self.config.final_log_std, left))

    def actor_tensors(self) -> Tensors:
        """The tensors of an `Agent` from the actor; copies."""
        policy = self.policy
        layers = [*policy.mlp_extractor.policy_net, policy.action_net]
        return layer_tensors(policy.features_extractor, layers, {"log_std": policy.log_std})
