"""The compiled search of the dodging planner: the best of many candidates, refined.

A candidate is a curve of :mod:`planners.lagrange.via.curve`, given by its end, its via-nodes and its duration.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from planners.compiled.calls import private
from planners.lagrange.via.curve import DEGREE, angle_at, derivative, interpolate
from planners.robot.clearance import clearance_single
from planners.robot.dynamics import inverse_dynamics_single
from planners.typing import Array

DURATIONS, STRETCH, FINER = 6, 1.25, 4
"""Usual number of durations for each end and pattern, the factor from one to the next, and the refinement factor of
that grid on the direct path."""

PACES = np.array([0.0, 0.016, -0.016, -0.032])
"""Displacements of the via-nodes along a direct path, as shares of it: apart for less acceleration, closer for less
speed."""

STRIDE, SHRINKAGE, ROUNDS = 0.16, 0.7, 6
"""Of the coordinate search: first stride of the via-nodes, rad, its factor from round to round, and their number."""

SHARE = 0.985
"""Share of the limits that is used: between the samples there may be more."""

LIMIT_SAMPLES, EFFORT_SAMPLES = 20, 8
"""Intervals between the samples of the limited values, and of the torques."""

MOST_WORK = 1.2e8
"""Evaluations of a joint, for an angle, its limits or its clearance from a disc, that the searches of a plan may make:
arms of two links need a thousandth of them. Each search may use half of those that are left, and each end its share."""

CONTACT = 1000.0
"""Cost of a predicted contact, s: this times (1 + seconds from the contact to the end of the prediction)."""

TOUCHING = 0.005
"""Clearance below which a sample counts as contact, m: allows for the minimum between samples."""

LONG_STEP, SHORT_STEP, CLOSING_SPEED = 0.1, 0.02, 4.0
"""Longest and shortest time between samples of the clearance, s, and largest closing speed of arm and disc, m/s."""

MOST_LONG_STEPS = 500
"""Number of longest steps after which these grow: motions that last for minutes are slow."""

MARGIN_GROWTH, INTRUSION = 0.03, 100.0
"""Growth of the margin with the time ahead, m/s, and cost of zero clearance, s per s, falling to 0 at the margin."""

COMFORT, CLOSENESS = 0.15, 1.0
"""Clearance from which on a disc has no cost, m, and cost of zero clearance, s per s."""

EFFORT = 0.1
"""Cost of full torque of one joint, s per s."""


class Situation(NamedTuple):
    """The arm, its limits and its state, and the discs, as arrays.

    Attributes:
        lengths, base, link_radius: of the arm, m.
        coupling, weight: of its dynamics; see `planners.robot.dynamics`.
        torque, velocity, acceleration, jerk: limits, ``(n,)``, N m, rad/s, rad/s^2 and rad/s^3.
        middle, angle: middle of the joint ranges and half of their width, ``(n,)``, rad.
        q, qd: start, ``(n,)``, rad and rad/s.
        discs: position, velocity and radius, ``(discs, 5)``, m and m/s.
        horizon: longest duration, s.
        left: evaluations that are left to the searches of the plan, ``(1,)``; see `MOST_WORK`.
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
    middle: Array
    angle: Array
    q: Array
    qd: Array
    discs: Array
    horizon: float
    left: Array


class Options(NamedTuple):
    """Options of the same names of :func:`planners.lagrange.via.planner.plan_via`, m and s; and the number of durations
    that are tried for each end and pattern.
    """

    margin: float
    prediction: float
    keep_out: float
    hold: float
    durations: int


class Stops(NamedTuple):
    """Postures to come to rest in, ``(stops, n)``, rad, and for each: the cost of ending there (s), the time of rest
    (s), the shortest duration that is tried (s), and the number of patterns that are tried.
    """

    q: Array
    due: Array
    hold: Array
    soonest: Array
    patterns: Array


class Scratch(NamedTuple):
    """Buffers of coefficients ``(n, 6)``, one joint state and its torques, ``(n,)``; time of the last contact, s."""

    c: Array
    q: Array
    qd: Array
    qdd: Array
    tau: Array
    hit: Array


class Search(NamedTuple):
    """The problem and the buffers shared by all candidates."""

    situation: Situation
    options: Options
    ends: Stops
    scratch: Scratch


