"""The reference of ExcavatorPayload-v0: the tip error of a controller that knows what is hidden from the policies."""

from __future__ import annotations

import math
from contextlib import closing
from typing import Any

import gymnasium as gym
import numpy as np

from envs.excavator_payload.estimation import filter_settings
from planners import Infeasible
from planners.excavator.kalman import KalmanComputedTorque


def known_payload_tip_rms(batch: Any, env_index: int, seed: int) -> float:
    """Root mean square of the tip error, m, of the Kalman filter's controller with the true payload and friction.

    It sees the same noisy measurements as a policy, so the error is what noise and the control period leave to it.

    Args:
        batch: a vector environment in which ``env_index`` is at the start of the episode of ``seed``.
        env_index: the environment.
        seed: of its episode, which is repeated.

    Raises:
        planners.Infeasible: if the episode ends as a failure.
    """
    record = batch.task.batch[env_index]
    period, last = batch.task.config.control_period, int(record["n_waypoints"])
    hidden = {
        "payload": float(record["payload"]),
        "payload_offset": tuple(record["load_offset"].tolist()),
        "friction_scale": float(record["friction_scale"]),
    }
    motion = {
        "waypoints": record["waypoints"][:last].tolist(),
        "arrival_times": (period * record["due"][1:last]).tolist(),
    }
    config = {**batch.task.config.model_dump(), "control_mode": "torque"}
    with closing(gym.make("ExcavatorPayload-v0", disable_env_checker=True, **config)) as env:
        return _tip_rms(env.unwrapped, env.reset(seed=seed, options={**hidden, **motion})[0])


def _tip_rms(env: Any, observation: Any) -> float:
    """The error over the episode that an environment is at the start of."""
    task, record = env.task, env.task.batch[0]
    controller = KalmanComputedTorque(filter_settings(task.config, task.uncertainty))
    limit = np.array(task.arm.limits.torque)
    truncated = terminated = False
    while not (truncated or terminated):
        seen = task.layout.parse(observation[None])
        q, error = seen["joint_position"], seen["reference_error"]
        reference = q + error, seen["reference_velocity"], seen["reference_acceleration"]
        torque = controller.torque(q, seen["joint_velocity"], *reference)
        observation, _, terminated, truncated, info = env.step((torque[0] / limit).astype(np.float32))
        controller.set_payload(record["load"], record["load_offset"], record["friction_scale"])
    if not math.isfinite(info["tip_rms"]):
        raise Infeasible("limits", "the controller that knows payload and friction leaves the allowed range")
    return float(info["tip_rms"])
