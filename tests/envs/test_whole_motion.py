"""MinTorqueMove-v0 with whole motions for actions."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import envs
from agents import evaluate
from planners import PLANAR_3R
from planners.motion.time_laws import SHAPES, shape_functions
from planners.typing import Array

ENV = "MinTorqueMove-v0"
MOTION = {"control_mode": "motion"}
SIZE = 3 * SHAPES


class Same:
    """The same action whatever is seen."""

    def __init__(self, action: Any) -> None:
        self.action = np.asarray(action, dtype=np.float32)

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = False
    ) -> tuple[Any, Any]:
        return np.broadcast_to(self.action, (len(observation), *self.action.shape)), None


def test_nothing_chosen_is_the_quintic() -> None:
    motion = evaluate(Same(np.zeros(SIZE)), ENV, range(20), env_config=MOTION)
    follower = evaluate("follower", ENV, range(20))
    assert motion.success.all()
    np.testing.assert_allclose(motion.metrics["quintic_ratio"], 1.0, atol=1e-3)
    np.testing.assert_allclose(motion.metrics["torque_l1"], follower.metrics["torque_l1"], rtol=1e-3)


def test_the_arm_follows_the_motion_that_the_first_action_says() -> None:
    env = gym.make(ENV, **MOTION)
    assert env.action_space.shape == (SIZE,)
    options = {"start": (0.2, 0.5, -0.5), "goal": (1.0, -0.5, 0.5), "duration": 1.5}
    env.reset(seed=0, options=options)
    action = np.zeros(SIZE, np.float32)
    action[SHAPES : SHAPES + 2] = 0.1, -0.2  # joint 2: 0.5 T_0 - 0.5 T_1, rad
    seen = []
    done, first = False, True
    while not done:
        _, _, done, _, info = env.step(action if first else np.ones(SIZE, np.float32))  # later actions do nothing
        first = False
        seen.append(env.unwrapped.joint_state()[0])  # type: ignore[attr-defined]
    s = np.arange(1, 301) / 300
    expected = reference(s, options, {1: (0.5, -0.5)})
    np.testing.assert_allclose(seen, expected, atol=2e-4)
    assert info["is_success"]


def reference(s: Array, options: dict[str, Any], bends: dict[int, tuple[float, ...]]) -> Array:
    start, goal = (np.array(options[name]) for name in ("start", "goal"))
    q: Array = start + (goal - start) * (10 * s**3 - 15 * s**4 + 6 * s**5)[:, None]
    for joint, coefficients in bends.items():
        q[:, joint] += np.array(coefficients) @ shape_functions(s)[0, : len(coefficients)]
    return q


def test_the_torque_is_that_of_inverse_dynamics() -> None:
    options = {"start": (0.0, 0.5, 0.5), "goal": (1.5, 0.5, -0.5), "duration": 1.0}
    action = np.zeros(SIZE, np.float32)
    action[SHAPES], action[2 * SHAPES] = 0.2, -0.1
    measured = evaluate(Same(action), ENV, [0], env_config=MOTION, options=options).metrics["torque_l1"][0]
    s = np.linspace(0.0, 1.0, 2001)
    q = reference(s, options, {1: (1.0,), 2: (-0.5,)})
    qd = np.gradient(q, s, axis=0, edge_order=2)
    qdd = np.gradient(qd, s, axis=0, edge_order=2)
    tau = PLANAR_3R.inverse_dynamics(q, qd, qdd)
    assert measured == pytest.approx(np.trapezoid(np.abs(tau).sum(axis=1), s), rel=5e-3)


def test_a_environment_equals_the_single_environment() -> None:
    actions = np.random.default_rng(0).uniform(-0.05, 0.05, (4, SIZE)).astype(np.float32)
    batch = gym.make_vec(ENV, num_envs=4, **MOTION)
    batch.reset(seed=3)
    single = gym.make(ENV, **MOTION)
    single.reset(seed=5)
    for _ in range(40):
        together, *_ = batch.step(actions)
        alone, *_ = single.step(actions[2])
        np.testing.assert_array_equal(together[2], alone)


def test_experts_say_that_they_choose_no_motions() -> None:
    with pytest.raises(ValueError, match=r"experts give one number per joint.*'motion'"):
        envs.make_expert("lagrange", gym.make(ENV, **MOTION))
