"""Hybrid A* in joint angles, velocities and time for a two-link arm among discs whose motion is known.

Planners observe only the present, so the motions found here bound theirs. After D. Dolgov et al., "Practical Search
Techniques in Path Planning for Autonomous Driving" (2008): a lattice of motions with constant accelerations, an
admissible heuristic in closed form, and from expanded states time-optimal motions to rest at the goal in continuous
time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planners.motion.double_integrator import BRAKE, CRUISE, RISE, along_profile
from planners.motion.spacetime.lattice import FOUND, GAVE_UP, LAYER, Effort, Lattice, States, explore
from planners.motion.spacetime.world import Goal, World
from planners.problem import FixedJoints, MotionProblem
from planners.robot.arm import Arm, JointLimits
from planners.robot.kinematics import turned_towards
from planners.trajectory import Trajectory, sampled_trajectory
from planners.typing import Array

Verdict = Literal["found", "exhausted", "gave up"]

Pieces = tuple[Array, Array, Array, Array]
"""Stretches of constant acceleration: when each begins, ``(pieces,)``, and q, qd and qdd there, ``(pieces, 2)``."""

MARGIN = 0.003
"""Clearance at every sample of the path, m, that leaves a positive one between samples.

The distance d from a disc's centre to a point of the arm has a second derivative of at most ``v^2 / d + a``, where v
and a are their relative velocity and acceleration, so between two samples it dips below both by at most
``(v^2 / d + a) h^2 / 8``. That is 2.1 mm for samples h = 10 ms apart, 4.6 m/s, 20 m/s^2 and d = 0.145 m: the stretched
SCARA_50CM with both joints at their limits, against a disc of 0.1 m at 1 m/s.
"""

TORQUE_SHARE = 0.99
"""Share of the torque limits that is used: torques are checked at samples only."""

POLISH = 4
"""After a coarser lattice has found a motion, the next may keep this many times fewer states."""

RING = 0.8
"""Radius of the ring of further stopping places around the goal, as a share of the tolerance."""

RING_PLACES = 8

GRID = 0.002
"""Spacing of the samples of the motion that is returned, s."""

NEAR = 2e-6
"""Least time between a jump of the acceleration and a sample of the grid, s."""


@dataclass(frozen=True)
class Answer:
    """What a search found.

    Attributes:
        verdict: ``found``; ``exhausted``: no motion exists at the resolution of the lattice; or ``gave up``: the limit
            on the number of states was reached.
        trajectory: the motion until the goal has been held long enough, or None. Its ``rendezvous_time`` is when the
            hand enters the tolerance for good, its ``cost`` the same.
        lower_bound: a time, s, before which no motion of the lattice has the hand in the tolerance for good; inf if
            there is none.
        expanded: number of expanded states.
    """

    verdict: Verdict
    trajectory: Trajectory | None
    lower_bound: float
    expanded: int

    @property
    def time_to_goal(self) -> float:
        """When the hand enters the tolerance for good, s; inf without a motion."""
        return math.inf if self.trajectory is None else self.trajectory.rendezvous_time


def search(
    arm: Arm,
    q: ArrayLike,
    goal: ArrayLike,
    path: ArrayLike,
    step: float,
    radii: ArrayLike,
    *,
    limits: JointLimits | None = None,
    tolerance: float = 0.03,
    hold: float = 0.5,
    horizon: float = 8.0,
    time_steps: Sequence[float] = (0.2, 0.1),
    gap: float = 0.05,
    margin: float = MARGIN,
    nodes: int = 2_000_000,
) -> Answer:
    """Bring the hand to ``goal`` as soon as possible and hold it there, without touching a disc.

    Args:
        arm: two links.
        q: joint angles at time 0, at rest, ``(2,)``, rad.
        goal: position of the hand, ``(2,)``, m.
        path: centres of the discs at times 0, ``step``, 2 ``step``, ..., straight in between, ``(samples, k, 2)``, m.
            It must not end before the horizon.
        step: s.
        radii: of the discs, ``(k,)``, m.
        limits: of the joints; the arm's with half of its acceleration when left out.
        tolerance: largest distance of the hand from the goal, m.
        hold: time for which the goal is held, s.
        horizon: time by which it has been held, s.
        time_steps: of the lattices, searched in this order, s; multiples of ``step``. The last one decides what is
            exhausted; a coarser one before it finds motions with long waits and prunes later ones.
        gap: optimality gap: the answer is at most this much later than the last lattice's earliest motion, s.
        margin: clearance kept at every sample, m.
        nodes: most states of a lattice before giving up.

    Raises:
        UnreachableTarget: if the goal is out of the arm's reach.
        ValueError: if a shape or a number does not fit.
    """
    halved = replace(arm.limits, acceleration=tuple(0.5 * a for a in arm.limits.acceleration))
    limits = (limits or halved).for_joints(arm.n_joints, arm.name)
    start, centers, sizes, place = (np.asarray(value, dtype=float) for value in (q, path, radii, goal))
    _check(arm, limits, start, place, centers, sizes, step, time_steps, horizon)
    last = round(horizon / step)
    centers = np.ascontiguousarray(centers[: last + 1])
    pace = float(np.max(np.hypot(*np.moveaxis(np.diff(centers, axis=0), -1, 0)), initial=0.0)) / step
    world = World(
        arm.length_array,
        arm.base_array,
        arm.link_radius,
        *arm.chain_constants,
        TORQUE_SHARE * limits.array("torque"),
        limits.array("velocity"),
        limits.array("acceleration"),
        limits.angle_middle,
        limits.angle_half,
        centers,
        sizes,
        pace,
        step,
        margin,
    )
    target = _goal(world, arm, place, tolerance, round(hold / step))
    trajectory: Trajectory | None = None
    verdict, lower, expanded, entry = GAVE_UP, 0.0, 0, len(centers)
    for time_step in time_steps:
        lattice = Lattice(start, world.acceleration * time_step, round(time_step / step), time_step)
        effort = Effort(gap, nodes if trajectory is None else nodes // POLISH, entry)
        verdict, sooner, lower, states, motion, profiles = explore(world, target, lattice, effort)
        expanded += states
        if verdict == FOUND:
            entry = sooner
            pieces = _pieces(world, lattice, motion, profiles)
            trajectory = _sample(arm, limits, pieces, entry * step, (entry + target.hold) * step)
    if trajectory is not None:
        return Answer("found", trajectory, lower, expanded)
    if verdict == GAVE_UP:
        return Answer("gave up", None, lower, expanded)
    return Answer("exhausted", None, math.inf, expanded)


def _check(
    arm: Arm,
    limits: JointLimits,
    start: Array,
    goal: Array,
    path: Array,
    radii: Array,
    step: float,
    time_steps: Sequence[float],
    horizon: float,
) -> None:
    """Raise ValueError for arguments that do not fit."""
    if arm.n_joints != 2:
        raise ValueError(f"{arm.name} has {arm.n_joints} joints; this search is for two")
    for name, array, shape in (("q", start, (2,)), ("goal", goal, (2,)), ("path", path, (len(path), len(radii), 2))):
        if array.shape != shape or not np.isfinite(array).all():
            raise ValueError(f"{name} has shape {array.shape}; it must be finite and have shape {shape}")
    bounds = [limits.array(kind) for kind in ("velocity", "acceleration", "angle")]
    if not np.isfinite(bounds).all():
        raise ValueError(f"limits {limits} must be finite in velocity, acceleration and angle to make a lattice")
    if not time_steps or any(abs(dt / step - round(dt / step)) > 1e-6 or dt < step for dt in time_steps):
        raise ValueError(f"time_steps {time_steps} s must be multiples of the path's step, {step} s, and at least one")
    if (len(path) - 1) * step < horizon - 1e-6 * step:
        raise ValueError(f"the path lasts {(len(path) - 1) * step:.4g} s; it must not end before {horizon} s")
    if not limits.within(start):
        raise ValueError(f"q {start} is out of the joints' ranges, {limits.angle_text}")


def _goal(world: World, arm: Arm, place: Array, tolerance: float, hold: int) -> Goal:
    """The goal in joint angles, with the times from which it can be held."""
    arm.inverse_kinematics(place)  # raises where the goal is out of reach
    turns = 2.0 * np.pi * np.arange(RING_PLACES) / RING_PLACES
    ring = place + RING * tolerance * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    aims = _postures(arm, world, np.concatenate([place[None], ring])).reshape(-1, 2)
    aims = aims[np.all(np.abs(aims - world.middle) <= world.angle, axis=1)]
    windows = _windows(world, place, tolerance, hold)
    return Goal(place, tolerance, hold, windows, aims, _boxes(arm, world, place, tolerance))


def _windows(world: World, place: Array, tolerance: float, hold: int) -> NDArray[np.int64]:
    """``Goal.windows``: a disc closer to the goal than ``near`` touches a hand anywhere in the tolerance."""
    samples = len(world.path)
    near = world.radii + world.link_radius + world.margin - tolerance
    blocked = np.any(np.hypot(*np.moveaxis(world.path - place, -1, 0)) < near, axis=1)
    blocks = np.concatenate([[0], np.cumsum(blocked)])
    begins = np.full(samples, samples)
    first = np.arange(samples - hold)
    free = blocks[first + hold + 1] == blocks[first]
    begins[first[free]] = first[free]
    windows: NDArray[np.int64] = np.minimum.accumulate(begins[::-1])[::-1].copy()
    return windows


def _postures(arm: Arm, world: World, hands: Array) -> Array:
    """Both postures for hand positions ``(batch, 2)``, which are clipped to the reach, ``(batch, 2, 2)``, rad.

    Angles are those in the whole turn around the middle of the joint ranges.
    """
    away = hands - arm.base_array
    distance = np.hypot(*away.T)[:, None]
    within = np.clip(distance, abs(arm.lengths[0] - arm.lengths[1]), arm.reach)
    q = arm.inverse_kinematics(arm.base_array + away * within / np.maximum(distance, np.finfo(float).tiny))
    turned: Array = turned_towards(q, world.middle)
    return turned


def _boxes(arm: Arm, world: World, place: Array, tolerance: float) -> Array:
    """Joint ranges of each branch with the hand in the tolerance, slightly too wide, ``(2, 2, 2)``."""
    turns = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)
    shares = np.linspace(0.0, 1.001, 6)
    disc = place + tolerance * np.stack(
        [np.outer(shares, np.cos(turns)).ravel(), np.outer(shares, np.sin(turns)).ravel()], axis=1
    )
    postures = _postures(arm, world, disc)
    return np.stack([postures.min(axis=0), postures.max(axis=0)], axis=-1)


def _pieces(world: World, lattice: Lattice, motion: States, profiles: Array) -> Pieces:
    """The lattice motion to its last state, followed by the motion to rest."""
    steps = motion.astype(float)
    q = lattice.start + 0.5 * lattice.speed * lattice.dt * steps[:, [0, 2]]
    qd = lattice.speed * steps[:, [1, 3]]
    phases = np.cumsum(profiles[:, [RISE, CRUISE, BRAKE]], axis=1)
    switches = np.unique(np.concatenate([[0.0], phases.ravel()]))
    inside = switches + 0.5 * np.diff(switches, append=switches[-1] + 1.0)

    def along(times: Array) -> Array:
        joints = [(profile, v, a) for profile, v, a in zip(profiles, qd[-1], world.acceleration, strict=True)]
        return np.array([[along_profile(*joint, t) for joint in joints] for t in times])

    final = along(switches)
    begun = steps[-1, LAYER] * lattice.dt
    return (
        np.concatenate([steps[:-1, LAYER] * lattice.dt, begun + switches]),
        np.concatenate([q[:-1], q[-1] + final[:, :, 0]]),
        np.concatenate([qd[:-1], final[:, :, 1]]),
        np.concatenate([np.diff(qd, axis=0) / lattice.dt, along(inside)[:, :, 2]]),
    )


def _sample(arm: Arm, limits: JointLimits, pieces: Pieces, entry: float, end: float) -> Trajectory:
    """The motion on a dense grid until ``end``, with two samples where the acceleration jumps."""
    begins, q0, qd0, accelerations = pieces
    jumps = np.unique(begins[(begins > 0.0) & (begins < end)])
    grid = np.linspace(0.0, end, round(end / GRID) + 1)
    near = np.min(np.abs(grid[1:-1, None] - jumps), axis=1, initial=np.inf) < NEAR
    near = np.concatenate([[False], near, [False]])
    t = np.sort(np.concatenate([grid[~near], jumps, jumps]))
    piece = np.searchsorted(begins, t, side="right") - 1
    before = np.append(np.diff(t) == 0.0, False)
    piece[before] = np.searchsorted(begins, t[before], side="left") - 1
    since = (t - begins[piece])[:, None]
    qdd = accelerations[piece]
    qd = qd0[piece] + since * qdd
    q = q0[piece] + since * (qd0[piece] + 0.5 * since * qdd)
    problem = MotionProblem(arm, q[0], FixedJoints(q[-1]), end, qd=qd[0], limits=limits)
    name = "space-time search"
    return sampled_trajectory(problem, t, q, qd, qdd, planner=name, cost=entry, rendezvous_time=entry)
