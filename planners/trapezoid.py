"""The straight move: all joints in step along a line in joint space, a trapezoid of speed, as fast as limits allow.

It looks at limits of velocity and acceleration only, and at no obstacle: the yardstick of every planner that dodges.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numba import njit

from planners.goals import goal_postures
from planners.problem import FixedHand, FixedJoints, Infeasible, MotionProblem, Trajectory, limit_ratios
from planners.typing import Array

SAMPLES = 200
"""Intervals of time into which a motion is divided."""


def plan(problem: MotionProblem) -> Trajectory:
    """Move from rest straight to rest at the nearest posture of the goal, as fast as velocity and acceleration allow.

    Args:
        problem: with a fixed target and a start at rest; its obstacles are not looked at.

    Returns:
        The trajectory; its cost is its duration, s.

    Raises:
        Infeasible: with reason ``start`` if the start moves, ``unreachable`` if the target is out of reach, ``late`` if
            the horizon is too short.
        ValueError: if the target moves.
    """
    if not isinstance(problem.target, FixedHand | FixedJoints):
        raise ValueError(f"a straight move needs a fixed target, not {type(problem.target).__name__}")
    q0, qd0, _ = problem.start
    if np.abs(qd0).max() > 1e-3:
        raise Infeasible("start", f"a straight move from rest cannot start at {qd0} rad/s", qd=qd0)
    change = goal_postures(problem, problem.target, "best")[0] - q0
    limits = problem.joint_limits
    top, ramp = trapezoid(change, np.array(limits.velocity), np.array(limits.acceleration))
    duration = 1.0 / top + ramp
    if duration > problem.horizon:
        raise Infeasible("late", f"the straight move takes {duration:.4g} s; allow that much", minimum_time=duration)
    # Samples where the acceleration jumps, and evenly between.
    t = np.unique(np.concatenate([np.linspace(0.0, duration, SAMPLES + 1), [ramp, duration - ramp]]))
    share = np.array([share_at(top, ramp, time) for time in t])
    speed = np.minimum(1.0, np.minimum(t, duration - t) / ramp) * top
    rise = np.where(t < ramp, 1.0, np.where(t > duration - ramp, -1.0, 0.0)) * top / ramp
    q, qd, qdd = q0 + share[:, None] * change, speed[:, None] * change, rise[:, None] * change
    tau = problem.loaded_arm.inverse_dynamics(q, qd, qdd)
    ratios = limit_ratios(replace(limits, jerk=(math.inf,) * len(q0)), t, q, qd, qdd, tau)
    return Trajectory(t, q, qd, qdd, tau, ratios, duration, duration, "straight")


@njit(cache=True, nogil=True)
def trapezoid(change: Array, velocity: Array, acceleration: Array) -> tuple[float, float]:
    """Top speed of the share of the move that is done, 1/s, and the time taken to reach it, s.

    The share goes from 0 to 1 in ``1 / top + ramp`` seconds.

    Args:
        change: of each joint over the move, ``(n,)``, rad.
        velocity, acceleration: limits of each joint, ``(n,)``.
    """
    top = rise = 1e9  # where nothing moves: at once
    for i in range(change.shape[0]):
        if change[i] != 0.0:
            top = min(top, velocity[i] / abs(change[i]))
            rise = min(rise, acceleration[i] / abs(change[i]))
    top = min(top, math.sqrt(rise))
    return top, top / rise


@njit(cache=True, nogil=True)
def share_at(top: float, ramp: float, t: float) -> float:
    """The share of the move that is done at time ``t``, s."""
    duration = 1.0 / top + ramp
    if t >= duration:
        return 1.0
    if t < ramp:
        return 0.5 * top / ramp * t * t
    if t > duration - ramp:
        return 1.0 - 0.5 * top / ramp * (duration - t) ** 2
    return top * (t - 0.5 * ramp)
