"""A* over a lattice of joint states in time, compiled.

A lattice step holds accelerations of {-a, 0, a} for a time dt. From rest, velocities are multiples of ``a dt`` and
angles, relative to the start, multiples of ``a dt^2 / 2``: a state is four small integers and a time, and duplicates
are found exactly. From expanded states, motions to rest at the goal are tried in continuous time.
"""

from __future__ import annotations

import heapq
import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planners.compiled.calls import private
from planners.motion.spacetime.world import (
    Goal,
    World,
    begin_rest,
    entry_sample,
    gap_to_discs,
    in_range,
    least_entry,
    next_window,
    step_is_free,
)
from planners.typing import Array

FOUND, EXHAUSTED, GAVE_UP = range(3)

LAYER = 4
"""Column of a state with the number of steps; before it are angle and velocity of the first and the second joint."""

SUCCESSORS = 9
"""Accelerations {-a, 0, a} of two joints."""

TRY_EVERY = 4
"""Number of expanded states per motion to rest that is tried, in turn; from the start all are tried."""

States = NDArray[np.int16]


class Lattice(NamedTuple):
    """Joint states reached by steps of constant acceleration.

    Attributes:
        start: joint angles, ``(2,)``, rad.
        speed: change of each joint's velocity in one step of full acceleration, ``(2,)``, rad/s.
        samples: number of samples of the discs' paths in a step.
        dt: duration of a step, s.
    """

    start: Array
    speed: Array
    samples: int
    dt: float


class Effort(NamedTuple):
    """When to stop the search.

    Attributes:
        gap: the answer is at most this much later than the lattice's earliest motion, s.
        nodes: most states to keep.
        before: sample of the path before which the hand must be in the tolerance.
    """

    gap: float
    nodes: int
    before: int


@njit(cache=True, nogil=True)
def explore(world: World, goal: Goal, lattice: Lattice, effort: Effort) -> tuple[int, int, float, int, States, Array]:
    """Search from rest at the lattice's start.

    Returns:
        Verdict; sample of the path from which the hand is in the tolerance for good, -1 if not found; a time, s, before
        which no motion of the lattice is there; number of expanded states; states along the motion, ``(steps + 1, 5)``;
        and the profiles of both joints from the last of them, ``(2, 4)``.
    """
    nodes, parents = np.zeros((effort.nodes, 5), np.int16), np.zeros(effort.nodes, np.int32)
    table = np.zeros(1 << math.ceil(math.log2(2.0 * effort.nodes)), np.int32)  # node + 1, 0 where empty
    q, qd, next_q, next_qd, qdd = lattice.start.copy(), np.zeros(2), np.empty(2), np.empty(2), np.empty(2)
    profiles, best_profiles = np.empty((2, 4)), np.zeros((2, 4))
    best, best_node, verdict, count, expanded = effort.before, -1, EXHAUSTED, 1, 0
    lower = least_entry(world, goal, q, qd)
    ways = 2 * goal.aims.shape[0]
    heap = [(lower, 0)]
    if gap_to_discs(world, 0, q) < world.margin:
        heap.pop()
    while heap:
        # Stop when no remaining state can lead to a motion sooner than the best by more than the gap.
        f, node = heapq.heappop(heap)
        soonest = next_window(world, goal, f)
        if soonest >= best * world.step - effort.gap:
            break
        lower = soonest
        if count + SUCCESSORS > effort.nodes:
            verdict = GAVE_UP
            break
        # Expand the state and try a motion to rest from it.
        expanded += 1
        state = nodes[node]
        first = state[LAYER] * lattice.samples
        fill_state(lattice, state, q, qd)
        turn = expanded // TRY_EVERY % max(1, ways) if expanded % TRY_EVERY == 0 else -1
        for way in range(ways):
            if node > 0 and way != turn:
                continue
            begin_rest(world, goal.aims[way // 2], q, qd, way % 2 == 1, profiles)
            entry = entry_sample(world, goal, first, best, q, qd, profiles, next_q)
            if entry >= 0:
                best, best_node = entry, node
                best_profiles[:] = profiles
        # Add successors that are new, in time, within the limits and clear of the discs.
        for choice in range(SUCCESSORS):
            fill_successor(state, choice, nodes[count])
            place = find_place(table, nodes, count)
            if table[place] > 0:
                continue
            fill_state(lattice, nodes[count], next_q, next_qd)
            f = lattice.dt * nodes[count, LAYER] + least_entry(world, goal, next_q, next_qd)
            late = next_window(world, goal, f) >= best * world.step - effort.gap
            if late or not in_range(world, next_q, next_qd):
                continue
            for j in range(2):
                qdd[j] = (next_qd[j] - qd[j]) / lattice.dt
            if not step_is_free(world, first, lattice.samples, q, qd, qdd, next_q):
                continue
            parents[count] = node
            table[place] = count + 1
            heapq.heappush(heap, (f, count))
            count += 1
    if verdict == EXHAUSTED and best < world.path.shape[0]:  # pruned states are at most the gap better
        lower = max(lower, best * world.step - effort.gap)
    if best_node < 0:
        return verdict, -1, lower, expanded, nodes[:0], best_profiles
    return FOUND, best, lower, expanded, trace_back(nodes, parents, best_node), best_profiles


@private
def fill_state(lattice: Lattice, state: States, q: Array, qd: Array) -> None:
    """Joint angles and velocities of a state ``(5,)``, written to ``q`` and ``qd``."""
    for j in range(2):
        qd[j] = lattice.speed[j] * state[2 * j + 1]
        q[j] = lattice.start[j] + 0.5 * lattice.speed[j] * lattice.dt * state[2 * j]


@private
def fill_successor(state: States, choice: int, new: States) -> None:
    """The state after one step, written to ``new``."""
    for j in range(2):
        push = choice // 3 - 1 if j == 0 else choice % 3 - 1
        new[2 * j] = state[2 * j] + 2 * state[2 * j + 1] + push
        new[2 * j + 1] = state[2 * j + 1] + push
    new[LAYER] = state[LAYER] + 1


@private
def find_place(table: NDArray[np.int32], nodes: States, node: int) -> int:
    """Index of a node's state in the hash table, or of the free place where it belongs."""
    key = np.uint64(0)
    for column in range(5):
        key = key * np.uint64(8191) + np.uint64(np.int64(nodes[node, column]) + 4096)
    key *= np.uint64(0x9E3779B97F4A7C15)
    mask = table.shape[0] - 1
    place = np.int64(key >> np.uint64(24)) & mask
    while table[place] > 0:
        other = table[place] - 1
        same = True
        for column in range(5):
            same &= nodes[other, column] == nodes[node, column]
        if same:
            break
        place = (place + 1) & mask
    return int(place)


@private
def trace_back(nodes: States, parents: NDArray[np.int32], node: int) -> States:
    """States from the start to a node, ``(steps + 1, 5)``."""
    motion = np.empty((nodes[node, LAYER] + 1, 5), np.int16)
    for i in range(len(motion) - 1, -1, -1):
        motion[i] = nodes[node]
        node = parents[node]
    return motion
