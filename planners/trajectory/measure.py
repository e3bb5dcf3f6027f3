"""Measurement of a motion on its continuous course: worst loads of the joint limits, and clearance from discs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planners.compiled.calls import inlined, private
from planners.problem import MotionProblem
from planners.robot.dynamics import inverse_dynamics_single, mass_matrix_single
from planners.robot.limits import LIMIT_KINDS
from planners.trajectory.interpolate import between_samples, overshoot, peak_jerk
from planners.trajectory.least_clearance import least_clearance
from planners.typing import Array

PARTS, MIDDLE_FIRST = 4, (2, 1, 3)
"""Parts of an interval between two samples at whose ends torque is evaluated, and these ends in their order."""

_WEIGHTS = [[0, 0, 24, 0, 0], [2, -16, 0, 16, -2], [-1, 16, -30, 16, -1], [-2, 4, 0, -4, 2], [1, -4, 6, -4, 1]]
QUARTIC = np.array(_WEIGHTS) / 24.0
"""Coefficients of the polynomial through the five torques: for each power of the place, in parts from the middle of the
interval, the weights of the torques, ``(5, 5)``."""

TURN, MOST_BLOCKS = 0.5, 1e5
"""Rotation of all joints together over which torques are a polynomial, rad; largest number of these in a motion."""

ROUNDS = 5
"""Places at which the polynomial is evaluated on the way, by Newton's method, to where it turns."""

JUMP = 1e-9
"""Difference of two accelerations at the same time, relative to the largest, that is rounding."""

ROUNDING = 1e-13
"""Difference of two accelerations at different times, relative to the largest, that is rounding."""

BLURRED = 1e-8
"""Rounding of an acceleration between two samples, relative to the largest, above which torques count as blurred."""

CUT = 3.2
"""Error of the polynomial, as a multiple of what is cut off: 1 + the sum of the magnitudes of the torques' weights."""

TORQUE, VELOCITY, ACCELERATION, JERK, ANGLE = range(5)


class Measure(NamedTuple):
    """What is measured on a motion.

    Attributes:
        ratios: worst |value| / limit of each of `LIMIT_KINDS`, ``(5,)``; angles from the middle of their range.
        joints: the joint of each, ``(5,)``.
        times: its time, ``(5,)``, s; that of a torque to an eighth of the time between two samples.
        clearance: least distance between the surfaces of the arm and a disc, m; inf without discs. A lower bound where
            the joints spin so often that a closer look would take too long.
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
    clearance, when = least_clearance(t, q, qd, qdd, discs, *body[:3]) if len(discs) else (np.inf, 0.0)
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
    torques = jerks = False
    rounding = 0.0
    for j in range(n):
        torques, jerks = torques or limits[TORQUE, j] < np.inf, jerks or limits[JERK, j] < np.inf
        for i in range(samples):
            rounding = max(rounding, ROUNDING * abs(qdd[i, j]))
            for kind in (TORQUE, VELOCITY, ACCELERATION, ANGLE):
                value = tau[i, j] if kind == TORQUE else qd[i, j] if kind == VELOCITY else qdd[i, j]
                value = q[i, j] - middle[j] if kind == ANGLE else value
                _raise(ratios, joints, times, kind, j, t[i], abs(value) / limits[kind, j])
    if not (torques or jerks):
        return ratios, joints, times
    point, inner, quartic = np.empty((3, n)), np.empty((PARTS + 1, n)), np.empty(PARTS + 1)
    blur, mass = np.empty(n), np.empty((n, n))
    for i in range(samples - 1):
        h = t[i + 1] - t[i]
        if torques and h > 0.0:
            for j in range(n):
                inner[PARTS, j] = tau[i, j]
            blurred = _torque_blur(t[i + 1], h, i, q, qd, qdd, rounding, coupling, mass, blur)
            blocks = _blocks(h, i, q, qd)
            for block in range(blocks):
                for j in range(n):
                    inner[0, j], inner[PARTS, j] = inner[PARTS, j], tau[i + 1, j]
                if block + 1 < blocks:
                    _torque((block + 1.0) / blocks, h, i, q, qd, qdd, coupling, weight, point, inner[PARTS])
                doubtful = True
                for k in MIDDLE_FIRST:
                    if doubtful:
                        _torque((block + k / PARTS) / blocks, h, i, q, qd, qdd, coupling, weight, point, inner[k])
                        doubtful = k != PARTS // 2 or blurred or _may_exceed(inner, limits[TORQUE], ratios[TORQUE])
                if doubtful:
                    for j in range(n):
                        _fit_quartic(inner, j, quartic)
                        for k in range(1, 2 * PARTS):
                            load = (_peak(0.5 * k - 0.5 * PARTS, quartic) + blur[j]) / limits[TORQUE, j]
                            place = (block + 0.5 * k / PARTS) / blocks
                            _raise(ratios, joints, times, TORQUE, j, t[i] + place * h, load)
        if jerks:
            for j in range(n):
                if limits[JERK, j] < np.inf:
                    jerk = _jerk(t[i + 1], h, i, j, q, qd, qdd, rounding)
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
    between_samples(s, h, i, q, qd, qdd, point)
    inverse_dynamics_single(coupling, weight, point[0], point[1], point[2], tau)


@inlined
def _blocks(h: float, i: int, q: Array, qd: Array) -> int:
    """Equal blocks of interval ``i``, in each of which five torques show how they go: many where joints spin."""
    turn = 0.0
    for j in range(q.shape[1]):
        turn += max(abs(q[i + 1, j] - q[i, j]), h * abs(qd[i, j]), h * abs(qd[i + 1, j]))
    return 1 + int(min(turn / TURN, MOST_BLOCKS / q.shape[0]))


@private
def _torque_blur(
    end: float,
    h: float,
    i: int,
    q: Array,
    qd: Array,
    qdd: Array,
    rounding: float,
    coupling: Array,
    mass: Array,
    blur: Array,
) -> bool:
    """Whether samples are so close that rounding of the angles turns accelerations and torques between them.

    How far the torques of interval ``i``, which ends at a time, may then lie from the polynomial through five of them,
    because accelerations are cut off where they turn, is written to ``blur``, ``(n,)``.
    """
    n, blurred, least = q.shape[1], False, BLURRED / ROUNDING * rounding
    for j in range(n):
        blur[j] = 0.0
    for j in range(n):
        if _rounding_of_bends(end, h, i, j, q, qd) > least:
            if not blurred:
                mass_matrix_single(coupling, q[i], mass)
            blurred = True
            cut = CUT * overshoot(h, q[i, j], qd[i, j], qdd[i, j], q[i + 1, j], qd[i + 1, j], qdd[i + 1, j])
            cut = min(cut, abs(qdd[i + 1, j] - qdd[i, j]))
            for k in range(n):
                blur[k] += abs(mass[k, j]) * cut
    return blurred


@private
def _fit_quartic(inner: Array, joint: int, quartic: Array) -> None:
    """Write the coefficients of the polynomial through a joint's five torques to ``quartic``; see `QUARTIC`."""
    for power in range(PARTS + 1):
        quartic[power] = 0.0
        for k in range(PARTS + 1):
            quartic[power] += QUARTIC[power, k] * inner[k, joint]


