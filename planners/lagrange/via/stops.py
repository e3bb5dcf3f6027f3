"""Where a motion of the dodging planner may end: at a goal, or in a posture in which the arm waits."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from planners.compiled.calls import private
from planners.lagrange.via.candidates import SHARE, Found, Options, Situation, Stops, search
from planners.motion.double_integrator import rest_time
from planners.typing import Array

SHORTEST = 0.2
"""Least duration of a motion, s."""

CLEARING, SLOWEST = 0.3, 0.03
"""A wait for a disc costs its time for so many metres at its speed, m, at least at this speed, m/s."""

DETOUR = 1.5
"""Cost of ending in a waiting posture, as a multiple of the least time from there to a goal."""


def can_stop(situation: Situation, options: Options, goals: Array, offsets: Array, patterns: Array) -> bool:
    """Whether a motion to a waiting posture keeps the limits, whatever it touches; goals ``(goals, n)`` are not tried.

    ``patterns`` are those of `planners.lagrange.via.candidates.search`, the other arguments those of `list_ends`.
    """
    stops = Stops(*list_ends(situation, options.hold, goals, offsets, len(patterns)))
    stops.patterns[: len(goals)] = 0
    alone = situation._replace(discs=situation.discs[:0])
    return Found(*search(alone, options, stops, patterns, np.zeros((2, goals.shape[1])))).end >= 0


@njit(cache=True, nogil=True)
def list_ends(situation: Situation, hold: float, goals: Array, offsets: Array, patterns: int) -> tuple[Array, ...]:
    """Goals ``(goals, n)``, with every pattern, and waiting postures: where the arm can stop, plus ``offsets``.

    The fields of `Stops`.
    Waiting postures outside of the joint ranges are left out; the motion to them has no via-nodes.
    """
    n, count = goals.shape[1], goals.shape[0]
    most = count + offsets.shape[0]
    q, soonest, due, holds = np.empty((most, n)), np.empty(most), np.zeros(most), np.empty(most)
    tried, still = np.empty(most, np.int64), np.zeros(n)
    for g in range(count):
        holds[g], tried[g] = hold, patterns
        for i in range(n):
            q[g, i] = goals[g, i]
        soonest[g] = max(SHORTEST, _least_time(situation, situation.q, situation.qd, q[g]))
    waiting = 0.0
    for disc in situation.discs:
        waiting = max(waiting, CLEARING / max(math.hypot(disc[2], disc[3]), SLOWEST))
    braking = SHORTEST
    for i in range(n):
        braking = max(braking, 1.001 * abs(situation.qd[i]) / (SHARE * situation.acceleration[i]))
    for k in range(offsets.shape[0]):
        outside = False
        for i in range(n):
            q[count, i] = situation.q[i] + 0.5 * braking * situation.qd[i] + offsets[k, i]
            outside = outside or abs(q[count, i] - situation.middle[i]) > situation.angle[i]
        if outside:
            continue
        holds[count], tried[count], due[count] = np.inf, 1, np.inf
        soonest[count] = max(braking, _least_time(situation, situation.q, situation.qd, q[count]))
        for g in range(goals.shape[0]):
            due[count] = min(due[count], waiting + DETOUR * _least_time(situation, q[count], still, goals[g]))
        count += 1
    return q[:count], due[:count], holds[:count], soonest[:count], tried[:count]


@private
def _least_time(situation: Situation, q: Array, qd: Array, end: Array) -> float:
    """Time in which every joint by itself can come to rest at ``end``, s."""
    longest = 0.0
    for i in range(q.shape[0]):
        top, rise = SHARE * situation.velocity[i], SHARE * situation.acceleration[i]
        longest = max(longest, rest_time(end[i] - q[i], qd[i], top, rise))
    return longest
