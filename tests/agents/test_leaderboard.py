"""The table, from results made by hand."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from agents.evaluation.benchmark_config import BenchmarkTask, Published
from agents.evaluation.leaderboard import TaskResult, as_document, leaderboard
from agents.evaluation.results import Evaluation, Timing


def evaluation(policy: str, success: list[bool], settling_time: list[float], returns: list[float]) -> Evaluation:
    n = len(success)
    return Evaluation(
        policy=policy,
        env_id="ConveyorTrack-v0",
        seeds=np.arange(n),
        returns=np.array(returns),
        lengths=np.full(n, 150),
        metrics={
            "is_success": np.array(success),
            "settling_time": np.array(settling_time),
            "steady_state_error": np.full(n, 2e-4),
            "limit_ratio": np.array([1.0, 1.003, 1.004, 1.021][:n]),
        },
        timing=Timing(env_steps=600, plans=4, planning_seconds=0.02, policy_seconds=0.0012, env_seconds=0.003),
    )


@pytest.fixture
def result() -> TaskResult:
    task = BenchmarkTask(
        env="ConveyorTrack-v0", published=Published(source="Somebody, 1992", settling_time=1.1, note="Of its own.")
    )
    return TaskResult(
        task,
        np.arange(4),
        [
            evaluation("late", [True] * 4, [2.0, 2.2, 2.4, 2.6], [0.5] * 4),
            evaluation("lost", [False] * 4, [np.inf] * 4, [9.0] * 4),
            evaluation("soon", [True] * 4, [1.0, 1.2, 1.4, 1.6], [1.5] * 4),
        ],
        bounds=np.array([0.9, np.inf, 1.0]),
    )


def printed(result: TaskResult, *, terminal: bool, width: int = 80, wide: bool = False) -> str:
    file = io.StringIO()
    leaderboard(result).show(Console(file=file, width=width, force_terminal=terminal, color_system=None), wide=wide)
    return file.getvalue()


def test_the_summary_with_the_bound(result: TaskResult) -> None:
    estimates = result.summarise(result.evaluations[0])
    assert estimates["success"].value == 1.0
    assert estimates["settling_time"].value == pytest.approx(2.3)
    assert estimates["limit_broken"].value == 0.25
    # Seeds 0 and 2: the bound of seed 1 is infinite, seed 3 has none.
    assert estimates["above_bound"].value == pytest.approx(np.median([2.0 - 0.9, 2.4 - 1.0]))


def test_episodes_of_policies_within_the_limits_take_the_place_of_worse_best_known_values(result: TaskResult) -> None:
    result.bounds = np.array([2.1, np.inf, 1.0, 0.9])
    result.bound_by_policies()
    assert result.bounds.tolist() == [1.0, 1.2, 1.0, 0.9]
    result.bounds = np.array([2.1, np.inf, 1.0, 3.0])
    result.bound_by_policies()  # in the last episode all break a limit
    assert result.bounds.tolist() == [1.0, 1.2, 1.0, 3.0]
    assert "or of a policy's episode that is better within the limits" in printed(result, terminal=False)


def test_where_noise_decides_a_policy_is_no_best_known_value(result: TaskResult) -> None:
    metrics = {"tip_rms": np.zeros(4), **result.evaluations[0].metrics}
    noisy = TaskResult(
        BenchmarkTask(env="ExcavatorPayload-v0"),
        np.arange(4),
        [replace(result.evaluations[0], env_id="ExcavatorPayload-v0", metrics=metrics)],
        bounds=np.array([1e-3, 2e-3]),
    )
    noisy.bound_by_policies()
    assert noisy.bounds is not None
    assert noisy.bounds.tolist() == [1e-3, 2e-3]


def test_markdown_where_there_is_no_terminal(result: TaskResult) -> None:
    text = printed(result, terminal=False)
    rows = [
        [cell.strip() for cell in line.strip("| ").split("|")] for line in text.splitlines() if line.startswith("|")
    ]
    table = {row[0]: dict(zip(rows[0], row, strict=False)) for row in rows[2:]}
    assert list(table) == ["soon", "late", "lost", "best known (first 3)", "paper"]  # success first, the return second
    assert table["soon"]["success (%)"] == "100 (51-100)"
    assert table["soon"]["settled (s)"] == "1.300"
    assert table["soon"]["error (mm)"] == "0.200"
    assert table["soon"]["broken (%)"] == "25"
    assert table["late"]["return"] == "0.500 (0.500 to 0.500)"
    assert table["soon"]["plan (ms)"] == "5.000"
    assert table["soon"]["step (us)"] == "2.000"
    assert table["lost"]["settled (s)"] == table["lost"]["over best known"] == "never"
    assert table["best known (first 3)"]["settled (s)"] == "1.000"
    assert table["paper"]["settled (s)"] == "1.100"
    assert "the environment takes 5.0 us" in text
    assert "(first 3)" in text
    assert "Somebody, 1992. Of its own." in text


def test_a_terminal_shows_the_foremost_columns_that_fit(result: TaskResult) -> None:
    for width in (60, 80, 120):
        text = printed(result, terminal=True, width=width)
        assert max(map(len, text.splitlines())) <= width
        for cell in ("settled", "success", "1.300", "never", "1.100", "100 (51-100)"):
            assert cell in text
    assert "--wide" not in text  # all fit
    assert "Not shown: error (mm), limit ratio, return" in " ".join(printed(result, terminal=True, width=60).split())


def test_a_terminal_shows_every_cell_if_asked_to(result: TaskResult) -> None:
    text = printed(result, terminal=True, wide=True)
    assert max(map(len, text.splitlines())) <= 80
    assert "…" not in text
    for cell in ("1.300", "0.200", "never", "5.000", "2.000", "1.100"):
        assert cell in text


def test_document_holds_every_episode(result: TaskResult) -> None:
    document = as_document(result)
    soon = document["policies"][2]
    np.testing.assert_array_equal(soon["episodes"]["settling_time"], [1.0, 1.2, 1.4, 1.6])
    assert soon["episodes"].keys() == {"seed", "return", "length", *result.evaluations[2].metrics}
    assert soon["timing"]["planning_ms"] == pytest.approx(5.0)
    assert document["bound"]["seeds"].tolist() == [0, 1, 2]
    assert document["published"]["settling_time"] == 1.1
