"""Where and when the hand can follow a moving target, and the joint moves to such a state.

The target's line and the times within the limits are those of :mod:`planners.motion.line` and
:mod:`planners.motion.rides`; the move to the line is free in joint space.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from planners.goals import ORIENTATIONS, Elbow, on_branch
from planners.lagrange.joint_move import JointMove
from planners.lagrange.search.multistart import reaches
from planners.motion.line import Line, reduce_to_line
from planners.motion.line_motion import joint_motion
from planners.motion.rides import Window, ride_windows
from planners.problem import Infeasible, MotionProblem, MovingHand
from planners.robot.kinematics import UnreachableTarget, wrap
from planners.typing import Array

TARGET_SAMPLES = 81
"""Number of samples of the target's path."""

HALVINGS, UNCERTAIN, SHORTEST = 5, 0.25, 0.01
"""Least number of bisections of the time of the earliest rendezvous; its error, as a fraction of it, after the last;
and a time that needs no more of them, s.
"""

ENDS = (1.0, 0.5, 0.1)
"""Times that are tried first, as shares of a whole window: at its end the target may be on the rim of the reach."""

MOST_RIDES = 4

BEYOND = 4.0
"""Latest rendezvous that is searched for, as a multiple of the horizon."""


@dataclass(frozen=True)
class Ride:
    """The line of a moving target for one elbow (and, for three links, one orientation), and the time windows in which
    the hand can follow the target within the limits.
    """

    line: Line
    windows: list[Window]

    def window_at(self, t: float) -> Window | None:
        """The window that holds time ``t``."""
        return next((window for window in self.windows if window.opens <= t <= window.closes), None)

    def state_at(self, t: float) -> Array:
        """Joint angles, velocities and accelerations at the target, ``(3, n)``."""
        r, v, a = self.line.target_at(np.array([t]))
        q, _, qd, qdd, _ = joint_motion(self.line, r, v, a, np.zeros(1))
        return np.concatenate([q, qd, qdd])

    def earliest(self, move: JointMove, latest: float) -> float:
        """The earliest rendezvous found, s, by bisection of the first window with one by ``latest``; inf if there is
        none.
        """
        for window in self.windows:
            low, last = window.opens, min(window.closes, latest)
            shares = ENDS if last == window.closes else ENDS[:1]
            ends = [low + share * (last - low) for share in shares] if last > low else []
            high = next((end for end in ends if reaches(move.to(self.state_at(end), end))), None)
            if high is None:
                continue
            halvings = 0
            while halvings < HALVINGS or (high - low > UNCERTAIN * high and high > SHORTEST):
                later = halvings >= HALVINGS  # a range that is long against the move
                middle = math.sqrt(max(low, 0.1 * SHORTEST) * high) if later else 0.5 * (low + high)
                met = reaches(move.to(self.state_at(middle), middle))
                low, high = (low, middle) if met else (middle, high)
                halvings += 1
            return high
        return math.inf


def find_rides(problem: MotionProblem, target: MovingHand, elbow: Elbow) -> list[Ride]:
    """Rides with the target: if there are any, those that last until the horizon; else those that last longest.

    Raises:
        Infeasible: with reason ``unreachable`` if the hand never reaches the target, ``no_window`` if following it
            always breaks a limit.
    """
    still = np.zeros(problem.arm.n_joints)
    rides, reason = [], Infeasible("no_window", "following the target breaks a limit at all times; slow it down")
    for posture in _postures_on_line(problem, target, elbow):
        try:
            line = reduce_to_line(replace(problem, q=posture, qd=still, qdd=still))
        except Infeasible as refusal:
            reason = Infeasible("unreachable", f"the hand cannot follow the target: {refusal.message}")
            continue
        windows = ride_windows(line)
        if windows:
            rides.append(Ride(line, windows))
    if not rides:
        raise reason
    lasting = [ride for ride in rides if ride.window_at(problem.horizon) is not None]
    return (lasting or sorted(rides, key=lambda ride: -ride.windows[-1].closes))[:MOST_RIDES]


def earliest(rides: Sequence[Ride], move: JointMove, preferred: float, horizon: float) -> float:
    """The earliest rendezvous found with one of the rides, s; inf if there is none within four horizons.

    Times up to ``preferred``, s, are searched first, then those up to ``horizon``, s.
    """
    for latest in (preferred, horizon, math.sqrt(BEYOND) * horizon, BEYOND * horizon):
        time = min(ride.earliest(move, latest) for ride in rides)
        if time < math.inf:
            return time
    return math.inf


def _postures_on_line(problem: MotionProblem, target: MovingHand, elbow: Elbow) -> list[Array]:
    """For every branch and orientation of a third link, the posture on the target's path with its elbow closest to 90
    degrees. The orientation closest to that of the start comes first.
    """
    places = target.at(np.linspace(0.0, problem.horizon, TARGET_SAMPLES))[0]
    orientations: list[float | None] = [None]
    if problem.arm.n_joints == 3:
        order = np.array(sorted(range(ORIENTATIONS), key=lambda i: min(i, ORIENTATIONS - i)))
        orientations = [float(problem.q.sum() + turn) for turn in 2.0 * np.pi / ORIENTATIONS * order]
    postures: list[Array] = []
    refusal = f"the target is met on no posture with its elbow on branch {elbow!r}; use 'best'"
    for orientation in orientations:
        try:
            branches = _reachable_branches(problem, places, orientation)
        except UnreachableTarget as error:
            refusal = str(error)
            continue
        bent = branches[np.abs(np.sin(branches[:, 0, 1])).argmax()]
        postures += [branch for branch in bent if on_branch(branch, problem.q, elbow)]
    if not postures:
        raise Infeasible("unreachable", refusal)
    return [problem.q + wrap(posture - problem.q) for posture in postures]


def _reachable_branches(problem: MotionProblem, places: Array, orientation: float | None) -> Array:
    """Both branches wherever the target is within reach, ``(places, 2, n)``."""
    try:
        return problem.arm.inverse_kinematics(places, orientation)
    except UnreachableTarget as error:
        reachable = np.delete(places, error.rows, axis=0)
        if len(reachable) == 0:
            raise
        return problem.arm.inverse_kinematics(reachable, orientation)
