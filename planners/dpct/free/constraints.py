"""A chase on stages of constant jerk relative to the ride: states and constraints of every joint.

The error of a joint is its angle less that of the ride with the target, ``e = q - q*(t)``. Time is scaled by the
rendezvous time T as in :mod:`planners.dpct.constraints`: ``z = (e, T e', T^2 e'')`` of every joint, and the control is
``T^3 e'''``. The end of the stages is ``z = 0``. Constraints hold at the start and the middle of every stage: torque,
joint velocity, acceleration, jerk and angle, each scaled to [-1, 1], and, from a stage on, the hand's errors of
position ``J e`` and velocity ``J e' + J' e``, within an octagon in each tolerance.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from planners.compiled.calls import dividing, private
from planners.dpct.constraints import advance
from planners.robot.dynamics import inverse_dynamics_single, mass_matrix_single
from planners.typing import Array

TORQUE, VELOCITY, ACCELERATION, JERK, ANGLE = range(5)
"""Rows of the limits."""

SIDES = 4
"""Pairs of parallel sides of an octagon."""

NUDGE = 1e-6
"""Change of an angle (rad) or a velocity (rad/s) for the derivatives of the torque."""


class Chase(NamedTuple):
    """What is chased, from where and within which limits.

    Attributes:
        start: angles, velocities and accelerations at time 0, ``(3, n)``.
        step, ride: time between the nodes, s, and angles of the ride with their derivatives, ``(nodes, 4, n)``.
        jacobians: of the hand on the ride, and their rates, ``(nodes, 2, 2, n)``.
        coupling, weight: of the loaded arm; see `planners.robot.dynamics`.
        inverse_limits: 1 / limit (0 for none) by `TORQUE` to `ANGLE`, ``(5, n)``.
        middle: of the joint ranges, ``(n,)``, rad.
        durations: of the stages, as fractions of T, ``(N,)``.
        settled: stage from which on the hand is within the tolerances.
        tolerances: of position (m) and velocity (m/s), ``(2,)``.
    """

    start: Array
    step: float
    ride: Array
    jacobians: Array
    coupling: Array
    weight: Array
    inverse_limits: Array
    middle: Array
    durations: Array
    settled: int
    tolerances: Array


@njit(cache=True, nogil=True)
def roll_out(chase: Chase, time: float, control: Array) -> Array:
    """Scaled errors at the nodes, ``(N + 1, n, 3)``, under the scaled jerks ``control`` ``(N, n)``."""
    stages, n = control.shape
    z = np.empty((stages + 1, n, 3))
    for i in range(n):
        z[0, i, 0] = chase.start[0, i] - chase.ride[0, 0, i]
        z[0, i, 1] = time * (chase.start[1, i] - chase.ride[0, 1, i])
        z[0, i, 2] = time * time * (chase.start[2, i] - chase.ride[0, 2, i])
        for k in range(stages):
            advance(z[k, i], control[k, i], chase.durations[k], z[k + 1, i])
    return z


@private
def bounded_rows(chase: Chase) -> Array:
    """Which bounds exist: ``(N, rows, 2)``; that of T, the last row, is left out."""
    stages, n = chase.durations.shape[0], chase.middle.shape[0]
    per_point = 5 * n + 2 * SIDES
    bounded = np.zeros((stages, 2 * per_point + 1, 2), dtype=np.bool_)
    for k in range(stages):
        for point in range(2):
            given = k == 0 and point == 0  # nothing to decide at the start but the jerk
            for side in range(2):
                for kind in range(5):
                    for i in range(n):
                        decided = not given or kind == JERK
                        row = point * per_point + kind * n + i
                        bounded[k, row, side] = decided and chase.inverse_limits[kind, i] > 0.0
                for i in range(2 * SIDES):
                    bounded[k, point * per_point + 5 * n + i, side] = k >= chase.settled and not given
    return bounded


@njit(cache=True, nogil=True, error_model="numpy")
def evaluate(
    chase: Chase,
    time: float,
    time_low: float,
    time_high: float,
    z: Array,
    control: Array,
    value: Array,
    gradient: Array,
) -> None:
    """Constraints of every stage, to ``value`` ``(N, rows)``, and their gradients, to ``gradient``
    ``(N, rows, 4 n + 1)``: by z of every joint, by T, and by the controls.

    ``gradient`` is all 0 at the first call. ``time`` is T, s; its bounds are the last row of the first stage.
    """
    stages, n = control.shape
    per_point, last = 5 * n + 2 * SIDES, chase.ride.shape[0] - 1
    local, motion, star = np.empty((n, 3)), np.empty((4, n)), np.empty((4, n))
    by_time = np.empty((4, n))  # how angle .. jerk change with T where z and the control stay
    tau, moved, mass, by_q, by_qd = np.empty(n), np.empty(n), np.empty((n, n)), np.empty((n, n)), np.empty((n, n))
    weights = np.empty(4)
    elapsed = 0.0
    for k in range(stages):
        for point in range(2):
            s = 0.5 * point * chase.durations[k]
            share = elapsed + s
            t = share * time
            node = min(int(t / chase.step + 0.5), last)
            dt = t - node * chase.step
            for i in range(n):
                advance(z[k, i], control[k, i], s, local[i])
                q, qd, qdd, jerk = (
                    chase.ride[node, 0, i], chase.ride[node, 1, i], chase.ride[node, 2, i], chase.ride[node, 3, i]
                )  # fmt: skip
                star[0, i] = q + dt * (qd + dt * (qdd / 2.0 + dt * jerk / 6.0))
                star[1, i] = qd + dt * (qdd + dt * jerk / 2.0)
                star[2, i], star[3, i] = qdd + dt * jerk, jerk
                motion[0, i] = star[0, i] + local[i, 0]
                motion[1, i] = star[1, i] + local[i, 1] / time
                motion[2, i] = star[2, i] + local[i, 2] / time**2
                motion[3, i] = star[3, i] + control[k, i] / time**3
                by_time[0, i] = share * star[1, i]
                by_time[1, i] = share * star[2, i] - local[i, 1] / time**2
                by_time[2, i] = share * star[3, i] - 2.0 * local[i, 2] / time**3
                by_time[3, i] = -3.0 * control[k, i] / time**4
            # torque, linearised by nudges
            inverse_dynamics_single(chase.coupling, chase.weight, motion[0], motion[1], motion[2], tau)
            mass_matrix_single(chase.coupling, motion[0], mass)
            for j in range(n):
                for kind in range(2):
                    motion[kind, j] += NUDGE
                    inverse_dynamics_single(chase.coupling, chase.weight, motion[0], motion[1], motion[2], moved)
                    motion[kind, j] -= NUDGE
                    for i in range(n):
                        if kind == 0:
                            by_q[i, j] = (moved[i] - tau[i]) / NUDGE
                        else:
                            by_qd[i, j] = (moved[i] - tau[i]) / NUDGE
            base = point * per_point
            for i in range(n):
                c = chase.inverse_limits[TORQUE, i]
                row = base + TORQUE * n + i
                value[k, row], gradient[k, row, 3 * n] = c * tau[i], 0.0
                for j in range(n):
                    weights[0], weights[1], weights[2], weights[3] = by_q[i, j], by_qd[i, j], mass[i, j], 0.0
                    _chain(gradient[k, row], n, j, s, time, by_time, weights, c)
                for kind in range(1, 5):
                    c = chase.inverse_limits[kind, i]
                    order = kind % 4  # of the derivative: 0 for the angle
                    row = base + kind * n + i
                    middle = chase.middle[i] if kind == ANGLE else 0.0
                    value[k, row], gradient[k, row, 3 * n] = c * (motion[order, i] - middle), 0.0
                    weights[:] = 0.0
                    weights[order] = 1.0
                    _chain(gradient[k, row], n, i, s, time, by_time, weights, c)
            if k >= chase.settled:
                for i in range(n):  # of the errors, no longer of the joints
                    by_time[0, i], by_time[1, i] = 0.0, -local[i, 1] / time**2
                for side in range(SIDES):
                    cosine, sine = math.cos(side * math.pi / SIDES), math.sin(side * math.pi / SIDES)
                    for kind in range(2):
                        row = base + 5 * n + kind * SIDES + side
                        c = 1.0 / (chase.tolerances[kind] * math.cos(0.5 * math.pi / SIDES))
                        value[k, row], gradient[k, row, 3 * n] = 0.0, 0.0
                        for i in range(n):
                            along = cosine * chase.jacobians[node, 0, 0, i] + sine * chase.jacobians[node, 0, 1, i]
                            rate = cosine * chase.jacobians[node, 1, 0, i] + sine * chase.jacobians[node, 1, 1, i]
                            weights[:] = 0.0
                            if kind == 0:
                                weights[0] = along
                            else:
                                weights[0], weights[1] = rate, along
                            value[k, row] += c * (weights[0] * local[i, 0] + weights[1] * local[i, 1] / time)
                            _chain(gradient[k, row], n, i, s, time, by_time, weights, c)
        elapsed += chase.durations[k]
    for k in range(stages):
        value[k, -1] = 0.0
    if time_low < time_high:
        half = 0.5 * (time_high - time_low)
        value[0, -1] = (time - 0.5 * (time_low + time_high)) / half
        gradient[0, -1, 3 * n] = 1.0 / half


@dividing
def _chain(out: Array, n: int, i: int, s: float, time: float, by_time: Array, weights: Array, scale: float) -> None:
    """Gradient of a quantity with derivatives ``scale * weights`` by angle .. jerk of joint ``i``, at ``s`` in a stage.

    By z and the control of that joint it is written, by T added.
    """
    dq, v, a, j = scale * weights[0], scale * weights[1] / time, scale * weights[2] / time**2, scale * weights[3]
    out[3 * i] = dq
    out[3 * i + 1] = dq * s + v
    out[3 * i + 2] = (dq * 0.5 * s + v) * s + a
    out[3 * n + 1 + i] = ((dq * s / 6.0 + 0.5 * v) * s + a) * s + j / time**3
    for order in range(4):
        out[3 * n] += scale * weights[order] * by_time[order, i]
