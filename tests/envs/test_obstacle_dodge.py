"""ObstacleDodge-v0 through the public door."""

from __future__ import annotations

from functools import cache
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import agents
import envs
from envs.obstacle_dodge.paths import PATH_STEP
from planners import SCARA_50CM, FixedHand

ENV = "ObstacleDodge-v0"
FAR_AWAY = (((-1.2, 0.0),),)


def run(env: gym.Env[Any, Any], action: Any = (0.0, 0.0)) -> tuple[float, int, bool, bool, dict[str, Any]]:
    """The same action to the end: return, length, terminated, truncated, last info."""
    total, steps = 0.0, 0
    while True:
        _, reward, terminated, truncated, info = env.step(np.asarray(action, dtype=np.float32))
        total, steps = total + float(reward), steps + 1
        if terminated or truncated:
            return total, steps, terminated, truncated, info


def env_of(env: gym.Env[Any, Any]) -> Any:
    return env.unwrapped.task.batch[0]  # type: ignore[attr-defined]


def test_a_disc_that_runs_into_an_arm_at_rest_ends_the_episode() -> None:
    env = gym.make(ENV)
    env.reset(options={"start": (0.0, 0.5), "obstacle_paths": (((0.3, 1.0), (0.3, -1.0)),), "obstacle_speed": 0.5})
    total, steps, terminated, truncated, info = run(env)
    # the disc's centre starts 1 m above the upper arm, which lies along x; surfaces meet after 0.855 m
    assert steps == np.ceil(0.855 / 0.5 / 0.02)
    assert (terminated, truncated, info["collision"], info["is_success"]) == (True, False, True, False)
    assert -0.5 * 0.02 <= info["min_clearance"] < 0.0
    assert info["time_to_goal"] == np.inf
    assert info["reward_collision"] == -2.0
    assert total < -2.0


def test_no_disc_slips_between_two_control_instants() -> None:
    env = gym.make(ENV, control_period=0.1)
    path = (((0.3, 1.15), (0.3, -1.2)),)
    env.reset(options={"start": (0.0, 0.5), "goal": (0.2, -0.6), "obstacle_paths": path, "obstacle_speed": 5.0})
    clear = []
    while True:
        _, _, terminated, _, info = env.step(np.zeros(2, dtype=np.float32))
        clear.append(float(env_of(env)["clearance"]))
        if terminated:
            break
    assert info["collision"]
    assert min(clear) > 0.0  # at each instant of control the disc was above or below the arm
    assert len(clear) == 3


def test_holding_the_goal_is_a_success() -> None:
    hand = SCARA_50CM.forward_kinematics([0.3, 1.0])
    env = gym.make(ENV)
    env.reset(options={"start": (0.3, 1.0), "goal": tuple(hand), "obstacle_paths": FAR_AWAY})
    total, steps, terminated, truncated, info = run(env)
    assert (steps, terminated, truncated) == (25, True, False)
    assert (info["is_success"], info["collision"], info["time_to_goal"]) == (True, False, 0.02)
    assert total == pytest.approx(1.0 + 1.0 - 25 / 400, abs=1e-9)


def test_the_time_limit_truncates() -> None:
    env = gym.make(ENV, horizon=1.0)
    env.reset(options={"start": (0.3, 1.0), "goal": (0.0, -0.7), "obstacle_paths": FAR_AWAY})
    _, steps, terminated, truncated, info = run(env)
    assert (steps, terminated, truncated, info["is_success"]) == (50, False, True, False)
    assert info["goal_distance"] == pytest.approx(np.hypot(*(SCARA_50CM.forward_kinematics([0.3, 1.0]) - [0.0, -0.7])))


def test_the_path_of_the_disc_is_fixed_at_reset() -> None:
    """Whatever the arm does, and however often it is asked."""
    shown = []
    for action, period in (((0.0, 0.0), 0.02), ((0.3, -0.2), 0.02), ((0.0, 0.0), 0.01)):
        env = gym.make(ENV, control_period=period)
        env.reset(seed=7)
        path = env.unwrapped.task.obstacle_path(0)  # type: ignore[attr-defined]
        seen = {}
        for step in range(1, 21):
            env.step(np.asarray(action, dtype=np.float32))
            seen[round(step * period / PATH_STEP)] = env_of(env)["discs"][0].copy()
        for sample, disc in seen.items():
            np.testing.assert_allclose(disc, path[sample, 0], atol=1e-12)
        shown.append(path)
    np.testing.assert_array_equal(shown[0], shown[1])
    np.testing.assert_array_equal(shown[0], shown[2])


def test_the_observed_velocity_is_of_the_past() -> None:
    """A camera cannot tell the next move of a disc: the velocity is the difference from the position before."""
    env = gym.make(ENV)
    env.reset(seed=3)
    path = env.unwrapped.task.obstacle_path(0)[:, 0]  # type: ignore[attr-defined]
    layout = env.unwrapped.task.layout  # type: ignore[attr-defined]
    for step in range(1, 10):
        observation, *_ = env.step(np.zeros(2, dtype=np.float32))
        sample = 2 * step
        wanted = (path[sample] - path[sample - 1]) / PATH_STEP
        np.testing.assert_allclose(layout.parse(observation)["obstacle_velocity"], wanted, atol=1e-6)


