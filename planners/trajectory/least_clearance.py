"""Least clearance of a motion from discs that keep their velocities, on its continuous course."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from planners.compiled.calls import private
from planners.robot.clearance import clearance_single
from planners.trajectory.interpolate import between_samples
from planners.typing import Array

BLUR, DEPTH, SECTIONS = 2e-6, 24, 25
"""Error of the least clearance, m, most halvings of an interval in search of it, and thirds cut off in the end."""

MOST_GAPS = 100
"""Gaps that are looked at in search of the least clearance, for each sample and disc; joints that spin would take more.
"""


@njit(cache=True, nogil=True)
def least_clearance(
    t: Array, q: Array, qd: Array, qdd: Array, discs: Array, lengths: Array, base: Array, link_radius: float
) -> tuple[float, float]:
    """Least clearance from a disc, and its time.

    A gap changes by no more than the disc and the arm move. An interval is halved until this leaves no room for a gap
    that is smaller than the least so far, but for `BLUR`, or until none can be there because the arm does not reach so
    far, and no surfaces are closer than their axes; around the least of all a search finds the minimum.
    """
    n, left = q.shape[1], MOST_GAPS * (1000 + t.shape[0] * discs.shape[0])
    outward = np.empty(n)
    for j in range(n - 1, -1, -1):
        outward[j] = lengths[j] + (outward[j + 1] if j < n - 1 else 0.0)
    least, when, row, width, closest = np.inf, 0.0, 0, 0.0, discs[0]
    begins, gaps, parts = np.empty(DEPTH + 2), np.empty(DEPTH + 2), np.empty(DEPTH + 2)
    point = np.empty((3, n))
    for number in range(discs.shape[0]):
        disc = discs[number]
        last = clearance_single(lengths, base, link_radius, q[0], disc[0], disc[1], disc[4])
        if last < least:
            least, when, row, width, closest = last, 0.0, 0, 0.0, disc
        for i in range(t.shape[0] - 1):
            h = t[i + 1] - t[i]
            if h <= 0.0:
                continue
            speed = math.hypot(disc[2], disc[3])
            steepness = speed
            for j in range(n):
                steepness += outward[j] * max(abs(qd[i, j]), abs(qd[i + 1, j]))
            # a stack of parts of the interval: where each begins, its share of the interval, and the gap at its end
            before = last
            last = _gap_at(1.0, h, i, t, q, qd, qdd, disc, lengths, base, link_radius, point)
            begins[0], parts[0], gaps[0] = 0.0, 1.0, last
            size = 1
            while size > 0:
                begin, part, after = begins[size - 1], parts[size - 1], gaps[size - 1]
                if after < least:
                    least, when, row, width, closest = after, t[i] + (begin + part) * h, i, part, disc
                half_time = t[i] + (begin + 0.5 * part) * h
                x, y = disc[0] + half_time * disc[2] - base[0], disc[1] + half_time * disc[3] - base[1]
                beyond = max(0.0, math.hypot(x, y) - 0.5 * speed * part * h - outward[0])
                room = max(0.5 * (before + after - steepness * part * h), beyond - link_radius - disc[4])
                enough = room >= least - max(BLUR, 1e-3 * abs(least))
                if enough or size > DEPTH or left == 0:
                    if left == 0 and not enough:
                        least, when, row, width, closest = room, half_time, i, part, disc
                    before = after
                    size -= 1
                    continue
                left -= 1
                half = 0.5 * part
                gap = _gap_at(begin + half, h, i, t, q, qd, qdd, disc, lengths, base, link_radius, point)
                begins[size - 1], parts[size - 1] = begin + half, half
                begins[size], parts[size], gaps[size] = begin, half, gap
                size += 1
    for i in range(max(0, row - 1), min(row + 2, t.shape[0] - 1)):
        h = t[i + 1] - t[i]
        if h <= 0.0:
            continue
        reach = max(width, BLUR) * (t[row + 1] - t[row]) / h
        low, high = min(1.0, max(0.0, (when - t[i]) / h - reach)), min(1.0, max(0.0, (when - t[i]) / h + reach))
        for _ in range(SECTIONS):
            a, b = low + (high - low) / 3.0, high - (high - low) / 3.0
            at_a = _gap_at(a, h, i, t, q, qd, qdd, closest, lengths, base, link_radius, point)
            at_b = _gap_at(b, h, i, t, q, qd, qdd, closest, lengths, base, link_radius, point)
            if at_a < at_b:
                high = b
            else:
                low = a
            if min(at_a, at_b) < least:
                least, when = min(at_a, at_b), t[i] + (a if at_a < at_b else b) * h
    return least, when


@private
def _gap_at(
    s: float,
    h: float,
    i: int,
    t: Array,
    q: Array,
    qd: Array,
    qdd: Array,
    disc: Array,
    lengths: Array,
    base: Array,
    link_radius: float,
    point: Array,
) -> float:
    """Distance from a disc at a share ``s`` of interval ``i``; ``point`` is scratch, ``(3, n)``."""
    between_samples(s, h, i, q, qd, qdd, point)
    time = t[i] + s * h
    x, y = disc[0] + time * disc[2], disc[1] + time * disc[3]
    return float(clearance_single(lengths, base, link_radius, point[0], x, y, disc[4]))
