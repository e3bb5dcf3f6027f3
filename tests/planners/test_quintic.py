from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.interpolate import BPoly

from planners import PLANAR_3R, FixedHand, FixedJoints, Infeasible, JointLimits, MotionProblem, Obstacle, quintic

HEAVY = replace(PLANAR_3R, gravity=9.81, limits=JointLimits())
START, GOAL = np.array([0.2, -0.5, 1.0]), np.array([1.2, 0.4, -0.3])


def problem(**changes: object) -> MotionProblem:
    return replace(MotionProblem(HEAVY, START, FixedJoints(GOAL), 0.8), **changes)  # type: ignore[arg-type]


def test_it_is_the_hermite_quintic() -> None:
    plan = quintic.plan(problem())
    for joint in range(3):
        ends = [[START[joint], 0.0, 0.0], [GOAL[joint], 0.0, 0.0]]
        reference = BPoly.from_derivatives([0.0, 0.8], ends)
        for order, values in enumerate((plan.q, plan.qd, plan.qdd)):
            np.testing.assert_allclose(values[:, joint], reference(plan.t, nu=order), atol=1e-10)


def test_cost_is_the_integral_of_the_torques() -> None:
    plan = quintic.plan(problem())

    def effort(t: float) -> float:
        return float(np.abs(HEAVY.inverse_dynamics(*plan.at(t))).sum())

    assert plan.cost == pytest.approx(quad(effort, 0.0, 0.8, limit=400)[0], rel=1e-4)


def test_compiled_effort_equals_the_plans() -> None:
    plan, peak = quintic.plan(problem()), np.empty(3)
    effort = quintic.quintic_effort(*HEAVY.chain_constants, START, GOAL, 0.8, peak)
    assert effort == pytest.approx(plan.cost, rel=1e-12)
    sampled = np.isin(
        plan.t, 0.8 * np.linspace(0.0, 1.0, quintic.SAMPLES + 1)
    )  # not where it turns between two samples
    np.testing.assert_allclose(peak, np.abs(plan.tau[sampled]).max(axis=0), rtol=1e-12)


def test_a_motion_beyond_the_limits_is_refused_with_the_number() -> None:
    limited = problem(horizon=0.1, limits=PLANAR_3R.limits)
    with pytest.raises(Infeasible, match=r"takes joint \d to .* times its torque limit of .* N m at") as caught:
        quintic.plan(limited)
    assert caught.value.details["kind"] == "torque"
    slow = quintic.plan(problem(horizon=8.0, limits=PLANAR_3R.limits, arm=replace(HEAVY, gravity=0.0)))
    assert 0.0 < slow.limit_ratio <= 1.0


def test_an_obstacle_on_the_way_is_refused_with_the_depth() -> None:
    parked = Obstacle(HEAVY.forward_kinematics(0.5 * (START + GOAL)), np.zeros(2), 0.05)
    with pytest.raises(Infeasible, match=r"touches an obstacle, .* mm deep at .* s") as caught:
        quintic.plan(problem(obstacles=(parked,)))
    assert caught.value.reason == "collision"


def test_the_papers_move_from_rest_to_rest() -> None:
    """Horizontal; 5.500 N m s by an independent computation."""
    plan = quintic.plan(MotionProblem(PLANAR_3R, np.zeros(3), FixedJoints(np.array([1.0, 0.0, 0.0])), 1.0))
    assert plan.cost == pytest.approx(5.500, abs=1e-3)


@pytest.mark.parametrize("jerk", [math.inf, 1e4])
def test_a_moving_start_is_matched_and_its_acceleration_too_where_jerk_is_limited(jerk: float) -> None:
    qd, qdd = np.array([0.4, -0.3, 0.2]), np.array([1.0, 2.0, -3.0])
    plan = quintic.plan(problem(qd=qd, qdd=qdd, limits=JointLimits(jerk=jerk)))
    for joint in range(3):
        first = qdd[joint] if math.isfinite(jerk) else 0.0
        reference = BPoly.from_derivatives([0.0, 0.8], [[START[joint], qd[joint], first], [GOAL[joint], 0.0, 0.0]])
        for order, values in enumerate((plan.q, plan.qd, plan.qdd)):
            np.testing.assert_allclose(values[:, joint], reference(plan.t, nu=order), atol=1e-10)


def test_what_it_cannot_do_is_said() -> None:
    with pytest.raises(ValueError, match="goes to a target of kind joints, not hand"):
        quintic.plan(problem(target=FixedHand(np.array([0.3, 0.2]), 0.0)))
