"""Under which settings and levels commands score, train and record: given, carried by a policy, and said."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import agents
import envs
import planarm
import planners
from agents.cli import main
from agents.commands.evaluate import EvaluateOptions
from agents.commands.train import TrainOptions
from agents.evaluation.benchmark_config import BenchmarkConfig, BenchmarkTask, configure
from agents.policies.lookup import find_policy
from agents.submissions.writing import write_submission
from agents.tables import Table
from agents.yaml_config import assigned
from planners.documents import parse_yaml

BELT = "ConveyorTrack-v0"


@pytest.mark.parametrize("option", ["--settings", "--against", "--episodes"])
def test_an_option_that_is_given_twice_is_refused(option: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", "apf", "--env", BELT, option, "payload=0.1", option, "latency=0.02"]) == 2
    assert f"{option} is given twice: give it once, with all of its values behind it" in capsys.readouterr().err


def test_a_flag_may_stand_twice(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["play", BELT, "--policies", "nobody", "--no-browser", "--no-browser"]) == 2
    assert "unknown policy" in capsys.readouterr().err


def test_changes_of_a_training_may_stand_on_both_sides_of_an_option(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["train", "ppo/ConveyorTrack-v0", "gamma=0.9", "--seed", "1", "hidden=64"]) == 2
    assert "hidden = 64: give a list, such as [64]" in capsys.readouterr().err


def test_a_shipped_agent_brings_the_settings_of_its_training_nowhere() -> None:
    named = find_policy("agent:uncertain", "ObstacleDodge-v0")
    assert named.own_settings({}) == named.settings({}) == {"control_mode": "velocity"}
    options = EvaluateOptions("agent:uncertain", env="ObstacleDodge-v0", against=("apf",))
    (task,) = options.resolve().config.tasks
    assert task.env_config == {}


class Carry:
    """A policy of a user's own that declares settings."""

    env_config = {"control_mode": "jerk", "payload": 0.2}  # noqa: RUF012

    def predict(self, observation: object) -> object:
        raise NotImplementedError


def test_settings_that_a_policy_declares_are_its_own_in_every_command() -> None:
    named = find_policy(f"{__name__}:Carry", BELT)
    assert named.settings({"horizon": 2.0}) == {"horizon": 2.0, "control_mode": "jerk", "payload": 0.2}
    with pytest.raises(ValueError, match=r"Carry was made for payload 0\.2 and cannot act with 0\.1"):
        named.settings({"payload": 0.1})


def test_a_level_has_precedence_over_what_a_policy_carries_and_is_not_mixed() -> None:
    (task,) = EvaluateOptions(f"{__name__}:Carry", env=BELT, level="payload").resolve().config.tasks
    assert task.env_config["payload"] in ((0.0, 0.3), [0.0, 0.3])
    assert task.title == f"{BELT}/payload"
    assert task.beside_title == ""


def test_settings_beside_the_title_are_said() -> None:
    task = BenchmarkTask.parse({"env": BELT, "level": "noise", "env_config": {"payload": 0.2}}, "task")
    assert task.beside_title == "payload 0.2"


def test_changes_of_a_named_task_are_said() -> None:
    tasks = {task.title: task for task in configure("benchmark", {"env_config": {"payload": 0.2}}).tasks}
    assert {task.beside_title for task in tasks.values()} == {"payload 0.2"}
    assert any(task.name for task in tasks.values())
    assert {task.beside_title for task in configure("benchmark", {}).tasks if task.name} == {""}


def test_a_policy_made_for_other_episodes_is_not_compared_with_the_rest() -> None:
    with pytest.raises(ValueError, match=r"Carry was made for payload 0\.2 and would have other episodes"):
        agents.compare(["dpct", f"{__name__}:Carry"], BELT, range(2))
    with pytest.raises(ValueError, match="give this to every policy, as a setting of ConveyorTrack-v0"):
        agents.leaderboard(["dpct", f"{__name__}:Carry"], [BELT], episodes=1)
    named = find_policy(f"{__name__}:Carry", BELT)
    named.require_same_episodes(BELT, {"payload": 0.2})
    replace(named, action_config={"control_mode": "jerk", "horizon": 3.0}).require_same_episodes(BELT, {})


