"""MinTorqueMove-v0: its moves, what it measures, and what its reward prefers."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import envs
from envs.experts import PlanningExpert
from envs.min_torque_move.env import LAYOUT
from planners import FixedJoints, MotionProblem, Trajectory, dpct, lagrange, quintic

ENV_ID = "MinTorqueMove-v0"
PAPER = {"scenario": "paper"}


def made(**config: Any) -> Any:
    return gym.make(ENV_ID, **config)


def episode(env: Any, expert: Any, **reset: Any) -> tuple[float, dict[str, Any]]:
    """Return and final info of one episode."""
    observation, info = env.reset(**reset)
    state, over, total = None, False, 0.0
    while not over:
        action, state = expert.predict(observation, state)
        observation, reward, over, truncated, info = env.step(action)
        assert not truncated
        total += reward
    return total, info


class Still:
    """A policy that does nothing."""

    def predict(self, observation: Any, state: Any = None) -> tuple[Any, Any]:
        return np.zeros(3, dtype=np.float32), state


class TestMove:
    def test_the_papers(self) -> None:
        seen = LAYOUT.parse(made().reset(seed=0, options=PAPER)[0])
        np.testing.assert_array_equal(seen["joint_position"], np.zeros(3))
        assert seen["goal"] == pytest.approx([1.0, 0.0, 0.0])
        assert seen["goal_error"] == pytest.approx([1.0, 0.0, 0.0])
        assert seen["time_left"] == pytest.approx([1.0])
        assert seen["torque_limit"] == pytest.approx([20.0, 10.0, 5.0])

    def test_long_moves_and_folded_starts_are_among_them(self) -> None:
        vector = gym.make_vec(ENV_ID, num_envs=300)
        seen = LAYOUT.parse(vector.reset(seed=0)[0])
        assert (np.abs(seen["goal_error"][:, 0]) > 2.0).mean() > 0.2
        assert (np.abs(seen["joint_position"][:, 1:]) > 2.0).any(axis=1).mean() > 0.2
        assert (np.abs(seen["joint_position"][:, 1:]) <= math.radians(150.0) + 1e-6).all()
        assert (np.abs(seen["goal"][:, 1:]) <= math.radians(150.0) + 1e-6).all()
        assert np.ptp(seen["time_left"]) > 1.0

    @pytest.mark.parametrize("gravity", [0.0, 9.81])
    def test_every_one_is_solved_by_the_quintic(self, gravity: float) -> None:
        vector = gym.make_vec(ENV_ID, num_envs=200, gravity=gravity)
        vector.reset(seed=7)
        for env_index in range(200):
            plan = quintic.plan(vector.unwrapped.motion_problem(env_index))  # type: ignore[attr-defined]
            assert plan.limit_ratio <= 1.0

    def test_values_set_by_hand_are_taken(self) -> None:
        given = {"start": (0.1, -0.2, 0.3), "goal": (0.5, 0.4, -0.3), "duration": 1.5}
        seen = LAYOUT.parse(made().reset(seed=0, options=given)[0])
        assert seen["joint_position"] == pytest.approx(given["start"])
        assert seen["goal"] == pytest.approx(given["goal"])
        assert seen["time_left"] == pytest.approx([1.5])

    @pytest.mark.parametrize(
        ("options", "reason"),
        [
            ({"goal": (0.0, 2.7, 0.0)}, r"goal \[0\.0, 2\.7, 0\.0\] rad leaves the joint ranges"),
            ({"start": (0.0, 0.0, -3.0)}, "start .* leaves the joint ranges"),
            ({"duration": 0.1}, r"no motion within the limits .* late: .*"),
            ({"duration": 0.333}, "duration 0.333 s is no multiple of control_period"),
            ({"duration": 4.0}, "longer than the horizon"),
            ({"duration": -1.0}, "duration = -1.0"),
            ({"goal": (0.0, 1.0)}, "goal"),
            ({"gaol": (0.0, 1.0, 0.0)}, 'did you mean "goal"'),
        ],
    )
    def test_what_is_impossible_is_refused(self, options: dict[str, Any], reason: str) -> None:
        env = made()
        before, _ = env.reset(seed=0)
        with pytest.raises(ValueError, match=reason):
            env.reset(options={**PAPER, **options})
        np.testing.assert_array_equal(env.unwrapped.task.batch["observation"][0], before)

    def test_a_horizon_too_short_for_any_move_is_refused(self) -> None:
        with pytest.raises(ValueError, match=r"move within 0\.05 s.*or the time"):
            made(horizon=0.05).reset(seed=0)

    def test_modes_that_need_smoothness_limits_are_refused(self) -> None:
        with pytest.raises(ValueError, match="control_mode = 'jerk'"):
            made(control_mode="jerk")


@pytest.mark.parametrize("name", ["dpct", "lagrange", "apf", "follower"])
def test_experts_plan_from_a_start_that_is_measured_in_motion(name: str) -> None:
    """By 1 mrad/s as an encoder's noise, and after three periods of other torques."""
    env = made()
    for seed, periods in ((3, 0), (4, 3)):
        observation, info = env.reset(seed=seed)
        for _ in range(periods):
            observation = env.step(np.array([0.05, -0.1, 0.1], dtype=np.float32))[0]
        observation[3:6] += np.float32(1e-3) if periods == 0 else np.float32(0.0)
        expert, over, state = envs.make_expert(name, env), False, None
        while not over:
            action, state = expert.predict(observation, state)
            observation, _, over, _, info = env.step(action)
        assert info["is_success"]
        assert expert.infeasible == 0


