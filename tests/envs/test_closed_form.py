"""`physics="closed_form"`: the exact equations of motion, behind the same contract as Pymunk."""

from __future__ import annotations

import pickle
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import envs
from envs.min_torque_move.env import MinTorqueMove
from envs.physics.closed_form import closed_form_constants
from planners import Arm
from planners.robot.arm import JointLimits
from planners.robot.clearance import clearance

every_task = pytest.mark.parametrize("env_id", envs.env_ids())


def made(env_id: str = "MinTorqueMove-v0", num_envs: int = 0, **settings: Any) -> Any:
    settings = {"physics": "closed_form", **settings}
    return gym.make_vec(env_id, num_envs=num_envs, **settings) if num_envs else gym.make(env_id, **settings)


def action_of(env: Any, k: int) -> np.ndarray[Any, Any]:
    draw: Any = np.random.default_rng(k).uniform(-0.3, 0.3, env.action_space.shape)
    return np.asarray(draw, np.float32)


@every_task
def test_environments_equal_single_ones_through_their_resets(env_id: str) -> None:
    batch = made(env_id, 11, autoreset_mode="SameStep")
    seen, _ = batch.reset(seed=4)
    actions = [action_of(batch, k) for k in range(170)]
    rows = [seen, *[batch.step(action) for action in actions]]
    assert any((row[2] | row[3]).any() for row in rows[1:])
    for index in (0, 7, 8, 10):  # of a whole pack, and of one that is not full
        alone = made(env_id)
        observation, _ = alone.reset(seed=4 + index)
        np.testing.assert_array_equal(observation, rows[0][index])
        for action, row in zip(actions, rows[1:], strict=True):
            observation, reward, terminated, truncated, _ = alone.step(action[index])
            if terminated or truncated:
                observation, _ = alone.reset()
            np.testing.assert_array_equal(observation, row[0][index])
            assert (reward, terminated, truncated) == (row[1][index], row[2][index], row[3][index])


def test_environments_that_wait_for_the_next_step_do_not_matter_to_others() -> None:
    batch, singles = made(num_envs=19), [made() for _ in range(19)]
    batch.reset(seed=4)
    for index, alone in enumerate(singles):
        alone.reset(seed=4 + index)
    over, waited = np.zeros(19, dtype=bool), 0
    for k in range(170):
        action = action_of(batch, k)
        seen, _, terminated, truncated, _ = batch.step(action)
        for index, alone in enumerate(singles):
            observation = alone.reset()[0] if over[index] else alone.step(action[index])[0]
            np.testing.assert_array_equal(observation, seen[index])
        waited += over.sum()
        over = terminated | truncated
    assert waited > 3


@every_task
@pytest.mark.parametrize("num_envs", [0, 3])
def test_states_and_pickles_continue_to_the_bit(env_id: str, num_envs: int) -> None:
    env = made(env_id, num_envs)
    env.reset(seed=3)
    for k in range(7):
        env.step(action_of(env, k))
    state, twin, other = env.unwrapped.get_state(), pickle.loads(pickle.dumps(env.unwrapped)), made(env_id, num_envs)
    other.reset(seed=99)
    other.unwrapped.set_state(state)
    for k in range(12):
        action = action_of(env, 50 + k)
        expected = env.step(action)
        for one in (twin, other):
            found = one.step(action)
            np.testing.assert_array_equal(found[0], expected[0])
            np.testing.assert_array_equal(found[1], expected[1])


@every_task
def test_it_stays_near_pymunk_but_is_not_it(env_id: str) -> None:
    exact, pymunk = made(env_id), made(env_id, physics="pymunk")
    start, _ = exact.reset(seed=1)
    np.testing.assert_array_equal(start, pymunk.reset(seed=1)[0])
    for k in range(10):
        one, two = exact.step(action_of(exact, k))[0], pymunk.step(action_of(exact, k))[0]
    assert 0.0 < np.abs(one - two).max() < 0.05


