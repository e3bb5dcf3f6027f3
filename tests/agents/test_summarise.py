"""The one summary of an evaluation, from results made by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from agents.evaluation.results import Evaluation, Timing
from agents.evaluation.summarise import card_of, metric_text, summarise, training_scores, values_of

METRICS = {
    "is_success": np.array([True, True, True, False]),
    "collision": np.array([False, False, False, True]),
    "limit_ratio": np.array([0.9, 1.0, 1.06, 3.0]),
    "limit_ratios/torque": np.ones(4),
    "time_to_goal": np.array([1.0, 2.0, 4.0, np.inf]),
}
EVALUATION = Evaluation(
    policy="x",
    env_id="ObstacleDodge-v0",
    seeds=np.arange(4),
    returns=np.array([1.0, 2.0, 3.0, -2.0]),
    lengths=np.array([1, 2, 3, 4]),
    metrics=METRICS,
    timing=Timing(),
)


def test_shares_medians_and_the_interquartile_mean() -> None:
    assert values_of(summarise(EVALUATION)) == {
        "success": 0.75,
        "return": 1.5,
        "length": 2.5,
        "limit_broken": 0.5,
        "collision": 0.25,
        "limit_ratio": pytest.approx(1.03),
        "limit_ratios/torque": 1.0,
        "time_to_goal": 3.0,
    }


def test_intervals_are_bootstrapped_when_asked_for() -> None:
    with_intervals, without = summarise(EVALUATION), summarise(EVALUATION, bootstrap=False)
    assert values_of(with_intervals) == values_of(without)
    assert with_intervals["return"].low < 1.5 < with_intervals["return"].high
    assert with_intervals["time_to_goal"].high == np.inf
    assert np.isnan(without["return"].low)
    assert without["success"] == with_intervals["success"]  # Wilson's needs no resampling


def test_missing_values_are_left_out() -> None:
    partial = replace(EVALUATION, metrics={**METRICS, "rare": np.array([np.nan, 1.0, 3.0, np.nan])})
    assert summarise(partial)["rare"].value == 2.0
    never = replace(EVALUATION, metrics={**METRICS, "rare": np.full(4, np.nan)})
    assert np.isnan(summarise(never)["rare"].value)


def test_training_records_the_mean_return_and_no_nested_metric() -> None:
    assert values_of(training_scores(EVALUATION)) == {
        "success": 0.75,
        "return": 1.0,
        "collision": 0.25,
        "limit_ratio": pytest.approx(1.03),
        "time_to_goal": 3.0,
    }


def test_values_are_plain_floats_which_a_checkpoint_can_hold() -> None:
    never = replace(EVALUATION, metrics={**METRICS, "time_to_goal": np.full(4, np.inf)})
    assert {type(value) for value in values_of(training_scores(never)).values()} == {float}


def test_cells_are_shares_or_in_the_unit_of_the_column() -> None:
    collided, soon, _ = card_of("ObstacleDodge-v0").metrics
    estimates = summarise(EVALUATION, bootstrap=False)
    assert metric_text(collided, EVALUATION, estimates).startswith("25 (")
    assert metric_text(soon, EVALUATION, estimates) == "3.000"
    assert card_of("CartPole-v1").metrics == ()
