"""DPCT with the torque as its index: along a straight path, to rest in a given time.

The dynamic program of "Motion Planning of a Robot Manipulator for Conveyor Tracking" (T. H. Park, B. H. Lee and
M. S. Ko) over the phase plane of the progress ``r`` along a path and its rate, with three changes. A step takes the
time that constant acceleration takes (eq 26 divides by zero at rest). Its cost is the torque index of "Trajectory
planning for torque minimization of robot manipulators using the Lagrange interpolation method" (eq 6, as an integral)
in place of eq 28. And the given duration is met by a Lagrange multiplier on time, in place of the clock of eq 27.

Only the speed along the path is chosen, so the index cannot fall below that of the best motion on the path; a planner
that bends the path may do better.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal, cast, get_args

import numpy as np

from planners.capabilities import SMOOTHLESS, Takes, variant
from planners.checks import require_choice, rounded_up
from planners.dpct.torque.profile_search import Corridor, Profile, least_torque, mix
from planners.dpct.torque.speed_profile import controllable, extreme_profile
from planners.dpct.torque.way import KINDS, Way, way_of
from planners.goals import goal_postures
from planners.motion.time_laws import stop_motion
from planners.problem import FixedHand, FixedJoints, Infeasible, MotionProblem, MovingHand
from planners.trajectory import Trajectory, sampled_trajectory
from planners.trajectory.measure import measure
from planners.typing import Array

Objective = Literal["PI1", "PI2"]

STAGES, MOST_STAGES = 96, 1000
"""Steps in r, shortest at the ends, where the speed changes most."""

SAMPLES, MOST_SAMPLES, SAMPLING_STEP = 6, 500, 0.004
"""Least and most samples a step, and largest time (s) between two if they are enough."""

MOST_IN_ALL = 4_000
"""Samples of a motion, about: of one that takes longer than `SAMPLING_STEP` times that, they are further apart."""

TIGHTENING, ATTEMPTS = np.array([1.0 - 1e-4, 1.0, 1.0 - 1e-4]), 12
"""Share of the limits of torque, velocity and acceleration of the first attempt, and how many attempts there are."""

MOST_WITHOUT_GAIN = 3
"""Attempts in a row that do not lower the least excess so far: after these no other is made."""

BACK_OFF = 1e-4
"""How much tighter than the excess between the stages the limits become for the next attempt."""

CEILING = 1000.0
"""Largest speed, as a multiple of the mean, where no limit ends it; twice that of the start if that is more."""

ON_TIME = 1e-9
"""Difference, as a fraction, between the duration and the horizon that is rounding."""

START_TOLERANCE = 1e-3
"""Relative excess over the largest feasible squared start speed that is accepted: a replan during braking at the
limit starts on the boundary."""

STANDSTILL = 1e-9
"""Speed, as a fraction of the fastest, that is rest but for rounding."""


@variant(
    "dpct",
    "torque",
    {
        "joints": Takes(keeps=SMOOTHLESS, arrives="on time"),
        "hand": Takes(keeps=SMOOTHLESS, arrives="on time"),
    },
)
def plan_torque(problem: MotionProblem, *, objective: Objective = "PI1", stages: int = STAGES) -> Trajectory:
    """Come to rest at a fixed target when the horizon is over, with the least torque on the straight path there.

    Straight in joint angles for a target in joint angles; for a hand, straight for the hand, or in joint angles where
    its orientation changes, that path fails, or there are other than two or three links. The arm never moves backwards
    on the path; where time is left over it may rest on it, or at either end, where that takes least torque. To a target
    in joint angles, what the start moves across the path or against it is braked in addition, over the whole horizon.

    Limits of torque, velocity and acceleration, and joint ranges, are kept on a dense grid of samples. The path's
    acceleration is constant from stage to stage and jumps between, so no finite limit of jerk is kept (its ratio is
    then inf), and the acceleration at time 0 is not the start's. Without torque limits PI1 has no minimum, only ever
    shorter and higher pulses: the stages then bound them.

    Args:
        problem: for the straight path of a hand at rest, or moving along it; obstacles play no part.
        objective: ``"PI1"``, the integral of the summed absolute torques (N m s), or ``"PI2"``, of their squares.
        stages: steps of constant acceleration.

    Returns:
        The trajectory, as long as the horizon; its cost is PI1 or PI2.

    Raises:
        Infeasible: ``late`` if the horizon is too short, with the least time that does as ``minimum_time``, unless
            joints move beside the path at the start;
            ``start`` if the arm moves too fast to stop in time; ``limits`` if the limits allow no motion on the path;
            ``unreachable`` if the path leaves the reach.
        ValueError: if the target moves, or an option is out of range.
    """
    if isinstance(problem.target, MovingHand):
        raise ValueError("variant 'torque' goes to a fixed target; a MovingHand is for variant 'optimal'")
    require_choice("objective", objective, get_args(Objective))
    if not 10 <= stages <= MOST_STAGES:
        raise ValueError(f"stages {stages} must be from 10 to {MOST_STAGES}")
    if not isinstance(problem.target, FixedHand):
        return _among(problem, _along(_free_way(problem, stages), objective))
    failure = None
    if problem.arm.n_joints in (2, 3):
        try:
            return _among(problem, _along(_free_way(problem, stages), objective))
        except Infeasible as refusal:
            failure = refusal
    return _to_postures(problem, objective, stages, failure)


def _free_way(problem: MotionProblem, stages: int) -> Way:
    """The way without the obstacles, which are looked at once, in the motion that is chosen."""
    return way_of(replace(problem, obstacles=()), stages)


def _among(problem: MotionProblem, trajectory: Trajectory) -> Trajectory:
    """A motion that was planned without the obstacles of a problem, measured with them."""
    if not problem.obstacles:
        return replace(trajectory, problem=problem)
    samples = trajectory.t, trajectory.q, trajectory.qd, trajectory.qdd, trajectory.tau
    return replace(trajectory, problem=problem, measured=measure(problem, *samples))


def _along(way: Way, objective: Objective) -> Trajectory:
    """The motion of least torque along a way."""
    problem = way.problem
    if way.length == 0.0:
        return _trajectory(way, None, objective, way.across)
    corridor = _fastest_within_limits(way, objective)
    fastest, horizon = corridor.fastest, problem.horizon
    least = corridor.duration(fastest)
    if horizon < least:
        message = (
            f"the straight path takes {math.ceil(1e4 * least) / 1e4:.4f} s; the horizon is {horizon:.4g} s, raise it"
        )
        if way.across is not None:
            raise Infeasible("late", f"{message} further: joints move beside the path and must brake", horizon=horizon)
        raise Infeasible("late", message, minimum_time=least * (1.0 + 1e-9), horizon=horizon)
    least_excess, without_gain = math.inf, 0
    for _ in range(ATTEMPTS):
        late = corridor.duration(corridor.fastest) > horizon  # for the tightened limits only
        profile = mix(corridor, fastest, corridor.fastest) if late else least_torque(corridor)
        trajectory = _trajectory(way, profile, objective, way.across)
        excess = _excess(trajectory)
        if (excess <= 1.0).all():
            return trajectory
        without_gain = 0 if excess.max() < least_excess else without_gain + 1
        least_excess = min(least_excess, float(excess.max()))
        if without_gain == MOST_WITHOUT_GAIN:  # what moves beside the path exceeds them, whatever the speed along it
            break
        corridor = _corridor(way, objective, _tightened(corridor.track.limits, excess))
    if way.across is not None:
        moving = float(np.abs(way.across).max())
        message = f"beside the straight path the joints move at up to {moving:.3g} rad/s, which the limits do not allow"
        raise Infeasible("start", f"{message} to brake on the way; change the horizon, or start at rest", across=moving)
    raise _between_stages()


def _to_postures(problem: MotionProblem, objective: Objective, stages: int, failure: Infeasible | None) -> Trajectory:
    """The best of the straight joint paths to the postures of a hand target that touches no obstacle; ``failure`` is
    that of the hand's path.
    """
    assert isinstance(problem.target, FixedHand)
    plans = []
    failures: list[tuple[Infeasible, FixedHand | FixedJoints]] = []
    if failure is not None:
        failures.append((failure, problem.target))
    for goal in map(FixedJoints, goal_postures(problem, problem.target, "best")):
        try:
            free = replace(problem, target=goal, obstacles=())
            plans.append(plan_torque(free, objective=objective, stages=stages))
        except Infeasible as refusal:
            failures.append((refusal, goal))
    plans.sort(key=lambda plan: plan.cost)
    measured = []
    for plan in plans:
        measured.append(_among(problem, plan))
        if measured[-1].clearance >= 0.0:
            return measured[-1]
    for late, target in failures:
        if _time_helps(replace(problem, target=target), late, objective, stages):
            raise late
    if measured:
        return measured[0]  # to be refused with where it touches
    least = min(cast(float, late.details["minimum_time"]) for late, _ in failures)
    message = f"the straight paths take {rounded_up(least):.4g} s or more, and in their least times touch an obstacle"
    raise Infeasible("late", f"{message}; the horizon is {problem.horizon:.4g} s, try another planner")


def _time_helps(problem: MotionProblem, refusal: Infeasible, objective: Objective, stages: int) -> bool:
    """Whether the time that a path's refusal names, if it does, leads to a motion that touches no obstacle."""
    enough = refusal.details.get("minimum_time")
    if not isinstance(enough, float) or not problem.obstacles:
        return True
    longer = replace(problem, horizon=1.001 * enough)
    try:
        return _among(longer, _along(_free_way(longer, stages), objective)).clearance >= 0.0
    except Infeasible:
        return False


