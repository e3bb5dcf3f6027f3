"""Numbers at the ends of what a float holds, and degenerate problems: planned, or refused in words."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from planners import (
    Arm,
    FixedHand,
    FixedJoints,
    Infeasible,
    JointLimits,
    MotionProblem,
    MovingHand,
    Obstacle,
    Trajectory,
    apf,
    dpct,
    lagrange,
    quintic,
    sampled_trajectory,
    trapezoid,
)
from planners.capabilities import VARIANTS, Variant, variant
from planners.problem import Target
from tools.fuzzing.promises import broken_promises

LIMITS = JointLimits(torque=[30.0, 15.0], velocity=[3.0, 3.0], acceleration=[9.0, 9.0], angle=[2.8, 2.8])
ARM = Arm("arm", [0.4, 0.3], [3.0, 2.0], limits=LIMITS)
LIGHT = Arm("light", [0.4, 0.4], [1e-9, 1e-9], limits=JointLimits(velocity=3.0, acceleration=9.0), gravity=9.81)
GOAL = FixedJoints([0.8, 0.9])
QUICK = [("dpct", "optimal"), ("dpct", "timing"), ("dpct", "torque"), ("lagrange", "via"), ("apf", "field")]
QUICK += [("trapezoid", ""), ("quintic", "")]


def problem(**changes: Any) -> MotionProblem:
    given = {"arm": ARM, "q": [0.3, 0.7], "target": GOAL, "horizon": 3.0, **changes}
    return MotionProblem(**given)


def outcome(entry: Variant, asked: MotionProblem) -> str:
    """Plan: "solved", with all that is promised kept, or the reason of a refusal; another error goes on."""
    try:
        motion = entry.plan(asked)
    except Infeasible as refusal:
        return "message with a NaN" if "nan" in refusal.message else refusal.reason
    assert broken_promises(asked, motion, entry) == []
    return "solved"


@pytest.mark.parametrize(
    ("made", "name"),
    [
        (lambda x: problem(horizon=x), "horizon"),
        (lambda x: problem(payload=x), "payload mass"),
        (lambda x: problem(q=[x, 0.0]), "q"),
        (lambda x: problem(qd=[0.0, -x]), "qd"),
        (lambda x: FixedHand([0.1, 0.1], x), "orientation"),
        (lambda x: MovingHand([0.1, 0.1], [0.0, -x]), "velocity"),
        (lambda x: Obstacle([0.1, 0.1], [0.0, 0.0], x), "obstacle radius"),
        (lambda x: Arm("arm", [0.4, x], [1.0, 1.0]), "lengths"),
        (lambda x: Arm("arm", [0.4], [1.0], gravity=-x), "gravity"),
        (lambda x: Arm("arm", [0.4], [1.0], base=(0.0, x)), "base"),
        (lambda x: Arm("arm", [0.4], [1.0], link_radius=x), "link_radius"),
        (lambda x: ARM.with_payload(x), "payload mass"),
        (lambda x: JointLimits(torque=x), "torque limits"),
        (lambda x: JointLimits(jerk=[1.0, x]), "jerk limits"),
        (lambda x: JointLimits(angle=[(-x, 1.0), 1.0]), "angle limits"),
        (lambda x: apf.plan(problem(), period=x), "period"),
        (lambda x: apf.plan(problem(), tolerance=x), "tolerance"),
        (lambda x: lagrange.plan(problem(), variant="via", margin=x), "margin"),
        (lambda x: dpct.plan(problem(), variant="timing", prediction=x), "prediction"),
        (lambda x: dpct.plan(problem(), time_weight=-x), "time_weight"),
    ],
)
def test_numbers_above_1e100_are_refused_by_name(made: Callable[[float], Any], name: str) -> None:
    with pytest.raises(ValueError, match=rf"{name}.* 1e\+(100|09)"):
        made(1.1e100)


def test_numbers_of_32_bits_are_numbers() -> None:
    one = np.float32(1.0)
    given = MotionProblem(ARM.with_payload(one), [0.2, one], GOAL, one, obstacles=(Obstacle([one, one], [0, 0], one),))
    assert given.horizon == 1.0
    assert lagrange.plan(problem(), variant="via", margin=np.float32(0.125)).limit_ratio <= 1.0


def test_no_limit_is_still_written_as_inf() -> None:
    limits = JointLimits(torque=np.inf, velocity=[1.0, np.inf], angle=[np.inf, (-1.0, 2.0)])
    assert limits.for_joints(2).velocity == (1.0, np.inf)


@pytest.mark.parametrize("key", QUICK)
@pytest.mark.parametrize("size", [1e99, 1e30, 1e8, 1e-60, 1e-160, 1e-300])
def test_extreme_sizes_are_planned_or_refused_in_words(key: tuple[str, str], size: float) -> None:
    entry = VARIANTS[key]
    extremes = [{"horizon": size}, {"qd": [size, 0.4]}, {"q": [size, 0.7]}]
    extremes += [{"payload": size}] if size < 1e9 else []
    if size < 1.0:
        extremes += [{"arm": Arm("arm", [0.4, size], [1.0, 1.0], limits=LIMITS)}]
        extremes += [{"arm": Arm("arm", [0.4, 0.3], [size, 1.0], limits=LIMITS)}]
    for kind, values in itertools.product(("torque", "velocity", "acceleration"), ([size, 5.0], [5.0, size])):
        given = {one: getattr(LIMITS, one) for one in ("torque", "velocity", "acceleration")}
        extremes.append({"limits": JointLimits(**{**given, kind: values})})
    for changes in extremes:
        assert outcome(entry, problem(**changes)) != "message with a NaN", changes


@pytest.mark.parametrize("key", [*QUICK, ("apf", "paper")])
def test_degenerate_problems_are_planned_or_refused_in_words(key: tuple[str, str]) -> None:
    """Straight and folded elbows, the start as the goal, targets in the base and on the rim, tiny masses and times."""
    assert "solved" in outcomes(VARIANTS[key], [ARM, LIGHT], [[0.0, 0.0], [0.3, np.pi]])


@pytest.mark.parametrize("key", [("dpct", "free"), ("lagrange", "optimal")])
def test_rides_that_begin_with_a_straight_elbow_are_planned_or_refused_in_words(key: tuple[str, str]) -> None:
    assert outcomes(VARIANTS[key], [ARM], [[0.0, 0.0]], rides_only=True) & {"solved", "late"}


def outcomes(entry: Variant, arms: list[Arm], starts: list[list[float]], *, rides_only: bool = False) -> set[str]:
    places = [[0.7, 0.0], [0.8, 0.0], [0.1, 0.0], [0.0, 0.0]]
    targets: list[Target] = [MovingHand([0.6, 0.1], [0.0, 0.1]), MovingHand(places[2], [0.0, 0.0])]
    if not rides_only:
        targets += [FixedJoints([0.3, 0.0]), FixedJoints([0.0, 0.0]), FixedJoints([0.3, np.pi])]
        targets += [FixedHand(place) for place in places]
    asked = [
        MotionProblem(arm, q, target, horizon)
        for arm, target, q, horizon in itertools.product(arms, targets, starts, (1e-9, 1.5))
    ]
    found = {outcome(entry, one) for one in asked if entry.objection(one) is None}
    assert "message with a NaN" not in found
    return found


def test_an_error_of_arithmetic_is_a_refusal_of_our_planners_only(monkeypatch: pytest.MonkeyPatch) -> None:
    def divide(problem: MotionProblem) -> Trajectory:
        raise ZeroDivisionError("division by zero")

    def overflow(problem: MotionProblem) -> Trajectory:
        return quintic.plan(MotionProblem(ARM, np.full(2, 1e90), GOAL, float(np.float64(1e200) * np.float64(1e200))))

    def fall(asked: MotionProblem) -> Trajectory:
        return sampled_trajectory(asked, [0.0, 1.0, 0.5], *np.zeros((3, 3, 2)), planner="trial")

    takes = VARIANTS["quintic", ""].takes
    for planner, function in itertools.product(("quintic", "mine"), (divide, overflow, fall)):
        monkeypatch.setitem(VARIANTS, (planner, "trial"), VARIANTS["quintic", ""])
        plan = variant(planner, "trial", takes)(function)
        with pytest.raises(Infeasible if planner == "quintic" else (ArithmeticError, ValueError, RuntimeWarning)) as e:
            plan(problem())
        if planner == "quintic":
            assert "numbers that are so far apart" in str(e.value)


def test_a_fixed_target_is_held_for_days_and_not_for_ages() -> None:
    motion = dpct.plan(problem(horizon=1e12))
    assert motion.rendezvous_time < 3.0
    assert 1e5 < motion.duration < 1e7
    np.testing.assert_array_equal(motion.q[-1], GOAL.q)


def test_a_start_too_fast_to_brake_is_refused() -> None:
    with pytest.raises(Infeasible, match="start"):
        trapezoid.plan(problem(qd=[1e12, 0.4]))
