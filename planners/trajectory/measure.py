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
"""Parts of an interval between two samples at whose ends torque, jerk and clearance are evaluated, where they may be
worse than anywhere before."""

JUMP = 1e-9
"""Difference of two accelerations at the same time, relative to the largest, that is rounding."""

ROUNDING = 1e-13
"""Difference of two accelerations at different times, relative to the largest, that is rounding."""

TORQUE, VELOCITY, ACCELERATION, JERK, ANGLE = range(5)


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


def measure(problem: MotionProblem, t: Array, q: Array, qd: Array, qdd: Array, tau: Array) -> Measure:
    """Measure a motion of samples ``t`` ``(samples,)`` and ``(samples, n)`` against a problem's limits and discs.

    Torques are those of the arm with the estimated payload; every disc keeps its velocity. Between two samples, angle,
    velocity and acceleration stay between their values at both (`planners.trajectory.interpolate`), so that only
    torque, jerk and clearance are looked for there.
    """
    arm, limits = problem.loaded_arm, problem.joint_limits
    table = np.array([limits.array(kind) for kind in LIMIT_KINDS])
    discs = np.array(
        [(*disc.position, *disc.velocity, disc.radius) for disc in problem.obstacles], dtype=float
    ).reshape(-1, 5)
    body = arm.length_array, arm.base_array, arm.link_radius, *arm.chain_constants
    ratios, joints, times = _loads(t, q, qd, qdd, tau, table, limits.angle_middle, *arm.chain_constants)
    clearance, when = _clearance(t, q, qd, qdd, discs, *body[:3]) if len(discs) else (np.inf, 0.0)
    return Measure(ratios, joints, times, clearance, when, _gap(t, q, qd, qdd))


@njit(cache=True, nogil=True)
def _gap(t: Array, q: Array, qd: Array, qdd: Array) -> float:
    """See `Measure`."""
    gap = 0.0
    for i in range(t.shape[0] - 1):
        h = t[i + 1] - t[i]
        for j in range(q.shape[1]):
            led_to = q[i, j] + h * (0.5 * (qd[i, j] + qd[i + 1, j]) + h * (qdd[i, j] - qdd[i + 1, j]) / 12.0)
            gap = max(gap, abs(q[i + 1, j] - led_to))
    return gap


