"""Motions as data: interpolation, jumps, and their loads, jerk and clearance measured between the samples too."""

from __future__ import annotations

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BPoly

from planners import (
    SCARA_1M,
    Arm,
    FixedJoints,
    JointLimits,
    MotionProblem,
    Obstacle,
    Trajectory,
    sampled_trajectory,
)
from planners.typing import Array

FREE = replace(SCARA_1M, limits=JointLimits())
QUINTICS = [
    np.polynomial.Polynomial([0.3, -1.0, 0.5, 2.0, -1.5, 0.25]),
    np.polynomial.Polynomial([-2.0, 0.1, 0.0, -0.7, 0.9, -0.3]),
]
UP_AND_DOWN = np.stack([np.array([[0.0, 0.5, 0.5, 1.0], [0.0, 1.0, 1.0, 0.0], [1.0, 1.0, -1.0, -1.0]])] * 2, axis=-1)
"""Angles, velocities and accelerations of both joints at 0, 1, 1 and 2 s: up to a speed, and down from it."""

UNEVEN = np.array([0.0, 0.1, 0.45, 0.5, 1.3, 2.0])


def problem(limits: JointLimits | None = None, *discs: Obstacle, arm: Arm = FREE) -> MotionProblem:
    return MotionProblem(arm, [0.3, -2.0], FixedJoints([1.0, 1.0]), 3.0, limits=limits, obstacles=discs)


def motion_of(samples: Array, polynomials: list[np.polynomial.Polynomial], asked: MotionProblem) -> Trajectory:
    """A trajectory whose joints follow polynomials of time."""
    q, qd, qdd = (np.stack([p.deriv(order)(samples) for p in polynomials], axis=-1) for order in range(3))
    return sampled_trajectory(asked, samples, q, qd, qdd, planner="test", cost=1.0, rendezvous_time=2.0)


def dense(motion: Trajectory, count: int = 20_001) -> tuple[Array, Array, Array, Array]:
    t = np.linspace(0.0, motion.duration, count)
    return t, *motion.at(t)


