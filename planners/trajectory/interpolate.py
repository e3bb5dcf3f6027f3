"""Interpolation between the samples of a motion.

Between two samples a quintic matches angle, velocity and acceleration at both. Each of the three is then kept between
its values at the two samples: where samples are so close that rounding dominates the quintic, it cannot overshoot.
`insert_turning_points` adds samples where a quintic turns inside an interval, so that this cuts nothing off.

Where the acceleration jumps there are two samples at the same time, before and after the jump.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from planners.compiled.calls import dividing, inlined, private
from planners.typing import Array

OVERSHOOT = 1e-9
"""Excess of a quintic over the values at both ends, relative to the largest value of the motion, that is rounding."""

ROUNDING = 1e-13
"""Angles carry this rounding, relative to their size; divided by the squared interval it is that of an acceleration."""

SHORT = 1e-6
"""Interval, as a fraction of the time at its end, in which rounding of times dominates a quintic: left as it is."""

INNER = 1e-6
"""Share of an interval, from either end, in which no turning point is looked for."""


@private
def quintic_between(
    s: float, h: float, q0: float, qd0: float, qdd0: float, q1: float, qd1: float, qdd1: float
) -> tuple[float, float, float]:
    """Angle, velocity and acceleration of one joint at a share ``s`` of the ``h`` s between two samples."""
    v0, a0, v1, a1 = h * qd0, h * h * qdd0, h * qd1, h * h * qdd1
    rest, dv, da = q1 - q0 - v0 - a0 / 2.0, v1 - v0 - a0, a1 - a0
    c3 = 10.0 * rest - 4.0 * dv + 0.5 * da
    c4 = -15.0 * rest + 7.0 * dv - da
    c5 = 6.0 * rest - 3.0 * dv + 0.5 * da
    q = q0 + s * (v0 + s * (a0 / 2.0 + s * (c3 + s * (c4 + s * c5))))
    qd = (v0 + s * (a0 + s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5)))) / h
    qdd = (a0 + s * (6.0 * c3 + s * (12.0 * c4 + s * 20.0 * c5))) / (h * h)
    return q, qd, qdd


@private
def jerk_parabola(
    h: float, q0: float, qd0: float, qdd0: float, q1: float, qd1: float, qdd1: float
) -> tuple[float, float, float]:
    """Coefficients of the jerk of the quintic between two samples, times ``h^3``, in powers of the share of ``h``."""
    rest, dv, da = q1 - q0 - h * (qd0 + h * qdd0 / 2.0), h * (qd1 - qd0 - h * qdd0), h * h * (qdd1 - qdd0)
    first = 60.0 * rest - 24.0 * dv + 3.0 * da
    slope = -360.0 * rest + 168.0 * dv - 24.0 * da
    bend = 360.0 * rest - 180.0 * dv + 30.0 * da
    return first, slope, bend


@private
def peak_jerk(h: float, q0: float, qd0: float, qdd0: float, q1: float, qd1: float, qdd1: float) -> float:
    """Largest |jerk| of the quintic between two samples: at an end, or where the parabola that it is turns."""
    first, slope, bend = jerk_parabola(h, q0, qd0, qdd0, q1, qd1, qdd1)
    most = max(abs(first), abs(first + slope + bend))
    if 0.0 < -slope * bend < 2.0 * bend * bend:
        most = max(most, abs(first - slope * slope / (4.0 * bend)))
    return float(most / h**3)


@dividing
def jerk_roots(h: float, q0: float, qd0: float, qdd0: float, q1: float, qd1: float, qdd1: float) -> tuple[float, float]:
    """The shares of ``h`` at which the acceleration of the quintic between two samples turns; -1 where it does not."""
    first, slope, bend = jerk_parabola(h, q0, qd0, qdd0, q1, qd1, qdd1)
    size = max(abs(first), abs(slope), abs(bend))
    first, slope, bend = first / size, slope / size, bend / size  # whose squares overflow where velocities are huge
    square = slope * slope - 4.0 * bend * first
    if not square > 0.0:
        return -1.0, -1.0
    far = -0.5 * (slope + math.copysign(math.sqrt(square), slope))  # the two terms have the same sign: no cancellation
    return far / bend if bend != 0.0 else -1.0, first / far


@inlined
def overshoot(h: float, q0: float, qd0: float, qdd0: float, q1: float, qd1: float, qdd1: float) -> float:
    """How far the acceleration of the quintic between two samples leaves the range that `between` keeps it in."""
    excess = 0.0
    for s in jerk_roots(h, q0, qd0, qdd0, q1, qd1, qdd1):
        if 0.0 < s < 1.0:
            turn = quintic_between(s, h, q0, qd0, qdd0, q1, qd1, qdd1)[2]
            excess = max(excess, turn - max(qdd0, qdd1), min(qdd0, qdd1) - turn)
    return excess


@njit(cache=True, nogil=True)
def between(
    s: float, h: float, q0: float, qd0: float, qdd0: float, q1: float, qd1: float, qdd1: float
) -> tuple[float, float, float]:
    """As `quintic_between`, with each of the three kept between its values at the ends."""
    q, qd, qdd = quintic_between(s, h, q0, qd0, qdd0, q1, qd1, qdd1)
    q = min(max(q, min(q0, q1)), max(q0, q1))
    qd = min(max(qd, min(qd0, qd1)), max(qd0, qd1))
    qdd = min(max(qdd, min(qdd0, qdd1)), max(qdd0, qdd1))
    return q, qd, qdd


@private
def between_samples(s: float, h: float, i: int, q: Array, qd: Array, qdd: Array, point: Array) -> None:
    """Angles, velocities and accelerations at a share ``s`` of interval ``i``, written to ``point``, ``(3, n)``."""
    for j in range(q.shape[1]):
        point[0, j], point[1, j], point[2, j] = between(
            s, h, q[i, j], qd[i, j], qdd[i, j], q[i + 1, j], qd[i + 1, j], qdd[i + 1, j]
        )


@njit(cache=True, nogil=True)
def interpolate(t: Array, q: Array, qd: Array, qdd: Array, times: Array) -> Array:
    """Angles, velocities and accelerations at ``times``, ``(3, times, n)``; outside the samples, those of the ends.

    At the time of a jump the values after it.
    """
    n = q.shape[1]
    found = np.empty((3, times.shape[0], n))
    for row in range(times.shape[0]):
        after, above = 0, t.shape[0]  # bisection for the first sample after the time
        while after < above:
            middle = (after + above) // 2
            if times[row] < t[middle]:
                above = middle
            else:
                after = middle + 1
        if after == 0 or after == t.shape[0] or not times[row] > t[after - 1]:
            i = 0 if after == 0 else after - 1
            for j in range(n):
                found[0, row, j], found[1, row, j], found[2, row, j] = q[i, j], qd[i, j], qdd[i, j]
            continue
        i, h = after - 1, t[after] - t[after - 1]
        s = (times[row] - t[i]) / h
        for j in range(n):
            found[0, row, j], found[1, row, j], found[2, row, j] = between(
                s, h, q[i, j], qd[i, j], qdd[i, j], q[after, j], qd[after, j], qdd[after, j]
            )
    return found


@njit(cache=True, nogil=True)
def insert_turning_points(t: Array, q: Array, qd: Array, qdd: Array) -> tuple[Array, Array, Array, Array]:
    """The same motion with samples also where an angle, a velocity or an acceleration turns between two samples."""
    samples, n = q.shape
    most = np.zeros(3)
    for i in range(samples):
        for j in range(n):
            most[0], most[1] = max(most[0], abs(q[i, j])), max(most[1], abs(qd[i, j]))
            most[2] = max(most[2], abs(qdd[i, j]))
    shares, counts = np.empty((samples, 4 * n)), np.zeros(samples, np.int64)
    extra = 0
    for i in range(samples - 1):
        counts[i] = _turning_points(i, t, q, qd, qdd, most, shares[i])
        extra += counts[i]
    if extra == 0:
        return t, q, qd, qdd
    times, motion = np.empty(samples + extra), np.empty((3, samples + extra, n))
    row = 0
    for i in range(samples):
        times[row] = t[i]
        for j in range(n):
            motion[0, row, j], motion[1, row, j], motion[2, row, j] = q[i, j], qd[i, j], qdd[i, j]
        row += 1
        for k in range(counts[i]):
            h, s = t[i + 1] - t[i], shares[i, k]
            times[row] = t[i] + s * h
            for j in range(n):
                motion[0, row, j], motion[1, row, j], motion[2, row, j] = quintic_between(
                    s, h, q[i, j], qd[i, j], qdd[i, j], q[i + 1, j], qd[i + 1, j], qdd[i + 1, j]
                )
            row += 1
    return times, motion[0], motion[1], motion[2]


@private
def _turning_points(i: int, t: Array, q: Array, qd: Array, qdd: Array, most: Array, shares: Array) -> int:
    """Write the shares of interval ``i`` at which a value of a joint turns to ``shares``; how many there are."""
    h, count = t[i + 1] - t[i], 0
    if not h > SHORT * t[i + 1]:
        return 0
    for j in range(q.shape[1]):
        ends = q[i, j], qd[i, j], qdd[i, j], q[i + 1, j], qd[i + 1, j], qdd[i + 1, j]
        slowest, fastest = min(qd[i, j], qd[i + 1, j]), max(qd[i, j], qd[i + 1, j])
        least, largest = min(qdd[i, j], qdd[i + 1, j]), max(qdd[i, j], qdd[i + 1, j])
        allowed = OVERSHOOT * most[2] + 60.0 * _rounding(2, h, ends)
        low, high = least, largest
        for s in jerk_roots(h, q[i, j], qd[i, j], qdd[i, j], q[i + 1, j], qd[i + 1, j], qdd[i + 1, j]):
            if INNER < s < 1.0 - INNER:
                value = _value(2, s, h, ends)
                least, largest = min(least, value), max(largest, value)
                if max(value - high, low - value) > allowed:
                    shares[count] = s
                    count += 1
        # a value turns only where the one that it is the integral of is 0
        for kind in (1, 0):
            turns = least < 0.0 < largest if kind == 1 else slowest < 0.0 < fastest
            if turns:
                low, high = min(ends[kind], ends[kind + 3]), max(ends[kind], ends[kind + 3])
                s, value = _extreme(kind, h, ends, low, high)
                slowest, fastest = (min(slowest, value), max(fastest, value)) if kind == 1 else (slowest, fastest)
                allowed = OVERSHOOT * most[kind] + 60.0 * _rounding(kind, h, ends)
                if max(value - high, low - value) > allowed and INNER < s < 1.0 - INNER:
                    shares[count] = s
                    count += 1
    for k in range(1, count):  # sorted by insertion: there are few
        share, place = shares[k], k
        while place > 0 and shares[place - 1] > share:
            shares[place] = shares[place - 1]
            place -= 1
        shares[place] = share
    kept = 0
    for k in range(count):
        if kept == 0 or shares[k] - shares[kept - 1] > INNER:
            shares[kept] = shares[k]
            kept += 1
    return kept


@private
def _rounding(kind: int, h: float, ends: tuple[float, float, float, float, float, float]) -> float:
    """Rounding of an angle (kind 0), a velocity (1) or an acceleration (2) that a quintic has between its ends."""
    return float(ROUNDING * (abs(ends[0]) + abs(ends[3]) + h * (abs(ends[1]) + abs(ends[4]))) / h**kind)


@private
def _extreme(
    kind: int, h: float, ends: tuple[float, float, float, float, float, float], low: float, high: float
) -> tuple[float, float]:
    """The share of the interval, and the value there, that lies furthest outside of ``[low, high]``."""
    best, step = 0.5, 0.125
    excess, value = -np.inf, 0.0
    for k in range(1, 16):
        value = _value(kind, k / 16.0, h, ends)
        if max(value - high, low - value) > excess:
            excess, best = max(value - high, low - value), k / 16.0
    # golden-section search around the best of a grid
    left, right = max(0.0, best - step), min(1.0, best + step)
    for _ in range(40):
        a, b = right - 0.6180339887498949 * (right - left), left + 0.6180339887498949 * (right - left)
        at_a, at_b = _value(kind, a, h, ends), _value(kind, b, h, ends)
        if max(at_a - high, low - at_a) >= max(at_b - high, low - at_b):
            right = b
        else:
            left = a
    best = 0.5 * (left + right)
    return best, _value(kind, best, h, ends)


@private
def _value(kind: int, s: float, h: float, ends: tuple[float, float, float, float, float, float]) -> float:
    """Angle (kind 0), velocity (1) or acceleration (2) at a share ``s`` of an interval with these ends."""
    q, qd, qdd = quintic_between(s, h, ends[0], ends[1], ends[2], ends[3], ends[4], ends[5])
    return q if kind == 0 else qd if kind == 1 else qdd