class Found(NamedTuple):
    """The best candidate: its cost, s, the index of its end, -1 if there is none, and its duration, s."""

    cost: float
    end: int
    duration: float


@njit(cache=True, nogil=True)
def search(
    situation: Situation, options: Options, ends: Stops, patterns: Array, via: Array
) -> tuple[float, int, float]:
    """Try every end with every pattern of via-nodes in several durations, and refine the best: the fields of a `Found`.

    ``patterns`` are displacements of the via-nodes, ``(patterns, 2, n)``, rad; those of the best are written to
    ``via``, ``(2, n)``.

    What is left of an end's share of the work goes to the next end; see `MOST_WORK`.
    """
    n = situation.q.shape[0]
    scratch = Scratch(np.empty((n, DEGREE + 1)), np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.zeros(1))
    context = Search(situation, options, ends, scratch)
    best = Found(np.inf, -1, np.nan)
    tried = np.empty((2, n))
    budget = 0.5 * situation.left[0]
    spare, total = situation.left[0], max(1, np.sum(ends.patterns))
    for e in range(ends.q.shape[0]):
        spare -= budget * ends.patterns[e] / total
        for p in range(ends.patterns[e]):
            if situation.left[0] < spare:
                break
            straight = p == 0 and ends.patterns[e] > 1
            for pace in PACES:
                if pace != PACES[0] and not straight:
                    break
                for i in range(n):
                    tried[0, i] = patterns[p, 0, i] - pace * (ends.q[e, i] - situation.q[i])
                    tried[1, i] = patterns[p, 1, i] + pace * (ends.q[e, i] - situation.q[i])
                duration = ends.soonest[e]
                for _ in range(options.durations * (FINER if straight else 1)):
                    cost = rate(context, e, tried, duration, best.cost)
                    if cost < best.cost:
                        best = Found(cost, e, duration)
                        for i in range(n):
                            via[0, i], via[1, i] = tried[0, i], tried[1, i]
                    duration *= STRETCH ** (1.0 / FINER) if straight else STRETCH
    if best.end >= 0:
        best = _refine(context, via, best)
    return best.cost, best.end, best.duration


@njit(cache=True, nogil=True)
def _refine(context: Search, via: Array, best: Found) -> Found:
    """Coordinate search with shrinking strides over via-nodes and duration."""
    cost, e, duration = best
    stride = STRIDE
    for _ in range(ROUNDS):
        for other in (duration * math.exp(-0.5 * stride), duration * math.exp(0.5 * stride)):
            tried = rate(context, e, via, other, cost)
            if tried < cost:
                cost, duration = tried, other
                break
        for node in range(via.shape[0]):
            for i in range(via.shape[1]):
                middle = via[node, i]
                for there in (middle - stride, middle + stride):
                    via[node, i] = there
                    tried = rate(context, e, via, duration, cost)
                    if tried < cost:
                        cost, middle = tried, there
                        break
                via[node, i] = middle
        stride *= SHRINKAGE
    return Found(cost, e, duration)


@njit(cache=True, nogil=True)
def rate(context: Search, e: int, via: Array, duration: float, best: float) -> float:
    """Cost of a candidate with end number ``e``, s; infinite if it breaks a limit or is not below ``best``."""
    situation, _, ends, scratch = context
    cost = duration + ends.due[e]
    if duration > situation.horizon or cost >= best:
        return np.inf
    situation.left[0] -= LIMIT_SAMPLES * via.shape[1]
    interpolate(situation.q, situation.qd, ends.q[e], via, duration, scratch.c)
    if not _keeps_limits(situation, scratch.c, duration):
        return np.inf
    cost += _danger(context, duration, duration + ends.hold[e], best - cost)
    if cost >= best:
        return np.inf
    situation.left[0] -= EFFORT_SAMPLES * via.shape[1] ** 2
    return float(cost + EFFORT * duration * _load(situation, scratch, duration))