def test_one_level_of_every_task_is_one_task_an_environment() -> None:
    config = configure("benchmark", {"level": "uncertain"})
    titles = [task.title for task in config.tasks]
    assert titles == list(dict.fromkeys(titles))
    assert all(title.endswith("/uncertain") for title in titles)
    plain = {task.env: task.episodes for task in configure("benchmark", {}).tasks if not task.options}
    assert all(task.episodes == plain[task.env] for task in config.tasks)
    for title in ("ObstacleDodge-v0/two_discs", "ObstacleDodge-v0/second_arm"):
        with pytest.raises(ValueError, match="has settings of its own beside --level fast"):
            configure("levels", {"level": "fast"}, [title])
    with pytest.raises(ValueError, match="give a list"):
        configure("benchmark", {}, BELT)


def test_a_level_stays_where_the_settings_of_a_recipe_are_replaced() -> None:
    changes = ("env_config={control_mode: jerk}", "gamma=0.9")
    config = TrainOptions("ppo/ConveyorTrack-v0", changes, level="payload").resolve()
    assert config.env_config["control_mode"] == "jerk"
    assert list(config.env_config["payload"]) == [0.0, 0.3]
    given = TrainOptions("ppo/ConveyorTrack-v0", ("env_config={payload: 0.1}",), level="payload").resolve()
    assert given.env_config["payload"] == 0.1


def test_remarks_of_runs_that_learn_nothing() -> None:
    short = TrainOptions("sac/ConveyorTrack-v0", ("total_steps=400", "learning_starts=5000")).resolve()
    assert "nothing will be learned" in short.remark
    assert TrainOptions("ppo/ConveyorTrack-v0", ("total_steps=0", "batch_size=999")).resolve().remark == ""
    with pytest.raises(ValueError, match='level "payload" is given 2 times'):
        TrainOptions("ppo/ConveyorTrack-v0", ("levels=[payload,payload]",)).resolve().check_levels()


def test_numbers_of_yaml_are_those_of_its_version_1_2() -> None:
    assert parse_yaml("[010, -007, 12, 1e-4, 1:30]", "it") == [10, -7, 12, 1e-4, "1:30"]


def test_a_bar_in_a_name_is_no_column() -> None:
    assert r"a\|b" in str(Table("t", ["policy", "x"], [["a|b", "1"]]))


def test_packages_list_their_public_names() -> None:
    for package in (agents, envs, planners, planarm):
        assert set(package.__all__) <= set(dir(package)), package.__name__


def test_an_agent_of_no_environment_of_the_leaderboard_is_no_submission(tmp_path: Path) -> None:
    agent = agents.load_agent(BELT)
    agent.document["env"] = "Circle-v0"
    with pytest.raises(ValueError, match="Circle-v0 is no environment of the leaderboard"):
        write_submission(agent, tmp_path / "mine", "mine", ["me"], "MIT", "none")
    assert not (tmp_path / "mine").exists()


@pytest.mark.parametrize(
    "command",
    [
        ["report", "FILE", "--out", "FILE"],
        ["benchmark", "--config", "FILE", "--json", "FILE"],
        ["evaluate", "apf", "--env", BELT, "--settings", "arm=FILE", "--json", "FILE"],
        ["plan", "--arm", "FILE", "--start", "0", "1", "--to-joints", "1", "1", "--csv", "FILE"],
        ["evaluate", "AGENT.safetensors", "--env", BELT, "--json", "AGENT.json"],
        ["evaluate", "RUN", "--env", BELT, "--json", "RUN/best.json"],
        ["evaluate", "mine:policy", "--env", BELT, "--json", "mine.py"],
        ["submit", "check", "RUN", "--json", "RUN/agent.json"],
    ],
)
def test_no_file_that_a_command_reads_is_replaced(
    command: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("mine", "run/best", "run/agent"):
        agents.save_agent(agents.load_agent(BELT), tmp_path / f"{name}.safetensors")
    Path("file.yaml").write_text("lengths_m: [1, 1]\n")
    Path("mine.py").write_text("policy = None\n")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*.*")}
    words = [word.replace("FILE", "file.yaml").replace("AGENT", "mine").replace("RUN", "run") for word in command]
    assert main(words) == 2
    assert "which the command reads: give it a name of its own" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in tmp_path.rglob("*.*")} == before


@pytest.mark.parametrize(
    "call",
    [
        lambda: agents.evaluate("apf", BELT, [0], env_config="payload=1"),  # type: ignore[arg-type]
        lambda: agents.evaluate("apf", BELT, [0], options=["paper"]),  # type: ignore[arg-type]
        lambda: agents.compare(["apf"], BELT, [0], env_config=3),  # type: ignore[arg-type]
        lambda: agents.leaderboard(["apf"], [BELT], env_config="payload=1"),  # type: ignore[arg-type]
    ],
)
def test_settings_are_names_with_values(call: Callable[[], object]) -> None:
    with pytest.raises(ValueError, match=r"names with values|valid dictionary|dictionary"):
        call()


