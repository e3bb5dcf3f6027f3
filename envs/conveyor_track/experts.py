"""DPCT as an expert of ConveyorTrack-v0."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from planners import MotionProblem, MovingHand, Trajectory, dpct

DRIFT = 1e-3
"""Largest velocity of the hand across the part's line that is left to tracking, m/s."""


def meet_on_line(problem: MotionProblem) -> Trajectory:
    """The earliest rendezvous on the line of the part.

    DPCT plans for hands that move along that line. Before a payload is known the hand drifts off it a little; such a
    drift is taken out of the start.
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
    if problem.arm.n_joints == 3:  # DPCT keeps the orientation of the third link
        jacobian, along = np.vstack([jacobian, np.ones(3)]), np.append(along, 0.0)
    return replace(problem, qd=np.asarray(np.linalg.lstsq(jacobian, along)[0], dtype=np.float64))
