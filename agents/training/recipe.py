"""Settings of a training run, validated, from YAML and from the command line."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Annotated, Any, ClassVar, Literal, Self, cast

from pydantic import BeforeValidator, Field, model_validator

from agents.yaml_config import assigned, refuse_twice
from envs.card import task_card
from envs.settings import Settings, refuse_unknown

Device = Literal["auto", "cpu", "cuda"]
OptimizerName = Literal["adam", "muon"]
Width = Annotated[int, Field(ge=1, le=16_384)]  # of a layer
Threads = Annotated[int, Field(ge=1, le=256)]
Gains = Annotated[
    tuple[float, ...],
    Field(min_length=1),
    BeforeValidator(lambda given: given if isinstance(given, list | tuple) else [given]),
]

DEFAULT_LEVEL = "default"  # the settings as they are, among levels
EVALUATION_SEED = 1_000_000  # seed of the first episode of an evaluation in training; the leaderboard has other seeds


class Teacher(Settings):
    """Where demonstrations come from: an expert or a dataset, one of the two.

    Attributes:
        expert: its name.
        dataset: id or folder of a Minari dataset, such as ``planarm dataset`` records.
        sha256: fingerprint of the dataset, filled in when a run begins; with another one it does not go on.
    """

    expert: str | None = None
    dataset: str | None = None
    sha256: str | None = None

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if (self.expert is None) == (self.dataset is None):
            raise ValueError("give expert, the name of an expert, or dataset, the id of a dataset: one of the two")
        return self

    @property
    def source(self) -> str:
        """The expert or the dataset, for messages."""
        return str(self.expert or self.dataset)


class WarmStart(Teacher):
    """DAgger before PPO, or behaviour cloning of a dataset: see :mod:`agents.training.warm_start.dagger`.

    Attributes:
        expert: its name.
        dataset: id or folder of a Minari dataset, whose episodes are cloned in one round.
        sha256: fingerprint of the dataset, filled in when a run begins; with another one it does not go on.
        episodes: in each iteration; all of a dataset.
        rounds: iterations of collecting and fitting; one with a dataset.
        updates: gradient steps in each iteration, on the samples of all iterations so far.
        batch_size: samples of a gradient step.
        learning_rate: at the start; it falls linearly to a hundredth over all iterations.
    """

    episodes: int = Field(256, ge=1)
    rounds: int = Field(8, ge=1)
    updates: int = Field(2000, ge=1)
    batch_size: int = Field(1024, ge=2)
    learning_rate: float = Field(2e-3, gt=0.0)

    @property
    def iterations(self) -> int:
        """Rounds of collecting and fitting; a dataset holds no labels for states that the clone visits."""
        return self.rounds if self.dataset is None else 1


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


class Forecasts(Settings):
    """Fit of forecasts to the paths of discs: see :mod:`agents.training.warm_start.forecasts`.

    Attributes:
        episodes: whose paths are taken, divided among the levels.
        samples: instants of each episode.
        updates: gradient steps.
        batch_size: samples of a gradient step.
        learning_rate: at the start; it falls linearly to a hundredth.
    """

    episodes: int = Field(40_000, ge=1)
    samples: int = Field(10, ge=1)
    updates: int = Field(15_000, ge=1)
    batch_size: int = Field(1024, ge=2)
    learning_rate: float = Field(2e-3, gt=0.0)


class Demonstrations(Teacher):
    """Episodes of an expert or a dataset for a replay buffer.

    Attributes:
        expert: its name.
        dataset: id or folder of a Minari dataset.
        sha256: fingerprint of the dataset, filled in when a run begins; with another one it does not go on.
        episodes: number of episodes, the first ones of a dataset.
    """

    episodes: int = Field(64, ge=1)


class TrainingConfig(Settings):
    """Settings of a training run with any algorithm; `parse` gives those of the algorithm that is named.

    Attributes:
        algorithm: of Stable-Baselines3.
        env: id of the environment; ``module:Name-v0`` imports the module first, which registers it.
        env_config: its settings.
        levels: difficulty levels of the task's card among which environments and episodes of evaluations are divided,
            with ``default`` for the settings as they are; these alone if left out.
        seed: of all random numbers.
        device: where the networks are trained; ``auto`` is cuda where PyTorch finds it, for large minibatches.
        threads: of PyTorch; ``auto`` is one for small minibatches or few processors, and for PPO as many as share its
            minibatches well.
        total_steps: control steps of all environments together.
        num_envs: environments stepped at once.
        rollout_steps: control steps an environment takes between two updates.
        batch_size: samples in a minibatch.
        learning_rate, final_learning_rate: at the start and at the end, linear between.
        gamma: discount of a control step.
        hidden: widths of the hidden layers, of actor and critic alike.
        activation: between them.
        fine: gain, or several, by entry of the observation; for each the networks also see tanh(gain * entry), which
            magnifies small values.
        checkpoint_steps: control steps between two checkpoints, rounded up to whole rollouts.
        evaluation_episodes: on seeds never trained on, at each checkpoint.
        baselines: experts; the best of them on the same seeds is reported beside the agent. If left out, all that the
            task's card names; none if empty.
    """

    title: ClassVar[str]  # the algorithm's name in prose
    algorithm: Literal["ppo", "sac", "td3"] = "ppo"
    env: str
    env_config: dict[str, Any] = Field(default_factory=dict)
    levels: tuple[str, ...] = ()
    seed: int = Field(0, ge=0, le=2**32 - 1)
    device: Device = "auto"
    threads: Literal["auto"] | Threads = "auto"
    total_steps: int = Field(3_000_000, ge=1)
    num_envs: int = Field(128, ge=1, le=2**20)
    rollout_steps: int = Field(150, ge=2)
    batch_size: int = Field(2400, ge=2)
    learning_rate: float = Field(1e-3, gt=0.0)
    final_learning_rate: float = Field(1e-5, gt=0.0)
    gamma: float = Field(0.98, gt=0.0, le=1.0)
    hidden: tuple[Width, ...] = Field((64, 64), min_length=1)
    activation: Literal["tanh", "relu"] = "tanh"
    fine: dict[str, Gains] = Field(default_factory=dict)
    checkpoint_steps: int = Field(250_000, ge=1)
    evaluation_episodes: int = Field(100, ge=1)
    baselines: tuple[str, ...] | None = None

    @classmethod
    def parse(cls, given: Mapping[str, Any], what: str) -> Self:
        """Settings of the algorithm that ``given`` names, PPO if none; see `Settings.parse`."""
        if cls is not TrainingConfig:
            return super().parse(given, what)
        name = given.get("algorithm", "ppo")
        refuse_unknown([str(name)], RECIPES, "algorithm")
        return cast(Self, RECIPES[str(name)].parse(given, what))

    @property
    def remark(self) -> str:
        """A sentence about something in the settings that may not be meant, if there is anything."""
        return ""

    @property
    def env_id(self) -> str:
        """The id of the environment, without the module that registers it."""
        return self.env.rpartition(":")[2]

    @property
    def conditions(self) -> list[tuple[dict[str, Any], dict[str, Any]]]:
        """Settings of the environment and reset options at each level; one pair without levels."""
        names = [None if name == DEFAULT_LEVEL else name for name in self.levels or (DEFAULT_LEVEL,)]
        if names == [None]:
            return [(dict(self.env_config), {})]
        card = task_card(self.env_id)
        return [card.at_level(name, self.env_config, {}) for name in names]

    def check_levels(self) -> None:
        """Raise a ValueError for levels that the task does not have, one twice, or more of them than environments."""
        refuse_twice(self.levels, "level")
        if len(self.conditions) > min(self.num_envs, self.evaluation_episodes):
            raise ValueError(
                f"{len(self.levels)} levels for {self.num_envs} environments and {self.evaluation_episodes} episodes "
                "of an evaluation: each level needs one or more; raise num_envs and evaluation_episodes"
            )
        if len(self.conditions) > 1 and (getattr(self, "amortise", None) or getattr(self, "demonstrations", None)):
            raise ValueError(f"levels {', '.join(self.levels)}: amortise and demonstrations take one level at most")

    @property
    def teacher(self) -> WarmStart | Demonstrations | None:
        """What the run takes from an expert or a dataset before it trains, if anything."""
        return None

    @property
    def segment_steps(self) -> int:
        """Control steps between two checkpoints: whole rollouts."""
        rollout = self.num_envs * self.rollout_steps
        return -(-self.checkpoint_steps // rollout) * rollout

    def overridden(self, changes: Iterable[str]) -> TrainingConfig:
        """These settings with some changed as by `agents.yaml_config.assigned`; an impossible one is a ValueError.

        Where the algorithm changes, settings that were left out have the other algorithm's defaults.
        """
        return TrainingConfig.parse(assigned(self.model_dump(exclude_unset=True), changes), "training setting")


class PPOConfig(TrainingConfig):
    """Settings of PPO beside those of every algorithm.

    Attributes:
        optimizer: adam, or muon for the weights of hidden layers, in PPO and in the fits before it.
        epochs: passes over the samples at each update.
        gae_lambda: of the generalised advantage estimate.
        clip_range: of the ratio of probabilities.
        entropy_weight, value_weight: of the entropy bonus and of the value's loss.
        max_grad_norm: a longer gradient is scaled down to this norm.
        log_std: logarithm of the actions' standard deviation at the start.
        final_log_std: at the end, linear between; if left out, it is learned.
        total_steps: control steps of all environments together; 0 for the warm start alone.
        warm_start: DAgger with an expert, or cloning of a dataset, before PPO.
        amortise: fit to the cost of motions before PPO.
        estimates: at levels of ConveyorTrack-v0 that declare uncertainty the policy observes estimates, and its jerks
            are those of the estimated arm, as every agent acts there that was trained without uncertainty. It learns
            from an expert at the other levels, or, if there is none, in the task without uncertainty.
        whole_episodes: the policy acts once an episode; steps then count episodes.
        forecasts: the policy forecasts a disc's path, and the expert apf acts on the forecast; steps then count
            forecasts. It is fitted to paths before PPO.
    """

    title: ClassVar[str] = "PPO"
    algorithm: Literal["ppo"] = "ppo"
    total_steps: int = Field(3_000_000, ge=0)
    optimizer: OptimizerName = "adam"
    epochs: int = Field(8, ge=1)
    gae_lambda: float = Field(0.95, ge=0.0, le=1.0)
    clip_range: float = Field(0.2, gt=0.0)
    entropy_weight: float = Field(0.0, ge=0.0)
    value_weight: float = Field(0.5, ge=0.0)
    max_grad_norm: float = Field(0.5, gt=0.0)
    log_std: float = -1.0
    final_log_std: float | None = None
    warm_start: WarmStart | None = None
    amortise: Amortisation | None = None
    estimates: bool = False
    whole_episodes: bool = False
    forecasts: Forecasts | None = None

    @model_validator(mode="after")
    def _forecasts_alone(self) -> Self:
        others = [name for name in ("warm_start", "amortise", "whole_episodes") if getattr(self, name)]
        if self.forecasts is not None and (others or self.fine):
            raise ValueError(
                f"forecasts go without {', '.join(others or ['fine'])}: the network sees a disc, not an observation"
            )
        return self

    @property
    def teacher(self) -> WarmStart | Demonstrations | None:
        """What the run takes from an expert or a dataset before it trains, if anything."""
        return self.warm_start

    @property
    def remark(self) -> str:
        """A sentence about minibatches of unequal size, if there are any."""
        samples = self.num_envs * self.rollout_steps
        if samples % self.batch_size == 0 or self.total_steps == 0:
            return ""
        return (
            f"batch_size {self.batch_size} does not divide the {samples} samples of an update (num_envs "
            f"{self.num_envs} x rollout_steps {self.rollout_steps}): its last minibatch has {samples % self.batch_size}"
        )


class OffPolicyConfig(TrainingConfig):
    """Settings that SAC and TD3 share beside those of every algorithm.

    Attributes:
        num_envs: environments stepped at once.
        rollout_steps: control steps an environment takes between two updates.
        gradient_steps: minibatches at each update.
        batch_size: samples in a minibatch.
        learning_rate, final_learning_rate: at the start and at the end, linear between.
        activation: between the hidden layers.
        buffer_size: transitions in the replay buffer, which is part of every checkpoint.
        learning_starts: control steps with random actions before the first update.
        demonstrations: episodes of an expert with which the replay buffer begins.
        tau: share of the networks that the target networks take over at each gradient step.
        total_steps: control steps of all environments together.
    """

    total_steps: int = Field(300_000, ge=1)
    num_envs: int = Field(16, ge=1, le=2**20)
    rollout_steps: int = Field(1, ge=1)
    gradient_steps: int = Field(8, ge=1)
    batch_size: int = Field(256, ge=2)
    learning_rate: float = Field(1e-3, gt=0.0)
    final_learning_rate: float = Field(1e-4, gt=0.0)
    activation: Literal["tanh", "relu"] = "relu"
    buffer_size: int = Field(300_000, ge=1, le=20_000_000)
    learning_starts: int = Field(5_000, ge=0)
    demonstrations: Demonstrations | None = None
    tau: float = Field(0.005, gt=0.0, le=1.0)

    @property
    def teacher(self) -> WarmStart | Demonstrations | None:
        """What the run takes from an expert or a dataset before it trains, if anything."""
        return self.demonstrations

    @property
    def remark(self) -> str:
        """A sentence about a run that never learns, if it does not."""
        if self.total_steps > self.learning_starts:
            return ""
        return (
            f"total_steps {self.total_steps} end before learning_starts {self.learning_starts}: nothing will be learned"
        )


class SACConfig(OffPolicyConfig):
    """Settings of SAC beside those of every algorithm.

    Attributes:
        entropy_weight: of the entropy in the objective; ``auto`` learns it.
        initial_entropy_weight: with which ``auto`` begins.
        target_entropy: of the actions, for ``entropy_weight: auto``; ``auto`` is minus their number.
    """

    title: ClassVar[str] = "SAC"
    algorithm: Literal["sac"] = "sac"
    entropy_weight: Literal["auto"] | Annotated[float, Field(ge=0.0)] = "auto"
    initial_entropy_weight: float = Field(1.0, gt=0.0)
    target_entropy: Literal["auto"] | float = "auto"


class TD3Config(OffPolicyConfig):
    """Settings of TD3 beside those of every algorithm.

    Attributes:
        action_noise: standard deviation of the noise on the actions.
        policy_delay: gradient steps of the critic for one of the actor.
        target_noise: standard deviation of the noise on the target's actions.
        target_noise_clip: largest noise on the target's actions.
    """

    title: ClassVar[str] = "TD3"
    algorithm: Literal["td3"] = "td3"
    action_noise: float = Field(0.1, ge=0.0)
    policy_delay: int = Field(2, ge=1)
    target_noise: float = Field(0.2, ge=0.0)
    target_noise_clip: float = Field(0.5, ge=0.0)


RECIPES: dict[str, type[PPOConfig | SACConfig | TD3Config]] = {"ppo": PPOConfig, "sac": SACConfig, "td3": TD3Config}
"""The settings of each algorithm."""