def _fastest_within_limits(way: Way, objective: Objective) -> Corridor:
    """The corridor of limits so tight that its fastest profile keeps the true ones between the stages too."""
    limits = way.track.limits * TIGHTENING[:, None]
    for _ in range(ATTEMPTS):
        corridor = _corridor(way, objective, limits)
        excess = _excess(_trajectory(way, Profile(corridor.fastest), objective))
        if (excess <= 1.0).all():
            return corridor
        limits = _tightened(limits, excess)
    raise _between_stages()


def _between_stages() -> Infeasible:
    """Backing off has not helped."""
    return Infeasible("limits", "the limits cannot be kept between the stages of the straight path; give more stages")


def _corridor(way: Way, objective: Objective, limits: Array) -> Corridor:
    """The slowest and the fastest profile within limits of torque, velocity and acceleration, ``(3, n)``."""
    track, horizon = way.track._replace(limits=limits), way.problem.horizon
    ceiling = max(CEILING / horizon, 2.0 * way.speed) ** 2
    low, high = controllable(track, ceiling)
    blocked = np.flatnonzero(np.isnan(low))
    if len(blocked):
        r = float(way.r[blocked[-1]])
        message = f"at {r:.0%} of the straight path no speed leads to rest at the target within the limits; raise them"
        raise Infeasible("limits", message, r=r)
    if way.speed**2 > high[0] * (1.0 + START_TOLERANCE):
        most = math.sqrt(high[0])
        ratio = way.speed / most if most > 0.0 else math.inf
        message = f"the start speed is {ratio:.4g} times the largest from which the arm can stop at the target"
        raise Infeasible("start", message, speed=way.speed, limit=most)
    if way.speed**2 < low[0]:
        least = math.sqrt(low[0])
        message = f"the limits require a start at {least:.3g} or more of the path per second, not {way.speed:.3g}"
        raise Infeasible("limits", message, speed=way.speed, limit=least)
    start = min(way.speed, math.sqrt(high[0]))
    slowest, fastest = (extreme_profile(track, low, high, ceiling, start, fast) for fast in (False, True))
    slowest[slowest < STANDSTILL * fastest.max()] = 0.0
    return Corridor(track, slowest, fastest, horizon, objective == "PI2")


