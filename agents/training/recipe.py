"""Settings of a training run, validated, from YAML and from the command line."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Literal, Self

from pydantic import Field

from agents.yaml_config import assigned
from envs.settings import Settings

EVALUATION_SEED = 1_000_000  # seed of the first episode of an evaluation in training; the leaderboard has other seeds


class WarmStart(Settings):
    """DAgger before PPO: see :mod:`agents.training.dagger`.

    Attributes:
        expert: its name.
        episodes: in each iteration.
        rounds: iterations of collecting and fitting.
        updates: gradient steps in each iteration, on the samples of all iterations so far.
        batch_size: samples of a gradient step.
        learning_rate: at the start; it falls linearly to a hundredth over all iterations.
    """

    expert: str
    episodes: int = Field(256, ge=1)
    rounds: int = Field(8, ge=1)
    updates: int = Field(2000, ge=1)
    batch_size: int = Field(1024, ge=2)
    learning_rate: float = Field(2e-3, gt=0.0)


class Amortisation(Settings):
    """Amortised optimisation before PPO, where actions are whole motions: see :mod:`agents.training.amortise`.

    Attributes:
        moves: random moves to fit to.
        updates: gradient steps.
        batch_size: moves of a gradient step.
        learning_rate: at the start; it falls linearly to a thousandth.
    """

    moves: int = Field(150_000, ge=1)
    updates: int = Field(40_000, ge=1)
    batch_size: int = Field(256, ge=1)
    learning_rate: float = Field(1e-3, gt=0.0)


class TrainingConfig(Settings):
    """PPO on one environment.

    Attributes:
        env: id of the environment.
        env_config: its settings.
        seed: of all random numbers.
        total_steps: control steps of all environments together.
        num_envs: environments stepped at once.
        rollout_steps: control steps an environment takes between two updates.
        batch_size: samples in a minibatch.
        epochs: passes over the samples at each update.
        learning_rate, final_learning_rate: at the start and at the end, linear between.
        gamma: discount of a control step.
        gae_lambda: of the generalised advantage estimate.
        clip_range: of the ratio of probabilities.
        entropy_weight, value_weight: of the entropy bonus and of the value's loss.
        max_grad_norm: a longer gradient is scaled down to this norm.
        log_std: logarithm of the actions' standard deviation at the start.
        final_log_std: at the end, linear between; if left out, it is learned.
        hidden: widths of the hidden layers, of policy and value alike.
        activation: between them.
        fine: gain by entry of the observation; the networks also see tanh(gain * entry), which magnifies small values.
        warm_start: DAgger with an expert before PPO.
        amortise: fit to the cost of motions before PPO.
        whole_episodes: the policy acts once an episode; steps then count episodes.
        checkpoint_steps: control steps between two checkpoints, rounded up to whole rollouts.
        evaluation_episodes: on seeds never trained on, at each checkpoint.
        baselines: experts; the best of them on the same seeds is reported beside the agent. If left out, all that the
            task's card names.
    """

    env: str
    env_config: dict[str, Any] = Field(default_factory=dict)
    seed: int = Field(0, ge=0)
    total_steps: int = Field(3_000_000, ge=1)
    num_envs: int = Field(128, ge=1)
    rollout_steps: int = Field(150, ge=2)
    batch_size: int = Field(2400, ge=2)
    epochs: int = Field(8, ge=1)
    learning_rate: float = Field(1e-3, gt=0.0)
    final_learning_rate: float = Field(1e-5, gt=0.0)
    gamma: float = Field(0.98, gt=0.0, le=1.0)
    gae_lambda: float = Field(0.95, ge=0.0, le=1.0)
    clip_range: float = Field(0.2, gt=0.0)
    entropy_weight: float = Field(0.0, ge=0.0)
    value_weight: float = Field(0.5, ge=0.0)
    max_grad_norm: float = Field(0.5, gt=0.0)
    log_std: float = -1.0
    final_log_std: float | None = None
    hidden: tuple[int, ...] = Field((64, 64), min_length=1)
    activation: Literal["tanh", "relu"] = "tanh"
    fine: dict[str, float] = Field(default_factory=dict)
    warm_start: WarmStart | None = None
    amortise: Amortisation | None = None
    whole_episodes: bool = False
    checkpoint_steps: int = Field(250_000, ge=1)
    evaluation_episodes: int = Field(100, ge=1)
    baselines: tuple[str, ...] | None = Field(None, min_length=1)

    @property
    def segment_steps(self) -> int:
        """Control steps between two checkpoints: whole rollouts."""
        rollout = self.num_envs * self.rollout_steps
        return -(-self.checkpoint_steps // rollout) * rollout

    def overridden(self, changes: Iterable[str]) -> Self:
        """These settings with some changed as by `agents.yaml_config.assigned`; an impossible one is a ValueError."""
        return self.parse(assigned(self.model_dump(), changes), "training setting")
