"""The vector environment returns what Gymnasium's SyncVectorEnv of single environments returns, in every mode."""

from __future__ import annotations

from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import envs
from envs.vector_environment import PlanarArmVectorEnv

N = 4
SHORT: dict[str, dict[str, Any]] = {
    "ConveyorTrack-v0": {"horizon": 1.6},
    "MinTorqueMove-v0": {"horizon": 0.5},
    "ObstacleDodge-v0": {"horizon": 0.5},
    "ExcavatorPayload-v0": {"horizon": 1.0},
}
every_env = pytest.mark.parametrize("env_id", SHORT)
every_mode = pytest.mark.parametrize("mode", AutoresetMode)


def assert_same(ours: Any, theirs: Any, place: str = "") -> None:
    """Equal to the bit, in kind and in shape."""
    if isinstance(theirs, dict):
        assert ours.keys() == theirs.keys(), place
        for key, value in theirs.items():
            assert_same(ours[key], value, f"{place}/{key}")
    elif isinstance(theirs, np.ndarray) and theirs.dtype == object:
        assert ours.dtype == object, place
        for one, other in zip(ours, theirs, strict=True):
            assert_same(one, other, place)
    elif isinstance(theirs, np.ndarray):
        assert (type(ours), ours.dtype, ours.shape) == (np.ndarray, theirs.dtype, theirs.shape), place
        np.testing.assert_array_equal(ours, theirs, err_msg=place)
    else:
        assert ours is theirs is None, place


def pair(env_id: str, mode: AutoresetMode, limit: int | None, **settings: Any) -> tuple[Any, Any]:
    """The batch, and Gymnasium's loop over single environments."""
    settings = {"max_episode_steps": limit, **SHORT[env_id], **settings}
    single = partial(gym.make, env_id, disable_env_checker=True, **settings)
    return gym.make_vec(env_id, N, autoreset_mode=mode, **settings), SyncVectorEnv([single] * N, autoreset_mode=mode)


def actions_of(vector: Any, steps: int) -> np.ndarray[Any, Any]:
    """Small in some environments and large in others, so that episodes end at different times."""
    size = np.linspace(0.05, 2.0, N)[:, None]
    drawn = size * np.random.default_rng(0).uniform(-1.0, 1.0, (steps, *vector.action_space.shape))
    return drawn.astype(np.float32)  # type: ignore[no-any-return]


@every_env
@every_mode
@pytest.mark.parametrize("limit", [None, 7])
def test_everything_returned_equals_a_loop_over_single_environments(
    env_id: str, mode: AutoresetMode, limit: int | None
) -> None:
    ours, theirs = pair(env_id, mode, limit)
    assert ours.metadata["autoreset_mode"] is ours.autoreset_mode is mode
    assert_same(ours.reset(seed=3)[0], theirs.reset(seed=3)[0])
    ends, shown = np.zeros(N, dtype=int), [vector.reset(seed=5) for vector in (ours, theirs)]
    assert_same(*map(list_of, shown))
    for step, action in enumerate(actions_of(ours, 130)):
        results = [vector.step(action) for vector in (ours, theirs)]
        assert_same(*map(list_of, results), place=f"step {step}")
        over = results[0][2] | results[0][3]
        ends += over
        if mode == AutoresetMode.DISABLED and over.any():
            shown = [vector.reset(options={"reset_mask": over.copy()}) for vector in (ours, theirs)]
            assert_same(*map(list_of, shown), place=f"reset after step {step}")
    assert ends.min() >= 1
    assert ends.max() >= 2 or not limit


def list_of(results: tuple[Any, ...]) -> dict[str, Any]:
    return {str(place): result for place, result in enumerate(results)}


