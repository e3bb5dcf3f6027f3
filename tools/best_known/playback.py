"""Motions of policies, and motions played back in an environment: only what it scores itself counts."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import envs
from envs.best_known import PAPER
from planners.control import held_torque
from planners.typing import Array

Actions = NDArray[np.float32]


class Motion(NamedTuple):
    """Joint angles and velocities at the ends of control periods, ``(periods + 1, n)`` each."""

    q: Array
    qd: Array


class Played(NamedTuple):
    """An episode: the last info, its torques as actions of torque mode ``(periods, n)``, and the motion."""

    info: dict[str, Any]
    actions: Actions
    motion: Motion

    def score(self, metric: str, limit_tolerance: float) -> float:
        """The metric of a success within the limits; inf for any other episode."""
        kept = self.info["is_success"] and self.info["limit_ratio"] <= 1.0 + limit_tolerance
        return float(self.info[metric]) if kept else math.inf


def options_of(key: int) -> dict[str, Any]:
    """What ``reset`` is given for a seed, or for `PAPER`."""
    return {"scenario": "paper"} if key == PAPER else {}


def begin(env: gym.Env[Any, Any], key: int) -> Any:
    """Begin the episode of a seed, or of the paper's start; the observation."""
    observation, _ = env.reset(seed=max(key, 0), options=options_of(key))
    return observation


def play_policy(env: gym.Env[Any, Any], key: int, policy: Any) -> Played:
    """Play an episode under a policy's ``predict``."""
    memory: Any = None

    def act(observation: Any, period: int) -> Any:
        nonlocal memory
        action, memory = policy.predict(observation[None], memory, np.array([period == 0]), True)
        return action[0]

    return _play(env, key, act)


def play_expert(env: gym.Env[Any, Any], key: int, name: str) -> Played:
    """Play an episode under an expert, which plans after the start."""
    begin(env, key)
    return play_policy(env, key, envs.make_expert(name, env))


def play_actions(env: gym.Env[Any, Any], key: int, actions: Actions) -> Played:
    """Play an episode under given actions."""
    return _play(env, key, lambda observation, period: actions[period])


def play_motion(env: gym.Env[Any, Any], key: int, motion: Motion, stiffness: float = 0.0) -> Played:
    """Play a motion by computed torque: at the end of each period the joints have its velocities.

    Args:
        env: in torque mode.
        key: seed of the episode, or `PAPER`.
        motion: after its end the joints stop.
        stiffness: acceleration for an error of the angles, 1/s^2.
    """
    task: Any = env.unwrapped
    arm, period = task.task.arm, task.task.config.control_period

    def act(observation: Any, index: int) -> Any:
        q, qd = task.joint_state()
        inside = index + 1 < len(motion.qd)
        wanted = motion.qd[index + 1] if inside else np.zeros_like(qd)
        qdd = (wanted - qd) / period + (stiffness * (motion.q[index] - q) if inside else 0.0)
        torque = held_torque(arm, q[None], qd[None], qdd[None], period)[0]
        return np.clip(torque / arm.limits.array("torque"), -1.0, 1.0)

    return _play(env, key, act)


def _play(env: gym.Env[Any, Any], key: int, act: Any) -> Played:
    task: Any = env.unwrapped
    observation, over = begin(env, key), False
    states, actions = [task.joint_state()], list[Any]()
    record, torque = task.task.batch[0], task.task.arm.limits.array("torque")
    while not over:
        action = np.asarray(act(observation, len(actions)), dtype=np.float32)
        observation, _, terminated, truncated, info = env.step(action)
        actions.append((record["tau"] / torque).astype(np.float32))
        states.append(task.joint_state())
        over = terminated or truncated
    q, qd = (np.array(part) for part in zip(*states, strict=True))
    return Played(info, np.array(actions), Motion(q, qd))