class TestInterpolation:
    def test_a_quintic_is_reproduced_between_uneven_samples(self) -> None:
        times = np.linspace(0.0, 2.0, 501)
        for order, found in enumerate(motion_of(UNEVEN, QUINTICS, problem()).at(times)):
            expected = np.stack([p.deriv(order)(times) for p in QUINTICS], axis=-1)
            np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-6)

    def test_so_is_a_short_move_before_a_long_rest(self) -> None:
        """The velocity turns within the 2 ms, of a motion of 41 hours."""
        move = np.polynomial.Polynomial([0.0, 0.0, 1.5e6, -5e8])  # a speed of 1.5 rad/s after 1 ms
        samples = np.array([0.0, 0.002, 150_000.0])
        q, qd, qdd = (np.repeat(move.deriv(order)(np.minimum(samples, 0.002))[:, None], 2, 1) for order in range(3))
        samples, rows = samples[[0, 1, 1, 2]], [0, 1, 1, 1]
        still = np.array([1.0, 1.0, 0.0, 0.0])[:, None]
        motion = sampled_trajectory(problem(), samples, q[rows], qd[rows] * still, qdd[rows] * still, planner="test")
        times = np.linspace(0.0, 0.002, 101)[:-1]
        for order, found in enumerate(motion.at(times)):
            expected = np.repeat(move.deriv(order)(times)[:, None], 2, 1)
            np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())

    @given(st.lists(st.floats(0.01, 1.0), min_size=1, max_size=6), st.integers(0, 10_000))
    @settings(deadline=None, max_examples=40)
    def test_nothing_is_cut_off_where_quintics_turn_between_samples(self, steps: list[float], seed: int) -> None:
        """A motion that is rough at some places and almost smooth at others, as planners' are, against SciPy's spline.

        Where an acceleration turned within a fifth of an interval, it was held at the value of the nearest sample.
        """
        samples, random = np.concatenate([[0.0], np.cumsum(steps)]), np.random.default_rng(seed)
        rows = np.stack([[p.deriv(order)(samples) for p in QUINTICS] for order in range(3)]).swapaxes(1, 2)
        rows += random.normal(size=rows.shape) * 10.0 ** random.uniform(-6.0, 0.0, size=(1, len(samples), 1))
        motion = sampled_trajectory(problem(), samples, *rows, planner="test")
        spline = BPoly.from_derivatives(samples, rows.swapaxes(0, 1))
        t, *found = dense(motion, 3001)
        for order, values in enumerate(found):
            expected = spline.derivative(order)(t) if order else spline(t)
            np.testing.assert_allclose(values, expected, rtol=0.0, atol=1e-6 * np.abs(expected).max())

    @given(st.lists(st.floats(0.01, 1.0), min_size=1, max_size=6), st.integers(0, 10_000))
    @settings(deadline=None, max_examples=40)
    def test_between_samples_nothing_exceeds_the_values_of_its_neighbours(self, steps: list[float], seed: int) -> None:
        samples = np.concatenate([[0.0], np.cumsum(steps)])
        motion = sampled_trajectory(
            problem(), samples, *np.random.default_rng(seed).normal(size=(3, len(samples), 2)), planner="test"
        )
        t, *found = dense(motion, 997)
        after = np.clip(np.searchsorted(motion.t, t, side="right"), 1, len(motion.t) - 1)
        for values, kept in zip(found, (motion.q, motion.qd, motion.qdd), strict=True):
            assert (values <= np.maximum(kept[after - 1], kept[after]) + 1e-12).all()
            assert (values >= np.minimum(kept[after - 1], kept[after]) - 1e-12).all()
        assert np.isin(samples, motion.t).all()

    def test_samples_that_almost_coincide_do_not_explode(self) -> None:
        t = np.array([0.0, 1.0, 1.0 + 2e-11, 2.0])
        q, qd = np.array([[0.0, 0.0], [1.0, 1.0], [1.0, 1.0], [2.0, 2.0]]), np.ones((4, 2))
        motion = sampled_trajectory(problem(), t, q, qd, np.zeros((4, 2)), planner="test")
        assert np.abs(motion.at(np.linspace(0.9, 1.1, 4001))[2]).max() < 1e-6

    def test_samples_are_returned_at_their_own_times(self) -> None:
        motion = motion_of(UNEVEN, QUINTICS, problem())
        for found, stored in zip(motion.at(motion.t), (motion.q, motion.qd, motion.qdd), strict=True):
            np.testing.assert_allclose(found, stored, rtol=0.0, atol=1e-12)

    def test_a_jump_of_the_acceleration_is_a_jump(self) -> None:
        t = np.array([0.0, 1.0, 1.0, 2.0])
        motion = sampled_trajectory(problem(), t, *UP_AND_DOWN, planner="test")
        found = motion.at([0.0, 1.0 - 1e-9, 1.0, 1.0 + 1e-9, 2.0])[2][:, 0]
        np.testing.assert_allclose(found, [1.0, 1.0, -1.0, -1.0, -1.0])
        np.testing.assert_allclose(motion.at([0.5, 1.5])[0][:, 0], [0.125, 0.875])

    def test_outside_it_stays_at_the_ends(self) -> None:
        motion = motion_of(UNEVEN, QUINTICS, problem())
        for time, end in ((-5.0, 0), (2.0 + 1e-9, -1), (math.inf, -1)):
            for found, stored in zip(motion.at(time), (motion.q, motion.qd, motion.qdd), strict=True):
                np.testing.assert_allclose(found, stored[end], rtol=0.0, atol=1e-12)

    @pytest.mark.parametrize("shape", [(), (1,), (7,), (2, 3)])
    def test_times_of_any_shape(self, shape: tuple[int, ...]) -> None:
        for found in motion_of(UNEVEN, QUINTICS, problem()).at(np.full(shape, 0.7)):
            assert found.shape == (*shape, 2)

    @pytest.mark.parametrize("t", [math.nan, [0.1, math.nan], "0.5", None, 1j, True, 10**400])
    def test_what_is_no_time_is_refused(self, t: object) -> None:
        with pytest.raises(ValueError, match=r"^t "):
            motion_of(UNEVEN, QUINTICS, problem()).at(t)  # type: ignore[arg-type]

    def test_later_changes_of_the_given_arrays_do_not_change_it(self) -> None:
        rows = UP_AND_DOWN.copy()
        motion = sampled_trajectory(problem(), np.array([0.0, 1.0, 1.0, 2.0]), *rows, planner="test")
        rows[:] = 9.0
        np.testing.assert_array_equal(motion.q, UP_AND_DOWN[0])

    def test_it_equals_a_motion_of_the_same_samples_and_no_other(self) -> None:
        motion, again = motion_of(UNEVEN, QUINTICS, problem()), motion_of(UNEVEN, QUINTICS, problem())
        assert motion == again
        assert len({motion, again}) == 1
        for other in (motion_of(UNEVEN, QUINTICS[::-1], problem()), replace(motion, cost=2.0), None):
            assert motion != other

    def test_pickling_keeps_the_motion(self) -> None:
        motion = motion_of(UNEVEN, QUINTICS, problem())
        back = pickle.loads(pickle.dumps(motion))
        np.testing.assert_array_equal(back.at(UNEVEN[1:] - 0.02), motion.at(UNEVEN[1:] - 0.02))
        assert (back.limit_ratios, back.cost, back.planner) == (motion.limit_ratios, 1.0, "test")

    @pytest.mark.parametrize(
        ("t", "rows", "message"),
        [
            ([0.0], 1, "give"),
            ([0.0, 1.0], 3, r"shapes \(2,\), \(3, 2\), \(3, 2\), \(3, 2\)"),
            ([0.0, 1.0, 0.5], 3, "never fall"),
            ([0.1, 1.0], 2, "begin at 0"),
            ([0.0, math.nan], 2, "must be finite"),
            ([0.0, 0.0], 2, "never fall"),
        ],
    )
    def test_samples_that_are_no_motion_are_refused(self, t: list[float], rows: int, message: str) -> None:
        with pytest.raises(ValueError, match=message):
            sampled_trajectory(problem(), t, *np.zeros((3, rows, 2)), planner="test")


