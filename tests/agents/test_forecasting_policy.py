"""The policy that dodges by forecasts, through the public door, and how good its forecasts are."""

from __future__ import annotations

from contextlib import closing
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from agents import Evaluation, evaluate
from agents.policies.forecasting import ForecastingDodger, load_forecaster
from agents.policies.forecasting.futures import PATHS, expect, going_on, knot_table
from agents.policies.forecasting.policy import Memory, aimed_move
from agents.policies.forecasting.track import follow_disc, new_tracks
from envs.obstacle_dodge.paths import PATH_STEP
from planners.apf.safety import STEP
from planners.typing import Array

ENV = "ObstacleDodge-v0"
SEEDS = np.arange(900_000, 900_030)
FORECASTER = load_forecaster()


def dodger(env: Any) -> ForecastingDodger:
    return ForecastingDodger(env.unwrapped.task, FORECASTER)


def episodes(seeds: Any = SEEDS, num_envs: int = 256, **env_config: Any) -> Evaluation:
    return evaluate(dodger, ENV, seeds, env_config=env_config, num_envs=num_envs)


@pytest.mark.parametrize("mode", ["torque", "acceleration", "velocity"])
def test_discs_are_dodged_within_the_limits_in_every_control_mode(mode: str) -> None:
    told = episodes(control_mode=mode)
    assert told.success.sum() >= 27
    assert told.metrics["limit_ratio"].max() <= 1.005


def test_more_are_dodged_than_with_the_fields_own_forecasts() -> None:
    seeds = np.arange(900_000, 900_150)
    assert episodes(seeds).success.sum() > evaluate("apf", ENV, seeds).success.sum()


def test_a_environment_is_bit_for_bit_the_episode_alone() -> None:
    batch, alone = episodes(SEEDS[:6]), episodes(SEEDS[:6], num_envs=1)
    np.testing.assert_array_equal(batch.returns, alone.returns)
    np.testing.assert_array_equal(batch.lengths, alone.lengths)
    with closing(gym.make(ENV)) as env:
        policy, observation = dodger(env), env.reset(seed=int(SEEDS[0]))[0]
        total, over = 0.0, False
        while not over:
            observation, reward, terminated, truncated, _ = env.step(policy.predict(observation)[0])
            total, over = total + float(reward), terminated or truncated
    assert total == batch.returns[0]


def actions_of(policy: ForecastingDodger, seeds: list[int], steps: int = 60, *, hand_back: bool) -> Array:
    """Actions of a batch, ``(steps, environments, 2)``, with the state handed back or remembered within."""
    taken, state = [], None
    with closing(gym.make_vec(ENV, num_envs=len(seeds))) as env:
        observation = env.reset(seed=seeds)[0]  # type: ignore[arg-type]  # a seed an environment
        for _ in range(steps):
            actions, told = policy.predict(observation, state=state)
            state = told if hand_back else None
            observation = env.step(actions)[0]
            taken.append(actions)
    return np.array(taken)


def test_state_handed_back_and_memory_within_give_the_same_actions_whatever_ran_before() -> None:
    with closing(gym.make_vec(ENV, num_envs=3)) as env:
        fresh = actions_of(dodger(env), [5, 6, 7], hand_back=True)
        policy = dodger(env)
        np.testing.assert_array_equal(actions_of(policy, [5, 6, 7], hand_back=False), fresh)
        actions_of(policy, [11, 12, 13], hand_back=False)
        np.testing.assert_array_equal(actions_of(policy, [5, 6, 7], hand_back=False), fresh)
        np.testing.assert_array_equal(actions_of(policy, [5, 9, 4], hand_back=False)[:, 0], fresh[:, 0])
    assert np.abs(fresh).max() > 0.1


def test_the_state_that_is_handed_back_is_not_changed() -> None:
    with closing(gym.make_vec(ENV, num_envs=2)) as env:
        policy, observation = dodger(env), env.reset(seed=[5, 6])[0]  # type: ignore[arg-type]
        _, state = policy.predict(observation)
        assert isinstance(state, Memory)
        kept, observation = state.copy(), env.step(np.zeros((2, 2), dtype=np.float32))[0]
        first, later = policy.predict(observation, state=state)
        np.testing.assert_array_equal(policy.predict(observation, state=state)[0], first)
        for name in ("field", "tracks", "moves"):
            np.testing.assert_array_equal(getattr(state, name), getattr(kept, name))
        assert (later.tracks["seen"] == 2).all()


