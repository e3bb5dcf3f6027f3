"""The safety layer: what a proposal of the field leads to among the predicted discs, and what the joints may do.

A proposal is followed by a short simulated motion of the joints, double integrators with all their limits, past the
predicted discs, at most until the goal has been held long enough. Its cost is the time to the goal plus a risk: how
much less clearance there is than the margin, which grows with the time ahead as the prediction gets worse, and a
collision, which counts less the later it is.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planners.apf.whole_arm import gap, held_torques, joint_attraction, time_to
from planners.control.joint_limits import TORQUE_SHARE, VELOCITY_SHARE, share_within, stoppable_velocities
from planners.typing import Array

STEP = 0.05
"""Time step of the motions that are simulated, s."""

RATE = 1.0 / STEP

GLANCE = 6
"""After so many steps it is looked whether a motion can still be worth its while."""

TOUCHING = 0.004
"""Predicted clearance that counts as a collision, m."""

SIGHT = [("travel", "f8"), ("settling", "f8"), ("margin", "f8"), ("closeness", "f8"), ("collision", "f8")]
"""The instants ahead that are looked at, `STEP` apart: for how long a disc moves between this instant and the last one,
less than `STEP` as confidence fades, s; by how much its velocity settles (see `whole_arm.forecast`), s; the clearance
that is wanted, m; the cost of a metre less, s/m; and the cost of a collision, s."""

STATE = [
    ("q", "f8", (2,)),
    ("qd", "f8", (2,)),
    ("directions", "f8", (2, 2)),
    ("goal", "f8", (2,)),
    ("tolerance", "f8"),
    ("held", "f8"),
    ("need", "f8"),
    ("postures", "f8", (2, 2)),
    ("handicaps", "f8", (2,)),
]
"""Where the motion of a row begins, and where to: joint angles and velocities; directions of the links; the goal, m
from the base, and how close counts as there, m; for how long it has been held and is to be, s; its two postures, rad,
and what each of them is worse by, s, infinite if it cannot be had."""


def make_sight(gains: Any) -> NDArray[Any]:
    """What `DodgeGains` make of the time ahead: an array of `SIGHT`, ``(steps,)``."""
    t = STEP * np.arange(1, round(gains.horizon / STEP) + 1)
    sight = np.zeros(len(t), SIGHT)
    sight["travel"] = np.diff(gains.confidence * -np.expm1(-t / gains.confidence), prepend=0.0)
    sight["settling"] = np.diff(gains.lag * -np.expm1(-t / gains.lag), prepend=0.0)
    sight["margin"] = gains.margin + gains.margin_growth * t
    sight["closeness"] = STEP * gains.closeness * np.exp(-t / gains.closeness_memory)
    sight["collision"] = gains.collision * np.exp(-t / gains.collision_memory)
    return sight


NEVER = 1 << 30
"""Steps of a well that draws for good."""


class Proposal(NamedTuple):
    """A well to be drawn into for some steps, and then that of the goal.

    Attributes:
        q1, q2: the bottom of the first well, rad.
        share: its strength, as a share of the largest accelerations.
        steps: how long it draws.
        elbow: which posture at the goal is next.
    """

    q1: float
    q2: float
    share: float
    steps: int
    elbow: int


class Outlook(NamedTuple):
    """What a proposal leads to.

    Attributes:
        cost: s.
        slack: least clearance beyond the margin, m.
        step: when that is.
        q1, q2: and in which posture.
    """

    cost: float
    slack: float
    step: int
    q1: float
    q2: float


class Scene(NamedTuple):
    """What a row sees when it looks ahead.

    Attributes:
        body: a record of `whole_arm.BODY`.
        gains: a record of `DodgeGains`.
        state: a record of `STATE`.
        sight: an array of `SIGHT`, ``(steps,)``.
        places: of the discs then, ``(steps, discs, 2)``, m from the base.
        radii: of the discs, ``(discs,)``, m.
    """

    body: Any
    gains: Any
    state: Any
    sight: NDArray[Any]
    places: Array
    radii: Array


@njit(cache=True, nogil=True)
def look_ahead(scene: Scene, proposal: Proposal, enough: float) -> Outlook:
    """Follow a proposal into the future; given up when it costs more than ``enough``, s."""
    body, gains, state, sight, places, radii = scene
    l1, l2 = body.lengths[0], body.lengths[1]
    top1, top2 = VELOCITY_SHARE * body.top[0], VELOCITY_SHARE * body.top[1]
    q1, q2, v1, v2 = state.q[0], state.q[1], state.qd[0], state.qd[1]
    c1, s1, c2, s2 = state.directions[0, 0], state.directions[0, 1], state.directions[1, 0], state.directions[1, 1]
    goal_x, goal_y, held = state.goal[0], state.goal[1], state.held
    well1, well2 = proposal.q1, proposal.q2
    strength1, strength2 = proposal.share * body.hardest[0], proposal.share * body.hardest[1]
    near = state.tolerance * state.tolerance
    cost, slack, worst, worst1, worst2 = 0.0, np.inf, 0, q1, q2
    n_steps, n_discs = places.shape[0], places.shape[1]
    for step in range(n_steps):
        if step == proposal.steps:
            well1, well2 = state.postures[proposal.elbow, 0], state.postures[proposal.elbow, 1]
            strength1, strength2 = body.cruise[0], body.cruise[1]
        a1 = joint_attraction(well1 - q1, v1, strength1, top1, RATE)
        a2 = joint_attraction(well2 - q2, v2, strength2, top2, RATE)
        turn1, turn2 = STEP * (v1 + 0.5 * STEP * a1), STEP * (v2 + 0.5 * STEP * a2)
        q1, q2, v1, v2 = q1 + turn1, q2 + turn2, v1 + STEP * a1, v2 + STEP * a2
        c1, s1 = _turned(c1, s1, turn1)
        c2, s2 = _turned(c2, s2, turn1 + turn2)
        clearance = np.inf
        for disc in range(n_discs):
            distance = gap(l1, l2, c1, s1, c2, s2, places[step, disc, 0], places[step, disc, 1])
            if distance - radii[disc] < clearance:
                clearance = distance - radii[disc]
        clearance -= body.link_radius
        spare = clearance - sight[step].margin
        if spare < slack:
            slack, worst, worst1, worst2 = spare, step, q1, q2
        if spare < 0.0:
            cost -= sight[step].closeness * spare
            if clearance < TOUCHING:
                cost += sight[step].collision
                break
            if cost > enough:
                return Outlook(cost, slack, worst, worst1, worst2)
        dx, dy = l1 * c1 + l2 * c2 - goal_x, l1 * s1 + l2 * s2 - goal_y
        held = held + STEP if dx * dx + dy * dy < near else 0.0
        if held >= state.need:
            cost += STEP * (step + 1 - n_steps) - gains.success
            return Outlook(cost, slack, worst, worst1, worst2)
        if step % GLANCE == GLANCE - 1 and enough < np.inf:
            late = STEP * (step + 1 - n_steps) + to_go(body, state, q1, q2, v1, v2)
            if late + state.need < 0.0:
                late += state.need - gains.success
            if cost + late > enough:
                return Outlook(cost + late, slack, worst, worst1, worst2)
    for disc in range(n_discs):
        x, y = places[n_steps - 1, disc, 0], places[n_steps - 1, disc, 1]
        cost += _cornered(body, gains, q1, s1 * x - c1 * y, math.hypot(x, y))
    return Outlook(cost + max(0.0, to_go(body, state, q1, q2, v1, v2) - held), slack, worst, worst1, worst2)


@njit(cache=True, nogil=True)
def to_go(body: Any, state: Any, q1: float, q2: float, v1: float, v2: float) -> float:
    """Least time to rest at the goal, with the handicap of the elbow that takes least, s."""
    least = np.inf
    for branch in range(2):
        if state.handicaps[branch] < np.inf:
            least = min(least, state.handicaps[branch] + time_to(body, q1, q2, v1, v2, state.postures[branch]))
    return least


@njit(cache=True, nogil=True, inline="always")
def _turned(c: float, s: float, angle: float) -> tuple[float, float]:
    """A direction turned by a small angle (below 0.5 rad to 1e-7), by its Taylor series."""
    square = angle * angle
    cosine = 1.0 - square * (0.5 - square * (1.0 / 24.0 - square / 720.0))
    sine = angle * (1.0 - square * (1.0 / 6.0 - square / 120.0))
    return c * cosine - s * sine, s * cosine + c * sine


@njit(cache=True, nogil=True)
def _cornered(body: Any, gains: Any, q1: float, side: float, away: float) -> float:
    """Cost of being between a disc and the end of the first joint's range, s.

    A disc this close to the base cannot be passed: it can only be run from, as far as the joint's range goes.

    Args:
        body: a record of `whole_arm.BODY`.
        gains: a record of `DodgeGains`.
        q1: angle of the first joint, rad.
        side: positive where the disc is on the side of smaller angles.
        away: distance of the disc from the base, m.
    """
    room = body.ranges[0] - q1 if side > 0.0 else body.ranges[0] + q1
    inside = max(0.0, (gains.corner_reach - away) / (gains.corner_reach - gains.nearest))
    return float(gains.corner * inside * max(0.0, 1.0 - room / gains.corner_room))


@njit(cache=True, nogil=True)
def keep_limits(body: Any, q: Array, qd: Array, period: float, qdd: Array) -> None:
    """Change the accelerations of one row, ``(2,)``, so that they keep the limits of velocity, range and torque.

    A joint brakes before its end stop with half of its largest acceleration, which leaves torque for the other joint.
    Torques are brought within their limits by scaling both accelerations.
    """
    for i in range(2):
        hardest, top = body.hardest[i], VELOCITY_SHARE * body.top[i]
        slowest, fastest = stoppable_velocities(q[i], qd[i], body.ranges[i], 0.5 * hardest, period)
        slowest, fastest = max(-top, slowest), min(top, fastest)
        qdd[i] = min((fastest - qd[i]) / period, max((slowest - qd[i]) / period, qdd[i]))
        qdd[i] = min(hardest, max(-hardest, qdd[i]))
    _keep_torque(body, q, qd, period, qdd)


@njit(cache=True, nogil=True)
def _keep_torque(body: Any, q: Array, qd: Array, period: float, qdd: Array) -> None:
    limit1, limit2 = TORQUE_SHARE * body.torque[0], TORQUE_SHARE * body.torque[1]
    tau1, tau2 = held_torques(body, q, qd, qdd[0], qdd[1], period)
    if abs(tau1) <= limit1 and abs(tau2) <= limit2:
        return
    still1, still2 = held_torques(body, q, qd, 0.0, 0.0, period)
    scale = min(share_within(still1, tau1, limit1), share_within(still2, tau2, limit2))
    qdd[0] *= scale
    qdd[1] *= scale
