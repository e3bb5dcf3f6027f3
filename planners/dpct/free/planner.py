"""The earliest meeting with a moving target by any motion of the joints, within every limit.

The stages and the end of :mod:`planners.dpct.optimal` stay (jerk as the control, time as the stage, error to the target
as the state), the line goes: every joint has an error and a jerk of its own. A hand that is let off the line meets the
part earlier, may start beside the line, and may follow a target on a curve.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace

import numpy as np

from planners.capabilities import Takes, variant
from planners.dpct.free.constraints import Chase, roll_out
from planners.dpct.free.ride import Reference, Ride
from planners.dpct.free.solver import guess_time, solve
from planners.dpct.optimal import plan_optimal
from planners.dpct.rendezvous import EARLY, WIDE
from planners.dpct.settling import hand_errors
from planners.motion.line_motion import KINDS, LONGEST_RIDE
from planners.problem import Infeasible, MotionProblem, limit_broken
from planners.trajectory import Trajectory, sampled_trajectory
from planners.typing import Array

STAGES, MOST_STAGES = 48, 400

TAILS, TAIL_SHARE, LONGEST_TAIL = (0.45, 0.1), 0.25, 0.5
"""Times within the tolerances before the exact meeting that are tried, s, and their share of the stages; the largest
share of the motion."""

SHORT_ENDS = (0.15, 0.5)
"""Lengths of the first stages against the others: where the jerk is free the acceleration jumps at the start."""

WITHIN = 0.99
"""Share of the tolerances that a plan uses: the rest is for what is between two points of a stage."""

BOLD, CAREFUL = 0.3, 0.1
"""Largest change of T in one step of the first and of the second attempt, as a fraction of it."""

SHORTEST = 0.01
"""Least rendezvous time looked for, s."""

FIRST_TIGHTENING, BACK_OFF, BACK_OFFS = 1.0 - 5e-4, 5e-4, 6
"""Share of every limit that the first attempt uses, how much tighter than the excess the next one is, and how many."""

START_TOLERANCE = 1e-3
"""Excess of a limit, as a fraction of it, that the start state may bring along."""

MET = np.array([1e-6, 1e-6, 1e-3])
"""Largest errors of angle, velocity and acceleration (rad, s) of a start that is with the target already."""

PARTS = 4
"""Samples a stage."""

PLANNER = "dpct (free)"

_LIMITS = (*KINDS, "angle")


@variant("dpct", "free", {"moving hand": Takes(links=(2, 3))})
def plan_free(
    problem: MotionProblem,
    *,
    position_tolerance: float = 0.0,
    velocity_tolerance: float = 0.0,
    stages: int = STAGES,
) -> Trajectory:
    """Meet a moving target as early as the joints can, off its line where that is quicker, and ride with it.

    With tolerances, the time from which both errors of the hand stay within them is the earliest, and the exact meeting
    follows, up to 0.45 s later. The hand keeps the elbow of the start, and at the meeting the start's orientation of a
    third link. After the meeting it moves exactly with the target until the horizon, or until that would break a limit.

    Args:
        problem: the motion asked for; the start may move, and be anywhere.
        position_tolerance, velocity_tolerance: of the hand, m and m/s; both positive, or both 0 for none.
        stages: intervals of constant jerk relative to the target.

    Returns:
        The trajectory; its cost is J of eq 18 in m^2 s: squared errors of position (m) and velocity (m/s) over time.

    Raises:
        Infeasible: with reason ``unreachable``, ``start``, ``no_window``, ``late`` or ``limits``.
        ValueError: if an option is out of range.
    """
    tolerances = np.array([position_tolerance, velocity_tolerance])
    if not ((tolerances > 0.0).all() or (tolerances == 0.0).all()) or not np.isfinite(tolerances).all():
        raise ValueError(
            f"position_tolerance {position_tolerance} m and velocity_tolerance {velocity_tolerance} m/s must both be "
            "positive, or both 0"
        )
    if not 10 <= stages <= MOST_STAGES:
        raise ValueError(f"stages {stages} must be from 10 to {MOST_STAGES}")
    q, qd, qdd = problem.start
    start_load = _start_load(problem)
    ride = Ride(problem, 1.0 if math.sin(q[1]) >= 0.0 else -1.0, float(q.sum()))
    for window in ride.windows():
        reference = ride.reference(window)
        error = np.abs(np.array([q, qd, qdd]) - reference.nodes[0, :3])
        if window.first == 0 and (error.max(axis=1) < MET).all():
            return _trajectory(reference, np.empty((0, 4, len(q))), np.empty(0), 0.0)
        plan = _plan_in(reference, tolerances, stages, start_load)
        if plan is not None:
            return plan
    with suppress(Infeasible):  # a motion on the line is one of these too
        plan = plan_optimal(problem, allow_reverse=True)
        return replace(plan, planner=PLANNER, cost=_tracking_index(plan))
    closes = float(ride.times[ride.windows()[-1].last])
    message = f"no motion within the limits found that meets the target by {closes:.4g} s"
    raise Infeasible("late", f"{message}; slow it down, raise the limits or allow more time", closes=closes)


def _start_load(problem: MotionProblem) -> Array:
    """|value| / limit at the start by kind, ``(5, n)``; that of jerk is 0, as it jumps as it may."""
    limits, (q, qd, qdd) = problem.joint_limits, problem.start
    values = problem.loaded_arm.inverse_dynamics(q, qd, qdd), qd, qdd, np.zeros_like(q), q - limits.angle_middle
    load: Array = np.abs(np.array(values)) / _limit_table(problem)
    if load.max() > 1.0 + START_TOLERANCE:
        raise limit_broken("start", "starts at", load, _LIMITS)
    return load


def _limit_table(problem: MotionProblem) -> Array:
    """Limits of torque, velocity, acceleration, jerk and of the angle from its middle, ``(5, n)``."""
    return np.array([problem.joint_limits.array(kind) for kind in _LIMITS])


def _plan_in(reference: Reference, tolerances: Array, stages: int, start_load: Array) -> Trajectory | None:
    """The earliest meeting in a window, checked on the continuous motion, with tighter limits where they are broken."""
    ride, problem = reference.ride, reference.ride.problem
    coupling, weight = problem.loaded_arm.chain_constants
    low, high = max(SHORTEST, ride.times[reference.window.first]), float(ride.times[reference.window.last])
    if low >= high:
        return None
    chase = Chase(
        np.array(problem.start),
        reference.step,
        reference.nodes,
        reference.jacobians(),
        coupling,
        weight,
        1.0 / _limit_table(problem),
        problem.joint_limits.angle_middle,
        _durations(stages, 0, 0.0),
        stages,
        np.maximum(WITHIN * tolerances, 1e-9),
    )
    for tail in (*TAILS, 0.0) if tolerances[0] > 0.0 else (0.0,):
        plan = _within_limits(reference, chase, tail, (low, high), start_load)
        if plan is not None:
            return plan
    return None


def _within_limits(
    reference: Reference, chase: Chase, tail: float, bounds: tuple[float, float], start_load: Array
) -> Trajectory | None:
    """The earliest meeting with a time within the tolerances before, or None."""
    low, high = bounds
    end, first = high, guess_time(chase, low, high)
    while end - low > WIDE and first - low < EARLY * (end - low):
        end, first = first, guess_time(chase, low, first)
    if end < high and (plan := _within_limits(reference, chase, tail, (low, end), start_load)) is not None:
        return plan
    for guess, largest_change in ((min(1.5 * first, 0.5 * (first + high)), BOLD), (0.5 * (low + high), CAREFUL)):
        plan = _from_guess(reference, chase, tail, (low, high), start_load, guess, largest_change)
        if plan is not None:
            return plan
    return None


def _from_guess(
    reference: Reference,
    chase: Chase,
    tail: float,
    bounds: tuple[float, float],
    start_load: Array,
    guess: float,
    largest_change: float,
) -> Trajectory | None:
    """The earliest meeting from a first guess of its time, or None."""
    stages, (low, high) = len(chase.durations), bounds
    tightening = np.full((5, 1), FIRST_TIGHTENING)
    for _ in range(BACK_OFFS):
        share = min(LONGEST_TAIL, tail / guess)
        limits = _limit_table(reference.ride.problem) * np.maximum(tightening, start_load)
        last = round(TAIL_SHARE * stages) if share > 0.0 else 0
        durations = _durations(stages, last, share)
        chase = chase._replace(inverse_limits=1.0 / limits, durations=durations, settled=stages - last)
        converged, time, jerk, _, _ = solve(chase, guess, low, high, largest_change)
        if not converged:
            return None
        plan = _sampled(reference, chase, time, jerk)
        excess = plan.measured.ratios / np.maximum(1.0, start_load.max(axis=1))
        if (excess <= 1.0).all():
            return plan
        tightening = tightening * np.where(excess > 1.0, (1.0 - BACK_OFF) / np.maximum(excess, 1.0), 1.0)[:, None]
        guess = time
    return None


def _durations(stages: int, last: int, tail: float) -> Array:
    """Durations of the stages as fractions of the whole, the ``last`` of which take the share ``tail``."""
    durations = np.ones(stages)
    durations[: len(SHORT_ENDS)] = SHORT_ENDS
    durations[-len(SHORT_ENDS) :] = SHORT_ENDS[::-1]
    if last > 0:
        durations[:-last] *= (1.0 - tail) / durations[:-last].sum()
        durations[-last:] *= tail / durations[-last:].sum()
    shares: Array = durations / durations.sum()
    return shares


def _sampled(reference: Reference, chase: Chase, time: float, jerk: Array) -> Trajectory:
    """A solution on dense samples, with the least change of its jerks that leaves no error at the end."""
    h = chase.durations
    after = 1.0 - np.cumsum(h)
    before = after + h
    effect = np.stack([(before**3 - after**3) / 6.0, (before**2 - after**2) / 2.0, h])
    control = jerk * time**3
    control = control - np.linalg.lstsq(effect, roll_out(chase, time, control)[-1].T, rcond=None)[0]
    z = roll_out(chase, time, control)
    stage = np.repeat(np.arange(len(h)), PARTS)
    s = (h[:, None] * np.arange(PARTS) / PARTS).ravel()[:, None]
    e, ed, edd = np.moveaxis(z[stage], 2, 0)
    u = control[stage]
    errors = np.stack(
        [
            e + s * (ed + s * (edd / 2.0 + s * u / 6.0)),
            (ed + s * (edd + s * u / 2.0)) / time,
            (edd + s * u) / time**2,
            u / time**3,
        ],
        axis=1,
    )
    t = time * ((np.cumsum(h) - h)[stage] + s[:, 0])
    return _trajectory(reference, errors, t, time)


def _trajectory(reference: Reference, errors: Array, t: Array, meeting: float) -> Trajectory:
    """Errors of the joints before the meeting, ``(samples, 4, n)``, and the ride after it."""
    ride, problem = reference.ride, reference.ride.problem
    closes = float(ride.times[reference.window.last])
    end = min(closes, meeting + LONGEST_RIDE)
    riding = np.linspace(meeting, end, max(2, math.ceil((end - meeting) / reference.step) + 1))
    q, qd, qdd, _ = np.moveaxis(reference.at(np.concatenate([t, riding])), 1, 0)
    for motion, error in zip((q, qd, qdd), np.moveaxis(errors, 1, 0), strict=False):
        motion[: len(t)] += error
    if len(t):
        for motion, given in zip((q, qd, qdd), problem.start, strict=True):
            motion[0] = given
    times = np.concatenate([t, riding])
    plan = sampled_trajectory(problem, times, q, qd, qdd, planner=PLANNER, rendezvous_time=meeting, rides_until=closes)
    return replace(plan, cost=_tracking_index(plan))


def _tracking_index(plan: Trajectory) -> float:
    """The integral of the squared errors of the hand's position and velocity, m^2 s."""
    return float(np.trapezoid((hand_errors(plan, plan.t) ** 2).sum(axis=1), plan.t))
