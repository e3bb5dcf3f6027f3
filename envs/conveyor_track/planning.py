"""What DPCT is asked on a conveyor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from planners import MotionProblem, MovingHand, Trajectory, dpct

DRIFT = 1e-3
"""Velocity of the hand across the part's line that is left to tracking, m/s."""


def meet_on_line(problem: MotionProblem) -> Trajectory:
    """DPCT: the earliest rendezvous on the line of the part.

    A payload that is not known yet makes the hand drift off its line a little, and DPCT plans for hands that move along
    it; what is across is taken out of the start.
    """
    return dpct.plan(_along_line(problem), allow_reverse=True)


def _along_line(problem: MotionProblem) -> MotionProblem:
    q, qd, _ = problem.start
    if not isinstance(problem.target, MovingHand) or not np.any(problem.target.velocity):
        return problem
    way = problem.target.velocity / np.linalg.norm(problem.target.velocity)
    jacobian = problem.arm.jacobian(q)
    velocity = jacobian @ qd
    along = (way @ velocity) * way
    if not 0.0 < np.linalg.norm(velocity - along) <= DRIFT:
        return problem
    return replace(problem, qd=np.asarray(np.linalg.lstsq(jacobian, along)[0], dtype=np.float64))
