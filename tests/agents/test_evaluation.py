"""`agents.evaluate`: one episode a seed, equal to a loop by hand, whatever the batching."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import agents
import envs
from agents.evaluation.evaluate import Evaluation
from agents.policies.policy import Policy
from envs.physics.actuation import LIMIT_KINDS

ENV_ID = "ConveyorTrack-v0"


class Linear:
    """A policy of some character that remembers nothing, and the first observations it saw."""

    def __init__(self, gain: float = 1.0) -> None:
        self.weights = gain * np.random.default_rng(0).normal(size=(18, 2)) / 10.0
        self.first: list[Any] = []

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = False
    ) -> tuple[Any, Any]:
        if state is None:
            self.first.append(observation.copy())
        # Element by element: the sums must not depend on how many environments there are.
        action = np.stack([(observation * column).sum(axis=1) for column in self.weights.T], axis=1)
        return np.tanh(action).astype(np.float32), 0


def by_hand(policy: Policy | str, seed: int, options: dict[str, Any], **config: Any) -> dict[str, Any]:
    env = gym.make(ENV_ID, **config)
    actor = envs.make_expert(policy, env) if isinstance(policy, str) else policy
    observation, _ = env.reset(seed=seed, options=options)
    state, total, steps, ended, begins = None, 0.0, 0, False, True
    while not ended:
        actions, state = actor.predict(observation[None], state, np.array([begins]), True)
        observation, reward, terminated, truncated, info = env.step(actions[0])
        total, steps, ended, begins = total + float(reward), steps + 1, terminated or truncated, False
    env.close()
    return {"return": total, "length": steps, **info}


def flat(evaluation: Evaluation) -> dict[str, Any]:
    return {"return": evaluation.returns, "length": evaluation.lengths, **evaluation.metrics}


@pytest.mark.parametrize("policy", [Linear(), "dpct", "follower"])
@pytest.mark.parametrize(
    ("config", "options"), [({}, {}), ({"control_mode": "jerk"}, {}), ({"horizon": 2.0}, {"elbow": "+"})]
)
def test_equals_a_loop_by_hand_bit_for_bit(
    policy: Policy | str, config: dict[str, Any], options: dict[str, Any]
) -> None:
    seeds = [5, 3, 11, 4]
    evaluation = agents.evaluate(policy, ENV_ID, seeds, env_config=config, options=options, num_envs=3)
    for episode, seed in enumerate(seeds):
        wanted = by_hand(policy, seed, options, **config)
        ratios = wanted.pop("limit_ratios")
        wanted = {key: value for key, value in wanted.items() if not key.startswith("reward_")}
        wanted |= {f"limit_ratios/{kind}": ratio for kind, ratio in zip(LIMIT_KINDS, ratios, strict=True)}
        assert {key: values[episode] for key, values in flat(evaluation).items()} == wanted


@pytest.mark.parametrize("policy", ["dpct", "follower"])
def test_number_of_environments_changes_nothing(policy: str) -> None:
    one, many = (agents.evaluate(policy, ENV_ID, range(5), num_envs=num_envs) for num_envs in (1, 256))
    for key, values in flat(one).items():
        np.testing.assert_array_equal(values, flat(many)[key], err_msg=key)


def test_every_policy_meets_the_same_starts() -> None:
    gentle, fierce = Linear(0.1), Linear(10.0)
    for policy in (gentle, fierce):
        agents.evaluate(policy, ENV_ID, range(7), num_envs=4)
    np.testing.assert_array_equal(np.concatenate(gentle.first), np.concatenate(fierce.first))
    assert len(np.unique(np.concatenate(gentle.first), axis=0)) == 7


def test_the_papers_start_is_the_same_for_every_seed() -> None:
    policy = Linear()
    agents.evaluate(policy, ENV_ID, range(3), options={"scenario": "paper"})
    assert len(np.unique(policy.first[0], axis=0)) == 1


def test_progress_counts_the_episodes() -> None:
    reported: list[int] = []
    agents.evaluate(Linear(), ENV_ID, range(7), num_envs=3, progress=reported.append)
    assert reported == [3, 3, 1]


class Planner(Linear):
    """Plans in its first call, and says that it took no longer than it did."""

    plans_made, planning_seconds, infeasible = 10, 1.0, 2

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = False
    ) -> tuple[Any, Any]:
        if state is None:
            self.plans_made += len(observation)
            self.planning_seconds += 1e-9 * len(observation)
            self.infeasible += 1
        return super().predict(observation, state, episode_start, deterministic)


def test_planning_is_told_apart_from_the_policys_steps() -> None:
    timing = agents.evaluate(Planner(), ENV_ID, range(5), num_envs=3).timing
    assert (timing.env_steps, timing.plans, timing.infeasible) == (5 * 150, 5, 2)
    assert timing.planning_ms == pytest.approx(1e-6, rel=1e-4)
    assert timing.policy_us > 0.0
    assert timing.env_us == pytest.approx(1e6 * timing.env_seconds / 750)
    assert np.isnan(agents.evaluate(Linear(), ENV_ID, [0]).timing.planning_ms)


class Countdown(gym.Env[Any, Any]):
    """Ends after as many steps as its seed's generator says; a reward of 1 a step."""

    observation_space = gym.spaces.Box(-1.0, 1.0, (18,), np.float32)
    action_space = gym.spaces.Box(-1.0, 1.0, (2,), np.float32)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.left = self.length = int(self.np_random.integers(1, 9))
        return np.zeros(18, np.float32), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.left -= 1
        info = {"is_success": self.length > 4, "length_drawn": self.length, "name": "x"} if self.left == 0 else {}
        if self.left == 0 and self.length > 4:
            info["rare"] = 0.5 * self.length
        return np.zeros(18, np.float32), 1.0, self.left == 0, False, info