def _excess(trajectory: Trajectory) -> Array:
    """Worst |value| / limit of torque, velocity and acceleration on the samples, ``(3,)``."""
    return np.array([trajectory.limit_ratios[kind] for kind in KINDS])


def _tightened(limits: Array, excess: Array) -> Array:
    """Limits ``(3, n)`` of the next attempt after the samples of one have exceeded the true ones."""
    tighter: Array = limits * np.where(excess > 1.0, (1.0 - BACK_OFF) / np.maximum(excess, 1.0), 1.0)[:, None]
    return tighter


def _trajectory(way: Way, profile: Profile | None, objective: Objective, across: Array | None = None) -> Trajectory:
    """A profile (None: staying at the start) on dense samples, by exact kinematics and inverse dynamics.

    Joint velocities ``across`` of the start, ``(n,)``, are braked meanwhile.
    """
    problem = way.problem
    t, r, rate, acceleration = _sample(way, profile)
    if math.isclose(t[-1], problem.horizon, rel_tol=ON_TIME):
        t = np.minimum(t * (problem.horizon / t[-1]), problem.horizon)
        t[-1] = problem.horizon
    q, slope, curvature = way.joints(r)
    qd = slope * rate[:, None]
    qdd = curvature * rate[:, None] ** 2 + slope * acceleration[:, None]
    if across is not None:
        stopping = stop_motion(across, np.zeros_like(across), t[-1], t[:, None] / t[-1])
        q, qd, qdd = map(np.add, (q, qd, qdd), stopping)
    if isinstance(problem.target, FixedJoints):
        q[-1] = problem.target.q  # to the last digit
    end = float(t[-1])
    trajectory = sampled_trajectory(problem, t, q, qd, qdd, rendezvous_time=end, planner="dpct (torque)")
    load = np.sum(trajectory.tau**2 if objective == "PI2" else np.abs(trajectory.tau), axis=1)
    return replace(trajectory, cost=float(np.trapezoid(load, trajectory.t)))


