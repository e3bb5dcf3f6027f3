"""Among several discs: a beam search over sequences of wells, in space and time, for a way between them.

One detour and then the goal, which is all that :mod:`planners.apf.dodge.proposals` tries, rarely leads past several
discs. Here the look-ahead is cut into segments. In each of them every joint brakes or accelerates towards either end of
its range. Of the states at the end of a segment, the `WIDTH` ones of least cost that differ are kept, and from each of
them the motion to the goal is tried. Only the first well of the best sequence is followed until the next decision.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from planners.apf.dodge.gains import STEP
from planners.apf.dodge.look_ahead import (
    CHECK_EVERY,
    TOUCHING,
    DodgeScene,
    cost_at_end,
    least_clearance,
    moved,
    to_go,
    turned,
)
from planners.apf.dodge.proposals import WELL_MARGIN
from planners.apf.dodge.whole_arm import CRUISE_SHARE, time_to
from planners.compiled.calls import private
from planners.control.joint_limits import VELOCITY_SHARE
from planners.typing import Array

WIDTH = 8
"""States kept at the end of a segment."""

FIRST, LONGER = 4, 1
"""Look-ahead steps of the first segment, and how many more each following one has."""

CHOICES = 9
"""Wells of a segment: each joint brakes, or accelerates one way or the other."""

SAME_ANGLE, SAME_SPEED = 0.25, 0.2
"""Two states whose joint angles differ by less, rad, and whose velocities by less than this share of the limits, are
taken for one: only the better one is kept."""

HELD, COST, ROOT, BOUND, COLUMNS = 4, 5, 6, 7, 8
"""A state: angles and velocities of both joints; time for which the goal has been held, s; cost of the risk so far, s;
index of its first well; lower bound of its total cost, s."""

GOING, ENDED = range(2)


def escape_room() -> Array:
    """Memory in which `escape` works: the states of two segments, two more, and the first wells."""
    return np.empty((2 * WIDTH + 2 + CHOICES, COLUMNS))


@private
def escape(scene: DodgeScene, record: Any, least: float, room: Array) -> None:
    """Write the first well of the best sequence to the row's memory, if it costs less than ``least``, s."""
    n_steps, evade = scene.places.shape[0], scene.gains.evade
    now, then, wells = room[:WIDTH], room[WIDTH : 2 * WIDTH], room[2 * WIDTH + 2 :]
    child, end = room[2 * WIDTH], room[2 * WIDTH + 1]
    for i in range(2):
        now[0, i], now[0, 2 + i] = scene.state.q[i], scene.state.qd[i]
    now[0, HELD], now[0, COST], now[0, BOUND] = scene.state.held, 0.0, -np.inf
    best, count, first, length = -1, 1, 0, FIRST
    while first < n_steps and count > 0:
        last, kept = min(n_steps, first + length), 0
        for index in range(count * CHOICES):
            node, choice = now[index // CHOICES], index % CHOICES
            if node[BOUND] > least:
                continue
            well1 = _well(scene.body, evade, node, choice // 3 - 1, 0)
            well2 = _well(scene.body, evade, node, choice % 3 - 1, 1)
            root = choice if first == 0 else int(node[ROOT])
            if first == 0:
                wells[choice, 0], wells[choice, 1] = well1, well2
            if _roll(scene, node, well1, well2, evade, first, last, least, child) == ENDED or last == n_steps:
                if child[COST] < least:
                    least, best = child[COST], root
                continue
            time = to_go(scene.body, scene.state, child[0], child[1], child[2], child[3])
            child[ROOT], child[BOUND] = root, child[COST] + STEP * (last - n_steps) + time
            if child[BOUND] - scene.state.need - scene.gains.success < least:
                kept = _keep(scene.body, child, then, kept)
        for k in range(kept if last < n_steps else 0):
            cost = _cost_to_goal(scene, then[k], last, least, end)
            if cost < least:
                least, best = cost, int(then[k, ROOT])
        first, length, count = last, length + LONGER, kept
        now, then = then, now
    if best >= 0:
        record.well[0], record.well[1], record.share, record.detour = wells[best, 0], wells[best, 1], evade, True


@private
def _well(body: Any, share: float, node: Array, way: int, joint: int) -> float:
    """Where a joint comes to rest if it brakes, ``way`` 0, or the end of its range on either side, rad."""
    middle, end, v = body.middle[joint], body.ranges[joint] - WELL_MARGIN, node[2 + joint]
    stop = node[joint] + 0.5 * v * abs(v) / (share * body.hardest[joint]) - middle
    return float(middle + (way * end if way != 0 else min(end, max(-end, stop))))


@private
def _cost_to_goal(scene: DodgeScene, node: Array, first: int, enough: float, end: Array) -> float:
    """Cost of the motion from a state to the goal's posture that takes least time, s; inf if it exceeds ``enough``."""
    to, least, state = -1, np.inf, scene.state
    for branch in range(2):
        if state.handicaps[branch] < np.inf:
            time = time_to(scene.body, node[0], node[1], node[2], node[3], state.postures[branch])
            if state.handicaps[branch] + time < least:
                to, least = branch, state.handicaps[branch] + time
    goal1, goal2 = state.postures[to, 0], state.postures[to, 1]
    _roll(scene, node, goal1, goal2, CRUISE_SHARE, first, scene.places.shape[0], enough, end)
    return float(end[COST])


@private
def _keep(body: Any, child: Array, nodes: Array, kept: int) -> int:
    """Put a state among those kept, in place of a like one or of the worst if there is no room; their number."""
    worst, place = 0, -1
    for k in range(kept):
        node = nodes[k]
        speeds = abs(node[2] - child[2]) + abs(node[3] - child[3])
        if max(abs(node[0] - child[0]), abs(node[1] - child[1])) < SAME_ANGLE and speeds < SAME_SPEED * (
            body.top[0] + body.top[1]
        ):
            place = k
            break
        if node[BOUND] > nodes[worst, BOUND]:
            worst = k
    if place < 0 and kept < WIDTH:
        nodes[kept] = child
        return kept + 1
    place = worst if place < 0 else place
    if child[BOUND] < nodes[place, BOUND]:
        nodes[place] = child
    return kept


@private
def _roll(
    scene: DodgeScene,
    node: Array,
    well1: float,
    well2: float,
    share: float,
    first: int,
    last: int,
    enough: float,
    end: Array,
) -> int:
    """Simulate a state in a well from step ``first`` to ``last``; the state there is written to ``end``.

    Its cost is that of the risk so far while the motion goes on, and all of it, s, if that has ended: at a disc, at the
    goal, with the look-ahead, or (inf) because it costs more than ``enough``.
    """
    body, gains, state, instants, _, _ = scene
    l1, l2, n_steps = body.lengths[0], body.lengths[1], scene.places.shape[0]
    top1, top2 = VELOCITY_SHARE * body.top[0], VELOCITY_SHARE * body.top[1]
    strength1, strength2 = share * body.hardest[0], share * body.hardest[1]
    q1, q2, v1, v2, held, cost = node[0], node[1], node[2], node[3], node[HELD], node[COST]
    c1, s1, c2, s2 = math.cos(q1), math.sin(q1), math.cos(q1 + q2), math.sin(q1 + q2)
    for step in range(first, last):
        turn1, v1 = moved(well1 - q1, v1, strength1, top1)
        turn2, v2 = moved(well2 - q2, v2, strength2, top2)
        q1, q2 = q1 + turn1, q2 + turn2
        c1, s1 = turned(c1, s1, turn1)
        c2, s2 = turned(c2, s2, turn1 + turn2)
        late = STEP * (step + 1 - n_steps)
        clearance = least_clearance(scene, step, c1, s1, c2, s2)
        spare = clearance - instants[step].margin
        if spare < 0.0:
            cost -= instants[step].closeness * spare
            if clearance < TOUCHING:
                end[COST] = cost + instants[step].collision + late
                return ENDED
        dx, dy = l1 * c1 + l2 * c2 - state.goal[0], l1 * s1 + l2 * s2 - state.goal[1]
        held = held + STEP if dx * dx + dy * dy < state.tolerance * state.tolerance else 0.0
        if held >= state.need:
            end[COST] = cost + late - gains.success
            return ENDED
        hopeless = cost + late > enough
        if step % CHECK_EVERY == CHECK_EVERY - 1:
            hopeless = cost + late + to_go(body, state, q1, q2, v1, v2) - state.need - gains.success > enough
        if hopeless:
            end[COST] = np.inf
            return ENDED
    end[0], end[1], end[2], end[3], end[HELD], end[COST] = q1, q2, v1, v2, held, cost
    if last == n_steps:
        end[COST] = cost_at_end(scene, cost, q1, q2, v1, v2, c1, s1, held)
        return ENDED
    return GOING
