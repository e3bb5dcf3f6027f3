"""ConveyorTrack-v0: its starts, its physics, what it measures, and what its reward prefers."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import scipy.stats

import envs
from envs.best_known import best_known
from envs.conveyor_track import table
from envs.conveyor_track.belt import RANGES, Demands, Start, problem_of, why_unsolvable
from envs.conveyor_track.env import LAYOUT
from envs.conveyor_track.table import TABLE
from envs.experts import PlanningExpert
from planners import SCARA_1M, Infeasible, JointLimits, MotionProblem, MovingHand, Trajectory, dpct

ENV_ID = "ConveyorTrack-v0"
PAPER = {"scenario": "paper"}


def made(**config: Any) -> Any:
    return gym.make(ENV_ID, **config)


def episode(env: Any, expert: Any, **reset: Any) -> tuple[float, dict[str, Any]]:
    """Return and final info of one episode."""
    observation, info = env.reset(**reset)
    state, start, over, total = None, np.ones(1, dtype=bool), False, 0.0
    while not over:
        action, state = expert.predict(observation, state, start)
        start = np.zeros(1, dtype=bool)
        observation, reward, terminated, truncated, info = env.step(action)
        total, over = total + reward, terminated or truncated
    return total, info


def planned_within(env: Any, limits: JointLimits, **options: Any) -> PlanningExpert:
    def plan(problem: MotionProblem) -> Trajectory:
        return dpct.plan(replace(problem, limits=limits), **options)

    return PlanningExpert(env.unwrapped.task, plan)


class TestStart:
    def test_the_papers(self) -> None:
        env = made()
        observation, _ = env.reset(seed=0, options=PAPER)
        seen = LAYOUT.parse(observation)
        assert seen["hand"] == pytest.approx([-0.8, 1.732], abs=1e-6)
        assert seen["part"] == pytest.approx([-0.9, 1.732], abs=1e-6)
        assert seen["part_velocity"] == pytest.approx([0.2, 0.0], abs=1e-7)
        assert seen["time_left"] == pytest.approx([3.0])
        q, qd = env.unwrapped.joint_state()
        assert SCARA_1M.forward_kinematics(q) == pytest.approx([-0.8, 1.732], abs=1e-12)
        assert q[1] > 0.0
        assert not qd.any()

    def test_is_drawn_from_the_declared_ranges(self) -> None:
        vector = gym.make_vec(ENV_ID, num_envs=300)
        seen = LAYOUT.parse(vector.reset(seed=0)[0])
        drawn = {
            "belt_speed": seen["part_velocity"][:, 0],
            "offset": seen["hand"][:, 0] - seen["part"][:, 0],
            "line_height": seen["part"][:, 1],
            "hand_x": seen["hand"][:, 0],
        }
        for name, values in drawn.items():
            assert values.min() >= RANGES[name][0] - 1e-6
            assert values.max() <= RANGES[name][1] + 1e-6
            assert np.ptp(values) >= 0.5 * np.ptp(RANGES[name]), name
        elbows = np.sign(seen["joint_position"][:, 1])
        assert 60 <= (elbows > 0).sum() <= 240

    def test_every_one_can_be_solved_within_all_limits(self) -> None:
        vector = gym.make_vec(ENV_ID, num_envs=150)
        vector.reset(seed=1000)
        for env_index in range(150):
            plan = dpct.plan(vector.unwrapped.motion_problem(env_index))  # type: ignore[attr-defined]
            assert plan.limit_ratio <= 1.0
            assert plan.rendezvous_time <= 2.5
            assert plan.duration >= 3.0 - 1e-9

    def test_values_set_by_hand_are_taken(self) -> None:
        given = {"belt_speed": 0.1, "offset": 0.05, "line_height": 1.6, "hand_x": -0.5, "elbow": "-"}
        env = made()
        seen = LAYOUT.parse(env.reset(seed=0, options=given)[0])
        assert seen["part_velocity"] == pytest.approx([0.1, 0.0])
        assert seen["part"] == pytest.approx([-0.55, 1.6])
        assert seen["hand"] == pytest.approx([-0.5, 1.6])
        assert seen["joint_position"][1] < 0.0

    def test_the_rest_is_drawn(self) -> None:
        env = made()
        one = LAYOUT.parse(env.reset(seed=0, options={"belt_speed": 0.1})[0])
        other = LAYOUT.parse(env.reset(options={"belt_speed": 0.1})[0])
        assert one["part_velocity"][0] == other["part_velocity"][0] == pytest.approx(0.1)
        assert one["hand"][0] != other["hand"][0]

    @pytest.mark.parametrize("scenario", ["random", "paper"])
    def test_a_range_is_drawn_from_in_each_episode(self, scenario: str) -> None:
        options = {"scenario": scenario, "belt_speed": [0.17, 0.22], "hand_x": (-0.8, -0.75)}
        env = gym.make_vec("ConveyorTrack-v0", num_envs=16)
        seen = LAYOUT.parse(env.reset(seed=3, options=options)[0])
        for values, low, high in ((seen["part_velocity"][:, 0], 0.17, 0.22), (seen["hand"][:, 0], -0.8, -0.75)):
            assert low <= values.min() < values.max() <= high
            assert np.ptp(values) > 0.5 * (high - low)
        if scenario == "paper":
            assert seen["part"][:, 1] == pytest.approx(1.732)
        alone = LAYOUT.parse(made().reset(seed=5, options=options)[0])
        assert alone["part"] == pytest.approx(seen["part"][2], abs=0.0)  # the same start by itself

    @pytest.mark.parametrize(
        ("options", "reason"),
        [
            ({"line_height": 2.5}, "2.5"),
            ({"line_height": [1.7, 1.6]}, r"turn it round: \[1.6, 1.7\]"),
            ({"belt_speed": [3.0, 4.0]}, "no_window.*joint"),
            ({"belt_speed": 3.0}, "no_window.*joint"),
            ({"offset": -0.6}, "late"),
            ({"elbow": "up"}, "elbow = 'up'"),
            ({"belt_speed": "fast"}, "belt_speed = 'fast'"),
        ],
    )
    def test_what_is_impossible_is_refused_with_the_reason(self, options: dict[str, Any], reason: str) -> None:
        env = made()
        before, _ = env.reset(seed=0)
        with pytest.raises(ValueError, match=reason):
            env.reset(options={**PAPER, **options})
        np.testing.assert_array_equal(env.unwrapped.task.batch["observation"][0], before)

    def test_a_horizon_that_no_start_fits_is_refused(self) -> None:
        with pytest.raises(ValueError, match=r"horizon 0\.6 s minus hold_time 0\.5 s"):
            made(horizon=0.6).reset(seed=0)

    def test_holding_longer_than_the_horizon_is_refused(self) -> None:
        with pytest.raises(ValueError, match=r"hold_time 0\.5 s is longer than the horizon 0\.4 s"):
            made(horizon=0.4)

    def test_the_answer_of_why_unsolvable_names_lateness(self) -> None:
        start = Start(belt_speed=0.2, offset=0.1, line_height=1.732, hand_x=-0.8, elbow=1.0)
        assert why_unsolvable(start, Demands(3.0, 0.5)) is None
        late = why_unsolvable(start, Demands(1.8, 0.5))
        assert late is not None
        assert "late" in late


class TestPart:
    @pytest.mark.parametrize("acceleration", [0.0, 0.005, -0.015])
    def test_moves_as_the_belt_does(self, acceleration: float) -> None:
        env = made(belt_acceleration=acceleration)
        env.reset(seed=0, options=PAPER)
        belt = MovingHand(np.array([-0.9, 1.732]), np.array([0.2, 0.0]), np.array([acceleration, 0.0]))
        for k in range(1, 101):
            seen = LAYOUT.parse(env.step(np.zeros(2, dtype=np.float32))[0])
            position, velocity = belt.at(0.02 * k)
            record = env.unwrapped.task.batch[0]
            assert record["part_position"] == pytest.approx(position, abs=1e-12)
            assert record["part_velocity"] == pytest.approx(velocity, abs=1e-12)
            assert seen["part_acceleration"] == pytest.approx([acceleration, 0.0], abs=1e-8)

    def test_payload_slows_the_same_torque(self) -> None:
        speeds = []
        for payload in (0.0, 0.5):
            env = made(payload=payload)
            env.reset(seed=3)
            q, qd = env.unwrapped.joint_state()
            env.step(np.array([0.5, 0.0], dtype=np.float32))
            expected = SCARA_1M.with_payload(payload).forward_dynamics(q, qd, [0.25, 0.0]) * 0.02
            speeds.append(env.unwrapped.joint_state()[1])
            assert speeds[-1] == pytest.approx(expected, rel=1e-2)
        assert (np.abs(speeds[1]) < np.abs(speeds[0])).all()


class TestExpert:
    def test_paper_scenario(self) -> None:
        env = made()
        _, info = episode(env, envs.make_expert("dpct", env), seed=0, options=PAPER)
        assert info["is_success"]
        assert info["steady_state_error"] <= 2e-4
        assert info["limit_ratio"] <= 1.02
        assert info["settling_time"] <= 1.60

    @pytest.mark.parametrize(
        ("name", "control_mode"),
        [("dpct", "torque"), ("dpct", "acceleration"), ("dpct", "jerk"), ("lagrange", "torque")],
    )
    def test_random_starts(self, name: str, control_mode: str) -> None:
        vector = gym.make_vec(ENV_ID, num_envs=40, autoreset_mode="SameStep", control_mode=control_mode)
        expert = envs.make_expert(name, vector)
        observations, _ = vector.reset(seed=500)
        state, starts = None, np.ones(40, dtype=bool)
        infos: dict[str, Any] = {}
        while "final_info" not in infos:
            actions, state = expert.predict(observations, state, starts)
            observations, _, _, starts, infos = vector.step(actions)
        assert infos["final_info"]["is_success"].all()
        assert infos["final_info"]["limit_ratio"].max() <= 1.02
        assert infos["final_info"]["steady_state_error"].max() <= 2e-4

    def test_the_state_may_be_left_to_the_expert(self) -> None:
        env = made()
        expert = envs.make_expert("dpct", env)
        for episodes in (1, 2):
            observation, info = env.reset(seed=episodes)
            over = False
            while not over:
                action, _ = expert.predict(observation)
                observation, _, _, over, info = env.step(action)
            assert info["is_success"]
            assert expert.plans_made == episodes

    def test_another_episodes_state_is_not_followed(self) -> None:
        env = made()
        expert = envs.make_expert("dpct", env)
        observation, _ = env.reset(seed=1)
        for _ in range(30):
            action, state = expert.predict(observation)
            observation, *_ = env.step(action)
        observation, _ = env.reset(seed=2)
        fresh, _ = envs.make_expert("dpct", env).predict(observation)
        np.testing.assert_array_equal(expert.predict(observation, state)[0], fresh)

    def test_taking_over_in_mid_episode(self) -> None:
        env = made(horizon=4.0)
        expert = envs.make_expert("dpct", env)
        observation, info = env.reset(seed=0, options={"belt_speed": 0.1, "offset": 0.1})
        follower = envs.make_expert("follower", env)
        for _ in range(25):
            observation, *_ = env.step(follower.predict(observation)[0])
        over = False
        while not over:
            action, _ = expert.predict(observation)
            observation, _, _, over, info = env.step(action)
        assert expert.plans_made == 1
        assert expert.infeasible == 0
        assert info["is_success"]

    def test_dpct_settles_within_two_periods_of_the_best_known_motion_and_keeps_the_limits(self) -> None:
        env, late = made(), []
        for seed in range(8):
            expert = envs.make_expert("dpct", env)
            observation, info = env.reset(seed=seed)
            known, over = best_known(env.unwrapped, 0), False
            while not over:
                observation, _, _, over, info = env.step(expert.predict(observation)[0])
            assert info["is_success"]
            assert info["limit_ratio"] <= 1.0
            late.append(info["settling_time"] - known)
        assert np.median(late) <= 0.03

    def test_dpct_starts_beside_the_line_and_in_motion(self) -> None:
        """After torques of its own choice, as with a replan."""
        env = made()
        for seed in (0, 1):
            observation, info = env.reset(seed=seed)
            for _ in range(12):
                observation, *_ = env.step(np.array([0.1, -0.12], dtype=np.float32))
            expert, over = envs.make_expert("dpct", env), False
            while not over:
                observation, _, _, over, info = env.step(expert.predict(observation)[0])
            assert info["is_success"]
            assert expert.infeasible == 0

    def test_brakes_to_rest_although_a_torque_saturates(self) -> None:
        def refuse(problem: MotionProblem) -> Trajectory:
            raise Infeasible("late", "for the test")

        env = made()
        moving = envs.make_expert("dpct", env)
        observation, _ = env.reset(seed=0)
        for _ in range(65):
            observation, *_ = env.step(moving.predict(observation)[0])
        assert np.abs(env.unwrapped.joint_state()[1]).max() > 0.15
        braking = PlanningExpert(env.unwrapped.task, refuse)
        for _ in range(70):
            observation, *_ = env.step(braking.predict(observation)[0])
        assert np.abs(env.unwrapped.joint_state()[1]).max() < 1e-6

    def test_brakes_when_there_is_no_plan(self) -> None:
        def refuse(problem: MotionProblem) -> Trajectory:
            raise Infeasible("late", "for the test")

        env = made()
        expert = PlanningExpert(env.unwrapped.task, refuse)
        env.reset(seed=0)
        for _ in range(20):
            observation, *_ = env.step(np.array([0.03, 0.02], dtype=np.float32))
        state = None
        while not env.unwrapped._needs_reset:
            action, state = expert.predict(observation, state, np.zeros(1, dtype=bool))
            observation, *_ = env.step(action)
        assert np.abs(env.unwrapped.joint_state()[1]).max() <= 1e-4
        assert expert.infeasible == expert.plans_made == 1

    def test_actions_of_a_batch_equal_those_of_one(self) -> None:
        vector = gym.make_vec(ENV_ID, num_envs=4)
        observations, _ = vector.reset(seed=0)
        for name in ("dpct", "follower", "random"):
            batch, _ = envs.make_expert(name, vector).predict(observations)
            for env_index in range(4):
                alone, _ = envs.make_expert(name, vector).predict(observations[env_index])
                np.testing.assert_array_equal(batch[env_index], alone)

    def test_random_actions_are_uniform_and_uncorrelated(self) -> None:
        vector = gym.make_vec(ENV_ID, num_envs=200)
        expert = envs.make_expert("random", vector)
        observations, _ = vector.reset(seed=0)
        actions = []
        for _ in range(100):
            action, _ = expert.predict(observations)
            observations, *_ = vector.step(action)
            actions.append(action)
        drawn = np.array(actions)
        for joint in range(2):
            assert scipy.stats.kstest(drawn[..., joint].ravel(), "uniform", (-1.0, 2.0)).pvalue > 1e-3
        assert abs(np.corrcoef(drawn[1:].ravel(), drawn[:-1].ravel())[0, 1]) < 0.02
        assert abs(np.corrcoef(drawn[..., 0].ravel(), drawn[..., 1].ravel())[0, 1]) < 0.02

    def test_motion_problem_is_read_from_the_observation(self) -> None:
        env = made()
        env.reset(seed=7)
        problem = env.unwrapped.motion_problem()
        q, _ = env.unwrapped.joint_state()
        assert problem.q == pytest.approx(q, abs=1e-6)
        assert isinstance(problem.target, MovingHand)
        assert problem.horizon == pytest.approx(3.0)


class TestMeasures:
    def test_info_against_the_raw_rollout(self) -> None:
        env = made()
        record = env.unwrapped.task.batch[0]
        expert = envs.make_expert("follower", env)
        observation, info = env.reset(seed=12)
        state, errors, costs, over = None, [], [], False
        costs.append((record["error"] ** 2 + record["velocity_error"] ** 2) / 0.25)
        while not over:
            action, state = expert.predict(observation, state)
            observation, _, _, over, info = env.step(action)
            hand = SCARA_1M.forward_kinematics(record["q"])
            hand_velocity = SCARA_1M.jacobian(record["q"]) @ record["qd"]
            error = np.linalg.norm(record["part_position"] - hand)
            velocity_error = np.linalg.norm(record["part_velocity"] - hand_velocity)
            errors.append((error, velocity_error))
            costs.append((error**2 + velocity_error**2) / 0.25)
        within = [position <= 1e-3 and velocity <= 2e-3 for position, velocity in errors]
        first = max((k + 1 for k, inside in enumerate(within) if not inside), default=0)
        assert info["settling_time"] == pytest.approx(0.02 * (first + 1) if first < 150 else math.inf)
        assert info["steady_state_error"] == pytest.approx(max(position for position, _ in errors[-25:]), rel=1e-9)
        assert info["lq_cost"] == pytest.approx(np.trapezoid(costs, dx=0.02), rel=1e-9)
        assert info["is_success"] == all(within[-25:])

    def test_lq_cost_of_a_hand_at_rest_is_the_closed_form(self) -> None:
        env = made()
        env.reset(seed=0, options=PAPER)
        over = False
        while not over:
            *_, over, info = env.step(np.zeros(2, dtype=np.float32))
        # e(t) = 0.2 t - 0.1 m and e' = 0.2 m/s over 3 s, in units of 0.5 m
        expected = ((0.2 * 3 - 0.1) ** 3 + 0.1**3) / (3 * 0.2) / 0.25 + 0.2**2 * 3 / 0.25
        assert info["lq_cost"] == pytest.approx(expected, rel=1e-4)
        assert info["settling_time"] == math.inf
        assert not info["is_success"]


class TestReward:
    """On real rollouts: settling earlier pays, breaking a limit never does."""

    def test_settling_earlier_gets_the_higher_return(self) -> None:
        """DPCT within ever smaller shares of the limits settles ever later, in most episodes."""
        compared = 0
        for reset in ({"seed": 0, "options": PAPER}, *({"seed": seed} for seed in range(6))):
            results = []
            for share in (0.8, 0.87, 0.94, 1.0):
                env = made()
                total, info = episode(env, planned_within(env, SCARA_1M.limits.scaled(share)), **reset)
                assert info["limit_ratio"] <= 1.02
                results.append((info["settling_time"], total))
            for (earlier, higher), (later, lower) in itertools.pairwise(sorted(results)):
                if earlier < later:
                    assert higher > lower
                    compared += 1
        assert compared >= 10

    @pytest.mark.parametrize("kind", ["velocity", "acceleration", "jerk"])
    def test_breaking_a_limit_costs_more_than_it_gains(self, kind: str) -> None:
        env = made()
        kept, info = episode(env, envs.make_expert("dpct", env), seed=0, options=PAPER)
        assert info["is_success"]
        looser = replace(SCARA_1M.limits, **{kind: tuple(1.3 * value for value in getattr(SCARA_1M.limits, kind))})
        broken, info = episode(env, planned_within(env, looser), seed=0, options=PAPER)
        if info["limit_ratio"] <= 1.02:
            pytest.skip(f"the {kind} limit is not active on this start")
        assert broken < kept

    def test_one_broken_period_costs_more_than_the_whole_episode_can_gain(self) -> None:
        """A perfect episode with one jolt in it returns less than standing still."""
        still_env = made()
        still, _ = episode(still_env, _Constant(np.zeros(2)), seed=0, options=PAPER)
        env = made()
        jolted, info = episode(env, _Jolt(envs.make_expert("dpct", env), at=2), seed=0, options=PAPER)
        assert info["limit_ratio"] > 1.02
        assert jolted < still

    def test_steps_are_bounded(self) -> None:
        env = made()
        env.action_space.seed(0)
        env.reset(seed=0)
        over = False
        while not over:
            _, reward, _, over, _ = env.step(env.action_space.sample())
            assert -6.0 <= reward <= 2.0

    def test_losing_the_part_pays_the_share_back(self) -> None:
        env = made()
        expert = envs.make_expert("dpct", env)
        observation, _ = env.reset(seed=0, options=PAPER)
        state, settling, over, step = None, [], False, 0
        while not over:
            action, state = expert.predict(observation, state)
            observation, _, _, over, info = env.step(action if step < 120 else np.ones(2, dtype=np.float32))
            settling.append(info["reward_settling"])
            step += 1
        assert sum(settling[:120]) > 0.2
        assert sum(settling) == pytest.approx(0.0, abs=1e-12)


class _Constant:
    def __init__(self, action: np.ndarray[Any, Any]) -> None:
        self._action = action.astype(np.float32)

    def predict(self, observation: Any, state: Any = None, *_: Any) -> tuple[Any, Any]:
        return self._action, state


class _Jolt:
    """An expert that is hit once."""

    def __init__(self, expert: Any, at: int) -> None:
        self._expert, self._at, self._step = expert, at, 0

    def predict(self, observation: Any, state: Any = None, *rest: Any) -> tuple[Any, Any]:
        action, state = self._expert.predict(observation, state, *rest)
        self._step += 1
        return (np.array([0.0, 0.9], dtype=np.float32) if self._step == self._at else action), state


def test_problem_of_a_start_is_the_environments_own() -> None:
    env = made()
    env.reset(seed=0, options=PAPER)
    start = Start(belt_speed=0.2, offset=0.1, line_height=1.732, hand_x=-0.8, elbow=1.0)
    ours, seen = problem_of(start, Demands(3.0, 0.5)), env.unwrapped.motion_problem()
    assert seen.q == pytest.approx(ours.q, abs=1e-6)
    assert isinstance(ours.target, MovingHand)
    assert isinstance(seen.target, MovingHand)
    assert seen.target.position == pytest.approx(ours.target.position, abs=1e-6)


def test_the_table_of_starts_is_built_as_it_is_stored(tmp_path: Path) -> None:
    from tools.conveyor_starts import AXES, build

    low = {"belt_speed": 3, "offset": 3, "line_height": 1, "hand_x": 1}
    build(tmp_path / TABLE, {name: AXES[name][first : first + 2] for name, first in low.items()})
    with np.load(tmp_path / TABLE) as built, np.load(Path(table.__file__).with_name(TABLE)) as stored:
        part = tuple(slice(first, first + 2) for first in low.values())
        assert np.isfinite(built["rendezvous_time"]).any()
        for name in ("rendezvous_time", "rides_until"):
            np.testing.assert_allclose(built[name], stored[name][part], rtol=1e-6)
