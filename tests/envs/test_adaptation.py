"""Experts with an unknown mass on the hand, in every task."""

from __future__ import annotations

from contextlib import closing
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import envs
from agents.evaluation.evaluate import Evaluation, evaluate
from envs.experts import ADAPTIVE, expert_names, is_expert
from envs.experts.payload_estimation import AdaptiveState
from envs.experts.robust import RobustState

TASKS = ("ConveyorTrack-v0", "MinTorqueMove-v0", "ObstacleDodge-v0")
PLANNED = ("dpct", "lagrange", "apf", "follower")

every_task = pytest.mark.parametrize("env_id", TASKS)
every_expert = pytest.mark.parametrize("name", PLANNED)


def scored(name: str, env_id: str, payload: float, episodes: int = 6) -> Evaluation:
    return evaluate(name, env_id, range(episodes), env_config={"payload": payload})


def actions_and_states(env: Any, expert: Any, steps: int, seed: int = 0) -> tuple[list[Any], list[AdaptiveState]]:
    """The actions of a vector environment's first steps, and the states after them."""
    observations, _ = env.reset(seed=seed)
    state, actions, states = None, [], []
    for _ in range(steps):
        action, state = expert.predict(observations, state)
        observations, *_ = env.step(action)
        actions.append(action)
        states.append(state)
    return actions, states


@every_task
@every_expert
def test_the_estimate_is_the_payload(env_id: str, name: str) -> None:
    with closing(gym.make_vec(env_id, num_envs=3, payload=0.3)) as env:
        expert = envs.make_expert(name, env, adaptive=True)
        _, states = actions_and_states(env, expert, 20)
        np.testing.assert_array_equal(states[0].mass_estimate, 0.0)  # nothing has moved yet
        np.testing.assert_allclose(states[-1].mass_estimate, 0.3, atol=0.004)
        np.testing.assert_array_equal(expert.mass_estimate, states[-1].mass_estimate)


@every_task
@every_expert
def test_without_payload_nothing_changes(env_id: str, name: str) -> None:
    """Lagrange's torques jump so in MinTorqueMove that the scale errs by two grams; elsewhere it shows none."""
    plain, adaptive = (scored(name + ending, env_id, 0.0, episodes=3) for ending in ("", ADAPTIVE))
    np.testing.assert_array_equal(adaptive.success, plain.success)
    np.testing.assert_allclose(adaptive.returns, plain.returns, atol=2e-3)


@pytest.mark.parametrize("name", ["dpct", "apf"])
def test_a_part_is_met_with_a_payload_as_exactly_as_without(name: str) -> None:
    """To a thousandth of the tolerance; who does not know of the payload is further off."""
    errors = {}
    for of in ((name, 0.0), (name, 0.3), (name + ADAPTIVE, 0.3)):
        errors[of] = np.median(scored(of[0], TASKS[0], of[1], episodes=12).metrics["steady_state_error"])
    unloaded, plain, adaptive = errors.values()
    assert adaptive == pytest.approx(unloaded, abs=1e-6)
    assert plain > 10.0 * adaptive


@pytest.mark.parametrize("name", ["dpct", "apf"])
def test_a_move_with_a_payload_ends_at_its_goal(name: str) -> None:
    plain, adaptive = (scored(name + ending, "MinTorqueMove-v0", 0.3) for ending in ("", ADAPTIVE))
    assert plain.success.mean() <= 0.5
    assert adaptive.success.all()


def test_the_limits_are_those_of_the_loaded_arm() -> None:
    """A hand that drifts off the line of the belt, before the payload is known, is no hindrance."""
    plain, adaptive = (scored("dpct" + ending, TASKS[0], 0.3, 12) for ending in ("", ADAPTIVE))
    assert adaptive.metrics["limit_ratio"].max() <= 1.05
    assert adaptive.timing.infeasible == 0
    assert np.median(plain.metrics["limit_ratio"]) > 1.5


@pytest.mark.parametrize("name", ["dpct", "lagrange", "apf"])
@pytest.mark.parametrize("env_id", ["ConveyorTrack-v0", "MinTorqueMove-v0"])
def test_a_payload_that_is_declared_is_estimated(env_id: str, name: str) -> None:
    settings = dict(envs.task_card(env_id).levels["payload"].settings)
    of_level, adaptive = (evaluate(name + ending, env_id, range(6), env_config=settings) for ending in ("", ADAPTIVE))
    assert of_level.success.all()
    np.testing.assert_array_equal(of_level.returns, adaptive.returns)
    assert (of_level.metrics["limit_ratio"] <= 1.005).mean() >= 5 / 6


@every_task
def test_an_episode_begins_with_the_lightest_payload_that_is_declared(env_id: str) -> None:
    with closing(gym.make_vec(env_id, num_envs=2, payload=(0.1, 0.2))) as env:
        expert = envs.make_expert("apf", env)
        for _ in range(2):
            _, states = actions_and_states(env, expert, 8)
            np.testing.assert_allclose(states[0].mass_estimate, 0.1)
            np.testing.assert_allclose(states[-1].mass_estimate, env.unwrapped.task.batch["payload"], atol=0.004)  # type: ignore[attr-defined]


@every_task
def test_other_uncertainty_beside_a_payload_is_filtered_with_it(env_id: str) -> None:
    with closing(gym.make(env_id, payload=(0.0, 0.2), mass_error=0.1)) as env:
        observation, _ = env.reset(seed=0)
        assert isinstance(envs.make_expert("apf", env).predict(observation)[1], RobustState)