@njit(cache=True, nogil=True)
def _loads(
    t: Array,
    q: Array,
    qd: Array,
    qdd: Array,
    tau: Array,
    limits: Array,
    middle: Array,
    coupling: Array,
    weight: Array,
) -> tuple[Array, NDArray[np.int64], Array]:
    """Worst loads, their joints and times; see `Measure`."""
    samples, n = q.shape
    ratios, joints, times = np.zeros(5), np.zeros(5, np.int64), np.zeros(5)
    for i in range(samples):
        for j in range(n):
            _raise(ratios, joints, times, TORQUE, j, t[i], abs(tau[i, j]) / limits[TORQUE, j])
            _raise(ratios, joints, times, VELOCITY, j, t[i], abs(qd[i, j]) / limits[VELOCITY, j])
            _raise(ratios, joints, times, ACCELERATION, j, t[i], abs(qdd[i, j]) / limits[ACCELERATION, j])
            _raise(ratios, joints, times, ANGLE, j, t[i], abs(q[i, j] - middle[j]) / limits[ANGLE, j])
    torques, jerks = bool(np.any(limits[TORQUE] < np.inf)), bool(np.any(limits[JERK] < np.inf))
    if not (torques or jerks):
        return ratios, joints, times
    rounding = ROUNDING * np.abs(qdd).max()
    point, inner = np.empty((3, n)), np.empty((PARTS + 1, n))
    for i in range(samples - 1):
        h = t[i + 1] - t[i]
        if torques and h > 0.0:
            inner[0], inner[PARTS] = tau[i], tau[i + 1]
            _torque(0.5, h, i, q, qd, qdd, coupling, weight, point, inner[PARTS // 2])
            if _may_exceed(inner, limits[TORQUE], ratios[TORQUE]):
                for k in range(1, PARTS):
                    _torque(k / PARTS, h, i, q, qd, qdd, coupling, weight, point, inner[k])
                for j in range(n):
                    for k in range(1, PARTS):  # the peak of a parabola through three neighbours
                        peak = inner[k, j] + _rise(inner[k - 1, j], inner[k, j], inner[k + 1, j])
                        load = max(abs(peak), abs(inner[k, j])) / limits[TORQUE, j]
                        _raise(ratios, joints, times, TORQUE, j, t[i] + k / PARTS * h, load)
        if jerks:
            for j in range(n):
                if limits[JERK, j] < np.inf:
                    jerk = _jerk(h, i, j, q, qd, qdd, rounding)
                    _raise(ratios, joints, times, JERK, j, t[i], jerk / limits[JERK, j])
    return ratios, joints, times


@njit(cache=True, nogil=True)
def _torque(
    s: float,
    h: float,
    i: int,
    q: Array,
    qd: Array,
    qdd: Array,
    coupling: Array,
    weight: Array,
    point: Array,
    tau: Array,
) -> None:
    """Torques at a share ``s`` of interval ``i``, written to ``tau``; ``point`` is scratch, ``(3, n)``."""
    _between_samples(s, h, i, q, qd, qdd, point)
    inverse_dynamics_single(coupling, weight, point[0], point[1], point[2], tau)


@njit(cache=True, nogil=True)
def _may_exceed(inner: Array, limits: Array, worst: float) -> bool:
    """Whether torques, known at the ends and in the middle of an interval, may be worse between these."""
    for j in range(limits.shape[0]):
        first, half, last = inner[0, j], inner[PARTS // 2, j], inner[PARTS, j]
        change = max(abs(half - first), abs(last - half))
        if max(abs(first), abs(half), abs(last)) + change > worst * limits[j]:
            return True
    return False


@njit(cache=True, nogil=True)
def _jerk(h: float, i: int, j: int, q: Array, qd: Array, qdd: Array, rounding: float) -> float:
    """Largest jerk of joint ``j`` in interval ``i``; inf for a jump of the acceleration."""
    change = abs(qdd[i + 1, j] - qdd[i, j])
    if h <= 0.0:
        return np.inf if change > JUMP / ROUNDING * rounding else 0.0
    most = max(0.0, change - rounding) / h
    # rounding of the angles, which an interpolation divides by the square of the interval
    blur = rounding + 60.0 * 2.2e-16 * (abs(q[i, j]) + abs(q[i + 1, j])) / (h * h)
    before = qdd[i, j]
    for k in range(1, PARTS + 1):
        after = between(k / PARTS, h, q[i, j], qd[i, j], qdd[i, j], q[i + 1, j], qd[i + 1, j], qdd[i + 1, j])[2]
        most = max(most, (abs(after - before) - blur) * PARTS / h)
        before = after
    return float(most)


@njit(cache=True, nogil=True)
def _clearance(
    t: Array, q: Array, qd: Array, qdd: Array, discs: Array, lengths: Array, base: Array, link_radius: float
) -> tuple[float, float]:
    """Least clearance from a disc, and its time."""
    samples, n = q.shape
    least, when = np.inf, 0.0
    point, distance = np.empty((3, n)), np.empty(PARTS + 1)
    for disc in discs:
        last = clearance_single(lengths, base, link_radius, q[0], disc[0], disc[1], disc[4])
        if last < least:
            least, when = last, 0.0
        for i in range(samples - 1):
            h = t[i + 1] - t[i]
            if h <= 0.0:
                continue
            distance[0] = last
            for step in (PARTS, PARTS // 2, 1, PARTS - 1):  # the quarters only where they may be the closest
                if step == 1:
                    change = max(abs(distance[PARTS // 2] - distance[0]), abs(distance[PARTS] - distance[PARTS // 2]))
                    if min(distance[0], distance[PARTS // 2], distance[PARTS]) - change > least:
                        break
                _between_samples(step / PARTS, h, i, q, qd, qdd, point)
                x, y = disc[0] + (t[i] + step / PARTS * h) * disc[2], disc[1] + (t[i] + step / PARTS * h) * disc[3]
                distance[step] = clearance_single(lengths, base, link_radius, point[0], x, y, disc[4])
            else:
                for k in range(1, PARTS + 1):
                    gap = distance[k]
                    if k < PARTS and gap <= min(distance[k - 1], distance[k + 1]):
                        gap += _rise(distance[k - 1], gap, distance[k + 1])
                    if gap < least:
                        least, when = gap, t[i] + k / PARTS * h
            last = distance[PARTS]
    return least, when


@njit(cache=True, nogil=True)
def _between_samples(s: float, h: float, i: int, q: Array, qd: Array, qdd: Array, point: Array) -> None:
    """Angles, velocities and accelerations at a share ``s`` of interval ``i``, written to ``point``, ``(3, n)``."""
    for j in range(q.shape[1]):
        point[0, j], point[1, j], point[2, j] = between(
            s, h, q[i, j], qd[i, j], qdd[i, j], q[i + 1, j], qd[i + 1, j], qdd[i + 1, j]
        )


@njit(cache=True, nogil=True)
def _raise(
    ratios: Array, joints: NDArray[np.int64], times: Array, kind: int, joint: int, time: float, ratio: float
) -> None:
    """Note a ratio if it is the worst so far of its kind; what is no number counts as inf."""
    if np.isnan(ratio):
        ratio = np.inf
    if ratio > ratios[kind]:
        ratios[kind], joints[kind], times[kind] = ratio, joint, time


@njit(cache=True, nogil=True)
def _rise(left: float, middle: float, right: float) -> float:
    """How far the vertex of a parabola lies above (or below) its middle value; 0 where it is not between the three."""
    curvature, slope = 2.0 * middle - left - right, right - left
    if curvature == 0.0 or abs(slope) > 2.0 * abs(curvature):
        return 0.0
    return float(slope * slope / (8.0 * curvature))
