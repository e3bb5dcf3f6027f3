"""The wells that the field proposes where the straight motion to the goal is predicted to come too close to a disc.

These are the goal's other elbow posture; as detours, the last one again, the posture in which the arm comes to rest,
and wells displaced from there along the repulsion, against it, and along the circulation in either sense, that is,
passing the disc in front or behind; and, kept until the end of the look-ahead, staying at rest and retreats to a folded
arm. The one of least cost (:func:`planners.apf.dodge.look_ahead.look_ahead`) is taken, which leads out of the local
minima of a sum of forces.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from planners.apf.dodge.gains import STEP
from planners.apf.dodge.look_ahead import NEVER, DodgeScene, Outlook, Proposal, look_ahead, to_go
from planners.apf.dodge.whole_arm import CRUISE_SHARE, repulsion
from planners.compiled.calls import private

COMPASS = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))
"""Directions of displaced wells: shares along the repulsion and along the circulation."""

FOLDED = 0.92
"""Bend of the elbow in a retreat, as a share of its range."""

WELL_MARGIN = 0.02
"""Distance of wells from the ends of the joint ranges, rad."""


@private
def choose_well(scene: DodgeScene, record: Any) -> float:
    """Choose the well that attracts a row and write it to the row's memory.

    Returns:
        Its cost, s; -inf if the straight motion to the goal keeps the margin.
    """
    gains, goals = scene.gains, scene.state.postures
    elbow, other = record.elbow, 1 - record.elbow
    was_detour, last1, last2 = record.detour, record.well[0], record.well[1]
    # straight to the goal, if that keeps the margin; else with the other elbow
    straight = Proposal(goals[elbow, 0], goals[elbow, 1], CRUISE_SHARE, NEVER, elbow)
    outlook = look_ahead(scene, straight, np.inf)
    _take(record, straight, False)
    record.decided = True
    if outlook.slack >= 0.0:
        return -np.inf
    least = outlook.cost
    if scene.state.handicaps[other] < np.inf:
        straight = Proposal(goals[other, 0], goals[other, 1], CRUISE_SHARE, NEVER, other)
        cost = look_ahead(scene, straight, least).cost
        if cost < least:
            least = cost
            _take(record, straight, False)
    # detours: the last one, to rest, and around the disc
    rest1, rest2, push1, push2 = _rest_and_push(scene, outlook)
    briefly = round(gains.detour / STEP)
    if was_detour:
        least = _try_well(scene, record, Proposal(last1, last2, gains.evade, briefly, elbow), least, gains.constancy)
    least = _try_well(scene, record, Proposal(rest1, rest2, gains.evade, briefly, elbow), least, 0.0)
    for along, across in COMPASS:
        well1 = rest1 + gains.push * (along * push1 - across * push2)
        well2 = rest2 + gains.push * gains.push_elbow * (across * push1 + along * push2)
        least = _try_well(scene, record, Proposal(well1, well2, gains.evade, briefly, elbow), least, 0.0)
    # until the end of the look-ahead: retreats, and to rest
    middle2 = scene.body.middle[1]
    for swing in range(-1, 2):
        for fold in (-FOLDED, FOLDED):
            well1, well2 = rest1 + swing * gains.retreat, middle2 + fold * min(scene.body.ranges[1], math.pi)
            least = _try_well(scene, record, Proposal(well1, well2, gains.evade, NEVER, elbow), least, 0.0)
    return float(_try_well(scene, record, Proposal(rest1, rest2, gains.evade, NEVER, elbow), least, 0.0))


@private
def _try_well(scene: DodgeScene, record: Any, wanted: Proposal, least: float, bonus: float) -> float:
    """Take a well if its cost, less its bonus, is below the least so far; the least cost after that."""
    # a well without an end costs at least the time from there to the goal
    if wanted.steps == NEVER and to_go(scene.body, scene.state, wanted.q1, wanted.q2, 0.0, 0.0) > least:
        return least
    middle1, middle2 = scene.body.middle[0], scene.body.middle[1]
    end1, end2 = scene.body.ranges[0] - WELL_MARGIN, scene.body.ranges[1] - WELL_MARGIN
    well1 = middle1 + min(end1, max(-end1, wanted.q1 - middle1))
    well2 = middle2 + min(end2, max(-end2, wanted.q2 - middle2))
    proposal = Proposal(well1, well2, wanted.share, wanted.steps, wanted.elbow)
    cost = look_ahead(scene, proposal, least + bonus).cost - bonus
    if cost >= least:
        return least
    _take(record, proposal, True)
    return cost


@njit(cache=True, nogil=True)
def _take(record: Any, proposal: Proposal, detour: bool) -> None:
    record.well[0], record.well[1], record.share = proposal.q1, proposal.q2, proposal.share
    record.elbow, record.detour = proposal.elbow, detour


@private
def _rest_and_push(scene: DodgeScene, outlook: Outlook) -> tuple[float, float, float, float]:
    """Joint angles of rest after braking, rad, and the direction of the repulsion in joint space.

    The repulsion is that of the disc that comes closest on the straight path, at that instant; its direction is a unit
    vector with the second joint in units of ``push_elbow``.
    """
    body, state, gains = scene.body, scene.state, scene.gains
    rest1 = state.q[0] + 0.5 * state.qd[0] * abs(state.qd[0]) / (gains.evade * body.hardest[0])
    rest2 = state.q[1] + 0.5 * state.qd[1] * abs(state.qd[1]) / (gains.evade * body.hardest[1])
    nearest, push1, push2 = np.inf, 1.0, 0.0
    for disc in range(scene.radii.shape[0]):
        x, y = scene.places[outlook.step, disc]
        distance, turn1, turn2 = repulsion(body, outlook.q1, outlook.q2, x, y)
        if distance - scene.radii[disc] < nearest:
            nearest, push1, push2 = distance - scene.radii[disc], turn1, turn2
    push2 *= gains.push_elbow
    norm = math.hypot(push1, push2)
    if norm < 1e-6:
        return rest1, rest2, 1.0, 0.0
    return rest1, rest2, push1 / norm, push2 / norm
