"""The second arm of ObstacleDodge-v0, through the public door."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import envs
from envs.obstacle_dodge.paths import PATH_STEP, SPAWN_CLEARANCE
from envs.obstacle_dodge.second_arm import PER_LINK, TURN_CLEARANCE, cover_radii
from planners import SCARA_50CM
from planners.typing import Array

ENV = "ObstacleDodge-v0"
EITHER = pytest.mark.parametrize("physics", ["pymunk", "closed_form"])
SHARES = np.linspace(0.0, 1.0, 61)[:, None]


def made(num_envs: int = 0, **settings: Any) -> Any:
    settings = {"second_arm": True, "num_obstacles": 0, **settings}
    return gym.make_vec(ENV, num_envs=num_envs, **settings) if num_envs else gym.make(ENV, **settings)


def samples(joints: Array) -> Array:
    """Points along the links between joints, ``(3, 2)``."""
    return np.concatenate([first + SHARES * (second - first) for first, second in pairwise(joints)])


def gap(task: Any, record: Any) -> float:
    """Distance between the surfaces of both arms, m, from points along their links: too large by 2 mm at most."""
    own, other = samples(task.arm.joint_positions(record["q"])), samples(task.second_arm(record))
    distances = np.hypot(*np.moveaxis(own[:, None] - other[None], -1, 0))
    return float(distances.min()) - 2.0 * task.arm.link_radius


def motion(env: Any) -> tuple[Array, Array]:
    """Angles of the second arm's links, ``(samples, 2)``, rad, and its link lengths, over the whole episode."""
    task = env.unwrapped.task
    path = task.obstacle_path(0)[:, task.config.num_obstacles :]
    base = np.broadcast_to(task.batch[0]["second_base"], (len(path), 2))
    joints = np.stack([base, path[:, PER_LINK - 1], path[:, -1]], axis=1)
    links = np.diff(joints, axis=1)
    return np.unwrap(np.arctan2(links[..., 1], links[..., 0]), axis=0), np.hypot(links[..., 0], links[..., 1])