def test_what_is_seen_from_the_links() -> None:
    """Against the arm's own kinematics, after some motion."""
    env = gym.make(ENV, num_obstacles=2)
    env.reset(seed=5)
    task = env.unwrapped.task  # type: ignore[attr-defined]
    velocities = []
    for _ in range(12):
        observation, *_ = env.step(np.array([0.4, -0.3], dtype=np.float32))
        seen = task.layout.parse(observation)
        velocities.append(seen["obstacle_velocity"].reshape(2, 2))
    q, goal = seen["joint_position"], seen["goal"]
    branches = task.arm.inverse_kinematics(goal + task.arm.base_array)
    np.testing.assert_allclose(seen["posture_error"].reshape(2, 2) + q, branches, atol=1e-5)
    turn = (velocities[-1] - velocities[-2]) / 0.02
    joints = task.arm.joint_positions(q)
    for disc, position in enumerate(seen["obstacle"].reshape(2, 2) + task.arm.base_array):
        for link, angle in enumerate(np.cumsum(q)):
            frame = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
            near = {
                name: seen[name].reshape(2, 2, 2)[disc, link]
                for name in ("obstacle_in_link", "obstacle_velocity_in_link")
            }
            np.testing.assert_allclose(near["obstacle_in_link"], frame @ (position - joints[link]), atol=1e-5)
            np.testing.assert_allclose(near["obstacle_velocity_in_link"], frame @ velocities[-1][disc], atol=1e-5)
            if link == 0:
                np.testing.assert_allclose(
                    seen["obstacle_acceleration"].reshape(2, 2)[disc], frame @ turn[disc], atol=1e-3
                )
    assert seen["link_clearance"].min() == pytest.approx(seen["clearance"][0], abs=1e-6)


def test_the_least_clearance_is_that_of_the_whole_arm() -> None:
    env = gym.make(ENV, physics_step=0.0025)
    env.reset(options={"start": (0.0, 0.5), "obstacle_paths": (((0.3, 1.0), (0.3, 0.3)),), "goal": (0.2, -0.6)})
    *_, info = run(env)
    assert info["min_clearance"] == pytest.approx(0.3 - 0.1 - 0.045, abs=1e-9)


def test_what_starts_an_episode_obeys_the_rules() -> None:
    batch: Any = gym.make_vec(ENV, num_envs=300)
    batch.reset(seed=1000)
    records, ranges = batch.unwrapped.task.batch, np.array(SCARA_50CM.limits.angle)
    q, hands = records["q"], SCARA_50CM.forward_kinematics(records["q"])
    assert (np.abs(q) <= ranges).all()
    assert (np.abs(q[:, 1]) >= 0.3).all()
    assert np.hypot(*(hands - records["goal"]).T).min() >= 0.4
    assert records["clearance"].min() >= 0.3
    branches = SCARA_50CM.inverse_kinematics(records["goal"])
    same_side = np.where(q[:, 1] > 0.0, 0, 1)
    assert (np.abs(branches[np.arange(300), same_side]) <= ranges + 1e-9).all()
    assert np.ptp(records["radii"]) == 0.0


@pytest.mark.parametrize("discs", [2, 4])
def test_several_discs(discs: int) -> None:
    env = gym.make(ENV, num_obstacles=discs)
    check_env(env.unwrapped, skip_render_check=True)
    env.reset(seed=0)
    problem = env.unwrapped.motion_problem()  # type: ignore[attr-defined]
    assert len(problem.obstacles) == discs
    gaps = [SCARA_50CM.clearance(problem.q, one.position, one.radius) for one in problem.obstacles]
    assert env_of(env)["clearance"] == pytest.approx(min(gaps), abs=1e-6)
    assert len({tuple(one.position) for one in problem.obstacles}) == discs


def test_the_problem_states_what_is_observed() -> None:
    env = gym.make(ENV)
    env.reset(seed=4)
    problem = env.unwrapped.motion_problem()  # type: ignore[attr-defined]
    record = env_of(env)
    assert isinstance(problem.target, FixedHand)
    np.testing.assert_allclose(problem.target.position, record["goal"], atol=1e-6)
    np.testing.assert_allclose(problem.obstacles[0].velocity, record["disc_velocities"][0], atol=1e-6)
    assert problem.obstacles[0].radius == pytest.approx(0.1)
    assert problem.horizon == pytest.approx(8.0)
    assert problem.joint_limits.acceleration == (4.5, 8.0)
    assert problem.joint_limits.torque == SCARA_50CM.limits.torque


def test_a_straight_move_fails_in_about_half_of_the_episodes() -> None:
    evaluation = agents.evaluate("follower", ENV, range(20_000, 20_300))
    assert 0.44 < evaluation.success.mean() < 0.64
    assert (evaluation.metrics["collision"].astype(bool) | evaluation.success).mean() > 0.98
    assert (evaluation.metrics["limit_ratio"] < 1.005).mean() > 0.99  # torque is not looked at: it may saturate


