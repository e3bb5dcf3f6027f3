"""From the potential on the hand to joint velocities (eq 16 to 18).

T. H. Kim, M. S. Park, S. Y. Song, S. K. Hong, "Collision-Free Trajectory Planning for SCARA robot": the hand moves down
the gradient (eq 16), and the inverse of the Jacobian turns its velocity into the joints' (eq 17, 18). The links are not
in the potential.

Eq 18 divides by ``sin(theta_2)``. Where its absolute value is below 0.1 the inverse is therefore damped,
``J^T (J J^T + lambda^2)^-1``, with a lambda that grows smoothly from 0 (Y. Nakamura, H. Hanafusa, "Inverse Kinematic
Solutions with Singularity Robustness").
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np
from numba import njit

from planners.apf.distance_table import DistanceTable, disc_shift
from planners.apf.khatib import Gains, make_gains, p_norm, wall
from planners.compiled.calls import private
from planners.typing import Array

Distance = Literal["table", "static"]

ATTRACTION, REPULSION, INFLUENCE, LOOK_AHEAD = 2.0, 0.004, 0.3, 0.4  # 1/s, m^4/s, m, s: the paper gives none
_NEAR_SINGULAR = 0.1  # of abs(sin(theta_2))
_DAMPING = 0.1  # largest lambda, as a share of the geometric mean of the link lengths


class HandField(NamedTuple):
    """The gains of the potential, ``shifts`` and ``max_speed`` of the :class:`DistanceTable`, and p of eq 19."""

    gains: Gains
    shifts: Array
    max_speed: float
    norm: float


def make_field(
    *,
    square: bool = True,
    distance: Distance | DistanceTable = "table",
    attraction: float = ATTRACTION,
    repulsion: float = REPULSION,
    influence: float = INFLUENCE,
    norm: float = 2.0,
) -> HandField:
    """The paper's field on the hand.

    Args:
        square: Khatib's wall; else eq 8 as printed (see :mod:`planners.apf.khatib`).
        distance: ``"table"`` is eq 20 with a look-ahead time of 0.4 s; ``"static"`` is eq 10; or a table.
        attraction, repulsion, influence: as for :func:`planners.apf.khatib.make_gains`.
        norm: p of the distance from the centre of a disc (eq 19), from 1 to inf. Below 2 it exceeds the true distance,
            and the hand may touch a disc.

    Raises:
        ValueError: if a gain is not finite and positive, the distance is unknown, or the norm is below 1.
    """
    if math.isnan(norm) or norm < 1.0:
        raise ValueError(f"norm {norm:g} must be from 1 to inf: the p of eq 19")
    if not isinstance(distance, DistanceTable):
        if distance not in ("table", "static"):
            raise ValueError(f"distance {distance!r} must be 'table', 'static' or a DistanceTable")
        distance = DistanceTable.looking_ahead(LOOK_AHEAD if distance == "table" else 0.0)
    return HandField(
        make_gains(attraction, repulsion, influence, square), distance.shifts, distance.max_speed, float(norm)
    )


@njit(cache=True, nogil=True)
def joint_rates_single(lengths: Array, q: Array, velocity: Array, rates: Array) -> None:
    """Joint velocities (rad/s), written to ``rates``, that move the hand of a two-link arm at ``velocity`` (m/s).

    Eq 18, damped near its singularity; all arguments ``(2,)``.
    """
    x2, y2 = lengths[1] * np.cos(q[0] + q[1]), lengths[1] * np.sin(q[0] + q[1])
    x, y = lengths[0] * np.cos(q[0]) + x2, lengths[0] * np.sin(q[0]) + y2
    vx, vy = velocity[0], velocity[1]
    product = lengths[0] * lengths[1]
    determinant = product * np.sin(q[1])
    closeness = 1.0 - (determinant / (_NEAR_SINGULAR * product)) ** 2
    if closeness <= 0.0:
        rates[0] = (x2 * vx + y2 * vy) / determinant
        rates[1] = -(x * vx + y * vy) / determinant
        return
    damping = _DAMPING**2 * product * closeness
    a, b, c = y * y + y2 * y2 + damping, -(x * y + x2 * y2), x * x + x2 * x2 + damping  # J J^T + lambda^2
    whole = a * c - b * b
    ux, uy = (c * vx - b * vy) / whole, (a * vy - b * vx) / whole
    rates[0] = x * uy - y * ux
    rates[1] = x2 * uy - y2 * ux


@private
def hand_velocity_single(
    field: HandField,
    hand: Array,
    hand_velocity: Array,
    goal: Array,
    positions: Array,
    velocities: Array,
    radii: Array,
    velocity: Array,
) -> None:
    """Velocity (m/s) of the field at one hand, written to ``velocity``, ``(2,)``: down the gradient (eq 2, 16).

    ``hand`` and ``hand_velocity`` are those of the hand, ``(2,)``, ``positions`` and ``velocities`` of the discs,
    ``(k, 2)``, m and m/s; ``radii``, ``(k,)``, m, include that of the hand.
    """
    for axis in range(2):
        velocity[axis] = field.gains.attraction * (hand[axis] - goal[axis])
    for k in range(radii.shape[0]):
        dx, dy = hand[0] - positions[k, 0], hand[1] - positions[k, 1]
        vx, vy = velocities[k, 0] - hand_velocity[0], velocities[k, 1] - hand_velocity[1]
        distance, along, across, scale = p_norm(dx, dy, field.norm)
        shift = disc_shift(field.shifts, field.max_speed, dx, dy, vx, vy)
        _, slope = wall(field.gains, distance - radii[k] + shift)
        if distance > 0.0:  # no direction at the centre
            velocity[0] += slope * along / scale
            velocity[1] += slope * across / scale
    velocity[0] = -velocity[0]
    velocity[1] = -velocity[1]
