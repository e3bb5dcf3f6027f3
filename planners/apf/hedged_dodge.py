"""Potential-field control among a moving disc of which several futures are told, with their probabilities.

As :mod:`planners.apf.dodge`, which forecasts one future itself; proposals are chosen by :mod:`planners.apf.hedging`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from planners.apf.dodge import TOLERANCE_SHARE, choose_elbow, look, prepared, shaped
from planners.apf.dodge_gains import DodgeGains
from planners.apf.hedging import HedgeGains, Options, choose_hedged, hedge_record, leave_out_unlikely, room_for_options
from planners.apf.safety import STATE, Scene, keep_limits
from planners.apf.whole_arm import forecast, goal_postures, joint_attraction, notice_discs
from planners.arm import Arm
from planners.typing import Array


def hedged_accelerations(
    arm: Arm,
    gains: DodgeGains,
    hedge: HedgeGains,
    q: ArrayLike,
    qd: ArrayLike,
    goal: ArrayLike,
    positions: ArrayLike,
    velocities: ArrayLike,
    radii: ArrayLike,
    futures: ArrayLike,
    weights: ArrayLike,
    memory: NDArray[Any],
    period: float,
    *,
    tolerance: float = 0.03,
    hold_time: float = 0.5,
) -> Array:
    """Mean joint accelerations for the next period that bring the hand to its goal, clear of the discs.

    They keep the arm's limits of acceleration, velocity, range and torque (held for the period).

    Args:
        arm: with two links.
        gains: of the field.
        hedge: how the futures are weighed.
        q, qd: joint angles and velocities, ``(lanes, 2)``, rad and rad/s.
        goal: of the hand, ``(lanes, 2)``, m.
        positions, velocities: of the discs, ``(lanes, discs, 2)``, m and m/s.
        radii: of the discs, ``(lanes, discs)``, m.
        futures: places of the discs at the instants that the gains look at, `STEP` apart and `STEP` from now,
            ``(lanes, futures, steps, discs, 2)``, m.
        weights: probabilities of the futures, ``(lanes, futures)``.
        memory: from `planners.apf.dodge.new_memory`, brought up to date here.
        period: control period, s.
        tolerance: how close to the goal the hand has to be, m.
        hold_time: for how long; then the episode is over, and so is any danger, s.

    Returns:
        ``(lanes, 2)``, rad/s^2.

    Raises:
        ValueError: if shapes do not fit, a probability is negative or NaN, or the arm has not two links.
    """
    body, values, sight = prepared(arm, gains)
    lanes, discs = len(memory), memory.dtype["seen"].shape[0]
    chances = np.asarray(weights, dtype=float)
    if not (chances >= 0.0).all():
        raise ValueError(f"weights {chances.min():g} and more: probabilities are numbers that are not negative")
    count = chances.shape[-1]
    angles, speeds, hands = (shaped(array, (lanes, 2)) for array in (q, qd, goal))
    places, rates = (shaped(array, (lanes, discs, 2)) for array in (positions, velocities))
    sizes, chances = shaped(radii, (lanes, discs)), shaped(chances, (lanes, count))
    ahead = shaped(futures, (lanes, count, len(sight), discs, 2))
    states = np.zeros(1, STATE)
    states["tolerance"], states["need"] = TOLERANCE_SHARE * tolerance, hold_time + 0.5 * period
    base = arm.base_array
    qdd = np.empty_like(angles)
    _dodge_lanes(
        body, values, sight, hedge_record(hedge), room_for_options(count + 1), states, angles, speeds, hands - base,
        places - base, rates, sizes, ahead - base, chances, memory, period, qdd,
    )  # fmt: skip
    return qdd


@njit(cache=True, nogil=True)
def _dodge_lanes(
    body: Any,
    gains: Any,
    sight: NDArray[Any],
    hedge: Any,
    options: Options,
    states: NDArray[Any],
    q: Array,
    qd: Array,
    goal: Array,
    positions: Array,
    velocities: Array,
    radii: Array,
    futures: Array,
    weights: Array,
    memory: Any,
    period: float,
    qdd: Array,
) -> None:
    count, discs, state = weights.shape[1], radii.shape[1], states[0]
    trends, ahead, chances = np.empty((discs, 4)), np.empty((count + 1, *futures.shape[2:])), np.empty(count + 1)
    for lane in range(q.shape[0]):
        record = memory[lane]
        look(body, q[lane], qd[lane], goal[lane], period, state, record)
        notice_discs(gains, record, positions[lane], velocities[lane], period, trends)
        if record.decided:
            record.decided = False
        else:
            goal_postures(body, goal[lane, 0], goal[lane, 1], state.postures)
            choose_elbow(body, gains, state, record)
            ahead[:count], chances[:count] = futures[lane], (1.0 - hedge.inertia) * weights[lane]
            forecast(gains, sight, positions[lane], trends, ahead[count])
            chances[count] = hedge.inertia
            leave_out_unlikely(chances)
            scene = Scene(body, gains, state, sight, ahead[0], radii[lane])
            choose_hedged(scene, ahead, chances, hedge, options, record)
        record.begun = True
        for i in range(2):
            error, strength = record.well[i] - q[lane, i], record.share * body.hardest[i]
            qdd[lane, i] = joint_attraction(error, qd[lane, i], strength, body.top[i], 1.0 / period)
        keep_limits(body, q[lane], qd[lane], period, qdd[lane])
