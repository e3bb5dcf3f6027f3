"""The numbers behind the charts of a report, against SciPy and against counting."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy import stats

from agents.evaluation.compare import paired
from agents.report.axes import Axis, span
from agents.report.numbers import costs, differences, profiled, profiles, quantiles, quantities, wilson
from agents.report.results_file import Results, TaskScores


@pytest.fixture
def tasks(scored: dict[str, Any]) -> list[TaskScores]:
    return Results.model_validate(scored).results


@pytest.mark.parametrize("trials", [1, 7, 128])
def test_wilson_is_scipys(trials: int) -> None:
    low, high = wilson(np.arange(trials + 1), trials)
    for successes in range(trials + 1):
        wanted = stats.binomtest(successes, trials).proportion_ci(0.95, method="wilson")
        assert (low[successes], high[successes]) == pytest.approx((wanted.low, wanted.high), abs=1e-12)


def test_a_profile_is_the_empirical_distribution_of_the_successes(tasks: list[TaskScores]) -> None:
    for task in tasks:
        for policy, profile in zip(task.policies, profiles(task), strict=False):
            assert task.primary is not None
            success = np.array(policy.episodes["is_success"], dtype=bool)[:4]  # those with a best known value
            values = np.array(policy.episodes[task.primary.key], dtype=float)[:4][success]
            if not values.size:
                assert not profile.values.size
                continue
            wanted = stats.ecdf(task.primary.factor * values).cdf
            np.testing.assert_allclose(profile.values, wanted.quantiles)
            np.testing.assert_allclose(profile.share, wanted.probabilities * success.mean())
            assert all(profile.low < profile.share)
            assert all(profile.share <= profile.high + 1e-12)


def test_the_bound_has_a_profile_of_its_own_seeds(tasks: list[TaskScores]) -> None:
    bound = profiles(tasks[0])[-1]
    assert bound.name == "best known"
    assert bound.share[-1] == 1.0
    assert tasks[0].bounds is not None
    assert list(tasks[0].bounds[1]) == [0, 1, 2, 3]
    assert tasks[0].bound_name == "best known (first 4)"
    assert profiled(tasks[0]) == "the first 4 episodes"


def test_without_a_best_known_value_the_profiles_are_of_all_episodes(scored: dict[str, Any]) -> None:
    task = TaskScores.model_validate({**scored["results"][0], "bound": None})
    assert profiled(task) == "the episodes"
    apf = next(each for each in task.policies if each.policy == "apf")
    assert len(profiles(task)[task.policies.index(apf)].values) == len(set(apf.episodes["settling_time"]))


def test_where_more_is_better_a_profile_descends(scored: dict[str, Any]) -> None:
    task = scored["results"][1]
    metrics = [{**metric, "primary": metric["key"] == "min_clearance"} for metric in task["metrics"]]
    changed = TaskScores.model_validate({**task, "metrics": metrics})
    profile = profiles(changed)[0]
    assert all(np.diff(profile.values) < 0.0)
    assert all(np.diff(profile.share) > 0.0)


def test_quantiles_are_those_of_the_episodes_of_the_profile(tasks: list[TaskScores]) -> None:
    profile = profiles(tasks[0])[0]
    assert profile.share[-1] == 1.0
    assert tasks[0].primary is not None
    values = np.array(tasks[0].policies[0].episodes[tasks[0].primary.key][:4], dtype=float)
    wanted = np.quantile(values, [0.1, 0.5, 0.9], method="inverted_cdf")
    np.testing.assert_allclose(quantiles(profile, [0.1, 0.5, 0.9]), wanted)
    failing = next(each for each in profiles(tasks[0]) if not len(each.share))
    assert math.isnan(quantiles(failing, [0.5])[0])


def test_differences_are_those_of_the_leaderboard(scored: dict[str, Any], tasks: list[TaskScores]) -> None:
    pairs = differences(tasks[0])
    for pair, stored in zip(pairs, scored["results"][0]["pairs"], strict=True):
        assert (pair.policy, pair.against) == (stored["policy"], stored["against"])
        assert pair.returns.value == pytest.approx(stored["returns"]["value"])
        assert pair.improvement.value == pytest.approx(stored["improvement"]["value"])
        assert pair.metric is not None
        assert (stored["metric"]["value"] is None) == math.isinf(pair.metric.value)
    one, other = tasks[0].policies[:2]
    assert paired(one.evaluation, other.evaluation).metric is None  # a file names its own metrics


def test_the_columns_begin_with_success_the_primary_metric_and_the_return(tasks: list[TaskScores]) -> None:
    columns = quantities(tasks[0])
    assert [column.key for column in columns[:3]] == ["success", "settling_time", "return"]
    assert columns[1].bound == pytest.approx(float(np.median(list((tasks[0].bounds or (0, {}))[1].values()))))
    collided = next(column for column in quantities(tasks[1]) if column.key == "collision")
    assert collided.share
    assert collided.factor == 100.0


def test_a_cost_is_the_time_of_an_action_with_planning(tasks: list[TaskScores]) -> None:
    quantity, shown = costs(tasks[0])
    assert quantity.key == "settling_time"
    timing = shown[0].policy.timing
    seconds = timing.planning_seconds + timing.policy_seconds
    assert shown[0].action_us == pytest.approx(1e6 * seconds / timing.env_steps)


def test_an_axis_leaves_out_what_would_make_it_useless() -> None:
    low, high = span([(1.2, 1.3, 1.4), (1.1, 1.2, 1.3), (-11.0, -10.0, -9.0), (-600.0,)])
    assert 1.0 < low < 1.1
    assert 1.4 < high < 1.5
    assert span([(1.0,)], [0.0])[0] < 0.0
    assert span([(math.nan,)]) == (0.0, 1.0)
    low, high = span([(5.0,)])
    assert low < 5.0 < high


@pytest.mark.parametrize("ends", [(0.0, 1.0), (-3.2, 17.0), (1e-6, 2e-6), (-600.0, 1e4)])
def test_ticks_are_round_and_within(ends: tuple[float, float]) -> None:
    axis = Axis(*ends, 0.0, 100.0)
    ticks = axis.ticks(5)
    assert 2 <= len(ticks) <= 7
    assert all(axis.shows(tick) for tick in ticks)
    assert axis.place(ends[0]) == 0.0
    assert axis.place(ends[1]) == 100.0
    assert axis.place(1e9) == 100.0


def test_a_logarithmic_axis_has_decades() -> None:
    axis = Axis(3.0, 4e4, 0.0, 100.0, logarithmic=True)
    assert axis.ticks() == [10.0, 100.0, 1000.0, 10000.0]
    assert axis.place(math.sqrt(3.0 * 4e4)) == pytest.approx(50.0)
    assert all(10.0 <= tick <= 40.0 for tick in Axis(10.0, 40.0, 0.0, 1.0, logarithmic=True).ticks())