@every_mode
def test_resets_in_the_middle_of_episodes_equal_those_of_the_loop(mode: AutoresetMode) -> None:
    ours, theirs = pair("ObstacleDodge-v0", mode, 9)
    rng, over = np.random.default_rng(1), np.zeros(N, dtype=bool)
    for vector in (ours, theirs):
        vector.reset(seed=0)
    for step, action in enumerate(actions_of(ours, 60)):
        mask = rng.random(N) < 0.15
        if mode == AutoresetMode.DISABLED:
            mask |= over
        if mask.any():
            seeds = [int(seed) if drawn else None for seed, drawn in zip(rng.integers(99, size=N), mask, strict=True)]
            shown = [vector.reset(seed=seeds, options={"reset_mask": mask.copy()}) for vector in (ours, theirs)]
            assert_same(*map(list_of, shown), place=f"reset before step {step}")
        results = [vector.step(action) for vector in (ours, theirs)]
        assert_same(*map(list_of, results), place=f"step {step}")
        over = results[0][2] | results[0][3]


@pytest.mark.parametrize("num_envs", [70, 200])  # on several threads
def test_batches_on_threads_begin_their_next_episodes_one_by_one(num_envs: int) -> None:
    shown = []
    for threads in (1, 3):
        vector: Any = gym.make_vec("ObstacleDodge-v0", num_envs, horizon=0.5)
        vector.unwrapped.task._threads = threads
        vector.reset(seed=0)
        size = np.linspace(0.05, 2.0, num_envs)[:, None]
        rng = np.random.default_rng(0)
        shown.append([vector.step((size * rng.uniform(-1.0, 1.0, (num_envs, 2))).astype("f4")) for _ in range(60)])
        vector.close()
    ended = np.array([result[2] | result[3] for result in shown[0]])
    assert (ended.sum(axis=1) % num_envs != 0).sum() > 3
    for one, other in zip(*shown, strict=True):
        assert_same(*map(list_of, (one, other)))


def test_an_episode_that_is_over_waits_for_its_reset_when_nothing_resets() -> None:
    vector = gym.make_vec("MinTorqueMove-v0", 2, autoreset_mode="Disabled", max_episode_steps=2)
    actions = np.zeros((2, 3), dtype=np.float32)
    vector.reset(seed=0)
    vector.step(actions)
    vector.reset(options={"reset_mask": np.array([False, True])})
    *_, truncated, _ = vector.step(actions)
    assert truncated.tolist() == [True, False]
    before = vector.unwrapped.task.batch.tobytes()  # type: ignore[attr-defined]
    with pytest.raises(gym.error.ResetNeeded, match=r"episodes of environments \[0\] are over: call reset"):
        vector.step(actions)
    assert vector.unwrapped.task.batch.tobytes() == before  # type: ignore[attr-defined]
    vector.reset(options={"reset_mask": truncated})
    vector.step(actions)


def test_the_action_of_an_environment_that_begins_its_next_episode_is_not_read() -> None:
    vector = gym.make_vec("MinTorqueMove-v0", 2, max_episode_steps=1)
    vector.reset(seed=0)
    vector.step(np.zeros((2, 3), dtype=np.float32))
    _, rewards, *_, infos = vector.step(np.full((2, 3), np.nan, dtype=np.float32))
    assert rewards.tolist() == [0.0, 0.0]
    assert np.isnan(infos["reward_effort"]).all()
    with pytest.raises(ValueError, match="not finite"):
        vector.step(np.full((2, 3), np.nan, dtype=np.float32))


@pytest.mark.parametrize(
    ("given", "mode"),
    [
        (None, AutoresetMode.NEXT_STEP),
        ("NextStep", AutoresetMode.NEXT_STEP),
        ("SameStep", AutoresetMode.SAME_STEP),
        ("DISABLED", AutoresetMode.DISABLED),
    ],
)
def test_the_mode_is_given_by_itself_its_value_or_its_name(given: str | None, mode: AutoresetMode) -> None:
    vector: Any = gym.make_vec("MinTorqueMove-v0", 2, **({} if given is None else {"autoreset_mode": given}))
    assert vector.autoreset_mode is vector.metadata["autoreset_mode"] is mode
    assert PlanarArmVectorEnv.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    again: Any = gym.make_vec(vector.spec)
    assert again.autoreset_mode is mode


