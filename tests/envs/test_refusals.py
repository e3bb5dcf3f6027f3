"""What an environment refuses leaves the episode and its random numbers as they were, single and vector."""

from __future__ import annotations

import math
import pickle
import re
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import envs

every_env = pytest.mark.parametrize("env_id", envs.env_ids())

BAD_ACTIONS = [
    (0.5, r"shape \(2,\), found shape \(\)"),
    ("0.5", r"shape \(2,\), found '0.5' of type <U3"),
    (["0.5", "0.5"], "of type <U3"),
    ([0.5], r"shape \(2,\), found shape \(1,\)"),
    (np.zeros(3), r"shape \(2,\), found shape \(3,\)"),
    (np.zeros((1, 2)), r"shape \(2,\), found shape \(1, 2\)"),
    (np.zeros((2, 1)), r"shape \(2,\), found shape \(2, 1\)"),
    (None, "found None of type object"),
    ([0.5, None], "of type object"),
    (np.ma.array([0.5, 0.5], mask=[0, 1]), "found masked_array"),
    ([[0.5], [0.5, 0.5]], "which is no array"),
    (np.zeros(2, dtype=bool), "of type bool"),
    (np.zeros(2, dtype=complex), "of type complex128"),
    ([0.5, math.nan], r"action \[0.5, nan\] \(environment 0\) is not finite"),
    (np.full(2, np.finfo(np.longdouble).max), "is not finite"),
    ([math.inf, 0.5], r"action \[inf, 0.5\] \(environment 0\) is not finite"),
]


def whole_state(env: Any) -> bytes:
    """Everything that an episode depends on."""
    task = env.unwrapped.task
    hands = [task.hand_position(i).tolist() for i in range(task.num_envs)]
    generators = getattr(env.unwrapped, "_generators", None) or [env.unwrapped.np_random]
    return pickle.dumps((task.batch.tobytes(), hands, [one.bit_generator.state for one in generators]))


def rest_of_episode(env: Any, shape: tuple[int, ...]) -> list[Any]:
    return [env.step(np.full(shape, 0.1, dtype=np.float32))[:4] for _ in range(5)]


@pytest.mark.parametrize(("action", "complaint"), BAD_ACTIONS, ids=[str(action) for action, _ in BAD_ACTIONS])
def test_an_action_of_another_kind_is_refused_and_the_episode_goes_on(action: Any, complaint: str) -> None:
    env, twin = (gym.make("ConveyorTrack-v0", disable_env_checker=True).unwrapped for _ in range(2))
    for one in (env, twin):
        one.reset(seed=0)
        one.step(np.array([0.3, -0.2], dtype=np.float32))
    before = whole_state(env)
    with pytest.raises(ValueError, match=complaint):
        env.step(action)
    assert whole_state(env) == before
    assert pickle.dumps(rest_of_episode(env, (2,))) == pickle.dumps(rest_of_episode(twin, (2,)))


@pytest.mark.parametrize(
    ("actions", "complaint"),
    [
        (np.zeros(2), r"shape \(3, 2\), found shape \(2,\)"),
        (np.zeros((1, 2)), r"shape \(3, 2\), found shape \(1, 2\)"),
        (np.zeros((3, 1)), r"shape \(3, 2\), found shape \(3, 1\)"),
        (0.0, r"shape \(3, 2\), found shape \(\)"),
        ("0.5", "of type <U3"),
        ([[0.0, 0.0], [0.0, math.nan], [0.0, 0.0]], r"action \[0.0, nan\] \(environment 1\) is not finite"),
    ],
    ids=str,
)
def test_a_batch_of_actions_of_another_kind_is_refused(actions: Any, complaint: str) -> None:
    vector, twin = (gym.make_vec("ConveyorTrack-v0", num_envs=3) for _ in range(2))
    for one in (vector, twin):
        one.reset(seed=0)
        one.step(np.full((3, 2), 0.3, dtype=np.float32))
    before = whole_state(vector)
    with pytest.raises(ValueError, match=complaint):
        vector.step(actions)
    assert whole_state(vector) == before
    assert pickle.dumps(rest_of_episode(vector, (3, 2))) == pickle.dumps(rest_of_episode(twin, (3, 2)))


