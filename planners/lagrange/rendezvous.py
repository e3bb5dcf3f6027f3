"""Where and when the hand may join a moving target: rides along its line, and the moves that lead onto them.

The line, what riding along it demands of the joints, and when it may be ridden are those of DPCT
(:mod:`planners.motion.line`, :mod:`planners.motion.rides`); the way there is free in joint space.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from planners.goals import ORIENTATIONS, Elbow, on_branch
from planners.lagrange.joint_move import JointMove
from planners.lagrange.multistart import reaches
from planners.lagrange.transcription import Ends
from planners.motion.line import Line, reduce_to_line
from planners.motion.line_motion import joint_motion
from planners.motion.rides import Window, ride_windows
from planners.problem import Infeasible, MotionProblem, MovingHand
from planners.robot.kinematics import UnreachableTarget, wrap
from planners.typing import Array

LOOKED_AT = 81
"""Instants at which the target's place is looked at."""

HALVINGS = 5
"""How often the time in which the earliest rendezvous is looked for is halved."""

MOST_RIDES = 4

BEYOND = 4.0
"""Multiples of the horizon within which a rendezvous that comes too late is looked for."""


@dataclass(frozen=True)
class Ride:
    """One way to go with a moving target: its line with one elbow (and, for three links, one orientation), and the
    windows in which it may be ridden within the limits.
    """

    line: Line
    windows: list[Window]

    def window_at(self, t: float) -> Window | None:
        """The window that holds time ``t``."""
        return next((window for window in self.windows if window.opens <= t <= window.closes), None)

    def state_at(self, t: float) -> Array:
        """Joint angles, velocities and accelerations of the ride, ``(3, n)``."""
        r, v, a = self.line.target_at(np.array([t]))
        q, _, qd, qdd, _ = joint_motion(self.line, r, v, a, np.zeros(1))
        return np.concatenate([q, qd, qdd])


def find_rides(problem: MotionProblem, target: MovingHand, elbow: Elbow) -> list[Ride]:
    """Ways to go with the target: if there are any, those that last until the horizon; else those that last longest.

    Raises:
        Infeasible: with reason ``unreachable`` if the hand never reaches the target, ``no_window`` if riding with it
            would always break a limit.
    """
    still = np.zeros(problem.arm.n_joints)
    rides, reason = [], Infeasible("no_window", "riding with the target breaks a limit at all times; slow it down")
    for posture in _postures_on_line(problem, target, elbow):
        try:
            line = reduce_to_line(replace(problem, q=posture, qd=still, qdd=still))
        except Infeasible as refusal:
            reason = refusal
            continue
        windows = ride_windows(line)
        if windows:
            rides.append(Ride(line, windows))
    if not rides:
        raise reason
    lasting = [ride for ride in rides if ride.window_at(problem.horizon) is not None]
    return (lasting or sorted(rides, key=lambda ride: -ride.windows[-1].closes))[:MOST_RIDES]


def moves_to(rides: Sequence[Ride], move: JointMove, t: float) -> dict[int, JointMove]:
    """The moves that join the rides at time ``t``, by number of the ride; none for one closed then."""
    start = move.ends.start
    return {
        i: replace(move, ends=Ends(start, ride.state_at(t)), duration=t)
        for i, ride in enumerate(rides)
        if ride.window_at(t) is not None
    }


def earliest(rides: Sequence[Ride], move: JointMove, preferred: float, horizon: float) -> float:
    """The earliest rendezvous found with one of the rides, s; inf if there is none within four horizons.

    ``preferred`` is the latest time that leaves leisure, ``horizon`` the latest that is of use, s.
    """
    for latest in (preferred, horizon, math.sqrt(BEYOND) * horizon, BEYOND * horizon):
        times = [_earliest(ride, move, latest) for ride in rides]
        if min(times) < math.inf:
            return min(times)
    return math.inf


def _earliest(ride: Ride, move: JointMove, latest: float) -> float:
    """The earliest rendezvous found with one ride, by halving from the end of its first window that will do."""
    for window in ride.windows:
        high = min(window.closes, latest)
        low = window.opens
        if high <= low or not _joins(ride, move, high):
            continue
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if _joins(ride, move, middle) else (middle, high)
        return high
    return math.inf


def _joins(ride: Ride, move: JointMove, t: float) -> bool:
    return reaches(replace(move, ends=Ends(move.ends.start, ride.state_at(t)), duration=t))


def _postures_on_line(problem: MotionProblem, target: MovingHand, elbow: Elbow) -> list[Array]:
    """For every branch, and orientations of a third link, the posture on the target's way that is bent most squarely.

    The orientation of the start, which the hand would keep, comes first.
    """
    places = target.at(np.linspace(0.0, problem.horizon, LOOKED_AT))[0]
    orientations: list[float | None] = [None]
    if problem.arm.n_joints == 3:
        turns = (
            2.0 * np.pi / ORIENTATIONS * np.array(sorted(range(ORIENTATIONS), key=lambda i: min(i, ORIENTATIONS - i)))
        )
        orientations = [float(problem.q.sum() + turn) for turn in turns]
    postures: list[Array] = []
    for orientation in orientations:
        try:
            branches = _reachable_branches(problem, places, orientation)
        except UnreachableTarget as error:
            unreachable = error
            continue
        squarest = branches[np.abs(np.sin(branches[:, 0, 1])).argmax()]
        postures += [branch for branch in squarest if on_branch(branch, problem.q, elbow)]
    if not postures:
        raise Infeasible("unreachable", str(unreachable))
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
