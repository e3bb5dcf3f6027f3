"""Environments without infos but at the ends of episodes: the same episodes, and the same infos there."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import envs

HORIZON = {"ConveyorTrack-v0": 3.0, "MinTorqueMove-v0": 2.0, "ObstacleDodge-v0": 1.0, "ExcavatorPayload-v0": 2.0}
every = pytest.mark.parametrize("env_id", envs.env_ids())


def made(env_id: str, *, info_terms: bool) -> Any:
    env = gym.make(env_id, info_terms=info_terms, horizon=HORIZON[env_id])
    env.action_space.seed(0)
    return env


@every
def test_steps_are_the_same_and_the_last_info_is(env_id: str) -> None:
    plain, bare = made(env_id, info_terms=True), made(env_id, info_terms=False)
    (first, _), (second, info) = plain.reset(seed=1), bare.reset(seed=1)
    assert info == {}
    over = False
    while not over:
        np.testing.assert_array_equal(first, second)
        action = plain.action_space.sample()
        (first, *ends, known), (second, *others, info) = plain.step(action), bare.step(action)
        assert ends == others
        over = ends[1] or ends[2]
        assert over or info == {}
    assert info.keys() == known.keys()
    for key, value in known.items():
        np.testing.assert_array_equal(value, info[key])


@every
@pytest.mark.parametrize("mode", ["SameStep", "NextStep"])
def test_vectors_have_infos_where_an_episode_ends(env_id: str, mode: str) -> None:
    made_with = {"num_envs": 3, "autoreset_mode": mode, "horizon": HORIZON[env_id]}
    plain, bare = (gym.make_vec(env_id, info_terms=wanted, **made_with) for wanted in (True, False))
    plain.action_space.seed(0)
    plain.reset(seed=1)
    assert bare.reset(seed=1)[1] == {}
    seen = 0
    for _ in range(160):
        actions = plain.action_space.sample()
        *_, terminated, truncated, known = plain.step(actions)
        infos = bare.step(actions)[4]
        if not (terminated | truncated).any():
            assert infos == {}
            continue
        seen += 1
        if mode == "SameStep":
            assert set(infos) == {"final_obs", "_final_obs", "final_info", "_final_info"}
            known, infos = known["final_info"], infos["final_info"]
        assert known.keys() == infos.keys()
        for key, value in known.items():
            np.testing.assert_array_equal(value, infos[key])
    assert seen


def test_a_state_goes_on_with_and_without() -> None:
    plain, bare = (made("ConveyorTrack-v0", info_terms=wanted) for wanted in (True, False))
    plain.reset(seed=1)
    bare.reset(seed=2)
    bare.unwrapped.set_state(plain.unwrapped.get_state())
    action = plain.action_space.sample()
    np.testing.assert_array_equal(plain.step(action)[0], bare.step(action)[0])


def test_a_time_limit_ends_an_episode_with_an_info() -> None:
    env = gym.make("ConveyorTrack-v0", max_episode_steps=3, info_terms=False)
    env.reset(seed=0)
    infos = [env.step(env.action_space.sample())[4] for _ in range(3)]
    assert infos[:2] == [{}, {}]
    assert "settling_time" in infos[2]