@every_env
def test_lists_and_integers_are_actions_too(env_id: str) -> None:
    env, twin = gym.make(env_id, disable_env_checker=True), gym.make(env_id, disable_env_checker=True)
    env.reset(seed=0)
    twin.reset(seed=0)
    n = env.action_space.shape[0]  # type: ignore[index]
    observation = env.step([0] * n)[0]
    np.testing.assert_array_equal(observation, twin.step(np.zeros(n, dtype=np.float32))[0])


@every_env
@pytest.mark.parametrize("options", [{"scenario": "papr"}, {"senario": "paper"}, ["paper"], "paper", 3])
@pytest.mark.parametrize("seed", [None, 5])
def test_refused_options_leave_the_episode_and_its_random_numbers(env_id: str, options: Any, seed: int | None) -> None:
    for env in (gym.make(env_id, disable_env_checker=True).unwrapped, gym.make_vec(env_id, num_envs=2).unwrapped):
        env.reset(seed=0)
        before = whole_state(env)
        with pytest.raises(ValueError, match=r"scenario|option"):
            env.reset(seed=seed, options=options)
        assert whole_state(env) == before


def test_options_refused_after_random_draws_leave_the_random_numbers() -> None:
    given = {"belt_speed": 3.0}
    for env in (gym.make("ConveyorTrack-v0").unwrapped, gym.make_vec("ConveyorTrack-v0", num_envs=2).unwrapped):
        env.reset(seed=0)
        before = whole_state(env)
        with pytest.raises(ValueError, match="no_window"):
            env.reset(options=given)
        assert whole_state(env) == before


@pytest.mark.parametrize("name", ["lagrange", "apf", "follower", "random", "lagrange+adaptive"])
def test_an_expert_refuses_what_is_no_observation_of_its_own(name: str) -> None:
    env = gym.make_vec("MinTorqueMove-v0", num_envs=3)
    expert, size = envs.make_expert(name, env), 20
    observation, _ = env.reset(seed=0)
    for shape in [(), (3,), (3, 3), (0, size), (2, 2, size)]:
        with pytest.raises(ValueError, match=rf"\(num_envs, {size}\), found shape {re.escape(str(shape))}"):
            expert.predict(np.zeros(shape))
    for given in (None, "x", ["a"] * size, np.zeros(size, complex), np.zeros(size, object)):
        with pytest.raises(ValueError, match="found shape"):
            expert.predict(given)  # type: ignore[arg-type]
    for number in (math.nan, math.inf):
        with pytest.raises(ValueError, match="not finite"):
            expert.predict(np.full((3, size), number))
    for starts in (True, [True], np.ones(2, bool), np.ones((3, 1), bool), "abc", [None] * 3):
        with pytest.raises(ValueError, match=r"episode_start of shape \(3,\)"):
            expert.predict(observation, None, starts)  # type: ignore[arg-type]
    actions = expert.predict(observation, None, np.ones(3, bool))[0]
    if name != "random":
        np.testing.assert_array_equal(expert.predict(observation, None, np.ones(3, int))[0], actions)


def test_experts_are_made_by_name_for_an_environment() -> None:
    for name in (None, 3, "", "+adaptive"):
        with pytest.raises(ValueError, match="unknown MinTorqueMove-v0 expert"):
            envs.make_expert(name, gym.make("MinTorqueMove-v0"))  # type: ignore[arg-type]
    for env in (None, 3, "MinTorqueMove-v0"):
        with pytest.raises(ValueError, match="is not one of planarm's environments"):
            envs.make_expert("dpct", env)  # type: ignore[arg-type]


BAD_SEEDS = [-1, 2.0, np.float32(1.0), "3", b"34", True, {1, 2}, [3, -1], [3, 4.0], ["a", None], np.array([1.0, 2.0])]