def _sample(way: Way, profile: Profile | None) -> tuple[Array, Array, Array, Array]:
    """Time, r, its rate and its acceleration, ``(samples,)`` each, to rest at the end."""
    if profile is None:
        t = way.problem.horizon * np.linspace(0.0, 1.0, 2 if way.across is None else 4 * len(way.r))
        return t, np.zeros_like(t), np.zeros_like(t), np.zeros_like(t)
    speeds, stage = profile.speeds, profile.rest_stage
    acceleration = np.diff(speeds**2) / (2.0 * np.diff(way.r))
    duration = 2.0 * np.diff(way.r) / (speeds[:-1] + speeds[1:])
    steps = np.stack([way.r[:-1], speeds[:-1], acceleration, duration])
    if profile.rest > 0.0:
        steps = np.insert(steps, stage, [way.r[stage], 0.0, 0.0, profile.rest], axis=1)
    begin = np.append(0.0, np.cumsum(steps[3]))
    parts = np.clip(np.ceil(steps[3] / SAMPLING_STEP), SAMPLES, MOST_SAMPLES).astype(int)
    share = np.maximum(steps[3] / steps[3].sum(), 1.0 / len(parts))
    parts = np.minimum(parts, np.maximum(SAMPLES, np.ceil(MOST_IN_ALL * share)).astype(int))
    step = np.repeat(np.arange(len(parts)), parts + 1)
    part = np.arange(len(step)) - (np.cumsum(parts + 1) - (parts + 1))[step]
    r, rate, acceleration, duration = steps[:, step]
    since = np.where(part < parts[step], duration * part / parts[step], duration)
    t = np.append(begin[step] + since, begin[-1])
    r = np.append(r + since * (rate + 0.5 * since * acceleration), 1.0)
    rate, acceleration = np.append(rate + since * acceleration, 0.0), np.append(acceleration, 0.0)
    return t, r, rate, acceleration
