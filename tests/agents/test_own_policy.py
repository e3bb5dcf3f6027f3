"""A policy of the user's own: found by module:name, made for the environment, checked, and scored beside the others."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from pages import follow

import agents
import envs
import planners
from agents import environments
from agents.cli import main
from agents.environments import full_name, import_env
from agents.policies.files import describe_layout, layout_of
from agents.policies.policy import as_policy
from planners.capabilities import VARIANTS

ENV = "ConveyorTrack-v0"
MODULE = """
import numpy as np


class Still:
    def __init__(self, env):
        self.n = env.unwrapped.task.arm.n_joints

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        return np.zeros((len(observation), self.n)), None


class Plain:
    env_config = {"control_mode": "jerk"}

    def predict(self, observation):
        return np.zeros((len(observation), 2)), None


class Wrong:
    def __init__(self, actions):
        self.actions = actions

    def predict(self, observation, **rest):
        return self.actions(len(observation)), None


def make_policy(env):
    return Still(env)


def with_more(env, gain):
    return Still(env)


flat = Wrong(lambda n: np.zeros(2))
turned = Wrong(lambda n: np.zeros((2, n)))
nan = Wrong(lambda n: np.full((n, 2), np.nan))
words = Wrong(lambda n: np.full((n, 2), "left"))
plain = Plain()
number = 3
nothing = lambda: None


