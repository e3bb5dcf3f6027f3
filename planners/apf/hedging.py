"""Which proposal of the field costs least where a disc may go several ways.

Every proposal is followed into every future (:mod:`planners.apf.safety`). What counts is its mean cost, with recourse:
a danger that lies further ahead than the futures need to part costs little more than the best that could be done about
it then, because by that time it will be seen which of them has come.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planners.apf.proposals import COMPASS, FOLDED, WELL_MARGIN, rest_and_push
from planners.apf.safety import NEVER, STEP, Outlook, Proposal, Scene, look_ahead
from planners.apf.whole_arm import CRUISE_SHARE
from planners.typing import Array

UNLIKELY = 0.05
"""Probability of a future up to which it is not looked at."""

MOST_OPTIONS = 19
"""Proposals at one time: two elbows, the last detour, rest, four displaced wells, four swings, seven refuges."""

SWING = 12
"""Steps for which the field draws in a swing: to the goal's first angle, with the arm folded past the disc."""

NEARBY = 12.0
"""Steps ahead over which a danger loses its claim to say which way the displaced wells lie."""

_OPTION = [
    ("q1", "f8"),
    ("q2", "f8"),
    ("share", "f8"),
    ("steps", "i8"),
    ("elbow", "i8"),
    ("detour", "?"),
    ("bonus", "f8"),
]


@dataclass(frozen=True)
class HedgeGains:
    """How several futures are weighed.

    Attributes:
        alarm: probability of a blocked way above which going straight on is not taken for granted.
        recourse: time ahead from which on it is seen which future has come, s.
        regret: what a danger costs at most that lies further ahead, beyond the best that could be done about it, s.
        inertia: probability given to the disc's going on as it does, whatever else is expected.
    """

    alarm: float = 0.12
    recourse: float = 0.5
    regret: float = 0.5
    inertia: float = 0.25

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0.0 <= value < math.inf:
                raise ValueError(f"{field.name} = {value} must be a number that is not negative")
        if self.inertia > 1.0:
            raise ValueError(f"inertia = {self.inertia} is a probability, at most 1")


class Futures(NamedTuple):
    """Several ways that the discs of each row may go.

    Attributes:
        places: of the discs, `STEP` apart and `STEP` from now, ``(batch, futures, steps, discs, 2)``, m.
        weights: probabilities, ``(batch, futures)``.
        hedge: how they are weighed.
    """

    places: Array
    weights: Array
    hedge: HedgeGains


class Options(NamedTuple):
    """Room for the proposals of one row, and for what becomes of each in each future.

    Attributes:
        proposals: records, ``(MOST_OPTIONS,)``.
        costs: s, ``(MOST_OPTIONS, futures)``.
        steps: when it is closest to a disc, ``(MOST_OPTIONS, futures)``.
    """

    proposals: NDArray[Any]
    costs: Array
    steps: NDArray[np.int64]


def room_for_options(futures: int) -> Options:
    """`Options` for so many futures."""
    shape = (MOST_OPTIONS, futures)
    return Options(np.zeros(MOST_OPTIONS, _OPTION), np.zeros(shape), np.zeros(shape, dtype=np.int64))


@njit(cache=True, nogil=True)
def leave_out_unlikely(weights: Array) -> None:
    """Set small probabilities ``(futures,)`` to zero and scale the others up, in place; the largest one stays."""
    total, likeliest = 0.0, np.argmax(weights)
    for future in range(weights.shape[0]):
        if future == likeliest:
            weights[future] = max(weights[future], 1e-9)
        elif weights[future] <= UNLIKELY:
            weights[future] = 0.0
        total += weights[future]
    for future in range(weights.shape[0]):
        weights[future] /= total


@njit(cache=True, nogil=True)
def choose_hedged(scene: Scene, futures: Array, weights: Array, hedge: Any, options: Options, record: Any) -> None:
    """Choose the well that draws the row, and write it to the record.

    Args:
        scene: of the row; its own places are not looked at.
        futures: places of the discs, ``(futures, steps, discs, 2)``, m from the base.
        weights: probabilities of the futures, ``(futures,)``; those of 0 are not looked at.
        hedge: a record of `HedgeGains`.
        options: room for as many futures.
        record: what is remembered of the row.
    """
    record.decided = True
    clear, pressing, outlook = _straight_on(scene, futures, weights, hedge, options, record)
    if clear:
        _take(record, options.proposals[0])
        return
    count = _propose(_seen_in(scene, futures[pressing]), outlook, options.proposals, record)
    for future in range(futures.shape[0]):
        if weights[future] > 0.0:
            _follow(_seen_in(scene, futures[future]), future, count, hedge, options)
    least, best = np.inf, 0
    for i in range(count):
        cost = -options.proposals[i].bonus
        for future in range(futures.shape[0]):
            if weights[future] > 0.0:
                cost += weights[future] * options.costs[i, future]
        if cost < least:
            least, best = cost, i
    _take(record, options.proposals[best])


