"""DPCT past moving discs: the timing of a straight joint-space line to a fixed target.

The dynamic program of "Motion Planning of a Robot Manipulator for Conveyor Tracking" (T. H. Park, B. H. Lee and M. S.
Ko) over path position and speed (eq 9-12), with time as the stage, so that a predicted disc is a forbidden region in
position and time: the arm passes before it, waits, or moves back. After K. Kant and S. W. Zucker, "Toward Efficient
Trajectory Planning: The Path-Velocity Decomposition".

The lines lead to every posture of the target. Where discs block all of them, straight detours are searched as well,
each followed by a straight line to the target.

Meant for replanning every 0.1 s or so from the arm's present state and the observed discs.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import Literal, NamedTuple, get_args

import numpy as np

from planners.capabilities import SMOOTHLESS, Takes, variant
from planners.checks import require_choice
from planners.dpct.timing.crossings import STAGE, ArmLimits, PredictedDiscs, StraightLine, first_contact
from planners.dpct.timing.lattice import best_timing, time_from_rest
from planners.dpct.timing.line import fields_of_line_to
from planners.goals import goal_postures
from planners.motion.double_integrator import BRAKE, CRUISE, RISE, SPEED, fill_profile
from planners.problem import FixedHand, FixedJoints, Infeasible, MotionProblem, limit_broken
from planners.robot.limits import LimitKind
from planners.trajectory import Trajectory, sampled_trajectory
from planners.typing import Array

Contact = Literal["refuse", "delay"]

MOST_PREDICTION = 3.0  # longest prediction horizon of the discs, s: the effort grows with its cube
LONGEST_WAIT = 15.0  # that a plan is planned on from, s
SAMPLING_STEP, MOST_SAMPLES = 0.01, 1000  # time between two samples, s, unless a piece then has more than so many
ATTEMPTS, BACK_OFF = 10, 0.95  # attempts with tightened limits where a limit is exceeded, and an extra factor of each
ROUNDING = 1e-9  # excess of a limit, as a fraction of it, within rounding


@variant(
    "dpct",
    "timing",
    {
        "joints": Takes(obstacles="avoided", keeps=SMOOTHLESS, needs=("velocity", "acceleration")),
        "hand": Takes(obstacles="avoided", keeps=SMOOTHLESS, needs=("velocity", "acceleration")),
    },
)
def plan_timing(
    problem: MotionProblem, *, margin: float = 0.04, prediction: float = 1.5, contact: Contact = "refuse"
) -> Trajectory:
    """Come to rest at a fixed target, as soon as the discs allow.

    With no disc near, this is the time-optimal motion on the straight joint line. Otherwise the time to the target is
    traded off against the time spent closer than ``margin`` to a disc. The acceleration jumps, at time 0 too.

    Where the best motion touches a disc later than it has looked ahead, it is followed for half of that time, and
    planned again from there; then all of this with the longest prediction.

    Args:
        problem: at rest or in motion, with a fixed target.
        margin: least clearance from a disc without a cost, m.
        prediction: how far discs are looked ahead for in one plan, s.
        contact: ``"refuse"`` a motion that touches a disc or arrives after the horizon, or ``"delay"`` the contact as
            long as possible: one plan with discs ignored after the prediction, and no promise but the limits.

    Returns:
        The trajectory; its cost is the time to the target plus the cost of small clearances, s.

    Raises:
        Infeasible: ``collision`` if every motion found touches a disc; ``late`` if it takes longer than the horizon;
            ``unreachable`` if the target is out of reach; ``limits`` if the limits allow no motion.
        ValueError: if the target moves, a joint has no limit of velocity or acceleration, or an option is out of range.
    """
    assert isinstance(problem.target, FixedJoints | FixedHand)  # as declared
    if not (margin > 0.0 and math.isfinite(margin)):
        raise ValueError(f"margin {margin} m must be positive and finite")
    if not STAGE <= prediction <= MOST_PREDICTION:
        raise ValueError(f"prediction {prediction} s must be from {STAGE} to {MOST_PREDICTION} s")
    require_choice("contact", contact, get_args(Contact))
    goals = np.array(goal_postures(problem, problem.target, "best"))
    if contact == "delay":
        return _plan_once(problem, _scene(problem, margin, prediction), goals)
    answers: list[Trajectory | Infeasible] = []
    for ahead in dict.fromkeys((prediction, MOST_PREDICTION)):
        try:
            motion = _plan_clear(problem, margin, ahead, goals)
        except Infeasible as refusal:
            answers.append(refusal)
            if refusal.reason != "collision":
                break
        else:
            if motion.rendezvous_time <= problem.horizon:
                return motion
            answers.append(motion)
    if isinstance(answers[0], Infeasible):
        raise answers[0]
    return answers[0]  # it takes longer than the horizon, which the check of every motion refuses


def _plan_clear(problem: MotionProblem, margin: float, prediction: float, goals: Array) -> Trajectory:
    """A motion that is clear to its end, of as many plans as that takes."""
    begin, now, parts = 0.0, problem, []
    while True:
        scene = _scene(now, margin, prediction)
        plan = _plan_once(now, scene, goals)
        time = first_contact(scene, plan.t, plan.q)
        if plan.clearance >= 0.0:
            break
        if math.isfinite(time) or begin + prediction > min(problem.horizon, LONGEST_WAIT):
            time = begin + min(time, plan.measured.clearance_time)
            message = f"every timing found touches a disc, the best one after {time:.3g} s"
            advice = "allow more time, raise the acceleration limits, or try variant 'via' of lagrange"
            raise Infeasible("collision", f"{message}; {advice}", time=time)
        cut = 0.5 * prediction
        q, qd, qdd = plan.at(cut)
        first = plan.t < cut
        t = begin + np.append(plan.t[first], cut)
        parts.append((t, *(np.vstack([a[first], b]) for a, b in ((plan.q, q), (plan.qd, qd), (plan.qdd, qdd)))))
        begin += cut
        moved = tuple(replace(disc, position=disc.position + cut * disc.velocity) for disc in now.obstacles)
        now = replace(now, q=q, qd=qd, obstacles=moved)
    if not parts:
        return plan
    parts.append((begin + plan.t, plan.q, plan.qd, plan.qdd))
    motion = [np.concatenate(values) for values in zip(*parts, strict=True)]
    end, cost = begin + plan.duration, begin + plan.cost
    return sampled_trajectory(problem, *motion, cost=cost, rendezvous_time=end, planner="dpct (timing)")


def _scene(problem: MotionProblem, margin: float, prediction: float) -> PredictedDiscs:
    """The arm and its discs."""
    arm = problem.arm
    discs = np.array([[*disc.position, *disc.velocity, disc.radius] for disc in problem.obstacles]).reshape(-1, 5)
    return PredictedDiscs(arm.length_array, arm.base_array, arm.link_radius, discs, margin, prediction)


def _plan_once(problem: MotionProblem, scene: PredictedDiscs, goals: Array) -> Trajectory:
    """The best motion within the limits, planned again within tighter ones where it exceeds them."""
    kinds: tuple[LimitKind, ...] = ("torque", "velocity", "acceleration", "angle")
    limits = np.array([problem.joint_limits.array(kind) for kind in kinds])
    for _ in range(ATTEMPTS):
        cost, legs = _plan_legs(problem, scene, goals, limits)
        trajectory = _trajectory(problem, legs, cost)
        excess = _excess(problem, trajectory)
        if excess <= 1.0 + ROUNDING:
            return trajectory
        tighter = BACK_OFF / excess
        limits[:3] *= np.array([[tighter], [math.sqrt(tighter)], [tighter]])
    message = f"the motion takes {excess:.4g} times the limits even at {limits[2, 0]:.3g} rad/s^2; start slower"
    raise Infeasible("limits", message, ratio=excess)


class _Leg(NamedTuple):
    """A motion on a line: duration (s) and acceleration (rad/s^2) of each of its pieces, ``(pieces, 2)``."""

    line: StraightLine
    pieces: Array


def _detours(n: int) -> Array:
    """Directions, ``(directions, n)``: each joint alone, neighbouring joints together and against each other."""
    axes = np.eye(n)
    pairs = [axes[i] + sign * axes[i + 1] for i in range(n - 1) for sign in (1.0, -1.0)]
    return np.array([*axes, *pairs])


def _plan_legs(problem: MotionProblem, scene: PredictedDiscs, goals: Array, limits: Array) -> tuple[float, list[_Leg]]:
    """The best timing: one leg to the target, or a detour and a leg from its end."""
    q, qd = (array.copy() for array in problem.start[:2])  # arrays that cannot be written to are another type
    bounds = ArmLimits(limits, problem.joint_limits.angle_middle, *problem.loaded_arm.chain_constants)
    cost, fields, accelerations = best_timing(scene, q, qd, goals, _detours(len(q)), bounds)
    line = StraightLine(*fields)
    if not np.isfinite(cost):
        _require_strength(problem, goals)
        message = "the joints are too fast to stop within their ranges, or the static torques use up the torque limits"
        raise Infeasible("limits", f"{message}; start slower, or raise the limits")
    pieces = [(STAGE, acceleration) for acceleration in accelerations]
    r, v = 0.0, line.speed
    for duration, u in pieces:
        r, v = r + duration * (v + 0.5 * duration * u), v + duration * u
    if not math.isnan(line.goal):
        return cost, [_leg(line, pieces + _to_rest(line, line.goal - r, v))]
    pieces.append((abs(v) / line.acceleration, -math.copysign(line.acceleration, v)))
    stop = line.origin + (r + 0.5 * v * abs(v) / line.acceleration) * line.direction
    times = [time_from_rest(stop, goal[None], limits) for goal in goals]
    last = StraightLine(*fields_of_line_to(stop, np.zeros_like(stop), goals[int(np.argmin(times))], bounds))
    if math.isnan(last.low):
        raise Infeasible(
            "limits", "no straight line within the limits leads on to the target from a detour; raise them"
        )
    return cost, [_leg(line, pieces), _leg(last, _to_rest(last, last.goal, 0.0))]


def _require_strength(problem: MotionProblem, goals: Array) -> None:
    """Raise Infeasible if the motors cannot hold the arm at the start, or at none of the goals."""
    limits, still = problem.joint_limits.array("torque"), np.zeros_like(goals)
    held = np.abs(problem.loaded_arm.inverse_dynamics(goals, still, still)) / limits
    least = held[held.max(axis=1).argmin()]
    start = np.abs(problem.loaded_arm.bias(problem.q, still[0])) / limits
    for where, ratios in (("start", start), ("target", least)):
        if not ratios.max() < 1.0:
            raise limit_broken("limits", f"holds the arm's weight at the {where} with", ratios[None], ("torque",))


def _leg(line: StraightLine, pieces: list[tuple[float, float]]) -> _Leg:
    """A leg that ends at rest: not before the transverse velocity is 0, however short the line."""
    wait = line.decay - sum(duration for duration, _ in pieces)
    return _Leg(line, np.array([*pieces, (wait, 0.0)] if wait > 0.0 else pieces))


def _to_rest(line: StraightLine, distance: float, speed: float) -> list[tuple[float, float]]:
    """Pieces of the fastest motion to rest."""
    profile = np.empty(4)
    fill_profile(distance, speed, line.top_speed, line.acceleration, 0.0, profile)
    rise = math.copysign(line.acceleration, profile[SPEED] - speed)
    brake = -math.copysign(line.acceleration, profile[SPEED])
    return [(profile[RISE], rise), (profile[CRUISE], 0.0), (profile[BRAKE], brake)]


def _trajectory(problem: MotionProblem, legs: list[_Leg], cost: float) -> Trajectory:
    """Legs on dense samples, by exact kinematics and inverse dynamics."""
    begin, parts = 0.0, []
    for leg in legs:
        t, *motion = _sample(leg)
        parts.append((begin + t, *motion))
        begin = float(parts[-1][0][-1]) if len(t) else begin
    t, q, qd, qdd = (np.concatenate(values) for values in zip(*parts, strict=True))
    if len(t) == 0:  # at the target already
        t = np.array([0.0, STAGE])
        q, qd, qdd = np.tile(problem.q, (2, 1)), np.zeros((2, len(problem.q))), np.zeros((2, len(problem.q)))
    return sampled_trajectory(problem, t, q, qd, qdd, cost=cost, rendezvous_time=float(t[-1]), planner="dpct (timing)")


def _excess(problem: MotionProblem, trajectory: Trajectory) -> float:
    """Worst ratio to a limit of torque, acceleration or velocity; the last one is taken to be at least the start's."""
    ratios = trajectory.limit_ratios
    start = float(np.max(np.abs(trajectory.qd[0]) / problem.joint_limits.array("velocity")))
    return max(ratios["torque"], ratios["acceleration"], ratios["velocity"] / max(1.0, start))


