"""The promises of a motion, recomputed on a dense grid of `Trajectory.at` with code of this file only."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planners import Arm, FixedHand, FixedJoints, MotionProblem, MovingHand, Obstacle, Trajectory, capabilities
from planners.robot.limits import LIMIT_KINDS, LimitKind
from planners.typing import Array

GRID = 1500
"""Points of the dense grid on which a motion is recomputed."""

CLEARANCE_ERROR = 1e-3
"""Error of the least clearance that a motion states, as a share of it."""

ALLOWED = 1e-6
"""Excess of a promise, as a fraction of the limit, in m or in rad, that is rounding."""

GAUSS = ((0.5 - math.sqrt(0.15), 5.0 / 18.0), (0.5, 4.0 / 9.0), (0.5 + math.sqrt(0.15), 5.0 / 18.0))
"""Places and weights of Gauss's rule in an interval; it is exact for velocities of degree five."""

CONTINUOUS = 1e-5
"""Difference, rad, between angles and integrated velocities that is rounding."""


def broken_promises(
    problem: MotionProblem,
    motion: Trajectory,
    entry: capabilities.Variant,
    options: Mapping[str, Any] = MappingProxyType({}),
) -> list[str]:
    """What a motion does not keep of what its variant promises, and of what it says itself, in words with numbers."""
    takes = entry.takes[capabilities.TARGETS[type(problem.target)]]
    t, starts_piece = _grid(motion)
    q, qd, qdd = motion.at(t)
    if not np.isfinite([*q, *qd, *qdd]).all():
        return ["not finite"]
    kept = takes.keeps if entry.promises else ()
    found = _broken_limits(problem, motion, kept, (t, q, qd, qdd), starts_piece)
    clearance = min((float(gaps(problem.arm, q, disc, t).min()) for disc in problem.obstacles), default=math.inf)
    stated = motion.clearance
    if not (clearance >= stated - ALLOWED or math.isclose(clearance, stated, rel_tol=CLEARANCE_ERROR)):
        found.append(f"says {motion.clearance:.6g} m of clearance and has {clearance:.6g} m")
    smooth, h = ~starts_piece, np.diff(t)[:, None]
    led_to = q[:-1] + sum(weight * h * motion.at(t[:-1] + place * h[:, 0])[1] for place, weight in GAUSS)
    gap = float(np.abs(q[1:] - led_to)[smooth].max(initial=0.0))
    if entry.promises and not gap <= CONTINUOUS + 1e-6 * float(np.abs(q).max()):
        found.append(f"angles jump by {gap:.3g} rad")
    # another elbow of dpct begins with the hand in the same place
    turned = (
        entry.planner == "dpct"
        and options.get("elbow", "start") != "start"
        and not isinstance(problem.target, FixedJoints)
    )
    apart = hands(problem.arm, q[:1]) - hands(problem.arm, problem.q[None]) if turned else q[0] - problem.q
    if entry.promises and not np.abs(apart).max() <= 1e-5:
        found.append("does not begin at the start")
    if not entry.promises or options.get("contact") == "delay":
        return found
    if not clearance >= -ALLOWED:
        found.append(f"touches an obstacle, {1e3 * clearance:.4g} mm")
    precision = max(takes.precision, float(options.get("tolerance", 0.0)))
    return found + _broken_ends(problem, motion, precision, t, q)


