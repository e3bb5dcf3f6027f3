"""Simulates the motion to a proposed well among the predicted discs, and computes its cost.

The joints move as double integrators with all their limits, at most until the goal has been held long enough. The cost
is the time to the goal plus a risk: the clearance below the margin, which grows with the time ahead, and a collision.
The weights of both decay with the time ahead.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planners.apf.dodge.gains import STEP
from planners.apf.dodge.whole_arm import gap, joint_attraction, time_to
from planners.compiled.calls import private
from planners.control.joint_limits import VELOCITY_SHARE
from planners.typing import Array

RATE = 1.0 / STEP

CHECK_EVERY = 6
"""Steps between early-termination checks."""

TOUCHING = 0.004
"""Predicted clearance that counts as a collision, m."""

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
"""State and goal of a row: joint angles and velocities; directions of the links; the goal, m from the base, and its
tolerance, m; times for which it has been held and has to be held, s; its two elbow postures, rad, and the handicap of
each, s, infinite if the posture is impossible."""

NEVER = 1 << 30
"""Steps of a well that attracts until the end of the look-ahead."""


class Proposal(NamedTuple):
    """A well at ``q1``, ``q2`` (rad), of a strength that is a ``share`` of the acceleration limits, for some ``steps``,
    followed by that of the goal's posture with an ``elbow``.
    """

    q1: float
    q2: float
    share: float
    steps: int
    elbow: int


class Outlook(NamedTuple):
    """Cost of a proposal, s; least clearance beyond the margin, m; step and joint angles (rad) of that instant."""

    cost: float
    slack: float
    step: int
    q1: float
    q2: float


class DodgeScene(NamedTuple):
    """One row: records of `whole_arm.BODY`, `DodgeGains` and `STATE`, an array of `planners.apf.dodge.gains.INSTANTS`,
    predicted positions of the discs, ``(steps, discs, 2)``, m from the base, and their radii, ``(discs,)``, m.
    """

    body: Any
    gains: Any
    state: Any
    instants: NDArray[Any]
    places: Array
    radii: Array


@private
def look_ahead(scene: DodgeScene, proposal: Proposal, enough: float) -> Outlook:
    """Simulate a proposal; stops early once its cost exceeds ``enough``, s."""
    body, gains, state, instants, places, _ = scene
    l1, l2 = body.lengths[0], body.lengths[1]
    top1, top2 = VELOCITY_SHARE * body.top[0], VELOCITY_SHARE * body.top[1]
    q1, q2, v1, v2 = state.q[0], state.q[1], state.qd[0], state.qd[1]
    c1, s1, c2, s2 = state.directions[0, 0], state.directions[0, 1], state.directions[1, 0], state.directions[1, 1]
    goal_x, goal_y, held = state.goal[0], state.goal[1], state.held
    well1, well2 = proposal.q1, proposal.q2
    strength1, strength2 = proposal.share * body.hardest[0], proposal.share * body.hardest[1]
    near = state.tolerance * state.tolerance
    cost, slack, worst, worst1, worst2 = 0.0, np.inf, 0, q1, q2
    n_steps = places.shape[0]
    for step in range(n_steps):
        # motion of the joints in the present well
        if step == proposal.steps:
            well1, well2 = state.postures[proposal.elbow, 0], state.postures[proposal.elbow, 1]
            strength1, strength2 = body.cruise[0], body.cruise[1]
        turn1, v1 = moved(well1 - q1, v1, strength1, top1)
        turn2, v2 = moved(well2 - q2, v2, strength2, top2)
        q1, q2 = q1 + turn1, q2 + turn2
        c1, s1 = turned(c1, s1, turn1)
        c2, s2 = turned(c2, s2, turn1 + turn2)
        # clearance from the nearest disc, and its cost
        clearance = least_clearance(scene, step, c1, s1, c2, s2)
        spare = clearance - instants[step].margin
        if spare < slack:
            slack, worst, worst1, worst2 = spare, step, q1, q2
        if spare < 0.0:
            cost -= instants[step].closeness * spare
            if clearance < TOUCHING:
                cost += instants[step].collision
                break
            if cost > enough:
                return Outlook(cost, slack, worst, worst1, worst2)
        # success once the goal has been held
        dx, dy = l1 * c1 + l2 * c2 - goal_x, l1 * s1 + l2 * s2 - goal_y
        held = held + STEP if dx * dx + dy * dy < near else 0.0
        if held >= state.need:
            cost += STEP * (step + 1 - n_steps) - gains.success
            return Outlook(cost, slack, worst, worst1, worst2)
        # early termination: even the least time to the goal costs too much
        if step % CHECK_EVERY == CHECK_EVERY - 1 and enough < np.inf:
            late = STEP * (step + 1 - n_steps) + to_go(body, state, q1, q2, v1, v2)
            if late + state.need < 0.0:
                late += state.need - gains.success
            if cost + late > enough:
                return Outlook(cost + late, slack, worst, worst1, worst2)
    return Outlook(cost_at_end(scene, cost, q1, q2, v1, v2, c1, s1, held), slack, worst, worst1, worst2)


@njit(cache=True, nogil=True, inline="always")
def moved(error: float, v: float, strength: float, top: float) -> tuple[float, float]:
    """Turn of a joint in a step, rad, and its velocity after it, rad/s, in a well ``error`` (rad) away."""
    a = joint_attraction(error, v, strength, top, RATE)
    return STEP * (v + 0.5 * STEP * a), v + STEP * a


@njit(cache=True, nogil=True, inline="always")
def least_clearance(scene: DodgeScene, step: int, c1: float, s1: float, c2: float, s2: float) -> float:
    """Clearance of links along ``(c1, s1)`` and ``(c2, s2)`` from the nearest predicted disc, m."""
    body, places, radii = scene.body, scene.places, scene.radii
    clearance = np.inf
    for disc in range(places.shape[1]):
        x, y = places[step, disc, 0], places[step, disc, 1]
        distance = gap(body.lengths[0], body.lengths[1], c1, s1, c2, s2, x, y)
        if distance - radii[disc] < clearance:
            clearance = distance - radii[disc]
    return float(clearance - body.link_radius)


@private
def cost_at_end(
    scene: DodgeScene, cost: float, q1: float, q2: float, v1: float, v2: float, c1: float, s1: float, held: float
) -> float:
    """Cost so far and of what is left at the end of the look-ahead, s: time to the goal, and a blocked first joint."""
    body, places = scene.body, scene.places
    for disc in range(places.shape[1]):
        x, y = places[-1, disc, 0], places[-1, disc, 1]
        cost += _cornered(body, scene.gains, q1, s1 * x - c1 * y, math.hypot(x, y))
    return float(cost + max(0.0, to_go(body, scene.state, q1, q2, v1, v2) - held))


@private
def to_go(body: Any, state: Any, q1: float, q2: float, v1: float, v2: float) -> float:
    """Least time to rest at the goal, with the handicap of the elbow that takes least, s."""
    least = np.inf
    for branch in range(2):
        if state.handicaps[branch] < np.inf:
            least = min(least, state.handicaps[branch] + time_to(body, q1, q2, v1, v2, state.postures[branch]))
    return least


@njit(cache=True, nogil=True, inline="always")
def turned(c: float, s: float, angle: float) -> tuple[float, float]:
    """A direction turned by a small angle (below 0.5 rad to 1e-7), by its Taylor series."""
    square = angle * angle
    cosine = 1.0 - square * (0.5 - square * (1.0 / 24.0 - square / 720.0))
    sine = angle * (1.0 - square * (1.0 / 6.0 - square / 120.0))
    return c * cosine - s * sine, s * cosine + c * sine


@private
def _cornered(body: Any, gains: Any, q1: float, side: float, away: float) -> float:
    """Cost of a first joint at ``q1`` (rad) between the end of its range and a disc that blocks it, s.

    ``side`` is positive where the disc is on the side of smaller angles, ``away`` its distance from the base, m.
    """
    from_middle = q1 - body.middle[0]
    room = body.ranges[0] - from_middle if side > 0.0 else body.ranges[0] + from_middle
    inside = max(0.0, (gains.corner_reach - away) / (gains.corner_reach - gains.nearest))
    return float(gains.corner * inside * max(0.0, 1.0 - room / gains.corner_room))