def _sample(leg: _Leg) -> tuple[Array, Array, Array, Array]:
    """Time, and joint angles, velocities and accelerations, ``(samples, n)`` each, to rest at the end.

    Two samples where the acceleration jumps; none if the leg takes no time.
    """
    line = leg.line
    duration, acceleration = leg.pieces.T
    begin = np.append(0.0, np.cumsum(duration))
    jumps = np.unique(np.append(begin, line.decay if line.decay < begin[-1] else 0.0))
    pieces = [np.linspace(a, b, min(math.ceil((b - a) / SAMPLING_STEP), MOST_SAMPLES) + 1) for a, b in pairwise(jumps)]
    t = np.concatenate([np.zeros(0), *pieces])
    middle = np.repeat(0.5 * (jumps[:-1] + jumps[1:]), [len(times) for times in pieces])
    rise = np.append(0.0, np.cumsum(duration * acceleration))
    speed = line.speed + rise
    place = np.append(0.0, np.cumsum(duration * 0.5 * (speed[:-1] + speed[1:])))
    piece = np.clip(np.searchsorted(begin, middle, side="right") - 1, 0, len(duration) - 1)
    s, u = t - begin[piece], acceleration[piece]
    r, v = place[piece] + s * (speed[piece] + 0.5 * s * u), speed[piece] + s * u
    left = np.maximum(0.0, line.decay - t)
    rate = line.across / line.decay if line.decay > 0.0 else np.zeros_like(line.across)
    q = line.origin + r[:, None] * line.direction - 0.5 * left[:, None] ** 2 * rate
    qd = v[:, None] * line.direction + left[:, None] * rate
    qdd = u[:, None] * line.direction - np.where(middle < line.decay, 1.0, 0.0)[:, None] * rate
    return t, q, qd, qdd
