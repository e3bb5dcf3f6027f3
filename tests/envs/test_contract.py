"""What every environment promises, with every expert, through the public door."""

from __future__ import annotations

import multiprocessing
import pickle
import re
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.utils.env_match import check_environments_match

import envs
from envs.experts import expert_names

MODES = {env_id: envs.task_card(env_id).control_modes for env_id in envs.env_ids()}

every_env = pytest.mark.parametrize("env_id", MODES)
every_mode = pytest.mark.parametrize(
    ("env_id", "control_mode"), [(env_id, mode) for env_id, modes in MODES.items() for mode in modes]
)


def roll_out(env: gym.Env[Any, Any], seed: int, expert_name: str | None = None) -> list[Any]:
    """Everything one episode shows."""
    cheap = expert_names(env.unwrapped.task.env_id)[-2]  # type: ignore[attr-defined]
    expert = envs.make_expert(expert_name or cheap, env)
    observation, info = env.reset(seed=seed)
    shown: list[Any] = [observation, info]
    state, start, over = None, np.ones(1, dtype=bool), False
    while not over:
        action, state = expert.predict(observation, state, start)
        start[:] = False
        observation, reward, terminated, truncated, info = env.step(action)
        shown += [observation, reward, terminated, truncated, info]
        over = terminated or truncated
    return shown


def observations(env: gym.Env[Any, Any], actions: list[Any]) -> list[Any]:
    """What is observed after each action, to the last of them or of the episode."""
    seen = []
    for action in actions:
        observation, _, terminated, truncated, _ = env.step(action)
        seen.append(observation)
        if terminated or truncated:
            break
    return seen


def same(one: list[Any], other: list[Any]) -> bool:
    return pickle.dumps(one) == pickle.dumps(other)


@every_mode
def test_gymnasium_check(env_id: str, control_mode: str) -> None:
    env = gym.make(env_id, control_mode=control_mode, render_mode="rgb_array")
    check_env(env.unwrapped)


@pytest.mark.parametrize(
    ("env_id", "control_mode", "name"),
    [(env_id, mode, name) for env_id, modes in MODES.items() for mode in modes for name in expert_names(env_id)],
)
def test_an_expert_finishes_an_episode(env_id: str, name: str, control_mode: str) -> None:
    env = gym.make(env_id, control_mode=control_mode)
    shown = roll_out(env, 11, name)
    rewards, last = shown[3::5], shown[-1]
    assert np.isfinite(rewards).all()
    assert {"is_success", "limit_ratio", "limit_ratios"} <= last.keys()
    for observation in shown[2::5]:
        assert env.observation_space.contains(observation)
    for reward, info in zip(rewards, shown[6::5], strict=True):
        assert reward == pytest.approx(
            sum(value for key, value in info.items() if key.startswith("reward_")), abs=1e-12
        )
    assert same(shown, roll_out(gym.make(env_id, control_mode=control_mode), 11, name))


@every_env
def test_a_seed_gives_the_same_bits_after_an_unrelated_episode(env_id: str) -> None:
    fresh, used = gym.make(env_id), gym.make(env_id)
    roll_out(used, 99, "random")
    used.reset(seed=5)
    used.step(np.ones(used.action_space.shape, dtype=np.float32))
    assert same(roll_out(used, 3), roll_out(fresh, 3))


@every_env
def test_no_observation_is_touched_later(env_id: str) -> None:
    env = gym.make(env_id)
    env.action_space.seed(0)
    first, _ = env.reset(seed=0)
    kept = first.copy()
    second, *_ = env.step(0.1 * env.action_space.sample())  # a large one may end the episode
    kept_second = second.copy()
    env.step(0.1 * env.action_space.sample())
    np.testing.assert_array_equal(first, kept)
    np.testing.assert_array_equal(second, kept_second)


@every_env
def test_every_element_varies(env_id: str) -> None:
    env = gym.make(env_id)
    env.action_space.seed(0)
    seen = []
    for seed in range(3):
        seen.append(env.reset(seed=seed)[0])
        seen += observations(env, [env.action_space.sample() for _ in range(20)])
    varies = np.ptp(np.array(seen), axis=0) > 0.0
    layout = env.unwrapped.task.layout  # type: ignore[attr-defined]
    for entry, place in layout.slices():
        if entry.name not in envs.task_card(env_id).constant_entries:
            assert varies[place].any(), entry.name


@every_env
def test_unseeded_resets_differ(env_id: str) -> None:
    env = gym.make(env_id)
    env.reset(seed=0)
    one, other = env.reset()[0], env.reset()[0]
    assert (one != other).any()


@every_env
def test_step_wants_a_reset(env_id: str) -> None:
    env = gym.make(env_id, disable_env_checker=True).unwrapped
    with pytest.raises(gym.error.ResetNeeded, match="call reset"):
        env.step(np.zeros(env.action_space.shape, dtype=np.float32))
    roll_out(env, 0)
    with pytest.raises(gym.error.ResetNeeded, match="call reset"):
        env.step(np.zeros(env.action_space.shape, dtype=np.float32))