def _broken_limits(
    problem: MotionProblem,
    motion: Trajectory,
    kept: Sequence[str],
    samples: tuple[Array, Array, Array, Array],
    starts_piece: NDArray[np.bool_],
) -> list[str]:
    """Limits of the kinds ``kept`` that are exceeded, and of all kinds ratios that the motion understates."""
    t, q, qd, qdd = samples
    found, limits, h = [], problem.joint_limits, np.diff(t)[:, None]
    values = {"velocity": qd, "acceleration": qdd, "angle": q - limits.angle_middle}
    values["torque"] = torques(problem, q, qd, qdd)
    values["jerk"] = np.diff(qdd, axis=0)[~starts_piece] / h[~starts_piece]
    steps, changes = np.diff(motion.t)[:, None], np.abs(np.diff(motion.qdd, axis=0))
    jumps = changes[steps[:, 0] == 0.0]
    means = np.maximum(0.0, changes - 1e-9 * np.abs(qdd).max())[steps[:, 0] > 0.0] / steps[steps[:, 0] > 0.0]
    for kind in LIMIT_KINDS:
        limit, value = limits.array(kind), np.abs(values[kind])
        if not np.isfinite(limit).any():
            continue
        rounding: Array | float = 0.0
        if kind == "jerk":
            rounding = _jerk_rounding(motion, t, qdd)[~starts_piece]
        elif kind == "torque":
            rounding = _torque_rounding(problem, qd)
        ratio = float(((value - rounding) / limit).max(initial=0.0))
        if kind == "jerk":
            ratio = max(ratio, float((means / limit).max(initial=0.0)))
        said = motion.limit_ratios[kind]
        if not ratio <= said * (1.0 + ALLOWED) + 1e-9:
            found.append(f"says {said:.7g} times its {kind} limit and has {ratio:.7g}")
        if kind not in kept:
            continue
        beyond = (value - rounding) / limit - np.maximum(1.0, _start_load(problem, kind))
        excess = float(beyond.max(initial=-1.0)) if kind != "jerk" else ratio - 1.0
        if not excess <= ALLOWED:
            found.append(f"{kind} {1.0 + excess:.7g} times its limit")
        if kind == "jerk" and not (jumps[:, np.isfinite(limit)] <= 1e-8 * np.abs(qdd).max()).all():
            found.append("acceleration jumps in spite of a jerk limit")
    return found


def _torque_rounding(problem: MotionProblem, qd: Array) -> Array:
    """How much of the torques is rounding, ``(times, 1)``, N m: centripetal forces cancel in the torque of a link."""
    arm = problem.arm
    moment = (sum(arm.masses) + problem.payload) * arm.reach**2
    rounding: Array = 8.0 * np.finfo(float).eps * moment * np.abs(np.cumsum(qd, axis=1)).max(axis=1, keepdims=True) ** 2
    return rounding


def _jerk_rounding(motion: Trajectory, t: Array, qdd: Array) -> Array:
    """How much of the jerk in each interval of ``t`` is rounding, ``(intervals, 1)``, rad/s^3.

    Accelerations have a relative rounding. Between two samples they come from a quintic through the angles there, whose
    rounding it divides by the square of the samples' distance (times at most 60, for each of the two); across samples
    this part is absent.
    """
    h = np.maximum(np.diff(t), 1e-12)
    after = np.searchsorted(motion.t, t[:-1], side="right").clip(1, len(motion.t) - 1)
    apart = np.maximum(np.diff(motion.t)[after - 1], h)
    angles = np.abs(motion.q).max() + motion.duration * np.abs(motion.qd).max()
    quintic = np.where(apart > 1.000001 * h, 120.0 * np.finfo(float).eps * angles / apart**2, 0.0)
    rounding: Array = (1e-9 * np.abs(qdd).max() + quintic) / h
    return rounding[:, None]


def _broken_ends(problem: MotionProblem, motion: Trajectory, precision: float, t: Array, q: Array) -> list[str]:
    """Horizon and arrival."""
    found, target, arm = [], problem.target, problem.arm
    if not motion.duration <= problem.horizon * (1.0 + 1e-9):
        found.append(f"takes {motion.duration:.6g} s of {problem.horizon:.6g} s")
    if isinstance(target, FixedJoints):
        error = float(np.abs(q[-1] - target.q).max())
    elif isinstance(target, FixedHand):
        error = float(np.hypot(*(hands(arm, q[-1:])[0] - target.position)))
        if target.orientation is not None:
            error = max(error, abs(math.remainder(float(q[-1].sum()) - target.orientation, math.tau)))
    else:
        riding = t >= motion.rendezvous_time
        error = float(np.hypot(*(hands(arm, q[riding]) - target.at(t[riding])[0]).T).max(initial=0.0))
    if not error <= precision + ALLOWED:
        found.append(f"ends {error:.3g} from the target")
    if not isinstance(target, MovingHand) and not np.abs(motion.at(motion.duration)[1]).max() <= 10.0 * precision:
        found.append("does not end at rest")
    return found


