"""Scores of an agent at a checkpoint and of the baselines, on seeds that are never trained on."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from agents.evaluation.evaluate import evaluate
from agents.evaluation.results import Evaluation
from agents.evaluation.summarise import training_scores, values_of
from agents.policies.agent import ACTION_SETTINGS, Agent
from agents.training.learning_curves import Row, merit
from agents.training.recipe import EVALUATION_SEED, TrainingConfig
from envs.experts import expert_names


def score(policy: Agent | str, config: TrainingConfig) -> dict[str, float]:
    """Success rate, mean return and metrics of an agent, or of an expert in the environment's default control mode."""
    return values_of(training_scores(evaluation_of(policy, config, EVALUATION_SEED)))


def evaluation_of(policy: Agent | str, config: TrainingConfig, first: int) -> Evaluation:
    """The episodes of an evaluation of a recipe, from a first seed on, divided among its levels."""
    conditions, parts = config.conditions, []
    for index, (settings, options) in enumerate(conditions):
        seeds = first + np.arange(index, config.evaluation_episodes, len(conditions))
        if isinstance(policy, str):
            settings = {name: value for name, value in settings.items() if name not in ACTION_SETTINGS}
        parts.append(evaluate(policy, config.env_id, seeds, env_config=settings, options=options))
    return Evaluation.joined(parts)


def score_baselines(
    config: TrainingConfig, scores: dict[str, Row], begin: Callable[[str], object], save: Callable[[Any], object]
) -> dict[str, Row]:
    """The scores of each baseline, by name.

    ``scores`` are those that are known. ``begin`` is called with a line about each other one, and ``save`` with all
    scores so far.
    """
    for name in expert_names(config.env_id) if config.baselines is None else config.baselines:
        if name not in scores:
            begin(f"evaluating {name}")
            scores = {**scores, name: score(name, config)}
            save(scores)
    return scores


def best_baseline(scores: dict[str, Row]) -> Row:
    """The columns of the best baseline: its name and its scores; none without baselines."""
    if not scores:
        return {}
    best = max(scores, key=lambda name: merit(scores[name]))
    return {"expert": best, **{f"expert_{name}": value for name, value in scores[best].items()}}


def baseline_columns(row: Row) -> Row:
    """The columns of a row that are about the baseline."""
    return {name: value for name, value in row.items() if name.startswith("expert")}
