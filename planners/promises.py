"""What a planner promises of a motion, checked on its continuous course: limits, continuity, clearance, arrival."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from planners.checks import LARGEST, rounded_up
from planners.problem import FixedHand, FixedJoints, Infeasible, MotionProblem, MovingHand
from planners.robot.kinematics import wrap
from planners.robot.limits import LIMIT_KINDS, JointLimits
from planners.trajectory import Trajectory
from planners.trajectory.measure import measure
from planners.typing import Array

BEYOND = 1e-6
"""Excess of a joint range by a target in joint angles that counts as rounding, rad."""

EXCESS = 1e-6
"""Excess of a limit, as a fraction of it, that is rounding."""

BESIDE = 1e-5
"""Distance from the start, rad or m, that is rounding."""

CONTINUOUS = 1e-3
"""Largest difference, rad, between a sample and where the last one's velocity leads, in a continuous motion."""

REST_SPEED = 10.0
"""Largest joint velocity that counts as rest at the end, rad/s, as a multiple of the precision (m or rad)."""

CLOSELY = 33
"""Times around the largest distance from a moving target at which it is looked for."""

UNITS = {"torque": "N m", "velocity": "rad/s", "acceleration": "rad/s^2", "jerk": "rad/s^3", "angle": "rad"}


def require_start(name: str, trajectory: Trajectory, *, turned: bool) -> None:
    """Refuse a motion of the planner ``name`` that does not begin at the start.

    ``turned`` allows, for a target of the hand, another posture with the hand in the same place.

    Raises:
        Infeasible: with reason ``start``.
    """
    problem, arm, first = trajectory.problem, trajectory.problem.arm, trajectory.q[0]
    apart, unit = float(np.abs(first - problem.q).max()), "rad"
    if turned and not isinstance(problem.target, FixedJoints):
        apart, unit = float(np.hypot(*(arm.forward_kinematics(first) - arm.forward_kinematics(problem.q)))), "m"
    if not apart <= BESIDE:
        message = f"the motion of {name} begins {apart:.4g} {unit} from the start; {BESIDE:.4g} {unit} is allowed"
        raise Infeasible("start", message, error=apart)


def require_range(problem: MotionProblem, goal: Array) -> None:
    """Refuse a target in joint angles ``(n,)`` that leaves a joint's range.

    Raises:
        Infeasible: with reason ``limits``.
    """
    limits = problem.joint_limits
    outside = (goal < limits.angle_lower - BEYOND) | (goal > limits.angle_upper + BEYOND)
    if outside.any():
        joint = int(np.argmax(outside))
        message = f"the target has joint {joint + 1} at {goal[joint]:.4g} rad; the joint ranges are {limits.angle_text}"
        raise Infeasible("limits", message, kind="angle", joint=joint)


def require_within_limits(name: str, trajectory: Trajectory) -> None:
    """Refuse a motion of the planner ``name`` that breaks a limit anywhere, or jumps.

    What the start breaks is allowed, to the joint that begins there and up to where it begins.

    Raises:
        Infeasible: with reason ``limits``.
    """
    problem, measured = trajectory.problem, trajectory.measured
    loads = _start_loads(problem)
    if (loads > 1.0).any():
        wider = replace(problem, limits=_widened(problem.joint_limits, np.maximum(1.0, loads)))
        measured = measure(wider, trajectory.t, trajectory.q, trajectory.qd, trajectory.qdd, trajectory.tau)
    kept = measured.ratios <= 1.0 + EXCESS
    if not kept.all():
        kind = int(np.argmax(np.where(kept, -1.0, measured.ratios)))
        joint, what = int(measured.joints[kind]), LIMIT_KINDS[kind]
        limit = float(problem.joint_limits.array(what)[joint])
        ratio = float(measured.ratios[kind]) * max(1.0, float(loads[kind, joint]))
        limited = f"its {what} limit of {limit:.4g} {UNITS[what]} at {measured.times[kind]:.4g} s"
        remedy = "try another planner, or widen the range" if what == "angle" else "allow more time, or raise the limit"
        excess = f"takes joint {joint + 1} to {ratio:.4g} times {limited}; {remedy}"
        if math.isinf(ratio):
            excess = f"has a jump of joint {joint + 1} in spite of {limited}; leave the limit out, or start at rest"
        raise Infeasible(
            "limits",
            f"the motion of {name} {excess}",
            joint=joint,
            kind=what,
            ratio=ratio,
        )
    if not measured.gap <= CONTINUOUS:
        message = f"the motion of {name} is not continuous: a joint jumps by {measured.gap:.4g} rad"
        raise Infeasible("limits", message, gap=measured.gap)


