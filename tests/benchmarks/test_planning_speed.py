"""How fast planners search, beside the inverse dynamics of the motions that they search."""

from __future__ import annotations

import time

import numpy as np
import pytest

from planners import Arm, FixedJoints, MotionProblem
from planners.lagrange.paper import node_angles, plan_paper

STEPS = 100  # of the trapezoidal rule
SAMPLES = 200_000


@pytest.mark.skipif("not config.getoption('--benchmark-enable')", reason="a ratio of times; needs --benchmark-enable")
def test_a_whole_grid_of_three_joints_takes_a_hundredth_of_the_inverse_dynamics_of_its_motions() -> None:
    """Under gravity, where most motions take about the same torque, all are added up almost to their end."""
    masses = (2.172876928913592, 0.6714211303179607, 3.31971816085836)
    arm = Arm("heavy", (0.5171472847539138, 0.580476393400382, 0.5215524488905523), masses, gravity=9.81)
    start, goal = (-0.48746434, -2.46002468, 1.73346655), FixedJoints((-1.09823233, 0.58097656, 3.14159265))
    problem = MotionProblem(arm, start, goal, 2.73)
    motions = np.prod([float(len(angles)) ** 3 for angles in node_angles(problem)])
    some = np.random.default_rng(0).normal(size=(3, SAMPLES, 3))
    plan_paper(problem, steps=STEPS, grid=[[0.0]] * 3)  # compiles
    arm.inverse_dynamics(*some)
    search, dynamics = np.empty(3), np.empty(3)
    for turn in range(3):
        began = time.process_time()
        plan_paper(problem, steps=STEPS)
        search[turn] = time.process_time() - began
        began = time.process_time()
        arm.inverse_dynamics(*some)
        dynamics[turn] = time.process_time() - began
    ours, theirs = search.min() / (motions * (STEPS + 1)), dynamics.min() / SAMPLES
    print(f"{motions:.3g} motions: a sample {1e9 * ours:.2f} ns, inverse dynamics {1e9 * theirs:.0f} ns")
    assert theirs / ours >= 100.0
