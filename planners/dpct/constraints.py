"""The tracking problem on stages of constant jerk: states, index and constraints.

Everything is relative to the target, ``e = r - target``, and time is scaled by the rendezvous time T. The scaled
state ``z = (e, T e', T^2 e'')`` obeys, over a stage of duration ``h`` (a fraction of T) with the constant control
``j = T^3 r'''``,

    z+ = [[1, h, h^2/2], [0, 1, h], [0, 0, 1]] z + (h^3/6, h^2/2, h) j,

which is exact for a target of constant acceleration. Constraints hold at the start, the middle and the end of every
stage: torque (eq 12 within eq 3 of "Motion Planning of a Robot Manipulator for Conveyor Tracking"), joint velocity
(eq 10 within eq 4), acceleration (eq 11 within eq 5) and jerk (its derivative within eq 6). Each is
scaled to [-1, 1].
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from planners.compiled.calls import dividing, private
from planners.motion.path import look_up
from planners.typing import Array

POINT_ROWS = 4
"""Constraints at a point of a stage besides torque, velocity and acceleration: r, r', error, error rate."""


class Tracking(NamedTuple):
    """What is tracked, from where and within which limits. Lengths are in the unit of the path's ``r``.

    Attributes:
        target, start: position, velocity and acceleration of the target and the hand at time 0, ``(3,)``.
        free_acceleration: whether the planner chooses the acceleration at time 0.
        table_start, table_step, table: a :class:`planners.motion.path.PathTable`.
        inverse_limits: 1 / limit (0 for none) of torque, velocity, acceleration and jerk, ``(4, n)``.
        low, high, slowest: bounds of r, and lower bound of r' (-inf for none).
        speed: a typical speed, to scale that bound.
        durations: of the stages, as fractions of T, ``(N,)``.
        error_bounds: bounds of abs(e) and abs(e') from the start of each stage on (inf for none), ``(N, 2)``.
    """

    target: Array
    start: Array
    free_acceleration: bool
    table_start: float
    table_step: float
    table: Array
    inverse_limits: Array
    low: float
    high: float
    slowest: float
    speed: float
    durations: Array
    error_bounds: Array


@njit(cache=True, nogil=True)
def roll_out(tracking: Tracking, time: float, acceleration: float, control: Array) -> Array:
    """Scaled error states at the nodes, ``(N + 1, 3)``."""
    stages = control.shape[0]
    z = np.empty((stages + 1, 3))
    z[0, 0] = tracking.start[0] - tracking.target[0]
    z[0, 1] = time * (tracking.start[1] - tracking.target[1])
    z[0, 2] = time * time * (acceleration - tracking.target[2])
    for k in range(stages):
        advance(z[k], control[k], tracking.durations[k], z[k + 1])
    return z


@njit(cache=True, nogil=True)
def advance(z: Array, control: float, h: float, after: Array) -> None:
    """The state ``h`` later, written to ``after``."""
    after[0] = z[0] + h * (z[1] + h * (z[2] / 2.0 + h * control / 6.0))
    after[1] = z[1] + h * (z[2] + h * control / 2.0)
    after[2] = z[2] + h * control


@private
def cost_matrices(durations: Array) -> tuple[Array, Array]:
    """Exact integrals of e^2 and of (T e')^2 over scaled time, as quadratic forms of ``(z, j)``: each ``(N, 4, 4)``."""
    stages = durations.shape[0]
    taylor = (1.0, 1.0, 0.5, 1.0 / 6.0)
    position, velocity = np.zeros((stages, 4, 4)), np.zeros((stages, 4, 4))
    for k in range(stages):
        h = durations[k]
        for a in range(4):
            for b in range(4):
                both = taylor[a] * taylor[b]
                position[k, a, b] = both * h ** (a + b + 1) / (a + b + 1)
                if a > 0 and b > 0:
                    velocity[k, a, b] = both * a * b * h ** (a + b - 1) / (a + b - 1)
    return position, velocity


@private
def tracking_index(position: Array, velocity: Array, z: Array, control: Array, time: float) -> float:
    """The index J of eq 18, in squared units of r times s, from the integrals of `cost_matrices`."""
    x = np.empty(4)
    total = 0.0
    for k in range(control.shape[0]):
        x[0], x[1], x[2], x[3] = z[k, 0], z[k, 1], z[k, 2], control[k]
        for a in range(4):
            for b in range(4):
                total += x[a] * (time * position[k, a, b] + velocity[k, a, b] / time) * x[b]
    return total


@private
def bounded_rows(tracking: Tracking) -> Array:
    """Which bounds exist: ``(N, rows, 2)``, the lower and the upper one of every constraint; that of T is left out."""
    stages, n = tracking.durations.shape[0], tracking.inverse_limits.shape[1]
    per_point = 3 * n + POINT_ROWS
    bounded = np.zeros((stages, 2 * per_point + 3 * n + 1, 2), dtype=np.bool_)
    for k in range(stages):
        for side in range(2):
            for point in range(2):
                base = point * per_point
                given = k == 0 and point == 0  # nothing to decide at the start but a free acceleration
                for i in range(n):
                    for kind in range(3):
                        decided = not given or (tracking.free_acceleration and kind != 1)
                        bounded[k, base + 3 * i + kind, side] = decided and tracking.inverse_limits[kind, i] > 0.0
                if not given:
                    bounded[k, base + 3 * n, side] = True
                    bounded[k, base + 3 * n + 1, side] = side == 0 and tracking.slowest > -np.inf
                    bounded[k, base + 3 * n + 2, side] = tracking.error_bounds[k, 0] < np.inf
                    bounded[k, base + 3 * n + 3, side] = tracking.error_bounds[k, 1] < np.inf
            for point in range(3):
                for i in range(n):
                    bounded[k, 2 * per_point + point * n + i, side] = tracking.inverse_limits[3, i] > 0.0
    return bounded


