"""The default Lagrange planner: least joint torque between two joint states in a given time, within every limit.

The search is among the interpolations of "Trajectory Planning for Torque Minimization of Robot Manipulators Using the
Lagrange Interpolation Method" (eq 8, 9) on Chebyshev-Lobatto nodes in barycentric form, with angle and velocity exact
at both ends; under gravity, where the best motions swing, among cubic splines. In place of the paper's grid search
there is a compiled interior point method with exact derivatives, from several starts; the best ones are refined by
splines. Every plan is checked on a dense grid with exact inverse dynamics, and planned again within tighter limits
where it exceeds one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import NamedTuple, get_args

import numpy as np

from planners.capabilities import Takes, variant
from planners.checks import require_choice, rounded_up
from planners.goals import Elbow, goal_postures
from planners.lagrange.joint_move import Curve, JointMove, Objective, torque_rate
from planners.lagrange.rendezvous import Ride, earliest, find_rides
from planners.lagrange.search.least_time import BESIDE, holdable, joint_time, late, too_late
from planners.lagrange.search.multistart import any_motion, direct_motion, least_torque
from planners.lagrange.search.refinement import Fit
from planners.lagrange.transcription import Ends
from planners.motion.line_motion import Motion, sample_ride, to_trajectory
from planners.problem import Infeasible, MotionProblem, MovingHand, limit_broken
from planners.promises import require_within_limits
from planners.robot.limits import LIMIT_KINDS
from planners.trajectory import Trajectory, sampled_trajectory
from planners.typing import Array

NODES, FEWEST_NODES, MOST_NODES = 21, 9, 41

START_TOLERANCE = 1e-3
"""Largest excess of a limit by the start state, as a fraction of the limit."""

TIME_MARGIN = 1.25
"""Rendezvous time chosen, as a multiple of the earliest one found."""

SETTLED = 0.5
"""Least time from the rendezvous to the horizon, if possible, s."""

LONGER = (1.02, 1.5)
"""Horizons tried for the advice of a refusal, as multiples of the earliest rendezvous that a quick probe finds."""

MET = np.array([[1e-6], [1e-6], [1e-3]])
"""Differences of joint angle, velocity and acceleration (SI units) below which the arm already follows the target."""

_PLANNER = "lagrange (optimal)"


class Settings(NamedTuple):
    """Options of a plan, checked; see `plan_optimal`. In a ``hurry`` any motion will do."""

    objective: Objective
    degree: int
    polish: bool
    elbow: Elbow
    rendezvous_time: float | None
    guess: Curve | None
    explain: bool
    thorough: bool
    hurry: bool = False


@variant(
    "lagrange",
    "optimal",
    {
        "joints": Takes(arrives="on time"),
        "hand": Takes(arrives="on time"),
        "moving hand": Takes(links=(2, 3)),
    },
)
def plan_optimal(
    problem: MotionProblem,
    *,
    objective: Objective = "PI1",
    nodes: int = NODES,
    polish: bool = True,
    elbow: Elbow = "best",
    rendezvous_time: float | None = None,
    clamp_acceleration: bool | None = None,
    guess: Trajectory | None = None,
    explain: bool = True,
    thorough: bool = False,
) -> Trajectory:
    """Move with the least torque to a fixed or a moving target.

    A fixed target is reached, at rest, at the horizon. A moving one is met at the rendezvous time with its velocity
    (and acceleration), and then followed exactly along its line until the horizon, or until following it breaks a
    limit.

    Args:
        problem: the start, the target and the limits.
        objective: ``"PI1"``, the integral of sum abs(tau) (the paper's eq 6 over time), or ``"PI2"``, of sum tau^2.
        nodes: of the interpolation where the plan is not polished, both ends included; splines take its place where
            only they keep the limits.
        polish: refine the coarse solution by cubic splines (90 stages of linear acceleration, 150 to 300 with gravity),
            whose torques can switch, in place of an interpolation with more nodes.
        elbow: branch on which a target of the hand is met: the one of less torque, the start's or a given one.
        rendezvous_time: when to meet a moving target, s; by default 1.25 times the earliest time found, but half a
            second before the horizon if possible.
        clamp_acceleration: whether the start's acceleration is continued and the target's met, so that torque and
            acceleration do not jump there; by default where there are jerk limits.
        guess: an additional motion to start from, such as the plan for a similar problem.
        explain: on failure look for a time that is enough (up to 4 s, with gravity 10), for the message and
            the details.
        thorough: search a second time, from 40 random starts more (120 with gravity) and displaced solutions, and keep
            the better motion; takes six times as long (with gravity four times).

    Returns:
        The trajectory; its cost is the objective over its whole duration.

    Raises:
        Infeasible: with reason ``late`` (``details["minimum_time"]``, s, is the least time found in which, and in
            a thousandth more, there is a motion), ``start``, ``limits``, ``unreachable`` or ``no_window``.
        ValueError: if an option is out of range.
    """
    require_choice("objective", objective, get_args(Objective))
    require_choice("elbow", elbow, get_args(Elbow))
    if not FEWEST_NODES <= nodes <= MOST_NODES:
        raise ValueError(f"nodes {nodes} must be from {FEWEST_NODES} to {MOST_NODES}")
    if rendezvous_time is not None and not isinstance(problem.target, MovingHand):
        raise ValueError("only a moving target has a rendezvous_time; a fixed one is reached at the horizon")
    if rendezvous_time is not None and not 0.0 < rendezvous_time <= problem.horizon:
        raise ValueError(f"rendezvous_time {rendezvous_time} s must be in (0, horizon = {problem.horizon}] s")
    clamp = clamp_acceleration
    if clamp is None:
        clamp = bool(np.isfinite(problem.joint_limits.jerk).any())
    start = np.stack(problem.start)
    move = JointMove(problem.loaded_arm, problem.joint_limits, Ends(start, start), problem.horizon, clamp)
    _require_within_limits(move, 0, "start", 1.0 + START_TOLERANCE)
    curve = None if guess is None else (lambda s: guess.at(s * guess.duration)[0])
    settings = Settings(objective, nodes - 1, polish, elbow, rendezvous_time, curve, explain, thorough)
    if isinstance(problem.target, MovingHand):
        return _plan_rendezvous(problem, move, settings)
    return _plan_to_rest(problem, move, goal_postures(problem, problem.target, elbow), settings)


def _plan_to_rest(problem: MotionProblem, move: JointMove, goals: Sequence[Array], settings: Settings) -> Trajectory:
    """Come to rest in one of the goal postures at the horizon."""
    still = np.zeros(problem.arm.n_joints)
    goals = holdable(move, goals)
    moves = [move.to(np.stack([goal, still, still]), problem.horizon) for goal in goals]
    if len(moves) == 1:
        _require_within_limits(moves[0], 1, "limits", 1.0)
    fit = _best_fit(moves, settings) if min(map(joint_time, moves)) <= problem.horizon else None
    if fit is None:
        if settings.explain:
            raise late(
                moves,
                settings.objective,
                settings.guess,
                partial(_best_fit, settings=settings._replace(thorough=False)),
            )
        raise too_late(problem.horizon, math.inf)
    t, q, _, qd, qdd, _ = _sample(fit)
    trajectory = sampled_trajectory(problem, t, q, qd, qdd, planner=_PLANNER, rendezvous_time=problem.horizon)
    return _with_cost(trajectory, settings)


def _plan_rendezvous(problem: MotionProblem, move: JointMove, settings: Settings) -> Trajectory:
    """Meet a moving target and follow it with one of the rides."""
    assert isinstance(problem.target, MovingHand)
    rides, given = find_rides(problem, problem.target, settings.elbow), settings.rendezvous_time
    for ride in rides:
        window = ride.window_at(0.0)
        if given is None and window and (np.abs(ride.state_at(0.0) - move.ends.start) < MET).all():
            riding = sample_ride(ride.line, 0.0, min(problem.horizon, window.closes))
            return _with_cost(to_trajectory(ride.line, [riding], window.closes, 0.0, 0.0, _PLANNER), settings)
    if given is not None and not any(ride.window_at(given) for ride in rides):
        raise Infeasible("no_window", f"at {given:.4g} s following the target breaks a limit; choose another time")
    times = [given] if given else _times(rides, move, problem.horizon)
    for time in times:
        open_rides = [(ride, window) for ride in rides if (window := ride.window_at(time)) is not None]
        moves = [move.to(ride.state_at(time), time) for ride, _ in open_rides]
        fit = _best_fit(moves, settings) if moves else None
        if fit is not None:
            break
    else:
        raise too_late(given or problem.horizon, _enough(problem, move, rides, settings))
    ride, window = next(pair for pair, joining in zip(open_rides, moves, strict=True) if joining is fit.minimum.move)
    riding = sample_ride(ride.line, time, max(time, min(problem.horizon, window.closes)))
    trajectory = to_trajectory(ride.line, [_sample(fit), riding], window.closes, time, 0.0, _PLANNER)
    return _with_cost(replace(trajectory, problem=problem), settings)


def _preferred(horizon: float) -> float:
    """Latest rendezvous with time to follow the target until the horizon, s."""
    return max(horizon - SETTLED, 0.5 * horizon)


def _times(rides: Sequence[Ride], move: JointMove, horizon: float) -> list[float]:
    """Times for the rendezvous, s: with a margin over the earliest one, and later ones should that fail."""
    preferred = _preferred(horizon)
    soonest = earliest(rides, move, preferred, horizon)
    if soonest > horizon:
        return []
    closes = max(window.closes for ride in rides for window in ride.windows if window.opens <= soonest)
    time = max(soonest, min(TIME_MARGIN * soonest, preferred, closes))
    latest = min(horizon, closes)
    return [time, *(later for later in (math.sqrt(time * latest), latest) if later > 1.01 * time)]


def _enough(problem: MotionProblem, move: JointMove, rides: Sequence[Ride], settings: Settings) -> float:
    """A time in which a motion is found where none is in the given one, s; inf if there is none."""
    horizon, given = problem.horizon, settings.rendezvous_time
    soonest = earliest(rides, move, horizon, horizon) if settings.explain else math.inf
    if math.isinf(soonest) or (soonest <= horizon and given is None):
        return math.inf
    free = settings._replace(rendezvous_time=None, explain=False, hurry=True)
    for longer in [horizon] if soonest <= horizon else [rounded_up(factor * soonest) for factor in LONGER]:
        with suppress(Infeasible):
            motions = [_plan_rendezvous(replace(problem, horizon=share * longer), move, free) for share in BESIDE]
            for motion in motions:
                require_within_limits(_PLANNER, motion)
            return motions[0].rendezvous_time if longer == horizon else longer
    return math.inf


def _best_fit(moves: Sequence[JointMove], settings: Settings) -> Fit | None:
    if settings.hurry:
        direct = direct_motion(moves, settings.objective)
        return direct or any_motion(moves, settings.objective, settings.guess)
    return least_torque(
        moves, settings.objective, settings.degree, settings.guess, polish=settings.polish, thorough=settings.thorough
    )


def _require_within_limits(move: JointMove, side: int, reason: str, most: float) -> None:
    """Refuse an end of the move that breaks a limit by itself."""
    loads = move.end_loads[side]
    if loads.max() > most:
        raise limit_broken(reason, ("starts at", "is to end at")[side], loads, LIMIT_KINDS)


def _sample(fit: Fit) -> Motion:
    """A fit at equally spaced instants."""
    q, qd, qdd, jerk = fit.minimum.at(fit.samples)
    move = fit.minimum.move
    return Motion(fit.samples.s * move.duration, q, move.arm.inverse_dynamics(q, qd, qdd), qd, qdd, jerk)


def _with_cost(trajectory: Trajectory, settings: Settings) -> Trajectory:
    cost = float(np.trapezoid(torque_rate(trajectory.tau, settings.objective), trajectory.t))
    name = _PLANNER if settings.polish else f"{_PLANNER}, not polished"
    return replace(trajectory, cost=cost, planner=name)
