"""The earliest time from which a hand can be with a moving target to within tolerances, and stay so."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from planners.checks import checked_count, require_finite
from planners.dpct.constraints import Tracking
from planners.dpct.interior_point import Solution, solve
from planners.dpct.rendezvous import Aim, find_rendezvous, graded_stages, tracking_problem
from planners.motion.line import reduce_to_line
from planners.motion.rides import Window, ride_windows
from planners.problem import MotionProblem, MovingHand
from planners.trajectory import Trajectory
from planners.typing import Array

LOOK_AHEAD = 2.0
"""How much later than the horizon, or than the earliest rendezvous, the exact rendezvous may be, as a factor."""

SETTLED_SHARES = (0.05, 0.1, 0.2, 0.3, 0.45)
"""Parts of the stages, up to the exact rendezvous, on which the errors are already within tolerance."""


def settling_bound(
    problem: MotionProblem,
    position_tolerance: float,
    velocity_tolerance: float,
    limit_tolerance: float = 0.0,
    stages: int = 100,
    *,
    free_initial_acceleration: bool = False,
) -> float:
    """Earliest time from which position and velocity errors can stay within tolerances, s: the best known optimum.

    The hand keeps to the target's line and may move backwards. From the settling time on it is within both tolerances,
    and some time later exactly with the target. An arm that leaves the line may use the tolerances across it too, so
    this is a reference for a score and no proof. It is inf if no motion settles within the horizon.

    Args:
        problem: with a moving target.
        position_tolerance: largest distance of hand and target, m.
        velocity_tolerance: largest difference of their velocities, m/s.
        limit_tolerance: by how much every limit but the joint angles' may be exceeded, as a fraction of it.
        stages: intervals of constant jerk.
        free_initial_acceleration: let the hand choose its acceleration at time 0, in place of the start's.

    Raises:
        ValueError: if a tolerance is out of range, or the problem has no moving target.
        Infeasible: if the hand is not on the target's line.
    """
    for name, value in (("position_tolerance", position_tolerance), ("velocity_tolerance", velocity_tolerance)):
        require_finite(name, value, sign="positive")
    require_finite("limit_tolerance", limit_tolerance, sign="not negative")
    checked_count("stages", stages)
    if not isinstance(problem.target, MovingHand):
        raise ValueError(f"only a moving target is settled on; got {type(problem.target).__name__}")
    limits = problem.joint_limits.scaled(1.0 + limit_tolerance)
    # the exact rendezvous may come after the horizon
    line = reduce_to_line(replace(problem, limits=limits, horizon=LOOK_AHEAD * problem.horizon))
    windows = ride_windows(line)
    tracking = tracking_problem(line, graded_stages(stages), free_initial_acceleration, allow_reverse=True)
    tolerances = np.array([position_tolerance, velocity_tolerance])
    if (np.abs(line.start - line.target)[:2] <= tolerances).all():
        settled = tracking._replace(error_bounds=np.tile(tolerances, (stages, 1)))
        if find_rendezvous(line, settled, windows, Aim()) is not None:
            return 0.0
    found = find_rendezvous(line, tracking, windows, Aim())
    if found is None:
        return math.inf
    window, exact = found
    times = [_settling_time(tracking, tolerances, share, window, exact.time) for share in SETTLED_SHARES]
    earliest = min(exact.time, *times)
    return earliest if earliest <= problem.horizon else math.inf


def hand_errors(plan: Trajectory, t: Array) -> Array:
    """Distance (m) and relative velocity (m/s) of hand and moving target at times ``t`` of a plan, ``(times, 2)``."""
    arm, target = plan.problem.arm, plan.problem.target
    assert isinstance(target, MovingHand)
    (q, qd, _), (place, velocity) = plan.at(t), target.at(t)
    moving = np.einsum("lij,lj->li", arm.jacobian(q), qd)
    differences = np.stack([arm.forward_kinematics(q) - place, moving - velocity], axis=1)
    errors: Array = np.linalg.norm(differences, axis=2)
    return errors


def _settling_time(tracking: Tracking, tolerances: Array, share: float, window: Window, rendezvous: float) -> float:
    """Earliest settling time if the errors are within tolerance for the last ``share`` of the stages."""
    stages = len(tracking.durations)
    first = stages - round(share * stages)
    error_bounds = np.full((stages, 2), math.inf)
    error_bounds[first:] = tolerances
    latest = min(window.closes, LOOK_AHEAD * rendezvous)
    earliest = max(window.opens, 0.1 * rendezvous)
    if latest <= earliest:
        return math.inf
    tracking = tracking._replace(error_bounds=error_bounds)
    solution = Solution(*solve(tracking, rendezvous, earliest, latest, 1.0 / rendezvous, 0.0, 1.0))
    return solution.time * float(tracking.durations[:first].sum()) if solution.converged else math.inf
