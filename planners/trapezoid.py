"""The straight move: all joints along a line in joint space with a trapezoid of speed, as fast as limits allow.

Only velocity and acceleration limits are kept; obstacles are ignored. The baseline of planners that avoid obstacles.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from planners.capabilities import Takes, variant
from planners.goals import goal_postures
from planners.motion.time_laws import trapezoid, trapezoid_share
from planners.problem import FixedHand, FixedJoints, Infeasible, MotionProblem
from planners.trajectory import Trajectory, sampled_trajectory

SAMPLES = 200
"""Intervals of time into which a motion is divided."""


@variant(
    "trapezoid",
    "",
    {
        "joints": Takes(keeps=("velocity", "acceleration"), needs=("velocity", "acceleration")),
        "hand": Takes(links=(2, 3), keeps=("velocity", "acceleration"), needs=("velocity", "acceleration")),
    },
)
def plan(problem: MotionProblem) -> Trajectory:
    """The fastest straight move within the velocity and acceleration limits, from rest to the nearest goal posture.

    Its cost is its duration, s.

    Raises:
        Infeasible: with reason ``start`` if the start moves, ``unreachable`` if the target is out of reach, ``late`` if
            the horizon is too short.
        ValueError: if the target moves, or a joint that moves has no acceleration limit.
    """
    if not isinstance(problem.target, FixedHand | FixedJoints):
        raise ValueError(f"a straight move needs a fixed target, not {type(problem.target).__name__}")
    q0, qd0, _ = problem.start
    if np.abs(qd0).max() > 1e-3:
        raise Infeasible("start", f"a straight move from rest cannot start at {qd0} rad/s", qd=qd0)
    change = goal_postures(problem, problem.target, "best")[0] - q0
    limits = problem.joint_limits
    free = np.flatnonzero((change != 0.0) & np.isinf(limits.array("acceleration")))
    if len(free):
        raise ValueError(
            f"a straight move needs acceleration limits, but joint {free[0] + 1} of {problem.arm.name} has none; give "
            "JointLimits(acceleration=...) to the arm or the problem"
        )
    top, ramp = trapezoid(change, np.array(limits.velocity), np.array(limits.acceleration))
    duration = 1.0 / top + ramp
    if duration > problem.horizon:
        raise Infeasible("late", f"the straight move takes {duration:.4g} s; allow that much", minimum_time=duration)
    # uniform samples, and those where the acceleration jumps
    t = np.unique(np.concatenate([np.linspace(0.0, duration, SAMPLES + 1), [ramp, duration - ramp]]))
    share = np.array([trapezoid_share(top, ramp, time) for time in t])
    speed = np.minimum(1.0, np.minimum(t, duration - t) / ramp) * top
    rise = np.where(t < ramp, 1.0, np.where(t > duration - ramp, -1.0, 0.0)) * top / ramp
    q, qd, qdd = q0 + share[:, None] * change, speed[:, None] * change, rise[:, None] * change
    any_jerk = replace(problem, limits=replace(limits, jerk=()))
    return sampled_trajectory(any_jerk, t, q, qd, qdd, planner="straight", cost=duration, rendezvous_time=duration)
