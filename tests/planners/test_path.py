from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planners import PLANAR_3R, SCARA_1M, Arm, Infeasible, JointLimits
from planners.motion.path import SINGULAR_SINE, HandLine, JointLine, look_up, tabulate
from planners.typing import Array

ANGLES = st.floats(-np.pi, np.pi)
BENDS = st.floats(0.3, 2.8) | st.floats(-2.8, -0.3)


def line_from(arm: Arm, q: Array, heading: float, length: float = 1.0) -> HandLine:
    direction = length * np.array([np.cos(heading), np.sin(heading)])
    return HandLine(arm, arm.forward_kinematics(q), direction, q)


def inside(line: HandLine, share: float = 0.8, samples: int = 9) -> Array:
    low, high = line.span
    return np.linspace(share * low, share * high, samples)


@given(ANGLES, BENDS, ANGLES)
@settings(deadline=None)
def test_two_links_keep_to_the_line_on_the_elbow_of_the_start(q1: float, q2: float, heading: float) -> None:
    line = line_from(SCARA_1M, np.array([q1, q2]), heading, length=0.7)
    r = inside(line)
    q = line.derivatives(r)[:, 0]
    np.testing.assert_allclose(SCARA_1M.forward_kinematics(q), line.origin + r[:, None] * line.direction, atol=1e-12)
    assert (np.sign(np.sin(q[:, 1])) == np.sign(q2)).all()
    np.testing.assert_allclose(line.derivatives([0.0])[0, 0], [q1, q2], atol=1e-9)


@given(ANGLES, BENDS, ANGLES, ANGLES)
@settings(deadline=None)
def test_three_links_keep_their_orientation(q1: float, q2: float, q3: float, heading: float) -> None:
    start = np.array([q1, q2, q3])
    line = line_from(PLANAR_3R, start, heading)
    r = inside(line)
    q = line.derivatives(r)[:, 0]
    np.testing.assert_allclose(PLANAR_3R.forward_kinematics(q), line.origin + r[:, None] * line.direction, atol=1e-12)
    np.testing.assert_allclose(q.sum(axis=1), start.sum(), atol=1e-12)


@pytest.mark.parametrize("arm", [SCARA_1M, PLANAR_3R])
@given(q1=ANGLES, q2=BENDS, heading=ANGLES)
@settings(max_examples=30, deadline=None)
def test_derivatives_agree_with_differences(arm: Arm, q1: float, q2: float, heading: float) -> None:
    line = line_from(arm, np.array([q1, q2, 0.4])[: arm.n_joints], heading)
    r, h = inside(line, 0.6), 1e-5
    exact, later, earlier = line.derivatives(r), line.derivatives(r + h), line.derivatives(r - h)
    for order in range(3):
        difference = (later[:, order] - earlier[:, order]) / (2.0 * h)
        scale = np.abs(exact[:, order + 1 :]).max()
        np.testing.assert_allclose(exact[:, order + 1], difference, atol=1e-4 * max(scale, 1.0))


def test_whole_turns_of_the_start_are_kept() -> None:
    start = np.array([0.3 + 4.0 * np.pi, 0.9 - 2.0 * np.pi])
    line = line_from(SCARA_1M, start, 0.2)
    np.testing.assert_allclose(line.derivatives([0.0])[0, 0], start, atol=1e-12)


def test_span_ends_where_the_elbow_straightens() -> None:
    line = line_from(SCARA_1M, np.array([0.3, 0.9]), 0.2)
    ends = line.derivatives(np.array(line.span))[:, 0, 1]
    np.testing.assert_allclose(np.abs(np.sin(ends)), SINGULAR_SINE, rtol=1e-6)


def test_a_place_where_the_elbow_is_straight_is_refused() -> None:
    line = line_from(SCARA_1M, np.array([0.3, 1.2]), 0.3)
    beyond = line.span[1] + 0.1 * (line.span[1] - line.span[0])  # out of reach: the elbow stays straight
    with pytest.raises(Infeasible, match="unreachable: the straight path of the hand passes a straight elbow"):
        line.derivatives([0.0, beyond])


