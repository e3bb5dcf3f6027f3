"""Khatib's potential on the hand: a bowl around the goal and a wall around every disc.

T. H. Kim, M. S. Park, S. Y. Song, S. K. Hong, "Collision-Free Trajectory Planning for SCARA robot", with its equation
numbers, after O. Khatib, "Real-Time Obstacle Avoidance for Manipulators and Mobile Robots":

    (6)       U_att = 1/2 xi |p - p_goal|^2
    (8, 9)    U_rep = 1/2 eta (1 / rho - 1 / rho_0)  up to rho = rho_0, and 0 beyond          "printed"
    Khatib    U_rep = 1/2 eta (1 / rho - 1 / rho_0)^2  up to rho = rho_0, and 0 beyond        the square (8) lacks
    (10)      rho = least distance of the hand p from the obstacle
    (19)      |p - o| = (|x - x'|^p + |y - y'|^p)^(1/p),  with p = 2 "in general"

The slope of the printed form jumps at rho_0 from 0 to ``-eta / (2 rho_0^2)``; that of Khatib's is continuous. The
potential drives the hand's velocity (eq 16), so it is in m^2/s.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from planners.compiled.calls import private
from planners.typing import Array

NEAREST_SHARE = 0.1
"""Share of the influence below which the wall has a constant slope, because it grows to infinity at contact."""


class Gains(NamedTuple):
    """xi, 1/s; eta, m^4/s with the square and m^3/s without it; rho_0, m; whether the wall has Khatib's square."""

    attraction: float
    repulsion: float
    influence: float
    square: bool


def make_gains(attraction: float, repulsion: float, influence: float, square: bool = True) -> Gains:
    """Gains for either form of the wall.

    ``repulsion`` is the eta of Khatib's form, m^4/s; the printed form gets ``2 eta / rho_0``, which has the same slope
    at half the influence.

    Raises:
        ValueError: if one of the numbers is not finite and positive.
    """
    for name, value in (("attraction", attraction), ("repulsion", repulsion), ("influence", influence)):
        if not (math.isfinite(value) and value > 0.0):
            raise ValueError(f"{name} {value} must be finite and positive")
    return Gains(attraction, repulsion if square else 2.0 * repulsion / influence, influence, square)


@njit(cache=True, nogil=True)
def wall(gains: Gains, rho: float) -> tuple[float, float]:
    """Repulsive potential (eq 8, 9) at distance ``rho`` (m) from a disc, m^2/s, and its derivative by rho, m/s."""
    if rho > gains.influence:
        return 0.0, 0.0
    inside = max(rho, NEAREST_SHARE * gains.influence)
    height = 1.0 / inside - 1.0 / gains.influence
    slope = -0.5 * gains.repulsion / (inside * inside)
    if gains.square:
        slope = slope * 2.0 * height
    value = 0.5 * gains.repulsion * (height * height if gains.square else height)
    return value + slope * (rho - inside), slope


@private
def p_norm(x: float, y: float, p: float) -> tuple[float, float, float, float]:
    """The p-norm (eq 19) of a vector and a, b, c: its gradient is ``(a / c, b / c)``; c is 0 for no vector."""
    if p == 2.0:
        norm = math.hypot(x, y)
        return norm, x, y, norm
    wide, high = abs(x), abs(y)
    largest = max(wide, high)
    if largest == 0.0:
        return 0.0, 0.0, 0.0, 0.0
    if p == np.inf:
        return largest, math.copysign(1.0, x) * (wide == largest), math.copysign(1.0, y) * (wide < largest), 1.0
    wide, high = wide / largest, high / largest
    share = (wide**p + high**p) ** (1.0 / p)
    return (
        largest * share,
        math.copysign(wide ** (p - 1.0), x),
        math.copysign(high ** (p - 1.0), y),
        share ** (p - 1.0),
    )


@njit(cache=True, nogil=True)
def potential(
    gains: Gains, hands: Array, goal: Array, positions: Array, radii: Array, norm: float = 2.0
) -> tuple[Array, Array]:
    """Attractive and repulsive potential (eq 6, 8 to 10), each ``(points,)``, m^2/s; eq 3 is their sum.

    Args:
        gains: of the potential.
        hands: positions, ``(points, 2)``, m.
        goal: ``(2,)``, m.
        positions, radii: of the discs, ``(k, 2)`` and ``(k,)``, m; the radii include that of the hand.
        norm: p of eq 19.
    """
    bowl, walls = np.empty(hands.shape[0]), np.zeros(hands.shape[0])
    for i in range(hands.shape[0]):
        x, y = hands[i, 0], hands[i, 1]
        bowl[i] = 0.5 * gains.attraction * ((x - goal[0]) ** 2 + (y - goal[1]) ** 2)
        for k in range(radii.shape[0]):
            distance, _, _, _ = p_norm(x - positions[k, 0], y - positions[k, 1], norm)
            walls[i] += wall(gains, distance - radii[k])[0]
    return bowl, walls
