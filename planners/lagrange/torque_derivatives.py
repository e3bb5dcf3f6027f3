"""Inverse dynamics of a planar chain with its first and second derivatives, in absolute link angles.

With link angles ``phi``, their rates ``w`` and accelerations ``a`` (see :mod:`planners.robot.dynamics`) link i takes
a moment

    T_i = sum_j c_ij (cos(phi_i - phi_j) a_j + sin(phi_i - phi_j) w_j^2) + g_i cos(phi_i)

and the torque of joint j is ``T_j + ... + T_n``. All derivatives are closed forms of the same sines and cosines.
"""

from __future__ import annotations

import numpy as np

from planners.compiled.calls import private
from planners.typing import Array


@private
def torques_single(coupling: Array, weight: Array, links: Array, tau: Array) -> None:
    """Joint torques, to ``tau`` ``(n,)``, N m, from link angles, rates and accelerations ``(3 or more, n)``."""
    n = tau.shape[0]
    for i in range(n):
        tau[i] = weight[i] * np.cos(links[0, i]) + coupling[i, i] * links[2, i]
    for i in range(n):
        for j in range(i):
            angle = links[0, i] - links[0, j]
            cosine, sine = coupling[i, j] * np.cos(angle), coupling[i, j] * np.sin(angle)
            tau[i] += cosine * links[2, j] + sine * links[1, j] * links[1, j]
            tau[j] += cosine * links[2, i] - sine * links[1, i] * links[1, i]
    for i in range(n - 1, 0, -1):
        tau[i - 1] += tau[i]


@private
def turn_couplings(coupling: Array, links: Array, cosine: Array, sine: Array) -> None:
    """Couplings times cosine and sine of ``phi_i - phi_j``, to ``(n, n)`` each."""
    n = cosine.shape[0]
    for i in range(n):
        cosine[i, i], sine[i, i] = coupling[i, i], 0.0
        for j in range(i):
            angle = links[0, i] - links[0, j]
            cosine[i, j], sine[i, j] = coupling[i, j] * np.cos(angle), coupling[i, j] * np.sin(angle)
            cosine[j, i], sine[j, i] = cosine[i, j], -sine[i, j]


@private
def torque_jacobian_single(weight: Array, links: Array, cosine: Array, sine: Array, jacobian: Array) -> None:
    """Derivative of every joint torque by link angles, rates and accelerations, to ``jacobian`` ``(n, 3, n)``.

    ``cosine`` and ``sine`` are those of `turn_couplings`.
    """
    n = jacobian.shape[0]
    for i in range(n - 1, -1, -1):
        own = -weight[i] * np.sin(links[0, i])
        for j in range(n):
            rate = links[1, j]
            turning = sine[i, j] * links[2, j] - cosine[i, j] * rate * rate  # by phi_j, minus that by phi_i
            own -= turning
            jacobian[i, 0, j] = turning
            jacobian[i, 1, j] = 2.0 * sine[i, j] * rate
            jacobian[i, 2, j] = cosine[i, j]
        jacobian[i, 0, i] += own
        if i + 1 < n:
            for d in range(3):
                for j in range(n):
                    jacobian[i, d, j] += jacobian[i + 1, d, j]


@private
def add_torque_curvature_single(
    weight: Array, links: Array, cosine: Array, sine: Array, factors: Array, curvature: Array
) -> None:
    """Add the second derivatives of ``factors @ tau`` to ``curvature`` ``(3 n or more, 3 n or more)``, its rows and
    columns the link angles, then their rates, then their accelerations.

    ``cosine`` and ``sine`` are those of `turn_couplings`.
    """
    n = factors.shape[0]
    moment_factor = 0.0
    for i in range(n):
        moment_factor += factors[i]
        curvature[i, i] -= moment_factor * weight[i] * np.cos(links[0, i])
        for j in range(n):
            if j == i:
                continue
            rate, cos, sin = links[1, j], moment_factor * cosine[i, j], moment_factor * sine[i, j]
            bend = -cos * links[2, j] - sin * rate * rate
            curvature[i, i] += bend
            curvature[j, j] += bend
            curvature[i, j] -= bend
            curvature[j, i] -= bend
            twist = 2.0 * cos * rate
            by_rate, by_acceleration = n + j, 2 * n + j
            curvature[i, by_rate] += twist
            curvature[by_rate, i] += twist
            curvature[j, by_rate] -= twist
            curvature[by_rate, j] -= twist
            curvature[by_rate, by_rate] += 2.0 * sin
            curvature[i, by_acceleration] -= sin
            curvature[by_acceleration, i] -= sin
            curvature[j, by_acceleration] += sin
            curvature[by_acceleration, j] += sin
