"""The default DPCT planner: earliest rendezvous with a moving target, then least tracking index.

It takes the dynamic programming of "Motion Planning of a Robot Manipulator for Conveyor Tracking" from a grid in the
phase plane to the tracking error and its two derivatives in continuous values, with the jerk as the control and time
as the stages. So the principle of optimality holds, the start is met on time, and no acceleration, torque or jerk is
a quotient of differences. The limits hold between the stages too: every plan is checked on a dense grid with exact
kinematics and inverse dynamics, and planned again within tighter limits where the check finds an excess.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace
from typing import Any, Literal, get_args

import numpy as np

from planners.capabilities import Takes, variant
from planners.checks import require_choice
from planners.dpct.constraints import Tracking
from planners.dpct.rendezvous import Aim, find_rendezvous, graded_stages, sample_manoeuvre, tracking_problem
from planners.goals import goal_postures
from planners.motion.line import Branch, Line, reduce_to_line
from planners.motion.line_motion import KINDS, joint_motion, limit_table, sample_ride, to_trajectory
from planners.motion.rides import Window, ride_load, ride_windows
from planners.problem import FixedHand, FixedJoints, Infeasible, MotionProblem, limit_broken
from planners.trajectory import Trajectory
from planners.typing import Array

STAGES, MOST_STAGES = 60, 1000

_PLANNER = "dpct (optimal)"

FIRST_TIGHTENING = 1.0 - 2e-4
"""Share of every limit that the first attempt uses: most plans need no second."""

DENSE_LOAD = 1.0 - 1e-5
"""Largest load a plan may show on the dense grid: a little less than 1, for what lies between two samples."""

BACK_OFF, BACK_OFFS = 2e-5, 10
"""How much tighter than the excess the limits become for the next attempt, and how many there are."""

START_TOLERANCE = 1e-3
"""Excess of a limit, as a fraction of it, that the start state may bring along."""

START_OVERSHOOT = 1e-4
"""How much further, as a fraction of the limit, a start close to a limit may go where it cannot turn in time."""

MET = np.array([1e-6, 1e-6, 1e-3])
"""Differences of position (m), velocity (m/s) and acceleration (m/s^2) at which the hand is with the target already."""

Elbow = Literal["start", "best", "+", "-"]


@variant("dpct", "optimal", {"joints": Takes(), "hand": Takes(), "moving hand": Takes(links=(2, 3))})
def plan_optimal(
    problem: MotionProblem,
    *,
    elbow: Elbow = "start",
    rendezvous_time: float | None = None,
    time_weight: float | None = None,
    free_initial_acceleration: bool = False,
    allow_reverse: bool = False,
    stages: int = STAGES,
) -> Trajectory:
    """Meet a moving target exactly and ride with it, or come to rest at a fixed one.

    The hand keeps to the target's line. To a fixed target in joint angles the joints keep to their straight path; so
    they do to a fixed hand where the hand's own straight path fails, or with other than two or three links. After the
    rendezvous it moves exactly with the target until the horizon, or until riding on would break a limit
    (``rides_until``). Small deviations of the start, such as an observation's rounding, are left to the tracking
    control: up to 1e-4 m and m/s across the line, and up to 1e-6 m and m/s along it where the hand already rides.

    Args:
        problem: the motion asked for.
        elbow: the branch of the start posture, a given one, or the better of both; on another branch than its own the
            start posture counts as the one with the hand in the same place.
        rendezvous_time: meet then, with the least tracking index, s; as early as possible when left out.
        time_weight: minimise ``time_weight * rendezvous time + J`` instead, 1/s.
        free_initial_acceleration: let the plan choose the acceleration at time 0, as the paper does, in place of the
            start's.
        allow_reverse: let the hand move against the direction of the line, to meet a part that is still upstream
            earlier; it always may where its start, or the target later on, moves that way.
        stages: intervals of constant jerk.

    Returns:
        The trajectory; its cost is J of eq 18, with ``r = 1`` where the target is at the horizon (eq 7).

    Raises:
        Infeasible: with reason ``unreachable``, ``start``, ``no_window``, ``late`` or ``limits``.
        ValueError: if an option is out of range.
    """
    require_choice("elbow", elbow, get_args(Elbow))
    if rendezvous_time is not None and not 0.0 < rendezvous_time <= problem.horizon:
        raise ValueError(f"rendezvous_time {rendezvous_time} s must be in (0, horizon = {problem.horizon}] s")
    if time_weight is not None and not time_weight >= 0.0:
        raise ValueError(f"time_weight {time_weight} must not be negative")
    if not 10 <= stages <= MOST_STAGES:
        raise ValueError(f"stages {stages} must be from 10 to {MOST_STAGES}")
    options = rendezvous_time, time_weight, free_initial_acceleration, allow_reverse, stages
    if isinstance(problem.target, FixedHand) and problem.arm.n_joints not in (2, 3):
        return _to_postures(problem, elbow, options)
    aim = Aim(rendezvous_time, time_weight)
    branches: dict[Elbow, tuple[Branch, ...]] = {"start": ("start",), "best": ("+", "-"), "+": ("+",), "-": ("-",)}
    plans, failures = [], []
    for branch in ("start",) if isinstance(problem.target, FixedJoints) and elbow == "best" else branches[elbow]:
        try:
            line = reduce_to_line(problem, branch)
            plans.append(_plan_on(line, aim, free_initial_acceleration, allow_reverse, stages))
        except Infeasible as failure:
            failures.append(failure)
    if not plans and isinstance(problem.target, FixedHand) and elbow in ("start", "best"):
        with suppress(Infeasible):  # the straight path of the hand has failed; that of the joints may not
            return _to_postures(problem, elbow, options)
    if not plans:
        raise failures[0]
    weight = math.inf if time_weight is None else time_weight
    return min(plans, key=lambda plan: _merit(plan, weight))


def _to_postures(problem: MotionProblem, elbow: Elbow, options: tuple[Any, ...]) -> Trajectory:
    """The best of the straight joint paths to the postures of a hand target."""
    names = "rendezvous_time", "time_weight", "free_initial_acceleration", "allow_reverse", "stages"
    assert isinstance(problem.target, FixedHand)
    plans, failures = [], []
    for goal in goal_postures(problem, problem.target, elbow):
        try:
            to_joints = replace(problem, target=FixedJoints(goal))
            plans.append(plan_optimal(to_joints, **dict(zip(names, options, strict=True))))
        except Infeasible as failure:
            failures.append(failure)
    if not plans:
        raise failures[0]
    weight = math.inf if options[1] is None else options[1]
    return replace(min(plans, key=lambda plan: _merit(plan, weight)), problem=problem)


def _merit(plan: Trajectory, time_weight: float) -> tuple[float, float]:
    """Comparison key of two plans; smaller is better."""
    if math.isinf(time_weight):
        return plan.rendezvous_time, plan.cost
    return time_weight * plan.rendezvous_time + plan.cost, 0.0


def _plan_on(line: Line, aim: Aim, free_acceleration: bool, allow_reverse: bool, stages: int) -> Trajectory:
    """Plan along a line and ride on."""
    start_load = _check_start(line, free_acceleration)
    windows = _windows(line, aim.rendezvous_time)
    if windows[0].opens == 0.0 and (np.abs(line.start - line.target) < MET).all():
        ride = sample_ride(line, 0.0, min(line.problem.horizon, windows[0].closes))
        return to_trajectory(line, [ride], windows[0].closes, 0.0, 0.0, _PLANNER)
    tracking = tracking_problem(line, graded_stages(stages), free_acceleration, allow_reverse)
    plan = _within_limits(line, tracking, windows, aim, start_load, 0.0)
    if plan is None and start_load.max() > 1.0 - START_TOLERANCE:
        plan = _within_limits(line, tracking, windows, aim, start_load, START_OVERSHOOT)
    if plan is None:
        raise _late(line, windows, aim.rendezvous_time)
    return plan


def _within_limits(
    line: Line, tracking: Tracking, windows: list[Window], aim: Aim, start_load: Array, overshoot: float
) -> Trajectory | None:
    """Search, check densely, and back off where the check finds an excess.

    ``start_load`` ``(4, n)`` are the loads of the start, which count as limits where they are higher; ``overshoot`` is
    how much more than that is accepted, as a fraction of the limits.
    """
    allowed = np.maximum(DENSE_LOAD, start_load + overshoot)
    tightening = np.full((4, 1), FIRST_TIGHTENING)
    guess = None
    for attempt in range(BACK_OFFS):
        limits = limit_table(line) * np.maximum(tightening, start_load + 0.5 * overshoot)
        found = find_rendezvous(line, tracking._replace(inverse_limits=1.0 / limits), windows, aim, guess)
        if found is None and attempt > 0:
            return None
        if found is None:  # retry with the full limits
            tightening = np.ones((4, 1))
            continue
        window, solution = found
        manoeuvre = sample_manoeuvre(line, tracking, solution)
        excess = (manoeuvre.peak_load(line) / allowed).max(axis=1, keepdims=True)
        if (excess <= 1.0).all():
            ride = sample_ride(line, solution.time, max(solution.time, min(line.problem.horizon, window.closes)))
            cost = solution.cost / line.unit**2
            return to_trajectory(line, [manoeuvre, ride], window.closes, solution.time, cost, _PLANNER)
        tightening = tightening * (1.0 - BACK_OFF) / np.maximum(excess, 1.0 - BACK_OFF)
        guess = solution.time
    return None


def _windows(line: Line, rendezvous_time: float | None) -> list[Window]:
    """The intervals in which the rendezvous may be."""
    windows = ride_windows(line)
    usable = [window for window in windows if window.opens < line.problem.horizon]
    if rendezvous_time is not None:
        usable = [window for window in usable if window.opens <= rendezvous_time <= window.closes]
    if not usable:
        raise _no_window(line, windows, rendezvous_time)
    return usable


def _no_window(line: Line, windows: list[Window], rendezvous_time: float | None) -> Infeasible:
    """The hand cannot ride with the target at any time within the horizon, or not at the given time."""
    horizon = line.problem.horizon
    if windows:
        asked = f"within the horizon of {horizon:.4g} s" if rendezvous_time is None else f"at {rendezvous_time:.4g} s"
        spans = ", ".join(f"{window.opens:.4g} to {window.closes:.4g} s" for window in windows)
        return Infeasible("no_window", f"the hand cannot follow the target {asked}, only from {spans}", windows=windows)
    loads = ride_load(line, np.linspace(0.0, horizon, 201))
    load = loads[loads.max(axis=(1, 2)).argmin()]
    if math.isinf(load.max()):
        return Infeasible(
            "unreachable",
            f"within {horizon:.4g} s the target never is on the part of its line that {line.arm.name} reaches: from "
            f"{line.low:.4g} to {line.high:.4g} m ahead of the hand",
            low=line.low,
            high=line.high,
        )
    what = "follows the target only at" if line.moving else "holds still at the target only at"
    return limit_broken("no_window" if line.moving else "limits", what, load, KINDS)


def _late(line: Line, windows: list[Window], rendezvous_time: float | None) -> Infeasible:
    """No motion within the limits meets the target in the windows."""
    closes = min(windows[-1].closes, line.problem.horizon)
    when = f"by {closes:.4g} s" if rendezvous_time is None else f"at {rendezvous_time:.4g} s"
    advice = "start further ahead of it, slow it down, " if line.moving else ""
    message = f"no motion within the limits found that meets the target {when}"
    advice += "raise the limits or allow more time"
    return Infeasible("late", f"{message}; {advice}", closes=closes)


def _check_start(line: Line, free_acceleration: bool) -> Array:
    """Loads at the start of what the plan cannot change, ``(4, n)``."""
    r, v, a = line.start[:, None]
    _, *values = joint_motion(line, r, v, np.zeros(1) if free_acceleration else a, np.zeros(1))
    load: Array = np.abs(np.stack(values, axis=1))[0] / limit_table(line)
    load[KINDS.index("jerk")] = 0.0  # jumps at the start as it may
    if free_acceleration:
        load[[KINDS.index("torque"), KINDS.index("acceleration")]] = 0.0
    if load.max() > 1.0 + START_TOLERANCE:
        raise limit_broken("start", "starts at", load, KINDS)
    return load
