"""Joint limits from numbers, lists and arrays; ranges of the angles; refusals that say how to write it."""

from __future__ import annotations

import math
import pickle
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planners import SCARA_50CM, Arm, FixedJoints, JointLimits, MotionProblem, sampled_trajectory

ends = st.floats(-1e3, 1e3).filter(lambda value: abs(value) > 1e-6)


def test_lists_arrays_and_integers_are_the_same_limits() -> None:
    plain = JointLimits(torque=(10.0, 4.0), angle=(2.0, 1.0))
    for given_ in ([10, 4], np.array([10, 4]), np.array([10.0, 4.0], dtype=np.float32), (np.float64(10.0), 4)):
        assert JointLimits(torque=given_, angle=np.array([2, 1])) == plain
    assert hash(JointLimits(torque=[10, 4], angle=[2, 1])) == hash(plain)


def test_a_number_holds_for_every_joint_of_the_others_or_of_the_arm() -> None:
    assert JointLimits(torque=(10.0, 4.0), velocity=2).velocity == (2.0, 2.0)
    open_ = JointLimits(torque=5.0, velocity=np.float64(2.0), angle=1.5)
    arm = Arm("pair", [0.4, 0.3], [1.0, 1.0], open_)
    assert arm.limits == JointLimits(torque=(5.0, 5.0), velocity=(2.0, 2.0), angle=(1.5, 1.5))
    assert open_.for_joints(3).torque == (5.0, 5.0, 5.0)
    assert repr(open_) == "JointLimits(torque=5.0, velocity=2.0, acceleration=inf, jerk=inf, angle=1.5)"
    assert replace(open_, jerk=7.0).for_joints(2).jerk == (7.0, 7.0)
    assert pickle.loads(pickle.dumps(open_)).for_joints(2) == open_.for_joints(2)
    assert open_.scaled(2.0).for_joints(2).torque == (10.0, 10.0)
    limited = MotionProblem(arm, np.zeros(2), FixedJoints(np.ones(2)), 1.0, limits=JointLimits(velocity=1.0))
    assert limited.joint_limits.velocity == (1.0, 1.0)


def test_limits_of_another_number_of_joints_are_refused() -> None:
    one = JointLimits(torque=(5.0,))
    with pytest.raises(ValueError, match="limits are given for 1 joints, pair has 2; give one value per joint, or"):
        Arm("pair", [0.4, 0.3], [1.0, 1.0], one)
    with pytest.raises(ValueError, match="limits are given for 1 joints, the arm has 2"):
        MotionProblem(SCARA_50CM, np.zeros(2), FixedJoints(np.ones(2)), 1.0, limits=one)


def test_a_masked_value_is_no_limit() -> None:
    hidden = np.ma.masked_array([0.2, 0.4], [False, True])
    for kind in ("torque", "angle"):
        with pytest.raises(ValueError, match=f"{kind} limits"):
            JointLimits(**{kind: hidden})
    for one in (np.ma.masked, np.ma.array(1.0, mask=True)):
        with pytest.raises(ValueError, match=r"horizon .* must be a finite number$"):
            MotionProblem(SCARA_50CM, np.zeros(2), FixedJoints(np.ones(2)), one)
    with pytest.raises(ValueError, match="torque limits"):
        JointLimits(torque=[hidden[0], hidden[1]])
    with pytest.raises(ValueError, match=r"q .* must be numbers"):
        sampled_trajectory(
            MotionProblem(SCARA_50CM, np.zeros(2), FixedJoints(np.ones(2)), 1.0),
            [0.0, 1.0],
            [hidden, np.zeros(2)],  # type: ignore[list-item]
            *np.zeros((2, 2, 2)),
            planner="test",
        )


def test_an_angle_is_a_number_or_a_pair() -> None:
    limits = JointLimits(angle=[(-0.5, 2.5), 2.0, math.inf, (-1.0, 1.0), [-3.0, -1.0], np.array([4.0, 9.0])])
    assert limits.angle == ((-0.5, 2.5), 2.0, math.inf, 1.0, (-3.0, -1.0), (4.0, 9.0))
    np.testing.assert_array_equal(limits.angle_lower, [-0.5, -2.0, -math.inf, -1.0, -3.0, 4.0])
    np.testing.assert_array_equal(limits.angle_upper, [2.5, 2.0, math.inf, 1.0, -1.0, 9.0])
    np.testing.assert_array_equal(limits.angle_middle, [1.0, 0.0, 0.0, 0.0, -2.0, 6.5])
    np.testing.assert_array_equal(limits.angle_half, [1.5, 2.0, math.inf, 1.0, 1.0, 2.5])
    np.testing.assert_array_equal(limits.array("angle"), limits.angle_half)
    assert limits.angle_text == "-0.5 to 2.5, +-2, any, +-1, -3 to -1, 4 to 9 rad"
    assert JointLimits(angle=[(-math.inf, math.inf)]) == JointLimits.unlimited(1)