@pytest.mark.parametrize("num_obstacles", [1, 3])
def test_the_clearance_is_that_of_the_arm_and_the_discs(num_obstacles: int) -> None:
    env = made("ObstacleDodge-v0", 5, num_obstacles=num_obstacles)
    env.reset(seed=6)
    task, nearest = env.unwrapped.task, np.full(5, np.inf)
    lengths, radius = np.array(task.arm.lengths), task.arm.link_radius
    for k in range(15):
        _, _, terminated, _, _ = env.step(action_of(env, k))
        assert not terminated.any()
        gaps = [
            clearance(lengths, task.arm.base_array, radius, record["q"][None], disc[None], size)[0]
            for record in task.batch
            for disc, size in zip(record["discs"], record["radii"], strict=True)
        ]
        wanted = np.min(np.reshape(gaps, (5, num_obstacles)), axis=1)
        np.testing.assert_allclose(task.batch["clearance"], wanted, rtol=0.0, atol=1e-12)
        assert (task.batch["closest"] <= wanted + 1e-12).all()
        nearest = np.minimum(nearest, wanted)
    assert (task.batch["min_clearance"] <= nearest + 1e-12).all()
    assert (task.batch["min_clearance"] > nearest - 0.01).all()


class OnlyPymunk(MinTorqueMove):
    """A task whose kernels step Pymunk themselves."""

    physics = ("pymunk",)


def test_a_task_without_it_refuses_it() -> None:
    with pytest.raises(ValueError, match=r"MinTorqueMove-v0 physics.*closed_form"):
        OnlyPymunk.make({"physics": "closed_form"}, 1)


def test_an_arm_that_is_too_long_is_refused() -> None:
    constants = {"lengths": (0.1,) * 7, "masses": (0.1,) * 7, "limits": JointLimits(torque=(1.0,) * 7)}
    with pytest.raises(ValueError, match=r"up to 6 joints, and SEVEN has 7 joints"):
        closed_form_constants(Arm(name="SEVEN", **constants), "closed_form")
    assert not closed_form_constants(Arm(name="SEVEN", **constants), "pymunk")["closed_form"]


@pytest.mark.parametrize("env_id", ["ConveyorTrack-v0", "MinTorqueMove-v0"])  # the excavator: test_excavator_world.py
def test_it_follows_the_lagrange_euler_equations(env_id: str) -> None:
    env = made(env_id)
    env.reset(seed=2)
    task, errors = env.unwrapped.task, []
    arm = task.arm
    hardest = np.resize(np.array([1.0, -0.5], np.float32), arm.n_joints)
    for _ in range(20):
        record = task.batch[0]
        begun = np.concatenate([record["q"], record["qd"]])
        env.step(hardest)
        record = task.batch[0]
        tau = record["tau"].copy()

        def rates(_t: float, state: Any, tau: Any = tau) -> Any:
            q, qd = np.split(state, 2)
            return np.concatenate([qd, arm.forward_dynamics(q, qd, tau)])

        span = (0.0, task.config.control_period)
        wanted = solve_ivp(rates, span, begun, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
        errors.append(np.abs(np.concatenate([record["q"], record["qd"]]) - wanted).max())
    assert np.abs(begun[arm.n_joints :]).max() > 0.05
    assert max(errors) < 1e-7


def test_a_free_swing_keeps_its_energy() -> None:
    env = made(gravity=9.81)
    env.reset(seed=2)
    task = env.unwrapped.task
    arm, still = task.arm, np.zeros(env.action_space.shape, np.float32)
    begun, moved = float(arm.energy(task.batch[0]["q"], task.batch[0]["qd"])), 0.0
    for _ in range(40):
        env.step(still)
        q, qd = task.batch[0]["q"], task.batch[0]["qd"]
        moved = max(moved, float(arm.energy(q, qd) - arm.energy(q, 0.0 * qd)))
        assert abs(float(arm.energy(q, qd)) - begun) < 1e-5 * max(moved, 1.0)
    assert moved > 1.0
