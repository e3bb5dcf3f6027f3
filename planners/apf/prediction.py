"""Simulates a field on an arm that follows it exactly, past discs at constant velocity."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from planners.apf.dodge import dodge_accelerations, new_memory, tuned_gains
from planners.apf.joint_field import reach
from planners.apf.moving_target import approach
from planners.capabilities import SMOOTHLESS, Takes, variant
from planners.problem import FixedHand, FixedJoints, Infeasible, MotionProblem, MovingHand
from planners.robot.limits import LIMIT_KINDS
from planners.trajectory import Trajectory, sampled_trajectory
from planners.typing import Array

PERIOD = 0.02
"""Default control period, s."""

Field = Callable[[float, Array, Array, Array], Array]
"""Joint accelerations ``(1, n)`` from time (s), angles, velocities and the last accelerations, each ``(1, n)``."""


@variant(
    "apf",
    "field",
    {
        "joints": Takes(keeps=SMOOTHLESS, precision=1e-3, arrives="on time"),
        "hand": Takes(links=(2,), obstacles="avoided", keeps=SMOOTHLESS, precision=1e-3),
        "moving hand": Takes(links=(2,), precision=1e-3),
    },
)
def plan_field(
    problem: MotionProblem, *, period: float = PERIOD, tolerance: float = 1e-3, hold_time: float = 0.1
) -> Trajectory:
    """Follow the field of the target's kind until the target is reached; accelerations are held for a period each.

    Args:
        problem: with two links if the target is a place of the hand. The limits kept are those of the arm.
        period: control period, s.
        tolerance: distance from the target that counts as reached, m, or rad for a target in joint angles.
        hold_time: time for which a fixed place of the hand must be held, s.

    Returns:
        The motion: to a place of the hand until it has been held, otherwise over the whole horizon. Its cost is the
        time from which on the tolerance is kept, s.

    Raises:
        Infeasible: reason ``collision`` if the arm touches an obstacle, ``late`` if the target is not reached in time.
        ValueError: if the period is not positive, or the arm does not have two links where it must.
    """
    if not period > 0.0:
        raise ValueError(f"period {period} s must be positive")
    field = _field(problem, period, tolerance, hold_time)
    q, qd, qdd = (array[None].copy() for array in problem.start)
    steps = max(1, int(problem.horizon / period + 1e-6))
    states, accelerations = [np.stack([q[0], qd[0]])], []
    since = 0 if _error(problem, 0.0, q) <= tolerance else None
    for step in range(steps):
        qdd = field(step * period, q, qd, qdd)
        q, qd = q + period * (qd + 0.5 * period * qdd), qd + period * qdd
        states.append(np.stack([q[0], qd[0]]))
        accelerations.append(qdd[0])
        t = (step + 1) * period
        _require_clear(problem, t, q)
        if _error(problem, t, q) > tolerance:
            since = None
        elif since is None:
            since = step + 1
        if isinstance(problem.target, FixedHand) and since is not None and (step + 1 - since) * period >= hold_time:
            break
    if since is None:
        error = _error(problem, t, q)
        raise Infeasible("late", f"after {t:.4g} s the field is still {error:.3g} from the target", error=error)
    return _sampled(problem, np.array(states), np.array(accelerations), period, since * period)


def _field(problem: MotionProblem, period: float, tolerance: float, hold_time: float) -> Field:
    """The field for the kind of the target."""
    arm, target = problem.loaded_arm, problem.target
    if isinstance(target, MovingHand):
        acceleration = target.acceleration[None]

        def follow(t: float, q: Array, qd: Array, qdd: Array) -> Array:
            position, velocity = target.at(np.array([t]))
            return approach(arm, q, qd, qdd, (position, velocity, acceleration), period, limits=problem.joint_limits)

        return follow
    if isinstance(target, FixedJoints):
        goal = target.q[None]

        def rest_in_time(t: float, q: Array, qd: Array, qdd: Array) -> Array:
            return reach(arm, q, qd, goal, problem.horizon - t, period)

        return rest_in_time
    hand, gains, discs = target.position[None], tuned_gains(), problem.obstacles
    memory = new_memory(1, len(discs))
    positions = np.array([disc.position for disc in discs]).reshape(-1, 2)
    velocities = np.array([disc.velocity for disc in discs]).reshape(-1, 2)
    radii = np.array([[disc.radius for disc in discs]])

    def dodge(t: float, q: Array, qd: Array, qdd: Array) -> Array:
        discs = (positions + t * velocities)[None], velocities[None], radii
        return dodge_accelerations(
            arm, gains, q, qd, hand, *discs, memory, period, tolerance=tolerance, hold_time=hold_time
        )

    return dodge


def _error(problem: MotionProblem, t: float, q: Array) -> float:
    """Distance from the target, m or rad."""
    target = problem.target
    if isinstance(target, FixedJoints):
        return float(np.abs(q[0] - target.q).max())
    place = target.position if isinstance(target, FixedHand) else target.at(t)[0]
    return float(np.hypot(*(problem.arm.forward_kinematics(q[0]) - place)))


def _require_clear(problem: MotionProblem, t: float, q: Array) -> None:
    for disc in problem.obstacles:
        gap = float(problem.arm.clearance(q[0], disc.position + t * disc.velocity, disc.radius))
        if gap < 0.0:
            raise Infeasible("collision", f"after {t:.4g} s the arm touches an obstacle", time=t, clearance=gap)


def _sampled(problem: MotionProblem, states: Array, accelerations: Array, period: float, since: float) -> Trajectory:
    """The motion as a trajectory: accelerations are constant within a period, and jump between two."""
    # each instant twice, except for the ends: with the acceleration before and the one after
    t = np.repeat(period * np.arange(len(states)), 2)[1:-1]
    q, qd = (np.repeat(states[:, kind], 2, axis=0)[1:-1] for kind in (0, 1))
    qdd = np.repeat(accelerations, 2, axis=0)
    motion = sampled_trajectory(problem, t, q, qd, qdd, planner="APF (field)", cost=since, rendezvous_time=since)
    # the fields limit jerk as the change of the acceleration from one period to the next
    jerk = np.diff(accelerations, axis=0, prepend=problem.start[2][None]) / period
    ratio = float((np.abs(jerk) / np.array(problem.joint_limits.jerk)).max())
    ratios = motion.measured.ratios.copy()
    ratios[LIMIT_KINDS.index("jerk")] = ratio
    return replace(motion, measured=motion.measured._replace(ratios=ratios))