class TestLimitRatios:
    LIMITS = JointLimits(
        torque=(9.0, 2.0), velocity=(1.0, 2.0), acceleration=(4.0, 4.0), jerk=(10.0, 8.0), angle=((-0.5, 2.5), 3.0)
    )

    def test_they_are_those_of_the_continuous_motion(self) -> None:
        asked = problem(self.LIMITS)
        motion = motion_of(UNEVEN, QUINTICS, asked)
        t, q, qd, qdd = dense(motion)
        tau = FREE.inverse_dynamics(q, qd, qdd)
        jerk = np.stack([p.deriv(3)(t) for p in QUINTICS], axis=-1)
        values = {"torque": tau, "velocity": qd, "acceleration": qdd, "jerk": jerk, "angle": q - [1.0, 0.0]}
        for kind, x in values.items():
            worst = float(np.max(np.abs(x) / self.LIMITS.array(kind)))  # type: ignore[arg-type]
            assert motion.limit_ratios[kind] == pytest.approx(worst, rel=1e-4), kind
        assert motion.limit_ratio == max(motion.limit_ratios.values())

    def test_that_of_jerk_is_not_less_than_the_interpolation_has_anywhere(self) -> None:
        t, rate = np.linspace(0.0, 2.0, 7)[:, None], np.array([3.0, 2.0])
        rows = np.sin(rate * t), rate * np.cos(rate * t), -(rate**2) * np.sin(rate * t)
        motion = sampled_trajectory(problem(JointLimits(jerk=1.0)), t[:, 0], *rows, planner="test")
        dense = np.linspace(0.0, motion.duration, 20_001)
        jerk = np.abs(np.diff(motion.at(dense)[2], axis=0)) / dense[1]
        assert jerk.max() <= motion.limit_ratios["jerk"] * (1.0 + 1e-6)

    def test_that_of_torque_is_the_peak_between_samples(self) -> None:
        """Between two samples, with constant jerk, the torque of a fast arm rises and falls."""
        t, limits = np.array([0.0, 0.02]), np.array([90.0, 20.0])
        s = t[:, None]
        for seed in (15, 47, 114, 187, 199, 216, 249, 265):
            generator = np.random.default_rng(seed)
            q, qd, qdd, jerk = (size * generator.uniform(-1.0, 1.0, 2) for size in (3.0, 10.0, 100.0, 1e4))
            rows = q + qd * s + qdd * s**2 / 2 + jerk * s**3 / 6, qd + qdd * s + jerk * s**2 / 2, qdd + jerk * s
            motion = sampled_trajectory(problem(JointLimits(torque=limits)), t, *rows, planner="test")
            tau = FREE.inverse_dynamics(*motion.at(np.linspace(0.0, 0.02, 4001)))
            assert motion.limit_ratios["torque"] == pytest.approx(np.max(np.abs(tau) / limits), rel=2e-6)

    def test_no_limit_gives_zero(self) -> None:
        motion = motion_of(UNEVEN, QUINTICS, problem())
        assert set(motion.limit_ratios.values()) == {0.0}
        one = motion_of(UNEVEN, QUINTICS, problem(JointLimits(velocity=(math.inf, 0.5))))
        assert {kind for kind, ratio in one.limit_ratios.items() if ratio > 0.0} == {"velocity"}

    def test_a_jump_exceeds_any_limit_of_jerk(self) -> None:
        t = np.array([0.0, 1.0, 1.0, 2.0])
        for limits, ratio in ((JointLimits(jerk=1e9), math.inf), (JointLimits(velocity=9.0), 0.0)):
            assert sampled_trajectory(problem(limits), t, *UP_AND_DOWN, planner="test").limit_ratios["jerk"] == ratio

    def test_samples_a_rounding_apart_have_no_jerk(self) -> None:
        """Constant acceleration, sampled twice at almost the same times."""
        t = np.sort(np.concatenate([np.linspace(0.0, 1.0, 11), np.linspace(0.0, 1.0, 11)[1:-1] + 2e-16]))
        rows = [np.stack([x, x], axis=-1) for x in (0.5 * t**2, t, np.ones_like(t) + 1e-16 * np.arange(len(t)))]
        motion = sampled_trajectory(problem(JointLimits(jerk=1e-3)), t, *rows, planner="test")
        assert motion.limit_ratios["jerk"] < 1e-3

    @pytest.mark.parametrize(("name", "row", "value"), [("q", 0, 1e308), ("qd", 1, 1e200), ("t", 3, 1e308)])
    def test_numbers_whose_products_are_none_are_refused(self, name: str, row: int, value: float) -> None:
        rows: Array = np.zeros((3, 2, 2))
        times = np.array([0.0, value if name == "t" else 1.0])
        rows[min(row, 2), 1, 0] = 0.0 if name == "t" else value
        with pytest.raises(ValueError, match=r"must be finite, at most 1e\+100 in size"):
            sampled_trajectory(problem(), times, *rows, planner="test")

    @pytest.mark.parametrize("duration", [5e-324, 1e-200])
    def test_a_motion_takes_time(self, duration: float) -> None:
        with pytest.raises(ValueError, match="end after 1e-100 s or more"):
            sampled_trajectory(problem(), [0.0, duration], *np.zeros((3, 2, 2)), planner="test")


