"""Joint ranges around any angle: an arm in the plane does not know where its first angle is counted from.

Turning the whole scene by an angle, with the range of the first joint, leaves every plan the same but for that angle.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from planners import (
    SCARA_50CM,
    Arm,
    FixedHand,
    FixedJoints,
    Infeasible,
    JointLimits,
    MotionProblem,
    MovingHand,
    Trajectory,
    apf,
    dpct,
    lagrange,
)
from planners.apf import dodge_accelerations, new_memory, tuned_gains
from planners.motion.spacetime.search import search
from planners.typing import Array

TURN = 1.1
START = np.array([-0.6, 0.9])
ARM = replace(SCARA_50CM, limits=replace(SCARA_50CM.limits, jerk=(300.0, 600.0), angle=(1.6, 2.2)))

JUMPING = ("dpct timing", "dpct torque", "lagrange via", "apf")
"""Plans whose acceleration jumps, for arms without limits of jerk."""

Plan = Callable[[MotionProblem], Trajectory]


def turned(points: Array, angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.asarray(points) @ np.array([[c, s], [-s, c]])


def turned_arm(angle: float) -> Arm:
    return replace(ARM, limits=replace(ARM.limits, angle=((-1.6 + angle, 1.6 + angle), 2.2)))


def scene(kind: str, angle: float, *, jerk: bool = True) -> MotionProblem:
    """A problem, turned: to joints, to a hand position, or along a belt; close to the ends of the first range."""
    arm, start = turned_arm(angle), START + np.array([angle, 0.0])
    if not jerk:
        arm = replace(arm, limits=replace(arm.limits, jerk=()))
    if kind == "joints":
        target: FixedJoints | FixedHand | MovingHand = FixedJoints(np.array([1.5 + angle, 0.4]))
    elif kind == "hand":
        target = FixedHand(turned(ARM.forward_kinematics([1.3, 0.8]), angle))
    else:
        hand = ARM.forward_kinematics(START)
        along = (ARM.forward_kinematics([0.6, 1.2]) - hand) / 2.5
        target = MovingHand(turned(hand + 0.1 * along, angle), turned(along, angle))
    return MotionProblem(arm, start, target, 4.0)


PLANS: dict[str, tuple[str, Plan]] = {
    "dpct": ("belt", dpct.plan),
    "dpct to joints": ("joints", dpct.plan),
    "dpct timing": ("hand", lambda problem: dpct.plan(problem, variant="timing")),
    "dpct torque": ("joints", lambda problem: dpct.plan(problem, variant="torque")),
    "lagrange": ("joints", lagrange.plan),
    "lagrange to a hand": ("hand", lagrange.plan),
    "lagrange belt": ("belt", lagrange.plan),
    "lagrange via": ("hand", lambda problem: lagrange.plan(problem, variant="via")),
    "apf": ("hand", apf.plan),
}


@pytest.mark.parametrize("name", PLANS)
def test_a_turned_scene_has_the_turned_plan(name: str) -> None:
    kind, plan = PLANS[name]
    one, other = (plan(scene(kind, angle, jerk=name not in JUMPING)) for angle in (0.0, TURN))
    assert other.duration == pytest.approx(one.duration, rel=1e-3)
    t = np.linspace(0.0, min(one.duration, other.duration), 50)
    np.testing.assert_allclose(other.at(t)[0] - [TURN, 0.0], one.at(t)[0], atol=0.02)
    assert other.limit_ratios["angle"] == pytest.approx(one.limit_ratios["angle"], abs=0.02)
    assert turned_arm(TURN).limits.within(other.q - 1e-7 * np.sign(other.q - [TURN, 0.0])).all()


@pytest.mark.parametrize("name", ["dpct timing", "lagrange", "lagrange via"])
def test_a_target_beyond_the_end_of_a_range_is_refused_on_either_side(name: str) -> None:
    _, plan = PLANS[name]
    for angle in (1.5 + TURN + 0.15, -1.6 + TURN - 0.05):
        beyond = replace(scene("joints", TURN, jerk=name not in JUMPING), target=FixedJoints(np.array([angle, 0.4])))
        with pytest.raises(Infeasible, match=r"range|limits"):
            plan(beyond)


def test_the_search_among_moving_discs_is_the_same() -> None:
    def found(angle: float) -> Trajectory:
        problem = scene("hand", angle)
        assert isinstance(problem.target, FixedHand)
        path = np.tile(turned(np.array([0.75, 0.55]), angle), (161, 1, 1))
        limits = replace(problem.joint_limits, acceleration=(4.5, 8.0))
        answer = search(
            problem.arm, problem.q, problem.target.position, path, 0.05, [0.05], limits=limits, time_steps=[0.2]
        )
        assert answer.trajectory is not None
        return answer.trajectory

    one, other = found(0.0), found(TURN)
    assert other.rendezvous_time == pytest.approx(one.rendezvous_time, abs=0.051)
    assert turned_arm(TURN).limits.within(other.q).all()


def test_the_dodging_field_is_the_same() -> None:
    """Closed loop past a disc, double integrators for the arm."""

    def driven(angle: float) -> Array:
        problem = scene("hand", angle)
        assert isinstance(problem.target, FixedHand)
        place, velocity = (turned(np.array(v), angle)[None, None] for v in ([0.62, 0.52], [0.0, -0.05]))
        goal = problem.target.position[None]
        q, qd, memory, period = problem.q[None], np.zeros((1, 2)), new_memory(1, 1), 0.02
        angles = []
        for _ in range(150):
            qdd = dodge_accelerations(
                problem.arm,
                tuned_gains(),
                q,
                qd,
                goal,
                place,
                velocity,
                [[0.05]],
                memory,
                period,
            )
            q, qd, place = q + period * (qd + 0.5 * period * qdd), qd + period * qdd, place + period * velocity
            angles.append(q[0] - [angle, 0.0])
        return np.array(angles)

    np.testing.assert_allclose(driven(TURN), driven(0.0), atol=0.02)


def test_ranges_of_more_than_a_turn_and_without_zero_are_planned_in() -> None:
    limits = replace(ARM.limits, jerk=(), angle=((2.0, 9.0), (-2.4, 2.4)))
    arm = replace(ARM, limits=limits)
    target = FixedHand(arm.forward_kinematics([0.4, 1.0]))
    for plan in (lagrange.plan, PLANS["dpct timing"][1], PLANS["lagrange via"][1]):
        motion = plan(MotionProblem(arm, np.array([6.0, 0.8]), target, 6.0))
        assert limits.within(motion.q).all()
        np.testing.assert_allclose(arm.forward_kinematics(motion.q[-1]), target.position, atol=1e-3)
        np.testing.assert_allclose(motion.q[-1, 0], 0.4 + 2.0 * math.pi, atol=0.02)
    assert JointLimits(angle=((2.0, 9.0),)).angle_middle[0] == 5.5