def require_solved(name: str, problem: MotionProblem, trajectory: Trajectory, precision: float, advice: str) -> None:
    """Refuse a motion that touches an obstacle, takes longer than the horizon or misses the target.

    Args:
        name: of the planner, for the message.
        problem: the one that was asked.
        trajectory: the motion.
        precision: largest distance from the target, m or rad.
        advice: for a collision: who avoids obstacles.

    Raises:
        Infeasible: with reason ``collision`` or ``late``.
    """
    if not trajectory.clearance >= 0.0:
        raise Infeasible(
            "collision",
            f"the motion of {name} touches an obstacle, {-1e3 * trajectory.clearance:.4g} mm deep at "
            f"{trajectory.measured.clearance_time:.4g} s ({advice})",
            clearance=trajectory.clearance,
            time=trajectory.measured.clearance_time,
        )
    arrival = trajectory.rendezvous_time
    if not arrival < math.inf:
        raise _late(f"the motion of {name} waits", problem.horizon, arrival)
    error, unit = target_error(problem, trajectory)
    if not error <= precision:
        message = f"the motion of {name} ends {error:.4g} {unit} from the target; {precision:.4g} {unit} is allowed"
        raise Infeasible("late", message, error=error)
    speed, allowed = float(np.abs(trajectory.qd[-1]).max()), REST_SPEED * precision
    if not isinstance(problem.target, MovingHand) and not speed <= allowed:
        message = f"the motion of {name} ends at {speed:.4g} rad/s, not at rest; {allowed:.4g} rad/s is allowed"
        raise Infeasible("late", message, speed=speed)
    # Last, so that a motion which has to be refused with more time too is not said to need more.
    if not arrival <= problem.horizon * (1.0 + 1e-9):
        raise _late(f"the motion of {name} arrives at {rounded_up(arrival):.4g} s", problem.horizon, arrival)


def _late(motion: str, horizon: float, arrival: float) -> Infeasible:
    """The refusal of a motion that takes longer than the horizon."""
    return Infeasible("late", f"{motion}; the horizon is {horizon:.4g} s, allow more time", minimum_time=arrival)


def target_error(problem: MotionProblem, trajectory: Trajectory) -> tuple[float, str]:
    """Largest distance from the target, with its unit: at the end, or from the rendezvous on for a moving one.

    Of a hand with an orientation, the larger number of the two.
    """
    target, arm = problem.target, problem.arm
    if isinstance(target, FixedJoints):
        return float(np.abs(trajectory.q[-1] - target.q).max()), "rad"
    if isinstance(target, FixedHand):
        away = float(np.hypot(*(arm.forward_kinematics(trajectory.q[-1]) - target.position)))
        turn = 0.0 if target.orientation is None else abs(float(wrap(trajectory.q[-1].sum() - target.orientation)))
        return (turn, "rad") if turn > away else (away, "m")
    return farthest(trajectory, target, min(trajectory.rendezvous_time, trajectory.duration))[0], "m"


def distances(trajectory: Trajectory, target: MovingHand, since: float = 0.0) -> tuple[Array, Array]:
    """Times of the samples from some time on, and of the instants halfway between them, s; the hand's distances, m."""
    riding = trajectory.t >= since
    t, q = trajectory.t[riding], trajectory.q[riding]
    times = np.repeat(t, 2)[:-1]
    times[1::2] = 0.5 * (t[1:] + t[:-1])
    postures = np.repeat(q, 2, axis=0)[:-1]
    postures[1::2] = trajectory.at(times[1::2])[0]
    return times, _away(trajectory, target, times, postures)


def farthest(trajectory: Trajectory, target: MovingHand, since: float) -> tuple[float, float]:
    """Largest distance of the hand from a moving target from some time on, m, and when, s.

    It is looked for at the times of `distances`, and closely around the worst of them.
    """
    times, found = distances(trajectory, target, since)
    worst = int(found.argmax())  # a NaN, if there is one
    closely = np.linspace(times[max(worst - 1, 0)], times[min(worst + 1, len(times) - 1)], CLOSELY)
    again = _away(trajectory, target, closely, trajectory.at(closely)[0])
    best = int(again.argmax())
    if again[best] > found[worst]:
        return float(again[best]), float(closely[best])
    return float(found[worst]), float(times[worst])


def _away(trajectory: Trajectory, target: MovingHand, t: Array, q: Array) -> Array:
    away: Array = np.hypot(*(trajectory.problem.arm.forward_kinematics(q) - target.at(t)[0]).T)
    return away


def _start_loads(problem: MotionProblem) -> Array:
    """|value| / limit of each kind and joint at the start, ``(5, n)``; that of jerk is 0."""
    limits, (q, qd, qdd) = problem.joint_limits, problem.start
    tau = problem.loaded_arm.inverse_dynamics(q, qd, qdd)
    values = {
        "torque": tau,
        "velocity": qd,
        "acceleration": qdd,
        "jerk": np.zeros_like(q),
        "angle": q - limits.angle_middle,
    }
    return np.array([np.abs(values[kind]) / limits.array(kind) for kind in LIMIT_KINDS])


def _widened(limits: JointLimits, factors: Array) -> JointLimits:
    """Limits times factors of each kind and joint, ``(5, n)``, ranges of angles about their middles."""
    wide = {kind: factor * limits.array(kind) for kind, factor in zip(LIMIT_KINDS, factors, strict=True)}
    wide = {kind: np.where(values > LARGEST, np.inf, values) for kind, values in wide.items()}
    half, middle = wide.pop("angle"), limits.angle_middle
    angle = tuple(zip((middle - half).tolist(), (middle + half).tolist(), strict=True))
    return JointLimits(**{kind: tuple(values.tolist()) for kind, values in wide.items()}, angle=angle)
