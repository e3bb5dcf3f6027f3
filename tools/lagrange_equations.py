"""Lagrange's equations of a planar arm, derived by SymPy from its energies: an inverse dynamics with another origin."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import sympy as sp  # type: ignore[import-untyped]

from planners.robot.arm import Arm


@dataclass(frozen=True)
class Equations:
    """Lagrange's equations of an arm; all arguments are sequences of arrays, one for each joint.

    Attributes:
        torque: of ``(q, qd, qdd)``: ``n`` torques.
        jacobian: of the same: rows of ``3 n`` derivatives.
        curvature: of the same and factors of the torques: ``3 n`` rows of second derivatives of their sum.
    """

    torque: Callable[..., Any]
    jacobian: Callable[..., Any]
    curvature: Callable[..., Any]


@lru_cache(maxsize=2)
def derive(arm: Arm) -> Equations:
    """Lagrange's equations of an arm, eq 1-5 of the minimal-torque paper, derived from its energies."""
    n = arm.n_joints
    t = sp.Symbol("t")
    q = [sp.Function(f"q{i}")(t) for i in range(n)]
    x = y = angle = energy = sp.Integer(0)
    for i in range(n):
        angle = angle + q[i]
        com_x, com_y = x + arm.coms[i] * sp.cos(angle), y + arm.coms[i] * sp.sin(angle)
        energy += arm.masses[i] * (com_x.diff(t) ** 2 + com_y.diff(t) ** 2) / 2
        energy += arm.inertias[i] * angle.diff(t) ** 2 / 2 - arm.masses[i] * arm.gravity * com_y
        x, y = x + arm.lengths[i] * sp.cos(angle), y + arm.lengths[i] * sp.sin(angle)
    plain = [sp.symbols(f"{name}:{n}") for name in ("a", "v", "q")]
    names = [(variable.diff(t, order), plain[2 - order][i]) for order in (2, 1, 0) for i, variable in enumerate(q)]
    torque = sp.Matrix([sp.simplify((energy.diff(v.diff(t)).diff(t) - energy.diff(v)).subs(names)) for v in q])
    state = [*plain[2], *plain[1], *plain[0]]
    factors = sp.symbols(f"f:{n}")
    total = sum(f * tau for f, tau in zip(factors, torque, strict=True))
    arguments = [plain[2], plain[1], plain[0]]
    return Equations(
        sp.lambdify(arguments, list(torque), cse=True),
        sp.lambdify(arguments, torque.jacobian(state).tolist(), cse=True),
        sp.lambdify([*arguments, factors], sp.hessian(total, state).tolist(), cse=True),
    )