class TestMeasures:
    def test_info_against_the_raw_rollout(self) -> None:
        env = made()
        record = env.unwrapped.task.batch[0]
        expert = envs.make_expert("follower", env)
        observation, info = env.reset(seed=5)
        state, over, taus, reward_sum = None, False, [], 0.0
        while not over:
            action, state = expert.predict(observation, state)
            observation, reward, over, _, info = env.step(action)
            reward_sum += reward
            taus.append(np.clip(action.astype(float), -1.0, 1.0) * [20.0, 10.0, 5.0])
        spent = np.abs(taus).sum() * 0.005
        assert info["torque_l1"] == pytest.approx(spent, rel=1e-9)
        assert info["torque_l2"] == pytest.approx(np.square(taus).sum() * 0.005, rel=1e-9)
        assert info["peak_torque"] == pytest.approx(np.abs(taus).max(), rel=1e-9)
        assert info["angle_error"] == pytest.approx(np.abs(record["q"] - record["goal"]).max())
        assert info["velocity_error"] == pytest.approx(np.abs(record["qd"]).max())
        assert info["is_success"]
        assert reward_sum == pytest.approx(-info["quintic_ratio"], rel=1e-9)

    @pytest.mark.parametrize("gravity", [0.0, 9.81])
    def test_the_quintics_own_ratio_is_one(self, gravity: float) -> None:
        env = made(gravity=gravity)
        for seed in range(4):
            total, info = episode(env, envs.make_expert("follower", env), seed=seed)
            assert info["is_success"]
            assert info["quintic_ratio"] == pytest.approx(1.0, abs=2e-3)
            assert total == pytest.approx(-1.0, abs=2e-3)

    def test_the_yardstick_is_the_planned_quintics_effort(self) -> None:
        env = made()
        env.reset(seed=3)
        plan = quintic.plan(env.unwrapped.motion_problem())
        assert env.unwrapped.task.batch["quintic_l1"][0] == pytest.approx(plan.cost, rel=1e-5)

    def test_gravity_acts(self) -> None:
        env = made(gravity=9.81)
        env.reset(seed=0, options={**PAPER})
        env.step(np.zeros(3, dtype=np.float32))
        arm = env.unwrapped.task.arm
        expected = arm.forward_dynamics(np.zeros(3), np.zeros(3), np.zeros(3)) * 0.005
        assert env.unwrapped.joint_state()[1] == pytest.approx(expected, rel=1e-2)