@EITHER
def test_the_clearance_is_that_of_both_arms(physics: str) -> None:
    env = made(4, physics=physics)
    env.reset(seed=2)
    task, moved = env.unwrapped.task, []
    for k in range(12):
        observation, *_ = env.step(np.full((4, 2), 0.3 * (-1.0) ** (k // 5), np.float32))
        wanted = np.array([gap(task, record) for record in task.batch])
        np.testing.assert_allclose(task.batch["clearance"], wanted, rtol=0.0, atol=2e-3)
        np.testing.assert_allclose(
            task.layout.parse(observation)["clearance"][:, 0], task.batch["clearance"], atol=1e-6
        )
        moved.append(wanted)
    assert np.ptp(moved, axis=0).min() > 1e-3


@EITHER
def test_an_arm_that_runs_into_an_arm_at_rest_ends_the_episode(physics: str) -> None:
    env = made(physics=physics)
    task, ended = env.unwrapped.task, 0
    for seed in range(6):
        env.reset(seed=seed)
        terminated = truncated = False
        while not (terminated or truncated):
            _, _, terminated, truncated, info = env.step(np.zeros(2, np.float32))
            apart = gap(task, task.batch[0])
            assert terminated or apart > -1e-9
        ended += terminated
        if terminated:
            assert info["collision"]
            assert info["reward_collision"] == -2.0
            assert -0.05 < info["min_clearance"] < 0.0
    assert ended > 0


def test_both_physics_play_the_same_motion_of_the_second_arm() -> None:
    exact, pymunk = made(physics="closed_form"), made()
    for env in (exact, pymunk):
        env.reset(seed=5)
    for k in range(15):
        action = np.array([0.2, -0.2 * (k % 2)], np.float32)
        one, two = exact.step(action)[0], pymunk.step(action)[0]
    np.testing.assert_array_equal(exact.unwrapped.task.batch["discs"], pymunk.unwrapped.task.batch["discs"])
    np.testing.assert_allclose(one, two, atol=0.05)


def test_a_batch_equals_single_environments_and_states_continue_to_the_bit() -> None:
    batch, singles = made(3, num_obstacles=1), [made(num_obstacles=1) for _ in range(3)]
    together, _ = batch.reset(seed=[4, 5, 6])
    alone = [env.reset(seed=4 + k)[0] for k, env in enumerate(singles)]
    np.testing.assert_array_equal(together, alone)
    state, twin = None, made(3, num_obstacles=1)
    for k in range(12):
        action = np.full((3, 2), 0.1 * (k % 3), np.float32)
        together = batch.step(action)[0]
        np.testing.assert_array_equal(together, [env.step(action[0])[0] for env in singles])
        if k == 5:
            state = batch.unwrapped.get_state()
            twin.reset(seed=99)
            twin.unwrapped.set_state(state)
        elif k > 5:
            np.testing.assert_array_equal(twin.step(action)[0], together)


def test_it_moves_within_its_limits_and_keeps_its_links() -> None:
    env, limits, moved = made(), SCARA_50CM.limits, 0.0
    for seed in range(4):
        env.reset(seed=seed)
        angles, lengths = motion(env)
        np.testing.assert_allclose(lengths, 0.5, atol=1e-12)
        joints = np.stack([angles[:, 0], angles[:, 1] - angles[:, 0]], axis=1)
        speeds = np.diff(joints, axis=0) / PATH_STEP
        rates = np.diff(speeds, axis=0) / PATH_STEP
        assert (np.abs(speeds).max(axis=0) <= limits.velocity).all()
        assert (np.abs(rates).max(axis=0) <= limits.acceleration).all()
        assert (np.ptp(joints, axis=0) <= 2.0 * limits.angle_half).all()
        moved = max(moved, float(np.abs(speeds).max()))
    assert moved > 1.0


def test_it_begins_clear_of_the_arm_and_never_rests_at_its_goal() -> None:
    env, arm = made(), SCARA_50CM
    task = env.unwrapped.task
    for seed in range(6):
        env.reset(seed=seed)
        record = task.batch[0]
        assert gap(task, record) > SPAWN_CLEARANCE - 1e-9
        assert 1.35 <= np.hypot(*record["second_base"]) <= 1.5
        path = task.obstacle_path(0)
        resting = np.flatnonzero(np.abs(np.diff(path[:, -1], axis=0)).max(axis=1) < 2e-6)
        goals = [q for q in arm.inverse_kinematics(record["goal"]) if q[1] * record["q"][1] > 0.0]
        at_goal = samples(arm.joint_positions(goals[0]))
        for sample in resting:
            other = samples(np.stack([record["second_base"], path[sample, PER_LINK - 1], path[sample, -1]]))
            apart = np.hypot(*np.moveaxis(at_goal[:, None] - other[None], -1, 0)).min()
            assert apart > TURN_CLEARANCE + 2.0 * arm.link_radius - 1e-3


def test_a_base_without_room_for_the_motion_is_drawn_again() -> None:
    env = made(num_obstacles=1)
    for seed in (32, 2562):  # the first base of these seeds has none
        env.reset(seed=seed)
        task = env.unwrapped.task
        assert gap(task, task.batch[0]) > 0.0


def test_policies_see_discs_that_cover_its_links() -> None:
    env = made(num_obstacles=1, observed_discs=2)
    observation, _ = env.reset(seed=3)
    for _ in range(5):
        observation, *_ = env.step(np.zeros(2, np.float32))
    task = env.unwrapped.task
    seen = task.layout.parse(observation)
    assert seen["obstacle_radius"].shape == (10,)
    assert seen["obstacle_radius"][9] == 0.0  # the place without a disc is the last
    problem = task.motion_problem(observation)
    discs = problem.obstacles[1:]
    assert [disc.radius for disc in discs] == pytest.approx(cover_radii(SCARA_50CM), rel=1e-6)
    centres, radii = np.array([disc.position for disc in discs]), cover_radii(SCARA_50CM)
    axis = samples(task.second_arm(task.batch[0]))
    axis = axis[np.hypot(*(axis - axis[0]).T) > 0.5 / (2 * PER_LINK)]
    along = np.gradient(axis, axis=0)
    for side in (-1.0, 1.0):
        rim = axis + side * 0.999 * 0.045 * np.stack([-along[:, 1], along[:, 0]], 1) / np.hypot(*along.T)[:, None]
        assert (np.hypot(*np.moveaxis(rim[:, None] - centres[None], -1, 0)) - radii).min(axis=1).max() < 2e-3
    before = task.batch[0]["discs"].copy()
    env.step(np.zeros(2, np.float32))
    speeds = np.array([disc.velocity for disc in discs])
    np.testing.assert_allclose((task.batch[0]["discs"] - before)[1:] / 0.02, speeds, atol=0.15)


def test_planners_that_see_it_collide_less_than_one_that_does_not() -> None:
    from agents.evaluation.evaluate import evaluate

    settings = {"second_arm": True, "num_obstacles": 0, "physics": "closed_form"}
    scores = {
        name: evaluate(name, ENV, range(3_000_000, 3_000_040), env_config=settings) for name in ("apf", "follower")
    }
    hit = {name: int(score.metrics["collision"].sum()) for name, score in scores.items()}
    assert hit["apf"] <= 2 < hit["follower"]
    assert scores["apf"].success.mean() > scores["follower"].success.mean()


def test_frames_show_it() -> None:
    pictures = []
    for settings in ({}, {"second_arm": True}):
        env = gym.make(ENV, render_mode="rgb_array", **settings)  # type: ignore[arg-type]
        env.reset(seed=1)
        scene = env.unwrapped.task.scene(0, np.empty((0, 2)))  # type: ignore[attr-defined]
        assert len(scene.obstacles) == 1
        assert len(scene.second_arm) == (3 if settings else 0)
        picture: Any = env.render()
        red = (picture[..., 0] > 180) & (picture[..., 1] < 190) & (picture[..., 2] < 190)
        pictures.append(int(red.sum()))
        env.close()
    assert pictures[1] > 2 * pictures[0]


def test_nothing_to_avoid_is_refused() -> None:
    with pytest.raises(ValueError, match="nothing to avoid; ask for 1 to 4 discs, or set second_arm=True"):
        gym.make(ENV, num_obstacles=0)


def test_given_paths_of_discs_leave_the_second_arm_as_it_is_drawn() -> None:
    env = made(num_obstacles=1)
    env.reset(seed=8, options={"obstacle_paths": (((-1.2, 0.0),),)})
    given = env.unwrapped.task.obstacle_path(0)
    assert (given[:, 0] == [-1.2, 0.0]).all()
    assert np.ptp(given[:, -1], axis=0).max() > 0.1
    assert set(envs.task_card(ENV).levels["second_arm"].settings) == {"second_arm"}
