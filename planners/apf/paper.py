"""The potential-field paper as published: the hand moves down the gradient of the potential, and the arm follows.

T. H. Kim, M. S. Park, S. Y. Song, S. K. Hong, "Collision-Free Trajectory Planning for SCARA robot": the potential
(:mod:`planners.apf.khatib`) at a distance that depends on the obstacle's motion (:mod:`planners.apf.distance_table`)
gives the velocity of the hand and by the inverse Jacobian that of the joints (:mod:`planners.apf.hand_field`), every
0.1 ms. Equations 13 to 15 are the inverse kinematics: see :func:`posture`.

As in the paper, the limits of the arm are not kept (``limit_ratio`` of the motion tells by how much), the motion starts
at the velocity of the field, and only the hand avoids the discs; a motion in which a link touches one is refused.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from planners.apf.distance_table import DistanceTable
from planners.apf.hand_field import (
    ATTRACTION,
    INFLUENCE,
    REPULSION,
    Distance,
    HandField,
    hand_velocity_single,
    joint_rates_single,
    make_field,
)
from planners.apf.khatib import Gains
from planners.capabilities import Takes, variant
from planners.problem import FixedHand, FixedJoints, Infeasible, MotionProblem
from planners.robot.clearance import clearance_single
from planners.robot.kinematics import hand_state_single
from planners.trajectory import Trajectory, sampled_trajectory
from planners.typing import Array

PERIOD = 1e-4
"""The paper's sampling period, s."""

Outcome = Literal["reached", "collision", "local_minimum", "late"]

_MEASURING_TIME = 0.01  # s
_MOST_SAMPLES = 500_000
_STALL_TIME, _STALL_SHARE = 0.5, 0.1  # s; of the distance that the bowl alone moves the hand in that time


@dataclass(frozen=True)
class FieldMotion:
    """The motion of the arm under the field.

    Attributes:
        t: sample times, ``(samples,)``, s.
        q, qd: joint angles and velocities, ``(samples, 2)``.
        clearance, hand_clearance: of the whole arm and of the hand alone, ``(samples,)``, m; inf without discs.
        outcome: ``reached`` the goal, ``collision`` of the arm, or at the horizon in a ``local_minimum`` or still
            moving (``late``).
    """

    t: Array
    q: Array
    qd: Array
    clearance: Array
    hand_clearance: Array
    outcome: Outcome


_TWO_LINKS = Takes(links=(2,), obstacles="avoided")


@variant("apf", "paper", {"joints": _TWO_LINKS, "hand": _TWO_LINKS}, promises=False)
def plan_paper(
    problem: MotionProblem,
    *,
    square: bool = True,
    distance: Distance | DistanceTable = "table",
    attraction: float = ATTRACTION,
    repulsion: float = REPULSION,
    influence: float = INFLUENCE,
    norm: float = 2.0,
    period: float | None = None,
    tolerance: float = 1e-3,
) -> Trajectory:
    """Plan as the paper does, with discs at constant velocity.

    Args:
        problem: a two-link arm and a target at rest. Its limits are not kept.
        square, distance, attraction, repulsion, influence, norm: as for :func:`planners.apf.hand_field.make_field`.
        period: of the sampling, s; when left out `PERIOD`, or half of a horizon shorter than two. A motion has at
            most 500,000 samples: a longer horizon is not followed to its end.
        tolerance: distance from the goal that counts as reached, m; the hand still moves at xi times that.

    Returns:
        The motion until the goal is reached. ``limit_ratios`` may be above 1: the paper has no limits. ``cost`` is the
        duration, s.

    Raises:
        Infeasible: reason ``collision``, ``local_minimum`` or ``late``, see :class:`FieldMotion` (details: ``time``, s;
            ``clearance``, ``hand_clearance`` and ``distance`` to the goal, m), or ``unreachable``.
        ValueError: if the problem or an option is not of this kind.
    """
    field = make_field(
        square=square,
        distance=distance,
        attraction=attraction,
        repulsion=repulsion,
        influence=influence,
        norm=norm,
    )
    motion = follow_field(problem, field, period=period, tolerance=tolerance)
    if motion.outcome != "reached":
        raise _failure(problem, motion)
    name = f"apf (paper), {'Khatib' if square else 'printed'}, {distance if isinstance(distance, str) else 'own'}"
    qdd, end = np.gradient(motion.qd, motion.t, axis=0), float(motion.t[-1])
    return sampled_trajectory(problem, motion.t, motion.q, motion.qd, qdd, planner=name, cost=end, rendezvous_time=end)


