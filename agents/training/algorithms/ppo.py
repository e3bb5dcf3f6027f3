"""PPO of Stable-Baselines3 for runs in segments, with its update on several threads."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.utils import explained_variance

from agents.training.algorithms.optimizers import optimizer_of
from agents.training.algorithms.segmented import Segmented, Tensors, between, layer_tensors, network_settings
from agents.training.devices import thread_count
from agents.training.gradients import Gradients
from agents.training.recipe import PPOConfig
from agents.training.vec_env import NativeVecEnv
from envs.observation import Layout

_ADAM_EPS = 1e-5  # as in Stable-Baselines3
_HALF_LOG_2PI = 0.5 * math.log(2.0 * math.pi)
_MEASURED = ("loss", "policy_gradient_loss", "value_loss", "entropy_loss", "approx_kl", "clip_fraction")


def mean_action(policy: Any, observations: torch.Tensor) -> torch.Tensor:
    """Mean actions ``(samples, n)`` of a policy of PPO; unlike its ``get_distribution`` for several threads at once."""
    mean: torch.Tensor = policy.action_net(policy.mlp_extractor.forward_actor(policy.extract_features(observations)))
    return mean


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
        self.policy.optimizer = optimizer_of(config.optimizer, self.policy, config.learning_rate, eps=_ADAM_EPS)

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
            policy_kwargs={
                **network_settings(config, layout),
                "log_std_init": config.log_std,
            },
            seed=config.seed,
            device=device,
        )

    def train(self) -> None:
        """One update as Stable-Baselines3's; then sets the noise of the actions to its schedule, if it has one."""
        policy, buffer, device = self.policy, self.rollout_buffer, self.device
        policy.set_training_mode(True)
        self._update_learning_rate(policy.optimizer)
        names = ("observations", "actions", "log_probs", "advantages", "returns")
        rollout = [torch.from_numpy(buffer.swap_and_flatten(getattr(buffer, name))).to(device) for name in names]
        with torch.no_grad():
            rollout[0] = policy.extract_features(rollout[0])
        measured = []
        with Gradients(thread_count(self.config), whole=device.type != "cpu") as gradients:
            for _ in range(self.n_epochs):
                order = torch.from_numpy(np.random.permutation(len(rollout[0])))  # noqa: NPY002  # as SB3
                for batch in order.to(device).split(self.batch_size):
                    measured.append(self._step(gradients, [values[batch] for values in rollout]))
                self._n_updates += 1
        for name, values in zip(_MEASURED, np.transpose(measured), strict=True):
            self.logger.record(f"train/{name}", float(values.mean()))
        variance = explained_variance(buffer.values.flatten(), buffer.returns.flatten())
        self.logger.record("train/explained_variance", variance)
        self.logger.record("train/std", policy.log_std.exp().mean().item())
        self.logger.record("train/clip_range", self.config.clip_range)
        if self.config.final_log_std is not None:
            left = self._current_progress_remaining
            self.policy.log_std.data.fill_(between(self.config.log_std, self.config.final_log_std, left))

    def _step(self, gradients: Gradients, minibatch: list[torch.Tensor]) -> list[float]:
        """A gradient step on features, actions, log probabilities, advantages and returns; means of `_MEASURED`."""
        features, actions, log_probs, advantages, returns = minibatch
        if (samples := len(features)) > 1:
            advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
        policy, config = self.policy, self.config
        parts: dict[int, torch.Tensor] = {}

        def loss(where: slice) -> torch.Tensor:
            actor, critic = policy.mlp_extractor(features[where])
            deviation = (actions[where] - policy.action_net(actor)) / policy.log_std.exp()
            log_prob = -(0.5 * deviation**2 + policy.log_std + _HALF_LOG_2PI).sum(1)
            log_ratio = log_prob - log_probs[where, 0]
            ratio, advantage = log_ratio.exp(), advantages[where, 0]
            clipped = ratio.clamp(1.0 - config.clip_range, 1.0 + config.clip_range)
            gain = torch.min(advantage * ratio, advantage * clipped).mean()
            value_loss = torch.nn.functional.mse_loss(policy.value_net(critic), returns[where])
            entropy = (policy.log_std + _HALF_LOG_2PI + 0.5).sum()
            total: torch.Tensor = config.value_weight * value_loss - gain - config.entropy_weight * entropy
            with torch.no_grad():
                outside = ((ratio - 1.0).abs() > config.clip_range).float().mean()
                means = (total, -gain, value_loss, -entropy, (ratio - 1.0 - log_ratio).mean(), outside)
                parts[where.start] = torch.stack(means) * ((where.stop - where.start) / samples)
            return total

        gradients.backward(policy.parameters(), samples, loss)
        torch.nn.utils.clip_grad_norm_(policy.parameters(), config.max_grad_norm)
        policy.optimizer.step()
        means: list[float] = sum(parts[start] for start in sorted(parts)).tolist()
        return means

    def actor_tensors(self) -> Tensors:
        """The tensors of an `Agent` from the actor; copies."""
        policy = self.policy
        layers = [*policy.mlp_extractor.policy_net, policy.action_net]
        return layer_tensors(policy.features_extractor, layers, {"log_std": policy.log_std})
