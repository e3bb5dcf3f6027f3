"""The experts of ExcavatorPayload-v0: tracking with an unknown payload, and their state."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import envs
from envs.experts import expert_names
from planners.typing import Array

ENV_ID = "ExcavatorPayload-v0"
N_ENVS = 8
NAMES = [name for name in expert_names(ENV_ID) if name != "random"]

Ends = dict[str, Array]


def finish(name: str, batch: int = N_ENVS, options: dict[str, Any] | None = None, **config: Any) -> tuple[Ends, Any]:
    """One episode an environment: its last info, and the expert with its last estimates."""
    env = gym.make_vec(ENV_ID, num_envs=batch, autoreset_mode="SameStep", **config)
    expert = envs.make_expert(name, env)
    observation, _ = env.reset(seed=0, options=options)
    ends: dict[int, dict[str, float]] = {}
    while len(ends) < batch:
        actions, _ = expert.predict(observation)
        observation, _, terminated, truncated, infos = env.step(actions)
        for env_index in np.flatnonzero(terminated | truncated):
            final = infos["final_info"]
            ends.setdefault(
                env_index, {key: final[key][env_index] for key in ("is_success", "payload_mass", "tip_rms")}
            )
    return {key: np.array([ends[env_index][key] for env_index in range(batch)]) for key in ends[0]}, expert


def observations(env: Any, expert: Any, steps: int) -> list[Any]:
    """What an expert sees, the first observation included."""
    seen = [env.reset(seed=3)[0]]
    for _ in range(steps):
        action, _ = expert.predict(seen[-1])
        seen.append(env.step(action)[0])
    return seen


@pytest.fixture(scope="module")
def adaptive() -> tuple[Ends, Any]:
    return finish("adaptive")


def test_adapting_succeeds_whatever_the_load(adaptive: tuple[Ends, Any]) -> None:
    assert adaptive[0]["is_success"].all()


def test_the_load_is_weighed(adaptive: tuple[Ends, Any]) -> None:
    ends, expert = adaptive
    np.testing.assert_allclose(expert.mass_estimate, ends["payload_mass"], atol=20.0)
    assert np.ptp(ends["payload_mass"]) > 200.0


@pytest.mark.parametrize("name", ["computed_torque", "integral_computed_torque"])
def test_without_adapting_a_heavy_load_is_too_much(name: str) -> None:
    ends, expert = finish(name, options={"payload": 300.0})
    assert not ends["is_success"].any()
    assert expert.mass_estimate is None


def test_computed_torque_succeeds_with_what_it_takes_the_machine_for() -> None:
    ends, _ = finish("computed_torque", options={"payload": 0.0, "friction_scale": 1.0})
    assert ends["is_success"].all()


def test_adapting_succeeds_as_a_residual() -> None:
    ends, expert = finish("adaptive", control_mode="residual")
    assert ends["is_success"].all()
    np.testing.assert_allclose(expert.mass_estimate, ends["payload_mass"], atol=20.0)


def test_both_control_modes_move_the_machine_alike() -> None:
    ends = []
    for mode in ("torque", "residual"):
        env: Any = gym.make(ENV_ID, control_mode=mode)
        observations(env, envs.make_expert("adaptive", env), 100)
        ends.append(np.concatenate(env.unwrapped.joint_state()))
    np.testing.assert_allclose(*ends, atol=1e-5)


def test_a_load_that_comes_and_goes_is_weighed_again() -> None:
    ends, expert = finish("adaptive", level=2)
    assert ends["is_success"].mean() >= 0.75
    np.testing.assert_allclose(expert.mass_estimate, 0.0, atol=20.0)


@pytest.mark.parametrize("name", NAMES)
def test_the_state_is_all_that_an_expert_remembers(name: str) -> None:
    env: Any = gym.make(ENV_ID)
    seen = observations(env, envs.make_expert(name, env), 60)
    one, other = envs.make_expert(name, env), envs.make_expert(name, env)
    state, states, actions = None, [], []
    for observation in seen:
        states.append(state)
        action, state = one.predict(observation, state)
        actions.append(action)
    for step in (40, 15, 40):  # back and forth: an older state gives the same again
        again, _ = other.predict(seen[step], states[step])
        np.testing.assert_array_equal(again, actions[step])


@pytest.mark.parametrize("name", NAMES)
def test_environments_know_nothing_of_each_other(name: str) -> None:
    env: Any = gym.make_vec(ENV_ID, num_envs=3)
    single: Any = gym.make(ENV_ID)
    together, alone = envs.make_expert(name, env), envs.make_expert(name, single)
    observation, _ = env.reset(seed=5)
    state, env_state = None, None
    for _ in range(40):
        actions, state = together.predict(observation, state)
        action, env_state = alone.predict(observation[1], env_state)
        np.testing.assert_allclose(action, actions[1], atol=1e-6)
        observation, *_ = env.step(actions)


@pytest.mark.parametrize("name", NAMES)
def test_an_episode_begins_with_nothing_known(name: str) -> None:
    env: Any = gym.make(ENV_ID)
    expert = envs.make_expert(name, env)
    first = observations(env, expert, 0)[0]
    fresh, _ = expert.predict(first)
    for observation in observations(env, expert, 80):
        _, state = expert.predict(observation)
    np.testing.assert_array_equal(expert.predict(first, state)[0], fresh)
    if expert.mass_estimate is not None:
        # The filter begins with the mean of the drawn payloads, the others with an empty bucket.
        assert expert.mass_estimate[0] == pytest.approx(175.0 if name == "kalman" else 0.0, abs=20.0)


@pytest.mark.parametrize("name", ["adaptive", "computed_torque"])
def test_a_controller_alone_is_refused_where_there_is_no_reference(name: str) -> None:
    with pytest.raises(ValueError, match=f'unknown MinTorqueMove-v0 expert "{name}".*known: apf, dpct'):
        envs.make_expert(name, gym.make("MinTorqueMove-v0"))


@pytest.mark.parametrize("name", ["dpct", "lagrange", "apf", "follower"])
def test_no_planner_acts_where_the_motion_is_given(name: str) -> None:
    with pytest.raises(ValueError, match=f'unknown {ENV_ID} expert "{name}".*known: adaptive'):
        envs.make_expert(name, gym.make(ENV_ID))


def test_experts_need_no_adaptation_around_them() -> None:
    with pytest.raises(ValueError, match=f"needs joint_acceleration, not in the observation of {ENV_ID}"):
        envs.make_expert("adaptive", gym.make(ENV_ID), adaptive=True)


@pytest.mark.parametrize(
    ("config", "options"),
    [
        ({}, {}),
        ({}, {"friction_scale": 3.0}),
        ({"encoder_noise": 3e-4}, {}),
        ({"level": 2}, {}),
        ({"control_mode": "residual"}, {}),
        ({"mass_error": (-0.1, 0.1)}, {}),
        ({"latency": (0.0, 0.02)}, {}),
        ({"mass_error": (-0.1, 0.1), "latency": (0.0, 0.02), "encoder_noise": 3e-4}, {}),
    ],
)
def test_the_kalman_filter_halves_the_tip_error(config: dict[str, Any], options: dict[str, Any]) -> None:
    kalman, expert = finish("kalman", options=options, **config)
    simple, _ = finish("adaptive", options=options, **config)
    assert kalman["is_success"].all()
    assert (kalman["tip_rms"] < simple["tip_rms"]).all()
    assert np.median(kalman["tip_rms"]) < 0.5 * np.median(simple["tip_rms"])
    # On level 2 the bucket is empty at the end; and a heavier bucket looks like a heavier payload.
    if config.get("level") != 2 and "mass_error" not in config:
        np.testing.assert_allclose(expert.mass_estimate, kalman["payload_mass"], atol=5.0)


def test_the_reference_repeats_the_episode_and_knows_the_payload() -> None:
    bound = envs.task_card(ENV_ID).bound
    assert bound is not None
    env = gym.make_vec(ENV_ID, num_envs=N_ENVS, autoreset_mode="SameStep", level=2).unwrapped
    env.reset(seed=list(range(N_ENVS)))
    given = np.array([bound.optimum(env, env_index, env_index) for env_index in range(N_ENVS)])
    kalman, _ = finish("kalman", level=2)
    assert np.median(given) < np.median(kalman["tip_rms"])
    # Noise may favour the one that is given less, by little.
    assert (given < 1.2 * kalman["tip_rms"]).all()
