"""Environments with an arm of the user's own: what they bear, what follows from it, and what they refuse."""

from __future__ import annotations

import json
import math
import pickle
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import agents
import envs
import planners
from envs import user_cache
from envs.conveyor_track import starts, table
from envs.conveyor_track.belt import Start, problem_of
from planners import Arm, JointLimits, dpct
from tests.pages import follow

INDUSTRIAL = Arm(
    "industrial",
    (0.42, 0.31),
    (6.0, 3.0),
    JointLimits(torque=(60, 25), velocity=(6, 8), acceleration=(30, 40), angle=(2.3, 2.5)),
    link_radius=0.04,
)
ONE_SIDED = Arm(
    "one-sided",
    (0.35, 0.3),
    (4.0, 2.0),
    JointLimits(torque=(40, 15), velocity=(5, 6), acceleration=(20, 30), angle=((-3.0, 0.6), (-2.2, 2.7))),
    base=(0.5, 1.0),
    link_radius=0.03,
)
THREE = Arm(
    "three",
    (0.3, 0.25, 0.12),
    (3.0, 2.0, 1.0),
    JointLimits(torque=(40, 20, 8), velocity=(4, 4, 6), acceleration=(20, 20, 30)),
)
TINY = Arm(
    "tiny",
    (0.06, 0.05),
    (0.05, 0.03),
    JointLimits(torque=(0.02, 0.008), velocity=(8, 10), acceleration=(60, 90), angle=2.6),
    link_radius=0.004,
)
SLOW = Arm(
    "slow",
    (0.5, 0.4),
    (4.0, 3.0),
    JointLimits(torque=(8, 3), velocity=(0.5, 0.7), acceleration=(1.5, 2.5), jerk=(10, 15), angle=2.6),
    link_radius=0.04,
)


