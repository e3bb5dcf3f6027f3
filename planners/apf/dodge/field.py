"""The controller: from the state of arms and discs to joint accelerations, one row of a batch at a time."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from planners.apf.dodge.discs import observe_discs, predict_discs
from planners.apf.dodge.escape import escape, escape_room
from planners.apf.dodge.gains import DodgeGains, as_record, make_instants
from planners.apf.dodge.look_ahead import STATE, DodgeScene
from planners.apf.dodge.proposals import choose_well
from planners.apf.dodge.whole_arm import goal_postures, joint_attraction, keep_limits, make_body, time_to
from planners.checks import floats, require_all_finite, require_finite, require_shape
from planners.compiled.calls import private, require_compiled
from planners.robot.arm import Arm
from planners.typing import Array

TOLERANCE_SHARE = 0.85
"""Distance from the goal that counts as reached in the look-ahead, as a share of the tolerance."""


def new_memory(rows: int, discs: int) -> NDArray[Any]:
    """The controller's memory of each row, all zeros where an episode begins.

    Returns:
        A structured array, ``(batch,)``; ``memory[row] = 0`` resets a row.
    """
    fields: list[tuple[Any, ...]] = [
        ("begun", "?"),
        ("decided", "?"),  # in the last period: the decision holds for two
        ("detour", "?"),
        ("elbow", "i8"),
        ("held", "f8"),
        ("share", "f8"),
        ("well", "f8", (2,)),
        ("disc_velocity", "f8", (discs, 2)),
    ]
    return np.zeros(rows, dtype=fields)


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
    forecast: ArrayLike | None = None,
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
        memory: from `new_memory`, updated in place.
        period: control period, s.
        tolerance: distance from the goal that counts as reached, m.
        hold_time: time for which the goal has to be held, s; the simulated episode ends once it has been held.
        forecast: where the discs will be at multiples of `STEP`, ``(batch, steps, discs, 2)``, m, with the steps of
            `look_ahead_steps`; the field's own prediction when left out. It is read in the periods of a decision.

    Returns:
        ``(batch, 2)``, rad/s^2. A row with its goal out of reach brakes and evades.

    Raises:
        ValueError: if shapes do not fit, or the arm does not have two links.
        ImportError: where NUMBA_DISABLE_JIT is set.
    """
    body, values, instants = _prepared(arm, gains)
    require_finite("period", period, "s", "positive")
    if memory.ndim != 1 or not (memory.dtype.names and "disc_velocity" in memory.dtype.names and memory.flags.carray):
        raise ValueError("memory must be an array as new_memory makes it, which can be written to")
    rows, discs = len(memory), memory.dtype["disc_velocity"].shape[0]
    angles, speeds, hands = (
        _shaped(name, array, (rows, 2)) for name, array in {"q": q, "qd": qd, "goal": goal}.items()
    )
    places, rates = (
        _shaped("positions", positions, (rows, discs, 2)),
        _shaped("velocities", velocities, (rows, discs, 2)),
    )
    states = np.zeros(1, STATE)
    states["tolerance"], states["need"] = TOLERANCE_SHARE * tolerance, hold_time + 0.5 * period
    base, sizes, qdd = arm.base_array, _shaped("radii", radii, (rows, discs)), np.empty_like(angles)
    require_all_finite("radii", sizes, "not negative")
    room = escape_room() if discs > 1 or forecast is not None else None
    expected = None
    if forecast is not None:
        expected = _shaped("forecast", forecast, (rows, len(instants), discs, 2)) - base
    _dodge_batch(
        body,
        values,
        instants,
        states,
        angles,
        speeds,
        hands - base,
        places - base,
        rates,
        sizes,
        memory,
        period,
        qdd,
        room,
        expected,
    )
    return qdd


def _shaped(name: str, array: ArrayLike, shape: tuple[int, ...]) -> Array:
    given = np.ascontiguousarray(floats(name, array))
    require_shape(name, given, shape)
    require_all_finite(name, given)
    return given


@lru_cache(maxsize=64)
def _prepared(arm: Arm, gains: DodgeGains) -> tuple[Any, Any, NDArray[Any]]:
    """Arm, gains and instants of the look-ahead for compiled code."""
    require_compiled("the field among discs")
    return make_body(arm), as_record(gains), make_instants(gains)


@njit(cache=True, nogil=True)
def _dodge_batch(
    body: Any,
    gains: Any,
    instants: NDArray[Any],
    states: NDArray[Any],
    q: Array,
    qd: Array,
    goal: Array,
    positions: Array,
    velocities: Array,
    radii: Array,
    memory: Any,
    period: float,
    qdd: Array,
    room: Array | None,
    expected: Array | None,
) -> None:
    """Fill in the accelerations of every row; without ``room`` for it, the escape is not compiled.

    Where the places of the discs are given, ``expected``, they are not predicted.
    """
    state, discs = states[0], radii.shape[1]
    places, trends = np.empty((instants.shape[0], discs, 2)), np.empty((discs, 4))
    for row in range(q.shape[0]):
        record = memory[row]
        _set_state(body, q[row], qd[row], goal[row], period, state, record)
        observe_discs(gains, record, positions[row], velocities[row], period, trends)
        if record.decided:
            record.decided = False
        else:
            goal_postures(body, q[row], goal[row, 0], goal[row, 1], state.postures)
            _choose_elbow(body, gains, state, record)
            if expected is not None:
                places[:] = expected[row]
            else:
                predict_discs(gains, instants, positions[row], trends, places)
            scene = DodgeScene(body, gains, state, instants, places, radii[row])
            cost = choose_well(scene, record)
            if room is not None and cost > -np.inf:
                escape(scene, record, cost, room)
        record.begun = True
        for i in range(2):
            error, strength = record.well[i] - q[row, i], record.share * body.hardest[i]
            qdd[row, i] = joint_attraction(error, qd[row, i], strength, body.top[i], 1.0 / period)
        keep_limits(body, q[row], qd[row], period, qdd[row])


@private
def _set_state(body: Any, q: Array, qd: Array, goal: Array, period: float, state: Any, record: Any) -> None:
    """Fill in the state of a row, and update the time for which it has held its goal."""
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


@private
def _choose_elbow(body: Any, gains: Any, state: Any, record: Any) -> None:
    """Take the elbow of least time when an episode begins, and set the handicaps of both."""
    if not record.begun:
        record.elbow, least = 0, np.inf
        for branch in range(2):
            time = time_to(body, state.q[0], state.q[1], state.qd[0], state.qd[1], state.postures[branch])
            if time < least:  # False for the NaN of an impossible posture
                record.elbow, least = branch, time
    elif record.elbow != 0:  # it is an index
        record.elbow = 1
    for branch in range(2):
        state.handicaps[branch] = 0.0 if branch == record.elbow else gains.elbow
        if math.isnan(state.postures[branch, 0]):
            state.handicaps[branch] = np.inf
    if state.handicaps[0] == state.handicaps[1] == np.inf:  # out of reach: come to rest
        for i in range(2):
            stop = 0.5 * state.qd[i] * abs(state.qd[i]) / body.cruise[i]
            way = state.q[i] + stop - body.middle[i]
            state.postures[record.elbow, i] = body.middle[i] + min(body.ranges[i], max(-body.ranges[i], way))
        state.handicaps[record.elbow] = 0.0
