"""Experts keep the limits in every control mode and period, and follow no plan of an episode before."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import agents
import envs

BELT = "ConveyorTrack-v0"


@pytest.mark.parametrize("expert", ["dpct", "lagrange", "apf"])
@pytest.mark.parametrize("period", [0.004, 0.002])
def test_short_control_periods_make_no_jerk_of_rounding(expert: str, period: float) -> None:
    scores = agents.evaluate(expert, BELT, range(3), env_config={"control_period": period})
    assert scores.success.all()
    assert scores.metrics["limit_ratio"].max() < 1.005


@pytest.mark.parametrize("expert", ["dpct", "lagrange", "apf"])
def test_motions_by_velocities_leave_what_the_environment_cuts_off(expert: str) -> None:
    scores = agents.evaluate(expert, BELT, range(3_000_000, 3_000_016), env_config={"control_mode": "velocity"})
    assert scores.success.all()
    assert scores.metrics["limit_ratio"].max() < 1.001


@pytest.mark.parametrize("latency", [0.04, (0.0, 0.02)])
@pytest.mark.parametrize("expert", ["dpct", "lagrange", "apf", "follower"])
def test_an_accelerating_belt_is_met_by_torques_that_come_late(expert: str, latency: object) -> None:
    scores = agents.evaluate(expert, BELT, range(3), env_config={"belt_acceleration": 0.05, "latency": latency})
    assert scores.success.all()


@pytest.mark.parametrize("task", [BELT, "ObstacleDodge-v0"])
def test_an_action_of_one_is_the_velocity_that_is_documented(task: str) -> None:
    env = gym.make(task, control_mode="velocity")
    env.reset(seed=0)
    for _ in range(40):
        env.step(np.array([0.1, 0.0], np.float32))
    top = env.unwrapped.task.arm.limits.array("velocity")[0]  # type: ignore[attr-defined]
    assert env.unwrapped.joint_state()[1][0] == pytest.approx(0.0998 * top, rel=1e-3)  # type: ignore[attr-defined]


@pytest.mark.parametrize("expert", ["dpct", "lagrange"])
@pytest.mark.parametrize("settings", [{}, {"payload": (0.0, 0.2)}, {"encoder_noise": 5e-5}])
def test_a_move_of_as_many_periods_as_were_left_of_another_is_a_new_one(expert: str, settings: dict[str, Any]) -> None:
    env = gym.make("MinTorqueMove-v0", **settings)
    policy, lengths = envs.make_expert(expert, env), []
    for seed in (20, 11):
        observation, _ = env.reset(seed=seed)
        lengths.append(int(env.unwrapped.task.batch["duration_steps"][0]))  # type: ignore[attr-defined]
    for _ in range(lengths[1] - lengths[0]):
        observation, *_ = env.step(policy.predict(observation)[0])
    observation, _ = env.reset(seed=20)
    ended = False
    while not ended:
        observation, _, terminated, truncated, info = env.step(policy.predict(observation)[0])
        ended = terminated or truncated
    assert info["is_success"]


@pytest.mark.parametrize("task", envs.env_ids())
def test_a_state_of_something_else_is_refused_in_a_sentence(task: str) -> None:
    uncertain = envs.task_card(task).at_level("uncertain", {}, {})[0]
    for settings in ({}, uncertain):
        env = gym.make(task, **settings)
        observation, _ = env.reset(seed=0)
        for name in envs.task_card(task).experts:
            expert = envs.make_expert(name, env)
            _, own = expert.predict(observation)
            for junk in ("junk", 3, object(), (1, 2), {}):
                with pytest.raises(ValueError, match="none that this expert has returned"):
                    expert.predict(observation, junk)
            expert.predict(observation, own)


def test_dpct_meets_the_belt_under_all_uncertainty_by_jerks() -> None:
    settings, options = envs.task_card(BELT).at_level("uncertain", {"control_mode": "jerk"}, {})
    seeds = [3_000_017, 3_000_019, 3_000_027, 3_000_037, 3_000_043]  # it met none of them
    scores = agents.evaluate("dpct", BELT, seeds, env_config=settings, options=options)
    assert scores.success.all()
    assert scores.metrics["limit_ratio"].max() < 1.005