@every_env
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_an_action_that_is_not_finite_moves_nothing(env_id: str, bad: float) -> None:
    env = gym.make(env_id)
    env.reset(seed=0)
    q, qd = env.unwrapped.joint_state()  # type: ignore[attr-defined]
    action = np.zeros(env.action_space.shape, dtype=np.float32)
    action[-1] = bad
    with pytest.raises(ValueError, match="is not finite"):
        env.step(action)
    after = env.unwrapped.joint_state()  # type: ignore[attr-defined]
    np.testing.assert_array_equal(after, (q, qd))


@every_mode
def test_a_larger_action_is_clipped(env_id: str, control_mode: str) -> None:
    ends = []
    for size in (1.0, 7.5):
        env = gym.make(env_id, control_mode=control_mode)
        env.reset(seed=0)
        ends.append(observations(env, [np.full(env.action_space.shape, size, dtype=np.float32)] * 5))
    np.testing.assert_array_equal(*ends)


@every_env
def test_pickled_and_made_again_environments_are_equal(env_id: str) -> None:
    env = gym.make(env_id, horizon=2.5)
    copy = pickle.loads(pickle.dumps(env.unwrapped))
    assert copy.task.config == env.unwrapped.task.config  # type: ignore[attr-defined]
    assert same(roll_out(copy, 4), roll_out(env.unwrapped, 4))


@every_env
def test_closing_twice(env_id: str) -> None:
    env = gym.make(env_id, render_mode="rgb_array")
    env.reset(seed=0)
    env.render()
    env.close()
    env.unwrapped.close()
    vector = gym.make_vec(env_id, num_envs=2)
    vector.close()
    vector.close()


@every_env
def test_the_module_can_be_named_in_the_id(env_id: str) -> None:
    check_environments_match(gym.make(f"envs:{env_id}"), gym.make(env_id), 20, seed=1)


def _first_observations(env_id: str, method: str) -> np.ndarray[Any, Any]:
    async_envs = gym.vector.AsyncVectorEnv([lambda: gym.make(f"envs:{env_id}")] * 2, context=method)
    try:
        return async_envs.reset(seed=3)[0].copy()  # type: ignore[no-any-return]
    finally:
        async_envs.close()


@every_env
@pytest.mark.parametrize("method", ["spawn", "forkserver"])
def test_workers(env_id: str, method: str) -> None:
    assert method in multiprocessing.get_all_start_methods()
    first = _first_observations(env_id, method)
    for env_index in range(2):
        np.testing.assert_array_equal(first[env_index], gym.make(env_id).reset(seed=3 + env_index)[0])


@every_env
def test_the_recorders_work(env_id: str) -> None:
    env = gym.wrappers.RecordEpisodeStatistics(gym.make(env_id))
    shown = roll_out(env, 0)
    assert shown[-1]["episode"]["r"] == pytest.approx(sum(shown[3::5]))
    vector = gym.wrappers.vector.RecordEpisodeStatistics(gym.make_vec(env_id, num_envs=3))
    vector.reset(seed=0)
    infos: dict[str, Any] = {}
    while "episode" not in infos:
        *_, infos = vector.step(np.zeros(vector.action_space.shape, dtype=np.float32))
    assert infos["_episode"].any()
    assert np.isfinite(infos["episode"]["r"]).all()


@every_env
def test_an_unknown_setting_is_refused_with_the_nearest_name(env_id: str) -> None:
    with pytest.raises(ValueError, match=rf'unknown {env_id} setting "contol_mode"; did you mean "control_mode"'):
        gym.make(env_id, contol_mode="jerk")


@every_env
def test_an_unknown_option_is_refused_and_changes_nothing(env_id: str) -> None:
    env = gym.make(env_id)
    before, _ = env.reset(seed=0)
    with pytest.raises(ValueError, match='did you mean "scenario"'):
        env.reset(options={"senario": "paper"})
    assert (env.unwrapped.motion_problem().q == env.unwrapped.motion_problem().q).all()  # type: ignore[attr-defined]
    np.testing.assert_array_equal(env.unwrapped.task.batch["observation"][0], before)  # type: ignore[attr-defined]


@every_env
@pytest.mark.parametrize(
    ("setting", "value", "complaint"),
    [
        ("payload", -0.1, "payload = -0.1"),
        ("physics_step", 0.003, "no multiple of physics_step 0.003 s"),
        ("control_mode", "speed", "control_mode = 'speed'"),
        ("horizon", 0.013, "horizon 0.013 s is no multiple of control_period"),
    ],
)
def test_a_bad_setting_is_refused(env_id: str, setting: str, value: object, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        gym.make(env_id, **{setting: value})


@every_env
def test_the_kernels_and_the_docstring_have_every_setting(env_id: str) -> None:
    env: Any = gym.make(env_id, horizon=2.5).unwrapped
    config, model = env.task.config, env.task.model
    for name, value in config.numbers().items():
        assert model[name] == value
    assert type(config).table() in type(env).__doc__
    assert set(env.reset(seed=0)[1]) <= set(re.findall(r"^\| `(\w+)`", type(env).__doc__, flags=re.MULTILINE))


@every_env
def test_experts_refuse_other_environments(env_id: str) -> None:
    with pytest.raises(ValueError, match="not one of planarm's"):
        envs.make_expert("random", gym.make("CartPole-v1"))
    with pytest.raises(ValueError, match=f'unknown {env_id} expert "randon"; did you mean "random"'):
        envs.make_expert("randon", gym.make(env_id))
