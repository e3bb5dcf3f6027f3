"""The grid search of Algorithms 1 and 2 of the minimal-torque paper, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planners.typing import Array


@njit(cache=True, nogil=True)
def least_torque(
    coupling: Array,
    weight: Array,
    turn: NDArray[np.complex128],
    speed: Array,
    acceleration: Array,
    first: NDArray[np.int64],
    weights: Array,
) -> NDArray[np.int64]:
    """Index of each joint's curve, ``(n,)``, in the combination of least PI of all.

    The torques are those of :mod:`planners.robot.dynamics` with a link's direction as a complex number z = exp(i
    phi), which needs no sines: the moment on link i is ``Im(conj(z_i) (sum_j a_ij z_j'' + i weight_i))``.

    Args:
        coupling, weight: the arm's chain constants.
        turn, speed, acceleration: exp(i q), q' and q'' of the curves of all joints, one joint after the other,
            ``(curves, samples)``.
        first: row of each joint's first curve, and the number of rows, ``(n + 1,)``.
        weights: of the samples in the integral over time, ``(samples,)``, s.
    """
    n, samples = len(first) - 1, len(weights)
    outer = n - 1
    z, pull = np.empty((samples, n), dtype=np.complex128), np.empty((samples, n), dtype=np.complex128)
    w, alpha = np.empty(samples), np.empty(samples)
    chosen = first[:-1].copy()
    best_chosen, best = chosen.copy(), np.inf
    while True:
        for s in range(samples):  # all links but the last, once for all curves of the last
            w[s] = alpha[s] = 0.0
            direction = 1.0 + 0.0j
            for i in range(n):
                pull[s, i] = 1j * weight[i]
            for j in range(outer):
                w[s] += speed[chosen[j], s]
                alpha[s] += acceleration[chosen[j], s]
                direction *= turn[chosen[j], s]
                z[s, j] = direction
                for i in range(n):
                    pull[s, i] += coupling[i, j] * (1j * alpha[s] - w[s] ** 2) * direction
            z[s, outer] = direction
        # PI (eq 6) of every curve of the last joint, until it exceeds the least one so far
        for last in range(first[outer], first[n]):
            total = 0.0
            for s in range(samples):
                tip = z[s, outer] * turn[last, s]
                tip_pull = (1j * (alpha[s] + acceleration[last, s]) - (w[s] + speed[last, s]) ** 2) * tip
                tau = (np.conj(tip) * (pull[s, outer] + coupling[outer, outer] * tip_pull)).imag
                rate = abs(tau)
                for i in range(outer - 1, -1, -1):
                    tau += (np.conj(z[s, i]) * (pull[s, i] + coupling[i, outer] * tip_pull)).imag
                    rate += abs(tau)
                total += weights[s] * rate
                if total >= best:
                    break
            if total < best:
                best = total
                best_chosen[:] = chosen
                best_chosen[outer] = last
        # the next combination of the other joints, as an odometer counts
        joint = outer - 1
        while joint >= 0 and chosen[joint] + 1 == first[joint + 1]:
            chosen[joint] = first[joint]
            joint -= 1
        if joint < 0:
            return best_chosen - first[:-1]
        chosen[joint] += 1
