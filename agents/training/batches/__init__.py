"""The environments of a training run: at difficulty levels, side by side, and with forecasts for actions."""

from __future__ import annotations

from agents.environments import VectorEnv, make_batch
from agents.training.batches.estimates import OnEstimates, acts_on_estimates
from agents.training.batches.forecasting import Forecasting
from agents.training.batches.levels import SameOptions, SideBySide
from agents.training.recipe import PPOConfig, TrainingConfig
from agents.training.whole_episodes import WholeEpisodes


def training_batch(config: TrainingConfig) -> VectorEnv:
    """The environments of a recipe, divided among its levels as equally as can be, as one batch."""
    conditions = config.conditions
    parts, more = divmod(config.num_envs, len(conditions))
    batches = []
    for index, (settings, options) in enumerate(conditions):
        size = parts + (index < more)
        if options:
            batch: VectorEnv = SameOptions(make_batch(config.env_id, size, settings, resets=False), options)
        else:
            batch = make_batch(config.env_id, size, settings)
        if isinstance(config, PPOConfig):
            batch = Forecasting(batch) if config.forecasts else batch
            batch = OnEstimates(batch) if config.estimates and acts_on_estimates(batch) else batch
            batch = WholeEpisodes(batch) if config.whole_episodes else batch
        batches.append(batch)
    return batches[0] if len(batches) == 1 else SideBySide(batches)