@njit(cache=True, nogil=True)
def _straight_on(
    scene: Scene, futures: Array, weights: Array, hedge: Any, options: Options, record: Any
) -> tuple[bool, int, Outlook]:
    """Whether the straight way is clear; the future in which it is most pressingly not; and what it leads to there."""
    goals = scene.state.postures
    straight = _add(options.proposals, 0, goals[record.elbow, 0], goals[record.elbow, 1], record.elbow)
    clear, pressing, most = True, 0, -np.inf
    answer = Outlook(0.0, np.inf, 0, 0.0, 0.0)
    for future in range(futures.shape[0]):
        if weights[future] > 0.0:
            outlook = look_ahead(_seen_in(scene, futures[future]), straight, np.inf)
            if outlook.slack < 0.0:
                urgency = -outlook.slack * weights[future] * math.exp(-outlook.step / NEARBY)
                clear = clear and weights[future] <= hedge.alarm
            else:
                urgency = -1e-3 * outlook.slack
            if urgency > most:
                most, pressing, answer = urgency, future, outlook
    return clear, pressing, answer


@njit(cache=True, nogil=True)
def _propose(scene: Scene, outlook: Outlook, proposals: Any, record: Any) -> int:
    """Write down all proposals after the first, which is there; how many there are then."""
    gains, goals, ranges = scene.gains, scene.state.postures, scene.body.ranges
    elbow, other, count = record.elbow, 1 - record.elbow, 1
    briefly = round(gains.detour / STEP)
    if scene.state.handicaps[other] < np.inf:
        _add(proposals, count, goals[other, 0], goals[other, 1], other)
        count += 1
    if record.detour:
        count = _add_detour(scene, proposals, count, record.well[0], record.well[1], briefly, elbow)
        proposals[count - 1].bonus = gains.constancy
    rest1, rest2, push1, push2 = rest_and_push(scene, outlook)
    count = _add_detour(scene, proposals, count, rest1, rest2, briefly, elbow)
    for along, across in COMPASS:
        well1 = rest1 + gains.push * (along * push1 - across * push2)
        well2 = rest2 + gains.push * gains.push_elbow * (across * push1 + along * push2)
        count = _add_detour(scene, proposals, count, well1, well2, briefly, elbow)
    for branch in range(2):
        if scene.state.handicaps[branch] < np.inf:
            for fold in (-FOLDED, FOLDED):
                count = _add_detour(scene, proposals, count, goals[branch, 0], fold * ranges[1], SWING, branch)
    for swing in range(-1, 2):
        for fold in (-FOLDED, FOLDED):
            well1 = rest1 + swing * gains.retreat
            count = _add_detour(scene, proposals, count, well1, fold * ranges[1], NEVER, elbow)
    return _add_detour(scene, proposals, count, rest1, rest2, NEVER, elbow)


@njit(cache=True, nogil=True)
def _follow(scene: Scene, future: int, count: int, hedge: Any, options: Options) -> None:
    """What every proposal costs in one future, with recourse."""
    costs, steps = options.costs, options.steps
    least = np.inf
    for i in range(count):
        option = options.proposals[i]
        proposal = Proposal(option.q1, option.q2, option.share, option.steps, option.elbow)
        outlook = look_ahead(scene, proposal, np.inf)
        costs[i, future], steps[i, future] = outlook.cost, outlook.step
        least = min(least, outlook.cost)
    for i in range(count):
        if STEP * steps[i, future] >= hedge.recourse - 1e-9:
            costs[i, future] = min(costs[i, future], least + hedge.regret)


@njit(cache=True, nogil=True)
def _add(proposals: Any, i: int, q1: float, q2: float, elbow: int) -> Proposal:
    """Write down the well of a goal posture."""
    option = proposals[i]
    option.q1, option.q2, option.share, option.steps, option.elbow = q1, q2, CRUISE_SHARE, NEVER, elbow
    option.detour, option.bonus = False, 0.0
    return Proposal(q1, q2, CRUISE_SHARE, NEVER, elbow)


@njit(cache=True, nogil=True)
def _add_detour(scene: Scene, proposals: Any, i: int, q1: float, q2: float, steps: int, elbow: int) -> int:
    """Write down another well, within the ranges; how many proposals there are then."""
    option, ranges = proposals[i], scene.body.ranges
    end1, end2 = ranges[0] - WELL_MARGIN, ranges[1] - WELL_MARGIN
    option.q1, option.q2 = min(end1, max(-end1, q1)), min(end2, max(-end2, q2))
    option.share, option.steps, option.elbow = scene.gains.evade, steps, elbow
    option.detour, option.bonus = True, 0.0
    return i + 1


@njit(cache=True, nogil=True, inline="always")
def _seen_in(scene: Scene, places: Array) -> Scene:
    return Scene(scene.body, scene.gains, scene.state, scene.sight, places, scene.radii)


@njit(cache=True, nogil=True)
def _take(record: Any, option: Any) -> None:
    record.elbow, record.share, record.detour = option.elbow, option.share, option.detour
    record.well[0], record.well[1] = option.q1, option.q2
