"""The compiled search of the dodging planner: candidates of a motion past discs, rated, and the best refined.

A candidate is a curve of :mod:`planners.lagrange.via.curve`, with its end, its via-nodes and its duration.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from planners.lagrange.via.curve import DEGREE, angle_at, derivative, interpolate
from planners.robot.clearance import clearance_single
from planners.robot.dynamics import inverse_dynamics_single
from planners.typing import Array

DURATIONS, STRETCH, FINER = 6, 1.25, 4
"""How many durations are tried for each end and pattern, the factor from one to the next, and how many times as many,
and as close, on the direct way."""

PACES = np.array([0.0, 0.016, -0.016, -0.032])
"""How far the via-nodes are moved apart along a direct way, as shares of it: less acceleration or less speed."""

STRIDE, SHRINKAGE, ROUNDS = 0.16, 0.7, 6
"""Of the coordinate search: first stride of the via-nodes, rad, its factor from round to round, and their number."""

SHARE = 0.985
"""Share of the limits that is used: they are looked at at instants, and between those there may be more."""

LIMIT_SAMPLES, EFFORT_SAMPLES = 20, 8
"""Intervals between the instants at which the limits, and the torques, are looked at."""

CONTACT = 1000.0
"""Cost of a predicted contact, s, for every second that it comes before the prediction ends, and once more."""

TOUCHING = 0.005
"""Clearance that counts as contact, m, since clearance is looked at at instants."""

LONG_STEP, SHORT_STEP, CLOSING_SPEED = 0.1, 0.02, 4.0
"""Longest and shortest time between those, s, and about how fast arm and disc approach each other at most, m/s."""

INTRUSION = 100.0
"""Cost of having no clearance left, s per s; less in proportion to the share of the margin that is kept."""


class Situation(NamedTuple):
    """The arm, its limits and its state, and the discs, as arrays.

    Attributes:
        lengths, base, link_radius: of the arm, m.
        coupling, weight: of its dynamics; see `planners.robot.dynamics`.
        torque, velocity, acceleration, jerk, angle: limits, ``(n,)``, N m, rad/s, rad/s^2, rad/s^3 and rad.
        q, qd: start, ``(n,)``, rad and rad/s.
        discs: position, velocity and radius, ``(discs, 5)``, m and m/s.
        horizon: longest duration, s.
    """

    lengths: Array
    base: Array
    link_radius: float
    coupling: Array
    weight: Array
    torque: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    angle: Array
    q: Array
    qd: Array
    discs: Array
    horizon: float


class CostModel(NamedTuple):
    """What a motion costs, in seconds. The defaults were chosen on simulated episodes of discs that cross an arm's way.

    Attributes:
        margin: clearance that is to be kept now, m.
        trusted: how long the prediction of the discs counts, less and less, s.
        keep_out: how far from the base the discs stay, m.
        hold: how long a goal is to be held, s.
        growth: how the margin grows with the time ahead, m/s.
        comfort, closeness: clearance from which on a disc does not matter, m, and cost of having none left, s per s.
        effort: cost of full torque of one joint, s per s.
        clearing: how far a disc must have moved until a wait for it may end, m.
        detour: cost of ending elsewhere than at a goal, as a multiple of the least time from there to it.
    """

    margin: float
    trusted: float
    keep_out: float
    hold: float
    growth: float = 0.03
    comfort: float = 0.15
    closeness: float = 1.0
    effort: float = 0.1
    clearing: float = 0.3
    detour: float = 1.5


class Stops(NamedTuple):
    """Postures to come to rest in, ``(stops, n)``, rad, and for each: the cost of ending there (s), how long the arm
    is to stay (s), the shortest duration that is tried (s), and how many of the patterns are tried.
    """

    q: Array
    due: Array
    hold: Array
    soonest: Array
    patterns: Array


class Scratch(NamedTuple):
    """Room for coefficients ``(n, 6)``, one joint state and its torques, ``(n,)`` each, and the last contact, s."""

    c: Array
    q: Array
    qd: Array
    qdd: Array
    tau: Array
    hit: Array


class Found(NamedTuple):
    """The best candidate: its cost, s, the index of its end, -1 if there is none, and its duration, s."""

    cost: float
    end: int
    duration: float


@njit(cache=True, nogil=True)
def search(situation: Situation, model: CostModel, ends: Stops, patterns: Array, via: Array) -> Found:
    """Try every end with every pattern of via-nodes in several durations, and refine the best.

    ``patterns`` are displacements of the via-nodes, ``(patterns, 2, n)``, rad; ``via`` ``(2, n)`` gets those of the
    best.
    """
    n = situation.q.shape[0]
    scratch = Scratch(np.empty((n, DEGREE + 1)), np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.zeros(1))
    best = Found(np.inf, -1, np.nan)
    tried = np.empty((2, n))
    for e in range(ends.q.shape[0]):
        for p in range(ends.patterns[e]):
            straight = p == 0 and ends.patterns[e] > 1
            for pace in PACES if straight else PACES[:1]:
                tried[0] = patterns[p, 0] - pace * (ends.q[e] - situation.q)
                tried[1] = patterns[p, 1] + pace * (ends.q[e] - situation.q)
                duration = ends.soonest[e]
                for _ in range(DURATIONS * (FINER if straight else 1)):
                    cost = rate(situation, model, ends, e, tried, duration, best.cost, scratch)
                    if cost < best.cost:
                        best = Found(cost, e, duration)
                        via[:] = tried
                    duration *= STRETCH ** (1.0 / FINER) if straight else STRETCH
    return _refine(situation, model, ends, via, best, scratch) if best.end >= 0 else best


@njit(cache=True, nogil=True)
def _refine(situation: Situation, model: CostModel, ends: Stops, via: Array, best: Found, scratch: Scratch) -> Found:
    """Coordinate search with shrinking strides over via-nodes and duration."""
    cost, e, duration = best
    stride = STRIDE
    for _ in range(ROUNDS):
        for other in (duration * math.exp(-0.5 * stride), duration * math.exp(0.5 * stride)):
            tried = rate(situation, model, ends, e, via, other, cost, scratch)
            if tried < cost:
                cost, duration = tried, other
                break
        for node in range(via.shape[0]):
            for i in range(via.shape[1]):
                middle = via[node, i]
                for there in (middle - stride, middle + stride):
                    via[node, i] = there
                    tried = rate(situation, model, ends, e, via, duration, cost, scratch)
                    if tried < cost:
                        cost, middle = tried, there
                        break
                via[node, i] = middle
        stride *= SHRINKAGE
    return Found(cost, e, duration)


@njit(cache=True, nogil=True)
def rate(
    situation: Situation,
    model: CostModel,
    ends: Stops,
    e: int,
    via: Array,
    duration: float,
    best: float,
    scratch: Scratch,
) -> float:
    """Cost of a candidate, s; infinite if it breaks a limit or is not below ``best``."""
    cost = duration + ends.due[e]
    if duration > situation.horizon or cost >= best:
        return np.inf
    interpolate(situation.q, situation.qd, ends.q[e], via, duration, scratch.c)
    if not _keeps_limits(situation, scratch.c, duration):
        return np.inf
    cost += _danger(situation, model, scratch, duration, duration + ends.hold[e], best - cost)
    if cost >= best:
        return np.inf
    return float(cost + model.effort * duration * _load(situation, scratch, duration))


@njit(cache=True, nogil=True)
def _keeps_limits(situation: Situation, c: Array, duration: float) -> bool:
    """Whether angles, velocities, accelerations and jerks stay within their limits, or those that the start breaks."""
    for i in range(c.shape[0]):
        far = max(SHARE * situation.angle[i], (1.0 + 1e-6) * abs(situation.q[i]))
        fast = max(SHARE * situation.velocity[i], (1.0 + 1e-6) * abs(situation.qd[i])) * duration
        hard, harsh = SHARE * situation.acceleration[i] * duration**2, SHARE * situation.jerk[i] * duration**3
        _, c1, c2, c3, c4, c5 = c[i]
        for k in range(LIMIT_SAMPLES + 1):
            s = k / LIMIT_SAMPLES
            if abs(2.0 * c2 + s * (6.0 * c3 + s * (12.0 * c4 + s * 20.0 * c5))) > hard:
                return False
            if abs(c1 + s * (2.0 * c2 + s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5)))) > fast:
                return False
            if abs(6.0 * c3 + s * (24.0 * c4 + s * 60.0 * c5)) > harsh:
                return False
            if abs(angle_at(c[i], s)) > far:
                return False
    return True


@njit(cache=True, nogil=True)
def _danger(
    situation: Situation, model: CostModel, scratch: Scratch, duration: float, until: float, best: float
) -> float:
    """Cost of coming close to discs until some time, as far as their prediction is trusted; at least up to ``best``."""
    last = min(until, model.trusted)
    # Where one candidate touches a disc, the next often does too: look there first.
    hit = float(scratch.hit[0])
    touching = CONTACT * (1.0 + model.trusted - hit)
    if hit <= last and touching >= best and _gap(situation, model, scratch, duration, hit) < TOUCHING:
        return touching
    cost = t = 0.0
    while cost < best:
        gap = _gap(situation, model, scratch, duration, t)
        if gap < TOUCHING:
            scratch.hit[0] = t
            return CONTACT * (1.0 + model.trusted - t)
        step = min(LONG_STEP, max(SHORT_STEP, gap / CLOSING_SPEED))
        margin = model.margin + model.growth * t
        trust = 1.0 - t / (model.trusted + LONG_STEP)
        cost += step * trust * INTRUSION * max(0.0, 1.0 - gap / margin)
        cost += step * trust * model.closeness * max(0.0, 1.0 - gap / model.comfort) ** 2
        if t >= last:
            break
        t = min(t + step, last)
    return cost


@njit(cache=True, nogil=True)
def _gap(situation: Situation, model: CostModel, scratch: Scratch, duration: float, t: float) -> float:
    """Clearance at time ``t``, s, also after the end, m."""
    s = min(1.0, t / duration)
    for i in range(scratch.q.shape[0]):
        scratch.q[i] = angle_at(scratch.c[i], s)
    return float(clearance_at(situation, model.keep_out, scratch.q, t))


@njit(cache=True, nogil=True)
def clearance_at(situation: Situation, keep_out: float, q: Array, t: float) -> float:
    """Least clearance of a posture from the discs where they are predicted to be at time ``t``, m.

    They go straight on, but not closer to the base than ``keep_out``, m: around that they slide.
    """
    nearest = np.inf
    for disc in situation.discs:
        x, y = disc[0] + t * disc[2] - situation.base[0], disc[1] + t * disc[3] - situation.base[1]
        away = max(math.hypot(x, y), 1e-9)
        out = max(1.0, keep_out / away)
        x, y = situation.base[0] + out * x, situation.base[1] + out * y
        gap = clearance_single(situation.lengths, situation.base, situation.link_radius, q, x, y, disc[4])
        nearest = min(nearest, gap)
    return float(nearest)


@njit(cache=True, nogil=True)
def _load(situation: Situation, scratch: Scratch, duration: float) -> float:
    """Mean square of the torques as shares of their limits, summed over the joints; infinite if one is exceeded."""
    _, q, qd, qdd, tau, _ = scratch
    total = 0.0
    for k in range(EFFORT_SAMPLES + 1):
        s = k / EFFORT_SAMPLES
        for i in range(q.shape[0]):
            q[i] = derivative(scratch.c[i], 0, s)
            qd[i] = derivative(scratch.c[i], 1, s) / duration
            qdd[i] = derivative(scratch.c[i], 2, s) / duration**2
        inverse_dynamics_single(situation.coupling, situation.weight, q, qd, qdd, tau)
        for i in range(q.shape[0]):
            load = abs(tau[i]) / situation.torque[i]
            if load > SHARE:
                return np.inf
            total += load * load * (0.5 if k in (0, EFFORT_SAMPLES) else 1.0)
    return total / EFFORT_SAMPLES
