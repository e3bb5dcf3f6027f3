"""What is asked of a planner and what it answers: refusals, copies, pickling, interpolation, limit ratios."""

from __future__ import annotations

import copy
import math
import pickle
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BPoly

from planners import (
    PLANAR_3R,
    SCARA_1M,
    FixedHand,
    FixedJoints,
    Infeasible,
    JointLimits,
    MotionProblem,
    MovingHand,
    Obstacle,
    Trajectory,
)
from planners.problem import limit_ratios
from planners.typing import Array


def problem(**changes: Any) -> MotionProblem:
    given = {"arm": SCARA_1M, "q": [0.1, 0.2], "target": FixedJoints([1.0, 1.0]), "horizon": 3.0}
    return MotionProblem(**(given | changes))


def trajectory_of(samples: Array, polynomials: list[np.polynomial.Polynomial]) -> Trajectory:
    """A trajectory whose joints follow polynomials of time."""
    q, qd, qdd = (np.stack([p.deriv(order)(samples) for p in polynomials], axis=-1) for order in range(3))
    ratios = {"torque": 0.5, "velocity": 0.75}
    return Trajectory(samples, q, qd, qdd, np.zeros_like(q), ratios, cost=1.0, rendezvous_time=2.0, planner="test")


QUINTICS = [
    np.polynomial.Polynomial([0.3, -1.0, 0.5, 2.0, -1.5, 0.25]),
    np.polynomial.Polynomial([-2.0, 0.1, 0.0, -0.7, 0.9, -0.3]),
]
UNEVEN = np.array([0.0, 0.1, 0.45, 0.5, 1.3, 2.0])


class TestMotionProblem:
    def test_rest_and_the_arms_limits_are_the_default(self) -> None:
        plain = problem()
        q, qd, qdd = plain.start
        np.testing.assert_array_equal([q, qd, qdd], [[0.1, 0.2], [0.0, 0.0], [0.0, 0.0]])
        assert plain.joint_limits is SCARA_1M.limits
        assert plain.loaded_arm is SCARA_1M

    def test_its_own_limits_and_payload_come_first(self) -> None:
        limits = JointLimits.unlimited(2)
        loaded = problem(limits=limits, payload=0.5)
        assert loaded.joint_limits is limits
        assert loaded.loaded_arm == SCARA_1M.with_payload(0.5)

    def test_arrays_are_read_only_copies(self) -> None:
        q, position = np.array([0.1, 0.2]), np.array([1.0, 0.5])
        asked = problem(
            q=q, qd=q, target=MovingHand(position, position), obstacles=(Obstacle(position, position, 0.1),)
        )
        q[:], position[:] = 9.0, 9.0
        assert isinstance(asked.target, MovingHand)
        arrays = [*asked.start, asked.target.position, asked.target.velocity, asked.target.acceleration]
        arrays += [asked.obstacles[0].position, asked.obstacles[0].velocity]
        for array in arrays:
            assert array.max() < 9.0
            assert array.dtype == np.float64
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 1.0

    @pytest.mark.parametrize(
        ("changes", "message"),
        [
            ({"q": [0.1]}, r"q has shape \(1,\); it must have shape \(2,\)"),
            ({"q": 0.1}, r"q has shape \(\)"),
            ({"qd": np.zeros((2, 2))}, r"qd has shape \(2, 2\)"),
            ({"qdd": [0.0, 0.0, 0.0]}, r"qdd has shape \(3,\)"),
            ({"q": [0.1, math.nan]}, r"q \[0.1 nan\] must be finite"),
            ({"qd": [math.inf, 0.0]}, r"qd \[inf  ?0.\] must be finite"),
            ({"horizon": 0.0}, "horizon 0.0 s must be finite and positive"),
            ({"horizon": -1.0}, "horizon -1.0 s"),
            ({"horizon": math.inf}, "horizon inf s"),
            ({"horizon": math.nan}, "horizon nan s"),
            ({"payload": -0.2}, "payload mass -0.2 kg must be finite and not negative"),
            ({"payload": math.nan}, "payload mass nan kg"),
            ({"target": FixedJoints([1.0, 1.0, 1.0])}, "target has 3 joint angles, the arm 2 joints"),
            ({"limits": JointLimits.unlimited(3)}, "limits are given for 3 joints, the arm has 2"),
            ({"arm": PLANAR_3R}, r"q has shape \(2,\); it must have shape \(3,\)"),
        ],
    )
    def test_impossible_questions_are_refused_by_value(self, changes: dict[str, Any], message: str) -> None:
        with pytest.raises(ValueError, match=message):
            problem(**changes)

    def test_impossible_targets_and_obstacles_are_refused_by_value(self) -> None:
        with pytest.raises(ValueError, match=r"position has shape \(3,\); it must have shape \(2,\)"):
            FixedHand([1.0, 2.0, 3.0])
        with pytest.raises(ValueError, match=r"velocity \[nan  ?0.\] must be finite"):
            MovingHand([0.0, 0.0], [math.nan, 0.0])
        with pytest.raises(ValueError, match=r"q has shape \(1, 2\); it must have one dimension"):
            FixedJoints([[1.0, 2.0]])
        for radius in (-0.1, math.nan, math.inf):
            with pytest.raises(ValueError, match=f"obstacle radius {radius} m must be finite and not negative"):
                Obstacle([0.0, 0.0], [0.0, 0.0], radius)

    def test_pickling_keeps_everything(self) -> None:
        asked = problem(
            target=MovingHand([-0.9, 1.732], [0.2, 0.0]),
            obstacles=(Obstacle([0.5, 0.5], [0.1, 0.0], 0.2),),
            payload=0.3,
        )
        back = pickle.loads(pickle.dumps(asked))
        assert (back.arm, back.limits, back.horizon, back.payload) == (SCARA_1M, SCARA_1M.limits, 3.0, 0.3)
        np.testing.assert_array_equal(back.start, asked.start)
        np.testing.assert_array_equal(back.target.position, [-0.9, 1.732])
        assert back.obstacles[0].radius == 0.2
        assert back.loaded_arm == asked.loaded_arm


