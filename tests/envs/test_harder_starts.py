"""Starts of harder levels: the hand beside the belt, and moves as short as the torque of the quintic allows."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import envs


def begun(env_id: str, level: str, num_envs: int = 4) -> Any:
    env = gym.make_vec(env_id, num_envs=num_envs)
    env.reset(seed=0, options=dict(envs.task_card(env_id).levels[level].options))
    return env.unwrapped


def test_the_hand_starts_beside_the_line_as_far_as_asked() -> None:
    env = begun("ConveyorTrack-v0", "beside")
    records = env.task.batch
    away = records["hand"][:, 1] - records["part_position"][:, 1]
    assert (np.abs(away) <= 0.2).all()
    assert len(set(away.tolist())) == 4
    env.reset(seed=0, options={"scenario": "paper", "beside": -0.1})
    assert env.task.batch["hand"][:, 1] == pytest.approx(1.632)
    assert env.task.batch["part_position"][:, 1] == pytest.approx(1.732)
    rest = {"belt_speed": 0.1, "offset": 0.05, "line_height": 1.6, "hand_x": -0.5, "elbow": "-"}
    env.reset(seed=0, options={**rest, "beside": (0.1, 0.2)})
    away = env.task.batch["hand"][:, 1] - 1.6
    assert ((away >= 0.1) & (away <= 0.2)).all()
    assert len(set(away.tolist())) == 4


def test_a_start_beside_the_line_that_the_arm_cannot_reach_is_refused() -> None:
    with pytest.raises(ValueError, match="no motion within the joint limits"):
        gym.make("ConveyorTrack-v0").reset(seed=0, options={"scenario": "paper", "beside": 0.5})


def test_a_short_move_needs_the_given_share_of_the_torque_limits_and_no_more() -> None:
    env = begun("MinTorqueMove-v0", "short")
    limits = env.task.arm.limits.array("torque")
    shares = (env.task.batch["quintic_peak"] / limits).max(axis=1)
    assert (shares > 0.85).all()  # times are whole control periods
    assert (shares < 0.92).all()  # of 33 samples of the quintic, between which the torque is higher
    with pytest.raises(ValueError, match="torque_share"):
        env.reset(seed=0, options={"torque_share": 0.95})
