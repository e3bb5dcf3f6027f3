"""Fits a policy's forecasts to the paths of discs, which are drawn whole when an episode begins."""

from __future__ import annotations

from contextlib import closing
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from numpy.typing import NDArray

from agents.environments import make_batch
from agents.training.algorithms.optimizers import optimizer_of
from agents.training.algorithms.ppo import mean_action
from agents.training.devices import thread_count
from agents.training.recipe import Forecasts, PPOConfig
from agents.training.warm_start.gradient_steps import Minibatch, gradient_steps
from agents.training.warm_start.stage import Stage, state_of
from envs.observation import Observation
from envs.obstacle_dodge.env import ObstacleDodge
from envs.obstacle_dodge.forecasts import KNOTS, LAGS, PACE, Move, forecast_inputs, labels, move_of
from envs.obstacle_dodge.scale import scale_of_task
from planners.typing import Array

_BATCH = 500  # environments of a reset
_LINES = 20  # that the fit reports
_EARLY, _FIRST = 0.5, 2.4  # share of the samples of an episode's first seconds, and those seconds


def check_forecasts(config: PPOConfig) -> None:
    """Raise a ValueError for an environment without discs, with another arm's units, or with several discs for PPO."""
    for settings, _ in config.conditions:
        with closing(gym.make(config.env_id, **settings)) as env:
            task = env.unwrapped.task  # type: ignore[attr-defined]
            if not isinstance(task, ObstacleDodge) or scale_of_task(task.arm) != (1.0, 1.0):
                raise ValueError("forecasts are of the discs of ObstacleDodge-v0 with its own arm")
            if task.n_discs != 1 or task.config.second_arm:
                raise ValueError(
                    "forecasts are trained with one disc, as those of several are drawn alike; leave out num_obstacles "
                    "and levels with several discs"
                )


def fit_forecasts(policy: Any, config: PPOConfig, seed: int, stage: Stage | None = None) -> bool:
    """Fit the mean action to true displacements, by least squares relative to a spread that grows with the time ahead.

    ``seed`` is of the first episode and of the instants. ``stage`` keeps the state, from which a later call goes on;
    the return value says whether all is done. Without forecasts in ``config``, it is.
    """
    plan, stage = config.forecasts, stage or Stage()
    if plan is None:
        return True
    inputs, wanted = (torch.from_numpy(values) for values in _samples(config, plan, seed))
    spread = (0.04 + 0.12 * np.repeat(KNOTS, 2)) / (PACE * np.repeat(KNOTS, 2))
    weights = torch.from_numpy((1.0 / spread**2 / len(spread)).astype(np.float32))
    optimizer = optimizer_of(config.optimizer, policy, plan.learning_rate)
    generator, done = np.random.default_rng(seed), 0
    if state := stage.load("forecasts"):
        policy.load_state_dict(state["policy"])
        optimizer.load_state_dict(state["optimizer"])
        generator.bit_generator.state = state["generator"]
        done = int(state["updates"])

    def loss(batch: Minibatch) -> torch.Tensor:
        return (weights * (mean_action(policy, inputs[batch]) - wanted[batch]) ** 2).sum(1).mean()

    def rate(update: int) -> float:
        return 1.0 - 0.99 * update / plan.updates

    losses: list[float] = []
    every, threads = -(-plan.updates // _LINES), thread_count(config)
    for value in gradient_steps(optimizer, loss, len(inputs), plan, generator, threads=threads, first=done, rate=rate):
        losses.append(value)
        done += 1
        if done % every == 0:
            stage.save("forecasts", {**state_of(policy, optimizer, generator), "updates": done})
            if not stage.report(f"forecasts: {done:,} of {plan.updates:,} updates, loss {np.mean(losses):.3f}"):
                return False
            losses.clear()
    return True


def _samples(config: PPOConfig, plan: Forecasts, seed: int) -> tuple[Observation, NDArray[np.float32]]:
    """Inputs of forecasts at random instants of episodes, and what the forecasts should be."""
    generator = np.random.default_rng(seed)
    found: list[list[tuple[Observation, NDArray[np.float32]]]] = []
    conditions = config.conditions
    for settings, options in conditions:
        with closing(make_batch(config.env_id, _BATCH, settings)) as env:
            task: Any = env.unwrapped.task  # type: ignore[attr-defined]
            for _ in range(-(-plan.episodes // (_BATCH * len(conditions)))):
                first = seed + len(found) * _BATCH
                observations, _ = env.reset(seed=first, options=options)
                move = move_of(task.layout.parse(observations))
                paths = np.stack([task.obstacle_path(index)[:, 0] for index in range(_BATCH)]) - task.arm.base_array
                found.append([_at_instants(task, move, paths, generator) for _ in range(plan.samples)])
    inputs, wanted = zip(*(pair for batch in found for pair in batch), strict=True)
    return np.concatenate(inputs), np.concatenate(wanted)


def _at_instants(
    task: ObstacleDodge, move: Move, paths: Array, generator: np.random.Generator
) -> tuple[Observation, NDArray[np.float32]]:
    """One sample of each path, ``(num_envs, samples, 2)``, at an instant of its own."""
    step, count = task.scale.path_step, len(paths)
    per_period = round(task.config.control_period / step)
    last = (paths.shape[1] - 1 - round(KNOTS[-1] / step)) // per_period
    early = generator.random(count) < _EARLY
    most = np.where(early, min(last, round(_FIRST / task.config.control_period)), last)
    now = per_period * (generator.random(count) * most).astype(int)
    rows = np.arange(count)

    def velocity(sample: NDArray[np.int64]) -> Array:
        """As observed: backward differences, the first one forward."""
        after = np.maximum(sample, 1)
        difference: Array = (paths[rows, after] - paths[rows, after - 1]) / step
        return difference

    earlier = np.stack([velocity(np.maximum(now - round(lag / step), 0)) for lag in LAGS], axis=1)
    place, own = paths[rows, now], velocity(now)
    inputs = forecast_inputs(task.arm, now * step, move, place, own, earlier)
    ahead = np.stack([paths[rows, now + round(knot / step)] - place for knot in KNOTS], axis=1)
    return inputs, labels(own, ahead)