def test_moving_target_follows_constant_acceleration() -> None:
    target = MovingHand([1.0, 2.0], [0.5, 0.0], [0.0, -2.0])
    position, velocity = target.at([0.0, 1.0, 3.0])
    np.testing.assert_allclose(position, [[1.0, 2.0], [1.5, 1.0], [2.5, -7.0]])
    np.testing.assert_allclose(velocity, [[0.5, 0.0], [0.5, -2.0], [0.5, -6.0]])
    position, velocity = target.at(1.0)
    np.testing.assert_allclose([position, velocity], [[1.5, 1.0], [0.5, -2.0]])


class TestInfeasible:
    def test_it_says_why_in_words_and_in_numbers(self) -> None:
        error = Infeasible("late", "the belt is too fast", speed=0.4, joint=1)
        assert isinstance(error, ValueError)
        assert str(error) == "late: the belt is too fast"
        assert (error.reason, error.details) == ("late", {"speed": 0.4, "joint": 1})

    @pytest.mark.parametrize("duplicate", [copy.copy, copy.deepcopy, lambda error: pickle.loads(pickle.dumps(error))])
    def test_copies_keep_everything(self, duplicate: Any) -> None:
        error = duplicate(Infeasible("late", "the belt is too fast", speed=0.4))
        assert type(error) is Infeasible
        assert (str(error), error.reason, error.message) == (
            "late: the belt is too fast",
            "late",
            "the belt is too fast",
        )
        assert error.details == {"speed": 0.4}


class TestTrajectory:
    def test_a_quintic_is_reproduced_between_uneven_samples(self) -> None:
        times = np.linspace(0.0, 2.0, 501)
        for order, found in enumerate(trajectory_of(UNEVEN, QUINTICS).at(times)):
            expected = np.stack([p.deriv(order)(times) for p in QUINTICS], axis=-1)
            np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-11)

    @given(st.lists(st.floats(0.01, 1.0), min_size=1, max_size=6), st.integers(0, 10_000))
    @settings(deadline=None, max_examples=40)
    def test_any_samples_are_joined_by_the_hermite_quintic(self, steps: list[float], seed: int) -> None:
        samples = np.concatenate([[0.0], np.cumsum(steps)])
        rng = np.random.default_rng(seed)
        q, qd, qdd = rng.normal(size=(3, len(samples), 2))
        motion = Trajectory(samples, q, qd, qdd, np.zeros_like(q), {}, 0.0, 0.0, "test")
        curve = BPoly.from_derivatives(samples, np.stack([q, qd, qdd], axis=1))
        times = np.linspace(0.0, samples[-1], 97)
        scale = 1.0 / min(steps) ** np.arange(3)
        for order, found in enumerate(motion.at(times)):
            exact = curve.derivative(order)(times) if order else curve(times)
            inside = ~np.isclose(times[:, None], samples, rtol=0.0, atol=1e-9).any(axis=1)  # scipy jumps with q'''
            np.testing.assert_allclose(found[inside], exact[inside], rtol=0.0, atol=1e-11 * scale[order])

    def test_samples_are_returned_at_their_own_times(self) -> None:
        motion = trajectory_of(UNEVEN, QUINTICS)
        for found, stored in zip(motion.at(UNEVEN), (motion.q, motion.qd, motion.qdd), strict=True):
            np.testing.assert_allclose(found, stored, rtol=0.0, atol=1e-12)

    def test_outside_it_stays_at_the_ends(self) -> None:
        motion = trajectory_of(UNEVEN, QUINTICS)
        for time, end in ((-5.0, 0), (2.0 + 1e-9, -1), (math.inf, -1)):
            for found, stored in zip(motion.at(time), (motion.q, motion.qd, motion.qdd), strict=True):
                np.testing.assert_allclose(found, stored[end], rtol=0.0, atol=1e-12)

    @pytest.mark.parametrize("shape", [(), (1,), (7,), (2, 3)])
    def test_times_of_any_shape(self, shape: tuple[int, ...]) -> None:
        for found in trajectory_of(UNEVEN, QUINTICS).at(np.full(shape, 0.7)):
            assert found.shape == (*shape, 2)

    def test_summary_numbers(self) -> None:
        motion = trajectory_of(UNEVEN, QUINTICS)
        assert (motion.duration, motion.limit_ratio, motion.rides_until) == (2.0, 0.75, math.inf)

    def test_pickling_keeps_the_motion(self) -> None:
        motion = trajectory_of(UNEVEN, QUINTICS)
        back = pickle.loads(pickle.dumps(motion))
        np.testing.assert_array_equal(back.at(UNEVEN[1:] - 0.02), motion.at(UNEVEN[1:] - 0.02))
        assert (back.limit_ratios, back.cost, back.planner) == (motion.limit_ratios, 1.0, "test")