def test_span_ends_at_the_hole_around_the_base() -> None:
    arm = replace(SCARA_1M, lengths=(1.0, 0.4))
    line = line_from(arm, np.array([0.0, 1.2]), np.pi)
    towards_base = line.origin + line.span[1] * line.direction
    assert np.hypot(*towards_base) == pytest.approx(0.6, abs=0.01)
    assert towards_base @ line.origin > 0.0


@pytest.mark.parametrize("q", [[0.4, 0.0], [0.4, np.pi - 1e-3]])
def test_a_straight_or_folded_start_is_refused(q: list[float]) -> None:
    with pytest.raises(Infeasible, match="straight or folded") as caught:
        line_from(SCARA_1M, np.array(q), 0.2)
    assert caught.value.reason == "start"


def test_wrong_arms_and_directions_are_refused() -> None:
    one = Arm("one", (1.0,), (1.0,), JointLimits.unlimited(1))
    with pytest.raises(ValueError, match="two or three links"):
        HandLine(one, np.array([1.0, 0.0]), np.array([0.0, 1.0]), np.zeros(1))
    with pytest.raises(ValueError, match="zero vector"):
        HandLine(SCARA_1M, np.array([1.0, 1.0]), np.zeros(2), np.array([0.0, np.pi / 2.0]))


def test_joint_line_is_straight() -> None:
    line = JointLine(np.array([0.1, 0.2, 0.3]), np.array([1.0, -2.0, 0.5]))
    q, f1, f2, f3 = np.moveaxis(line.derivatives([0.0, 0.5, 2.0]), 1, 0)
    np.testing.assert_allclose(q, [[0.1, 0.2, 0.3], [0.6, -0.8, 0.55], [2.1, -3.8, 1.3]])
    np.testing.assert_array_equal(f1, np.tile([1.0, -2.0, 0.5], (3, 1)))
    assert not f2.any()
    assert not f3.any()


@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_table_gives_the_torque_of_a_motion_along_the_path(gravity: float) -> None:
    arm = replace(PLANAR_3R, gravity=gravity)
    line = line_from(arm, np.array([0.3, 1.2, -0.5]), 2.0)
    table = tabulate(line, arm, *(0.8 * end for end in line.span))
    value, slope = np.empty((6, 3)), np.empty((6, 3))
    v, a = 0.7, -1.3
    for r in np.linspace(table.start, table.stop, 37):
        look_up(*table, r, value, slope)
        q, f1, f2, f3 = line.derivatives([r])[0]
        np.testing.assert_allclose(value[:3], [f1, f2, f3], rtol=1e-4, atol=1e-4 * np.abs(f3).max())
        torque = value[3] * a + value[4] * v**2 + value[5]
        exact = arm.inverse_dynamics(q, f1 * v, f2 * v**2 + f1 * a)
        np.testing.assert_allclose(torque, exact, atol=1e-5 * max(1.0, np.abs(exact).max()))


def test_table_slopes_are_the_derivatives_of_its_values() -> None:
    line = line_from(SCARA_1M, np.array([0.3, 1.2]), 2.0)
    table = tabulate(line, SCARA_1M, *(0.8 * end for end in line.span))
    value, slope, later, earlier = (np.empty((6, 2)) for _ in range(4))
    unused = np.empty((6, 2))
    h = 1e-6
    for r in np.linspace(table.start + 0.01, table.stop - 0.01, 23):
        look_up(*table, r, value, slope)
        look_up(*table, r + h, later, unused)
        look_up(*table, r - h, earlier, unused)
        difference = (later - earlier) / (2.0 * h)
        np.testing.assert_allclose(slope, difference, rtol=1e-5, atol=1e-5 * np.abs(slope).max())


def test_table_must_be_on_the_path() -> None:
    line = line_from(SCARA_1M, np.array([0.3, 1.2]), 2.0)
    with pytest.raises(ValueError, match="inside the path's span"):
        tabulate(line, SCARA_1M, 0.0, line.span[1] + 0.1)
