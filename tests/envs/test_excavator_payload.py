"""The task: what is hidden, what is measured, how it is judged."""

from __future__ import annotations

import math
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import envs  # noqa: F401  (registers the ids)
from envs.excavator_payload.kernels import RESIDUAL_SHARE
from envs.physics.actuation import LIMIT_KINDS
from planners import quintic
from planners.control import SlotineLi
from planners.excavator.controllers import make_controller
from planners.excavator.plane import planar_arm, planar_dynamics, planar_payload
from planners.typing import Array

ENV_ID = "ExcavatorPayload-v0"
TORQUE_LIMITS = np.array([45e3, 22e3, 10e3])
RESTING = np.zeros(3, dtype=np.float32)


def make(**config: Any) -> Any:
    return gym.make(ENV_ID, **config).unwrapped


def follow(env: Any, law: str = "integral-slotine-li") -> tuple[list[Any], dict[str, Any]]:
    """Play the episode that has begun with a controller that sees the observation only: its steps and last info."""
    controller, steps = make_controller(law, planar=True), []
    observation = env.task.batch["observation"][0].copy()
    while True:
        seen = {name: value[None] for name, value in env.task.layout.parse(observation).items()}
        q, qd = seen["joint_position"], seen["joint_velocity"]
        wanted = (q + seen["reference_error"], seen["reference_velocity"], seen["reference_acceleration"])
        tau = controller.torque(q, qd, *wanted)[0]
        observation, *outcome = env.step((tau / TORQUE_LIMITS).astype(np.float32))
        steps.append((observation, *outcome, env.joint_state(), wanted, tau))
        if outcome[1] or outcome[2]:
            return steps, outcome[3]


def test_an_adaptive_controller_succeeds_and_a_fixed_one_does_not() -> None:
    env = make()
    for seed in range(3):
        for law, succeeds in (("integral-slotine-li", True), ("integral-computed-torque", False)):
            env.reset(seed=seed, options={"payload": 300.0})
            steps, info = follow(env, law)
            assert len(steps) == 600
            assert info["is_success"] == info["success_easy"] == succeeds
            assert not any(step[4]["is_success"] for step in steps[:-1])


@pytest.mark.parametrize("level", [1, 2])
def test_the_numbers_of_an_episode(level: int) -> None:
    env = make(level=level)
    env.reset(seed=1, options={"payload": 200.0, "friction_scale": 0.9})
    angles, times = env.task.batch["waypoints"][0].copy(), env.task.batch["due"][0].copy()
    pick, drop = int(env.task.batch["pick_step"][0]), int(env.task.batch["drop_step"][0])
    assert (pick, drop) == (0, -1) or (150 <= pick <= 250 and 400 <= drop <= 450)
    steps, info = follow(env)
    assert level == 2 or info["limit_ratios"][LIMIT_KINDS.index("torque")] < 1.0
    tau = np.array([np.clip(step[7], -TORQUE_LIMITS, TORQUE_LIMITS) for step in steps])
    q = np.array([env.task.layout.parse(step[0])["joint_position"] for step in steps])
    error = np.array([env.task.layout.parse(step[0])["reference_error"] for step in steps])
    true_q = np.array([step[5][0] for step in steps])
    judged = np.arange(1, 601) > 200
    if level == 2:
        for change in (pick, drop):
            judged &= ~((np.arange(1, 601) > change) & (np.arange(1, 601) <= change + 100))
    off = np.linalg.norm(tips(true_q) - tips(q + error), axis=1)
    assert info["tip_rms"] == pytest.approx(np.sqrt(np.mean(off[judged] ** 2)), rel=1e-3)
    assert info["tip_max"] == pytest.approx(off[judged].max(), rel=1e-3)
    assert info["joint_rms"] == pytest.approx(np.sqrt(np.mean((q + error - true_q)[judged] ** 2)), rel=1e-3)
    due = [int(time) for time in times[1:] if 0 < time <= 600 and judged[int(time) - 1]]
    missed = [np.linalg.norm(tips(true_q[k - 1]) - tips(angles[list(times).index(k)])) for k in due]
    assert info["waypoint_error"] == pytest.approx(max(missed), rel=1e-3)
    assert info["payload_mass"] == 200.0
    assert info["friction_scale"] == 0.9
    assert info["torque_l1"] == pytest.approx(0.02 * np.abs(tau).sum(), rel=1e-5)
    assert info["peak_torque"] == pytest.approx(np.abs(tau).max(), rel=1e-5)
    assert info["limit_ratio"] == info["limit_ratios"].max()
    assert info["limit_ratios"][LIMIT_KINDS.index("torque")] == pytest.approx(
        (np.abs(tau) / TORQUE_LIMITS).max(), rel=1e-5
    )


