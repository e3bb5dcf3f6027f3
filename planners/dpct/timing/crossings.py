"""Collision constraints of an arm on a straight joint-space line among discs, in the plane of position and time.

A disc is predicted to keep its velocity, so the clearance is a function of the arm's position ``r`` on the line and the
time ``t``. Points with too little clearance form a forbidden region of the (r, t) plane, which a timing has to avoid.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from planners.compiled.calls import private
from planners.robot.clearance import clearance_single
from planners.typing import Array

STAGE = 0.1  # duration of a stage of the dynamic program, s
CONTACT = 1000.0  # least cost of a contact, s: far above that of any delay
NEAR, NEARER = 2.0, 8.0  # cost per second just below the margin, and its increase as the clearance goes to 0
BETWEEN = 0.005  # clearance added to the margin, m, for the decrease of clearance between samples


class StraightLine(NamedTuple):
    """A straight line in joint space, and a transverse velocity that decays to 0 at a constant deceleration.

    ``q = origin + r direction - across (decay - t)^2 / (2 decay)``, without the last term from ``t = decay`` on.

    Attributes:
        origin, direction: joint angles at ``r = 0``, rad, and a unit vector, ``(n,)``.
        across, decay: transverse joint velocity at time 0, ``(n,)``, rad/s, and when it is 0, s.
        speed, top_speed, acceleration: along the line: at time 0, and the limits, rad/s and rad/s^2.
        low, high: interval of stopping positions within the joint ranges, rad; NaN if the line is infeasible.
        goal: position to come to rest at, rad; NaN for a line without a goal.
        held: number of stages of constant speed, because the transverse braking takes all acceleration.
    """

    origin: Array
    direction: Array
    across: Array
    decay: float
    speed: float
    top_speed: float
    acceleration: float
    low: float
    high: float
    goal: float
    held: int


class ArmLimits(NamedTuple):
    """Limits of torque, velocity, acceleration and angle (from the middle of its range), ``(4, n)``; the middles,
    ``(n,)``, rad; and the dynamics (`Arm.chain_constants`).
    """

    table: Array
    middle: Array
    coupling: Array
    weight: Array


class PredictedDiscs(NamedTuple):
    """An arm and the discs around it, which keep their velocities.

    Attributes:
        lengths, base, link_radius: of the arm, m.
        discs: position, velocity and radius of each, ``(discs, 5)``, m and m/s.
        margin: clearance without cost, m.
        prediction: horizon of the constant-velocity prediction, s.
    """

    lengths: Array
    base: Array
    link_radius: float
    discs: Array
    margin: float
    prediction: float


@njit(cache=True, nogil=True)
def posture(line: StraightLine, r: float, t: float, q: Array) -> None:
    """Joint angles at position ``r``, rad, and time ``t``, s, written to ``q``, ``(n,)``."""
    left = max(0.0, line.decay - t)
    offset = 0.5 * left * left / line.decay if left > 0.0 else 0.0
    for i in range(q.shape[0]):
        q[i] = line.origin[i] + r * line.direction[i] - offset * line.across[i]


@private
def predicted_clearance(scene: PredictedDiscs, q: Array, t: float) -> float:
    """Clearance of posture ``q`` from the closest disc at time ``t``, m."""
    nearest = np.inf
    for i in range(scene.discs.shape[0]):
        x, y = scene.discs[i, 0] + t * scene.discs[i, 2], scene.discs[i, 1] + t * scene.discs[i, 3]
        gap = clearance_single(scene.lengths, scene.base, scene.link_radius, q, x, y, scene.discs[i, 4])
        nearest = min(nearest, gap)
    return nearest


@private
def clearance_cost(scene: PredictedDiscs, clearance: float, t: float) -> float:
    """Cost per second at a clearance; in contact at least `CONTACT`, larger the earlier the contact is."""
    wanted = scene.margin + BETWEEN
    if clearance >= wanted:
        return 0.0
    if clearance < 0.0:
        return CONTACT * (2.0 - t / scene.prediction)
    lacking = 1.0 - clearance / wanted
    return NEAR + NEARER * lacking * lacking


@private
def cost_at(scene: PredictedDiscs, line: StraightLine, r: float, t: float, q: Array) -> float:
    """Cost per second at position ``r`` and time ``t``; ``q`` is scratch, ``(n,)``."""
    posture(line, r, t, q)
    return clearance_cost(scene, predicted_clearance(scene, q, t), t)


@private
def fill_costs(
    scene: PredictedDiscs, line: StraightLine, t: float, first: float, step: float, low: int, high: int, row: Array
) -> None:
    """Costs per second at time ``t`` at the positions ``first + step * index``, for indices from ``low`` to ``high``.

    Clearance changes by no more than the arm moves, so positions that are sure to be clear are skipped.
    """
    q = np.empty(line.origin.shape[0])
    steepness, outward = 0.0, 0.0
    for i in range(q.shape[0] - 1, -1, -1):
        outward += scene.lengths[i]
        steepness += abs(line.direction[i]) * outward
    for index in range(low, high + 1):
        row[index] = 0.0
    index = low
    while index <= high:
        posture(line, first + step * index, t, q)
        clearance = predicted_clearance(scene, q, t)
        if clearance == np.inf:
            return
        row[index] = clearance_cost(scene, clearance, t)
        index += 1 + int(max(0.0, clearance - scene.margin - BETWEEN) / (steepness * step))


@njit(cache=True, nogil=True)
def first_contact(scene: PredictedDiscs, t: Array, q: Array) -> float:
    """Time of the first contact of the postures ``q``, ``(samples, n)``, at times ``t``, s; inf if there is none."""
    for sample in range(t.shape[0]):
        if t[sample] > scene.prediction:
            break
        if predicted_clearance(scene, q[sample], t[sample]) < 0.0:
            return float(t[sample])
    return np.inf