@private
def _keeps_limits(situation: Situation, c: Array, duration: float) -> bool:
    """Whether angles, velocities, accelerations and jerks stay within their limits, or those that the start breaks."""
    for i in range(c.shape[0]):
        middle, end = situation.middle[i], angle_at(c[i], 1.0)
        far = max(SHARE * situation.angle[i], (1.0 + 1e-6) * abs(situation.q[i] - middle))
        if abs(end - middle) > far:  # a goal close to the end of the range, from inside
            far = abs(end - middle) * (1.0 + 1e-12)
            if (2.0 * c[i, 2] + 6.0 * c[i, 3] + 12.0 * c[i, 4] + 20.0 * c[i, 5]) * (end - middle) > 0.0:
                return False
        fast = max(SHARE * situation.velocity[i], (1.0 + 1e-6) * abs(situation.qd[i])) * duration
        hard, harsh = SHARE * situation.acceleration[i] * duration**2, SHARE * situation.jerk[i] * duration**3
        c1, c2, c3, c4, c5 = c[i, 1], c[i, 2], c[i, 3], c[i, 4], c[i, 5]
        for k in range(LIMIT_SAMPLES + 1):
            s = k / LIMIT_SAMPLES
            if abs(2.0 * c2 + s * (6.0 * c3 + s * (12.0 * c4 + s * 20.0 * c5))) > hard:
                return False
            if abs(c1 + s * (2.0 * c2 + s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5)))) > fast:
                return False
            if abs(6.0 * c3 + s * (24.0 * c4 + s * 60.0 * c5)) > harsh:
                return False
            if abs(angle_at(c[i], s) - middle) > far:
                return False
    return True


@private
def _danger(context: Search, duration: float, until: float, best: float) -> float:
    """Cost of coming close to discs until some time or the end of their prediction, exact where below ``best``."""
    options, scratch, situation = context.options, context.scratch, context.situation
    if situation.discs.shape[0] == 0:
        return 0.0
    last = min(until, options.prediction)
    # Where one candidate touches a disc, the next often does too: check that time first.
    hit = float(scratch.hit[0])
    touching = CONTACT * (1.0 + options.prediction - hit)
    if hit <= last and touching >= best and _gap(context, duration, hit) < TOUCHING:
        return touching
    cost = t = 0.0
    work = (1 + situation.discs.shape[0]) * situation.q.shape[0]
    stretch = max(1.0, last / (MOST_LONG_STEPS * LONG_STEP))
    while cost < best:
        situation.left[0] -= work
        gap = _gap(context, duration, t)
        if gap < TOUCHING:
            scratch.hit[0] = t
            return CONTACT * (1.0 + options.prediction - t)
        step = min(stretch * LONG_STEP, max(stretch * SHORT_STEP, gap / CLOSING_SPEED))
        margin = options.margin + MARGIN_GROWTH * t
        confidence = 1.0 - t / (options.prediction + LONG_STEP)
        cost += step * confidence * INTRUSION * max(0.0, 1.0 - gap / margin)
        cost += step * confidence * CLOSENESS * max(0.0, 1.0 - gap / COMFORT) ** 2
        if t >= last:
            break
        t = min(t + step, last)
    return cost


@njit(cache=True, nogil=True)
def _gap(context: Search, duration: float, t: float) -> float:
    """Least clearance from the predicted discs at time ``t``, s, also after the end, m.

    Discs move straight, and slide around the circle of ``keep_out`` about the base.
    """
    situation, options, _, scratch = context
    s, q, nearest = min(1.0, t / duration), scratch.q, np.inf
    for i in range(q.shape[0]):
        q[i] = angle_at(scratch.c[i], s)
    for k in range(situation.discs.shape[0]):
        disc = situation.discs[k]
        x, y = disc[0] + t * disc[2] - situation.base[0], disc[1] + t * disc[3] - situation.base[1]
        away = max(math.hypot(x, y), 1e-9)
        out = max(1.0, options.keep_out / away)
        x, y = situation.base[0] + out * x, situation.base[1] + out * y
        gap = clearance_single(situation.lengths, situation.base, situation.link_radius, q, x, y, disc[4])
        nearest = min(nearest, gap)
    return float(nearest)


@njit(cache=True, nogil=True)
def _load(situation: Situation, scratch: Scratch, duration: float) -> float:
    """Mean square of torque / limit, summed over the joints; infinite if a torque limit is exceeded."""
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