def tips(q: Array) -> Array:
    """Position of the tip, by hand."""
    phi = np.cumsum(q, axis=-1)
    x = 2.45 * np.cos(phi[..., 0]) + 1.4 * np.cos(phi[..., 1]) - 0.55 * np.cos(phi[..., 2]) + 0.35 * np.sin(phi[..., 2])
    y = 2.45 * np.sin(phi[..., 0]) + 1.4 * np.sin(phi[..., 1]) - 0.55 * np.sin(phi[..., 2]) - 0.35 * np.cos(phi[..., 2])
    return np.stack([x, y], axis=-1)


def test_the_reward() -> None:
    env = make(control_mode="residual", reward_distance=0.2, smoothness_weight=0.5)
    env.reset(seed=0, options={"payload": 250.0})
    before = np.zeros(3)
    for action in np.random.default_rng(0).uniform(-0.2, 0.2, (50, 3)).astype(np.float32):
        _, reward, *_, info = env.step(action)
        error = np.linalg.norm(env.task.batch["tip"][0] - env.task.batch["wanted_tip"][0])
        assert info["reward_tracking"] == pytest.approx((1.0 - min(1.0, error / 0.2)) / 60.0)
        assert info["reward_smoothness"] == pytest.approx(-0.5 * np.sum((action - before) ** 2) / 60.0)
        assert reward == pytest.approx(sum(info[f"reward_{term}"] for term in ("tracking", "smoothness", "failure")))
        before = action.astype(float)


def test_a_perfect_episode_is_worth_ten() -> None:
    env = make(encoder_noise=0.0)
    env.reset(seed=0, options={"payload": 0.0, "friction_scale": 1.0})
    steps, _ = follow(env)
    assert sum(step[1] for step in steps) == pytest.approx(10.0, abs=0.15)


@pytest.mark.parametrize("action", [[1.0, 0.0, 0.0], [0.3, 0.2, 1.0]])
def test_running_away_ends_the_episode_and_costs_more_than_going_on_could(action: list[float]) -> None:
    env = make()
    env.reset(seed=0)
    rewards: list[float] = []
    over = False
    while not over:
        _, reward, over, truncated, info = env.step(np.array(action, dtype=np.float32))
        rewards.append(reward)
        assert not truncated
    q, qd = env.joint_state()
    outside = np.maximum([-10.0, -110.0, -20.0] - np.degrees(q), np.degrees(q) - [55.0, -40.0, 70.0])
    assert outside.max() > 30.0 or np.abs(qd).max() > 6.0
    assert info["reward_failure"] == -2.0
    worst_of_going_on = 10.0 * 0.01 * 3.0 * 2.0**2
    assert -info["reward_failure"] > worst_of_going_on
    assert not info["is_success"]
    assert not info["success_easy"]
    assert {info[name] for name in ("tip_rms", "tip_max", "joint_rms", "waypoint_error")} == {math.inf}


def test_the_first_observation_does_not_tell_the_load() -> None:
    env = make()
    loads: list[dict[str, Any]] = [{"payload": 0.0}, {"payload": 350.0, "payload_offset": (0.1, 0.08)}, {}]
    first, *others = [env.reset(seed=4, options=load)[0] for load in loads]
    for other in others:
        np.testing.assert_array_equal(other, first)


def test_no_observation_before_the_pick_up_tells_the_load() -> None:
    shown = []
    for payload in (0.0, 350.0):
        env = make(level=2, control_mode="residual")
        env.reset(seed=4, options={"payload": payload})
        pick = int(env.task.batch["pick_step"][0])
        shown.append([env.step(RESTING)[0] for _ in range(pick + 5)])
    np.testing.assert_array_equal(shown[0][:pick], shown[1][:pick])
    assert (shown[0][-1] != shown[1][-1]).any()


def test_what_is_hidden_is_drawn_as_documented() -> None:
    task = gym.make_vec(ENV_ID, num_envs=400)
    task.reset(seed=0)
    batch = task.unwrapped.task.batch  # type: ignore[attr-defined]
    ends = {"payload": (0.0, 350.0), "friction_scale": (0.7, 1.5)}
    for name, (low, high) in ends.items():
        share = (batch[name] - low) / (high - low)
        assert 0.0 <= share.min() < 0.02
        assert 0.98 < share.max() <= 1.0
        assert share.mean() == pytest.approx(0.5, abs=0.05)
    for axis, reach in enumerate((0.10, 0.08)):
        offset = batch["load_offset"][:, axis]
        assert np.abs(offset).max() <= reach
        assert np.ptp(offset) > 1.9 * reach
        assert abs(np.corrcoef(offset, batch["payload"])[0, 1]) < 0.15
    middling = gym.make_vec(ENV_ID, num_envs=400, lightest=40.0, payload=50.0)
    middling.reset(seed=0)
    loads = middling.unwrapped.task.batch["payload"]  # type: ignore[attr-defined]
    assert 40.0 <= loads.min() < 40.1
    assert 49.9 < loads.max() <= 50.0


