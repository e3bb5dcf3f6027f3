"""A policy's first weights from an expert: cloning by regression, on states that expert and clone come to."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from numpy.typing import NDArray

import envs
from agents.training.recipe import TrainingConfig, WarmStart
from planners.typing import Array

Samples = tuple[NDArray[np.float32], NDArray[np.float32]]
"""Observations ``(samples, size)`` and the actions of the expert there ``(samples, n)``."""


def clone_expert(
    policy: Any, config: TrainingConfig, seed: int, progress: Callable[[str], bool] = lambda line: True
) -> bool:
    """Fit the mean action of a policy to an expert's, and its value to the returns of the fitted policy.

    Args:
        policy: of PPO; changed in place.
        config: of the run; it must have a warm start.
        seed: of the first episode and of the order of the samples.
        progress: called with a line about each round; says whether to go on.

    Returns:
        Whether it was done to the end.
    """
    plan = config.warm_start
    if plan is None:
        return True
    generator = np.random.default_rng(seed)
    optimizer = torch.optim.Adam(policy.parameters(), lr=plan.learning_rate)
    observations = np.zeros((0, *policy.observation_space.shape), np.float32)
    labels = np.zeros((0, *policy.action_space.shape), np.float32)
    with closing(gym.make_vec(config.env, num_envs=plan.episodes, **config.env_config)) as env:
        for number in range(plan.rounds):
            actor = policy if number else None
            seen, wanted, _ = collect(env, plan.expert, actor, seed + number * plan.episodes)
            observations = np.concatenate([observations, *seen])
            labels = np.concatenate([labels, *wanted])
            loss = _fit(policy, optimizer, (observations, labels), plan, number, generator)
            if not progress(f"cloning {plan.expert}: round {number + 1} of {plan.rounds}, error {loss**0.5:.3f}"):
                return False
        seen, _, rewards = collect(env, plan.expert, policy, seed + plan.rounds * plan.episodes)
    _fit_value(policy, np.concatenate(seen), np.concatenate(returns_to_go(rewards, config.gamma)), plan, generator)
    return True


def collect(
    env: gym.vector.VectorEnv[Any, Any, Any], expert_name: str, actor: Any, seed: int
) -> tuple[list[NDArray[np.float32]], list[NDArray[np.float32]], list[Array]]:
    """The first episode of each environment: observations and the expert's actions, ``(steps, ...)`` each, and rewards.

    Args:
        env: environments.
        expert_name: of the expert that says what to do.
        actor: the policy that acts; None for the expert itself.
        seed: of the first environment; the next has the next.
    """
    expert = envs.make_expert(expert_name, env)
    observation, _ = env.reset(seed=seed)
    state, begins = None, np.ones(env.num_envs, dtype=bool)
    running = begins.copy()
    rows: list[tuple[Any, Any, Any, Any]] = []
    while running.any():
        wanted, state = expert.predict(observation, state=state, episode_start=begins, deterministic=True)
        actions = wanted if actor is None else actor.predict(observation, deterministic=True)[0]
        following, rewards, terminated, truncated, _ = env.step(actions)
        rows.append((observation, wanted, rewards, running.copy()))
        begins = terminated | truncated
        running &= ~begins
        observation = following
    *columns, alive = (np.stack(column, axis=1) for column in zip(*rows, strict=True))
    seen, labels, earned = ([record[lives] for record, lives in zip(column, alive, strict=True)] for column in columns)
    return seen, labels, earned


def returns_to_go(rewards: list[Array], gamma: float) -> list[Array]:
    """Discounted sum of what is still to come, at each step of each episode."""
    answers = []
    for episode in rewards:
        values = np.zeros(len(episode))
        after = 0.0
        for step in reversed(range(len(episode))):
            values[step] = after = episode[step] + gamma * after
        answers.append(values)
    return answers


def _fit(
    policy: Any,
    optimizer: torch.optim.Optimizer,
    samples: Samples,
    plan: WarmStart,
    number: int,
    generator: np.random.Generator,
) -> float:
    """A round of regression on the expert's actions; the mean squared error of its last tenth."""
    observations, labels = (torch.from_numpy(values) for values in samples)
    losses = []
    for update in range(plan.updates):
        done = (number + update / plan.updates) / plan.rounds
        for group in optimizer.param_groups:
            group["lr"] = plan.learning_rate * (1.0 - 0.99 * done)
        batch = generator.integers(len(observations), size=plan.batch_size)
        means = policy.get_distribution(observations[batch]).distribution.mean
        losses.append(_descend(optimizer, torch.nn.functional.mse_loss(means, labels[batch])))
    return float(np.mean(losses[-max(1, plan.updates // 10) :]))


def _fit_value(
    policy: Any, observations: NDArray[np.float32], returns: Array, plan: WarmStart, generator: np.random.Generator
) -> None:
    """Regression of the value on returns, so that the first updates of PPO do not undo the clone."""
    seen, wanted = torch.from_numpy(observations), torch.from_numpy(returns.astype(np.float32))
    optimizer = torch.optim.Adam(policy.parameters(), lr=plan.learning_rate)
    for _ in range(plan.updates):
        batch = generator.integers(len(seen), size=plan.batch_size)
        values = policy.predict_values(seen[batch])[:, 0]
        _descend(optimizer, torch.nn.functional.mse_loss(values, wanted[batch]))


def _descend(optimizer: torch.optim.Optimizer, loss: Any) -> float:
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()
    return float(loss.detach())
