"""The quintic move from rest to rest, ``q(t) = q0 + (qf - q0) (10 s^3 - 15 s^4 + 6 s^5)`` with ``s = t / T``.

The baseline of planners that minimise torque. From a moving start it is the quintic that matches that start.
"""

from __future__ import annotations

import numpy as np

from planners.capabilities import Takes, variant
from planners.compiled.calls import private
from planners.motion.time_laws import quintic_motion, stop_motion
from planners.problem import FixedJoints, MotionProblem
from planners.robot.dynamics import inverse_dynamics_single
from planners.trajectory import Trajectory, sampled_trajectory
from planners.typing import Array

SAMPLES = 200
"""Intervals of a motion over which its torque is integrated and its peaks are found."""


@variant("quintic", "", {"joints": Takes(arrives="on time")})
def plan(problem: MotionProblem) -> Trajectory:
    """Move every joint by its quintic, from the start to rest, over the whole horizon.

    The acceleration at time 0 is the start's where jerk is limited, and 0 where torques may jump. The cost is PI1, the
    integral of the summed absolute torques, N m s.

    Raises:
        Infeasible: with reason ``limits`` if the motion breaks a limit, ``collision`` if it touches an obstacle.
        ValueError: if the target is not given in joint angles.
    """
    assert isinstance(problem.target, FixedJoints)  # as declared
    q0, qd0, qdd0 = problem.start
    change = problem.target.q - problem.q
    s = np.linspace(0.0, 1.0, SAMPLES + 1)[:, None]
    q, qd, qdd = quintic_motion(q0, change, problem.horizon, s)
    smooth = np.where(np.isfinite(problem.joint_limits.array("jerk")), qdd0, 0.0)
    if qd0.any() or smooth.any():
        q, qd, qdd = map(np.add, (q, qd, qdd), stop_motion(qd0, smooth, problem.horizon, s))
    t = problem.horizon * s[:, 0]
    effort = np.abs(problem.loaded_arm.inverse_dynamics(q, qd, qdd)).sum(axis=1)
    cost, end = float(np.trapezoid(effort, t)), problem.horizon
    return sampled_trajectory(problem, t, q, qd, qdd, cost=cost, rendezvous_time=end, planner="quintic")


@private
def quintic_effort(coupling: Array, weight: Array, q0: Array, qf: Array, duration: float, peak: Array) -> float:
    """PI1 (N m s) of the quintic from ``q0`` to ``qf``, ``(n,)``, in ``duration`` s; fills ``peak`` torques, N m."""
    n = q0.shape[0]
    q, qd, qdd, tau = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    effort = 0.0
    peak[:] = 0.0
    for sample in range(SAMPLES + 1):
        s = sample / SAMPLES
        for i in range(n):
            q[i], qd[i], qdd[i] = quintic_motion(q0[i], qf[i] - q0[i], duration, s)
        inverse_dynamics_single(coupling, weight, q, qd, qdd, tau)
        for i in range(n):
            peak[i] = max(peak[i], abs(tau[i]))
            effort += abs(tau[i]) * (0.5 if sample in (0, SAMPLES) else 1.0)
    return effort * duration / SAMPLES