class TestLimitRatios:
    T = np.array([0.0, 0.5, 1.0])
    Q = np.array([[0.0, 0.0], [-1.0, 0.5], [0.2, 0.6]])
    QD = np.array([[0.0, 0.0], [0.1, -3.0], [0.2, 1.0]])
    QDD = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, -2.0]])
    TAU = np.array([[4.0, 0.0], [-5.0, 1.0], [0.0, 1.0]])

    def ratios(self, limits: JointLimits) -> dict[str, float]:
        return limit_ratios(limits, self.T, self.Q, self.QD, self.QDD, self.TAU)

    def test_worst_of_joints_and_samples(self) -> None:
        limits = JointLimits(
            (10.0, 1.0), velocity=(1.0, 2.0), acceleration=(4.0, 4.0), jerk=(1.0, 8.0), angle=(2.0, 1.0)
        )
        expected = {"torque": 1.0, "velocity": 1.5, "acceleration": 0.5, "jerk": 2.0, "angle": 0.6}
        assert self.ratios(limits) == pytest.approx(expected)

    def test_no_limit_gives_zero(self) -> None:
        assert set(self.ratios(JointLimits.unlimited(2)).values()) == {0.0}
        limits = JointLimits(torque=(math.inf, 0.5))
        assert self.ratios(limits) == {"torque": 2.0, "velocity": 0.0, "acceleration": 0.0, "jerk": 0.0, "angle": 0.0}


def test_what_is_of_another_kind_is_refused_with_how_to_give_it() -> None:
    def given(**changes: Any) -> MotionProblem:
        usual = {"arm": SCARA_1M, "q": [0.0, 1.0], "target": FixedJoints(np.ones(2)), "horizon": 1.0}
        return MotionProblem(**(usual | changes))

    disc = Obstacle(np.array([1.0, 1.0]), np.zeros(2), 0.1)
    assert given(obstacles=disc).obstacles == given(obstacles=[disc]).obstacles == (disc,)
    for changes, message in (
        ({"arm": "SCARA_1M"}, "arm 'SCARA_1M' is no Arm; planners.load_arm makes one of a name or a file"),
        ({"target": [1.0, 1.0]}, r"target \[1.0, 1.0\] is no target; give FixedJoints\(q\), FixedHand\(position\)"),
        ({"limits": {"torque": 1.0}}, r"limits {'torque': 1.0} are no JointLimits; write JointLimits"),
        ({"obstacles": [[1.0, 1.0]]}, r"obstacles \[\[1.0, 1.0\]\] must be Obstacle\(position, velocity, radius\)"),
        ({"obstacles": None}, "obstacles None must be Obstacle"),
        ({"q": "ab"}, "q 'ab' must be numbers"),
        ({"q": [[0.0, 1.0]]}, r"q has shape \(1, 2\); it must have shape \(2,\)"),
        ({"horizon": "long"}, "horizon 'long' must be a finite number"),
    ):
        with pytest.raises(ValueError, match=message):
            given(**changes)
