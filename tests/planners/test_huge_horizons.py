"""A horizon is the time that is allowed: a huge one does not make what arrives early arrive late."""

from __future__ import annotations

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
    apf,
    dpct,
)
from planners.capabilities import VARIANTS
from planners.problem import Target
from planners.trajectory import measure
from planners.trajectory.least_clearance import least_clearance

LIMITS = JointLimits(torque=[30.0, 15.0], velocity=[3.0, 3.0], acceleration=[9.0, 9.0], angle=[2.8, 2.8])
ARM = Arm("arm", [0.4, 0.3], [3.0, 2.0], limits=LIMITS)
START = [0.3, 0.7]
BESIDE = ARM.forward_kinematics(START) - (0.2, 0.0)
STANDING, CREEPING = MovingHand(BESIDE, [0.0, 0.0]), MovingHand(BESIDE, [-0.01, 0.0])
"""The second one leaves the reach after 94 s."""
NEARING = MovingHand(BESIDE, [1e-12, 0.0])
"""So slow that it counts as standing, but for horizons in which it passes the hand."""

CASES = [
    *((name, target) for name in ("optimal", "timing") for target in (FixedJoints([0.8, 0.9]), FixedHand([0.35, 0.4]))),
    *((name, target) for name in ("optimal", "free") for target in (STANDING, CREEPING, NEARING)),
]


def arrival(planner: str, variant: str, target: Target, horizon: float) -> float:
    return VARIANTS[planner, variant].plan(MotionProblem(ARM, START, target, horizon)).rendezvous_time


@pytest.mark.parametrize("horizon", [1e4, 1e16, 1e30, 1e99])
@pytest.mark.parametrize(("variant", "target"), CASES)
def test_dpct_arrives_when_it_does_with_a_short_one(variant: str, target: Target, horizon: float) -> None:
    assert arrival("dpct", variant, target, horizon) == pytest.approx(arrival("dpct", variant, target, 5.0), rel=2e-3)


@pytest.mark.parametrize("horizon", [1e2, 1e4, 1e16, 1e99])
@pytest.mark.parametrize("target", [STANDING, CREEPING])
def test_lagrange_meets_a_target_with_its_margin_over_the_earliest_time(target: MovingHand, horizon: float) -> None:
    earliest = dpct.plan(MotionProblem(ARM, START, target, 5.0), allow_reverse=True).rendezvous_time
    assert earliest <= arrival("lagrange", "optimal", target, horizon) <= 1.6 * earliest


@pytest.mark.parametrize(("planner", "variant"), [("lagrange", "via"), ("apf", "field"), ("trapezoid", "")])
def test_others_arrive_at_the_same_time_to_the_bit(planner: str, variant: str) -> None:
    target = FixedHand([0.35, 0.4])
    assert len({arrival(planner, variant, target, horizon) for horizon in (5.0, 1e4, 1e30, 1e99)}) == 1


def test_the_paper_of_apf_ends_after_a_bounded_number_of_samples() -> None:
    problem = MotionProblem(ARM, START, FixedHand([0.35, 0.4]), 1e99)
    with pytest.raises(Infeasible, match=r"after 50 s, the last of 500000 samples, .* give a longer period"):
        apf.plan(problem, variant="paper", attraction=1e-3)
    longer = apf.plan(problem, variant="paper", attraction=1e-3, period=0.1)
    np.testing.assert_allclose(ARM.forward_kinematics(longer.q[-1]), [0.35, 0.4], atol=1.1e-3)


def test_a_start_across_the_path_among_discs_takes_a_bounded_number_of_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    """The joints spin while they brake over the whole horizon; discs are looked at in the chosen motion only."""
    limits = JointLimits(torque=[60.0] * 6, velocity=[2.0] * 6, acceleration=[5.0] * 6)
    arm = Arm("six", [0.2] * 6, [1.0] * 6, limits=limits)
    discs = tuple(Obstacle([2.0, y], [0.0, 0.0], 0.1) for y in (-1.0, 0.0, 1.0))
    goal, moving = np.linspace(0.5, -0.5, 6), np.array([0.1, 0.0, -0.1, 0.05, 0.0, 0.1])
    searches = []

    def counted(*given: Any) -> Any:
        searches.append(given)
        return least_clearance(*given)

    monkeypatch.setattr(measure, "least_clearance", counted)
    for target in (FixedJoints(goal), FixedHand(arm.forward_kinematics(goal))):
        problem = MotionProblem(arm, np.full(6, 0.2), target, 1.6e9, qd=moving, obstacles=discs)
        motion = dpct.plan(problem, variant="torque")
        assert len(searches) == 1  # in every attempt and posture it would take more than a minute
        searches.clear()
        assert len(motion.t) < 10_000
        assert 0.0 <= motion.clearance < 1.0
        assert motion.limit_ratio <= 1.0 + 1e-6