class Bare:
    def predict(self, observation):
        return np.zeros((len(observation), 2))
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The current folder, with the user's module ``mine``."""
    (tmp_path / "mine.py").write_text(MODULE)
    (tmp_path / "broken.py").write_text("import mine\n1 / 0\n")
    (tmp_path / "needy.py").write_text("import no_such_library\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    yield tmp_path
    for name in ("mine", "broken", "needy"):
        sys.modules.pop(name, None)


@pytest.mark.parametrize("name", ["make_policy", "Still", "plain", "Plain"])
def test_functions_classes_and_objects_act(folder: Path, name: str) -> None:
    evaluation = agents.evaluate(f"mine:{name}", ENV, range(3), num_envs=2)
    assert evaluation.policy == name
    assert evaluation.metrics["peak_torque"].max() < 1.0  # no torque, or that of a constant velocity
    assert not evaluation.success.any()


def test_a_policy_brings_the_settings_that_it_declares(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(folder))
    mine = import_module("mine")
    for policy in ("mine:plain", mine.Plain, mine.plain):
        board = agents.compare([policy, "dpct"], ENV, range(2))
        assert list(board.results[0].action_configs.values()) == [{"control_mode": "jerk"}]
        with pytest.raises(ValueError, match="leave control_mode out"):
            agents.evaluate(policy, ENV, [0], env_config={"control_mode": "torque"})


@pytest.mark.parametrize(
    ("name", "complaint"),
    [
        ("mine:make_polcy", 'did you mean "make_policy"'),
        ("mine:number", "mine:number is 3: give an object with predict"),
        ("mine:nothing", r"<lambda> gave None, which has no predict"),
        ("mine:with_more", r"with_more\(env, gain\) is called with the environment or without arguments"),
        ("mein:make_policy", r"no module mein .* no mein\.py"),
        ("mine.inner:make_policy", "mine"),
        ("broken:make_policy", r"broken cannot be imported: ZeroDivisionError.*broken\.py:2"),
        ("needy:make_policy", "needy cannot be imported: .*no_such_library"),
        ("mine:flat", r"flat gave actions of shape \(2,\); expected \(3, 2\)"),
        ("mine:turned", r"turned gave actions of shape \(2, 3\); expected \(3, 2\)"),
        ("mine:nan", r"nan gave the action \[nan, nan\] in environment 0"),
        ("mine:words", "words gave actions of type <U4"),
        ("mine:Bare", r"predict of Bare gave ndarray; expected a pair: actions of shape \(3, 2\)"),
    ],
)
def test_what_is_wrong_is_said(folder: Path, name: str, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        agents.evaluate(name, ENV, range(3))


def test_shapes_are_checked_for_policies_in_memory_too() -> None:
    class Two:
        def predict(self, observation: Any, *args: Any, **kwargs: Any) -> tuple[Any, None]:
            return np.zeros(2), None

    with pytest.raises(ValueError, match=r"Two gave actions of shape \(2,\); expected \(3, 2\)"):
        agents.evaluate(Two(), ENV, range(3))


@pytest.mark.parametrize("command", ["benchmark", "evaluate", "rollout", "paths"])
def test_every_command_knows_it(folder: Path, command: str, capsys: pytest.CaptureFixture[str]) -> None:
    few = ["--episodes", "2"]
    arguments = {
        "benchmark": ["--policies", "mine:make_policy", "follower", "--tasks", ENV, "--bound-episodes", "0", *few],
        "evaluate": ["follower", "--env", ENV, "--against", "mine:make_policy", *few],
        "rollout": [ENV, "--policy", "mine:make_policy"],
        "paths": [ENV, "--policies", "mine:make_policy", "follower"],
    }
    assert main([command, *arguments[command]]) == 0
    out = capsys.readouterr().out
    assert "make_policy" in out
    if command == "benchmark":
        assert "make_policy - follower" in out
    if command == "evaluate":
        assert "follower - make_policy" in out


def test_two_policies_of_one_name_are_told_apart(folder: Path) -> None:
    (folder / "other.py").write_text(MODULE)
    board = agents.compare(["mine:make_policy", "other:make_policy", "follower"], ENV, [0])
    assert [each.policy for each in board.evaluations] == ["make_policy", "other:make_policy", "follower"]
    assert len(board.pairs) == 3
    sys.modules.pop("other")


def test_an_expert_made_for_other_settings_is_scored_under_them() -> None:
    made_for = {"control_mode": "jerk", "horizon": 2.0}
    expert = envs.make_expert("dpct", gym.make(ENV, **made_for))
    own = agents.evaluate(expert, ENV, range(4))
    assert own.returns.tolist() == agents.evaluate("dpct", ENV, range(4), env_config=made_for).returns.tolist()
    with pytest.raises(ValueError, match="leave control_mode out"):
        agents.evaluate(expert, ENV, range(4), env_config={"control_mode": "torque"})


def test_an_agent_is_scored_under_its_own_settings_wherever_it_is_named() -> None:
    agent = agents.load_agent(ENV)
    assert agents.evaluate(agent, ENV, range(8)).success.all()
    assert agents.evaluate("agent", ENV, range(8)).success.all()
    with pytest.raises(ValueError, match=r"trained with control_mode 'jerk'; the environment has 'torque'"):
        as_policy(agent, gym.make(ENV))
    with pytest.raises(ValueError, match=r"trained on ConveyorTrack-v0, not on ObstacleDodge-v0"):
        as_policy(agent, gym.make("ObstacleDodge-v0"))


def test_compare_and_leaderboard_give_tables_pairs_and_json(tmp_path: Path) -> None:
    board = agents.leaderboard(["dpct", "random"], [ENV], episodes=3, bound_episodes=2, seed=5)
    assert "over best known" in str(board)
    assert board.pairs == []  # two experts
    board.to_json(tmp_path / "board.json")
    (task,) = json.loads((tmp_path / "board.json").read_text())["results"]
    assert task["policies"][0]["episodes"]["seed"] == [5, 6, 7]
    both = agents.compare(["dpct", "random"], ENV, [5, 6, 7], options={"belt_speed": 0.15})
    (pair,) = both.pairs
    assert (pair.policy, pair.against) == ("dpct", "random")
    assert "dpct - random" in str(both)
    with pytest.raises(ValueError, match="give a list"):
        agents.compare([], ENV)
    with pytest.raises(ValueError, match="--options belt_speed"):
        agents.compare(["dpct"], ENV, env_config={"belt_speed": 0.2})


def test_behind_a_wrapper_that_transforms_what_they_read_or_give_experts_and_agents_refuse() -> None:
    single, batch = gym.make(ENV, control_mode="jerk"), gym.make_vec(ENV, num_envs=2, control_mode="jerk")
    normalized: Any = gym.wrappers.NormalizeObservation(gym.wrappers.RecordEpisodeStatistics(single))
    rescaled: Any = gym.wrappers.vector.RescaleAction(batch, np.float32(-5.0), np.float32(5.0))
    for env, complaint in (
        (normalized, "NormalizeObservation transforms them"),
        (rescaled, "a wrapper makes them"),
        (gym.wrappers.FrameStackObservation(single, 2), "FrameStackObservation transforms them"),
        (gym.wrappers.MaxAndSkipObservation(single), "MaxAndSkipObservation transforms them"),
        (gym.wrappers.StickyAction(single, 0.5), "StickyAction transforms them"),
        (gym.wrappers.vector.NormalizeObservation(batch), "NormalizeObservation transforms them"),
    ):
        with pytest.raises(ValueError, match=f"expert dpct .*{complaint}"):
            envs.make_expert("dpct", env)
        with pytest.raises(ValueError, match=f"an agent .*{complaint}"):
            as_policy(agents.load_agent(ENV), env)
    envs.make_expert("dpct", gym.wrappers.RecordEpisodeStatistics(single))


PLANNER = """
import planners


def plan(problem):
    return planners.dpct.plan(problem)


planners.register("borrowed", plan)
"""


def test_a_planner_that_the_module_registers_is_a_policy(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "my_planners.py").write_text(PLANNER)
    try:
        few = ["--tasks", ENV, "--episodes", "3", "--bound-episodes", "0"]
        assert main(["benchmark", "--policies", "my_planners:borrowed", "follower", *few]) == 0
        assert "borrowed - follower" in capsys.readouterr().out
        board = agents.compare(["my_planners:borrowed", "borrowed+adaptive"], ENV, range(3))
        assert [each.policy for each in board.evaluations] == ["borrowed", "borrowed+adaptive"]
        assert board.evaluations[0].success.all()
        assert main(["rollout", "MinTorqueMove-v0", "--policy", "my_planners:borrowed"]) == 0
    finally:
        sys.modules.pop("my_planners", None)
        VARIANTS.pop(("borrowed", ""), None)


@pytest.mark.docs
def test_the_page_is_followed(tmp_path: Path) -> None:
    printed = follow("extend/policy.md", tmp_path)
    assert "make_policy - dpct" in printed
    assert "strong - dpct" in printed
    assert json.loads((tmp_path / "comparison.json").read_text())["complete"] is True


MY_ARM = {
    "lengths_m": [0.42, 0.31],
    "masses_kg": [4.0, 2.5],
    "limits": {
        "torque_N_m": [60.0, 25.0],
        "velocity_rad_s": [4.0, 6.0],
        "acceleration_rad_s2": [30.0, 50.0],
        "jerk_rad_s3": [600.0, 900.0],
    },
}


def test_an_agent_says_at_once_that_it_was_trained_for_another_arm(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="trained for another arm: PLANAR_3R"):
        agents.evaluate("agent", "MinTorqueMove-v0", [0], env_config={"arm": MY_ARM})
    settings, belt = {"control_mode": "jerk", "arm": MY_ARM}, agents.load_agent(ENV)
    document = {**belt.document, **describe_layout(layout_of(ENV, settings)), "env_config": settings}
    agents.save_agent(agents.Agent(document, belt.tensors), tmp_path / "mine.safetensors")
    own = agents.load_agent(tmp_path / "mine.safetensors")
    assert agents.evaluate(own, ENV, [0]).metrics["peak_torque"] > 0.0  # in the arm that it carries
    with pytest.raises(ValueError, match=r"another arm: arm \(links of 0\.42, 0\.31 m .* has SCARA_1M"):
        agents.evaluate(own, ENV, [0], env_config={})


def test_a_planner_of_joint_motions_acts_where_it_can_and_is_named_where_it_cannot() -> None:
    planners.register("of_joints", lambda problem: planners.quintic.plan(problem))
    try:
        assert agents.evaluate("of_joints", "ExcavatorPayload-v0", range(1)).lengths[0] > 100
        for env_id in ("ConveyorTrack-v0", "ObstacleDodge-v0"):
            with pytest.raises(
                ValueError, match=f"the planner of_joints cannot act in {env_id}: quintic goes to a target"
            ):
                agents.evaluate("of_joints", env_id, range(1))
    finally:
        VARIANTS.pop(("of_joints", ""))


def test_an_agent_of_one_disc_says_so_among_two() -> None:
    with pytest.raises(ValueError, match=r"observes 36 numbers.* it was trained with num_obstacles 1 \(here 2\)"):
        agents.evaluate("agent", "ObstacleDodge-v0", range(2), env_config={"num_obstacles": 2})


def test_results_say_how_commands_find_own_tasks_and_policies(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(folder))
    (task,) = agents.compare(["mine:plain", "dpct", import_module("mine").Plain()], ENV, range(2)).document()["results"]
    assert task["env_name"] == ENV
    assert [each["source"] for each in task["policies"]] == ["mine:plain", "dpct", ""]
    assert import_env(f"mine:{ENV}") == ENV
    assert full_name(ENV) == f"mine:{ENV}"
    environments._OWN.clear()


def test_seeds_may_come_from_an_iterator() -> None:
    found = agents.compare(["follower", "random"], ENV, iter(range(3)))
    assert "3 episodes" in str(found)
