"""Joint torques of planar arms for CasADi, derived from the arm's energies and not from the planners' own equations."""

from __future__ import annotations

import casadi as ca

from planners.robot.arm import Arm


def torques(arm: Arm) -> ca.Function:
    """Joint torques of ``(q, qd, qdd)`` by Lagrange's equations, eq 1-5 of the minimal-torque paper."""
    q, qd, qdd = (ca.SX.sym(name, arm.n_joints) for name in ("q", "qd", "qdd"))
    angle, x, y, energy = ca.cumsum(q), ca.SX(0), ca.SX(0), ca.SX(0)
    for i in range(arm.n_joints):
        com = ca.vertcat(x + arm.coms[i] * ca.cos(angle[i]), y + arm.coms[i] * ca.sin(angle[i]))
        energy += arm.masses[i] * (ca.sumsqr(ca.jtimes(com, q, qd)) / 2 - arm.gravity * com[1])
        energy += arm.inertias[i] * ca.sum1(qd[: i + 1]) ** 2 / 2
        x, y = x + arm.lengths[i] * ca.cos(angle[i]), y + arm.lengths[i] * ca.sin(angle[i])
    momentum = ca.gradient(energy, qd)
    rate = ca.jtimes(momentum, ca.vertcat(q, qd), ca.vertcat(qd, qdd))
    return ca.Function("torques", [q, qd, qdd], [rate - ca.gradient(energy, q)])
