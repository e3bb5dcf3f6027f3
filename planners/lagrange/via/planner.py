"""The dodging Lagrange planner: past moving discs to a fixed target, by via-nodes.

For replanning every 0.1 or 0.2 s: a plan takes about a millisecond, begins in the present state, and ends at rest, so
that the arm can always follow the last one to its end. With ``contact="delay"`` it may end in a waiting posture, for
planning again before it gets there. The motion is the Lagrange interpolant of "Trajectory Planning for Torque
Minimization of Robot Manipulators Using the Lagrange Interpolation Method" (eq 8, 9) on six Chebyshev-Lobatto nodes
with the velocities of both ends met. As in the paper, angles at the inner nodes are found by direct search; here the
cost counts time and closeness to the discs besides torque, and the duration is free.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from itertools import product
from typing import Literal, get_args

import numpy as np
from numpy.polynomial.polynomial import polyder, polyval

from planners.capabilities import SMOOTHLESS, Takes, variant
from planners.checks import LARGEST, require_choice, rounded_up
from planners.goals import Elbow, goal_postures
from planners.lagrange.via.candidates import (
    DURATIONS,
    MOST_WORK,
    STRETCH,
    Found,
    Options,
    Situation,
    Stops,
    search,
)
from planners.lagrange.via.curve import DEGREE, interpolate
from planners.lagrange.via.stops import can_stop, list_ends
from planners.problem import Infeasible, MotionProblem, MovingHand
from planners.promises import require_solved, require_within_limits
from planners.robot.limits import LIMIT_KINDS
from planners.trajectory import Trajectory, sampled_trajectory
from planners.typing import Array

DISPLACEMENTS = (0.2, 0.5, 0.9)
"""Displacements of the via-nodes, rad."""

PROFILES = ((1.0, 1.0), (1.0, 0.3), (0.3, 1.0))
"""Shares of these at the first and at the second via-node."""

RETREATS = (0.15, 0.4, 0.8)
"""Distances of waiting postures from the one in which the arm can stop, rad."""

ATTEMPTS, BACK_OFF = 4, 0.999
"""Searches with ever tighter torque limits where a motion exceeds them, and an extra factor of each."""

MOST_HORIZONS = 4.0
"""Longest horizon that is tried where the given one is too short, as a multiple of the least time of the joints."""

LONGER = (1.0001, 1.1, 1.25, 1.5, 2.0)
"""Horizons tried for the advice of a refusal, as multiples of the duration of a motion found with a longer one."""

SAMPLE_STEP, MOST_SAMPLES = 0.01, 4000
"""Time between samples of the trajectory, s, and their largest number: slow motions have longer steps."""

Contact = Literal["refuse", "delay"]


_TAKES = Takes(obstacles="avoided", keeps=SMOOTHLESS, needs=("velocity", "acceleration"))


@variant(
    "lagrange",
    "via",
    {
        "joints": _TAKES,
        "hand": _TAKES,
    },
)
def plan_via(
    problem: MotionProblem,
    *,
    elbow: Elbow = "best",
    contact: Contact = "refuse",
    margin: float = 0.03,
    prediction: float = 1.6,
    keep_out: float = 0.0,
    hold: float = 0.4,
) -> Trajectory:
    """Move to rest at a fixed target as soon as the limits and the obstacles allow.

    The search ends after a share of work (`MOST_WORK`), which five and six links may use up: then some candidates are
    not tried. Obstacles keep their velocity. With ``contact="delay"``, for planning again on the way, they are
    predicted for a while only; if no candidate reaches the target at acceptable cost, the plan ends in a waiting
    posture at or near the stopping point, and if all candidates collide, it is the one of the latest contact.

    Args:
        problem: with a fixed target, and limits of velocity and acceleration; at rest or moving. The accelerations of
            the start are not continued.
        elbow: branch on which a target of the hand is met: the better one, the start's or a given one.
        contact: ``"refuse"`` returns only motions that reach the target clear of every obstacle all the way,
            ``"delay"`` the best there is.
        margin: clearance to keep from obstacles where there is room, m, more than 0; it grows with the time ahead.
        prediction: prediction horizon of the obstacles, s; at least the whole motion unless contact is ``"delay"``.
        keep_out: least distance of the obstacles' centres from the base, m; predicted closer, they slide around it.
        hold: time for which the target is to be held, s; later contacts are ignored, and without ``"delay"`` a contact
            while it is held does not stop a motion.

    Returns:
        The trajectory. Its cost, in seconds, is that of the search: 1000 or more if contact with an obstacle is
        predicted. Its ``rendezvous_time`` is infinite if it ends in a waiting posture.

    Raises:
        Infeasible: with reason ``unreachable``; ``late`` if the horizon is too short; ``start`` if the start leaves no
            motion within the limits; ``collision`` if every motion found touches an obstacle.
        ValueError: if the target moves, a limit is missing, or an option is out of range.
    """
    require_choice("contact", contact, get_args(Contact))
    delay = contact == "delay"
    options = Options(margin, prediction, keep_out, hold, DURATIONS)
    _require_sensible(options)
    situation = _situation(problem)
    assert not isinstance(problem.target, MovingHand)  # refused by what the variant takes
    goals = np.array(goal_postures(problem, problem.target, elbow))
    try:
        return _within_torques(problem, situation, options, goals, delay=delay)
    except _TooLate as failure:
        enough = None if delay else _enough(problem, situation, options, goals, failure.soonest)
        raise _late(problem, failure.soonest, enough) from None


class _TooLate(Exception):
    """No motion was found within the horizon; every one takes more than ``soonest`` s."""

    def __init__(self, soonest: float) -> None:
        super().__init__(soonest)
        self.soonest = soonest


def _within_torques(
    problem: MotionProblem, situation: Situation, options: Options, goals: Array, *, delay: bool
) -> Trajectory:
    """The best motion found that keeps the limits of torque between its samples too; raises as `_search`."""
    for _ in range(ATTEMPTS):
        trajectory = _search(problem, situation, options, goals, delay=delay)
        excess = trajectory.measured.ratios[LIMIT_KINDS.index("torque")]
        if excess <= 1.0:
            break
        # between the instants at which the search checks them, torques are a little higher
        situation = situation._replace(torque=situation.torque * BACK_OFF / excess)
    return trajectory


def _enough(
    problem: MotionProblem, situation: Situation, options: Options, goals: Array, soonest: float
) -> float | None:
    """A horizon with which a motion is found, s; None if none is up to `MOST_HORIZONS` times the least time, or where
    a search may have ended after its share of work: then one within another horizon need not find that motion.
    """

    def found(horizon: float) -> Trajectory | None:
        longer = replace(problem, horizon=horizon)
        try:
            trajectory = _within_torques(longer, situation._replace(horizon=horizon), options, goals, delay=False)
            require_within_limits("", trajectory)
            require_solved("", longer, trajectory, _TAKES.precision, "")
        except (_TooLate, Infeasible):
            return None
        return trajectory

    longest = MOST_HORIZONS * max(soonest, problem.horizon)
    trajectory = found(longest) if longest <= LARGEST else None
    if trajectory is None:
        return None
    horizons = (factor * max(trajectory.duration, problem.horizon) for factor in LONGER)
    enough = next((horizon for horizon in horizons if horizon < longest and found(horizon)), longest)
    return enough if MOST_WORK - situation.left[0] < 0.5 * MOST_WORK / len(goals) else None


def _search(problem: MotionProblem, situation: Situation, options: Options, goals: Array, *, delay: bool) -> Trajectory:
    """The best motion to a goal posture ``(goals, n)``, or with ``delay`` to a waiting one; raises as `plan_via`."""
    patterns, offsets = _patterns(problem.arm.n_joints), _offsets(problem.arm.n_joints)
    ends = Stops(*list_ends(situation, options.hold, goals, offsets if delay else offsets[:0], len(patterns)))
    soonest = float(ends.soonest[: len(goals)].min())
    if soonest > problem.horizon:
        raise _TooLate(soonest)
    if not delay:
        options = _to_the_end(options, soonest, problem.horizon, bool(problem.obstacles))
    via = np.zeros((2, problem.arm.n_joints))
    found = Found(*search(situation, options, ends, patterns, via))
    if found.end < 0:
        if delay or not can_stop(situation, options, goals, offsets, patterns):
            raise Infeasible("start", "no motion from this start to rest keeps the limits within the horizon")
        raise _TooLate(soonest)
    if found.end >= len(goals) and not problem.obstacles:  # no reason to wait
        raise _TooLate(soonest)
    c = np.empty((problem.arm.n_joints, DEGREE + 1))
    interpolate(situation.q, situation.qd, ends.q[found.end], via, found.duration, c)
    return _trajectory(problem, c, found.duration, found.cost, waits=found.end >= len(goals))


def _to_the_end(options: Options, soonest: float, horizon: float, obstacles: bool) -> Options:
    """Options with obstacles predicted over the whole motion, and with slower motions up to the horizon among them."""
    durations = DURATIONS
    if obstacles:
        durations = max(DURATIONS, math.ceil(math.log(max(1.0, horizon / soonest)) / math.log(STRETCH)))
    return options._replace(prediction=max(options.prediction, horizon + options.hold), durations=durations)


def _require_sensible(options: Options) -> None:
    for name, value in options._asdict().items():
        if not (math.isfinite(value) and value >= 0.0) or (name == "margin" and value == 0.0):
            least = "positive" if name == "margin" else "not negative"
            raise ValueError(f"{name} {value} must be finite and {least}")


def _late(problem: MotionProblem, soonest: float, enough: float | None) -> Infeasible:
    message = f"no motion found within the limits takes {problem.horizon:.4g} s or less"
    if soonest > problem.horizon:
        message = f"the joints take {soonest:.4g} s at least, and the horizon is {problem.horizon:.4g} s"
    if enough is None:
        return Infeasible("late", f"{message}; allow more time, or raise the limits", at_least=soonest)
    return Infeasible(
        "late", f"{message}; {rounded_up(enough):.4g} s are enough", minimum_time=enough, at_least=soonest
    )


def _situation(problem: MotionProblem) -> Situation:
    arm, limits = problem.loaded_arm, problem.joint_limits
    discs = [(*obstacle.position, *obstacle.velocity, obstacle.radius) for obstacle in problem.obstacles]
    q, qd, _ = problem.start
    # copies, since arrays that cannot be written to are another type, for which all would be compiled again
    torque, velocity, acceleration, jerk, angle = (limits.array(kind).copy() for kind in LIMIT_KINDS)
    body = arm.length_array, arm.base_array, arm.link_radius, *arm.chain_constants
    disc_rows = np.array(discs).reshape(-1, 5)
    return Situation(
        *body, torque, velocity, acceleration, jerk, limits.angle_middle.copy(), angle,
        q.copy(), qd.copy(), disc_rows, problem.horizon, np.array([MOST_WORK]),
    )  # fmt: skip


@lru_cache
def _patterns(n_joints: int) -> Array:
    """Displacements of the via-nodes, ``(patterns, 2, n)``, rad; the first is zero."""
    sides = _sides(n_joints)
    displaced = [size * np.outer(profile, side) for size in DISPLACEMENTS for profile in PROFILES for side in sides]
    return np.array([np.zeros((2, n_joints)), *displaced])


@lru_cache
def _offsets(n_joints: int) -> Array:
    """Offsets of the waiting postures from the one to stop in, ``(offsets, n)``, rad; the first is zero."""
    aside = [size * side for size in RETREATS for side in _sides(n_joints)]
    return np.array([np.zeros(n_joints), *aside])


def _sides(n_joints: int) -> list[Array]:
    """All sign patterns in {-1, 0, 1} of the joints except all zeros, ``(n,)`` each."""
    return [np.array(signs) for signs in product((-1.0, 0.0, 1.0), repeat=n_joints) if any(signs)]


def _trajectory(problem: MotionProblem, c: Array, duration: float, cost: float, *, waits: bool) -> Trajectory:
    """Sample an interpolant."""
    t = np.linspace(0.0, duration, min(max(2, math.ceil(duration / SAMPLE_STEP)), MOST_SAMPLES) + 1)
    q, qd, qdd = (
        np.asarray(polyval(t / duration, polyder(c.T, order)).T / duration**order, dtype=np.float64)
        for order in range(3)
    )
    rendezvous = math.inf if waits else duration
    return sampled_trajectory(problem, t, q, qd, qdd, cost=cost, rendezvous_time=rendezvous, planner="lagrange (via)")