def test_of_two_episodes_without_collision_the_one_that_arrives_has_the_higher_return() -> None:
    evaluation = agents.evaluate("follower", ENV, range(30_000, 30_100))
    collided = evaluation.metrics["collision"].astype(bool)
    assert evaluation.returns[evaluation.success].min() > evaluation.returns[collided].max() + 1.0


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"goal": (2.0, 0.0)}, "is 2 m from the base; links of 0.5 m and 0.5 m reach from 0 m to 1 m"),
        ({"start": (3.0, 0.5)}, "leaves the joint ranges"),
        ({"start": (0.0, 0.5), "obstacle_paths": (((0.4, 0.0),),)}, "touches the arm at the start"),
        ({"obstacle_paths": (((1.0, 1.0),), ((-1.0, 1.0),))}, "holds 2 paths for 1 discs"),
        ({"obstacle_paths": ((),)}, "should have at least 1 item"),
        ({"obstacle_kind": "zigzag"}, "obstacle_kind = 'zigzag'"),
        ({"obstacle_speed": -1.0}, "obstacle_speed = -1.0"),
    ],
)
def test_an_episode_that_cannot_be_is_refused_and_changes_nothing(options: dict[str, Any], complaint: str) -> None:
    env = gym.make(ENV)
    env.reset(seed=0)
    before = env_of(env)["observation"].copy()
    with pytest.raises(ValueError, match=complaint):
        env.reset(options=options)
    np.testing.assert_array_equal(env_of(env)["observation"], before)


def test_an_episode_too_short_to_hold_the_goal_is_refused() -> None:
    with pytest.raises(ValueError, match=r"hold_time 0\.5 s is longer than the horizon 0\.4 s"):
        gym.make(ENV, horizon=0.4)


def test_the_papers_scenario_crosses_the_straight_way() -> None:
    env = gym.make(ENV)
    observations = [env.reset(seed=seed, options={"scenario": "paper"})[0] for seed in (0, 1)]
    np.testing.assert_array_equal(*observations)
    evaluation = agents.evaluate("follower", ENV, [0], options={"scenario": "paper"})
    assert evaluation.metrics["collision"][0]


@cache
def thirty_episodes(name: str) -> agents.Evaluation:
    """On seeds that are neither the leaderboard's nor those of the tuning."""
    return agents.evaluate(name, ENV, range(310_000, 310_030))


def test_the_field_dodges() -> None:
    field = agents.evaluate("apf", ENV, range(300_000, 300_400))
    assert field.success.mean() >= 0.92
    assert field.metrics["collision"].mean() <= 0.05


@pytest.mark.parametrize("name", ["dpct", "lagrange"])
def test_the_planners_beat_a_straight_move(name: str) -> None:
    assert thirty_episodes(name).success.mean() >= thirty_episodes("follower").success.mean() + 0.2


@pytest.mark.parametrize("name", ["apf", "dpct", "lagrange"])
def test_the_experts_keep_the_limits_while_they_dodge(name: str) -> None:
    ratio = thirty_episodes(name).metrics["limit_ratio"]
    assert ratio.max() <= 1.02
    assert (ratio <= 1.005).mean() >= 0.95


@pytest.mark.parametrize("expert", ["apf", "dpct"])
def test_an_observation_with_room_for_four_discs_leads_an_expert_to_the_same_actions(expert: str) -> None:
    own, roomy = (gym.make(ENV, num_obstacles=2, observed_discs=room) for room in (None, 4))
    experts = [envs.make_expert(expert, env) for env in (own, roomy)]
    seen = [env.reset(seed=3)[0] for env in (own, roomy)]
    assert seen[1].size == gym.make(ENV, observed_discs=4).observation_space.shape[0]  # type: ignore[index]
    for _ in range(20):
        few, many = (env.unwrapped.task.layout.parse(o) for env, o in zip((own, roomy), seen, strict=True))
        for name, value in few.items():
            size = value.size
            np.testing.assert_array_equal(many[name][:size], value)
            assert not many[name][size:].any()
        actions = [policy.predict(o)[0] for policy, o in zip(experts, seen, strict=True)]
        np.testing.assert_array_equal(*actions)
        seen = [env.step(action)[0] for env, action in zip((own, roomy), actions, strict=True)]


def test_room_for_fewer_discs_than_there_are_is_refused() -> None:
    with pytest.raises(ValueError, match=r"observed_discs.*fewer than num_obstacles, which is 3"):
        gym.make(ENV, num_obstacles=3, observed_discs=2)


@pytest.mark.parametrize(("discs", "share"), [(2, 0.8), (3, 0.66)])
def test_several_discs_are_dodged(discs: int, share: float) -> None:
    evaluation = agents.evaluate("apf", ENV, range(320_000, 320_100), env_config={"num_obstacles": discs})
    assert evaluation.success.mean() >= share
    assert evaluation.metrics["limit_ratio"].max() <= 1.02
