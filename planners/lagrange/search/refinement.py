"""Refinement of coarse solutions: on finer functions of time, within the limits of a dense grid."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from planners.lagrange.joint_move import FIRST_TIGHTENING, Curve, Effort, Index, JointMove, Minimum, minimise
from planners.lagrange.transcription import Basis, lagrange_basis, spline_basis
from planners.problem import FixedJoints, MotionProblem
from planners.robot.limits import LIMIT_KINDS
from planners.trajectory import sampled_trajectory
from planners.typing import Array

COARSE_DEGREE, COARSE_POINTS = 10, 49
POINTS_PER_DEGREE = 4
DENSE_POINTS, SAMPLES = 1201, 401
DENSE_LOAD = 1.0 - 1e-5
"""Largest load of a plan on the dense grid: less than 1 to allow for larger values between two instants."""

REFINE = Effort(barrier=1e-3, tolerance=3e-5, iterations=100)
REPAIR = Effort(barrier=1e-4, tolerance=3e-5, iterations=60)
HURRIED = Effort(barrier=1e-2, tolerance=math.inf, iterations=40)
"""For any motion within the limits, from a coarse solution or from a start of the search."""

POLISH = Effort(barrier=1e-3, tolerance=1e-3, iterations=60)
POLISH_FINE = Effort(barrier=1e-5, tolerance=3e-5, iterations=60)
STAGES, FINE_STAGES = 30, 90
"""Of the splines (the acceleration is linear on every stage) that choose among coarse solutions, and of the motion."""

SWING_TIME, FEWEST_PARTS, MOST_PARTS = 1.75, 3, 6
"""Length of a part of a motion under gravity, in sqrt(reach / gravity), and least and largest number of parts."""
COARSE_STAGES, COARSE_STAGES_PER_PART = 12, 4
"""Of the coarse solutions under gravity, which are splines too: the best motions swing almost freely."""
STAGES_PER_PART, FINE_STAGES_PER_PART = 10, 50
"""`STAGES` and `FINE_STAGES` under gravity: the torque left in a swing is small against the error of few stages."""

POINTS_PER_STAGE, DENSE_PER_STAGE, SPLINE_SAMPLES = 2, 8, 480
"""Instants of the search and of the dense grid on every stage, and least number of samples altogether."""

OVERSHOOT = 1e-6
"""Excess, as a fraction of the limit, that is accepted where an end of the move lies on the limit itself."""

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


def coarse_bases(move: JointMove) -> tuple[Basis, Basis]:
    """The functions of the coarse solutions at the instants of the search and at equally spaced samples."""
    if move.arm.gravity:
        return _spline_bases(move, COARSE_STAGES + COARSE_STAGES_PER_PART * _parts(move))
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
    count = _parts(move)
    return STAGES_PER_PART * count, FINE_STAGES_PER_PART * count


def _parts(move: JointMove) -> int:
    """Number of parts of a motion under gravity."""
    parts = move.duration / (SWING_TIME * math.sqrt(move.arm.reach / abs(move.arm.gravity)))
    return math.ceil(min(max(parts, FEWEST_PARTS), MOST_PARTS))


def refined(solution: Minimum, degree: int, index: Index) -> Fit | None:
    """A coarse solution on an interpolation of a higher degree within the limits of the dense grid; None if there is
    none.
    """
    move, points = solution.move, POINTS_PER_DEGREE * degree + 1
    clamp = move.clamp_acceleration
    bases = Bases(
        lagrange_basis(degree, clamp, points),
        lagrange_basis(degree, clamp, DENSE_POINTS),
        lagrange_basis(degree, clamp, SAMPLES, uniform=True),
    )
    return _within_limits(move, bases, coarse_curve(solution)(bases.search.s), index, (REFINE, REPAIR))


def polished(solutions: Sequence[Minimum], index: Index) -> Fit | None:
    """The best of the coarse solutions on splines within the limits of the dense grid; None if there is none."""
    stages, fine = _stages(solutions[0].move)  # all moves take the same time
    fits = []
    for solution in solutions:
        search, samples = _spline_bases(solution.move, stages)
        start = coarse_curve(solution)(search.s)
        fits.append(Fit(minimise(solution.move, search, start, index, POLISH), samples))
    fits.sort(key=lambda fit: (not fit.minimum.feasible, fit.minimum.index(index.objective)))
    kept = (
        _on_splines(fit.minimum.move, fit.curve, count, index, POLISH_FINE) for count in (fine, stages) for fit in fits
    )
    return next((fit for fit in kept if fit is not None), None)


def hurried(starts: Iterable[tuple[JointMove, Curve]], index: Index) -> Fit | None:
    """The first motion on splines within the limits, whatever its torque, that one of the starts leads to."""
    kept = (_on_splines(move, curve, _stages(move)[0], index, HURRIED) for move, curve in starts)
    return next((fit for fit in kept if fit is not None), None)


def coarse_curve(solution: Minimum) -> Curve:
    """A coarse solution as a start for another search."""
    return Fit(solution, coarse_bases(solution.move)[1]).curve


def _on_splines(move: JointMove, curve: Curve, stages: int, index: Index, effort: Effort) -> Fit | None:
    """The local minimum among splines of so many stages that a motion leads to, within the limits."""
    search, samples = _spline_bases(move, stages)
    bases = Bases(search, spline_basis(stages, move.clamp_acceleration, DENSE_PER_STAGE), samples)
    return _within_limits(move, bases, curve(search.s), index, (effort, effort))


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
