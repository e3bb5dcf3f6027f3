"""Recorded episodes: they are those that were scored, at a reduced rate, of the seeds that are worth a look."""

from __future__ import annotations

from contextlib import closing
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from report_cases import HOSTILE

import envs
from agents.commands.benchmark import BenchmarkOptions, run
from agents.environments import make_one
from agents.evaluation.benchmark_config import BenchmarkTask
from agents.evaluation.leaderboard import TaskResult
from agents.evaluation.replays import FRAMES, record_replays, seeds_to_record, units_of
from agents.evaluation.results import Evaluation, Timing
from agents.report.results_file import Results
from planners.typing import Array


def scores(name: str, success: list[bool], settled: list[float]) -> Evaluation:
    metrics = {"is_success": np.array(success), "settling_time": np.array(settled)}
    seeds = np.arange(10, 10 + len(success))
    return Evaluation(name, "ConveyorTrack-v0", seeds, np.array(settled), seeds, metrics, Timing(env_steps=1))


def replay_joints(recorded: dict[str, Any], units: dict[str, int]) -> Array:
    """The positions of the joints in a replay, ``(frames, n + 1, 2)``, m: `record_replay` read back."""
    paths = [path for path in (*recorded["fixed"], *recorded["numbers"]) if path.startswith("joints.")]
    joints = np.empty((recorded["frames"], len(paths) // 2, 2))
    for path in paths:
        _, joint, axis = path.split(".")
        if path in recorded["fixed"]:
            joints[:, int(joint), int(axis)] = recorded["fixed"][path]
        else:
            joints[:, int(joint), int(axis)] = np.cumsum([int(step) for step in recorded["numbers"][path].split()])
            joints[:, int(joint), int(axis)] /= units[""]
    return joints


@pytest.mark.parametrize(("task", "policy"), [(0, "apf"), (1, "random")])
def test_a_replay_is_the_episode_of_its_seed(scored: dict[str, Any], task: int, policy: str) -> None:
    result = scored["results"][task]
    recorded = next(each for each in result["replays"]["episodes"] if (each["policy"], each["seed"]) == (policy, 1))
    with closing(make_one(result["env"], result["env_config"])) as env:
        inner = env.unwrapped.task  # type: ignore[attr-defined]
        expert = envs.make_expert(policy, env)
        observation, _ = env.reset(seed=1)
        wanted, speeds, times, state, begins, ended = [], [], [], None, True, False
        while True:
            wanted.append(inner.arm.joint_positions(inner.batch["q"][0]))
            speeds.append(np.abs(inner.batch["qd"][0] / inner.arm.limits.velocity).max())
            times.append(round(len(times) * inner.config.control_period, 9))
            if ended:
                break
            actions, state = expert.predict(observation[None], state, np.array([begins]))
            observation, _, terminated, truncated, _ = env.step(actions[0])
            begins, ended = False, terminated or truncated
    shown = np.cumsum([int(step) for step in recorded["numbers"]["time"].split()]) / 1000
    places = [int(np.argmin(np.abs(np.array(times) - time))) for time in shown]
    joints = replay_joints(recorded, result["replays"]["units"])
    assert joints.shape == (recorded["frames"], *wanted[0].shape)
    np.testing.assert_allclose(joints, np.array(wanted)[places], atol=0.6e-3)
    np.testing.assert_allclose(shown, np.array(times)[places], atol=1e-9)
    assert places[0] == 0
    assert places[-1] == len(wanted) - 1 == recorded["length"]
    since = [max(speeds[last + 1 : place + 1]) for last, place in pairwise(places)]
    gauge = np.cumsum(
        [int(step) for step in recorded["numbers"][f"limit_gauges.{inner.gauges.index('velocity')}.1"].split()]
    )
    np.testing.assert_allclose(gauge[1:] / 100, since, atol=0.51e-2)


def test_replays_have_the_scores_of_their_episodes(scored: dict[str, Any]) -> None:
    for result in scored["results"]:
        names = [policy["policy"] for policy in result["policies"]]
        assert len(result["replays"]["episodes"]) == len(names) * len(result["replays"]["seeds"]) == 9
        for replay in result["replays"]["episodes"]:
            episodes = result["policies"][names.index(replay["policy"])]["episodes"]
            place = episodes["seed"].index(replay["seed"])
            assert (replay["return"], replay["length"]) == (episodes["return"][place], episodes["length"][place])
            assert 2 <= replay["frames"] <= FRAMES[1] + 1
            assert all(len(text.split()) == replay["frames"] for text in replay["numbers"].values())
            assert all(len(text.split("\n")) == replay["frames"] for text in replay["texts"].values())


def test_scores_do_not_depend_on_the_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    documents = []
    for replays in (0, 2):
        path = tmp_path / f"{replays}.json"
        options = BenchmarkOptions(
            episodes=3,
            bound_episodes=0,
            policies=("apf", "random"),
            tasks=("ConveyorTrack-v0",),
            json=path,
            replays=replays,
        )
        assert run(options) == 0
        documents.append(Results.read(path).results[0])
    without, recorded = documents
    assert without.replays is None
    assert recorded.replays is not None
    assert [policy.episodes for policy in without.policies] == [policy.episodes for policy in recorded.policies]
    assert [policy.summary for policy in without.policies] == [policy.summary for policy in recorded.policies]


def test_half_are_the_first_seeds_and_the_others_the_worst_of_each_policy() -> None:
    never = np.inf
    best = scores("best", [True] * 8, [1.0, 1.0, 1.0, 1.0, 9.0, 1.0, 8.0, 1.0])
    other = scores("other", [True, True, True, True, True, False, True, True], [1, 1, 1, 1, 1, never, 1, 5])
    result = TaskResult(BenchmarkTask(env="ConveyorTrack-v0"), best.seeds, [other, best])
    assert seeds_to_record(result, 4) == [10, 11, 14, 15]  # the worst of either, a failure before all
    assert seeds_to_record(result, 6) == [10, 11, 12, 14, 15, 16]  # the better policy first
    assert seeds_to_record(result, 99) == list(range(10, 18))
    assert seeds_to_record(result, 0) == []


def test_an_environment_without_scenes_has_no_replays() -> None:
    result = TaskResult(BenchmarkTask(env="CartPole-v1"), np.arange(2))
    assert record_replays(result, 2, lambda seeds: []) is None


def test_positions_are_finer_where_the_view_is_small() -> None:
    assert units_of((-1.4, 1.4, -1.0, 1.0))[""] == 1000
    assert units_of((-0.2, 0.2, -0.1, 0.1))[""] == 10_000
    assert units_of((-9.0, 9.0, -9.0, 9.0))[""] == 1000


def test_a_name_of_any_letters_is_recorded(scored: dict[str, Any]) -> None:
    assert {each["policy"] for each in scored["results"][0]["replays"]["episodes"]} == {"apf", HOSTILE, "random"}
