"""Amortised optimisation: a policy's first weights from the cost of its motions, by gradient through the dynamics.

Where an action is a whole motion, its torque is a smooth function of the action, known in closed form. The network is
fitted to the mean cost over many random moves; a planner minimises the cost of each move separately (B. Amos, "Tutorial
on amortized optimization", section 2). No physics is simulated.
"""

from __future__ import annotations

from contextlib import closing
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from agents.environments import VectorEnv, make_batch
from agents.training.algorithms.optimizers import optimizer_of
from agents.training.algorithms.ppo import mean_action
from agents.training.devices import thread_count
from agents.training.recipe import Amortisation, PPOConfig
from agents.training.warm_start.gradient_steps import Minibatch, gradient_steps
from agents.training.warm_start.stage import Stage, state_of
from envs.min_torque_move.env import MinTorqueMove
from envs.min_torque_move.kernels import SHAPE_SCALE
from planners.motion.time_laws import SHAPES, quintic, shape_functions
from planners.typing import Array

_N_ENVS = 1024
_SAMPLES = 40  # instants at which the torques of a motion are sampled, denser towards its ends, where torques are large
_TORQUE_ROOM, _RANGE_ROOM = 0.07, 0.02  # shares of the limits reserved for the tracking controller
_TORQUE_PENALTIES, _RANGE_PENALTY = (2.0, 20.0), 20.0
"""Weights of the largest excess over a torque limit and of its square, and of that over a joint range."""
_LINES = 20


class MoveCost:
    """Cost of motions for observations of their starts, in torch; see `planners.motion.time_laws` for the motions."""

    def __init__(self, task: MinTorqueMove) -> None:
        share = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
        s = 0.5 * (1.0 - np.cos(np.pi * share))
        units = SHAPE_SCALE / np.arange(1, SHAPES + 1)
        coupling, weight = task.arm.chain_constants
        limits = task.arm.limits
        self._layout = task.layout
        self._weights = _tensor(0.5 * np.pi * np.sin(np.pi * share) / _SAMPLES)[:, None]
        self._shapes = _tensor(units[:, None] * shape_functions(s))
        self._ways = _tensor(np.stack(quintic(s)))
        self._coupling, self._weight = _tensor(coupling), _tensor(weight)
        self._torques = _tensor((1.0 - _TORQUE_ROOM) * np.array(limits.torque))
        self._middles = _tensor(limits.angle_middle)
        self._ranges = _tensor((1.0 - _RANGE_ROOM) * limits.angle_half)

    def __call__(self, observations: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
        """Effort over that of the quintic, plus a penalty for exceeding the limits, ``(moves,)``.

        Args:
            observations: at the start of an episode, ``(moves, size)``.
            actions: of control mode "motion", ``(moves, 3 SHAPES)``.
        """
        entries = {entry.name: observations[:, place] * entry.scale for entry, place in self._layout.slices()}
        duration = entries["time_left"][:, :, None]
        change = entries["goal_error"]
        bend = actions.reshape(len(actions), -1, SHAPES)
        q, qd, qdd = (self._curve(change, bend, order) for order in range(3))
        q = q + entries["joint_position"][:, None, :]
        torque = self._torque(q, qd / duration, qdd / duration**2)
        effort = (torque.abs() * self._weights).sum((1, 2)) / entries["quintic_torque"][:, 0]
        excess = torch.relu(torque.abs() / self._torques - 1.0).amax((1, 2))
        outside = torch.relu((q - self._middles).abs() / self._ranges - 1.0).amax((1, 2))
        linear, square = _TORQUE_PENALTIES
        return effort + linear * excess + square * excess**2 + _RANGE_PENALTY * outside

    def _curve(self, change: torch.Tensor, bend: torch.Tensor, order: int) -> torch.Tensor:
        """A derivative of the motions by the share of the duration, ``(moves, samples, joints)``."""
        ways, shapes = self._ways[order], self._shapes[order]
        return change[:, None, :] * ways[:, None] + (bend @ shapes).transpose(1, 2)

    def _torque(self, q: torch.Tensor, qd: torch.Tensor, qdd: torch.Tensor) -> torch.Tensor:
        """Inverse dynamics of a planar chain, as in `planners.robot.dynamics`, in absolute angles."""
        angle, speed, acceleration = q.cumsum(-1), qd.cumsum(-1), qdd.cumsum(-1)
        c, s = torch.cos(angle), torch.sin(angle)
        square = speed * speed
        along = (c * acceleration - s * square) @ self._coupling
        across = (s * acceleration + c * square) @ self._coupling
        moment = c * along + s * across + self._weight * c
        return moment.flip(-1).cumsum(-1).flip(-1)


def amortise(policy: Any, config: PPOConfig, seed: int, stage: Stage | None = None) -> bool:
    """Fit the mean action of a policy of PPO to the least cost of the motions; whether it was completed.

    ``seed`` is of the first move and of the order of the moves. ``stage`` keeps the state after every twentieth of the
    updates, from which a later call goes on, and hears a line about it. Without an amortisation in ``config``, nothing
    is done.
    """
    plan, stage = config.amortise, stage or Stage()
    if plan is None:
        return True
    observations, cost = _moves(config, plan, seed)
    # An action of 1 is several radians. This makes the last layer's steps in radians as large as the others'.
    last_rate = 1.0 / SHAPE_SCALE * plan.learning_rate
    optimizer = optimizer_of(config.optimizer, policy, plan.learning_rate, last_rate=last_rate)

    def loss(batch: Minibatch) -> torch.Tensor:
        moves = observations[batch]
        return cost(moves, mean_action(policy, moves)).mean()

    def rate(update: int) -> float:
        return 1.0 - 0.999 * update / plan.updates

    costs: list[float] = []
    every = -(-plan.updates // _LINES)
    generator, done = np.random.default_rng(seed), 0
    if state := stage.load("amortise"):
        policy.load_state_dict(state["policy"])
        optimizer.load_state_dict(state["optimizer"])
        generator.bit_generator.state = state["generator"]
        done = int(state["updates"])
    steps = gradient_steps(
        optimizer,
        loss,
        len(observations),
        plan,
        generator,
        threads=thread_count(config),
        first=done,
        rate=rate,
        max_norm=1.0,
    )
    for value in steps:
        costs.append(value)
        done += 1
        if done % every == 0:
            stage.save("amortise", {**state_of(policy, optimizer, generator), "updates": done})
            if not stage.report(f"amortising: {done:,} of {plan.updates:,} updates, cost {np.mean(costs):.3f}"):
                return False
            costs.clear()
    return True


def check_motions(env: VectorEnv) -> MinTorqueMove:
    """The task of an environment whose actions are whole motions; a ValueError for another one."""
    task = env.unwrapped.task  # type: ignore[attr-defined]
    if not isinstance(task, MinTorqueMove) or task.config.control_mode != "motion":
        raise ValueError("amortise needs MinTorqueMove-v0 with control_mode motion: its actions are whole motions")
    return task


def _moves(config: PPOConfig, plan: Amortisation, seed: int) -> tuple[torch.Tensor, MoveCost]:
    """Observations of the starts of random moves, ``(moves, size)``, and their cost."""
    settings, options = config.conditions[0]
    with closing(make_batch(config.env_id, _N_ENVS, settings)) as env:
        task = check_motions(env)
        rows: list[NDArray[np.float32]] = []
        while len(rows) * _N_ENVS < plan.moves:
            rows.append(env.reset(seed=seed + len(rows) * _N_ENVS, options=options)[0])
        return torch.from_numpy(np.concatenate(rows)[: plan.moves]), MoveCost(task)


def _tensor(values: Array) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float32)
