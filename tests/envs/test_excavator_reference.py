"""What motions ExcavatorPayload asks for."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import envs  # noqa: F401  (registers the ids)
from envs.excavator_payload.reference import HIGHEST, LOWEST, draw_reference, numbers_needed
from planners.excavator import EXCAVATOR
from planners.excavator.motion import WORK_CYCLE, Cycle
from planners.excavator.plane import JOINTS, planar_dynamics, planar_payload
from planners.typing import Array

ENV_ID = "ExcavatorPayload-v0"
ENV: Any = gym.make(ENV_ID, control_mode="residual", encoder_noise=0.0).unwrapped
RESTING = np.zeros(3, dtype=np.float32)


def waypoints(env: Any) -> tuple[Array, Array]:
    """Angles and times of an environment's waypoints."""
    record = env.task.batch[0]
    count = int(record["n_waypoints"])
    return record["waypoints"][:count].copy(), 0.02 * record["due"][:count]


def sampled(env: Any) -> tuple[Array, Array, Array]:
    """The reference, every 5 ms, by an independent interpolation."""
    angles, times = waypoints(env)
    ways = Cycle(angles, np.append(np.diff(times), 1.0))
    return ways.sample(np.arange(0.0, times[-1], 5e-3))


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_what_is_drawn_can_be_done(seed: int) -> None:
    ENV.reset(seed=seed)
    angles, times = waypoints(ENV)
    assert ((angles >= LOWEST) & (angles <= HIGHEST)).all()
    assert times[-1] >= 12.0
    assert times[-2] < 12.4
    assert np.diff(times).min() >= 1.2 - 1e-9
    q, qd, qdd = sampled(ENV)
    load = np.tile(planar_payload(350.0), (len(q), 1))
    torque = planar_dynamics().torque(q, qd, qd, qdd, load)
    # 17 samples of a way are looked at, between two of which the torque may be a little higher
    assert (np.abs(torque) / np.array(EXCAVATOR.limits.torque)[JOINTS]).max() < 0.86
    assert (np.abs(qd) / np.array(EXCAVATOR.limits.velocity[JOINTS])).max() <= 0.85 + 1e-9


def test_ways_are_as_slow_as_documented() -> None:
    stretches = []
    for seed in range(40):
        ENV.reset(seed=seed)
        angles, times = waypoints(ENV)
        change = np.abs(np.diff(angles, axis=0)) / (0.85 * np.array(EXCAVATOR.limits.velocity[JOINTS]))
        stretches += (np.diff(times) / np.maximum(1.2, 1.875 * change.max(axis=1))).tolist()
    assert min(stretches) >= 1.0 - 1e-9
    assert max(stretches) <= 1.5 + 0.02 / 1.2
    assert np.mean(stretches) == pytest.approx(1.25, abs=0.03)


def test_drawing_ends_when_its_numbers_are_used_up() -> None:
    task = gym.make(ENV_ID).unwrapped.task  # type: ignore[attr-defined]
    model = task._batch.model.copy()
    model["gravity"] *= 10.0  # nothing can be held anywhere
    draw_reference(task._batch.records, model, 0, np.random.default_rng(0).random(numbers_needed(12.0)))
    env = task.batch[0]
    count = int(env["n_waypoints"])
    np.testing.assert_array_equal(np.ptp(env["waypoints"][:count], axis=0), 0.0)
    assert env["due"][count - 1] >= 600


def test_an_observation_tells_the_reference() -> None:
    observation, _ = ENV.reset(seed=5)
    angles, times = waypoints(ENV)
    ways = Cycle(angles, np.append(np.diff(times), 1.0))
    for step in range(600):
        seen = ENV.task.layout.parse(observation)
        q, qd, qdd = ways.sample([0.02 * step])
        ahead = ways.sample(0.02 * step + np.array([0.1, 0.2, 0.4]))[0]
        np.testing.assert_allclose(seen["joint_position"] + seen["reference_error"], q[0], atol=1e-6)
        np.testing.assert_allclose(seen["reference_velocity"], qd[0], atol=1e-6)
        np.testing.assert_allclose(seen["reference_acceleration"], qdd[0], atol=1e-6)
        np.testing.assert_allclose(seen["reference_ahead"].reshape(3, 3), ahead - q, atol=1e-6)
        following = int(np.searchsorted(times, 0.02 * step, side="right"))
        np.testing.assert_allclose(seen["waypoint"], angles[following], atol=1e-6)
        assert seen["waypoint_time"][0] == pytest.approx(times[following] - 0.02 * step, abs=1e-5)
        assert seen["time_left"][0] == pytest.approx(12.0 - 0.02 * step, abs=1e-5)
        observation, *_ = ENV.step(RESTING)