@pytest.mark.parametrize(("given", "complaint"), [("SameStpe", 'did you mean "SameStep"'), (1, "must be one of")])
def test_another_mode_is_refused(given: Any, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        gym.make_vec("MinTorqueMove-v0", 2, autoreset_mode=given)


@every_env
def test_infos_have_the_same_flat_keys_at_every_step(env_id: str) -> None:
    env = gym.make(env_id, disable_env_checker=True, **SHORT[env_id])
    kinds, task = set(), env.unwrapped.task  # type: ignore[attr-defined]
    _, info = env.reset(seed=0)
    terms = {f"reward_{name}" for name in task.reward_terms}
    assert info.keys() == {"is_success", *terms, *task.outcomes, "limit_ratio", "limit_ratios"}
    known = {key for key, value in info.items() if not np.any(np.isnan(value)) and value is not False}
    assert known == {"limit_ratio", "limit_ratios"}  # of what has been so far
    over = False
    while not over:
        kinds.add(tuple((key, np.asarray(value).dtype, np.shape(value)) for key, value in info.items()))
        _, reward, terminated, truncated, info = env.step(np.zeros(env.action_space.shape, dtype=np.float32))
        over = terminated or truncated
        assert np.isnan(info["peak_torque" if "peak_torque" in info else "goal_distance"]) != over
        assert info["limit_ratio"] == info["limit_ratios"].max()
        assert sum(info[term] for term in terms) == pytest.approx(reward, abs=1e-12)
    kinds.add(tuple((key, np.asarray(value).dtype, np.shape(value)) for key, value in info.items()))
    assert len(kinds) == 1
    assert info["limit_ratio"] == info["limit_ratios"].max()


def test_an_outcome_that_is_not_as_declared_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    env = gym.make("MinTorqueMove-v0", max_episode_steps=1, disable_env_checker=True)
    task: Any = env.unwrapped.task  # type: ignore[attr-defined]
    outcome = task.outcome
    for more, complaint in (({"extra": 1.0}, "make the keys the same"), ({"torque_l1": True}, "boolean_outcomes")):
        monkeypatch.setattr(task, "outcome", lambda record, more=more: outcome(record) | more)
        env.reset(seed=0)
        with pytest.raises(ValueError, match=complaint):
            env.step(np.zeros(3, dtype=np.float32))


@every_env
@pytest.mark.parametrize("limit", [-1, None])
def test_no_limit_of_steps_is_none_or_minus_one(env_id: str, limit: int | None) -> None:
    vector = gym.make_vec(env_id, 1, max_episode_steps=limit, **SHORT[env_id])
    single = gym.make(env_id, max_episode_steps=limit, **SHORT[env_id])
    for one in (vector, single):
        one.reset(seed=0)
    over, steps = False, 0
    while not over:
        steps += 1
        *_, terminated, truncated, _ = single.step(np.zeros(single.action_space.shape, dtype=np.float32))
        *_, vector_truncated, _ = vector.step(np.zeros(vector.action_space.shape, dtype=np.float32))
        over = terminated or truncated
        assert vector_truncated[0] == truncated
    assert steps > 10


def test_the_limit_of_a_registered_id_applies_to_the_batch_too() -> None:
    spec = gym.spec("MinTorqueMove-v0")
    gym.register(
        "Shorter-v0",
        entry_point=spec.entry_point,
        vector_entry_point=spec.vector_entry_point,
        max_episode_steps=3,
        kwargs=spec.kwargs,
    )
    try:
        for env in (gym.make_vec("Shorter-v0", 1), gym.make("Shorter-v0")):
            env.reset(seed=0)
            ends = [bool(env.step(np.zeros(env.action_space.shape, dtype=np.float32))[3]) for _ in range(3)]
            assert ends == [False, False, True]
    finally:
        del gym.registry["Shorter-v0"]


def test_an_id_of_every_task_is_covered() -> None:
    assert set(SHORT) == set(envs.env_ids())
