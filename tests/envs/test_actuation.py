"""The control modes, through the environment."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import envs  # noqa: F401  (registers the ids)
from envs.physics.actuation import LIMIT_KINDS
from planners import SCARA_1M
from planners.control.joint_limits import smooth_bounds

PERIOD = 0.02


def started(**config: Any) -> Any:
    env = gym.make("ConveyorTrack-v0", **config).unwrapped
    env.reset(seed=0)
    return env


def mean_acceleration(env: Any, action: list[float]) -> np.ndarray[Any, Any]:
    before = env.joint_state()[1]
    env.step(np.array(action, dtype=np.float32))
    return (env.joint_state()[1] - before) / PERIOD  # type: ignore[no-any-return]


def test_torque_is_a_share_of_the_limit() -> None:
    env = started()
    q, qd = env.joint_state()
    observed = mean_acceleration(env, [0.5, -0.25])
    expected = SCARA_1M.forward_dynamics(q, qd, [0.25, -0.05])
    assert observed == pytest.approx(expected, rel=2e-3)


def test_acceleration_is_a_share_of_the_limit() -> None:
    assert mean_acceleration(started(control_mode="acceleration"), [0.2, -0.1]) == pytest.approx(
        [0.06, -0.03], rel=1e-4
    )


def test_jerk_is_integrated() -> None:
    env = started(control_mode="jerk")
    for k in range(1, 4):
        expected = [0.5 * 2.3 * PERIOD * k, -0.5 * 2.0 * PERIOD * k]
        assert mean_acceleration(env, [0.5, -0.5]) == pytest.approx(expected, rel=1e-4)


def test_velocity_is_a_share_of_the_limit_at_the_end_of_a_period() -> None:
    env = gym.make("ObstacleDodge-v0", control_mode="velocity").unwrapped
    env.reset(seed=0)
    env.step(np.array([0.05, -0.1], dtype=np.float32))
    assert env.joint_state()[1] == pytest.approx([0.12 * 0.998, -0.24 * 0.998], rel=1e-2)  # type: ignore[attr-defined]


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), hold=st.integers(1, 60))
def test_velocity_control_keeps_every_limit_by_construction(seed: int, hold: int) -> None:
    """Whatever a policy asks for, in bursts of any length: into both ends of the ranges, too."""
    far_away = {"obstacle_paths": (((9.0, 9.0),),)}
    vector = gym.make_vec("ObstacleDodge-v0", num_envs=8, control_mode="velocity", horizon=4.0)
    vector.reset(seed=seed % 10_000, options=far_away)
    generator = np.random.default_rng(seed)
    for step in range(199):
        if step % hold == 0:
            actions = generator.choice([-1.0, 1.0], (8, 2)).astype(np.float32)
        vector.step(actions)
    ratios = vector.unwrapped.task.batch["limit_ratios"]  # type: ignore[attr-defined]
    assert ratios[:, LIMIT_KINDS.index("jerk")].max() == 0.0  # this arm has no such limit
    assert ratios.max() <= 1.005


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), hold=st.integers(1, 40))
def test_jerk_control_keeps_every_limit_by_construction(seed: int, hold: int) -> None:
    """Whatever a policy asks for, in bursts of any length: at full jerk, against both ends."""
    vector = gym.make_vec("ConveyorTrack-v0", num_envs=8, autoreset_mode="SameStep", control_mode="jerk")
    vector.reset(seed=seed % 10_000)
    generator = np.random.default_rng(seed)
    ratios = None
    for step in range(150):
        if step % hold == 0:
            actions = generator.choice([-1.0, 1.0], (8, 2)).astype(np.float32)
        *_, infos = vector.step(actions)
        ratios = infos.get("final_info")
    assert ratios is not None
    assert ratios["limit_ratio"].max() <= 1.002


@given(
    speed=st.floats(-0.2, 0.2),
    acceleration=st.floats(-0.3, 0.3),
    push=st.sampled_from([1.0, -1.0]),
)
def test_full_jerk_ends_at_the_speed_limit_and_not_beyond(speed: float, acceleration: float, push: float) -> None:
    limits = {"speed_limit": 0.2, "acceleration_limit": 0.3, "jerk_limit": 2.3}
    step = limits["jerk_limit"] * PERIOD
    # Only states from which the limits can still be kept: shedding the acceleration at full jerk stays below the limit.
    worst = speed + np.sign(acceleration) * (acceleration**2 / (2 * 2.3) + abs(acceleration) * PERIOD / 2)
    if abs(worst) > 0.2 - 1e-3:
        return
    for _ in range(200):
        lower, upper = smooth_bounds(speed, acceleration, PERIOD, *limits.values())
        assert lower <= upper
        following = min(upper, max(lower, acceleration + push * step))
        assert abs(following - acceleration) <= step * (1 + 1e-12)
        acceleration = following
        speed += acceleration * PERIOD
        assert abs(acceleration) <= 0.3
        assert abs(speed) <= 0.2 + 1e-9
    assert abs(speed) >= 0.19  # the limit is used, not only kept


def test_a_mode_without_its_limit_is_refused() -> None:
    from envs.physics.actuation import actuation_constants
    from planners import PLANAR_3R

    with pytest.raises(ValueError, match='control_mode "jerk" scales actions by the jerk limits, but PLANAR_3R'):
        actuation_constants(PLANAR_3R, "jerk")


def test_limits_are_watched_per_period() -> None:
    env = started()
    speeds, taus = [env.joint_state()[1]], []
    generator = np.random.default_rng(0)
    info: dict[str, Any] = {}
    truncated = False
    while not truncated:
        action = generator.uniform(-0.3, 0.3, 2).astype(np.float32)
        *_, truncated, info = env.step(action)
        speeds.append(env.joint_state()[1])
        taus.append(np.abs(action) * [0.5, 0.2])
    acceleration = np.diff(speeds, axis=0) / PERIOD
    jerk = np.diff(np.vstack([np.zeros(2), acceleration]), axis=0) / PERIOD
    expected = {
        "torque": np.max(taus / np.array([0.5, 0.2])),
        "velocity": np.max(np.abs(speeds)) / 0.2,
        "acceleration": np.max(np.abs(acceleration)) / 0.3,
        "jerk": np.max(np.abs(jerk) / [2.3, 2.0]),
        "angle": 0.0,
    }
    assert dict(zip(LIMIT_KINDS, info["limit_ratios"], strict=True)) == pytest.approx(expected, rel=1e-9)
    assert info["limit_ratio"] == pytest.approx(max(expected.values()), rel=1e-9)
