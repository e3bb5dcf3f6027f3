"""When a line is crossed: an arm that moves on a straight line in joint space, and discs that cross what it sweeps.

A disc is predicted to move with constant velocity, so where the arm is on its line, ``r``, and the time, ``t``, tell
how far the two are apart. Where that is too little is a forbidden stretch of the plane of r and t, and a timing passes
before it, behind it, or around it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from planners.robot.clearance import clearance_single
from planners.typing import Array

STAGE = 0.1
"""Duration of a stage of the dynamic program, s."""

CONTACT = 1000.0
"""Least price of touching a disc, s: far above that of any delay."""

NEAR, NEARER = 2.0, 8.0
"""Price of a second just inside the margin, and what is added to it as the clearance falls to nothing."""

BETWEEN = 0.005
"""Clearance, m, wanted on top of the margin for what it may fall to between the times at which it is looked at."""


class StraightWay(NamedTuple):
    """A straight line in joint space, and a velocity across it that is shed at a constant rate.

    ``q = origin + r direction - across (shed - t)^2 / (2 shed)``, without the last term from ``t = shed`` on.

    Attributes:
        origin, direction: joint angles at ``r = 0``, rad, and a unit vector, ``(n,)``.
        across, shed: joint velocity across the line at time 0, ``(n,)``, rad/s, and when nothing of it is left, s.
        speed, top_speed, acceleration: along the line: at time 0, and the limits, rad/s and rad/s^2.
        low, high: where it may come to rest, with the joints within their ranges, rad; NaN if the line is of no use.
        goal: place to come to rest at, rad; NaN for a line without a goal.
        held: number of stages in which the speed must stay as it is, because shedding takes all acceleration.
    """

    origin: Array
    direction: Array
    across: Array
    shed: float
    speed: float
    top_speed: float
    acceleration: float
    low: float
    high: float
    goal: float
    held: int


class ArmLimits(NamedTuple):
    """What an arm may do, and its dynamics.

    Attributes:
        table: limits of torque, velocity, acceleration and angle, ``(4, n)``.
        coupling, weight: `Arm.chain_constants`.
    """

    table: Array
    coupling: Array
    weight: Array


class PredictedDiscs(NamedTuple):
    """An arm and the discs around it, which keep their velocities.

    Attributes:
        lengths, base, link_radius: of the arm, m.
        discs: position, velocity and radius of each, ``(discs, 5)``, m and m/s.
        margin: clearance that is wanted, m.
        prediction: how long the velocities of the discs are trusted, s.
    """

    lengths: Array
    base: Array
    link_radius: float
    discs: Array
    margin: float
    prediction: float


@njit(cache=True, nogil=True)
def posture(line: StraightWay, r: float, t: float, q: Array) -> None:
    """Joint angles at place ``r``, rad, and time ``t``, s, written to ``q``, ``(n,)``."""
    left = max(0.0, line.shed - t)
    offset = 0.5 * left * left / line.shed if left > 0.0 else 0.0
    for i in range(q.shape[0]):
        q[i] = line.origin[i] + r * line.direction[i] - offset * line.across[i]


@njit(cache=True, nogil=True)
def predicted_clearance(scene: PredictedDiscs, q: Array, t: float) -> float:
    """Clearance of posture ``q`` from the closest disc at time ``t``, m."""
    nearest = np.inf
    for i in range(scene.discs.shape[0]):
        x, y, vx, vy, radius = scene.discs[i]
        gap = clearance_single(scene.lengths, scene.base, scene.link_radius, q, x + t * vx, y + t * vy, radius)
        nearest = min(nearest, gap)
    return nearest


@njit(cache=True, nogil=True)
def price(scene: PredictedDiscs, clearance: float, t: float) -> float:
    """What a second with this clearance costs, s; for touching `CONTACT` or more, the more the sooner."""
    wanted = scene.margin + BETWEEN
    if clearance >= wanted:
        return 0.0
    if clearance < 0.0:
        return CONTACT * (2.0 - t / scene.prediction)
    lacking = 1.0 - clearance / wanted
    return NEAR + NEARER * lacking * lacking


@njit(cache=True, nogil=True)
def price_row(
    scene: PredictedDiscs, line: StraightWay, t: float, first: float, step: float, low: int, high: int, row: Array
) -> None:
    """Prices at time ``t`` of the places ``first + step * index`` for the indices from ``low`` to ``high``.

    Clearance changes by no more than the arm moves, so places that are sure to be clear are not looked at.
    """
    q = np.empty(line.origin.shape[0])
    steepness, outward = 0.0, 0.0
    for i in range(q.shape[0] - 1, -1, -1):
        outward += scene.lengths[i]
        steepness += abs(line.direction[i]) * outward
    row[low : high + 1] = 0.0
    index = low
    while index <= high:
        posture(line, first + step * index, t, q)
        clearance = predicted_clearance(scene, q, t)
        if clearance == np.inf:
            return
        row[index] = price(scene, clearance, t)
        index += 1 + int(max(0.0, clearance - scene.margin - BETWEEN) / (steepness * step))


@njit(cache=True, nogil=True)
def first_contact(scene: PredictedDiscs, t: Array, q: Array) -> float:
    """When the postures ``q``, ``(samples, n)``, at times ``t`` first touch a disc, s; inf if they do not."""
    for sample in range(t.shape[0]):
        if t[sample] > scene.prediction:
            break
        if predicted_clearance(scene, q[sample], t[sample]) < 0.0:
            return float(t[sample])
    return np.inf
