"""The paired table, from results made by hand."""

from __future__ import annotations

import io
import math

import numpy as np
import pytest
from rich.console import Console

from agents.evaluation.compare import as_documents, compare_all, comparison, paired
from agents.evaluation.results import Evaluation, Timing
from agents.evaluation.statistics import Estimate

INF = math.inf


def evaluation(
    policy: str, settling_time: list[float], returns: list[float], env_id: str = "ConveyorTrack-v0", seed: int = 0
) -> Evaluation:
    times = np.array(settling_time)
    return Evaluation(
        policy=policy,
        env_id=env_id,
        seeds=seed + np.arange(len(times)),
        returns=np.array(returns),
        lengths=np.full(len(times), 150),
        metrics={"is_success": np.isfinite(times), "settling_time": times},
        timing=Timing(),
    )


OURS = evaluation("ours", [1.0, 1.0, 1.5, INF, INF, 1.25, 1.0, 1.0], [1.0, 2.0, 3.0, 0.0, 0.0, 1.0, 1.0, 1.0])
THEIRS = evaluation("theirs", [1.5, 1.0, 1.0, INF, 1.0, INF, 2.0, 1.5], [0.5, 1.5, 2.5, 9.0, 9.0, 0.5, 0.5, 0.5])


def test_differences_by_hand() -> None:
    pair = paired(OURS, THEIRS)
    assert pair.success.value == 0.0  # one success more, one less
    # Differences of the settling time: -0.5, 0, 0.5, 0 (both never), inf, -inf, -1, -0.5.
    assert pair.metric is not None
    assert pair.metric.value == pytest.approx(-0.25)
    assert pair.returns.value == pytest.approx(0.5)  # the middle half of six times 0.5 and twice -9
    assert pair.improvement.value == pytest.approx((4 + 2 * 0.5) / 8)


def test_the_other_way_round_changes_the_sign() -> None:
    pair, back = paired(OURS, THEIRS), paired(THEIRS, OURS)
    assert back.success.value == -pair.success.value
    assert pair.metric is not None
    assert back.metric is not None
    assert back.metric.value == -pair.metric.value
    assert back.improvement.value == 1.0 - pair.improvement.value
    assert back.returns.value == -pair.returns.value


def test_pairing_narrows_the_interval() -> None:
    generator = np.random.default_rng(0)
    starts = generator.normal(size=200)  # how hard an episode is, for both alike
    one, other = (
        evaluation(name, [1.0] * 200, (starts + shift + 0.01 * generator.normal(size=200)).tolist())
        for name, shift in (("one", 0.05), ("other", 0.0))
    )
    returns = paired(one, other).returns
    assert 0.04 < returns.low < 0.05 < returns.high < 0.06


def test_the_interval_covers_the_true_difference_about_as_often_as_it_says() -> None:
    covered = 0
    for seed in range(100):
        successes = np.random.default_rng(seed).random((2, 200)) < [[0.8], [0.7]]
        one, other = (evaluation("x", np.where(won, 1.0, INF).tolist(), [0.0] * 200) for won in successes)
        interval = paired(one, other).success
        covered += interval.low <= 0.1 <= interval.high
    assert 88 <= covered <= 99


def test_without_a_number_of_its_own_a_task_is_compared_by_the_return() -> None:
    one = evaluation("one", [1.0, INF], [2.0, 1.0], env_id="Other-v0")
    other = evaluation("other", [INF, 1.0], [1.0, 1.0], env_id="Other-v0")
    pair = paired(one, other)
    assert pair.metric is None
    assert pair.improvement.value == 0.75


def test_different_episodes_are_refused() -> None:
    with pytest.raises(ValueError, match="one and other were evaluated on different episodes"):
        paired(evaluation("one", [1.0], [1.0]), evaluation("other", [1.0], [1.0], seed=1))


def test_each_against_each_of_the_others() -> None:
    both = [OURS, THEIRS]
    assert [(pair.policy, pair.against) for pair in compare_all(both, ["ours"])] == [("ours", "theirs")]
    assert [(pair.policy, pair.against) for pair in compare_all(both, ["ours", "theirs"])] == [("ours", "theirs")]
    assert compare_all(both, []) == []


def test_the_table_and_the_document() -> None:
    pairs = [paired(OURS, THEIRS)]
    file = io.StringIO()
    comparison("ConveyorTrack-v0", pairs).show(Console(file=file))
    header, _, row = [line for line in file.getvalue().splitlines() if line.startswith("|")]
    assert [cell.strip() for cell in header.strip("|").split("|")] == [
        "difference",
        "success (points)",
        "settled (s)",
        "return",
        "better (%)",
    ]
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert cells[0] == "ours - theirs"
    assert cells[2].startswith("-0.250 (")
    assert cells[4].startswith("62.5 (")
    (document,) = as_documents(pairs)
    assert Estimate(**document["metric"]) == pairs[0].metric
    assert (document["policy"], document["against"]) == ("ours", "theirs")


def test_eighty_columns_show_every_cell() -> None:
    file = io.StringIO()
    console = Console(file=file, width=80, force_terminal=True, color_system=None)
    comparison("ConveyorTrack-v0", [paired(OURS, THEIRS)]).show(console)
    text = file.getvalue()
    assert "…" not in text
    assert "ours - theirs" in text
