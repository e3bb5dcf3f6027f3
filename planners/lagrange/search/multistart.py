"""Multistart search for the least torque: coarse solutions, of which the best are refined."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from planners.lagrange.joint_move import Curve, Effort, Index, JointMove, Minimum, Objective, minimise, torque_rate
from planners.lagrange.search.refinement import HURRIED, Fit, coarse_bases, coarse_curve, hurried, polished, refined
from planners.lagrange.search.starts import start_curves, with_detour
from planners.lagrange.transcription import Basis, lagrange_basis
from planners.typing import Array

UNIT_POINTS = 101
COARSE = Effort(barrier=1e-2, tolerance=1e-2, iterations=20)
COARSE_AGAIN = Effort(barrier=1e-3, tolerance=1e-3, iterations=20)
"""For the order of the solutions: a looser tolerance changes it little."""
SWING_ITERATIONS = 40
"""The iterations of both under gravity, where the starts are further from the solutions."""
PROBE_DEGREE, PROBE_POINTS = 14, 57


class Breadth(NamedTuple):
    """How widely is searched.

    Attributes:
        swings: number of random starts of a move.
        starts: most starts of all alternative moves together.
        refined: number of coarse solutions that are refined.
        hops: rounds in which the best solutions are displaced and solved again.
    """

    swings: int
    starts: int
    refined: int
    hops: int


BREADTHS = (Breadth(0, 58, 3, 0), Breadth(40, 58, 16, 2), Breadth(160, 178, 32, 4))
"""In a horizontal plane; for a thorough search there and usual under gravity, where more minima differ; for a thorough
search under gravity."""

MOST_MOVES, FEW_STARTS = 2, 30
"""Number of alternative moves with more starts than the quintic, and of these starts where any motion will do."""

PARENTS, CHILDREN, HOP = 3, 4, 1.0
"""Number of solutions that are displaced in a round, of displacements of each, and the largest displacement, rad."""

SAME_INDEX = 1e-3
"""Relative difference of the index up to which two coarse solutions count as the same."""


def least_torque(
    moves: Sequence[JointMove],
    objective: Objective,
    degree: int,
    guess: Curve | None = None,
    *,
    polish: bool = False,
    thorough: bool = False,
) -> Fit | None:
    """The best motion found among those that any of the moves (such as the branches of the inverse kinematics) allows.

    None if none keeps the limits. ``degree`` is that of the interpolation, ``guess`` a motion to start from too;
    ``polish`` refines by splines in place of the interpolation; ``thorough`` searches a second time, more widely.
    """
    usual = _usual_breadth(moves)
    found = (
        _least_torque(moves, objective, degree, guess, breadth, polish=polish)
        for breadth in BREADTHS[usual : usual + 1 + thorough]
    )
    fits = [fit for fit in found if fit is not None]
    return min(fits, key=lambda fit: fit.minimum.index(objective), default=None)


def _least_torque(
    moves: Sequence[JointMove],
    objective: Objective,
    degree: int,
    guess: Curve | None,
    breadth: Breadth,
    *,
    polish: bool,
) -> Fit | None:
    """The best motion that a search of some breadth finds; see `least_torque`."""
    best, index = _candidates(moves, objective, guess, breadth)
    if polish and (fit := polished(best, index)) is not None:
        return fit
    some = hurried(_starts(best), index) or direct_motion(moves, objective)
    if some is None:
        return None
    fits = (refined(solution, degree, index) for solution in best)
    return next((fit for fit in fits if fit is not None), some)


def direct_motion(moves: Sequence[JointMove], objective: Objective) -> Fit | None:
    """Some motion within the limits, found from the quintics of the moves; `least_torque` finds one then too."""
    return hurried([(move, move.quintic) for move in moves], _index(moves, objective))


def any_motion(moves: Sequence[JointMove], objective: Objective, guess: Curve | None = None) -> Fit | None:
    """As `direct_motion`, in ten times the time, from the best coarse solutions."""
    few = BREADTHS[_usual_breadth(moves)]._replace(starts=FEW_STARTS, hops=0)
    best, index = _candidates(moves, objective, guess, few)
    return hurried(_starts(best), index)


def _usual_breadth(moves: Sequence[JointMove]) -> int:
    """Which of the breadths is the usual one for the moves, which are of one arm."""
    return 1 if moves[0].arm.gravity else 0


def _candidates(
    moves: Sequence[JointMove], objective: Objective, guess: Curve | None, breadth: Breadth
) -> tuple[list[Minimum], Index]:
    """The best coarse solutions of the moves, and the index that they are measured by."""
    index = _index(moves, objective)
    if len(moves) > 1:
        first = [_coarse(move, index.smooth, move.quintic) for move in moves]
        moves = [solution.move for solution in _best(first, objective, MOST_MOVES)]
    share = breadth.starts // len(moves)
    solutions = [each for move in moves for each in _solutions(move, index, breadth, slice(share), guess)]
    if len(moves) > 1:
        best = _best(solutions, objective, 1)[0].move
        solutions += _solutions(best, index, breadth, slice(share, breadth.starts), None)
    solutions += _hopped(index, solutions, breadth)
    return _best(solutions, objective, breadth.refined), index


def _starts(solutions: Sequence[Minimum]) -> list[tuple[JointMove, Curve]]:
    """Coarse solutions as starts for a search on finer functions."""
    return [(solution.move, coarse_curve(solution)) for solution in solutions]


def _index(moves: Sequence[JointMove], objective: Objective) -> Index:
    """The index that alternative moves are compared by."""
    return Index(objective, max(torque_unit(move, objective) for move in moves))


def torque_unit(move: JointMove, objective: Objective) -> float:
    """Mean torque of the quintic (for PI2 its root mean square), N m: the unit in which the index is close to 1."""
    s = np.linspace(0.0, 1.0, UNIT_POINTS)
    q = move.quintic(s)
    rates = np.gradient(q, s, axis=0) / move.duration
    tau = move.arm.inverse_dynamics(q, rates, np.gradient(rates, s, axis=0) / move.duration)
    mean = torque_rate(tau, objective).mean()
    return max(float(mean if objective == "PI1" else np.sqrt(mean)), 1e-9)


def reaches(move: JointMove) -> bool:
    """Whether a motion close to the quintic keeps the limits: quick, and may miss some."""
    basis = lagrange_basis(PROBE_DEGREE, move.clamp_acceleration, PROBE_POINTS)
    q = move.quintic(basis.s)
    return minimise(move, basis, q, Index("PI2", torque_unit(move, "PI2")), HURRIED).feasible


def _best(solutions: Sequence[Minimum], objective: Objective, most: int) -> list[Minimum]:
    """The best solutions, no two of the same index, best first; those that keep the limits before the others."""
    scored = sorted(((not solution.feasible, solution.index(objective)), i) for i, solution in enumerate(solutions))
    best: list[tuple[float, int]] = []
    for (_, value), i in scored:
        if len(best) < most and not (best and abs(value - best[-1][0]) < SAME_INDEX * value):
            best.append((value, i))
    return [solutions[i] for _, i in best]


def _solutions(move: JointMove, index: Index, breadth: Breadth, starts: slice, guess: Curve | None) -> list[Minimum]:
    """Local minima with few nodes: of PI2 from every start, which is the smoother problem, then of the objective."""
    curves = [*start_curves(move, breadth.swings)[starts], *([guess] if guess else [])]
    solutions = [_coarse(move, index.smooth, curve) for curve in curves]
    if index.objective == "PI2":
        return solutions
    best = _best(solutions, index.objective, breadth.refined)
    return [_coarse_again(move, index, solution.basis, solution.at(solution.basis)[0]) for solution in best]


def _hopped(index: Index, solutions: Sequence[Minimum], breadth: Breadth) -> list[Minimum]:
    """The solutions to which the best of some lead when they are displaced, again and again (basin hopping)."""
    found: list[Minimum] = []
    for displacements in _displacements(solutions[0].move.arm.n_joints, breadth.hops):
        best = _best([*solutions, *found], index.objective, PARENTS)
        for parent, pairs in zip(best, displacements, strict=False):  # there may be fewer solutions
            angles = parent.at(parent.basis)[0]
            for detour, lean in pairs:
                displaced = with_detour(parent.move, angles, detour, lean, parent.basis.s)
                found.append(_coarse_again(parent.move, index, parent.basis, displaced))
    return found


def _coarse(move: JointMove, index: Index, curve: Curve) -> Minimum:
    """A local minimum with few unknowns from a start."""
    basis = coarse_bases(move)[0]
    return minimise(move, basis, curve(basis.s), index, _effort(move, COARSE))


def _coarse_again(move: JointMove, index: Index, basis: Basis, q: Array) -> Minimum:
    """A local minimum from joint angles ``q`` at the instants of a basis, ``(points, n)``, rad."""
    return minimise(move, basis, q, index, _effort(move, COARSE_AGAIN))


def _effort(move: JointMove, effort: Effort) -> Effort:
    return effort._replace(iterations=SWING_ITERATIONS) if move.arm.gravity else effort


@lru_cache
def _displacements(n: int, hops: int) -> Array:
    """Detour at half time and lean of every displacement, ``(hops, PARENTS, CHILDREN, 2, n)``, rad."""
    return np.random.default_rng(n).uniform(-HOP, HOP, (hops, PARENTS, CHILDREN, 2, n))
