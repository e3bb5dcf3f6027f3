"""Rigid-body dynamics of a planar chain of revolute joints, compiled and batched.

In absolute link angles ``phi`` (``phi_i = q_0 + ... + q_i``) the Lagrange-Euler equations of a planar chain are

    sum_j a_ij (cos(phi_i - phi_j) phi''_j + sin(phi_i - phi_j) phi'_j^2) + g b_i cos(phi_i) = T_i

with constants ``a`` (coupling matrix, kg m^2) and ``b`` (static moments, kg m) from masses, lengths and inertias. The
torque of joint j in relative angles is ``tau_j = T_j + ... + T_n``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from planners.compiled.calls import dividing, private
from planners.typing import Array


def chain_constants(lengths: Array, masses: Array, coms: Array, inertias: Array) -> tuple[Array, Array]:
    """Coupling matrix ``a``, ``(n, n)``, kg m^2, and static moments ``b``, ``(n,)``, kg m, of a chain.

    The arguments are ``(n,)``, as the attributes of `planners.robot.arm.Arm`.
    """
    n = len(lengths)
    # lever[k, i]: derivative of link k's centre of mass by link i's direction
    lever = np.tril(np.broadcast_to(lengths, (n, n)), -1) + np.diag(coms)
    coupling = np.einsum("k,ki,kj->ij", masses, lever, lever) + np.diag(inertias)
    return coupling, masses @ lever


@private
def inverse_dynamics_single(coupling: Array, weight: Array, q: Array, qd: Array, qdd: Array, tau: Array) -> None:
    """Joint torques (N m) of one row, written to ``tau``; ``weight`` is gravity times the static moments, N m."""
    n = q.shape[0]
    phi, w, alpha = np.empty(n), np.empty(n), np.empty(n)
    angle = speed = acceleration = 0.0
    for i in range(n):
        angle += q[i]
        speed += qd[i]
        acceleration += qdd[i]
        phi[i], w[i], alpha[i] = angle, speed, acceleration
    outer = 0.0
    for i in range(n - 1, -1, -1):
        moment = weight[i] * np.cos(phi[i])
        for j in range(n):
            difference = phi[i] - phi[j]
            moment += coupling[i, j] * (np.cos(difference) * alpha[j] + np.sin(difference) * w[j] * w[j])
        outer += moment
        tau[i] = outer


@njit(cache=True, nogil=True)
def mass_matrix_single(coupling: Array, q: Array, m: Array) -> None:
    """Mass matrix (kg m^2) of one row in relative joint angles, written to ``m``, ``(n, n)``."""
    n = q.shape[0]
    phi = np.empty(n)
    angle = 0.0
    for i in range(n):
        angle += q[i]
        phi[i] = angle
    for i in range(n - 1, -1, -1):
        for j in range(n - 1, i - 1, -1):
            total = coupling[i, j] * np.cos(phi[i] - phi[j])
            if i + 1 < n:
                total += m[i + 1, j]
            if j + 1 < n:
                total += m[i, j + 1]
            if i + 1 < n and j + 1 < n:
                total -= m[i + 1, j + 1]
            m[i, j] = m[j, i] = total


@dividing
def solve_mass_matrix(m: Array, rhs: Array) -> None:
    """Solve ``m x = rhs`` by Cholesky factorisation; ``m`` is destroyed and ``rhs`` becomes ``x``, not finite if ``m``
    is singular."""
    n = rhs.shape[0]
    for j in range(n):
        for k in range(j):
            m[j, j] -= m[j, k] * m[j, k]
        m[j, j] = np.sqrt(m[j, j])
        for i in range(j + 1, n):
            for k in range(j):
                m[i, j] -= m[i, k] * m[j, k]
            m[i, j] /= m[j, j]
        for k in range(j):
            rhs[j] -= m[j, k] * rhs[k]
        rhs[j] /= m[j, j]
    for j in range(n - 1, -1, -1):
        for k in range(j + 1, n):
            rhs[j] -= m[k, j] * rhs[k]
        rhs[j] /= m[j, j]


@njit(cache=True, nogil=True)
def inverse_dynamics(coupling: Array, weight: Array, q: Array, qd: Array, qdd: Array) -> Array:
    """Joint torques ``(batch, n)``, N m, that give accelerations ``qdd`` in the state ``q, qd``, all ``(batch, n)``."""
    tau = np.empty_like(q)
    for row in range(q.shape[0]):
        inverse_dynamics_single(coupling, weight, q[row], qd[row], qdd[row], tau[row])
    return tau


@njit(cache=True, nogil=True)
def mass_matrix(coupling: Array, q: Array) -> Array:
    """Mass matrices ``(batch, n, n)``, kg m^2, for ``q`` of ``(batch, n)``."""
    rows, n = q.shape
    m = np.empty((rows, n, n))
    for row in range(rows):
        mass_matrix_single(coupling, q[row], m[row])
    return m


@private
def forward_dynamics_single(coupling: Array, weight: Array, q: Array, qd: Array, tau: Array, qdd: Array) -> None:
    """Joint accelerations (rad/s^2) of one row, written to ``qdd``."""
    n = q.shape[0]
    bias, m = np.empty(n), np.empty((n, n))
    inverse_dynamics_single(coupling, weight, q, qd, np.zeros(n), bias)
    mass_matrix_single(coupling, q, m)
    for i in range(n):
        qdd[i] = tau[i] - bias[i]
    solve_mass_matrix(m, qdd)


@njit(cache=True, nogil=True)
def forward_dynamics(coupling: Array, weight: Array, q: Array, qd: Array, tau: Array) -> Array:
    """Joint accelerations ``(batch, n)``, rad/s^2, under torques ``tau`` in the state ``q, qd``, all ``(batch, n)``."""
    qdd = np.empty_like(q)
    for row in range(q.shape[0]):
        forward_dynamics_single(coupling, weight, q[row], qd[row], tau[row], qdd[row])
    return qdd


@njit(cache=True, nogil=True)
def energy(coupling: Array, weight: Array, q: Array, qd: Array) -> Array:
    """Kinetic plus potential energy ``(batch,)``, J, for ``q, qd`` of ``(batch, n)``; potential zero at base height."""
    rows, n = q.shape
    total = np.zeros(rows)
    for row in range(rows):
        phi, w = np.cumsum(q[row]), np.cumsum(qd[row])
        for i in range(n):
            total[row] += weight[i] * np.sin(phi[i])
            for j in range(n):
                total[row] += 0.5 * coupling[i, j] * np.cos(phi[i] - phi[j]) * w[i] * w[j]
    return total
