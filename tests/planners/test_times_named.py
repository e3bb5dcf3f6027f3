"""A time that a refusal names is enough: as its message prints it, and a little more too."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from planners import Arm, FixedHand, FixedJoints, Infeasible, JointLimits, MotionProblem, Obstacle
from planners.capabilities import VARIANTS
from planners.checks import rounded_up
from planners.problem import Target

LIMITS = JointLimits(torque=[8.0, 3.0], velocity=[3.0, 3.0], acceleration=[9.0, 9.0])
ARM = Arm("arm", [0.4, 0.3], [3.0, 2.0], limits=LIMITS, gravity=0.0)
GOALS = np.random.default_rng(5).uniform(-2.0, 2.0, (4, 2))


def named(refusal: Infeasible) -> float:
    """The time that a message says is enough, as it is printed, s."""
    for pattern in (
        r"at least ([\d.e+-]+) s$",
        r"path takes ([\d.e+-]+) s",
        r"arrives at ([\d.e+-]+) s",
        r"; ([\d.e+-]+) s are enough",
        r"move takes ([\d.e+-]+) s",
    ):
        if match := re.search(pattern, refusal.message):
            return float(match[1])
    raise AssertionError(refusal)


@pytest.mark.parametrize("goal", GOALS, ids=str)
@pytest.mark.parametrize(
    ("planner", "variant"),
    [("dpct", "torque"), ("dpct", "timing"), ("lagrange", "optimal"), ("lagrange", "via"), ("trapezoid", "")],
)
def test_the_time_that_is_printed_is_enough(planner: str, variant: str, goal: np.ndarray) -> None:
    plan = VARIANTS[planner, variant].plan
    problem = MotionProblem(ARM, np.array([0.2, 0.4]), FixedJoints(goal), 0.05)
    with pytest.raises(Infeasible) as refusal:
        plan(problem)
    printed, exact = named(refusal.value), refusal.value.details["minimum_time"]
    assert isinstance(exact, float)
    assert exact <= printed <= 1.001 * exact
    for horizon in (printed, 1.001 * printed, 1.5 * printed):
        assert plan(replace(problem, horizon=horizon)).rendezvous_time <= horizon * (1.0 + 1e-9)


@pytest.mark.parametrize("kind", ["joints", "hand"])
def test_many_links_are_refused_with_a_time_that_is_enough(kind: str) -> None:
    """Interpolations of a high degree, whose searches for a shorter time are bounded by a number."""
    limits = JointLimits(torque=6 * [3.0], velocity=6 * [1.0], acceleration=6 * [4.0], jerk=6 * [30.0], angle=6 * [2.0])
    arm = Arm("six", 6 * [0.3], 6 * [1.0], limits=limits, gravity=0.0)
    goal = np.array([1.2, -1.0, 0.8, 1.1, -0.9, 0.7])
    target: Target = FixedJoints(goal) if kind == "joints" else FixedHand(arm.forward_kinematics(goal))
    problem = MotionProblem(arm, np.full(6, -0.2), target, 1.0)
    options = {"nodes": 25, "polish": False}
    plan = VARIANTS["lagrange", "optimal"].plan
    with pytest.raises(Infeasible, match="allow at least") as refusal:
        plan(problem, **options)
    for longer in (1.0, 1.001):
        motion = plan(replace(problem, horizon=longer * named(refusal.value)), **options)
        assert motion.limit_ratio <= 1.0 + 1e-6


def test_no_time_is_named_after_which_an_obstacle_is_touched() -> None:
    """The shorter of two turns to the goal touches the disc, however long it takes; the other takes longer."""
    limits = JointLimits(torque=[math.inf], velocity=[5.4], acceleration=[3.6], angle=[math.inf])
    arm = Arm("one", [0.25], [1.6], limits=limits, gravity=0.0)
    disc = Obstacle([0.0, -0.2], [0.0, 0.0], 0.03)
    free = MotionProblem(arm, [-2.6], FixedHand(0.25 * np.array([math.cos(0.01), math.sin(0.01)])), 1.66, qd=[0.1])
    plan = VARIANTS["dpct", "torque"].plan
    with pytest.raises(Infeasible) as refusal:
        plan(free)
    assert plan(replace(free, horizon=1.001 * named(refusal.value))).clearance == math.inf
    with pytest.raises(Infeasible, match="raise it further") as refusal:
        plan(replace(free, obstacles=(disc,)))
    assert "minimum_time" not in refusal.value.details
    assert plan(replace(free, horizon=4.0, obstacles=(disc,))).clearance > 0.0


def test_no_time_is_named_if_every_path_touches_an_obstacle_in_its_least_time() -> None:
    """Of an arm of six links, with several postures at the target."""
    limits = JointLimits(torque=[math.inf] * 6, velocity=[2.0] * 6, acceleration=[3.0] * 6, angle=[math.inf] * 6)
    arm = Arm("six", [0.2] * 6, [1.0] * 6, limits=limits, gravity=0.0)
    start = np.full(6, 0.3)
    base = Obstacle([0.0, 0.0], [0.0, 0.0], 0.05)
    problem = MotionProblem(arm, start, FixedHand([0.5, -0.6]), 0.1, obstacles=(base,))
    plan = VARIANTS["dpct", "torque"].plan
    with pytest.raises(Infeasible, match=r"in their least times touch an obstacle; the horizon is 0\.1 s") as refusal:
        plan(problem)
    assert "minimum_time" not in refusal.value.details
    with pytest.raises(Infeasible, match="raise it") as refusal:
        plan(replace(problem, obstacles=()))
    plan(replace(problem, obstacles=(), horizon=1.001 * named(refusal.value)))


@pytest.mark.parametrize(
    ("value", "expected"), [(1.2341, 1.235), (1.234, 1.234), (9.9991, 10.0), (3e-7, 3e-7), (12345.0, 12350.0)]
)
def test_rounding_to_four_digits_is_never_down(value: float, expected: float) -> None:
    assert rounded_up(value) == expected
