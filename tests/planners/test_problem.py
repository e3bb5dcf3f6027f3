"""What is asked of a planner, and how it refuses: checks, copies, pickling."""

from __future__ import annotations

import copy
import math
import pickle
from typing import Any

import numpy as np
import pytest

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
)
from planners.apf.distance_table import DistanceTable


def problem(**changes: Any) -> MotionProblem:
    given = {"arm": SCARA_1M, "q": [0.1, 0.2], "target": FixedJoints([1.0, 1.0]), "horizon": 3.0}
    return MotionProblem(**(given | changes))


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
            ({"arm": PLANAR_3R}, r"q has shape \(2,\); it must have shape \(3,\) for the joints of the arm PLANAR_3R"),
        ],
    )
    def test_impossible_questions_are_refused_by_value(self, changes: dict[str, Any], message: str) -> None:
        with pytest.raises(ValueError, match=message):
            problem(**changes)

    def test_impossible_targets_and_obstacles_are_refused_by_value(self) -> None:
        with pytest.raises(ValueError, match=r"velocity .* must be finite, at most 1e\+100"):
            MovingHand(np.zeros(2), np.array([1e200, 0.0]))
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

    @pytest.mark.parametrize(
        ("value", "other"),
        [
            (FixedJoints([0.0, 1.0]), FixedJoints([0.0, 2.0])),
            (FixedJoints([0.0, 1.0]), FixedJoints([0.0, 1.0, 1.0])),
            (FixedHand([0.0, 1.0]), FixedHand([0.0, 1.0], 0.0)),
            (MovingHand([0.0, 1.0], [0.0, 0.0]), MovingHand([0.0, 1.0], [0.0, 0.1])),
            (Obstacle([0.0, 1.0], [0.0, 0.0], 0.1), Obstacle([0.0, 1.0], [0.0, 0.0], 0.2)),
            (problem(), problem(obstacles=Obstacle([0.0, 1.0], [0.0, 0.0], 0.1))),
            (problem(), FixedJoints([0.0, 1.0])),
            (DistanceTable.looking_ahead(0.4), DistanceTable.looking_ahead(0.3)),
        ],
    )
    def test_equal_values_are_equal_and_hash_alike(self, value: Any, other: Any) -> None:
        again = copy.deepcopy(value)
        assert value == again
        assert hash(value) == hash(again)
        assert value != other
        assert value in (other, again)

    def test_zero_is_zero_of_either_sign(self) -> None:
        assert len({FixedJoints([0.0, 1.0]), FixedJoints([-0.0, 1.0])}) == 1


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
