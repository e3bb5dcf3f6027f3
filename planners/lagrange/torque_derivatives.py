"""Inverse dynamics of a planar chain with its first and second derivatives, in absolute link angles.

With link angles ``phi``, their rates ``w`` and accelerations ``a`` (see :mod:`planners.robot.dynamics`) link i takes
a moment

    T_i = sum_j c_ij (cos(phi_i - phi_j) a_j + sin(phi_i - phi_j) w_j^2) + g_i cos(phi_i)

and the torque of joint j is ``T_j + ... + T_n``. All derivatives are closed forms of the same sines and cosines.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from planners.typing import Array


@njit(cache=True, nogil=True)
def torques_single(coupling: Array, weight: Array, links: Array, tau: Array) -> None:
    """Joint torques, to ``tau`` ``(n,)``, N m, from link angles, rates and accelerations ``(3 or more, n)``."""
    n = tau.shape[0]
    outer = 0.0
    for i in range(n - 1, -1, -1):
        moment = weight[i] * np.cos(links[0, i])
        for j in range(n):
            angle = links[0, i] - links[0, j]
            moment += coupling[i, j] * (np.cos(angle) * links[2, j] + np.sin(angle) * links[1, j] * links[1, j])
        outer += moment
        tau[i] = outer


@njit(cache=True, nogil=True)
def torque_jacobian_single(coupling: Array, weight: Array, links: Array, jacobian: Array) -> None:
    """Derivative of every joint torque by link angles, rates and accelerations, to ``jacobian`` ``(n, 3, n)``."""
    n = jacobian.shape[0]
    for i in range(n - 1, -1, -1):
        own = -weight[i] * np.sin(links[0, i])
        for j in range(n):
            angle, rate, acceleration = links[0, i] - links[0, j], links[1, j], links[2, j]
            cosine, sine = coupling[i, j] * np.cos(angle), coupling[i, j] * np.sin(angle)
            turning = sine * acceleration - cosine * rate * rate  # derivative by phi_j, minus that by phi_i
            own -= turning
            jacobian[i, 0, j] = turning
            jacobian[i, 1, j] = 2.0 * sine * rate
            jacobian[i, 2, j] = cosine
        jacobian[i, 0, i] += own
        if i + 1 < n:
            for d in range(3):
                for j in range(n):
                    jacobian[i, d, j] += jacobian[i + 1, d, j]


@njit(cache=True, nogil=True)
def add_torque_curvature_single(coupling: Array, weight: Array, links: Array, factors: Array, curvature: Array) -> None:
    """Add the second derivatives of ``factors @ tau`` to ``curvature`` ``(3 or more, n, 3 or more, n)``."""
    n = factors.shape[0]
    moment_factor = 0.0
    for i in range(n):
        moment_factor += factors[i]
        curvature[0, i, 0, i] -= moment_factor * weight[i] * np.cos(links[0, i])
        for j in range(n):
            if j == i:
                continue
            angle, rate, acceleration = links[0, i] - links[0, j], links[1, j], links[2, j]
            scale = moment_factor * coupling[i, j]
            cosine, sine = scale * np.cos(angle), scale * np.sin(angle)
            bend = -cosine * acceleration - sine * rate * rate
            curvature[0, i, 0, i] += bend
            curvature[0, j, 0, j] += bend
            curvature[0, i, 0, j] -= bend
            curvature[0, j, 0, i] -= bend
            twist = 2.0 * cosine * rate
            curvature[0, i, 1, j] += twist
            curvature[1, j, 0, i] += twist
            curvature[0, j, 1, j] -= twist
            curvature[1, j, 0, j] -= twist
            curvature[1, j, 1, j] += 2.0 * sine
            curvature[0, i, 2, j] -= sine
            curvature[2, j, 0, i] -= sine
            curvature[0, j, 2, j] += sine
            curvature[2, j, 0, j] += sine