@pytest.fixture(autouse=True)
def coarse_tables(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Coarser grids of starts, solved in a few seconds, in a cache of these tests."""
    monkeypatch.setenv("PLANARM_CACHE", str(tmp_path_factory.getbasetemp() / "planarm"))
    monkeypatch.setattr(table, "NODES", (3, 3, 2, 3))
    starts.distribution_of.cache_clear()
    yield
    starts.distribution_of.cache_clear()


def task_of(env: gym.Env[Any, Any] | gym.vector.VectorEnv[Any, Any, Any]) -> Any:
    return env.unwrapped.task  # type: ignore[attr-defined]


def score(expert: str, env_id: str, arm: Any, **settings: Any) -> Any:
    return agents.evaluate(expert, env_id, range(12), env_config={"arm": arm, **settings})


@pytest.mark.docs
def test_the_page_works_from_a_folder_of_ones_own(tmp_path: Path) -> None:
    reached = dict(re.findall(r"^(dpct|lagrange|apf) (\d+)$", follow("extend/arm.md", tmp_path), flags=re.MULTILINE))
    assert reached.keys() == {"dpct", "lagrange", "apf"}
    assert all(int(count) >= 7 for count in reached.values())


@pytest.mark.parametrize(
    ("expert", "arm"),
    [("dpct", INDUSTRIAL), ("lagrange", INDUSTRIAL), ("apf", INDUSTRIAL), ("dpct", THREE), ("follower", THREE)]
    + [("apf", one) for one in (THREE, ONE_SIDED, TINY, SLOW)],
    ids=lambda value: getattr(value, "name", value),
)
def test_experts_settle_on_the_belts_of_other_arms(expert: str, arm: Arm) -> None:
    result = score(expert, "ConveyorTrack-v0", arm)
    assert result.success.sum() >= 11
    if expert != "follower":
        assert result.metrics["limit_ratio"].max() <= 1.02


@pytest.mark.parametrize("arm", [ONE_SIDED, SLOW, TINY], ids=lambda arm: arm.name)
def test_a_field_dodges_with_other_arms(arm: Arm) -> None:
    result = score("apf", "ObstacleDodge-v0", arm)
    assert result.success.sum() >= 7
    assert result.metrics["limit_ratio"].max() <= 1.005


@pytest.mark.parametrize("links", [1, 2, 6])
@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_experts_move_arms_with_any_number_of_links(links: int, gravity: float) -> None:
    torque = 8.0 * np.arange(links, 0, -1) ** 2
    limits = JointLimits(torque=torque, velocity=10.0, acceleration=200.0, jerk=1e3, angle=2.5)
    arm = Arm("chain", np.full(links, 0.2), 1.0, limits)
    for expert in ("follower", "apf", "dpct"):
        result = score(expert, "MinTorqueMove-v0", arm, gravity=gravity)
        assert result.success.all(), expert
        assert result.metrics["limit_ratio"].max() <= 1.02, expert


def test_a_whole_motion_is_an_action_for_any_number_of_links() -> None:
    env = gym.make("MinTorqueMove-v0", arm=INDUSTRIAL, control_mode="motion")
    assert env.action_space.shape == (28,)
    env.reset(seed=0)
    over = False
    while not over:
        over, info = (lambda step: (step[2], step[4]))(env.step(np.zeros(28, dtype=np.float32)))
    assert info["is_success"]
    assert info["quintic_ratio"] == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("env_id", ["ConveyorTrack-v0", "MinTorqueMove-v0", "ObstacleDodge-v0"])
def test_the_tasks_own_arm_by_name_is_the_default_to_the_bit(env_id: str) -> None:
    default = gym.make_vec(env_id, num_envs=3)
    named = gym.make_vec(env_id, num_envs=3, arm=task_of(default).arm.name)
    assert task_of(default).arm == task_of(named).arm
    assert task_of(default).view == task_of(named).view
    assert default.single_observation_space == named.single_observation_space
    seen = [
        [env.reset(seed=0)[0], *(env.step(env.action_space.low / 3.0)[0] for _ in range(5))] for env in (default, named)
    ]
    np.testing.assert_array_equal(*seen)


@pytest.mark.parametrize("env_id", ["ConveyorTrack-v0", "MinTorqueMove-v0", "ObstacleDodge-v0"])
def test_single_and_vector_agree_and_pictures_show_the_arm(env_id: str) -> None:
    single = gym.make(env_id, arm=ONE_SIDED, render_mode="rgb_array")
    vector = gym.make_vec(env_id, num_envs=2, arm=planners.arm_document(ONE_SIDED))
    observation, _ = single.reset(seed=4)
    np.testing.assert_array_equal(vector.reset(seed=4)[0][0], observation)
    assert single.observation_space.contains(observation)
    task = task_of(single)
    left, right, bottom, top = task.view
    for x, y in task.scene(0, []).joints:
        assert left <= x <= right
        assert bottom <= y <= top
    assert np.ptp(np.asarray(single.render())) > 100


@pytest.mark.parametrize("form", ["preset", "arm", "mapping", "path"])
def test_the_setting_takes_every_form_and_is_a_document_in_json(form: str, tmp_path: Path) -> None:
    document = planners.arm_document(INDUSTRIAL)
    (tmp_path / "arm.json").write_text(json.dumps(document))
    given: Any = {"preset": "crs_a255", "arm": INDUSTRIAL, "mapping": document, "path": tmp_path / "arm.json"}[form]
    env = gym.make("MinTorqueMove-v0", arm=given)
    config = json.loads(json.dumps(task_of(env).config.model_dump(mode="json", exclude_defaults=True)))
    assert task_of(gym.make("MinTorqueMove-v0", **config)).arm == task_of(env).arm
    assert task_of(pickle.loads(pickle.dumps(env.unwrapped)).unwrapped).arm == task_of(env).arm


THICK = Arm("thick", (0.2, 0.2), 1.0, INDUSTRIAL.limits, link_radius=0.1)
BOUNDLESS = Arm("boundless", (0.4, 0.3), 1.0)
STIFF = Arm("stiff", (0.4, 0.3), 1.0, JointLimits(torque=9, velocity=3, acceleration=9, angle=(2.0, 0.2)))
WEAK = Arm("weak", (1.0, 1.0), 5.0, JointLimits(torque=1, velocity=1, acceleration=1), gravity=9.81)


@pytest.mark.parametrize(
    ("env_id", "arm", "reason"),
    [
        ("ConveyorTrack-v0", Arm("four", [0.2] * 4, 1.0), "arms with 2 or 3 links; four has 4"),
        ("ConveyorTrack-v0", BOUNDLESS, "scales actions by the torque limits, but boundless has"),
        ("ConveyorTrack-v0", WEAK, "no start is known .* with weak"),
        ("MinTorqueMove-v0", Arm("seven", [0.2] * 7, 1.0), "arms with 1 to 6 links; seven has 7"),
        ("MinTorqueMove-v0", BOUNDLESS, "MinTorqueMove-v0 needs torque limits of every joint; boundless has"),
        ("MinTorqueMove-v0", WEAK, "weak can hold its own weight"),
        ("ObstacleDodge-v0", THREE, "arms with 2 links; three has 3"),
        ("ObstacleDodge-v0", BOUNDLESS, "ObstacleDodge-v0 needs torque limits of every joint"),
        ("ObstacleDodge-v0", THICK, "the links of thick have a radius of 0.1 m"),
        ("ObstacleDodge-v0", STIFF, "hardly any posture of stiff"),
        ("ObstacleDodge-v0", "SCARA_1M", "SCARA_1M turns 12 times more slowly"),
        ("ExcavatorPayload-v0", INDUSTRIAL, "keeps its own machine; leave out arm and gravity"),
        ("ConveyorTrack-v0", "SCARA_2M", "SCARA_2M"),
        ("ConveyorTrack-v0", 3, "arm"),
    ],
    ids=lambda value: getattr(value, "name", str(value)),
)
def test_an_arm_that_a_task_cannot_bear_is_refused_with_the_reason(env_id: str, arm: Any, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        gym.make(env_id, arm=arm).reset(seed=0)


@pytest.mark.parametrize("env_id", ["MinTorqueMove-v0", "ObstacleDodge-v0"])
def test_point_masses_move_by_exact_equations_and_are_no_bodies_of_pymunk(env_id: str) -> None:
    """Pymunk would divide by their inertia, and every angle would be NaN."""
    limits = JointLimits(torque=[30.0, 15.0], velocity=[3.0, 3.0], acceleration=[9.0, 9.0])
    points = Arm("points", [0.5, 0.5], [2.0, 1.5], limits, coms=[0.5, 0.5], inertias=[0.0, 0.0])
    with pytest.raises(ValueError, match=r"link 0 of points has an inertia of 0 kg m\^2 .*Pymunk needs 5e-13 kg m\^2"):
        gym.make(env_id, arm=points)
    slender = Arm("slender", [0.5, 0.5], [2.0, 1.5], limits, coms=[0.5, 0.5], inertias=[1e-12, 1e-12])
    states = []
    for arm, physics in ((points, "closed_form"), (slender, "pymunk")):
        env = gym.make(env_id, arm=arm, physics=physics)
        env.reset(seed=0)
        for _ in range(10):
            env.step(np.full(2, 0.1, dtype=np.float32))
        states.append(np.concatenate(env.unwrapped.joint_state()))  # type: ignore[attr-defined]
    np.testing.assert_allclose(*states, atol=0.01)


def test_gravity_is_a_setting_of_every_task_with_an_arm() -> None:
    for env_id in ("ConveyorTrack-v0", "MinTorqueMove-v0", "ObstacleDodge-v0"):
        env = gym.make(env_id, arm=INDUSTRIAL, gravity=3.0)
        assert task_of(env).arm.gravity == 3.0
        assert task_of(gym.make(env_id, arm=INDUSTRIAL)).arm.gravity == 0.0
    with pytest.raises(ValueError, match="leave out arm and gravity"):
        gym.make("ExcavatorPayload-v0", gravity=1.0)


def test_every_drawn_start_of_another_arm_can_be_solved() -> None:
    task = task_of(gym.make_vec("ConveyorTrack-v0", num_envs=1, arm=INDUSTRIAL))
    for start in task.draw([np.random.default_rng(seed) for seed in range(25)], task.options_type()):
        plan = dpct.plan(problem_of(start, task._demands))
        assert plan.limit_ratio <= 1.0 + 1e-9
        assert plan.rendezvous_time <= 2.5
        assert plan.rides_until >= 3.0


class TestTables:
    """The tables of starts that are solved once."""

    def test_a_table_is_solved_once_and_depends_on_nothing_but_the_settings(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
    ) -> None:
        monkeypatch.setenv("PLANARM_CACHE", str(tmp_path))
        first = gym.make("ConveyorTrack-v0", arm=INDUSTRIAL)
        observation, _ = first.reset(seed=1)
        assert "solving the starts of ConveyorTrack-v0 for industrial (once)" in capfd.readouterr().err
        (file,) = tmp_path.iterdir()
        kept = file.read_bytes()
        starts.distribution_of.cache_clear()
        with monkeypatch.context() as patch:
            patch.setattr(dpct, "plan", None)  # nothing is planned any more
            np.testing.assert_array_equal(gym.make("ConveyorTrack-v0", arm=INDUSTRIAL).reset(seed=1)[0], observation)
        for damaged in (b"", kept[: len(kept) // 2], b"no archive"):
            file.write_bytes(damaged)
            assert user_cache.load_arrays(file.name) is None
        starts.distribution_of.cache_clear()
        np.testing.assert_array_equal(first.reset(seed=1)[0], observation)
        assert user_cache.load_arrays(file.name) is not None

    def test_a_folder_that_cannot_be_written_costs_one_warning(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        (tmp_path / "file").write_text("")
        monkeypatch.setenv("PLANARM_CACHE", str(tmp_path / "file"))
        with pytest.warns(RuntimeWarning, match="cannot be written.*PLANARM_CACHE"):
            folder = user_cache.cache_folder()
        user_cache.store_arrays("some.npz", {"a": np.arange(3.0)})
        np.testing.assert_array_equal(user_cache.load_arrays("some.npz")["a"], np.arange(3.0))  # type: ignore[index]
        assert folder == user_cache.cache_folder()

    @pytest.mark.parametrize(
        ("own", "shared", "wanted"),
        [("mine", "shared", "mine"), (None, "shared", "shared/planarm"), (None, None, "home/.cache/planarm")],
    )
    def test_the_folder_is_the_users(
        self, own: str | None, shared: str | None, wanted: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        for name, value in {"PLANARM_CACHE": own, "XDG_CACHE_HOME": shared, "HOME": "home"}.items():
            monkeypatch.delenv(name, raising=False)
            if value is not None:
                monkeypatch.setenv(name, str(tmp_path / value))
        assert user_cache.cache_folder() == tmp_path / wanted


GIVEN = {"belt_speed": 0.06, "offset": 0.05, "line_height": 1.6, "hand_x": -0.5, "elbow": "+"}


def test_starts_that_are_given_need_no_table(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table, "solve", None)
    for settings in ({"horizon": 8.0}, {"horizon": 3.0, "belt_acceleration": 0.01}, {"payload": 0.5, "horizon": 5.0}):
        env = gym.make("ConveyorTrack-v0", **settings)
        seen = task_of(env).layout.parse(env.reset(seed=0, options=GIVEN)[0])
        assert seen["part_velocity"][0] == pytest.approx(0.06)
    with pytest.raises(ValueError, match="late"):
        gym.make("ConveyorTrack-v0", horizon=8.0).reset(seed=0, options={**GIVEN, "belt_speed": 0.24})


@pytest.mark.parametrize("settings", [{"horizon": 8.0}, {"payload": 3.0}], ids=str)
def test_other_horizons_and_heavy_payloads_have_starts_of_their_own(settings: dict[str, float]) -> None:
    vector = gym.make_vec("ConveyorTrack-v0", num_envs=40, **settings)
    seen = task_of(vector).layout.parse(vector.reset(seed=0)[0])
    assert np.ptp(seen["part_velocity"][:, 0]) > 0.01
    demands = task_of(vector)._demands
    speed, height = seen["part_velocity"][0, 0], seen["hand"][0, 1]
    offset = seen["hand"][0, 0] - seen["part"][0, 0]
    start = Start(speed, offset, height, seen["hand"][0, 0], math.copysign(1.0, seen["joint_position"][0, 1]))
    plan = dpct.plan(problem_of(start, demands))
    assert plan.rides_until >= demands.horizon
    assert plan.rendezvous_time <= demands.horizon - demands.hold_time


def test_an_unknown_arm_names_the_nearest() -> None:
    with pytest.raises(ValueError, match="SCARA_50CM"):
        envs.make_expert("dpct", gym.make("ConveyorTrack-v0", arm="SCARA_50cm"))
