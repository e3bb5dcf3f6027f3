"""What is true of an episode and what a policy knows: model error, friction, latency and noise in every task."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import envs

PERIODS = {env_id: float(gym.make(env_id).unwrapped.task.config.control_period) for env_id in envs.env_ids()}  # type: ignore[attr-defined]
CAMERAS = ("ConveyorTrack-v0", "ObstacleDodge-v0")
every_env = pytest.mark.parametrize("env_id", sorted(PERIODS))
RANGES: dict[str, Any] = {
    "mass_error": (-0.2, 0.1),
    "viscous_friction": (0.0, 0.02),
    "coulomb_friction": (0.0, 0.01),
    "latency": (0.0, 0.03),
    "encoder_noise": (0.0, 1e-3),
}


def make(env_id: str, **settings: Any) -> Any:
    return gym.make(env_id, **settings).unwrapped


def roll(env: Any, seed: int | None = 3, steps: int = 25) -> list[Any]:
    """Observation, true joint state, reward and success of each step under the same small actions."""
    env.reset(seed=seed)
    shown = []
    for step in range(steps):
        action = 0.2 * np.sin(0.1 * step + np.arange(env.action_space.shape[0])).astype(np.float32)
        observation, reward, terminated, truncated, info = env.step(action)
        shown.append((observation, *env.joint_state(), reward, info["is_success"]))
        if terminated or truncated:
            break
    return shown


def angles(env: Any, seed: int = 3, steps: int = 25) -> Any:
    return np.array([shown[1] for shown in roll(env, seed, steps)])


@every_env
def test_ranges_are_drawn_from_the_seed_alike_in_single_and_vector_environments(env_id: str) -> None:
    used = make(env_id, **RANGES)
    roll(used, 9)
    alone = roll(used, 5)
    vector = gym.make_vec(env_id, num_envs=3, **RANGES)
    vector.reset(seed=3)
    for step, (observation, *_) in enumerate(alone[:10]):
        action = 0.2 * np.sin(0.1 * step + np.arange(vector.single_action_space.shape[0])).astype(np.float32)  # type: ignore[index]
        observations, *_ = vector.step(np.tile(action, (3, 1)))
        np.testing.assert_array_equal(observations[2], observation)
    truth = vector.unwrapped.task.batch  # type: ignore[attr-defined]
    for name in (*RANGES, "mass_scale"):
        drawn = truth["mass_scale"] - 1.0 if name in ("mass_error", "mass_scale") else truth[name]
        low, high = RANGES.get(name, RANGES["mass_error"])
        assert (drawn >= low - 1e-12).all()
        assert (drawn <= high + 1e-12).all()
        assert len(np.unique(drawn)) > 1


@every_env
def test_an_episode_with_all_of_it_continues_from_its_state(env_id: str) -> None:
    env = make(env_id, **RANGES)
    roll(env, steps=6)
    other = make(env_id, **RANGES)
    other.reset(seed=8)
    other.set_state(env.get_state())
    action = np.full(env.action_space.shape, 0.1, np.float32)
    for one in (other, copy.deepcopy(env)):
        env_state = env.get_state()
        shown = [env.step(action)[0] for _ in range(4)]
        again = [one.step(action)[0] for _ in range(4)]
        np.testing.assert_array_equal(shown, again)
        env.set_state(env_state)


@every_env
def test_episodes_of_one_seed_differ_in_what_is_drawn_only(env_id: str) -> None:
    plain, uncertain = make(env_id), make(env_id, latency=(0.0, 2.0 * PERIODS[env_id]), mass_error=(-0.1, 0.1))
    plain.reset(seed=4)
    uncertain.reset(seed=4)
    np.testing.assert_array_equal(plain.joint_state(), uncertain.joint_state())


@every_env
@pytest.mark.parametrize("setting", [{"mass_error": -0.1}, {"viscous_friction": 0.5}, {"coulomb_friction": 0.05}])
def test_the_true_robot_moves_otherwise_than_the_nominal_one(env_id: str, setting: dict[str, float]) -> None:
    if env_id == "ExcavatorPayload-v0":
        setting = {name: value if name == "mass_error" else 2e4 * value for name, value in setting.items()}
    assert np.abs(angles(make(env_id, **setting), steps=15) - angles(make(env_id), steps=15)).max() > 1e-5
    assert make(env_id, **setting).task.arm == make(env_id).task.arm


def test_light_links_accelerate_in_inverse_proportion_to_their_mass() -> None:
    heavy, light = (angles(make("ConveyorTrack-v0", mass_error=error), steps=1) for error in (0.0, -0.5))
    start = make("ConveyorTrack-v0")
    start.reset(seed=3)
    q = start.joint_state()[0]
    np.testing.assert_allclose(light[0] - q, 2.0 * (heavy[0] - q), rtol=1e-3)


@pytest.mark.parametrize(("name", "value"), [("viscous_friction", 0.4), ("coulomb_friction", 0.02)])
def test_friction_takes_energy_and_stops_a_joint_without_turning_it(name: str, value: float) -> None:
    speeds = []
    for setting in ({}, {name: value}):
        env = make("MinTorqueMove-v0", **setting)
        env.reset(seed=1, options={"scenario": "paper"})
        for step in range(150):
            env.step(np.full(3, 0.02 if step < 20 else 0.0, np.float32))
        speeds.append(np.abs(env.joint_state()[1]).max())
    assert speeds[1] < 0.3 * speeds[0]


def test_viscous_friction_takes_off_what_it_says() -> None:
    env = make("ConveyorTrack-v0", viscous_friction=0.01, physics_step=1e-3)
    env.reset(seed=1)
    for _ in range(10):
        env.step(np.full(2, 0.5, np.float32))
    q, qd = env.joint_state()
    env.step(np.zeros(2, np.float32))
    found = (env.joint_state()[1] - qd) / 0.02
    arm = env.task.arm
    np.testing.assert_allclose(found, arm.forward_dynamics(q, qd, -0.01 * qd), rtol=0.02)


@pytest.mark.parametrize("halves", [1, 2, 3])
def test_a_torque_comes_late_by_half_and_whole_control_periods(halves: int) -> None:
    period = PERIODS["ConveyorTrack-v0"]
    late, prompt = make("ConveyorTrack-v0", latency=halves * 0.5 * period), make("ConveyorTrack-v0")
    late.reset(seed=2)
    prompt.reset(seed=2)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (8, 2)).astype(np.float32)
    whole, half = divmod(halves, 2)
    if half:  # the mean torque of a period is that of both commands that act in it
        applied = [np.zeros(2, np.float32)] * (whole + 1) + list(actions)
        for step, action in enumerate(actions):
            late.step(action)
            prompt.step(0.5 * (applied[step] + applied[step + 1]))
        np.testing.assert_allclose(late.joint_state()[1], prompt.joint_state()[1], atol=2e-4)
    else:
        for step, action in enumerate(actions):
            late.step(action)
            prompt.step(actions[step - whole] if step >= whole else np.zeros(2, np.float32))
        np.testing.assert_array_equal(late.joint_state(), prompt.joint_state())
    assert np.abs(late.joint_state()[1]).max() > 1e-3


@every_env
def test_noise_is_in_the_observation_only(env_id: str) -> None:
    camera = {"camera_noise": 1e-3} if env_id in CAMERAS else {}
    noisy, plain = make(env_id, encoder_noise=2e-3, **camera), make(env_id, encoder_noise=0.0)
    noisy_steps, plain_steps = roll(noisy), roll(plain)
    for (seen, *true), (clear, *same) in zip(noisy_steps, plain_steps, strict=True):
        for one, other in zip(true, same, strict=True):
            np.testing.assert_array_equal(one, other)
        assert np.abs(seen - clear).max() > 0.0
    parse: Callable[[Any], dict[str, Any]] = noisy.task.layout.parse
    q, qd = (
        np.array([parse(shown[0])[name] - shown[at] for shown in noisy_steps])
        for name, at in (("joint_position", 1), ("joint_velocity", 2))
    )
    assert q.std() == pytest.approx(2e-3, rel=0.35)
    assert qd.std() == pytest.approx(2e-3 / PERIODS[env_id], rel=0.35)


@pytest.mark.parametrize(("env_id", "place", "rate"), [
    ("ConveyorTrack-v0", "part", "part_velocity"), ("ObstacleDodge-v0", "obstacle", "obstacle_velocity"),
])  # fmt: skip
def test_a_camera_sees_places_and_velocities_with_noise(env_id: str, place: str, rate: str) -> None:
    noisy, plain = (make(env_id, camera_noise=noise) for noise in (1e-3, 0.0))
    parse = noisy.task.layout.parse
    pairs = list(zip(roll(noisy, steps=60), roll(plain, steps=60), strict=True))
    for name, deviation in ((place, 1e-3), (rate, 1e-3 / PERIODS[env_id])):
        wrong = np.array([parse(one[0])[name] - parse(other[0])[name] for one, other in pairs])
        assert wrong.std() == pytest.approx(deviation, rel=0.3)
        assert abs(np.corrcoef(wrong[:-1].ravel(), wrong[1:].ravel())[0, 1]) < 0.4


@pytest.mark.parametrize("env_id", CAMERAS)
def test_what_follows_from_measurements_fits_them(env_id: str) -> None:
    env = make(env_id, encoder_noise=1e-2, camera_noise=1e-2)
    observation, _ = env.reset(seed=0)
    seen = env.task.layout.parse(observation)
    hand = env.task.arm.forward_kinematics(seen["joint_position"]) - env.task.arm.base_array
    np.testing.assert_allclose(seen["hand"], hand, atol=1e-5)
    target, error = ("part", "part_error") if env_id == "ConveyorTrack-v0" else ("goal", "goal_error")
    np.testing.assert_allclose(seen[error], seen[target] - seen["hand"], atol=1e-5)


def test_a_payload_may_have_a_range() -> None:
    vector = gym.make_vec("MinTorqueMove-v0", num_envs=8, payload=(0.1, 0.4))
    vector.reset(seed=0)
    truth = vector.unwrapped.task.batch  # type: ignore[attr-defined]
    assert len(np.unique(truth["payload"])) == 8
    arm = make("MinTorqueMove-v0").task.arm
    for record in truth:
        np.testing.assert_allclose(record["masses"][-1], arm.masses[-1] + record["payload"])


@pytest.mark.parametrize(("settings", "message"), [
    ({"mass_error": (0.1, -0.1)}, r"mass_error.*range is \[low, high\].*\[-0.1, 0.1\]"),
    ({"mass_error": -1.0}, "mass_error = -1.0: .*must be from -0.9 to 9"),
    ({"latency": 0.003}, "latency 0.003 s is no multiple of physics_step 0.002 s"),
    ({"latency": (0.0, 0.5)}, "longer than 8 control periods, 0.16 s"),
    ({"encoder_noise": -1e-3}, "encoder_noise"),
    ({"payload": (0.0, 11.0)}, "payload.*must be from 0 to 10"),
])  # fmt: skip
def test_what_cannot_be_is_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        gym.make("ConveyorTrack-v0", **settings)


@pytest.mark.parametrize("kind", [np.float32, np.float64, np.int64, np.array])
def test_numbers_of_numpy_are_settings_and_options(kind: Any) -> None:
    settings = {"payload": [kind(0), kind(2)], "mass_error": kind(0), "camera_noise": kind(0)}
    env = gym.make("ConveyorTrack-v0", **settings, disable_env_checker=True)
    env.reset(seed=0, options={"belt_speed": np.float32(0.25)})
    assert env.unwrapped.task.config.payload == (0.0, 2.0)  # type: ignore[attr-defined]


def test_a_task_without_a_camera_has_no_camera_noise() -> None:
    with pytest.raises(ValueError, match="camera_noise"):
        gym.make("MinTorqueMove-v0", camera_noise=1e-3)


def test_the_closed_form_refuses_what_it_does_not_know() -> None:
    with pytest.raises(ValueError, match='physics "closed_form" has no mass_error'):
        gym.make("MinTorqueMove-v0", physics="closed_form", mass_error=0.1)


@pytest.mark.parametrize("speed", [10**400, [0.1, 10**400], 1e200, float("nan")])
def test_a_number_beyond_what_a_float_holds_is_refused_by_name(speed: object) -> None:
    env = gym.make("ConveyorTrack-v0", disable_env_checker=True)
    with pytest.raises(ValueError, match="belt_speed"):
        env.reset(seed=0, options={"belt_speed": speed})
