"""DAgger: a policy's first weights from an expert, on states that the policy itself visits; or from a dataset.

S. Ross, G. Gordon and D. Bagnell, "A reduction of imitation learning and structured prediction to no-regret online
learning", algorithm 3.1.
"""

from __future__ import annotations

from contextlib import ExitStack, closing
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from numpy.typing import NDArray

import envs
from agents.datasets.read import read_dataset
from agents.environments import make_batch
from agents.training.algorithms.optimizers import optimizer_of
from agents.training.algorithms.ppo import mean_action
from agents.training.batches.estimates import certain_conditions
from agents.training.devices import thread_count
from agents.training.recipe import PPOConfig, WarmStart
from agents.training.warm_start.gradient_steps import Minibatch, gradient_steps
from agents.training.warm_start.stage import Stage, state_of
from planners.typing import Array


def dagger(policy: Any, config: PPOConfig, seed: int, stage: Stage | None = None) -> bool:
    """Fit the mean action of a policy to an expert's or a dataset's, and its value to the returns of the fitted policy.

    The expert acts in the first iteration, which is behaviour cloning, and the policy in the later ones. The expert
    labels every state visited, and each iteration fits the policy to the samples of all iterations so far. A dataset is
    cloned in one iteration. ``seed`` is of the first episode and of the order of the samples. ``stage`` keeps the state
    after each iteration, from which a later call goes on, and hears a line about it; the return value says whether all
    is done. Without a warm start in ``config``, it is.
    """
    plan, stage = config.warm_start, stage or Stage()
    if plan is None:
        return True
    generator = np.random.default_rng(seed)
    optimizer = optimizer_of(config.optimizer, policy, plan.learning_rate)
    observations = np.zeros((0, *policy.observation_space.shape), np.float32)
    labels = np.zeros((0, *policy.action_space.shape), np.float32)
    first = 0
    if state := stage.load("dagger"):
        policy.load_state_dict(state["policy"])
        optimizer.load_state_dict(state["optimizer"])
        generator.bit_generator.state = state["generator"]
        observations, labels = state["observations"].numpy(), state["labels"].numpy()
        first = int(state["iterations"])
    with _Levels(config, plan.episodes) as levels:
        for iteration in range(first, plan.iterations):
            if plan.dataset is None:
                actor = policy if iteration else None
                visited, wanted, _ = levels.collect(plan.expert, actor, seed + iteration * plan.episodes)
            else:
                episodes = read_dataset(plan.dataset)
                visited = [episode.observations[:-1] for episode in episodes]
                wanted = [episode.actions for episode in episodes]
            observations = np.concatenate([observations, *visited])
            labels = np.concatenate([labels, *wanted])
            samples = observations, labels
            error = _fit_actions(policy, optimizer, samples, plan, iteration, generator, thread_count(config)) ** 0.5
            kept = {"observations": torch.from_numpy(observations), "labels": torch.from_numpy(labels)}
            stage.save("dagger", {**state_of(policy, optimizer, generator), **kept, "iterations": iteration + 1})
            method = "DAgger" if plan.dataset is None else "behaviour cloning"
            line = f"{method}, {plan.source}: iteration {iteration + 1} of {plan.iterations}, error {error:.3f}"
            if not stage.report(line):
                return False
        visited, _, rewards = levels.collect(None, policy, seed + plan.iterations * plan.episodes)
    returns = np.concatenate(returns_to_go(rewards, config.gamma))
    _fit_value(policy, (np.concatenate(visited), returns), config, plan, generator)
    return True


class _Levels(ExitStack):
    """Environments at each level of a recipe, among which episodes are divided, while the context is open."""

    def __init__(self, config: PPOConfig, episodes: int) -> None:
        super().__init__()
        conditions = certain_conditions(config) if config.estimates else config.conditions
        each, more = divmod(episodes, len(conditions))
        self._parts = [
            (self.enter_context(closing(make_batch(config.env_id, each + (index < more), settings))), options)
            for index, (settings, options) in enumerate(conditions)
        ]

    def collect(self, expert_name: str | None, actor: Any, seed: int) -> tuple[list[Any], list[Any], list[Array]]:
        """What `collect` gives at each level, one after the other."""
        visited: list[Any] = []
        wanted: list[Any] = []
        rewards: list[Array] = []
        for env, options in self._parts:
            found = collect(env, expert_name, actor, seed, options)
            visited, wanted, rewards = visited + found[0], wanted + found[1], rewards + found[2]
            seed += env.num_envs
        return visited, wanted, rewards