@pytest.mark.parametrize(
    ("kinds", "message"),
    [
        ({"torque": "strong"}, r"torque limits 'strong' are no numbers; Write one positive number per joint, or one"),
        ({"torque": [1.0, "2"]}, r"torque limits \(1.0, '2'\): '2' is no number; .* in N m"),
        ({"velocity": [1.0, True]}, "True is no number"),
        ({"torque": math.nan}, r"torque limits \(nan,\) must be positive; use inf for no limit"),
        ({"torque": [[1.0, 2.0]]}, r"\[1.0, 2.0\] is no number"),
        ({"torque": [1.0, 2.0], "jerk": [1.0]}, r"jerk limits: 1 values for 2 joints \(2 torque limits are given\)"),
        ({"angle": (-1.0, 2.0)}, r"angle limits \(-1.0, 2.0\) must be positive; .* may be a pair \(lower, upper\)"),
        ({"angle": [(2.0, -1.0)]}, r"angle limits: \(2.0, -1.0\) rad must be two finite numbers, the lower end first"),
        ({"angle": [(1.0, 1.0)]}, "the lower end first"),
        ({"angle": [(-1.0, math.inf)]}, "use inf for a joint without a range"),
        ({"angle": [(math.nan, 1.0)]}, r"angle limits: \(nan, 1.0\) rad must be two finite numbers"),
        ({"angle": [(-1.0, 0.0, 1.0)]}, r"\(-1.0, 0.0, 1.0\) is no pair of numbers"),
        ({"angle": [None]}, "None is no number"),
    ],
)
def test_impossible_limits_are_refused_with_how_to_write_them(kinds: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        JointLimits(**kinds)


@given(one=ends, other=ends)
@settings(deadline=None)
def test_the_ends_of_a_range_load_it_fully_and_what_is_beyond_more(one: float, other: float) -> None:
    """The load is |q - middle| / half: at most 1 at both ends to the bit, more than 1 outside."""
    lower, upper = sorted((one, other))
    if not lower < upper:
        return
    limits = JointLimits(torque=[1.0], angle=[(lower, upper)])
    still = np.zeros((2, 1))

    def load(*q: float) -> float:
        angles = np.array(q)[:, None]
        problem = MotionProblem(Arm("one", 1.0, 1.0, limits), [lower], FixedJoints([upper]), 1.0)
        return sampled_trajectory(problem, [0.0, 1.0], angles, still, still, planner="test").limit_ratios["angle"]

    assert load(lower, upper) <= 1.0
    assert load(lower, upper) == pytest.approx(1.0)
    assert limits.within([lower])
    assert limits.within([upper])
    beyond = upper + 1e-6 * (upper - lower) + 1e-9
    assert load(beyond, upper) > 1.0
    assert not limits.within([beyond])


def test_unknown_kinds_of_limits_are_refused() -> None:
    with pytest.raises(ValueError, match='unknown kind of limit "speed"'):
        SCARA_50CM.limits.array("speed")  # type: ignore[arg-type]


def test_nan_is_in_no_range() -> None:
    limits = JointLimits.unlimited(2)
    np.testing.assert_array_equal(limits.within([[0.0, math.nan], [1e9, -1e9]]), [False, True])


def test_arrays_of_limits_cannot_be_written() -> None:
    limits = SCARA_50CM.limits
    for array in (limits.array("torque"), limits.array("angle"), limits.angle_lower, limits.angle_middle):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    np.testing.assert_array_equal(limits.array("acceleration"), limits.acceleration)


THINGS = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3) | st.just(10**400) | st.just(1j),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=2),
    max_leaves=5,
)


@given(kinds=st.dictionaries(st.sampled_from(["torque", "velocity", "jerk", "angle"]), THINGS, max_size=3))
@settings(deadline=None)
def test_anything_given_as_limits_is_taken_or_refused(kinds: dict[str, Any]) -> None:
    with suppress(ValueError):
        limits = JointLimits(**kinds)
        assert all(value > 0.0 for value in limits.torque)


@given(
    parts=st.dictionaries(
        st.sampled_from(["name", "lengths", "masses", "coms", "inertias", "gravity", "base", "link_radius", "limits"]),
        THINGS,
        max_size=3,
    )
)
@settings(deadline=None)
def test_anything_given_as_an_arm_is_taken_or_refused(parts: dict[str, Any]) -> None:
    with suppress(ValueError):
        arm = Arm(**({"name": "any", "lengths": [0.4, 0.3], "masses": 1.0} | parts))
        assert all(length > 0.0 for length in arm.lengths)