def test_an_environment_is_given_by_its_name() -> None:
    for wrong in (gym.make(BELT), None, 3):
        with pytest.raises(ValueError, match=r"is no name: give a text, such as ConveyorTrack-v0"):
            agents.evaluate("apf", wrong, [0])  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="give a list with at least one"):
        agents.compare(iter([]), BELT)  # type: ignore[arg-type]


def test_the_first_task_of_the_quick_part_is_one_of_the_benchmark(tmp_path: Path) -> None:
    config = tmp_path / "mine.yaml"
    config.write_text(
        f"episodes: 2\nbound_episodes: 0\npolicies: [apf]\ntasks: [{{env: {BELT}}}]\n"
        "quick: {episodes: 1, bound_episodes: 0, first: ConveyorTrak-v0}\n"
    )
    with pytest.raises(ValueError, match='"ConveyorTrak-v0"; did you mean "ConveyorTrack-v0"'):
        configure(str(config), {})


def test_an_agent_that_is_shipped_is_scored_alike_by_name_and_in_memory() -> None:
    env_id = "ObstacleDodge-v0"
    named = agents.evaluate("agent:uncertain", env_id, range(4))
    loaded = agents.evaluate(agents.load_agent(env_id, "uncertain"), env_id, range(4))
    np.testing.assert_array_equal(named.returns, loaded.returns)


def test_a_policy_is_given_once_everywhere() -> None:
    with pytest.raises(ValueError, match='policy "apf" is given 2 times'):
        agents.record_dataset("any-v0", BELT, ["apf", "apf"], 1)
    task = {"env": BELT, "policies": ["dpct", "dpct"]}
    with pytest.raises(ValueError, match='policy "dpct" is given 2 times'):
        BenchmarkConfig.parse({"episodes": 1, "bound_episodes": 0, "policies": ["apf"], "tasks": [task]}, "benchmark")


@pytest.mark.parametrize("env_id", envs.env_ids())
def test_an_expert_is_scored_with_the_arm_it_was_made_for(env_id: str) -> None:
    arms = [{}, {"arm": "so101"}] if env_id == "MinTorqueMove-v0" else [{}]  # whose task takes the limits of jerk away
    name = next(iter(envs.task_card(env_id).experts))
    for settings in arms:
        expert = envs.make_expert(name, gym.make(env_id, **settings))
        found = agents.evaluate(expert, env_id, range(1))
        assert found.returns.tolist() == agents.evaluate(name, env_id, range(1), env_config=settings).returns.tolist()


def test_an_expert_of_another_arm_is_refused() -> None:
    small = envs.make_expert("dpct", gym.make(BELT, arm="epson_t3b"))
    with pytest.raises(ValueError, match="was made for the arm"):
        agents.compare([small, "dpct"], BELT, range(2))
    own = envs.make_expert("dpct", gym.make(BELT))
    with pytest.raises(ValueError, match="was made for the arm"):
        agents.evaluate(own, BELT, range(2), env_config={"arm": "epson_t3b"})


def test_a_sign_is_a_value_of_an_option() -> None:
    assert assigned({}, ["elbow=-", "other=+", "list=[-1]"]) == {"elbow": "-", "other": "+", "list": [-1]}


def test_a_setting_that_is_swept_is_given_once(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sweep", "ppo/ConveyorTrack-v0", "gamma=0.5", "--over", "gamma=0.9,0.95", "--dry-run"]) == 2
    assert 'setting "gamma" is given 2 times' in capsys.readouterr().err


def test_an_expert_of_another_name_acts_in_the_mode_that_the_configuration_gives_it() -> None:
    given = {"my dpct": "dpct", "dpct": "dpct"}
    board = agents.leaderboard(given, ["ConveyorTrack-v0/latency"], config="levels", episodes=1, bound_episodes=0)
    (result,) = board.results
    assert [each.policy for each in result.evaluations] == ["my dpct", "dpct"]
    assert result.action_configs == {"my dpct": {"control_mode": "jerk"}, "dpct": {"control_mode": "jerk"}}
    assert result.evaluations[0].returns.tolist() == result.evaluations[1].returns.tolist()