def collect(
    env: gym.vector.VectorEnv[Any, Any, Any],
    expert_name: str | None,
    actor: Any,
    seed: int,
    options: dict[str, Any] | None = None,
) -> tuple[list[NDArray[np.float32]], list[NDArray[np.float32]], list[Array]]:
    """The first episode of each environment: observations and the expert's actions, ``(steps, ...)`` each, and rewards.

    ``actor`` acts, or the expert if it is None; without an expert, the actions are the actor's. Environment i is reset
    with ``seed`` + i and ``options``.
    """
    expert: Any = actor if expert_name is None else envs.make_expert(expert_name, env)
    observation, _ = env.reset(seed=seed, options=options)
    state, begins = None, np.ones(env.num_envs, dtype=bool)
    running = begins.copy()
    steps: list[tuple[Any, Any, Any, Any]] = []
    while running.any():
        if expert is not actor:
            expert.idle = ~running
        wanted, state = expert.predict(observation, state=state, episode_start=begins, deterministic=True)
        actions = wanted if actor is None else actor.predict(observation, deterministic=True)[0]
        following, rewards, terminated, truncated, _ = env.step(actions)
        steps.append((observation, wanted, rewards, running.copy()))
        begins = terminated | truncated
        running &= ~begins
        observation = following
    *columns, alive = (np.stack(column, axis=1) for column in zip(*steps, strict=True))
    visited, labels, earned = ([values[kept] for values, kept in zip(column, alive, strict=True)] for column in columns)
    return visited, labels, earned


def returns_to_go(rewards: list[Array], gamma: float) -> list[Array]:
    """Discounted sum of the present and future rewards, at each step of each episode."""
    answers = []
    for episode in rewards:
        values = np.zeros(len(episode))
        after = 0.0
        for step in reversed(range(len(episode))):
            values[step] = after = episode[step] + gamma * after
        answers.append(values)
    return answers


def _fit_actions(
    policy: Any,
    optimizer: torch.optim.Optimizer,
    samples: tuple[NDArray[np.float32], NDArray[np.float32]],
    plan: WarmStart,
    iteration: int,
    generator: np.random.Generator,
    threads: int,
) -> float:
    """Regression of the mean action on the expert's actions; the mean squared error over the last tenth of it."""
    observations, labels = (torch.from_numpy(values) for values in samples)

    def loss(batch: Minibatch) -> torch.Tensor:
        return torch.nn.functional.mse_loss(mean_action(policy, observations[batch]), labels[batch])

    def rate(update: int) -> float:
        return 1.0 - 0.99 * ((iteration + update / plan.updates) / plan.iterations)

    losses = list(gradient_steps(optimizer, loss, len(observations), plan, generator, threads=threads, rate=rate))
    return float(np.mean(losses[-max(1, plan.updates // 10) :]))


def _fit_value(
    policy: Any,
    samples: tuple[NDArray[np.float32], Array],
    config: PPOConfig,
    plan: WarmStart,
    generator: np.random.Generator,
) -> None:
    """Regression of the value on returns, so that the first updates of PPO do not undo the fit of the actions."""
    visited, wanted = (torch.from_numpy(values.astype(np.float32)) for values in samples)

    def loss(batch: Minibatch) -> torch.Tensor:
        return torch.nn.functional.mse_loss(policy.predict_values(visited[batch])[:, 0], wanted[batch])

    optimizer = optimizer_of(config.optimizer, policy, plan.learning_rate)
    for _ in gradient_steps(optimizer, loss, len(visited), plan, generator, threads=thread_count(config)):
        pass
