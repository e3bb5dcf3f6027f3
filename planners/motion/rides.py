"""Time intervals in which the hand can ride with a moving target within every limit."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners.motion.line import Line
from planners.motion.line_motion import joint_motion, limit_table
from planners.typing import Array

RIDE_LOAD = 1.0 - 2e-5
"""Largest |value| / limit at which the target counts as rideable: below 1, for the peaks between two samples."""

STILL = 1e-9
"""Motion within the horizon, as a fraction of the reach, below which a target counts as standing still."""


class Window(NamedTuple):
    """A time interval in which riding exactly with the target keeps every limit, s."""

    opens: float
    closes: float


def ride_load(line: Line, t: Array) -> Array:
    """|value| / limit of every kind and joint while the hand rides with the target, ``(samples, 4, n)``.

    Infinite where the target is outside ``[line.low, line.high]``.
    """
    r, v, a = line.target_at(t)
    limits = limit_table(line)
    load = np.full((len(t), *limits.shape), np.inf)
    on_line = (r >= line.low) & (r <= line.high)
    if on_line.any():
        _, *values = joint_motion(line, r[on_line], v[on_line], a[on_line], np.zeros(int(on_line.sum())))
        load[on_line] = np.abs(np.stack(values, axis=1)) / limits
    return load


def ride_windows(line: Line) -> list[Window]:
    """Maximal intervals in which the target can be ridden, from time 0 until it leaves the path, in order.

    They are found on a grid (finer within the horizon); the edges are refined inwards to 1e-8 of the horizon. The last
    interval of a resting target closes at infinity.
    """
    horizon, leaving = line.problem.horizon, _leaving_time(line)
    t = np.linspace(0.0, min(horizon, leaving), 241)
    if horizon < leaving < math.inf:
        t = np.append(t, np.linspace(horizon, leaving, 121)[1:])
    rideable = _rideable(line, t)
    edges = np.flatnonzero(rideable[1:] != rideable[:-1])
    times = [_edge(line, t[i], t[i + 1], bool(rideable[i])) for i in edges]
    if rideable[0]:
        times.insert(0, 0.0)
    if rideable[-1]:
        times.append(float(t[-1]) if leaving < math.inf else math.inf)
    return [Window(opens, closes) for opens, closes in zip(times[::2], times[1::2], strict=True) if closes > opens]


def _rideable(line: Line, t: Array) -> NDArray[np.bool_]:
    """Whether the target can be ridden at times ``t``."""
    return np.asarray(ride_load(line, t).max(axis=(1, 2)) <= RIDE_LOAD)


def _edge(line: Line, left: float, right: float, closing: bool) -> float:
    """The last (closing) or first (opening) rideable time of a bracket."""
    for _ in range(3):
        t = np.linspace(left, right, 65)
        first = int(np.argmax(_rideable(line, t) != closing))
        left, right = t[first - 1], t[first]
    return float(left if closing else right)


def _leaving_time(line: Line) -> float:
    """When the target leaves the line beyond the end it moves to, inf if never, s."""
    position, velocity, acceleration = line.target
    horizon = line.problem.horizon
    drift = np.array([0.5 * acceleration * horizon**2, velocity * horizon])
    drift[np.abs(drift) < STILL * line.problem.arm.reach] = 0.0
    if not drift.any():
        return math.inf
    times = [0.0]
    for end in (line.low, line.high):
        roots = np.roots(np.trim_zeros(np.append(drift, position - end), "f"))
        times += [horizon * float(root.real) for root in roots if abs(root.imag) < 1e-12]
    return max(times)