@pytest.mark.parametrize("seed", BAD_SEEDS, ids=str)
def test_a_refused_seed_leaves_the_random_numbers(seed: Any) -> None:
    for env in (gym.make("MinTorqueMove-v0").unwrapped, gym.make_vec("MinTorqueMove-v0", num_envs=2)):
        env.reset(seed=0)
        before = whole_state(env)
        with pytest.raises(ValueError, match=r"seed .* must be a whole number of at least 0"):
            env.reset(seed=seed)
        assert whole_state(env) == before


def test_seeds_are_whole_numbers_of_any_kind() -> None:
    single = gym.make("MinTorqueMove-v0").unwrapped
    vector = gym.make_vec("MinTorqueMove-v0", num_envs=2)
    for seed in (np.int64(254), np.uint8(254)):
        assert (single.reset(seed=seed)[0] == single.reset(seed=254)[0]).all()
        assert single.np_random_seed == 254
    wanted = vector.reset(seed=[254, 255])[0]
    for seeds in (np.uint8(254), np.array([254, 255], np.uint8), (254, np.int16(255)), range(254, 256)):
        assert (vector.reset(seed=seeds)[0] == wanted).all()


@every_env
@pytest.mark.parametrize("render_mode", ["rgb_array", None])
def test_rendering_wants_a_reset(env_id: str, render_mode: str | None) -> None:
    single = gym.make(env_id, render_mode=render_mode, disable_env_checker=True)
    for env in (single, single.unwrapped, gym.make_vec(env_id, num_envs=2, render_mode=render_mode)):
        with pytest.raises(gym.error.ResetNeeded, match="reset"):
            env.render()


def test_a_frame_after_the_end_is_the_last_of_the_episode() -> None:
    env = gym.make("ObstacleDodge-v0", horizon=0.5, render_mode="rgb_array")
    env.reset(seed=0)
    over = False
    while not over:
        over = any(env.step(np.zeros(2, dtype=np.float32))[2:4])
    assert np.asarray(env.render()).ndim == 3


@every_env
def test_an_unknown_setting_is_an_unexpected_keyword_and_a_bad_value(env_id: str) -> None:
    for kind in (TypeError, ValueError):
        with pytest.raises(kind, match=r'setting "frameskip".*unexpected keyword argument .frameskip.'):
            gym.make(env_id, frameskip=4)
        with pytest.raises(kind, match='setting "frameskip"'):
            gym.make_vec(env_id, num_envs=2, frameskip=4)


@every_env
@pytest.mark.parametrize(
    ("settings", "complaint"),
    [
        ({"physics_step": 1e-300}, "takes more than 1000000 steps"),
        ({"physics_step": 1e-9}, "takes more than 1000000 steps"),
        ({"control_period": 1e-300, "physics_step": 1e-300}, "takes more than 1000000 steps"),
        ({"control_period": math.inf}, "control_period = inf"),
        ({"horizon": math.nan}, "horizon = nan"),
        ({"num_envs": 3}, 'unknown .* setting "num_envs"'),
    ],
    ids=str,
)
def test_impossible_times_and_foreign_settings_are_refused(
    env_id: str, settings: dict[str, Any], complaint: str
) -> None:
    with pytest.raises(ValueError, match=complaint):
        gym.make(env_id, **settings)


@every_env
@pytest.mark.parametrize("count", [-2, 0, 2.5, True, "3"])
def test_counts_of_a_vector_environment_are_whole_and_positive(env_id: str, count: Any) -> None:
    with pytest.raises(ValueError, match=rf"max_episode_steps {count!r} must be a whole number of at least 1"):
        gym.make_vec(env_id, num_envs=2, max_episode_steps=count)
    with pytest.raises(ValueError, match=rf"num_envs {count!r} must be a whole number of at least 1"):
        gym.make_vec(env_id, num_envs=count)


