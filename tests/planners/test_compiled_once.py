"""Kernels are compiled for one kind of arguments: a problem without limits, or with a target of another kind, takes no
seconds of compilation more.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from planners import Arm, FixedHand, FixedJoints, JointLimits, MotionProblem, apf, dpct, lagrange
from planners.apf import paper
from planners.dpct import interior_point as dpct_solver
from planners.lagrange import interior_point as lagrange_solver

LIMITS = JointLimits(torque=[30.0, 15.0], velocity=[3.0, 3.0], acceleration=[9.0, 9.0])
START, GOAL = np.array([0.3, 0.7]), np.array([0.8, 0.9])


def problem(limits: JointLimits, *, hand: bool = False) -> MotionProblem:
    arm = Arm("arm", [0.4, 0.3], [3.0, 2.0], limits=limits)
    target = FixedHand(arm.forward_kinematics(GOAL)) if hand else FixedJoints(GOAL)
    return MotionProblem(arm, START, target, 3.0)


def kinds(kernel: Any) -> int:
    return len(kernel.signatures)


@pytest.mark.parametrize("limits", [JointLimits(), JointLimits(velocity=[3.0, np.inf])], ids=["none", "one"])
def test_lagrange_without_limits(limits: JointLimits) -> None:
    lagrange.plan(problem(LIMITS))
    before = kinds(lagrange_solver.solve)
    lagrange.plan(problem(limits))
    assert kinds(lagrange_solver.solve) == before


def test_dpct_at_a_given_time() -> None:
    dpct.plan(problem(LIMITS))
    before = kinds(dpct_solver.solve)
    dpct.plan(problem(LIMITS), rendezvous_time=2.0)
    assert kinds(dpct_solver.solve) == before


def test_the_field_to_a_place_of_the_hand() -> None:
    apf.plan(problem(LIMITS), variant="paper", period=1e-3)
    before = kinds(paper._follow)
    apf.plan(problem(LIMITS, hand=True), variant="paper", period=1e-3)
    assert kinds(paper._follow) == before