def test_a_environment_that_begins_anew_forgets() -> None:
    with closing(gym.make_vec(ENV, num_envs=2)) as env:
        policy = dodger(env)
        state: Any = None
        observation = first = env.reset(seed=[5, 6])[0]  # type: ignore[arg-type]
        for _ in range(5):
            actions, state = policy.predict(observation, state=state)
            observation = env.step(actions)[0]
        mixed = np.stack([observation[0], first[1]])
        actions, state = policy.predict(mixed, state=state, episode_start=np.array([False, True]))
        np.testing.assert_array_equal(state.tracks["seen"], [6, 1])
        np.testing.assert_array_equal(actions[1], dodger(env).predict(first)[0][1])


def test_a_goal_at_the_end_of_the_arms_reach_is_tried() -> None:
    """Single precision may put such a goal just out of reach."""
    with closing(gym.make(ENV)) as env:
        policy = dodger(env)
        for goal in ((0.6, 0.8), (-0.8, 0.6)):
            observation, _ = env.reset(seed=1, options={"goal": goal})
            assert np.isfinite(policy.predict(observation)[0]).all()


@pytest.mark.parametrize(
    ("env_id", "settings", "complaint"),
    [
        ("ConveyorTrack-v0", {}, f"knows the discs of {ENV}; ConveyorTrack-v0 has none"),
        (ENV, {"num_obstacles": 2}, "num_obstacles 1 and control_period 0.02 s, not 2 and 0.02 s; leave them out"),
        (ENV, {"control_period": 0.01}, r"not 1 and 0\.01 s; leave them out"),
    ],
)
def test_other_tasks_are_refused(env_id: str, settings: dict[str, Any], complaint: str) -> None:
    with closing(gym.make(env_id, **settings)) as env, pytest.raises(ValueError, match=complaint):
        dodger(env)


def errors_of_forecasts(seeds: range, seconds: float) -> dict[str, Array]:
    """Distances of forecasts from where the discs go, m: of going on, of the likeliest path and of the best one."""
    steps = round(seconds / STEP)
    places, weights, table = np.empty((PATHS, steps, 2)), np.empty(PATHS), knot_table(steps)
    errors: dict[str, list[float]] = {"going_on": [], "likeliest": [], "best": []}
    with closing(gym.make_vec(ENV, num_envs=len(seeds))) as env:
        observations = env.reset(seed=list(seeds))[0]  # type: ignore[arg-type]
        task: Any = env.unwrapped.task  # type: ignore[attr-defined]
        for env_index, observation in enumerate(observations):
            problem = task.motion_problem(observation)
            move = aimed_move(problem.arm, problem.joint_limits, problem.q, problem.target.position)
            path, track = task.obstacle_path(env_index)[:, 0] - problem.arm.base_array, new_tracks(1)[0]
            for now in range(0, 300, 2):
                since = max(now, 1)
                seen = np.array([path[now], (path[since] - path[since - 1]) / PATH_STEP], dtype=np.float32).astype(
                    float
                )
                follow_disc(track, move, *seen)
                if now % 20 == 0:
                    expect(track, move, FORECASTER.network, table, places, weights)
                    there = path[now + round(seconds / PATH_STEP)]
                    apart = np.hypot(*(places[:, -1] - there).T)
                    errors["going_on"].append(float(np.hypot(*(np.array(going_on(track, seconds)) - there))))
                    errors["likeliest"].append(float(apart[weights.argmax()]))
                    errors["best"].append(float(apart.min()))
    return {name: np.array(found) for name, found in errors.items()}


@pytest.mark.parametrize(("seconds", "likeliest", "best"), [(1.0, 0.7, 0.4), (2.0, 0.55, 0.3)])
def test_forecasts_are_better_than_that_a_disc_goes_on(seconds: float, likeliest: float, best: float) -> None:
    errors = errors_of_forecasts(range(900_000, 900_200), seconds)
    going_on = errors["going_on"]
    assert going_on.mean() > 0.2 * seconds
    assert errors["likeliest"].mean() < likeliest * going_on.mean()
    assert np.median(errors["likeliest"]) < 0.5 * np.median(going_on)
    assert errors["best"].mean() < best * going_on.mean()
