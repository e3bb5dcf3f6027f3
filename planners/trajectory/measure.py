"""Measurement of a motion on its continuous course: worst loads of the joint limits, and clearance from discs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planners.problem import MotionProblem
from planners.robot.clearance import clearance_single
from planners.robot.dynamics import inverse_dynamics_single
from planners.robot.limits import LIMIT_KINDS
from planners.trajectory.interpolate import between
from planners.typing import Array

PARTS = 4
"""Parts of an interval between two samples at whose ends torque, jerk and clearance are evaluated."""

JUMP = 1e-9
"""Difference of two accelerations at the same time, relative to the largest, that is rounding."""


class Measure(NamedTuple):
    """What is measured on a motion.

    Attributes:
        ratios: worst |value| / limit of each of `LIMIT_KINDS`, ``(5,)``; angles from the middle of their range.
        joints: the joint of each, ``(5,)``.
        times: its time, ``(5,)``, s.
        clearance: least distance between the surfaces of the arm and a disc, m; inf without discs.
        clearance_time: its time, s.
        gap: largest difference, rad, between the angles of a sample and those that the last sample's velocities lead
            to: a discontinuity where it is not small.
    """

    ratios: Array
    joints: NDArray[np.int64]
    times: Array
    clearance: float
    clearance_time: float
    gap: float


def measure(problem: MotionProblem, t: Array, q: Array, qd: Array, qdd: Array) -> Measure:
    """Measure a motion of samples ``t`` ``(samples,)`` and ``(samples, n)`` against a problem's limits and discs.

    Torques are those of the arm with the estimated payload; every disc keeps its velocity.
    """
    arm, limits = problem.loaded_arm, problem.joint_limits
    table = np.array([limits.array(kind) for kind in LIMIT_KINDS])
    discs = np.array(
        [(*disc.position, *disc.velocity, disc.radius) for disc in problem.obstacles], dtype=float
    ).reshape(-1, 5)
    body = arm.length_array, arm.base_array, arm.link_radius, *arm.chain_constants
    return Measure(*_measure(t, q, qd, qdd, table, limits.angle_middle, discs, *body))


@njit(cache=True, nogil=True)
def _measure(
    t: Array,
    q: Array,
    qd: Array,
    qdd: Array,
    limits: Array,
    middle: Array,
    discs: Array,
    lengths: Array,
    base: Array,
    link_radius: float,
    coupling: Array,
    weight: Array,
) -> tuple[Array, NDArray[np.int64], Array, float, float, float]:
    samples, n = q.shape
    ratios, joints, times = np.zeros(5), np.zeros(5, np.int64), np.zeros(5)
    clearance, clearance_time, gap = np.inf, 0.0, 0.0
    point, tau, distance = np.empty((PARTS + 1, 3, n)), np.empty((PARTS + 1, n)), np.empty(PARTS + 1)
    most = np.abs(qdd).max()
    for i in range(samples - 1):
        h = t[i + 1] - t[i]
        for j in range(n):
            led_to = q[i, j] + h * (0.5 * (qd[i, j] + qd[i + 1, j]) + h * (qdd[i, j] - qdd[i + 1, j]) / 12.0)
            gap = max(gap, abs(q[i + 1, j] - led_to))
            if h <= 0.0 and abs(qdd[i + 1, j] - qdd[i, j]) > JUMP * most and limits[3, j] < np.inf:
                ratios[3], joints[3], times[3] = np.inf, j, t[i]
        if h <= 0.0:
            continue
        # Angles, velocities, accelerations and torques at the ends of the parts.
        for k in range(PARTS + 1):
            for j in range(n):
                point[k, 0, j], point[k, 1, j], point[k, 2, j] = between(
                    k / PARTS, h, q[i, j], qd[i, j], qdd[i, j], q[i + 1, j], qd[i + 1, j], qdd[i + 1, j]
                )
            inverse_dynamics_single(coupling, weight, point[k, 0], point[k, 1], point[k, 2], tau[k])
        for j in range(n):
            for k in range(PARTS + 1):
                when = t[i] + k / PARTS * h
                _raise(ratios, joints, times, 0, j, when, abs(tau[k, j]) / limits[0, j])
                _raise(ratios, joints, times, 1, j, when, abs(point[k, 1, j]) / limits[1, j])
                _raise(ratios, joints, times, 2, j, when, abs(point[k, 2, j]) / limits[2, j])
                _raise(ratios, joints, times, 4, j, when, abs(point[k, 0, j] - middle[j]) / limits[4, j])
            for k in range(PARTS):
                jerk = (point[k + 1, 2, j] - point[k, 2, j]) / (h / PARTS)
                if limits[3, j] < np.inf:
                    _raise(ratios, joints, times, 3, j, t[i] + k / PARTS * h, abs(jerk) / limits[3, j])
            for k in range(1, PARTS):  # the peak of a parabola through three neighbours
                rise = _rise(tau[k - 1, j], tau[k, j], tau[k + 1, j])
                load = max(abs(tau[k, j] + rise), abs(tau[k, j])) / limits[0, j]
                _raise(ratios, joints, times, 0, j, t[i] + k / PARTS * h, load)
        for disc in discs:
            for k in range(PARTS + 1):
                when = t[i] + k / PARTS * h
                x, y = disc[0] + when * disc[2], disc[1] + when * disc[3]
                distance[k] = clearance_single(lengths, base, link_radius, point[k, 0], x, y, disc[4])
            for k in range(PARTS + 1):
                least = distance[k]
                if 0 < k < PARTS and least <= min(distance[k - 1], distance[k + 1]):
                    least += _rise(distance[k - 1], least, distance[k + 1])
                if least < clearance:
                    clearance, clearance_time = least, t[i] + k / PARTS * h
    return ratios, joints, times, clearance, clearance_time, gap


@njit(cache=True, nogil=True)
def _raise(
    ratios: Array, joints: NDArray[np.int64], times: Array, kind: int, joint: int, time: float, ratio: float
) -> None:
    """Note a ratio if it is the worst so far of its kind."""
    if ratio > ratios[kind]:
        ratios[kind], joints[kind], times[kind] = ratio, joint, time


@njit(cache=True, nogil=True)
def _rise(left: float, middle: float, right: float) -> float:
    """How far the vertex of a parabola lies above (or below) its middle value; 0 where it is not between the three."""
    curvature, slope = 2.0 * middle - left - right, right - left
    if curvature == 0.0 or abs(slope) > 2.0 * abs(curvature):
        return 0.0
    return float(slope * slope / (8.0 * curvature))