@njit(cache=True, nogil=True, error_model="numpy")
def evaluate(
    tracking: Tracking,
    time: float,
    time_low: float,
    time_high: float,
    z: Array,
    control: Array,
    value: Array,
    gradient: Array,
) -> None:
    """Constraints of every stage, to ``value`` ``(N, rows)``, and their gradients by ``(z, T, j)`` of the stage, to
    ``gradient`` ``(N, rows, 5)``, from scaled states ``z`` ``(N + 1, 3)`` and controls ``(N,)``.

    ``time`` is T, s; its bounds are the last row of the first stage.
    """
    n = tracking.inverse_limits.shape[1]
    per_point = 3 * n + POINT_ROWS
    inverse = tracking.inverse_limits
    table, slope, local = np.empty((6, n)), np.empty((6, n)), np.empty(3)
    by_time = np.empty(4)  # how r, r', r'' and r''' change with T where z and j stay
    middle, half_range = 0.5 * (tracking.low + tracking.high), 0.5 * (tracking.high - tracking.low)
    elapsed = 0.0
    for k in range(control.shape[0]):
        j = control[k] / time**3
        for point in range(3):
            s = 0.5 * point * tracking.durations[k]
            advance(z[k], control[k], s, local)
            t = (elapsed + s) * time
            target_speed = tracking.target[1] + t * tracking.target[2]
            r = tracking.target[0] + t * (tracking.target[1] + 0.5 * t * tracking.target[2]) + local[0]
            v = target_speed + local[1] / time
            a = tracking.target[2] + local[2] / time**2
            by_time[0] = (elapsed + s) * target_speed
            by_time[1] = (elapsed + s) * tracking.target[2] - local[1] / time**2
            by_time[2] = -2.0 * local[2] / time**3
            by_time[3] = -3.0 * j / time
            look_up(tracking.table_start, tracking.table_step, tracking.table, r, table, slope)
            for i in range(n):
                f1, f2, f3 = table[0, i], table[1, i], table[2, i]
                inertia, bias, weight = table[3, i], table[4, i], table[5, i]
                if point < 2:
                    # torque, eq 12; velocity, eq 10; acceleration, eq 11
                    row = point * per_point + 3 * i
                    c = inverse[0, i]
                    value[k, row] = c * (inertia * a + bias * v * v + weight)
                    dr = slope[3, i] * a + slope[4, i] * v * v + slope[5, i]
                    _chain(gradient[k, row], s, time, by_time, c * dr, c * 2.0 * bias * v, c * inertia, 0.0)
                    c = inverse[1, i]
                    value[k, row + 1] = c * f1 * v
                    _chain(gradient[k, row + 1], s, time, by_time, c * f2 * v, c * f1, 0.0, 0.0)
                    c = inverse[2, i]
                    value[k, row + 2] = c * (f2 * v * v + f1 * a)
                    dr = f3 * v * v + f2 * a
                    _chain(gradient[k, row + 2], s, time, by_time, c * dr, c * 2.0 * f2 * v, c * f1, 0.0)
                # jerk: the derivative of eq 11
                row = 2 * per_point + point * n + i
                c = inverse[3, i]
                value[k, row] = c * (f3 * v**3 + 3.0 * f2 * v * a + f1 * j)
                dr = slope[2, i] * v**3 + 3.0 * f3 * v * a + f2 * j
                dv = 3.0 * f3 * v * v + 3.0 * f2 * a
                _chain(gradient[k, row], s, time, by_time, c * dr, c * dv, c * 3.0 * f2 * v, c * f1)
            if point < 2:
                # place, speed and errors of the hand
                row = point * per_point + 3 * n
                value[k, row] = (r - middle) / half_range
                _chain(gradient[k, row], s, time, by_time, 1.0 / half_range, 0.0, 0.0, 0.0)
                value[k, row + 1] = (v - tracking.slowest) / tracking.speed - 1.0 if tracking.slowest > -np.inf else 0.0
                _chain(gradient[k, row + 1], s, time, by_time, 0.0, 1.0 / tracking.speed, 0.0, 0.0)
                by_time[0], by_time[1] = 0.0, -local[1] / time**2  # of the error, no longer of the hand
                c = 1.0 / tracking.error_bounds[k, 0]
                value[k, row + 2] = c * local[0]
                _chain(gradient[k, row + 2], s, time, by_time, c, 0.0, 0.0, 0.0)
                c = 1.0 / tracking.error_bounds[k, 1]
                value[k, row + 3] = c * local[1] / time
                _chain(gradient[k, row + 3], s, time, by_time, 0.0, c, 0.0, 0.0)
        value[k, -1] = 0.0
        for i in range(5):
            gradient[k, -1, i] = 0.0
        elapsed += tracking.durations[k]
    if time_low < time_high:
        half = 0.5 * (time_high - time_low)
        value[0, -1] = (time - 0.5 * (time_low + time_high)) / half
        gradient[0, -1, 3] = 1.0 / half


@dividing
def _chain(out: Array, s: float, time: float, by_time: Array, dr: float, dv: float, da: float, dj: float) -> None:
    """Gradient by ``(z, T, j)`` of a quantity with derivatives ``dr .. dj`` by r .. r''' at ``s`` into the stage."""
    v, a, j = dv / time, da / time**2, dj / time**3
    out[0] = dr
    out[1] = dr * s + v
    out[2] = (dr * 0.5 * s + v) * s + a
    out[3] = dr * by_time[0] + dv * by_time[1] + da * by_time[2] + dj * by_time[3]
    out[4] = ((dr * s / 6.0 + 0.5 * v) * s + a) * s + j