@private
def _peak(place: float, quartic: Array) -> float:
    """Largest |torque| at a place, and where the polynomial turns within half a part of it."""
    at, value = place, 0.0
    for _ in range(ROUNDS):
        torque = slope = bend = 0.0
        for power in range(PARTS, -1, -1):
            bend = at * bend + 2.0 * slope
            slope = at * slope + torque
            torque = at * torque + quartic[power]
        value = max(value, abs(torque))
        if bend == 0.0:
            break
        at = min(place + 0.5, max(place - 0.5, at - slope / bend))
    return value


@private
def _may_exceed(inner: Array, limits: Array, worst: float) -> bool:
    """Whether torques, known at the ends and in the middle of an interval, may be worse between these."""
    for j in range(limits.shape[0]):
        first, half, last = inner[0, j], inner[PARTS // 2, j], inner[PARTS, j]
        change = max(abs(half - first), abs(last - half))
        if max(abs(first), abs(half), abs(last)) + change > worst * limits[j]:
            return True
    return False


@private
def _jerk(end: float, h: float, i: int, j: int, q: Array, qd: Array, qdd: Array, rounding: float) -> float:
    """Largest jerk of joint ``j`` in interval ``i``, which ends at a time; inf for a jump of the acceleration."""
    change = abs(qdd[i + 1, j] - qdd[i, j])
    if h <= 0.0:
        return np.inf if change > JUMP / ROUNDING * rounding else 0.0
    blur = rounding + _rounding_of_bends(end, h, i, j, q, qd)
    most = peak_jerk(h, q[i, j], qd[i, j], qdd[i, j], q[i + 1, j], qd[i + 1, j], qdd[i + 1, j])
    return float(max(max(0.0, change - rounding) / h, most - PARTS * blur / h))


@private
def _rounding_of_bends(end: float, h: float, i: int, j: int, q: Array, qd: Array) -> float:
    """Rounding of the angles and of the times, which an interpolation divides by the square of the interval."""
    size = abs(q[i, j]) + abs(q[i + 1, j]) + end * (abs(qd[i, j]) + abs(qd[i + 1, j]))
    return float(60.0 * 2.2e-16 * size / (h * h))


@private
def _raise(
    ratios: Array, joints: NDArray[np.int64], times: Array, kind: int, joint: int, time: float, ratio: float
) -> None:
    """Note a ratio if it is the worst so far of its kind; what is no number counts as inf."""
    if np.isnan(ratio):
        ratio = np.inf
    if ratio > ratios[kind]:
        ratios[kind], joints[kind], times[kind] = ratio, joint, time
