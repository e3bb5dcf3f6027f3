"""Simulates a field on an arm that follows it exactly, past discs at constant velocity.

A field gives one acceleration for each control period. The arm holds it, and the acceleration jumps from one period to
the next. Where jerk is limited, it goes linearly from the last one to the next one instead, within a period. That is
the motion with held accelerations, averaged over the last period and therefore half a period later. Its state with the
last acceleration a and the period T,

    q + T / 2 q' + T^2 / 12 a,    q' + T / 2 a,

moves exactly as the state of a motion with held accelerations. The field is given this state, and the target half a
period later.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from planners.apf.dodge import dodge_accelerations, new_memory, tuned_gains
from planners.apf.joint_field import reach
from planners.apf.moving_target import approach
from planners.capabilities import SMOOTHLESS, Takes, variant
from planners.checks import require_finite
from planners.problem import FixedHand, FixedJoints, Infeasible, MotionProblem, MovingHand
from planners.promises import REST_SPEED, distances, farthest
from planners.robot.arm import Arm
from planners.trajectory import Trajectory, sampled_trajectory
from planners.typing import Array

PERIOD = 0.02
"""Default control period, s."""

MOST_PERIODS = 100_000
"""Largest number of control periods for a target in joint angles; for the hand fewer, see `_most_periods`."""

PRECISION = 1e-3
"""Default distance from the target that counts as reached, m or rad."""

STALLED = 500
"""Control periods at rest away from a fixed place of the hand, with no disc coming, after which the field is stuck."""

TOGETHER = 100
"""Control periods that are checked together for contact with a disc."""

TORQUE_SHARE = 0.99
"""Share of the torque limits that a field is given: the torque varies within a period."""

Field = Callable[[float, Array, Array, Array], Array]
"""Joint accelerations ``(1, n)`` from time (s), angles, velocities and the last accelerations, each ``(1, n)``."""


@variant(
    "apf",
    "field",
    {
        "joints": Takes(keeps=SMOOTHLESS, precision=PRECISION, arrives="on time"),
        "hand": Takes(
            links=(2,), obstacles="avoided", keeps=SMOOTHLESS, needs=("velocity", "acceleration"), precision=PRECISION
        ),
        "moving hand": Takes(links=(2, 3), precision=PRECISION),
    },
)
def plan_field(
    problem: MotionProblem, *, period: float = PERIOD, tolerance: float = PRECISION, hold_time: float = 0.1
) -> Trajectory:
    """Follow the field of the target's kind until the target is reached.

    Args:
        problem: with two links if the target is a place of the hand, two or three if it moves.
        period: control period, s; a little shorter where the horizon is not a multiple of it.
        tolerance: distance from the target that counts as reached, m, or rad for a target in joint angles.
        hold_time: time for which a fixed place of the hand must be held, s.

    Returns:
        The motion: to a place of the hand until it has been held and the arm is at rest, otherwise over the whole
        horizon. Its cost is the time from which on the tolerance is kept, s.

    Raises:
        Infeasible: reason ``collision`` if the arm touches an obstacle, ``late`` if the target is not reached in time,
            ``local_minimum`` if the arm comes to rest before a fixed place of the hand with no disc coming, ``limits``
            if the field exceeds a limit, or there are more than 100 000 periods, for the hand 50 000 or fewer.
        ValueError: if an option is out of range.
    """
    require_finite("period", period, "s", "positive")
    require_finite("tolerance", tolerance, "m or rad", "positive")
    require_finite("hold_time", hold_time, "s", "not negative")
    target = problem.target
    steps = max(1, math.ceil(problem.horizon / period - 1e-6))
    period = min(period, problem.horizon / steps)
    most = _most_periods(problem)
    if steps > most and not isinstance(target, FixedHand):
        raise Infeasible(
            "limits",
            f"a horizon of {problem.horizon:.4g} s has {steps:.8g} periods of {period:.4g} s, more than {most}; give a "
            f"shorter horizon or a longer period, {1.001 * problem.horizon / most:.4g} s",
        )
    field = _field(problem, period, tolerance, hold_time)
    smooth = bool(np.isfinite(problem.joint_limits.jerk).any())
    q, qd, qdd = (array[None].copy() for array in problem.start)
    states, accelerations, checked = [np.concatenate([q, qd])], [qdd[0]], 1
    since, resting = 0 if _error(problem, 0.0, q) <= tolerance else None, 0
    for step in range(min(steps, most)):
        last, t = qdd, step * period
        if smooth:
            ahead = q + period * (0.5 * qd + period / 12.0 * last), qd + 0.5 * period * last
            qdd = field(t + 0.5 * period, *ahead, last)
            q, qd = q + period * (qd + period * (last / 3.0 + qdd / 6.0)), qd + 0.5 * period * (last + qdd)
        else:
            qdd = field(t, q, qd, last)
            q, qd = q + period * (qd + 0.5 * period * qdd), qd + period * qdd
        if not (np.abs(qd) * period <= math.pi).all():
            _require_clear(problem, states, period, checked)
            raise _too_fast(qd[0], step * period, period)
        states.append(np.concatenate([q, qd]))
        accelerations.append(qdd[0])
        t = (step + 1) * period
        if problem.obstacles and len(states) - checked == TOGETHER:
            _require_clear(problem, states, period, checked)
            checked = len(states)
        if not _error(problem, t, q) <= tolerance:
            since = None
        elif since is None:
            since = step + 1
        if isinstance(target, FixedHand):
            still = np.abs(qd).max() <= REST_SPEED * max(tolerance, PRECISION)
            if since is not None and (step + 1 - since) * period >= hold_time and still:
                break
            resting = resting + 1 if since is None and not (qd.any() or qdd.any()) else 0
            if resting >= STALLED and resting % STALLED == 0 and not _coming(problem, t):
                _require_clear(problem, states, period, checked)
                raise _stuck(problem, t, _error(problem, t, q))
    _require_clear(problem, states, period, checked)
    if since is None:
        raise _late(problem, t, _error(problem, t, q))
    motion = _sampled(problem, np.array(states), np.array(accelerations), period, since * period, smooth)
    return _met(target, motion, tolerance) if isinstance(target, MovingHand) else motion


def _most_periods(problem: MotionProblem) -> int:
    """Control periods that are simulated in a few seconds."""
    if isinstance(problem.target, FixedJoints):
        return MOST_PERIODS
    return MOST_PERIODS // (2 + (len(problem.obstacles) if isinstance(problem.target, FixedHand) else 0))


def _field(problem: MotionProblem, period: float, tolerance: float, hold_time: float) -> Field:
    """The field for the kind of the target."""
    arm, target = _limited_arm(problem), problem.target
    if isinstance(target, MovingHand):
        acceleration = target.acceleration[None]

        def follow(t: float, q: Array, qd: Array, qdd: Array) -> Array:
            position, velocity = target.at(np.array([t]))
            return approach(arm, q, qd, qdd, (position, velocity, acceleration), period)

        return follow
    if isinstance(target, FixedJoints):
        goal = target.q[None]

        def rest_in_time(t: float, q: Array, qd: Array, qdd: Array) -> Array:
            return reach(arm, q, qd, goal, problem.horizon - t, period)

        return rest_in_time
    discs = problem.obstacles
    hand, gains = target.position[None], tuned_gains(len(discs))
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


def _limited_arm(problem: MotionProblem) -> Arm:
    """The loaded arm with the limits of the problem, its torques a little smaller."""
    limits = problem.joint_limits
    torque = tuple(TORQUE_SHARE * value for value in limits.torque)
    return replace(problem.loaded_arm, limits=replace(limits, torque=torque))


def _error(problem: MotionProblem, t: float, q: Array) -> float:
    """Distance from the target, m or rad."""
    target = problem.target
    if isinstance(target, FixedJoints):
        return float(np.abs(q[0] - target.q).max())
    place = target.position if isinstance(target, FixedHand) else target.at(t)[0]
    return float(np.hypot(*(problem.arm.forward_kinematics(q[0]) - place)))


def _require_clear(problem: MotionProblem, states: list[Array], period: float, checked: int) -> None:
    """Refuse a motion that touches an obstacle at one of its states from number ``checked`` on."""
    if not problem.obstacles or checked == len(states):
        return
    t = period * np.arange(checked, len(states))
    q = np.array(states[checked:])[:, 0]
    gaps = [
        problem.arm.clearance(q, disc.position + t[:, None] * disc.velocity, disc.radius) for disc in problem.obstacles
    ]
    clear = np.array(gaps) >= 0.0
    if not clear.all():
        first = int(np.argmin(clear.all(axis=0)))
        gap = gaps[int(np.argmin(clear[:, first]))][first]
        message = f"after {t[first]:.4g} s the arm touches an obstacle"
        raise Infeasible("collision", message, time=float(t[first]), clearance=float(gap))


def _too_fast(qd: Array, t: float, period: float) -> Infeasible:
    """The refusal of a motion that the field does not control any more: more than half a turn within a period."""
    turn = period * np.abs(qd)
    joint = int(np.argmax(np.where(np.isnan(turn), math.inf, turn)))
    message = f"joint {joint + 1} turns by {turn[joint]:.3g} rad in the period of {period:.4g} s from {t:.4g} s on"
    return Infeasible("limits", f"{message}; limit the velocities, or give a shorter period", joint=joint, time=t)


def _late(problem: MotionProblem, t: float, error: float) -> Infeasible:
    unit = "rad" if isinstance(problem.target, FixedJoints) else "m"
    return Infeasible("late", f"after {t:.4g} s the field is still {error:.3g} {unit} from the target", error=error)


def _coming(problem: MotionProblem, t: float) -> bool:
    """Whether a disc moves within twice the arm's reach at time ``t``, or towards the arm."""
    for disc in problem.obstacles:
        away = disc.position + t * disc.velocity - problem.arm.base_array
        near = np.hypot(*away) < 2.0 * problem.arm.reach + disc.radius
        if disc.velocity.any() and (near or away @ disc.velocity < 0.0):
            return True
    return False