class TestExperts:
    @pytest.mark.parametrize(
        ("name", "gravity"), [("lagrange", 0.0), ("dpct", 0.0), ("dpct", 9.81), ("follower", 9.81)]
    )
    def test_reach_every_goal_and_spend_what_they_planned(self, name: str, gravity: float) -> None:
        n = 30
        vector = gym.make_vec(ENV_ID, num_envs=n, autoreset_mode="SameStep", gravity=gravity)
        expert = envs.make_expert(name, vector)
        plans = {"lagrange": lagrange.plan, "dpct": partial(dpct.plan, variant="torque"), "follower": quintic.plan}
        observations, _ = vector.reset(seed=900)
        problems = [vector.unwrapped.motion_problem(env_index) for env_index in range(n)]  # type: ignore[attr-defined]
        state, over, spent = None, np.zeros(n, dtype=bool), np.full(n, np.nan)
        while not over.all():
            actions, state = expert.predict(observations, state)
            observations, _, terminated, _, infos = vector.step(actions)
            for env_index in np.flatnonzero(terminated & ~over):
                final = infos["final_info"]
                assert final["is_success"][env_index]
                assert final["limit_ratio"][env_index] <= 1.005
                spent[env_index] = final["torque_l1"][env_index]
            over |= terminated
        for env_index in range(0, n, 6):
            assert spent[env_index] == pytest.approx(plans[name](problems[env_index]).cost, rel=0.03)


class TestReward:
    def test_spending_less_gets_the_higher_return(self) -> None:
        env = made()
        for seed in range(4):
            reached = []
            for planner in (quintic.plan, lagrange.plan):
                reached.append(episode(env, PlanningExpert(env.unwrapped.task, planner), seed=seed))
            (quintic_return, quintic_info), (better_return, better_info) = reached
            assert better_info["is_success"]
            assert better_info["quintic_ratio"] < quintic_info["quintic_ratio"]
            assert better_return > quintic_return

    def test_missing_the_goal_is_never_worth_it(self) -> None:
        """Neither standing still, nor stopping short by a little, saves what the quintic spends."""
        env = made()
        for seed in range(4):
            quintic_return, _ = episode(env, envs.make_expert("follower", env), seed=seed)
            still_return, info = episode(env, Still(), seed=seed)
            assert not info["is_success"]
            assert still_return < quintic_return - 0.9
            short_return, info = episode(env, PlanningExpert(env.unwrapped.task, _stopping_short), seed=seed)
            assert not info["is_success"]
            assert short_return < quintic_return - 0.9

    def test_a_smaller_miss_costs_less(self) -> None:
        env = made()
        still, _ = episode(env, Still(), seed=0)
        short, _ = episode(env, PlanningExpert(env.unwrapped.task, _stopping_short), seed=0)
        assert short > still - 1.0

    def test_leaving_a_joint_range_costs_more_than_the_move(self) -> None:
        env = made()
        env.reset(seed=0, options={"start": (0.0, 2.5, 0.0), "goal": (0.5, 2.5, 0.0), "duration": 1.0})
        worst = 0.0
        for _ in range(30):
            _, _, _, _, info = env.step(np.array([0.0, 1.0, 0.0], dtype=np.float32))
            worst = min(worst, info["reward_limits"])
        assert worst <= -2.0


def _stopping_short(problem: MotionProblem) -> Trajectory:
    """The quintic to a place 0.05 rad before the goal."""
    assert isinstance(problem.target, FixedJoints)
    change = problem.target.q - problem.q
    nearer = problem.target.q - 0.05 * change / np.abs(change).max()
    return quintic.plan(MotionProblem(problem.arm, problem.q, FixedJoints(nearer), problem.horizon))