def follow_field(
    problem: MotionProblem,
    field: HandField,
    *,
    period: float | None = None,
    tolerance: float = 1e-3,
    measuring_time: float = _MEASURING_TIME,
) -> FieldMotion:
    """Follow the field until the arm is at the goal, touches a disc, or the horizon is over.

    Args:
        problem, period, tolerance: as for :func:`plan_paper`.
        field: of :func:`planners.apf.hand_field.make_field`.
        measuring_time: time constant of the low-pass filter of the hand's velocity for the table, s; without it (0) the
            velocity oscillates from sample to sample where the wall is steep.

    Raises:
        Infeasible: reason ``unreachable`` if the goal is out of reach.
        ValueError: if the problem or an option is not of this kind.
    """
    arm, goal = problem.arm, hand_goal(problem)
    if not (math.isfinite(tolerance) and tolerance > 0.0):
        raise ValueError(f"tolerance {tolerance} m must be finite and positive")
    if not (math.isfinite(measuring_time) and measuring_time >= 0.0):
        raise ValueError(f"measuring_time {measuring_time} s must be finite and not negative")
    if period is None:
        period = min(PERIOD, problem.horizon / 2.0)
    if not 0.0 < period <= problem.horizon / 2.0:
        raise ValueError(f"period {period} s must be positive and at most half the horizon of {problem.horizon} s")
    steps = round(min(problem.horizon / period, _MOST_SAMPLES))
    body = arm.length_array, arm.base_array, arm.link_radius
    positions = np.array([disc.position for disc in problem.obstacles]).reshape(-1, 2)
    velocities = np.array([disc.velocity for disc in problem.obstacles]).reshape(-1, 2)
    radii = np.array([disc.radius for disc in problem.obstacles], dtype=float)
    blend = 1.0 - math.exp(-period / measuring_time) if measuring_time else 1.0
    start, discs = problem.start[:2], (positions, velocities, radii)
    samples = _follow(*body, field, *start, goal, *discs, period, steps, tolerance, blend)
    q, _, clearance, _ = samples
    outcome = _outcome(problem, field.gains, goal, q, clearance, period, tolerance)
    return FieldMotion(period * np.arange(len(q), dtype=np.float64), *samples, outcome)


def hand_goal(problem: MotionProblem) -> Array:
    """The goal of the hand, ``(2,)``, m.

    Raises:
        Infeasible: reason ``unreachable`` if the goal is out of reach.
        ValueError: if the arm does not have two links, or the target moves.
    """
    arm, target = problem.arm, problem.target
    if arm.n_joints != 2:
        raise ValueError(f"the paper's field moves an arm of two links; {arm.name} has {arm.n_joints}")
    if isinstance(target, FixedJoints):
        return arm.forward_kinematics(target.q)
    if not isinstance(target, FixedHand):
        raise ValueError(f"the paper's goal stands still: give a FixedHand or FixedJoints target, not {target}")
    try:
        arm.inverse_kinematics(target.position)
    except ValueError as error:
        raise Infeasible("unreachable", str(error), position=target.position) from None
    return target.position.copy()  # writable, like the other: a second kind of argument would be compiled again


@njit(cache=True, nogil=True)
def _follow(
    lengths: Array,
    base: Array,
    link_radius: float,
    field: HandField,
    start: Array,
    start_velocity: Array,
    goal: Array,
    start_positions: Array,
    velocities: Array,
    radii: Array,
    period: float,
    steps: int,
    tolerance: float,
    blend: float,
) -> tuple[Array, Array, Array, Array]:
    """Samples of q, qd and the clearances of arm and hand; the last is at the goal, in contact or at the horizon."""
    q, qd = np.empty((steps + 1, 2)), np.empty((steps + 1, 2))
    clearance, hand_clearance = np.full(steps + 1, np.inf), np.full(steps + 1, np.inf)
    hand, hand_velocity, velocity = np.empty(2), np.empty(2), np.empty(2)
    grown = radii + link_radius
    q[0] = start
    measured = start_velocity.copy()
    last = steps
    for i in range(steps + 1):
        # Velocity of the hand down the potential (eq 16), and of the joints (eq 18).
        positions = start_positions + i * period * velocities
        hand_state_single(lengths, base, q[i], measured, hand, hand_velocity)
        hand_velocity_single(field, hand, hand_velocity, goal, positions, velocities, grown, velocity)
        joint_rates_single(lengths, q[i], velocity, qd[i])
        measured += blend * (qd[i] - measured)
        # Clearances, and whether the motion ends here.
        for k in range(radii.shape[0]):
            x, y = positions[k]
            clearance[i] = min(clearance[i], clearance_single(lengths, base, link_radius, q[i], x, y, radii[k]))
            hand_clearance[i] = min(hand_clearance[i], np.hypot(hand[0] - x, hand[1] - y) - grown[k])
        arrived = i > 0 and np.hypot(hand[0] - goal[0], hand[1] - goal[1]) <= tolerance  # a motion has two samples
        if arrived or clearance[i] < 0.0:
            last = i
            break
        if i < steps:
            q[i + 1] = q[i] + period * qd[i]
    end = last + 1
    return q[:end].copy(), qd[:end].copy(), clearance[:end].copy(), hand_clearance[:end].copy()


