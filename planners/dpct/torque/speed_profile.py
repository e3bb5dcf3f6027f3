"""Speed profiles along a path, compiled: how slow and how fast they may be, what a step costs, and the best of a grid.

The state on the way from ``r = 0`` to ``r = 1`` is the speed ``v = r'``. A step from stage to stage has constant path
acceleration ``u``, so ``x = v^2`` is linear in ``r`` (``dx/dr = 2 u``), and torque (eq 12 of "Motion Planning of a
Robot Manipulator for Conveyor Tracking") and joint acceleration (eq 11) are linear in ``(u, x)``:

    tau = A u + B x + G,    q'' = f' u + f'' x

Limits therefore are half-planes in ``(u, x)``, looked at where a step begins, at half its way, and where it ends.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from planners.compiled.calls import private
from planners.typing import Array

ROUNDING = 1e-7
"""Excess of a limit, as a fraction of it, that a step along the edge of what is possible may show."""


class Track(NamedTuple):
    """A path in the form the kernels need; quantities by ``r`` at every stage and half-way between, ``(2 N + 1, n)``.

    Attributes:
        widths: of the steps in r, ``(N,)``.
        slope, curvature: f' and f'', rad.
        inertia, centripetal, static: A, B (kg m^2) and G (N m).
        limits: of torque, joint velocity and joint acceleration, ``(3, n)``.
    """

    widths: Array
    slope: Array
    curvature: Array
    inertia: Array
    centripetal: Array
    static: Array
    limits: Array


@njit(cache=True, nogil=True)
def controllable(track: Track, ceiling: float) -> tuple[Array, Array]:
    """Least and largest x at every stage from which rest at the end can be reached, ``(N + 1,)`` each.

    Backwards from the end, as in H. Pham and Q.-C. Pham, "A New Approach to Time-Optimal Path Parameterization Based on
    Reachability Analysis". Where there is none the two are NaN from that stage backwards. ``ceiling`` bounds x.
    """
    stages = track.widths.shape[0]
    low, high = np.full(stages + 1, np.nan), np.full(stages + 1, np.nan)
    low[stages] = high[stages] = 0.0
    for k in range(stages - 1, -1, -1):
        low[k], high[k] = _squared_speeds(_half_planes(track, k, low[k + 1], high[k + 1], ceiling))
        if low[k] > high[k]:
            low[k] = high[k] = np.nan
            break
    return low, high


@njit(cache=True, nogil=True)
def extreme_profile(track: Track, low: Array, high: Array, ceiling: float, start: float, fastest: bool) -> Array:
    """Speeds at the stages, ``(N + 1,)``, with the largest (or least) acceleration at each, from the speed ``start``.

    ``low`` and ``high`` are those of `controllable`, and ``start`` squared is between their first.
    """
    stages = track.widths.shape[0]
    x = np.empty(stages + 1)
    x[0] = start * start
    for k in range(stages):
        rows = _half_planes(track, k, low[k + 1], high[k + 1], ceiling)
        least, most = _accelerations(rows, x[k])
        u = 0.5 * (least + most) if least > most else (most if fastest else least)
        x[k + 1] = min(max(x[k] + 2.0 * track.widths[k] * u, low[k + 1]), high[k + 1])
    return np.sqrt(x)


@private
def _half_planes(track: Track, k: int, low_next: float, high_next: float, ceiling: float) -> Array:
    """The limits of step ``k`` as rows ``(a, c, d)`` of ``a u + c x <= d``, x where the step begins."""
    n = track.slope.shape[1]
    rows = np.empty((3 * 5 * n + 4, 3))
    count = 0
    gain = 2.0 * track.widths[k]  # of x over the step, by u
    for point in range(3):
        m, part = 2 * k + point, 0.5 * point * gain
        for i in range(n):
            for kind in (0, 2):
                limit = track.limits[kind, i]
                if limit == np.inf:
                    continue
                by_u = track.inertia[m, i] if kind == 0 else track.slope[m, i]
                by_x = track.centripetal[m, i] if kind == 0 else track.curvature[m, i]
                still = track.static[m, i] if kind == 0 else 0.0
                by_u += part * by_x
                rows[count, 0], rows[count, 1], rows[count, 2] = by_u, by_x, limit - still
                rows[count + 1, 0], rows[count + 1, 1], rows[count + 1, 2] = -by_u, -by_x, limit + still
                count += 2
            if track.limits[1, i] < np.inf and track.slope[m, i] != 0.0:
                square = (track.limits[1, i] / track.slope[m, i]) ** 2
                rows[count, 0], rows[count, 1], rows[count, 2] = part, 1.0, square
                count += 1
    rows[count, 0], rows[count, 1], rows[count, 2] = gain, 1.0, high_next
    rows[count + 1, 0], rows[count + 1, 1], rows[count + 1, 2] = -gain, -1.0, -low_next
    rows[count + 2, 0], rows[count + 2, 1], rows[count + 2, 2] = 0.0, 1.0, ceiling
    rows[count + 3, 0], rows[count + 3, 1], rows[count + 3, 2] = 0.0, -1.0, 0.0
    return rows[: count + 4]


@private
def _squared_speeds(rows: Array) -> tuple[float, float]:
    """Least and largest x for which some u is within the half-planes, by Fourier-Motzkin elimination of u."""
    low, high = 0.0, np.inf
    for p in range(rows.shape[0]):
        for q in range(rows.shape[0]):
            if rows[p, 0] == 0.0 and q == p:
                c, d = rows[p, 1], rows[p, 2]
            elif rows[p, 0] > 0.0 and rows[q, 0] < 0.0:
                c = rows[q, 1] * rows[p, 0] - rows[p, 1] * rows[q, 0]
                d = rows[q, 2] * rows[p, 0] - rows[p, 2] * rows[q, 0]
            else:
                continue
            if c > 0.0:
                high = min(high, d / c)
            elif c < 0.0:
                low = max(low, d / c)
            elif d < 0.0:
                return np.inf, 0.0
    return low, high


@private
def _accelerations(rows: Array, x: float) -> tuple[float, float]:
    """Least and largest u within the half-planes at x."""
    least, most = -np.inf, np.inf
    for a, c, d in rows:
        if a > 0.0:
            most = min(most, (d - c * x) / a)
        elif a < 0.0:
            least = max(least, (d - c * x) / a)
    return least, most


@njit(cache=True, nogil=True)
def _step(track: Track, k: int, before: float, after: float, squared: bool) -> tuple[float, float]:
    """Torque index and duration of step ``k`` between two speeds; an index of inf beyond the limits or at rest."""
    n = track.slope.shape[1]
    if before + after <= 0.0:
        return np.inf, 0.0
    width = track.widths[k]
    x0, x2 = before * before, after * after
    x1 = 0.5 * (x0 + x2)
    u = (x2 - x0) / (2.0 * width)
    middle = np.sqrt(x1)
    first, second = width / (before + middle), width / (middle + after)  # durations of the halves
    index = 0.0
    for point in range(3):
        m = 2 * k + point
        x = x0 if point == 0 else (x1 if point == 1 else x2)
        load = 0.0
        for i in range(n):
            tau = abs(track.inertia[m, i] * u + track.centripetal[m, i] * x + track.static[m, i])
            qdd = abs(track.slope[m, i] * u + track.curvature[m, i] * x)
            qd = abs(track.slope[m, i]) * (before if point == 0 else (middle if point == 1 else after))
            edge = 1.0 + ROUNDING
            if tau > edge * track.limits[0, i] or qd > edge * track.limits[1, i] or qdd > edge * track.limits[2, i]:
                return np.inf, 0.0
            load += tau * tau if squared else tau
        index += 0.5 * load * (first if point == 0 else (first + second if point == 1 else second))
    return index, first + second


@njit(cache=True, nogil=True)
def price_steps(track: Track, speeds: Array, squared: bool) -> tuple[Array, Array]:
    """Torque index and duration, ``(N, states, states)``, of every step between the speeds of neighbouring stages.

    ``speeds`` are those at the stages, ``(N + 1, states)``; ``squared`` asks for PI2 in place of PI1. The index is inf
    (and the duration 0) where a step breaks a limit.
    """
    stages, states = track.widths.shape[0], speeds.shape[1]
    index = np.empty((stages, states, states))
    duration = np.empty((stages, states, states))
    for k in range(stages):
        for i in range(states):
            for j in range(states):
                index[k, i, j], duration[k, i, j] = _step(track, k, speeds[k, i], speeds[k + 1, j], squared)
    return index, duration


@njit(cache=True, nogil=True)
def best_states(index: Array, duration: Array, rate: float, gate: int) -> tuple[Array, float, float]:
    """States ``(N + 1,)`` of least ``index + rate * duration`` from state 0 of the first stage, and the index and the
    duration of the whole, inf where every way is blocked: backward dynamic programming over the arrays of
    `price_steps`.

    ``gate`` is a stage that must be passed in state 0, -1 for none.
    """
    stages, states = index.shape[0], index.shape[1]
    following = np.zeros((stages, states), dtype=np.int64)
    value, earlier = np.zeros(states), np.empty(states)
    for k in range(stages - 1, -1, -1):
        for i in range(states):
            best, choice = np.inf, 0
            for j in range(states):
                total = index[k, i, j] + rate * duration[k, i, j] + value[j]
                if total < best:
                    best, choice = total, j
            earlier[i], following[k, i] = best, choice
        if k == gate:
            earlier[1:] = np.inf
        value, earlier = earlier, value
    path = np.zeros(stages + 1, dtype=np.int64)
    total_index = total_duration = 0.0
    for k in range(stages):
        path[k + 1] = following[k, path[k]]
        total_index += index[k, path[k], path[k + 1]]
        total_duration += duration[k, path[k], path[k + 1]]
    if not np.isfinite(value[0]):
        total_index = total_duration = np.inf
    return path, total_index, total_duration


@njit(cache=True, nogil=True)
def profile_index(track: Track, speeds: Array, squared: bool) -> float:
    """Torque index of a profile of speeds ``(N + 1,)``; inf if it breaks a limit."""
    total = 0.0
    for k in range(track.widths.shape[0]):
        total += _step(track, k, speeds[k], speeds[k + 1], squared)[0]
    return total
