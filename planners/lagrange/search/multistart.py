"""Multistart search for the least torque: coarse solutions, the best refined and checked on a dense grid."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np

from planners.lagrange.joint_move import (
    FIRST_TIGHTENING,
    Curve,
    Effort,
    Index,
    JointMove,
    Minimum,
    Objective,
    minimise,
    torque_rate,
)
from planners.lagrange.transcription import Basis, lagrange_basis, spline_basis
from planners.problem import FixedJoints, MotionProblem
from planners.robot.limits import LIMIT_KINDS
from planners.trajectory import sampled_trajectory
from planners.typing import Array

COARSE_DEGREE, COARSE_POINTS = 10, 49
POINTS_PER_DEGREE = 4
DENSE_POINTS, SAMPLES, UNIT_POINTS = 1201, 401, 101
DENSE_LOAD = 1.0 - 1e-5
"""Largest load of a plan on the dense grid: less than 1 to allow for larger values between two instants."""

COARSE = Effort(barrier=1e-2, tolerance=1e-2, iterations=20)
COARSE_AGAIN = Effort(barrier=1e-3, tolerance=1e-3, iterations=20)
"""For the order of the solutions: a looser tolerance changes it little."""
REFINE = Effort(barrier=1e-3, tolerance=3e-5, iterations=100)
REPAIR = Effort(barrier=1e-4, tolerance=3e-5, iterations=60)
PROBE = Effort(barrier=1e-2, tolerance=math.inf, iterations=40)
"""For any motion within the limits."""

PROBE_DEGREE, PROBE_POINTS = 14, 57

POLISH = Effort(barrier=1e-3, tolerance=1e-3, iterations=60)
POLISH_FINE = Effort(barrier=1e-5, tolerance=3e-5, iterations=60)
STAGES, FINE_STAGES = 30, 90
"""Of the splines (the acceleration is linear on every stage) that choose among coarse solutions, and of the motion."""

COARSE_STAGES = 20
"""Of the coarse solutions under gravity, which are splines too: the best motions swing almost freely."""
SWING_TIME, FEWEST_PARTS, MOST_PARTS = 1.75, 3, 6
"""Length of a part of a motion under gravity, in sqrt(reach / gravity), and least and largest number of parts."""
STAGES_PER_PART, FINE_STAGES_PER_PART = 10, 50
"""`STAGES` and `FINE_STAGES` under gravity: the torque left in a swing is small against the error of few stages."""

POINTS_PER_STAGE, DENSE_PER_STAGE, SPLINE_SAMPLES = 2, 8, 480
"""Instants of the search and of the dense grid on every stage, and least number of samples altogether."""

MOST_REFINED, MOST_SWINGS = 3, 8
"""Number of coarse solutions that are refined, and the same under gravity, where more of them differ."""

MOST_MOVES, MOST_STARTS = 2, 30
"""Number of alternative moves with more starts than the quintic, and of these starts altogether."""

SWINGS, SWING_REACH = 20, (1.5, 2.6)
"""Number of random starts under gravity, and their largest detour of the first and of the other joints, rad."""

SAME_INDEX = 1e-3
"""Relative difference of the index up to which two coarse solutions count as the same."""

OVERSHOOT = 1e-6
"""Excess, as a fraction of the limit, that is accepted where an end of the move lies on the limit itself."""

FOLD, TURN = 2.0, 1.0
"""Displacements from the quintic at half time: of the outer joints in a fold, of the first one alone, rad."""

INSIDE = 0.95
"""Share of the joint ranges that the starts use."""

FASTEST_DETOUR = 2.0
"""Starts whose detour alone needs more than this multiple of the velocity limit are left out."""

BACK_OFF, ATTEMPTS = 1e-4, 6
"""Tightening of the limits beyond the excess for the next attempt, and the number of attempts."""


class Fit(NamedTuple):
    """A motion within its limits: on its basis, and with the same functions at equally spaced instants."""

    minimum: Minimum
    samples: Basis

    @property
    def curve(self) -> Curve:
        """The motion as a start for another search."""
        s, q = self.samples.s, self.minimum.at(self.samples)[0]
        return lambda instants: np.stack([np.interp(instants, s, angles) for angles in q.T], axis=1)


class Bases(NamedTuple):
    """The same functions at the instants of the search, on a dense grid, and at equally spaced samples."""

    search: Basis
    dense: Basis
    samples: Basis


def least_torque(
    moves: Sequence[JointMove], objective: Objective, degree: int, guess: Curve | None = None, *, polish: bool = False
) -> Fit | None:
    """The best motion found among those that any of the moves (such as the branches of the inverse kinematics) allows.

    None if none keeps the limits. ``degree`` is that of the interpolation, ``guess`` a motion to start from too;
    ``polish`` refines by splines in place of the interpolation.
    """
    index = Index(objective, max(torque_unit(move, objective) for move in moves))
    if len(moves) > 1:
        first = [_coarse(move, index.smooth, move.quintic) for move in moves]
        moves = [solution.move for solution in _best(first, objective)[:MOST_MOVES]]
    share = MOST_STARTS // len(moves)
    solutions = [solution for move in moves for solution in _solutions(move, index, slice(share), guess)]
    if len(moves) > 1:
        solutions += _solutions(_best(solutions, objective)[0].move, index, slice(share, None), None)
    best = _best(solutions, objective)
    if polish and (fit := _polished(best, index)) is not None:
        return fit
    return next((fit for solution in best if (fit := _refine(solution, degree, index)) is not None), None)


def torque_unit(move: JointMove, objective: Objective) -> float:
    """Mean torque of the quintic (for PI2 its root mean square), N m: the unit in which the index is close to 1."""
    s = np.linspace(0.0, 1.0, UNIT_POINTS)
    q = move.quintic(s)
    rates = np.gradient(q, s, axis=0) / move.duration
    tau = move.arm.inverse_dynamics(q, rates, np.gradient(rates, s, axis=0) / move.duration)
    mean = torque_rate(tau, objective).mean()
    return max(float(mean if objective == "PI1" else np.sqrt(mean)), 1e-9)


def reaches(move: JointMove, start: Curve | None = None) -> bool:
    """Whether a motion close to a start, by default the quintic, keeps the limits: quick, and may miss some."""
    basis = lagrange_basis(PROBE_DEGREE, move.clamp_acceleration, PROBE_POINTS)
    q = (start or move.quintic)(basis.s)
    return minimise(move, basis, q, Index("PI2", torque_unit(move, "PI2")), PROBE).feasible


def _best(solutions: Sequence[Minimum], objective: Objective) -> list[Minimum]:
    """The best solutions, no two of the same index, best first; those that keep the limits before the others."""
    scored = sorted(((not solution.feasible, solution.index(objective)), i) for i, solution in enumerate(solutions))
    most = MOST_SWINGS if any(solution.move.arm.gravity for solution in solutions) else MOST_REFINED
    best: list[tuple[float, int]] = []
    for (_, value), i in scored:
        if len(best) < most and not (best and abs(value - best[-1][0]) < SAME_INDEX * value):
            best.append((value, i))
    return [solutions[i] for _, i in best]


def _solutions(move: JointMove, index: Index, starts: slice, guess: Curve | None) -> list[Minimum]:
    """Local minima with few nodes: of PI2 from every start, which is the smoother problem, then of the objective."""
    curves = [*_start_curves(move)[starts], *([guess] if guess else [])]
    solutions = [_coarse(move, index.smooth, curve) for curve in curves]
    if index.objective == "PI2":
        return solutions
    return [
        minimise(move, solution.basis, solution.at(solution.basis)[0], index, COARSE_AGAIN)
        for solution in _best(solutions, index.objective)
    ]


def _coarse(move: JointMove, index: Index, curve: Curve) -> Minimum:
    """A local minimum with few unknowns from a start."""
    basis = _coarse_bases(move)[0]
    return minimise(move, basis, curve(basis.s), index, COARSE)


def _coarse_bases(move: JointMove) -> tuple[Basis, Basis]:
    """The functions of the coarse solutions at the instants of the search and at equally spaced samples."""
    if move.arm.gravity:
        return _spline_bases(move, COARSE_STAGES)
    clamp = move.clamp_acceleration
    search = lagrange_basis(COARSE_DEGREE, clamp, COARSE_POINTS)
    return search, lagrange_basis(COARSE_DEGREE, clamp, SAMPLES, uniform=True)


def _spline_bases(move: JointMove, stages: int) -> tuple[Basis, Basis]:
    """Splines at the instants of the search and at equally spaced samples."""
    counts = POINTS_PER_STAGE, -(-SPLINE_SAMPLES // stages)
    search, samples = (spline_basis(stages, move.clamp_acceleration, count) for count in counts)
    return search, samples


def _stages(move: JointMove) -> tuple[int, int]:
    """Stages of the splines that choose among coarse solutions, and of the motion."""
    if not move.arm.gravity:
        return STAGES, FINE_STAGES
    parts = move.duration / (SWING_TIME * math.sqrt(move.arm.reach / move.arm.gravity))
    count = math.ceil(min(max(parts, FEWEST_PARTS), MOST_PARTS))
    return STAGES_PER_PART * count, FINE_STAGES_PER_PART * count


def _refine(solution: Minimum, degree: int, index: Index) -> Fit | None:
    """A coarse solution on a finer basis within the limits of the dense grid; None if there is none."""
    move, points = solution.move, POINTS_PER_DEGREE * degree + 1
    clamp = move.clamp_acceleration
    bases = Bases(
        lagrange_basis(degree, clamp, points),
        lagrange_basis(degree, clamp, DENSE_POINTS),
        lagrange_basis(degree, clamp, SAMPLES, uniform=True),
    )
    start = Fit(solution, _coarse_bases(move)[1]).curve(bases.search.s)
    return _within_limits(move, bases, start, index, (REFINE, REPAIR))


def _polished(solutions: Sequence[Minimum], index: Index) -> Fit | None:
    """The best of the coarse solutions on splines within the limits of the dense grid; None if there is none."""
    stages, fine = _stages(solutions[0].move)  # all moves take the same time
    fits = []
    for solution in solutions:
        search, samples = _spline_bases(solution.move, stages)
        start = Fit(solution, _coarse_bases(solution.move)[1]).curve(search.s)
        fits.append(Fit(minimise(solution.move, search, start, index, POLISH), samples))
    fits.sort(key=lambda fit: (not fit.minimum.feasible, fit.minimum.index(index.objective)))
    kept = (_on_splines(fit, count, index) for count in (fine, stages) for fit in fits)
    return next((fit for fit in kept if fit is not None), None)


def _on_splines(fit: Fit, stages: int, index: Index) -> Fit | None:
    """The local minimum among splines of so many stages that a motion leads to, within the limits."""
    move = fit.minimum.move
    search, samples = _spline_bases(move, stages)
    bases = Bases(search, spline_basis(stages, move.clamp_acceleration, DENSE_PER_STAGE), samples)
    return _within_limits(move, bases, fit.curve(search.s), index, (POLISH_FINE, POLISH_FINE))


def _within_limits(move: JointMove, bases: Bases, q: Array, index: Index, efforts: tuple[Effort, Effort]) -> Fit | None:
    """A local minimum that keeps the limits on the dense grid and between the samples, by tightening them where it does
    not.

    It starts from joint angles ``q`` at the instants of the search, ``(points, n)``, rad; ``efforts`` are those of the
    first and of the later attempts, which start close by.
    """
    given = move.end_loads.max(axis=(0, 2))
    allowed = np.where(given > DENSE_LOAD, np.maximum(1.0, given + OVERSHOOT), DENSE_LOAD)
    tightening = np.full(len(LIMIT_KINDS), FIRST_TIGHTENING)
    start, effort = q, efforts[0]
    for _ in range(ATTEMPTS):
        minimum = minimise(move, bases.search, start, index, effort, tightening)
        loads = _loads(minimum, bases.dense)
        if (loads <= allowed).all():
            loads = np.maximum(loads, _measured_loads(minimum, bases.samples))
            if (loads <= np.maximum(1.0, allowed)).all():
                return Fit(minimum, bases.samples)
        if not minimum.feasible:
            return None
        tightening *= np.where(loads > allowed, (1.0 - BACK_OFF) * allowed / np.maximum(loads, allowed), 1.0)
        start, effort = minimum.at(bases.search)[0], efforts[1]
    return None


def _loads(minimum: Minimum, basis: Basis) -> Array:
    """Worst |value| / limit of every kind at the instants of a basis of the same functions, ``(5,)``."""
    q, qd, qdd, jerk = minimum.at(basis)
    move = minimum.move
    values = np.stack([move.arm.inverse_dynamics(q, qd, qdd), qd, qdd, jerk, q - move.limits.angle_middle])
    loads: Array = np.max(np.abs(values) / move.limit_table[:, None], axis=(1, 2))
    return loads


def _measured_loads(minimum: Minimum, samples: Basis) -> Array:
    """Worst |value| / limit of every kind on the continuous motion between samples, ``(5,)``."""
    move = minimum.move
    q, qd, qdd, _ = minimum.at(samples)
    start, end = move.ends
    problem = MotionProblem(move.arm, start[0], FixedJoints(end[0]), move.duration, limits=move.limits)
    return sampled_trajectory(problem, samples.s * move.duration, q, qd, qdd, planner="lagrange").measured.ratios


def _start_curves(move: JointMove) -> list[Curve]:
    """The quintic, an extended one, swings and folds in every direction; under gravity also random detours."""
    n = move.arm.n_joints
    outer: Array = np.where(np.arange(n) > 0, 1.0, 0.0)
    alternating: Array = np.where(np.arange(n) % 2 == 0, outer, -outer)
    patterns = [TURN * (1.0 - outer), *(FOLD * pattern for pattern in (alternating, outer)[: n - 1])]
    detours = [side * pattern for pattern in patterns for side in (1.0, -1.0)]
    # the fastest part of a detour takes about a third of the time
    longest = FASTEST_DETOUR * np.array(move.limits.velocity) * move.duration / 3.0
    possible = [detour for detour in detours if (np.abs(detour) <= longest).all()]
    return [
        move.quintic,
        partial(_curve, move, np.zeros(n), -outer),
        *(partial(_curve, move, detour, np.zeros(n)) for detour in possible),
        *(partial(_swing, move, *pair) for pair in _swings(n) if move.arm.gravity),
    ]


@lru_cache
def _swings(n: int) -> Array:
    """Detour at half time and lean of every random start, ``(SWINGS, 2, n)``, rad: the same for every move."""
    reach = np.where(np.arange(n) > 0, SWING_REACH[1], SWING_REACH[0])
    return np.random.default_rng(n).uniform(-reach, reach, (SWINGS, 2, n))


def _curve(move: JointMove, detour: Array, share: Array, s: Array) -> Array:
    """The quintic plus, at half time, ``detour`` (rad) and a ``share`` of itself, within the joint ranges."""
    quintic = move.quintic(s)
    return _in_range(move, quintic, detour + share * quintic, s)


def _swing(move: JointMove, detour: Array, lean: Array, s: Array) -> Array:
    """The quintic plus a detour that leans to the start, or against it, within the joint ranges."""
    return _in_range(move, move.quintic(s), detour + (1.0 - 2.0 * s)[:, None] * lean, s)


def _in_range(move: JointMove, quintic: Array, detour: Array, s: Array) -> Array:
    """The quintic plus a detour that is in full at half time and fades to the ends, within the joint ranges."""
    half_way = (16.0 * (s * (1.0 - s)) ** 2)[:, None]
    middle = move.limits.angle_middle
    reach = np.maximum(INSIDE * move.limits.angle_half, np.abs(quintic - middle).max(axis=0))
    return middle + np.clip(quintic + half_way * detour - middle, -reach, reach)