def _stuck(problem: MotionProblem, t: float, error: float) -> Infeasible:
    message = f"after {t:.4g} s the arm rests {error:.3g} m from the target, where attraction and repulsion cancel"
    return Infeasible("local_minimum", f"{message}; try another planner, or another start", error=error, time=t)


def _met(target: MovingHand, motion: Trajectory, tolerance: float) -> Trajectory:
    """The motion with the time from which on it stays with a moving target, also within the periods."""
    times, errors = distances(motion, target)
    away = np.flatnonzero(~(errors <= tolerance))
    first = int(np.searchsorted(motion.t, times[away[-1]], side="right")) if len(away) else 0
    while first < len(motion.t):
        since = float(motion.t[first])
        error, when = farthest(motion, target, since)
        if error <= tolerance:
            return replace(motion, cost=since, rendezvous_time=since)
        first = max(first + 1, int(np.searchsorted(motion.t, when, side="right")))
    raise _late(motion.problem, motion.duration, float(errors[-1]))


def _sampled(
    problem: MotionProblem, states: Array, accelerations: Array, period: float, since: float, smooth: bool
) -> Trajectory:
    """The motion as a trajectory; where accelerations are held, each instant but the ends twice, before and after."""
    t, q, qd, qdd = period * np.arange(len(states)), states[:, 0], states[:, 1], accelerations
    if not smooth:
        t, q, qd = (np.repeat(values, 2, axis=0)[1:-1] for values in (t, q, qd))
        qdd = np.repeat(accelerations[1:], 2, axis=0)
    return sampled_trajectory(problem, t, q, qd, qdd, planner="apf (field)", cost=since, rendezvous_time=since)