CUT = {
    "ConveyorTrack-v0": {"settling_time": math.inf, "steady_state_error": math.nan, "lq_cost": math.nan},
    "MinTorqueMove-v0": {"quintic_ratio": math.nan, "torque_l1": math.nan, "torque_l2": math.nan},
    "ObstacleDodge-v0": {"time_to_goal": math.inf, "collision": False},
    "ExcavatorPayload-v0": {"tip_rms": math.nan, "tip_max": math.nan, "success_easy": False},
}


@pytest.mark.parametrize("env_id", CUT)
def test_an_episode_cut_short_has_no_perfect_scores(env_id: str) -> None:
    vector = gym.make_vec(env_id, num_envs=2, max_episode_steps=10, autoreset_mode="SameStep")
    vector.reset(seed=0)
    for step in range(1, 11):
        *_, terminated, truncated, infos = vector.step(np.zeros(vector.action_space.shape, dtype=np.float32))
        assert not terminated.any()
        assert truncated.all() == (step == 10)
    final = infos["final_info"]
    assert not final["is_success"].any()
    for key, value in CUT[env_id].items():
        np.testing.assert_array_equal(final[key], [value] * 2, err_msg=key)


@pytest.mark.parametrize("env_id", CUT)
def test_a_time_limit_of_gymnasium_ends_with_the_same_info(env_id: str) -> None:
    settings = {"max_episode_steps": 10}
    vector, single = (
        gym.make_vec(env_id, num_envs=1, autoreset_mode="SameStep", **settings),
        gym.make(env_id, **settings),
    )
    vector.reset(seed=0)
    single.reset(seed=0)
    for step in range(1, 11):
        *_, infos = vector.step(np.zeros(vector.action_space.shape, dtype=np.float32))
        *_, truncated, info = single.step(np.zeros(single.action_space.shape, dtype=np.float32))
        known = info["goal_distance" if "goal_distance" in info else "peak_torque"]
        assert truncated == (not math.isnan(known)) == (step == 10)
    for key, value in info.items():
        np.testing.assert_array_equal(infos["final_info"][key][0], value, err_msg=key)


@pytest.mark.parametrize(("inner", "outer"), [(50, 5), (5, 50)])
def test_the_least_of_several_time_limits_ends_an_episode(inner: int, outer: int) -> None:
    env = gym.wrappers.TimeLimit(gym.make("ObstacleDodge-v0", max_episode_steps=inner), outer)
    env.reset(seed=0)
    state = env.unwrapped.get_state()  # type: ignore[attr-defined]
    for _ in range(2):
        still = np.zeros(env.action_space.shape or 0, np.float32)
        *_, truncated, info = [env.step(still) for _ in range(5)][-1]
        assert truncated
        assert info["min_clearance"] > 0.0
        env.unwrapped.set_state(state)  # type: ignore[attr-defined]


def test_truth_values_and_texts_are_no_numbers_in_settings() -> None:
    for name, given in {
        "horizon": "8",
        "mass_error": (True, 0.1),
        "latency": ("0", 0.01),
        "payload": [0.0, "1"],
    }.items():
        with pytest.raises(ValueError, match=f"{name} .* must be a number"):
            gym.make("ConveyorTrack-v0", **{name: given})


def test_an_excavator_episode_cut_while_judged_has_the_errors_so_far() -> None:
    finals = []
    for settings in ({"max_episode_steps": 300}, {}):
        vector = gym.make_vec(
            "ExcavatorPayload-v0", num_envs=1, autoreset_mode="SameStep", encoder_noise=0.0, **settings
        )
        expert = envs.make_expert("adaptive", vector)
        observation, _ = vector.reset(seed=0)
        infos: dict[str, Any] = {}
        while "final_info" not in infos:
            observation, *_, infos = vector.step(expert.predict(observation)[0])
        finals.append(infos["final_info"])
    cut, whole = finals
    assert 0.0 < cut["tip_max"][0] <= whole["tip_max"][0]
    assert not cut["is_success"][0]