def _outcome(
    problem: MotionProblem, gains: Gains, goal: Array, q: Array, clearance: Array, period: float, tolerance: float
) -> Outcome:
    """Outcome of the motion; a local minimum where the hand has been almost at rest for `_STALL_TIME`."""
    if clearance[-1] < 0.0:
        return "collision"
    back = min(round(_STALL_TIME / period), len(q) - 1)
    before, hand = problem.arm.forward_kinematics(q[[-1 - back, -1]])
    distance, moved = np.hypot(*(hand - goal)), np.hypot(*(hand - before))
    if distance <= tolerance:
        return "reached"
    stuck = moved < _STALL_SHARE * back * period * gains.attraction * distance
    return "local_minimum" if stuck else "late"


def _failure(problem: MotionProblem, motion: FieldMotion) -> Infeasible:
    distance = float(np.hypot(*(problem.arm.forward_kinematics(motion.q[-1]) - hand_goal(problem))))
    time, clearance, hand_clearance = float(motion.t[-1]), float(motion.clearance[-1]), float(motion.hand_clearance[-1])
    away, last = f"{distance:.3g} m from the goal", f"at the horizon of {time:.3g} s"
    more = "give it more time"
    if len(motion.t) > _MOST_SAMPLES and time < problem.horizon:
        last, more = f"after {time:.3g} s, the last of {_MOST_SAMPLES} samples,", "give a longer period"
    message = {
        "collision": f"the arm touches a disc at {time:.3g} s, the hand {hand_clearance:.3g} m clear of it and {away}",
        "local_minimum": f"{last} the arm is stuck {away}",
        "late": f"{last} the hand is still moving, {away}; {more}",
    }[motion.outcome]
    return Infeasible(
        motion.outcome, message, time=time, clearance=clearance, hand_clearance=hand_clearance, distance=distance
    )


def posture(lengths: ArrayLike, hand: ArrayLike, elbow: int = 1, *, as_printed: bool = False) -> Array:
    """Joint angles of a two-link arm by eq 13 to 15, ``(2,)`` or ``(batch, 2)``, rad; NaN out of reach.

    Args:
        lengths: of the links, ``(2,)``, m.
        hand: relative to the base, ``(2,)`` or ``(batch, 2)``, m.
        elbow: 1 or -1, the sign of eq 14.
        as_printed: with arc tangents of one argument. Eq 14 is then half a turn off where the elbow is bent by more
            than 90 degrees; eq 15, ``atan(x, y)`` being that of x / y, gives minus theta_1, up to half a turn.
    """
    a1, a2 = np.asarray(lengths, dtype=float)
    x, y = np.moveaxis(np.asarray(hand, dtype=float), -1, 0)
    r = (x**2 + y**2 - a1**2 - a2**2) / (2.0 * a1 * a2)
    with np.errstate(invalid="ignore", divide="ignore"):
        sine = np.copysign(np.sqrt(1.0 - r**2), elbow)
        if as_printed:
            theta2 = np.arctan(sine / r)
            theta1 = np.arctan(x / y) - np.arctan((a1 + a2 * np.cos(theta2)) / (a2 * np.sin(theta2)))
        else:
            theta2 = np.arctan2(sine, r)
            theta1 = np.arctan2(y, x) - np.arctan2(a2 * np.sin(theta2), a1 + a2 * np.cos(theta2))
    return np.stack([theta1, theta2], axis=-1)
