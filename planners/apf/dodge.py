"""Potential-field control of a two-link arm among moving discs, for a batch of rows.

Every other period a row looks ahead. It is drawn straight into the well of its goal as long as that is predicted to
keep clear of the discs (:mod:`planners.apf.whole_arm`). Where it is not, the field makes proposals
(:mod:`planners.apf.proposals`), each of which is followed into the future (:mod:`planners.apf.safety`). Where somebody
tells several futures, all of them count (:mod:`planners.apf.hedging`).
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from planners.apf.dodge_gains import DodgeGains, as_record, tuned_gains
from planners.apf.hedging import Futures, HedgeGains, Options, choose_hedged, leave_out_unlikely, room_for_options
from planners.apf.proposals import choose_well
from planners.apf.safety import STATE, Scene, keep_limits, make_sight
from planners.apf.whole_arm import forecast, goal_postures, joint_attraction, make_body, notice_discs, time_to
from planners.robot.arm import Arm
from planners.typing import Array

__all__ = ["DodgeGains", "dodge_accelerations", "new_memory", "tuned_gains"]

TOLERANCE_SHARE = 0.85
"""How close to the goal a motion that is looked ahead has to come, as a share of the tolerance."""


def new_memory(rows: int, discs: int) -> NDArray[Any]:
    """What is remembered of each row; all zeros where an episode begins.

    Returns:
        A structured array, ``(batch,)``: ``memory[row] = 0`` forgets a row.
    """
    return np.zeros(
        rows,
        dtype=[
            ("begun", "?"),
            ("decided", "?"),  # in the last period: the decision stands for another one
            ("detour", "?"),
            ("elbow", "i8"),
            ("held", "f8"),
            ("share", "f8"),
            ("well", "f8", (2,)),
            ("seen", "f8", (discs, 2)),
        ],
    )


def dodge_accelerations(
    arm: Arm,
    gains: DodgeGains,
    q: ArrayLike,
    qd: ArrayLike,
    goal: ArrayLike,
    positions: ArrayLike,
    velocities: ArrayLike,
    radii: ArrayLike,
    memory: NDArray[Any],
    period: float,
    *,
    tolerance: float = 0.03,
    hold_time: float = 0.5,
    futures: Futures | None = None,
) -> Array:
    """Mean joint accelerations for the next period that bring the hand to its goal, clear of the discs.

    They keep the arm's limits of acceleration, velocity, range and torque (held for the period).

    Args:
        arm: with two links.
        gains: of the field; `tuned_gains` for the best known.
        q, qd: joint angles and velocities, ``(batch, 2)``, rad and rad/s.
        goal: of the hand, ``(batch, 2)``, m.
        positions, velocities: of the discs, ``(batch, discs, 2)``, m and m/s.
        radii: of the discs, ``(batch, discs)``, m.
        memory: from `new_memory`, brought up to date here.
        period: control period, s.
        tolerance: how close to the goal the hand has to be, m.
        hold_time: for how long; then the episode is over, and so is any danger, s.
        futures: of the discs, at the instants that the gains look at; if left out, discs are taken to go on.

    Returns:
        ``(batch, 2)``, rad/s^2. A goal that no posture within the ranges reaches: the row brakes and evades.

    Raises:
        ValueError: if shapes do not fit, a probability is negative or NaN, or the arm has not two links.
    """
    body, values, sight = _prepared(arm, gains)
    rows, discs = len(memory), memory.dtype["seen"].shape[0]
    angles, speeds, hands = (_shaped(array, (rows, 2)) for array in (q, qd, goal))
    places, rates = (_shaped(array, (rows, discs, 2)) for array in (positions, velocities))
    sizes = _shaped(radii, (rows, discs))
    states = np.zeros(1, STATE)
    states["tolerance"], states["need"] = TOLERANCE_SHARE * tolerance, hold_time + 0.5 * period
    told = futures or Futures(np.empty((rows, 0, len(sight), discs, 2)), np.empty((rows, 0)), HedgeGains())
    count = np.shape(told.weights)[-1]
    ahead, weights = _shaped(told.places, (rows, count, len(sight), discs, 2)), _shaped(told.weights, (rows, count))
    if not (weights >= 0.0).all():
        raise ValueError(f"weights of futures {weights.tolist()}: probabilities are numbers that are not negative")
    hedge, options = as_record(told.hedge), room_for_options(count + 1)
    base = arm.base_array
    qdd = np.empty_like(angles)
    _dodge_batch(
        body, values, sight, states, angles, speeds, hands - base, places - base, rates, sizes, ahead - base, weights,
        hedge, options, memory, period, qdd,
    )  # fmt: skip
    return qdd


def _shaped(array: ArrayLike, shape: tuple[int, ...]) -> Array:
    given = np.ascontiguousarray(array, dtype=float)
    if given.shape != shape:
        raise ValueError(f"got shape {given.shape} where memory asks for {shape}: (batch, ...), (batch, discs, ...)")
    return given


@cache
def _prepared(arm: Arm, gains: DodgeGains) -> tuple[Any, Any, NDArray[Any]]:
    """Arm, gains and the time ahead as the kernels want them."""
    return make_body(arm), as_record(gains), make_sight(gains)


@njit(cache=True, nogil=True)
def _dodge_batch(
    body: Any,
    gains: Any,
    sight: NDArray[Any],
    states: NDArray[Any],
    q: Array,
    qd: Array,
    goal: Array,
    positions: Array,
    velocities: Array,
    radii: Array,
    futures: Array,
    weights: Array,
    hedge: Any,
    options: Options,
    memory: Any,
    period: float,
    qdd: Array,
) -> None:
    count, discs, state = weights.shape[1], radii.shape[1], states[0]
    # What is told, and last the field's own forecast.
    places, chances = np.empty((count + 1, sight.shape[0], discs, 2)), np.empty(count + 1)
    trends = np.empty((discs, 4))
    for row in range(q.shape[0]):
        record = memory[row]
        _look(body, q[row], qd[row], goal[row], period, state, record)
        notice_discs(gains, record, positions[row], velocities[row], period, trends)
        if record.decided:
            record.decided = False
        else:
            goal_postures(body, goal[row, 0], goal[row, 1], state.postures)
            _choose_elbow(body, gains, state, record)
            forecast(gains, sight, positions[row], trends, places[count])
            scene = Scene(body, gains, state, sight, places[count], radii[row])
            if count == 0:
                choose_well(scene, record)
            else:
                places[:count], chances[:count] = futures[row], (1.0 - hedge.inertia) * weights[row]
                chances[count] = hedge.inertia
                leave_out_unlikely(chances)
                choose_hedged(scene, places, chances, hedge, options, record)
        record.begun = True
        for i in range(2):
            error, strength = record.well[i] - q[row, i], record.share * body.hardest[i]
            qdd[row, i] = joint_attraction(error, qd[row, i], strength, body.top[i], 1.0 / period)
        keep_limits(body, q[row], qd[row], period, qdd[row])


@njit(cache=True, nogil=True)
def _look(body: Any, q: Array, qd: Array, goal: Array, period: float, state: Any, record: Any) -> None:
    """Fill in the state of a row; for how long it has held its goal so far."""
    angle = 0.0
    x = y = 0.0
    for i in range(2):
        angle += q[i]
        state.q[i], state.qd[i], state.goal[i] = q[i], qd[i], goal[i]
        state.directions[i, 0], state.directions[i, 1] = math.cos(angle), math.sin(angle)
        x += body.lengths[i] * state.directions[i, 0]
        y += body.lengths[i] * state.directions[i, 1]
    there = math.hypot(x - goal[0], y - goal[1]) <= state.tolerance / TOLERANCE_SHARE
    record.held = record.held + period if there and record.begun else 0.0
    state.held = record.held


@njit(cache=True, nogil=True)
def _choose_elbow(body: Any, gains: Any, state: Any, record: Any) -> None:
    """The quicker elbow when an episode begins; what the other one is worse by."""
    if not record.begun:
        record.elbow = 1 if _time_to_posture(body, state, 1) < _time_to_posture(body, state, 0) else 0
    for branch in range(2):
        state.handicaps[branch] = 0.0 if branch == record.elbow else gains.elbow
        if math.isnan(state.postures[branch, 0]):
            state.handicaps[branch] = np.inf
    if state.handicaps[0] == state.handicaps[1] == np.inf:  # out of reach: come to rest
        for i in range(2):
            stop = 0.5 * state.qd[i] * abs(state.qd[i]) / body.cruise[i]
            state.postures[record.elbow, i] = min(body.ranges[i], max(-body.ranges[i], state.q[i] + stop))
        state.handicaps[record.elbow] = 0.0


@njit(cache=True, nogil=True)
def _time_to_posture(body: Any, state: Any, branch: int) -> float:
    if math.isnan(state.postures[branch, 0]):
        return np.inf
    return time_to(body, state.q[0], state.q[1], state.qd[0], state.qd[1], state.postures[branch])
