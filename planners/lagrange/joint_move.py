"""A move between two joint states in a given time, and its local minima of torque on a given basis."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from planners.lagrange.interior_point import solve
from planners.lagrange.newton import TorqueTask
from planners.lagrange.transcription import Basis, Ends, fit, motion, transcribe
from planners.robot.arm import Arm, JointLimits
from planners.robot.limits import LIMIT_KINDS
from planners.typing import Array

Objective = Literal["PI1", "PI2"]
"""The integral of sum |tau| (N m s) or of sum tau^2 (N^2 m^2 s) over the motion."""

Curve = Callable[[Array], Array]
"""Joint angles ``(points, n)``, rad, at ``s`` of ``(points,)`` in [0, 1]."""

CLOSE = 0.05
"""Share of the duration within which the motion leaves a limit that the start lies on, or comes to one of the end."""

FIRST_TIGHTENING = 1.0 - 5e-4
"""Share of the limits that a first solution uses."""

_ORDERS = np.array([-1, 1, 2, 3, 0])


class Index(NamedTuple):
    """The objective, and the torque that counts as 1 in it, N m."""

    objective: Objective
    unit: float

    @property
    def smooth(self) -> Index:
        """PI2 in the same unit."""
        return Index("PI2", self.unit)


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

    def to(self, end: Array, duration: float) -> JointMove:
        """The move to another end, ``(3, n)``, in another time (s)."""
        return replace(self, ends=Ends(self.ends.start, end), duration=duration)

    @property
    def limit_table(self) -> Array:
        """Limits of every kind, ``(5, n)``, SI units."""
        return np.array([self.limits.array(kind) for kind in LIMIT_KINDS])

    @property
    def end_loads(self) -> Array:
        """|value| / limit of every kind and joint at the start and at the end, ``(2, 5, n)``; 0 if not given."""
        loads = np.zeros((2, *self.limit_table.shape))
        for side, (q, qd, qdd) in enumerate(self.ends):
            tau = self.arm.inverse_dynamics(q, qd, qdd)
            free = 1.0 if self.clamp_acceleration else 0.0
            values = np.stack([free * tau, qd, free * qdd, 0.0 * q, q - self.limits.angle_middle])
            loads[side] = np.abs(values) / self.limit_table
        return loads

    def quintic(self, s: Array) -> Array:
        """Joint angles of the quintic between the ends at ``s`` in [0, 1], ``(points, n)``."""
        powers = self.duration ** np.arange(3)[:, None]
        from scipy.interpolate import BPoly  # slow to import

        angles: Array = BPoly.from_derivatives([0.0, 1.0], [self.ends.start * powers, self.ends.end * powers])(s)
        return angles

    def task(self, basis: Basis, index: Index, tightening: Array) -> TorqueTask:
        """The index, and the share ``tightening``, ``(5,)``, of each kind of limit, raised near ends that need more."""
        excess = np.maximum(self.end_loads - tightening[:, None], 0.0)
        closeness = np.maximum(1.0 - np.stack([basis.s, 1.0 - basis.s]) / CLOSE, 0.0)
        share = tightening[:, None] + np.einsum("sk,sij->kij", closeness, excess)
        # without limits arrays would have another memory layout, for which all would be compiled again
        kinds, joints = map(np.ascontiguousarray, np.nonzero(np.isfinite(self.limit_table)))
        inverse = 1.0 / (share * self.limit_table)[:, kinds, joints]
        # values that depend on the ends alone are not limited
        acts = np.abs(basis.functions).max(axis=2) > 1e-9 * np.abs(basis.functions).max(axis=(0, 2))
        inverse *= np.column_stack([acts, acts[:, :3].any(axis=1)])[:, _ORDERS[kinds]]
        inverse = np.ascontiguousarray(inverse)
        middle = np.where(kinds == LIMIT_KINDS.index("angle"), self.limits.angle_middle[joints], 0.0)
        power = int(index.objective[2])
        return TorqueTask(*self.arm.chain_constants, _ORDERS[kinds], joints, middle, inverse, power, index.unit)


@dataclass(frozen=True)
class Minimum:
    """A local minimum of a move on a basis: absolute link angles ``unknowns`` ``(unknowns, n)``, and whether the
    limits are kept at the basis' instants.
    """

    move: JointMove
    basis: Basis
    unknowns: Array
    feasible: bool

    def at(self, basis: Basis) -> Array:
        """Joint angles and their derivatives at the instants of a basis of the same functions, ``(4, points, n)``."""
        return motion(transcribe(basis, self.move.ends, self.move.duration), self.unknowns)

    def index(self, objective: Objective, basis: Basis | None = None) -> float:
        """The index at the instants of its own or another basis of the same functions, SI units."""
        basis = basis or self.basis
        q, qd, qdd, _ = self.at(basis)
        tau = self.move.arm.inverse_dynamics(q, qd, qdd)
        return float(basis.weights @ torque_rate(tau, objective)) * self.move.duration


class Effort(NamedTuple):
    """First barrier parameter (small from a good start), tolerance of the index as a fraction of the quintic's, and
    most iterations of the solver.
    """

    barrier: float
    tolerance: float
    iterations: int


def torque_rate(tau: Array, objective: Objective) -> Array:
    """Integrand of the objective, ``(samples,)``, for torques ``(samples, n)``, N m."""
    rate: Array = (np.abs(tau) if objective == "PI1" else np.square(tau)).sum(axis=1)
    return rate


def minimise(
    move: JointMove, basis: Basis, q: Array, index: Index, effort: Effort, tightening: Array | None = None
) -> Minimum:
    """The local minimum from joint angles ``q`` at the basis' instants, ``(points, n)``, rad.

    ``tightening`` ``(5,)`` is the share of each kind of limit to be used, `FIRST_TIGHTENING` by default.
    """
    share = np.full(len(LIMIT_KINDS), FIRST_TIGHTENING) if tightening is None else tightening
    transcription = transcribe(basis, move.ends, move.duration)
    start = np.ascontiguousarray(fit(basis, transcription, q))
    unknowns, loads = solve(transcription, move.task(basis, index, share), start, *effort)
    return Minimum(move, basis, unknowns, bool((np.abs(loads) <= 1.0 + 1e-5).all()))