@pytest.mark.parametrize(
    ("noise", "deviations"), [({}, (1e-4, 5e-3)), ({"encoder_noise": 1e-3, "velocity_noise": 0.02}, (1e-3, 0.02))]
)
def test_noise_is_as_documented(noise: Any, deviations: tuple[float, float]) -> None:
    env = make(**noise)
    env.reset(seed=2)
    steps, _ = follow(env)
    for name, true, deviation in zip(("joint_position", "joint_velocity"), (0, 1), deviations, strict=True):
        wrong = np.array([env.task.layout.parse(step[0])[name] - step[5][true] for step in steps])
        assert wrong.std() == pytest.approx(deviation, rel=0.06)
        assert abs(wrong.mean()) < 4.0 * deviation / math.sqrt(wrong.size)


def test_without_noise_the_truth_is_measured() -> None:
    env = make(encoder_noise=0.0, control_mode="residual")
    env.reset(seed=2)
    for _ in range(20):
        seen = env.task.layout.parse(env.step(RESTING)[0])
        np.testing.assert_allclose(seen["joint_position"], env.joint_state()[0], atol=1e-6)
        np.testing.assert_allclose(seen["joint_velocity"], env.joint_state()[1], atol=1e-6)


def test_the_integral_is_that_of_the_errors_seen_before() -> None:
    env = make(control_mode="residual")
    observation, _ = env.reset(seed=2)
    total = np.zeros(3)
    for _ in range(100):
        seen = env.task.layout.parse(observation)
        np.testing.assert_allclose(seen["error_integral"], total, atol=1e-5)
        total += 0.02 * seen["reference_error"]
        observation, *_ = env.step(RESTING)


def test_a_residual_of_zero_is_the_frozen_controller() -> None:
    env = make(control_mode="residual")
    observation, _ = env.reset(seed=6)
    known = make_controller("slotine-li", planar=True, moments=False)
    frozen = SlotineLi(known.model, known.settings, known.prior, gain=np.zeros(1))
    for _ in range(200):
        seen = {name: value[None] for name, value in env.task.layout.parse(observation).items()}
        q, qd = seen["joint_position"], seen["joint_velocity"]
        wanted = (q + seen["reference_error"], seen["reference_velocity"], seen["reference_acceleration"])
        tau = frozen.torque(q, qd, *wanted)
        observation, *_ = env.step(RESTING)
        commanded = TORQUE_LIMITS * env.task.layout.parse(observation)["last_torque"]
        np.testing.assert_allclose(commanded, tau[0], rtol=1e-5, atol=1.0)


def test_a_residual_adds_its_share() -> None:
    torques = []
    for action in (RESTING, np.array([0.5, -0.5, 1.0], dtype=np.float32), np.ones(3, dtype=np.float32)):
        env = make(control_mode="residual")
        env.reset(seed=6)
        env.step(action)
        torques.append(env.task.batch["tau"][0].copy())
    np.testing.assert_allclose(torques[1] - torques[0], [9000.0, -4400.0, 3000.0], rtol=1e-9)
    np.testing.assert_allclose(torques[2] - torques[0], RESIDUAL_SHARE * TORQUE_LIMITS, rtol=1e-9)


def test_last_torque_begins_with_what_holds_the_empty_machine() -> None:
    env = make()
    observation, _ = env.reset(seed=0, options={"payload": 300.0})
    q, still = env.joint_state()[0][None], np.zeros((1, 3))
    held = planar_dynamics().torque(q, still, still, still)[0] / TORQUE_LIMITS
    np.testing.assert_allclose(env.task.layout.parse(observation)["last_torque"], held, atol=1e-6)


def test_the_drives_lag_on_level_2() -> None:
    env = make(level=2)
    env.reset(seed=0)
    held = env.task.batch["drive_torque"][0].copy()
    env.step(np.array([0.5, 0.2, 0.1], dtype=np.float32))
    done = (env.task.batch["drive_torque"][0] - held) / (env.task.batch["tau"][0] - held)
    np.testing.assert_allclose(done, 1.0 - math.exp(-0.02 / 0.03), rtol=1e-9)


