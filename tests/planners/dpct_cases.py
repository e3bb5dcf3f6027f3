"""The conveyor of the tests of DPCT."""

from __future__ import annotations

from typing import Any

import numpy as np

from planners import SCARA_1M, JointLimits, MotionProblem, MovingHand

HAND = np.array([-0.8, 1.732])


def conveyor(
    lead: float = 0.1,
    speed: float = 0.2,
    acceleration: float = 0.0,
    horizon: float = 3.0,
    limits: JointLimits = SCARA_1M.limits,
    elbow: int = 0,
    **options: Any,
) -> MotionProblem:
    """The paper's scenario: the part starts ``lead`` (D) behind the hand."""
    target = MovingHand(HAND - (lead, 0.0), np.array([speed, 0.0]), np.array([acceleration, 0.0]))
    q = SCARA_1M.inverse_kinematics(HAND)[elbow]
    return MotionProblem(SCARA_1M, q, target, horizon, limits=limits, **options)