def test_the_cycle() -> None:
    ENV.reset(seed=0, options={"scenario": "cycle"})
    angles, times = waypoints(ENV)
    np.testing.assert_allclose(angles[:4], WORK_CYCLE.postures[[0, 1, 2, 0], JOINTS])
    np.testing.assert_allclose(times[:4], [0.0, 2.0, 5.0, 8.0])
    assert times[-1] >= 12.4


def test_waypoints_by_hand() -> None:
    way = [[0.2, -1.2, 0.3], [0.5, -1.0, 0.6], [0.3, -1.4, 0.2]]
    ENV.reset(seed=0, options={"waypoints": way, "arrival_times": [1.5, 3.2]})
    angles, times = waypoints(ENV)
    np.testing.assert_array_equal(angles, way)
    np.testing.assert_allclose(times, [0.0, 1.5, 3.2])
    for _ in range(300):
        observation, *_ = ENV.step(RESTING)
    seen = ENV.task.layout.parse(observation)
    for name in ("reference_velocity", "reference_acceleration", "reference_ahead", "waypoint_time"):
        np.testing.assert_array_equal(seen[name], 0.0)
    np.testing.assert_allclose(seen["joint_position"] + seen["reference_error"], way[-1], atol=1e-6)


def test_waypoints_without_times_come_as_soon_as_allowed() -> None:
    ENV.reset(seed=0, options={"waypoints": [[0.0, -1.2, 0.3], [0.6, -1.2, 0.3], [0.59, -1.2, 0.3]]})
    assert waypoints(ENV)[1] == pytest.approx([0.0, 1.9, 3.1])  # 1.875 x 0.6 / (0.85 x 0.7) = 1.891 s; 1.2 s at least


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"waypoints": [[0.2, -1.2, 0.3]]}, "1 waypoints; give 2 to 53"),
        (
            {"waypoints": [[0.2, -1.2, 0.3], [1.2, -1.2, 0.3]]},
            r"waypoint 1 \[1.2, .* outside the ranges \[-0.1745, 0.9",
        ),
        ({"waypoints": [[0.2, -1.2], [0.3, -1.2]]}, "waypoints.0"),
        ({"waypoints": [[0.2, -1.2, 0.3], [0.4, -1.2, 0.3]], "arrival_times": [1.0, 2.0]}, "2 arrival_times for 2 way"),
        (
            {"waypoints": [[0.2, -1.2, 0.3], [0.4, -1.2, 0.3]], "arrival_times": [1.01]},
            "multiples of the control period",
        ),
        ({"waypoints": [[0.2, -1.2, 0.3], [0.4, -1.2, 0.3]], "arrival_times": [0.0]}, "must be positive and grow"),
        ({"waypoints": [[0.2, -1.2, 0.3], [0.4, -1.2, 0.3]], "arrival_times": [0.4]}, "speed limit; give it more time"),
        ({"arrival_times": [1.0]}, "arrival_times are given without waypoints"),
        ({"payload": 351.0}, "payload = 351.0"),
        ({"payload": -1.0}, "payload = -1.0"),
        ({"friction_scale": -0.1}, "friction_scale = -0.1"),
        ({"payload_ofset": (0.0, 0.0)}, 'did you mean "payload_offset"'),
        ({"scenario": "paper"}, "scenario = 'paper'"),
    ],
)
def test_a_bad_option_is_refused_and_changes_nothing(options: dict[str, Any], complaint: str) -> None:
    before, _ = ENV.reset(seed=0)
    with pytest.raises(ValueError, match=complaint):
        ENV.reset(options=options)
    np.testing.assert_array_equal(ENV.task.batch["observation"][0], before)
