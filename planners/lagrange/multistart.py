"""The search for the least torque: many sketches with few nodes, the best of them refined and checked densely."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from planners.lagrange.joint_move import KINDS, Curve, Effort, JointMove, Minimum, Objective, minimise
from planners.lagrange.starts import start_curves
from planners.lagrange.transcription import Basis, lagrange_basis, spline_basis
from planners.typing import Array

SKETCH_DEGREE, SKETCH_POINTS = 10, 49
POINTS_PER_DEGREE = 4
DENSE_POINTS, SAMPLES, UNIT_POINTS = 1201, 401, 101
DENSE_LOAD = 1.0 - 1e-5
"""Largest load a plan may show on the dense grid: a little less than 1, for what lies between two instants."""


SKETCH = Effort(barrier=1e-2, tolerance=1e-4, iterations=45)
RESKETCH = Effort(barrier=1e-3, tolerance=1e-4, iterations=40)
REFINE = Effort(barrier=1e-3, tolerance=3e-5, iterations=100)
REPAIR = Effort(barrier=1e-4, tolerance=3e-5, iterations=60)
PROBE = Effort(barrier=1e-2, tolerance=math.inf, iterations=40)
"""For a motion that just keeps the limits."""

PROBE_DEGREE, PROBE_POINTS = 14, 57

POLISH = Effort(barrier=1e-5, tolerance=1e-5, iterations=150)
STAGES, POINTS_PER_STAGE, SAMPLES_PER_STAGE, DENSE_PER_STAGE = 150, 2, 4, 8
"""Of the dense transcription: cubic splines, the acceleration linear on every stage."""

RIVALS = 3
"""How many sketches are followed up."""

MOST_MOVES, MOST_STARTS = 2, 10
"""How many alternative moves are sketched from more than the quintic, and from how many starts altogether."""

ALIKE = 1e-3
"""Relative difference of the index up to which two sketches count as one."""

OVERSHOOT = 1e-6
"""How much further, as a fraction of the limit, a joint may go where an end of the move lies on the limit itself."""

FIRST_TIGHTENING = 1.0 - 5e-4
BACK_OFF, ATTEMPTS = 1e-4, 6
"""How much tighter than the excess the limits become for the next attempt, and how many there are."""


class Fit(NamedTuple):
    """A motion within its limits: on its basis, with the same functions at equally spaced instants, and with the worst
    value / limit of every kind on the dense grid.
    """

    minimum: Minimum
    samples: Basis
    limit_ratios: dict[str, float]

    @property
    def curve(self) -> Curve:
        """The motion as a start for another search."""
        s, q = self.samples.s, self.minimum.seen_on(self.samples)[0]
        return lambda at: np.stack([np.interp(at, s, angles) for angles in q.T], axis=1)


def least_torque(
    moves: Sequence[JointMove], objective: Objective, degree: int, guess: Curve | None = None
) -> Fit | None:
    """The best motion found among those that any of the moves (such as the branches of the inverse kinematics) allows.

    None if none keeps the limits. ``degree`` is that of the interpolation, ``guess`` a motion to start from too.
    """
    unit = max(torque_unit(move, objective) for move in moves)
    if len(moves) > 1:
        first = [_sketch(move, "PI2", move.quintic, unit) for move in moves]
        moves = [sketch.move for sketch in rank(first, objective)[:MOST_MOVES]]
    share = MOST_STARTS // len(moves)
    sketches = [sketch for move in moves for sketch in _sketches(move, objective, unit, slice(share), guess)]
    if len(moves) > 1:
        sketches += _sketches(rank(sketches, objective)[0].move, objective, unit, slice(share, None), None)
    for sketch in rank(sketches, objective):
        fit = refine(sketch, objective, degree, unit)
        if fit is not None:
            return fit
    return None


def torque_unit(move: JointMove, objective: Objective) -> float:
    """Mean torque of the quintic (for PI2 its root mean square), N m: the unit in which the index is close to 1."""
    s = np.linspace(0.0, 1.0, UNIT_POINTS)
    q = move.quintic(s)
    rates = np.gradient(q, s, axis=0) / move.duration
    tau = move.arm.inverse_dynamics(q, rates, np.gradient(rates, s, axis=0) / move.duration)
    mean = np.abs(tau).sum(axis=1).mean() if objective == "PI1" else np.sqrt(np.square(tau).sum(axis=1).mean())
    return max(float(mean), 1e-9)


def rank(sketches: Sequence[Minimum], objective: Objective) -> list[Minimum]:
    """The best sketches, no two alike, best first; those that keep the limits before those that do not."""
    scored = sorted(((not sketch.feasible, sketch.index(objective)), i) for i, sketch in enumerate(sketches))
    best: list[tuple[tuple[bool, float], int]] = []
    for score, i in scored:
        if len(best) < RIVALS and not (best and abs(score[1] - best[-1][0][1]) < ALIKE * score[1]):
            best.append((score, i))
    return [sketches[i] for _, i in best]


def refine(sketch: Minimum, objective: Objective, degree: int, unit: float) -> Fit | None:
    """The sketch on a finer basis, tightened until it keeps the limits on the dense grid; None if it never does."""
    move = sketch.move
    basis = lagrange_basis(degree, move.clamp_acceleration, POINTS_PER_DEGREE * degree + 1)
    dense = lagrange_basis(degree, move.clamp_acceleration, DENSE_POINTS)
    sketched = lagrange_basis(SKETCH_DEGREE, move.clamp_acceleration, POINTS_PER_DEGREE * degree + 1)
    samples = lagrange_basis(degree, move.clamp_acceleration, SAMPLES, uniform=True)
    found = within_limits(move, basis, dense, sketch.seen_on(sketched)[0], objective, unit, (REFINE, REPAIR))
    return None if found is None else Fit(found[0], samples, found[1])


def polished(fit: Fit, objective: Objective) -> Fit:
    """The local minimum among splines close to a motion, if it is the better one."""
    move = fit.minimum.move
    basis = spline_basis(STAGES, move.clamp_acceleration, POINTS_PER_STAGE)
    dense = spline_basis(STAGES, move.clamp_acceleration, DENSE_PER_STAGE)
    samples = spline_basis(STAGES, move.clamp_acceleration, SAMPLES_PER_STAGE)
    unit = torque_unit(move, objective)
    found = within_limits(move, basis, dense, fit.curve(basis.s), objective, unit, (POLISH, POLISH))
    if found is None or found[0].index(objective, samples) > fit.minimum.index(objective, fit.samples):
        return fit
    return Fit(found[0], samples, found[1])


def within_limits(
    move: JointMove,
    basis: Basis,
    dense: Basis,
    q: Array,
    objective: Objective,
    unit: float,
    efforts: tuple[Effort, Effort],
) -> tuple[Minimum, dict[str, float]] | None:
    """A local minimum that keeps the limits on a dense grid, by backing off where it does not, with its limit ratios.

    It starts from joint angles ``q`` at the instants of ``basis``, ``(points, n)``, rad; ``dense`` has the same
    functions on a dense grid, and ``efforts`` are those from this start and from close by. ``unit`` is the torque
    that counts as 1, N m.
    """
    given = move.end_loads.max(axis=(0, 2))
    allowed = np.where(given > DENSE_LOAD, np.maximum(1.0, given + OVERSHOOT), DENSE_LOAD)
    tightening = np.full(len(KINDS), FIRST_TIGHTENING)
    start, effort = q, efforts[0]
    for _ in range(ATTEMPTS):
        minimum = minimise(move, basis, start, objective, tightening, unit, effort)
        loads = dense_loads(minimum, dense)
        if (loads <= allowed).all():
            return minimum, dict(zip(KINDS, loads.tolist(), strict=True))
        if not minimum.feasible:
            return None
        tightening *= np.where(loads > allowed, (1.0 - BACK_OFF) * allowed / np.maximum(loads, allowed), 1.0)
        start, effort = minimum.seen_on(basis)[0], efforts[1]
    return None


def dense_loads(minimum: Minimum, dense: Basis) -> Array:
    """Worst |value| / limit of every kind at the instants of a basis of the same functions, ``(5,)``."""
    move = minimum.move
    q, qd, qdd, jerk = minimum.seen_on(dense)
    values = np.stack([move.arm.inverse_dynamics(q, qd, qdd), qd, qdd, jerk, q])
    loads: Array = np.max(np.abs(values) / move.limit_table[:, None], axis=(1, 2))
    return loads


def reaches(move: JointMove) -> bool:
    """Whether a motion close to the quintic keeps the limits: a quick answer, and a cautious one."""
    basis = lagrange_basis(PROBE_DEGREE, move.clamp_acceleration, PROBE_POINTS)
    return _minimise(move, basis, move.quintic(basis.s), "PI2", torque_unit(move, "PI2"), PROBE).feasible


def _sketches(move: JointMove, objective: Objective, unit: float, starts: slice, guess: Curve | None) -> list[Minimum]:
    """Local minima with few nodes: of PI2 from every start, which is the smoother problem, then of the objective."""
    curves = [*start_curves(move)[starts], *([guess] if guess else [])]
    sketches = [_sketch(move, "PI2", curve, unit) for curve in curves]
    if objective == "PI2":
        return sketches
    basis = _sketch_basis(move)
    return [
        _minimise(move, basis, sketch.seen_on(basis)[0], objective, unit, RESKETCH)
        for sketch in rank(sketches, objective)
    ]


def _sketch(move: JointMove, objective: Objective, curve: Curve, unit: float) -> Minimum:
    basis = _sketch_basis(move)
    return _minimise(move, basis, curve(basis.s), objective, unit, SKETCH)


def _sketch_basis(move: JointMove) -> Basis:
    return lagrange_basis(SKETCH_DEGREE, move.clamp_acceleration, SKETCH_POINTS)


def _minimise(move: JointMove, basis: Basis, q: Array, objective: Objective, unit: float, effort: Effort) -> Minimum:
    return minimise(move, basis, q, objective, np.full(len(KINDS), FIRST_TIGHTENING), unit, effort)
