"""From a Lagrange interpolation to a dense transcription: cubic splines, acceleration linear on every stage."""

from __future__ import annotations

from planners.lagrange.joint_move import Effort, Objective
from planners.lagrange.search import Fit, torque_unit, within_limits
from planners.lagrange.transcription import spline_basis

STAGES, POINTS_PER_STAGE, SAMPLES_PER_STAGE, DENSE_PER_STAGE = 150, 2, 4, 8

POLISH = Effort(barrier=1e-5, tolerance=1e-5, iterations=150)


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
