"""Agents of the belt under uncertainty: they act on estimates, unless they were trained with uncertainty."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import agents
import envs
from agents.evaluation.evaluate import evaluate
from agents.policies.agent import Agent
from agents.training.batches.estimates import OnEstimates
from envs.conveyor_track.filtered import FilteredPolicy

BELT, LEVEL = "ConveyorTrack-v0", "noise"


def noisy(**more: Any) -> dict[str, Any]:
    return {**envs.task_card(BELT).levels[LEVEL].settings, "control_mode": "jerk", **more}


def scored(policy: Any, **settings: Any) -> Any:
    return evaluate(policy, BELT, np.arange(16), env_config=noisy(**settings), num_envs=16)


class Raw:
    """An agent that sees the noise."""

    def __init__(self) -> None:
        self._agent = agents.load_agent(BELT)

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> Any:
        return self._agent.predict(observation)


def test_the_agent_meets_the_part_within_all_limits_in_spite_of_noise() -> None:
    result = scored(agents.load_agent(BELT))
    assert result.success.mean() >= 15 / 16
    assert (result.metrics["limit_ratio"] <= 1.005).all()
    assert not scored(Raw()).success.any()


def test_it_settles_with_a_higher_return_than_what_it_clones() -> None:
    own = scored(agents.load_agent(BELT)).returns
    assert np.mean(own - scored("apf", control_mode="torque").returns) > 0.0


@pytest.mark.parametrize("level", ["noise", "uncertain"])
def test_it_is_trained_in_what_it_acts_in(level: str) -> None:
    """Rewards of the network in `OnEstimates`, over the end of an episode, are those of the agent."""
    agent, settings = agents.load_agent(BELT), {**envs.task_card(BELT).levels[level].settings, "control_mode": "jerk"}
    own, trained = (gym.make_vec(BELT, 3, autoreset_mode="SameStep", **settings) for _ in range(2))
    on_estimates = OnEstimates(trained)
    policy, state, starts = agent.for_env(own), None, np.ones(3, dtype=bool)
    (seen, _), (estimated, _) = own.reset(seed=2), on_estimates.reset(seed=2)
    ends = 0
    for _ in range(310):
        actions, state = policy.predict(seen, state, episode_start=starts)
        seen, rewards, _, starts, _ = own.step(actions)
        estimated, others, _, truncated, infos = on_estimates.step(agent.network_actions(estimated))
        np.testing.assert_array_equal(rewards, others)
        np.testing.assert_array_equal(starts, truncated)
        if truncated.any():
            ends += 1
            shapes = [final.shape for final in infos["final_obs"]]
            assert shapes == [estimated[0].shape] * 3
            assert not np.array_equal(np.stack(infos["final_obs"]), estimated)
    assert ends == 2


@pytest.mark.parametrize("level", ["noise", "uncertain"])
def test_single_and_vector_environments_give_the_same_bits(level: str) -> None:
    agent, settings = agents.load_agent(BELT), {**envs.task_card(BELT).levels[level].settings, "control_mode": "jerk"}
    vector: Any = gym.make_vec(BELT, num_envs=3, **settings)
    policy, (observations, _), state = agent.for_env(vector), vector.reset(seed=5), None
    alone: list[Any] = [gym.make(BELT, **settings) for _ in range(3)]
    singles = [[agent.for_env(env), env.reset(seed=5 + i)[0], None] for i, env in enumerate(alone)]
    for _ in range(40):
        actions, state = policy.predict(observations, state)
        observations, *_ = vector.step(actions)
        for index, (env, one) in enumerate(zip(alone, singles, strict=True)):
            action, one[2] = one[0].predict(one[1], one[2])
            assert np.array_equal(action, actions[index])
            one[1], *_ = env.step(action)


@pytest.mark.parametrize(
    "trained", [{"env_config": noisy()}, {"training": {"config": {"levels": ["noise"]}}}], ids=["settings", "level"]
)
def test_an_agent_that_was_trained_with_noise_sees_it(trained: dict[str, Any]) -> None:
    shipped = agents.load_agent(BELT)
    agent = Agent({**shipped.document, **trained}, shipped.tensors)
    with gym.make(BELT, **noisy()) as env:
        assert agent.for_env(env) is agent
        assert shipped.for_env(env) is not shipped
    with gym.make(BELT, control_mode="jerk") as env:
        assert shipped.for_env(env) is shipped


def test_an_agent_of_levels_without_uncertainty_acts_on_estimates_too() -> None:
    agent = agents.load_agent(BELT, "wide")
    assert agent.levels
    assert isinstance(agent.for_env(gym.make(BELT, **noisy())), FilteredPolicy)
    assert agent.for_env(gym.make(BELT, control_mode="jerk")) is agent