class TestClearance:
    def test_it_is_the_least_of_the_continuous_motion(self) -> None:
        discs = (Obstacle([1.4, 0.9], [-0.2, 0.1], 0.1), Obstacle([0.4, -1.8], [0.0, 0.2], 0.2))
        motion = motion_of(np.linspace(0.0, 2.0, 81), QUINTICS, problem(None, *discs))
        t, q, _, _ = dense(motion)
        gaps = [FREE.clearance(q, disc.position + t[:, None] * disc.velocity, disc.radius) for disc in discs]
        assert motion.clearance == pytest.approx(float(np.min(gaps)), abs=3e-6)
        assert motion.measured.clearance_time == pytest.approx(t[np.argmin(np.min(gaps, axis=0))], abs=0.1)

    def test_without_discs_it_is_inf(self) -> None:
        assert motion_of(UNEVEN, QUINTICS, problem()).clearance == math.inf

    def test_a_fast_disc_between_two_samples_is_not_missed(self) -> None:
        """It crosses the arm within 10 ms; the arm's two samples are a second apart."""
        disc = Obstacle([1.5, -7.3], [0.0, 20.0], 0.01)
        motion = sampled_trajectory(problem(None, disc), [0.0, 1.0], *np.zeros((3, 2, 2)), planner="test")
        assert motion.clearance < 0.0

    def test_joints_that_spin_between_two_samples_take_no_time_to_measure(self) -> None:
        """A million turns in a second, with a disc that they cannot reach and one that they must hit."""
        rows = np.array([[[0.0, 0.0], [2e6 * math.pi, 0.0]], np.full((2, 2), 2e6 * math.pi), np.zeros((2, 2))])
        away, hit = Obstacle([3.0, 0.0], [0.0, 0.0], 0.1), Obstacle([0.9, 0.5], [0.0, 0.0], 0.1)
        free = sampled_trajectory(problem(None, away), [0.0, 1.0], *rows, planner="test")
        assert 3.0 - 2.0 - 0.1 - FREE.link_radius - 3e-6 <= free.clearance <= 3.0 + 2.0
        struck = sampled_trajectory(problem(None, hit), [0.0, 1.0], *rows, planner="test")
        assert -0.1 - FREE.link_radius <= struck.clearance < 0.0