@every_task
def test_a_batch_is_as_its_environments(env_id: str) -> None:
    with closing(gym.make_vec(env_id, num_envs=3, payload=0.2)) as env:
        batch, _ = actions_and_states(env, envs.make_expert("apf+adaptive", env), 12, seed=4)
    for env_index in range(3):
        with closing(gym.make_vec(env_id, num_envs=1, payload=0.2)) as env:
            alone, _ = actions_and_states(env, envs.make_expert("apf+adaptive", env), 12, seed=4 + env_index)
        np.testing.assert_array_equal([step[0] for step in alone], [step[env_index] for step in batch])


@every_task
@every_expert
def test_what_is_known_travels_in_the_state(env_id: str, name: str) -> None:
    with closing(gym.make_vec(env_id, num_envs=2, payload=0.3)) as env:
        expert = envs.make_expert(name, env, adaptive=True)
        observations, _ = env.reset(seed=1)
        state, calls = None, []
        for _ in range(8):
            calls.append((observations, state))
            action, state = expert.predict(observations, state)
            observations, *_ = env.step(action)
        (early, known), (late, _) = calls[5], calls[7]
        before = expert.predict(early, known)[0]
        expert.predict(late, state)
        np.testing.assert_array_equal(expert.predict(early, known)[0], before)
        np.testing.assert_array_equal(envs.make_expert(name, env, adaptive=True).predict(early, known)[0], before)


@every_task
def test_an_episode_begins_without_payload(env_id: str) -> None:
    with closing(gym.make(env_id, payload=0.3)) as env:
        expert = envs.make_expert("apf", env, adaptive=True)
        observation, _ = env.reset(seed=3)
        for _ in range(10):
            action, state = expert.predict(observation)
            observation, *_ = env.step(action)
        assert state.mass_estimate[0] == pytest.approx(0.3, abs=0.004)
        observation, _ = env.reset(seed=5)
        action, state = expert.predict(observation)
        assert state.mass_estimate[0] == 0.0
        np.testing.assert_array_equal(action, envs.make_expert("apf", env).predict(observation)[0])
        observation, *_ = env.step(action)
        _, state = expert.predict(observation, state, episode_start=np.ones(1, dtype=bool))
        assert state.mass_estimate[0] == 0.0


def test_a_torque_that_is_clipped_tells_nothing_wrong() -> None:
    """The heavy hand asks for more than there is in almost every step; what was applied is what counts."""
    with closing(gym.make_vec("MinTorqueMove-v0", num_envs=4, payload=3.0)) as env:
        actions, states = actions_and_states(env, envs.make_expert("dpct+adaptive", env), 60)
        assert np.mean(np.abs(actions).max(axis=2) == 1.0) > 0.5
        np.testing.assert_allclose(states[-1].mass_estimate, 3.0, atol=0.02)


def test_environments_with_other_payloads_each_have_their_own_arm() -> None:
    light, heavy = (gym.make_vec(TASKS[0], num_envs=1, payload=mass) for mass in (0.1, 0.3))
    with closing(light), closing(heavy):
        one, other, both = (envs.make_expert("lagrange+adaptive", light) for _ in range(3))
        seen, its = light.reset(seed=0)[0], heavy.reset(seed=0)[0]
        states: list[Any] = [None, None, None]
        for _ in range(15):
            together, states[2] = both.predict(np.concatenate([seen, its]), states[2])
            apart, states[0] = one.predict(seen, states[0])
            apart_too, states[1] = other.predict(its, states[1])
            np.testing.assert_array_equal(together, np.concatenate([apart, apart_too]))
            seen, its = light.step(apart)[0], heavy.step(apart_too)[0]
        np.testing.assert_allclose(states[2].mass_estimate, [0.1, 0.3], atol=0.002)


@pytest.mark.parametrize(
    ("env_id", "mode"),
    [("ConveyorTrack-v0", "jerk"), ("ConveyorTrack-v0", "acceleration"), ("ObstacleDodge-v0", "velocity")],
)
def test_actions_that_are_no_torques_are_refused(env_id: str, mode: str) -> None:
    with pytest.raises(ValueError, match=f'actions of control_mode "{mode}".*use control_mode "torque"'):
        envs.make_expert("apf", gym.make(env_id, control_mode=mode), adaptive=True)


def test_names() -> None:
    assert all(is_expert(name) and is_expert(name + ADAPTIVE) for name in expert_names(TASKS[0]))
    assert not is_expert("agent+adaptive")
    env = gym.make(TASKS[0])
    assert envs.make_expert("apf", env).mass_estimate is None
    with pytest.raises(ValueError, match='did you mean "dpct"'):
        envs.make_expert("dcpt+adaptive", env)


@every_task
@pytest.mark.parametrize("mass", [-0.1, 10.5, float("nan"), "heavy"])
def test_impossible_payloads_are_refused(env_id: str, mass: Any) -> None:
    with pytest.raises(ValueError, match=f"{env_id} setting: payload = .*must be (from 0 to 10|a (finite )?number)"):
        gym.make(env_id, payload=mass)


@every_task
def test_no_policy_is_told_the_payload(env_id: str) -> None:
    shown = []
    for mass in (0.0, 0.3):
        with closing(gym.make(env_id, payload=mass)) as env:
            observation, _ = env.reset(seed=2)
            inner: Any = env.unwrapped
            problem = inner.motion_problem()
            assert problem.payload == 0.0
            assert problem.arm == inner.task.arm
            shown.append(observation)
    np.testing.assert_array_equal(*shown)
