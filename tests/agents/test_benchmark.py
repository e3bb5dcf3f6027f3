"""`planarm benchmark` from its options to the leaderboard and the JSON."""

from __future__ import annotations

import contextlib
import csv
import json
import signal
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import agents
import envs
from agents.cli import main
from agents.commands.benchmark import BenchmarkOptions, run
from agents.evaluation import benchmark
from agents.evaluation.benchmark_config import BenchmarkConfig
from envs.best_known import best_known, load, lower_bound
from planners import dpct

SMALL = {"episodes": 3, "bound_episodes": 2, "policies": ("dpct", "random"), "full": True}


def document(path: Path) -> dict[str, Any]:
    def refuse(name: str) -> None:
        raise AssertionError(f"{name} is no JSON")

    content: dict[str, Any] = json.loads(path.read_text(), parse_constant=refuse)
    return content


def test_every_policy_on_every_task(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "new" / "leaderboard.json"
    assert run(BenchmarkOptions(**SMALL, seed=7, json=path)) == 0
    out = capsys.readouterr().out
    assert "ConveyorTrack-v0: 3 episodes" in out
    assert "ConveyorTrack-v0/paper: 1 episode" in out
    content = document(path)
    assert content["complete"] is True
    assert content["versions"].keys() >= {"planarm", "python", "numpy", "numba", "pymunk", "gymnasium", "scipy"}
    assert content["machine"]["cpus"] >= 1
    assert content["command"].startswith("planarm")
    assert content["config"]["seed"] == 7
    *others, excavator = ([policy["policy"] for policy in task["policies"]] for task in content["results"])
    assert others == [["dpct", "random"]] * 5
    assert excavator == ["random"]  # it has no expert of the name dpct
    drawn, paper, move, _, dodge, _ = content["results"]
    assert all(ratio > 0.0 for ratio in move["bound"]["quintic_ratio"])
    known = load("ObstacleDodge-v0")
    assert dodge["bound"]["time_to_goal"] == [known.values[known.keys.index(seed)] for seed in (7, 8)]
    assert 0.0 <= dodge["policies"][0]["summary"]["collision"]["value"] <= 1.0
    dpct_episodes, random_episodes = (policy["episodes"] for policy in drawn["policies"])
    assert dpct_episodes["seed"] == random_episodes["seed"] == [7, 8, 9]
    assert random_episodes["settling_time"] == [None] * 3
    wanted = agents.evaluate("dpct", "ConveyorTrack-v0", [7, 8, 9])
    assert dpct_episodes["settling_time"] == wanted.metrics["settling_time"].tolist()
    assert dpct_episodes["return"] == wanted.returns.tolist()
    assert paper["options"] == {"scenario": "paper"}
    assert paper["published"]["settling_time"] == 1.10


def test_a_task_may_have_policies_of_its_own() -> None:
    (task,) = BenchmarkOptions(tasks=("ExcavatorPayload-v0",)).resolve().tasks
    assert task.policies is not None
    assert {"adaptive", "computed_torque"} <= set(task.policies)
    (task,) = BenchmarkOptions(tasks=("ExcavatorPayload-v0",), policies=("random",)).resolve().tasks
    assert task.policies == ("random",)  # the command line has the last word
    belt, load = (
        BenchmarkOptions(tasks=("ConveyorTrack-v0", "ExcavatorPayload-v0"), policies=("dpct", "random", "runs/mine"))
        .resolve()
        .tasks
    )
    assert belt.policies == ("dpct", "random", "runs/mine")
    assert load.policies == ("random", "runs/mine")  # it has no expert of the name dpct
    (belt,) = BenchmarkOptions(tasks=("ConveyorTrack-v0", "ExcavatorPayload-v0"), policies=("dpct",)).resolve().tasks
    assert belt.env == "ConveyorTrack-v0"
    board = BenchmarkOptions(episodes=3, tasks=("ExcavatorPayload-v0", "ObstacleDodge-v0"), bound_episodes=0).resolve()
    expected = 3 * sum(len(each.policies or board.policies) for each in board.tasks)
    assert benchmark.Benchmark(board).total_episodes == expected


def test_the_quick_benchmark_is_the_beginning_of_the_full_one() -> None:
    quick, full = BenchmarkOptions().resolve(), BenchmarkOptions(full=True).resolve()
    assert (full.episodes, [task.title for task in full.tasks]) == (
        128,
        [task.title for task in quick.tasks[1:]] + [quick.tasks[0].title],
    )
    assert (quick.seed, quick.policies, quick.num_envs) == (full.seed, full.policies, full.num_envs)
    assert 16 <= quick.episodes < full.episodes
    own = {"episodes", "bound_episodes"}
    whole = {task.title: task for task in full.tasks}
    for task in quick.tasks:
        assert task.model_dump(exclude=own) == whole[task.title].model_dump(exclude=own)
        assert (task.bound_episodes or 0) <= (whole[task.title].bound_episodes or 0)
    few = BenchmarkOptions(tasks=("MinTorqueMove-v0",), episodes=2).resolve()
    assert (few.episodes, few.bound_episodes) == (2, quick.bound_episodes)


def test_the_quick_benchmark_says_what_it_is(capsys: pytest.CaptureFixture[str]) -> None:
    few: dict[str, Any] = {"tasks": ("ConveyorTrack-v0",), "policies": ("random",), "bound_episodes": 0}
    assert run(BenchmarkOptions(**few)) == 0
    first = capsys.readouterr().out.splitlines()[0]
    assert "the first 32 of 128 episodes" in first
    assert "planarm benchmark --full" in first
    for options in ({"full": True}, {"episodes": 3}, {"format": "csv"}):
        assert run(BenchmarkOptions(**few, **options)) == 0
        captured = capsys.readouterr()
        assert "of 128 episodes" not in captured.out
        assert ("of 128 episodes" in captured.err) == ("format" in options)


def test_a_task_is_printed_when_it_is_finished(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    printed: list[str] = []

    def watching(policy: str, env_id: str, seeds: Any, **kwargs: Any) -> Any:
        printed.append(capsys.readouterr().out)
        return agents.evaluate(policy, env_id, seeds, **kwargs)

    monkeypatch.setattr(benchmark, "evaluate", watching)
    tasks = ("ConveyorTrack-v0", "ObstacleDodge-v0")
    assert run(BenchmarkOptions(episodes=3, bound_episodes=0, policies=("follower",), tasks=tasks)) == 0
    before, of_the_second = printed[:-2], printed[-2]
    assert not any(before)
    assert "### ConveyorTrack-v0: 3 episodes" in of_the_second
    assert "### ObstacleDodge-v0: 3 episodes" in capsys.readouterr().out


def test_numbers_as_csv_and_tables_as_markdown(capsys: pytest.CaptureFixture[str]) -> None:
    options = {**SMALL, "policies": ("apf", "random"), "tasks": ("ConveyorTrack-v0",), "bound_episodes": 0}
    assert run(BenchmarkOptions(**options, format="csv")) == 0
    rows = list(csv.DictReader(capsys.readouterr().out.splitlines()))
    (success,) = [row for row in rows if (row["policy"], row["number"]) == ("apf", "success")]
    assert success["task"] == "ConveyorTrack-v0"
    assert float(success["value"]) == 1.0
    assert 0.0 < float(success["low"]) < 1.0
    assert {"return", "settling_time", "planning_ms", "policy_us"} <= {row["number"] for row in rows}
    assert run(BenchmarkOptions(**options, format="markdown", wide=True)) == 0
    assert "|policy" in capsys.readouterr().out


@pytest.mark.parametrize("first", [0, 10_000])
def test_the_bound_is_the_best_known_value_of_each_start(tmp_path: Path, first: int) -> None:
    path = tmp_path / "leaderboard.json"
    options = {**SMALL, "policies": ("dpct",), "seed": first}
    assert run(BenchmarkOptions(**options, tasks=("ConveyorTrack-v0",), json=path)) == 0
    (task,) = document(path)["results"]
    env: Any = gym.make_vec("ConveyorTrack-v0", num_envs=2).unwrapped
    env.reset(seed=[first, first + 1])
    wanted = [best_known(env, env_index) for env_index in range(2)]
    assert np.isnan(wanted).all() == (first == 10_000)
    settled = task["policies"][0]["episodes"]["settling_time"][:2]
    if first == 10_000:  # not stored: with the hand on the belt's line, or the policy's own
        on_line = [dpct.settling_bound(env.motion_problem(env_index), 1e-3, 2e-3, 0.005) for env_index in range(2)]
        wanted = np.minimum(on_line, settled).tolist()
    assert task["bound"]["seeds"] == [first, first + 1]
    known = task["bound"]["settling_time"]
    assert known == pytest.approx(wanted, abs=1e-5 if first else 0.0)  # observations have 32 bits
    lower = [None if first == 10_000 else lower_bound(env, env_index) for env_index in range(2)]
    assert task["lower_bound"] == {"seeds": [first, first + 1], "settling_time": lower}
    above = np.subtract(settled, known)
    assert (above >= 0.0).all()
    assert task["policies"][0]["summary"]["above_bound"]["value"] == pytest.approx(np.median(above))


@pytest.mark.parametrize("env_id", ["ConveyorTrack-v0", "MinTorqueMove-v0", "ObstacleDodge-v0"])
def test_no_policy_within_the_limits_is_better_than_best_known_from_fresh_starts(env_id: str) -> None:
    settings = {"episodes": 12, "bound_episodes": 10, "seed": 77_777, "replays": 0, "num_envs": 12}
    config = BenchmarkConfig.parse({**settings, "tasks": [{"env": env_id}], "policies": ["dpct", "agent"]}, "test")
    run_through = benchmark.Benchmark(config)
    run_through.fill(lambda text: None, lambda count: None)
    (result,) = run_through.board.results
    bound = envs.task_card(env_id).bound
    assert bound is not None
    assert result.bounds is not None
    assert np.isfinite(result.bounds).all()
    for each in result.evaluations:
        kept = each.success & (each.metrics["limit_ratio"] <= 1.005)
        assert (each.metrics[bound.metric][:10] >= result.bounds)[kept[:10]].all()
        assert kept.mean() > 0.5


def test_measuring_with_noise_changes_no_best_known_value() -> None:
    bound, noise = envs.task_card("ConveyorTrack-v0").bound, {"encoder_noise": 1e-4, "camera_noise": 1e-3}
    assert bound is not None
    known = []
    for settings in ({}, noise):
        with contextlib.closing(gym.make_vec("ConveyorTrack-v0", num_envs=4, payload=0.1, **settings)) as env:
            env.reset(seed=[500, 501, 502, 503])
            known.append([bound.optimum(env.unwrapped, number, 500 + number) for number in range(4)])
    np.testing.assert_allclose(known[0], known[1], atol=1e-6)


@pytest.mark.parametrize("beside", [None, 0.05])
def test_a_best_known_value_is_no_worse_than_the_planners_own(beside: float | None) -> None:
    given = {} if beside is None else {"beside": beside}
    played = agents.evaluate("dpct", "ConveyorTrack-v0", range(500, 508), options=given)
    bound = envs.task_card("ConveyorTrack-v0").bound
    assert bound is not None
    with contextlib.closing(gym.make_vec("ConveyorTrack-v0", num_envs=8)) as env:
        env.reset(seed=list(range(500, 508)), options=given)
        known = [bound.optimum(env.unwrapped, number, 500 + number) for number in range(8)]
    assert (np.array(known) <= played.metrics["settling_time"] + 1e-9).all()


def test_ctrl_c_keeps_what_is_finished(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(policy: str, env_id: str, seeds: Any, **kwargs: Any) -> Any:
        if policy == "random" and len(seeds) > benchmark.WARM_UP:
            raise KeyboardInterrupt
        return agents.evaluate(policy, env_id, seeds, **kwargs)

    monkeypatch.setattr(benchmark, "evaluate", interrupted)
    path = tmp_path / "leaderboard.json"
    assert run(BenchmarkOptions(**SMALL, json=path)) == 130
    captured = capsys.readouterr()
    assert "interrupted" in captured.err
    assert "|dpct" in captured.out
    assert "|random" not in captured.out
    content = document(path)
    assert content["complete"] is False
    assert [policy["policy"] for policy in content["results"][0]["policies"]] == ["dpct"]


FAILING = """
import numpy as np

class Fails:  # in the middle of the benchmark
    resets = 0
    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        Fails.resets += int(episode_start.any())
        return np.full((len(observation), 3), 0.1 if Fails.resets < 6 else np.nan), None

class Single:  # in a single environment
    def __init__(self, env):
        self.shape = env.action_space.shape
    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        return np.zeros(self.shape), None
"""


def test_a_policy_that_fails_takes_nothing_with_it_that_is_finished(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "failing.py").write_text(FAILING)
    one = ["benchmark", "--tasks", "MinTorqueMove-v0", "--episodes", "4", "--bound-episodes", "0", "--num-envs", "1"]
    assert main([*one, "--policies", "random", "failing:Fails", "--json", "kept.json"]) == 2
    captured = capsys.readouterr()
    assert "failed: this is all that was finished" in captured.err
    assert "planarm benchmark: Fails gave the action [nan, nan, nan] in environment 0" in captured.err
    assert "|random" in captured.out
    (task,) = document(tmp_path / "kept.json")["results"]
    assert [policy["policy"] for policy in task["policies"]] == ["random"]
    assert document(tmp_path / "kept.json")["complete"] is False

    assert main([*one, "--policies", "random", "failing:Single", "--json", "none.json"]) == 2
    captured = capsys.readouterr()
    assert (captured.out, (tmp_path / "none.json").exists()) == ("", False)
    assert "Single gave actions of shape (3,); expected (1, 3)" in captured.err
    assert main([*one, "--policies", "random", "failing:Single"]) == 0  # without replays nothing needs that


def test_ctrl_c_that_a_callback_swallows_is_not_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    def swallowing(policy: str, env_id: str, seeds: Any, **kwargs: Any) -> Any:
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        return agents.evaluate(policy, env_id, seeds, **kwargs)

    before = signal.getsignal(signal.SIGINT)
    monkeypatch.setattr(benchmark, "evaluate", swallowing)
    assert run(BenchmarkOptions(**SMALL)) == 130
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("policies: [dpct, folower]\ntasks: [{env: ConveyorTrack-v0}]", 'did you mean "follower"'),
        ("policies: [dpct]\ntasks: [{env: ConveyrTrack-v0}]", 'did you mean "ConveyorTrack-v0"'),
        ("policies: [dpct]\ntasks: [{env: ConveyorTrack-v0, env_config: {paylod: 1}}]", 'did you mean "payload"'),
        ("policies: [dpct]\ntasks: [{env: ConveyorTrack-v0, options: {belt_speed: 9}}]", "no motion"),
    ],
)
def test_what_is_wrong_is_said_before_anything_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, complaint: str
) -> None:
    monkeypatch.setattr(benchmark, "evaluate", lambda *args, **kwargs: pytest.fail("an episode was run"))
    path = tmp_path / "mine.yaml"
    path.write_text(f"episodes: 1\nbound_episodes: 0\n{text}\n")
    with pytest.raises(ValueError, match=complaint):
        run(BenchmarkOptions(config=str(path)))
