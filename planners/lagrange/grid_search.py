"""The grid search of Algorithms 1 and 2 of the minimal-torque paper, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planners.compiled.calls import private
from planners.typing import Array

ABREAST = 24
"""Curves of the last joint that are looked at together, for the processor's vectors; loops over fewer are unrolled."""


def least_torque(
    coupling: Array,
    weight: Array,
    angle: Array,
    speed: Array,
    acceleration: Array,
    first: NDArray[np.int64],
    weights: Array,
) -> NDArray[np.int64]:
    """Index of each joint's curve, ``(n,)``, in the combination of least PI of all, the first one of equals.

    Args:
        coupling, weight: the arm's chain constants.
        angle, speed, acceleration: q, q' and q'' of the curves of all joints, one joint after the other,
            ``(curves, samples)``, SI units.
        first: row of each joint's first curve, and the number of rows, ``(n + 1,)``.
        weights: of the samples in the integral over time, ``(samples,)``, s.
    """
    curves = np.stack([np.cos(angle), np.sin(angle), speed, acceleration], axis=2)
    last = curves[first[-2] :]
    padded = np.concatenate([last, np.repeat(last[-1:], -len(last) % ABREAST, axis=0)])
    groups = np.ascontiguousarray(padded.reshape(-1, ABREAST, *last.shape[1:]).transpose(0, 2, 3, 1))
    return _search(coupling, weight, curves, groups, first, weights)


@njit(cache=True, nogil=True)
def _search(
    coupling: Array, weight: Array, curves: Array, groups: Array, first: NDArray[np.int64], weights: Array
) -> NDArray[np.int64]:
    """See `least_torque`.

    The torques are those of :mod:`planners.robot.dynamics` with a link's direction as a complex number z = exp(i
    phi), which needs no sines: the moment on link i is ``Im(conj(z_i) (sum_j a_ij z_j'' + i weight_i))``.

    ``curves`` ``(curves, samples, 4)`` are the real and imaginary part of exp(i q), q' and q''; ``groups`` ``(groups,
    samples, 4, ABREAST)`` those of the last joint.
    """
    n, samples = len(first) - 1, len(weights)
    outer = n - 1
    # by sample: directions of the links so far and what they pull with, real and imaginary parts; rate of turning
    z, pull, turning = np.empty((samples, n, 2)), np.empty((samples, n, 2)), np.empty((samples, 2))
    chosen = first[:-1].copy()
    best_chosen, best = chosen.copy(), np.inf
    totals = np.empty(ABREAST)
    while True:
        for s in range(samples):  # all links but the last, once for all curves of the last
            w = alpha = 0.0
            x, y = 1.0, 0.0
            for i in range(n):
                pull[s, i, 0], pull[s, i, 1] = 0.0, weight[i]
            for j in range(outer):
                cosine, sine, speed, acceleration = curves[chosen[j], s]
                w += speed
                alpha += acceleration
                x, y = x * cosine - y * sine, x * sine + y * cosine
                z[s, j, 0], z[s, j, 1] = x, y
                for i in range(n):
                    pull[s, i, 0] -= coupling[i, j] * (w * w * x + alpha * y)
                    pull[s, i, 1] += coupling[i, j] * (alpha * x - w * w * y)
            z[s, outer, 0], z[s, outer, 1] = x, y
            turning[s, 0], turning[s, 1] = w, alpha
        for group in range(groups.shape[0]):
            if _add_up(coupling, z, pull, turning, groups[group], weights, best, totals):
                for i in range(min(ABREAST, first[n] - first[outer] - group * ABREAST)):
                    if totals[i] < best:
                        best = totals[i]
                        best_chosen[:] = chosen
                        best_chosen[outer] = first[outer] + group * ABREAST + i
        # the next combination of the other joints, as an odometer counts
        joint = outer - 1
        while joint >= 0 and chosen[joint] + 1 == first[joint + 1]:
            chosen[joint] = first[joint]
            joint -= 1
        if joint < 0:
            return best_chosen - first[:-1]
        chosen[joint] += 1


@private
def _add_up(
    coupling: Array,
    z: Array,
    pull: Array,
    turning: Array,
    curves: Array,
    weights: Array,
    best: float,
    totals: Array,
) -> bool:
    """PI (eq 6) of a group of curves of the last joint, ``(ABREAST,)``; False if all exceed the least so far."""
    outer = z.shape[1] - 1
    tau, rate = np.empty(ABREAST), np.empty(ABREAST)
    forward, across = np.empty(ABREAST), np.empty(ABREAST)
    for i in range(ABREAST):
        totals[i] = 0.0
    for s in range(weights.shape[0]):
        w, alpha = turning[s, 0], turning[s, 1]
        x, y = z[s, outer, 0], z[s, outer, 1]
        load, pull_x, pull_y = coupling[outer, outer], pull[s, outer, 0], pull[s, outer, 1]
        for i in range(ABREAST):
            tip_x = x * curves[s, 0, i] - y * curves[s, 1, i]
            tip_y = x * curves[s, 1, i] + y * curves[s, 0, i]
            spin, lift = w + curves[s, 2, i], alpha + curves[s, 3, i]
            forward[i] = -(spin * spin * tip_x + lift * tip_y)
            across[i] = lift * tip_x - spin * spin * tip_y
            tau[i] = tip_x * (pull_y + load * across[i]) - tip_y * (pull_x + load * forward[i])
            rate[i] = abs(tau[i])
        for link in range(outer - 1, -1, -1):
            x, y, load = z[s, link, 0], z[s, link, 1], coupling[link, outer]
            pull_x, pull_y = pull[s, link, 0], pull[s, link, 1]
            for i in range(ABREAST):
                tau[i] += x * (pull_y + load * across[i]) - y * (pull_x + load * forward[i])
                rate[i] += abs(tau[i])
        least = np.inf
        for i in range(ABREAST):
            totals[i] += weights[s] * rate[i]
            least = min(least, totals[i])
        if least >= best:
            return False
    return True
