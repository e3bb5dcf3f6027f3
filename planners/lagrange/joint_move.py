"""A move between two joint states in a given time, and its local minima of torque on a given basis."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.interpolate import BPoly

from planners.lagrange.interior_point import Result, solve
from planners.lagrange.newton import TorqueTask
from planners.lagrange.transcription import Basis, Ends, Transcription, fit, motion, transcribe
from planners.robot.arm import Arm, JointLimits
from planners.typing import Array

Objective = Literal["PI1", "PI2"]
"""The integral of sum |tau| (N m s) or of sum tau^2 (N^2 m^2 s) over the motion."""

Curve = Callable[[Array], Array]
"""Joint angles ``(points, n)``, rad, at ``s`` of ``(points,)`` in [0, 1]."""

KINDS = ("torque", "velocity", "acceleration", "jerk", "angle")
CLOSE = 0.05
"""Share of the duration within which the motion leaves a limit that the start lies on, or comes to one of the end."""

_ORDERS = np.array([-1, 1, 2, 3, 0])


@dataclass(frozen=True)
class JointMove:
    """From one joint state to another in ``duration`` s, by an arm with its payload, within joint limits.

    ``clamp_acceleration`` says whether the accelerations of the ends are to be met too.
    """

    arm: Arm
    limits: JointLimits
    ends: Ends
    duration: float
    clamp_acceleration: bool

    def lasting(self, duration: float) -> JointMove:
        """The same move in another time (s)."""
        return replace(self, duration=duration)

    @property
    def limit_table(self) -> Array:
        """Limits of every kind, ``(5, n)``, SI units."""
        return np.array([getattr(self.limits, kind) for kind in KINDS])

    @property
    def end_loads(self) -> Array:
        """|value| / limit of every kind and joint at the start and at the end, ``(2, 5, n)``; 0 for what is free."""
        loads = np.zeros((2, *self.limit_table.shape))
        for side, (q, qd, qdd) in enumerate(self.ends):
            tau = self.arm.inverse_dynamics(q, qd, qdd)
            free = 1.0 if self.clamp_acceleration else 0.0
            loads[side] = np.abs(np.stack([free * tau, qd, free * qdd, 0.0 * q, q])) / self.limit_table
        return loads

    def quintic(self, s: Array) -> Array:
        """Joint angles of the quintic between the ends at ``s`` in [0, 1], ``(points, n)``."""
        powers = self.duration ** np.arange(3)[:, None]
        curve = BPoly.from_derivatives([0.0, 1.0], [self.ends.start * powers, self.ends.end * powers])
        angles: Array = curve(s)
        return angles

    def transcribe(self, basis: Basis) -> Transcription:
        """The move on a basis."""
        return transcribe(basis, self.ends, self.duration)

    def task(self, basis: Basis, objective: Objective, tightening: Array, unit: float) -> TorqueTask:
        """The index and the limits, of which ``tightening`` ``(5,)`` is the share to be used, by kind; close to the
        ends it is at least what those need. ``unit`` is the torque that counts as 1, N m.
        """
        excess = np.maximum(self.end_loads - tightening[:, None], 0.0)
        closeness = np.maximum(1.0 - np.stack([basis.s, 1.0 - basis.s]) / CLOSE, 0.0)
        share = tightening[:, None] + np.einsum("sk,sij->kij", closeness, excess)
        kinds, joints = np.nonzero(np.isfinite(self.limit_table))
        inverse = 1.0 / (share * self.limit_table)[:, kinds, joints]
        # what the ends decide alone is no matter of the unknowns
        acts = np.abs(basis.functions).max(axis=2) > 1e-9 * np.abs(basis.functions).max(axis=(0, 2))
        inverse *= np.column_stack([acts, acts[:, :3].any(axis=1)])[:, _ORDERS[kinds]]
        coupling, weight = self.arm.chain_constants
        return TorqueTask(coupling, weight, _ORDERS[kinds], joints, inverse, int(objective[2]), unit)


@dataclass(frozen=True)
class Minimum:
    """A local minimum of a move on a basis: absolute link angles ``unknowns`` ``(unknowns, n)``, and whether the
    limits are kept at the basis' instants.
    """

    move: JointMove
    basis: Basis
    unknowns: Array
    feasible: bool

    def seen_on(self, basis: Basis) -> Array:
        """Joint angles and their derivatives at the instants of a basis of the same functions, ``(4, points, n)``."""
        return motion(self.move.transcribe(basis), self.unknowns)

    def index(self, objective: Objective, basis: Basis | None = None) -> float:
        """The index at the instants of its own or another basis of the same functions, SI units."""
        basis = basis or self.basis
        q, qd, qdd, _ = self.seen_on(basis)
        tau = self.move.arm.inverse_dynamics(q, qd, qdd)
        rate = np.abs(tau).sum(axis=1) if objective == "PI1" else np.square(tau).sum(axis=1)
        return float(basis.weights @ rate) * self.move.duration


@dataclass(frozen=True)
class Effort:
    """How hard the solver tries: first barrier parameter (small from a good start), tolerance of the index as a
    fraction of the quintic's, most iterations.
    """

    barrier: float
    tolerance: float
    iterations: int


def minimise(
    move: JointMove, basis: Basis, q: Array, objective: Objective, tightening: Array, unit: float, effort: Effort
) -> Minimum:
    """The local minimum that joint angles ``q`` at the basis' instants, ``(points, n)``, rad, lead to.

    ``tightening`` ``(5,)`` is the share of the limits to be used, by kind; ``unit`` is the torque that counts as 1, N
    m.
    """
    transcription = move.transcribe(basis)
    task = move.task(basis, objective, tightening, unit)
    start = np.ascontiguousarray(fit(basis, transcription, q))
    solution: Result = solve(transcription, task, start, effort.barrier, effort.tolerance, effort.iterations)
    return Minimum(move, basis, solution.unknowns, solution.load <= 1.0 + 1e-5)
