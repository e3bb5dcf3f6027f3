"""Moves, arms and levels that are given in part or do not fit: what is left out follows, what cannot be is refused."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import agents
import envs
from planners import PLANAR_3R, FixedJoints, MotionProblem, quintic

MOVE = "MinTorqueMove-v0"


def problem_of(seed: int, **options: Any) -> MotionProblem:
    env = gym.make(MOVE)
    env.reset(seed=seed, options=options)
    problem: MotionProblem = env.unwrapped.motion_problem()  # type: ignore[attr-defined]
    env.close()
    return problem


def share_of(problem: MotionProblem) -> float:
    """The quintic's share of the torque limits in a move, from the plan of another module."""
    exact = MotionProblem(PLANAR_3R, problem.q, problem.target, round(problem.horizon, 6))
    return float(quintic.plan(exact).limit_ratios["torque"])


class TestMoves:
    def test_the_share_decides_the_time_of_a_move_with_given_ends(self) -> None:
        times = {
            round(problem_of(seed, torque_share=0.3, start=[0, 0, 0], goal=[2, 1, 1]).horizon, 6) for seed in (0, 5)
        }
        assert len(times) == 1
        assert share_of(problem_of(3, torque_share=0.3, start=[0, 0, 0], goal=[2, 1, 1])) == pytest.approx(
            0.3, abs=5e-3
        )
        assert share_of(problem_of(3, torque_share=0.3, start=[0, 0, 0])) == pytest.approx(0.3, abs=0.02)

    @pytest.mark.parametrize("given", [{"start": [3, 2.5, 2.5]}, {"goal": [1, 1, 1]}, {"duration": 0.4}])
    def test_what_is_left_out_is_drawn_to_fit(self, given: dict[str, Any]) -> None:
        for seed in range(25):
            problem = problem_of(seed, **given)
            assert share_of(problem) < 0.91
            assert problem.horizon == pytest.approx(given.get("duration", problem.horizon))
            np.testing.assert_allclose(problem.q, given.get("start", problem.q), atol=1e-6)
            assert isinstance(problem.target, FixedJoints)
            np.testing.assert_allclose(problem.target.q, given.get("goal", problem.target.q), atol=1e-6)

    @pytest.mark.parametrize(
        ("given", "message"),
        [
            ({"torque_share": 0.3, "duration": 1.0}, "leave one out"),
            ({"torque_share": 0.3, "scenario": "paper"}, "leave one out"),
            ({"start": [0, 0, 0], "goal": [0, 0, 0]}, "no torque is needed"),
            ({"start": [14.0, 0, 0]}, "take whole turns away"),
        ],
    )
    def test_what_cannot_be_is_refused(self, given: dict[str, Any], message: str) -> None:
        with pytest.raises(ValueError, match=message):
            problem_of(0, **given)

    def test_the_papers_move_takes_whole_control_periods_too(self) -> None:
        with gym.make(MOVE, control_period=0.003, horizon=2.1) as env, pytest.raises(ValueError, match="duration"):
            env.reset(options={"scenario": "paper"})

    def test_to_hold_a_posture_in_a_vertical_plane_is_a_move(self) -> None:
        env = gym.make(MOVE, gravity=9.81)
        env.reset(seed=0, options={"start": [0.5, 0.3, 0.2], "goal": [0.5, 0.3, 0.2], "duration": 1.0})
        assert np.isfinite(float(env.step(env.action_space.sample())[1]))


def arm(offset: float) -> dict[str, Any]:
    """An arm whose first joint has its range around ``offset``, rad."""
    limits = {"torque_N_m": [60, 25], "velocity_rad_s": [6, 8], "acceleration_rad_s2": [30, 40]}
    ranges = {"angle_rad": [[offset - 2.3, offset + 2.3], 2.5]}
    return {
        "name": "t",
        "lengths_m": [0.42, 0.31],
        "masses_kg": [6, 3],
        "link_radius_m": 0.04,
        "limits": limits | ranges,
    }


class TestArms:
    @pytest.mark.parametrize(("expert", "task"), [("dpct", MOVE), ("lagrange", MOVE), ("apf", "ObstacleDodge-v0")])
    def test_joint_ranges_may_lie_anywhere(self, expert: str, task: str) -> None:
        far = agents.evaluate(expert, task, range(2), env_config={"arm": arm(14.0)})
        assert far.success.all()
        assert far.metrics["limit_ratio"].max() < 1.001

    def test_ranges_that_no_observation_resolves_are_refused(self) -> None:
        with pytest.raises(ValueError, match="take whole turns away"):
            gym.make(MOVE, arm=arm(1e4))

    def test_levels_of_the_tasks_own_arm_are_refused_for_another(self) -> None:
        card = envs.task_card("ObstacleDodge-v0")
        with pytest.raises(ValueError, match="options that suit yours"):
            card.at_level("large", {"arm": arm(0.0)}, {})
        assert card.at_level("two_discs", {"arm": arm(0.0)}, {})[0]["num_obstacles"] == 2

    def test_speeds_and_radii_of_discs_are_bounded_in_the_units_of_the_arm(self) -> None:
        big = arm(0.0) | {"lengths_m": [4.2, 3.1], "link_radius_m": 0.3}
        with gym.make("ObstacleDodge-v0", arm=big) as env:
            env.reset(seed=0, options={"obstacle_radius": 0.6})
            env.reset(seed=0, options={"scenario": "paper"})
        with gym.make("ObstacleDodge-v0") as env, pytest.raises(ValueError, match=r"obstacle_radius 0\.6 m must be"):
            env.reset(options={"obstacle_radius": 0.6})

    def test_the_papers_disc_is_one_and_has_its_own_path(self) -> None:
        with gym.make("ObstacleDodge-v0", num_obstacles=2) as env, pytest.raises(ValueError, match="paper's scenario"):
            env.reset(options={"scenario": "paper"})
        with gym.make("ObstacleDodge-v0") as env, pytest.raises(ValueError, match="leave one out"):
            env.reset(options={"scenario": "paper", "obstacle_kind": "wander"})


class TestOtherSettings:
    def test_a_range_of_latencies_is_not_left(self) -> None:
        with pytest.raises(ValueError, match="no multiple of the physics_step"):
            gym.make("ConveyorTrack-v0", latency=(0.0009, 0.0011))
        env = gym.make("ConveyorTrack-v0", latency=(0.0031, 0.0049))
        for seed in range(4):
            env.reset(seed=seed)
            assert env.unwrapped.task.batch["latency"][0] == pytest.approx(0.004)  # type: ignore[attr-defined]

    def test_no_leg_of_the_excavator_is_longer_than_can_be_observed(self) -> None:
        env = gym.make("ExcavatorPayload-v0", horizon=60.0)
        with pytest.raises(ValueError, match="at most 10 s"):
            env.reset(options={"waypoints": [[0, -1, 0], [0.2, -1.2, 0.2]], "arrival_times": [30.0]})

    def test_no_payload_is_heavier_than_the_heaviest(self) -> None:
        with pytest.raises(ValueError, match="heavier than the heaviest"):
            gym.make("ExcavatorPayload-v0", payload=50.0).reset(options={"payload": 60.0})