def _grid(motion: Trajectory) -> tuple[Array, NDArray[np.bool_]]:
    """Dense times, with those of the samples and just before each jump; and which of their intervals contain a jump."""
    jumps = motion.t[1:][np.diff(motion.t) == 0.0]
    before, even = np.nextafter(jumps, 0.0), np.linspace(0.0, motion.duration, GRID + 1)
    after = np.searchsorted(motion.t, even).clip(1, len(motion.t) - 1)
    near = np.minimum(np.abs(even - motion.t[after - 1]), np.abs(motion.t[after] - even)) <= 1e-9 * motion.duration
    t = np.unique(np.concatenate([even[~near], before, motion.t]))
    return t, np.isin(t[1:], jumps)


def _start_load(problem: MotionProblem, kind: LimitKind) -> Array:
    """|value| / limit of each joint at the start, ``(n,)``."""
    q, qd, qdd = problem.start
    limits = problem.joint_limits
    values = {"velocity": qd, "acceleration": qdd, "angle": q - limits.angle_middle, "jerk": 0.0 * q}
    values["torque"] = torques(problem, q[None], qd[None], qdd[None])[0]
    load: Array = np.abs(values[kind]) / limits.array(kind)
    return load


def hands(arm: Arm, q: Array) -> Array:
    """Positions of the hand, ``(times, 2)``."""
    phi = np.cumsum(q, axis=1)
    hand: Array = arm.base_array + np.stack([np.cos(phi) @ arm.length_array, np.sin(phi) @ arm.length_array], axis=-1)
    return hand


def gaps(arm: Arm, q: Array, disc: Obstacle, t: Array) -> Array:
    """Distance of every link's surface from a disc, ``(times, n)``."""
    phi = np.cumsum(q, axis=1)
    steps = np.stack([np.cos(phi), np.sin(phi)], axis=-1) * arm.length_array[:, None]
    begins = arm.base_array + np.cumsum(steps, axis=1) - steps
    away = (disc.position + t[:, None] * disc.velocity)[:, None] - begins
    share = np.clip(np.sum(away * steps, axis=-1) / np.sum(steps * steps, axis=-1), 0.0, 1.0)
    distances: Array = np.linalg.norm(away - share[..., None] * steps, axis=-1) - disc.radius - arm.link_radius
    return distances


def torques(problem: MotionProblem, q: Array, qd: Array, qdd: Array) -> Array:
    """Newton's and Euler's equations of each link in turn, from the last to the first, N m."""
    arm = problem.arm
    phi, w, alpha = np.cumsum(q, axis=1), np.cumsum(qd, axis=1), np.cumsum(qdd, axis=1)
    along = np.stack([np.cos(phi), np.sin(phi)], axis=-1)
    across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    pull = alpha[..., None] * across - (w**2)[..., None] * along  # acceleration a metre along each link
    lengths, coms = arm.length_array[:, None], np.array(arm.coms)[:, None]
    joints = np.cumsum(lengths * pull, axis=1) - lengths * pull  # accelerations of the joints
    up = np.array([0.0, arm.gravity])
    forces = np.array(arm.masses)[:, None] * (joints + coms * pull + up)
    load = problem.payload * (joints[:, -1] + lengths[-1] * pull[:, -1] + up)
    tau, moment, onward = np.empty_like(q), np.zeros(len(q)), load
    for i in reversed(range(arm.n_joints)):
        moment = (
            moment
            + arm.inertias[i] * alpha[:, i]
            + arm.coms[i] * _cross(along[:, i], forces[:, i])
            + arm.lengths[i] * _cross(along[:, i], onward)
        )
        onward = onward + forces[:, i]
        tau[:, i] = moment
    return tau


def _cross(a: Array, b: Array) -> Array:
    product: Array = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product
