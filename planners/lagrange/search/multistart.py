"""Multistart search for the least torque: coarse solutions, of which the best are refined."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache, partial

import numpy as np

from planners.lagrange.joint_move import Curve, Effort, Index, JointMove, Minimum, Objective, minimise, torque_rate
from planners.lagrange.search.refinement import HURRIED, Fit, coarse_bases, coarse_curve, hurried, polished, refined
from planners.lagrange.transcription import lagrange_basis
from planners.typing import Array

UNIT_POINTS = 101
COARSE = Effort(barrier=1e-2, tolerance=1e-2, iterations=20)
COARSE_AGAIN = Effort(barrier=1e-3, tolerance=1e-3, iterations=20)
"""For the order of the solutions: a looser tolerance changes it little."""
PROBE_DEGREE, PROBE_POINTS = 14, 57

MOST_REFINED, MOST_SWINGS = 3, 8
"""Number of coarse solutions that are refined, and the same under gravity, where more of them differ."""

MOST_MOVES, MOST_STARTS = 2, 30
"""Number of alternative moves with more starts than the quintic, and of these starts altogether."""

SWINGS, SWING_REACH = 20, (1.5, 2.6)
"""Number of random starts under gravity, and their largest detour of the first and of the other joints, rad."""

SAME_INDEX = 1e-3
"""Relative difference of the index up to which two coarse solutions count as the same."""

FOLD, TURN = 2.0, 1.0
"""Displacements from the quintic at half time: of the outer joints in a fold, of the first one alone, rad."""

INSIDE = 0.95
"""Share of the joint ranges that the starts use."""

FASTEST_DETOUR = 2.0
"""Starts whose detour alone needs more than this multiple of the velocity limit are left out."""


def least_torque(
    moves: Sequence[JointMove], objective: Objective, degree: int, guess: Curve | None = None, *, polish: bool = False
) -> Fit | None:
    """The best motion found among those that any of the moves (such as the branches of the inverse kinematics) allows.

    None if none keeps the limits. ``degree`` is that of the interpolation, ``guess`` a motion to start from too;
    ``polish`` refines by splines in place of the interpolation.
    """
    best, index = _candidates(moves, objective, guess)
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
    """As `direct_motion`, in ten times the time, from the best coarse solutions of `least_torque`."""
    best, index = _candidates(moves, objective, guess)
    return hurried(_starts(best), index)


def _candidates(moves: Sequence[JointMove], objective: Objective, guess: Curve | None) -> tuple[list[Minimum], Index]:
    """The best coarse solutions of the moves, and the index that they are measured by."""
    index = _index(moves, objective)
    if len(moves) > 1:
        first = [_coarse(move, index.smooth, move.quintic) for move in moves]
        moves = [solution.move for solution in _best(first, objective)[:MOST_MOVES]]
    share = MOST_STARTS // len(moves)
    solutions = [solution for move in moves for solution in _solutions(move, index, slice(share), guess)]
    if len(moves) > 1:
        solutions += _solutions(_best(solutions, objective)[0].move, index, slice(share, None), None)
    return _best(solutions, objective), index


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
    basis = coarse_bases(move)[0]
    return minimise(move, basis, curve(basis.s), index, COARSE)


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