@pytest.fixture
def countdown_id() -> Iterator[str]:
    def make(num_envs: int, **kwargs: Any) -> SyncVectorEnv:
        return SyncVectorEnv([Countdown] * num_envs, autoreset_mode=AutoresetMode.SAME_STEP)

    gym.register("Countdown-v0", entry_point=Countdown, vector_entry_point=make)
    yield "Countdown-v0"
    del gym.registry["Countdown-v0"]


def test_environments_that_end_at_different_times_count_once(countdown_id: str) -> None:
    evaluation = agents.evaluate(Linear(), countdown_id, range(12), num_envs=5)
    lengths = [int(gym.utils.seeding.np_random(seed)[0].integers(1, 9)) for seed in range(12)]
    assert len(set(lengths[:5])) > 1
    assert evaluation.lengths.tolist() == evaluation.returns.tolist() == lengths
    assert evaluation.metrics["length_drawn"].tolist() == lengths
    assert evaluation.success.tolist() == [length > 4 for length in lengths]
    assert "name" not in evaluation.metrics
    rare = [0.5 * length if length > 4 else np.nan for length in lengths]
    np.testing.assert_array_equal(evaluation.metrics["rare"], rare)


def test_what_a_policy_takes_the_payload_for_is_kept() -> None:
    evaluation = agents.evaluate("adaptive", "ExcavatorPayload-v0", range(3), num_envs=2)
    np.testing.assert_allclose(evaluation.metrics["mass_estimate"], evaluation.metrics["payload_mass"], atol=15.0)
    assert "mass_estimate" not in agents.evaluate("follower", ENV_ID, [0]).metrics


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ({"seeds": []}, "no seeds"),
        ({"seeds": [3, -1]}, "seed -1"),
        ({"seeds": [0.5]}, "seed 0.5 must be a whole number"),
        ({"seeds": [True]}, "seed True must be a whole number"),
        ({"seeds": [2**70]}, f"seed {2**70} must be a whole number from 0 to"),
        ({"seeds": np.zeros((1, 2), int)}, "must be a whole number"),
        ({"seeds": 3}, "seeds 3 must be whole numbers, one an episode"),
        ({"seeds": "01"}, "seeds '01' must be whole numbers"),
        ({"seeds": range(10**12)}, "too many seeds: give 1 to 10000000"),
        ({"num_envs": 0}, "num_envs 0"),
        ({"num_envs": 1.5}, "num_envs 1.5"),
        ({"policy": "dpkt"}, 'did you mean "dpct"'),
        ({"policy": 3}, "predict"),
        ({"env_config": {"horizn": 2.0}}, 'did you mean "horizon"'),
        ({"options": {"senario": "paper"}}, 'did you mean "scenario"'),
        ({"env_id": "CartPole-v1"}, "SAME_STEP"),
    ],
)
def test_what_is_wrong_is_said(arguments: dict[str, Any], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        agents.evaluate(**{"policy": "follower", "env_id": ENV_ID, "seeds": [0], **arguments})


def test_public_names() -> None:
    assert envs.env_ids() == sorted(envs.env_ids())
    assert ENV_ID in envs.env_ids()
    with pytest.raises(AttributeError, match="evaluat"):
        agents.evaluat  # noqa: B018


def test_nothing_is_planned_for_environments_whose_episode_is_over() -> None:
    evaluation = agents.evaluate("dpct", "MinTorqueMove-v0", seeds=range(6))
    assert len(set(evaluation.lengths.tolist())) > 1
    assert evaluation.timing.plans == 6