@pytest.mark.parametrize("control_mode", ["torque", "residual"])
@pytest.mark.parametrize("num_envs", [3, 70])  # 70 environments run on two threads
def test_environments_equal_single_environments_bit_for_bit(num_envs: int, control_mode: str) -> None:
    steps = 650  # some environments end early, all begin a second episode
    actions = np.random.default_rng(0).uniform(-0.3, 0.6, (steps, num_envs, 3)).astype(np.float32)
    vector = gym.make_vec(ENV_ID, num_envs=num_envs, autoreset_mode="SameStep", level=2, control_mode=control_mode)
    shown = [vector.reset(seed=30)[0]]
    ended = []
    for action in actions:
        observations, rewards, terminated, truncated, _ = vector.step(action)
        shown.append(observations)
        ended.append((rewards, terminated, truncated))
    for env_index in (0, num_envs // 2, num_envs - 1):
        env = make(level=2, control_mode=control_mode)
        np.testing.assert_array_equal(env.reset(seed=30 + env_index)[0], shown[0][env_index])
        for k in range(steps):
            observation, *outcome, _ = env.step(actions[k, env_index])
            assert outcome == [part[env_index] for part in ended[k]]
            if outcome[1] or outcome[2]:
                observation, _ = env.reset()
            np.testing.assert_array_equal(observation, shown[k + 1][env_index])


def test_a_motion_problem_leads_to_the_next_waypoint_in_time() -> None:
    env = make()
    for seed in range(5):
        observation, _ = env.reset(seed=seed)
        seen = env.task.layout.parse(observation)
        problem = env.task.motion_problem(observation)
        plan = quintic.plan(problem)
        assert plan.duration == pytest.approx(seen["waypoint_time"][0])
        np.testing.assert_allclose(plan.q[-1], seen["waypoint"], atol=1e-9)
        assert plan.limit_ratio <= 1.0
        load = np.tile(planar_payload(350.0), (len(plan.t), 1))
        torque = planar_dynamics().torque(plan.q, plan.qd, plan.qd, plan.qdd, load)
        assert (np.abs(torque) < TORQUE_LIMITS).all()


def test_the_planning_arm_is_as_near_as_documented() -> None:
    q = np.radians(np.random.default_rng(0).uniform([-10, -110, -20], [55, -40, 70], (2000, 3)))
    qd, qdd = np.random.default_rng(1).uniform(-1.0, 1.0, (2, 2000, 3)) * [[[0.6, 0.7, 1.2]], [[1.0, 1.2, 2.0]]]
    for payload, documented in ((350.0, (0.14, 0.17, 0.33)), (175.0, (0.10, 0.11, 0.22))):
        load = np.tile(planar_payload(payload), (2000, 1))
        right = planar_dynamics().torque(q, qd, qd, qdd, load)
        wrong = np.abs(planar_arm().with_payload(payload).inverse_dynamics(q, qd, qdd) - right) / TORQUE_LIMITS
        assert (wrong.max(axis=0) < documented).all()


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("payload", 400.0),
        ("lightest", 351.0),
        ("level", 3),
        ("encoder_noise", (1e-4,)),
        ("encoder_noise", (-1e-4, 0.0)),
        ("horizon", 61.0),
    ],
)
def test_a_bad_setting_is_refused(setting: str, value: object) -> None:
    with pytest.raises(ValueError, match=rf"{ENV_ID} setting: {setting}"):
        gym.make(ENV_ID, **{setting: value})  # type: ignore[arg-type]


def test_a_frame_shows_the_bucket_and_its_load() -> None:
    frames = []
    for payload in (0.0, 350.0):
        env = make(render_mode="rgb_array")
        env.reset(seed=0, options={"payload": payload})
        scene = env.task.scene(0, [])
        np.testing.assert_allclose(scene.joints[-1], scene.target, atol=1e-12)  # the start is on the reference
        assert scene.bucket == payload / 350.0
        frames.append(env.render())
        env.close()
    left = frames[0].shape[1] * 2 // 3
    assert (frames[0][:, :left] != frames[1][:, :left]).any()  # in the picture, not only in the panel


@pytest.mark.parametrize("offset", [(0.0, 1e300), (1.1, 0.0), (0.0, -2.0), (math.nan, 0.0)])
def test_a_payload_outside_of_any_bucket_is_refused(offset: tuple[float, float]) -> None:
    """Chipmunk aborts the process where such an offset makes a moment of inertia negative."""
    env = gym.make("ExcavatorPayload-v0", disable_env_checker=True)
    with pytest.raises(ValueError, match="payload_offset"):
        env.reset(seed=0, options={"payload": 350.0, "payload_offset": offset})
    env.reset(seed=0, options={"payload": 350.0, "payload_offset": (1.0, -1.0)})
    for _ in range(20):
        observation, reward, *_ = env.step(np.zeros(3, dtype=np.float32))
        assert np.isfinite(observation).all()
        assert math.isfinite(float(reward))
