"""Random problems for every planner and variant, with the promises of each motion recomputed by other means.

``python -m tools.fuzz_planners --problems 1000 --seed 0`` draws random arms of 1 to 6 links, limits (also of jerk, and
joint ranges that are not around 0), targets of each kind, obstacles, gravity and payloads, and degenerate cases: the
start as the goal, straight elbows, the rim of the reach, tiny and huge horizons and limits. Every variant gets the same
number of problems. A motion is checked on a dense grid of `Trajectory.at` with code of this file only. For each variant
the command prints how many problems were solved, refused (by reason) or not taken, and every broken promise and
unexpected exception with the number of its problem, which ``--only`` repeats.
"""

from __future__ import annotations

import gc
import math
import resource
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import tyro
from numpy.typing import NDArray

from planners import (
    Arm,
    FixedHand,
    FixedJoints,
    Infeasible,
    JointLimits,
    MotionProblem,
    MovingHand,
    Obstacle,
    Trajectory,
    capabilities,
)
from planners.robot.limits import LIMIT_KINDS, LimitKind
from planners.typing import Array

GRID = 1500
"""Points of the dense grid on which a motion is recomputed."""

ALLOWED = 1e-6
"""Excess of a promise, as a fraction of the limit, in m or in rad, that is rounding."""

CONTINUOUS = 1e-5
"""Difference, rad, between angles and integrated velocities that is rounding."""


@dataclass
class Fuzz:
    """Options of the command."""

    problems: int = 200
    """for each variant"""
    seed: int = 0
    planner: str | None = None
    """only this one, as ``dpct`` or ``dpct/timing``"""
    only: int | None = None
    """only the problem of this number, with the traceback of an exception"""


@dataclass
class Record:
    """What became of the problems of a variant."""

    outcomes: Counter[str] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)
    slowest: float = 0.0
    slowest_problem: int = -1
    seconds: float = 0.0


def run(options: Fuzz) -> dict[str, Record]:
    """Give every variant its problems; the records by ``planner/variant``."""
    records = {}
    for number, ((planner, name), entry) in enumerate(sorted(capabilities.VARIANTS.items())):
        label = f"{planner}/{name}".rstrip("/")
        if options.planner not in (None, planner, label) or not entry.promises:
            continue
        record = records[label] = Record()
        chosen = range(options.problems) if options.only is None else [options.only]
        for problem_number in chosen:
            generator = np.random.default_rng([options.seed, number, problem_number])
            problem = draw(generator, entry)
            if problem is not None:
                _attempt(entry, problem, problem_number, record, options.only is not None)
            if problem_number % 200 == 0:
                gc.collect()
    return records


def _attempt(entry: capabilities.Variant, problem: MotionProblem, number: int, record: Record, show: bool) -> None:
    """Plan and check one problem."""
    began = time.perf_counter()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            motion = entry.plan(problem)
    except Infeasible as refusal:
        record.outcomes[refusal.reason] += 1
        if "nan" in str(refusal) or "inf " in str(refusal):
            record.faults.append(f"{number}: message {refusal}")
        if show:
            print(problem, refusal)
    except ValueError as refusal:
        if entry.objection(problem) is None:
            record.faults.append(f"{number}: ValueError {refusal}")
        record.outcomes["not taken"] += 1
    except Exception as error:
        record.faults.append(f"{number}: {type(error).__name__} {error}")
        record.outcomes["exception"] += 1
        if show:
            traceback.print_exc()
    else:
        record.outcomes["solved"] += 1
        broken = broken_promises(problem, motion, entry)
        record.faults += [f"{number}: {fault}" for fault in broken]
        if show:
            print(problem, motion, broken)
    spent = time.perf_counter() - began
    record.seconds += spent
    if spent > record.slowest:
        record.slowest, record.slowest_problem = spent, number


def broken_promises(problem: MotionProblem, motion: Trajectory, entry: capabilities.Variant) -> list[str]:
    """What a motion does not keep of what its variant promises, in words with numbers."""
    takes = entry.takes[capabilities.TARGETS[type(problem.target)]]
    t, starts_piece = _grid(motion)
    q, qd, qdd = motion.at(t)
    found = [] if np.isfinite([*q, *qd, *qdd]).all() else ["not finite"]
    limits, h = problem.joint_limits, np.diff(t)[:, None]
    tau = _torques(problem, q, qd, qdd)
    values = {"torque": tau, "velocity": qd, "acceleration": qdd, "angle": q - limits.angle_middle}
    values["jerk"] = np.diff(qdd, axis=0)[~starts_piece] / h[~starts_piece]
    jumps = np.abs(np.diff(motion.qdd, axis=0))[np.diff(motion.t) == 0.0]
    for kind in LIMIT_KINDS:
        limit, value = limits.array(kind), np.abs(values[kind])
        if kind not in takes.keeps or not np.isfinite(limit).any():
            continue
        rounding = 1e-9 * np.abs(qdd).max() / np.maximum(h[~starts_piece], 1e-12) / limit if kind == "jerk" else 0.0
        excess = float((value / limit - rounding).max(initial=0.0)) - max(1.0, _start_load(problem, kind))
        if not excess <= ALLOWED:
            found.append(f"{kind} {1.0 + excess:.7g} times its limit")
        if kind == "jerk" and not (jumps[:, np.isfinite(limit)] <= 1e-8 * np.abs(qdd).max()).all():
            found.append("acceleration jumps in spite of a jerk limit")
    smooth = ~starts_piece
    led_to = q[:-1] + h * (0.5 * (qd[:-1] + qd[1:]) + h * (qdd[:-1] - qdd[1:]) / 12.0)
    gap = float(np.abs(q[1:] - led_to)[smooth].max(initial=0.0))
    if not gap <= CONTINUOUS + 1e-6 * float(np.abs(q).max()):
        found.append(f"angles jump by {gap:.3g} rad")
    if not np.abs(q[0] - problem.q).max() <= 1e-5:
        found.append("does not begin at the start")
    return found + _broken_ends(problem, motion, takes.precision, t, q)


def _broken_ends(problem: MotionProblem, motion: Trajectory, precision: float, t: Array, q: Array) -> list[str]:
    """Clearance, horizon and arrival."""
    found, target, arm = [], problem.target, problem.arm
    clearance = min((float(_gaps(arm, q, disc, t).min()) for disc in problem.obstacles), default=math.inf)
    if not clearance >= -ALLOWED:
        found.append(f"touches an obstacle, {1e3 * clearance:.4g} mm")
    if not motion.duration <= problem.horizon * (1.0 + 1e-9):
        found.append(f"takes {motion.duration:.6g} s of {problem.horizon:.6g} s")
    if isinstance(target, FixedJoints):
        error = float(np.abs(q[-1] - target.q).max())
    elif isinstance(target, FixedHand):
        error = float(np.hypot(*(_hand(arm, q[-1:])[0] - target.position)))
    else:
        riding = t >= motion.rendezvous_time
        error = float(np.hypot(*(_hand(arm, q[riding]) - target.at(t[riding])[0]).T).max(initial=0.0))
    if not error <= precision + ALLOWED:
        found.append(f"ends {error:.3g} from the target")
    if not isinstance(target, MovingHand) and not np.abs(motion.at(motion.duration)[1]).max() <= 10.0 * precision:
        found.append("does not end at rest")
    return found


def _grid(motion: Trajectory) -> tuple[Array, NDArray[np.bool_]]:
    """Dense times, with those just before and at each jump; and which of their intervals contain a jump."""
    jumps = motion.t[1:][np.diff(motion.t) == 0.0]
    before = np.nextafter(jumps, 0.0)
    t = np.unique(np.concatenate([np.linspace(0.0, motion.duration, GRID + 1), before, jumps]))
    return t, np.isin(t[1:], jumps)


def _start_load(problem: MotionProblem, kind: LimitKind) -> float:
    q, qd, qdd = problem.start
    limits = problem.joint_limits
    values = {"velocity": qd, "acceleration": qdd, "angle": q - limits.angle_middle, "jerk": 0.0 * q}
    values["torque"] = _torques(problem, q[None], qd[None], qdd[None])[0]
    return float((np.abs(values[kind]) / limits.array(kind)).max())


def _hand(arm: Arm, q: Array) -> Array:
    phi = np.cumsum(q, axis=1)
    hand: Array = arm.base_array + np.stack([np.cos(phi) @ arm.length_array, np.sin(phi) @ arm.length_array], axis=-1)
    return hand


def _gaps(arm: Arm, q: Array, disc: Obstacle, t: Array) -> Array:
    """Distance of every link's surface from a disc, ``(times, n)``."""
    phi = np.cumsum(q, axis=1)
    steps = np.stack([np.cos(phi), np.sin(phi)], axis=-1) * arm.length_array[:, None]
    begins = arm.base_array + np.cumsum(steps, axis=1) - steps
    away = (disc.position + t[:, None] * disc.velocity)[:, None] - begins
    share = np.clip(np.sum(away * steps, axis=-1) / np.sum(steps * steps, axis=-1), 0.0, 1.0)
    gaps: Array = np.linalg.norm(away - share[..., None] * steps, axis=-1) - disc.radius - arm.link_radius
    return gaps


def _torques(problem: MotionProblem, q: Array, qd: Array, qdd: Array) -> Array:
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


# problems


def draw(generator: np.random.Generator, entry: capabilities.Variant) -> MotionProblem | None:
    """A random problem, mostly of a kind that the variant takes; None if none could be made."""
    kind = str(generator.choice(list(entry.takes)))
    takes = entry.takes[kind]  # type: ignore[index]
    rare = generator.random() < 0.03
    n = int(generator.integers(1, 7)) if rare else int(generator.choice(takes.links))
    arm = _arm(generator, n, takes)
    lower = np.maximum(arm.limits.angle_lower, -math.pi)
    upper = np.minimum(arm.limits.angle_upper, math.pi)
    q, goal = generator.uniform(lower, upper), generator.uniform(lower, upper)
    if generator.random() < 0.3:
        goal = np.clip(q + generator.uniform(-0.5, 0.5, n), lower, upper)
    match generator.integers(0, 12):
        case 0:
            goal = q
        case 1 if n > 1:
            q[1:], goal[1:] = np.clip(0.0, lower[1:], upper[1:]), goal[1:] * generator.integers(0, 2)
        case 2:
            goal = np.where(generator.random(n) < 0.5, lower, upper)
    horizon = _scaled(generator, 3.0, 0.04)
    hand = _hand(arm, goal[None])[0]
    target: FixedJoints | FixedHand | MovingHand
    if kind == "joints":
        target = FixedJoints(goal)
    elif kind == "hand":
        if generator.random() < 0.03:  # the rim, or beyond
            hand = arm.base_array + arm.reach * generator.uniform(1.0, 1.02) * (hand - arm.base_array) / arm.reach
        oriented = n > 2 and generator.random() < 0.3
        target = FixedHand(hand, float(goal.sum()) if oriented else None)
    else:
        heading, place = generator.uniform(-math.pi, math.pi), _hand(arm, q[None])[0]
        direction = np.array([math.cos(heading), math.sin(heading)])
        offset, speed = generator.uniform(-0.3, 0.3) * arm.reach, generator.uniform(-0.4, 0.4) * arm.reach
        rush = generator.uniform(-0.1, 0.1) * arm.reach if generator.random() < 0.3 else 0.0
        target = MovingHand(place + offset * direction, speed * direction, rush * direction)
    moving = kind == "joints" and generator.random() < 0.1
    qd = 0.3 * (goal - q) * generator.uniform(0.0, 1.0) if moving else np.zeros(n)
    payload = float(generator.uniform(0.0, 2.0)) if generator.random() < 0.3 else 0.0
    return MotionProblem(
        arm, q, target, horizon, qd=qd, payload=payload, obstacles=tuple(_obstacles(generator, arm, q))
    )


def _arm(generator: np.random.Generator, n: int, takes: capabilities.Takes) -> Arm:
    lengths = generator.uniform(0.1, 0.6, n)
    masses = generator.uniform(0.5, 4.0, n)
    gravity = 9.81 if generator.random() < 0.3 else 0.0
    outer = np.cumsum((masses * lengths)[::-1])[::-1] * np.cumsum(lengths[::-1])[::-1]
    given: dict[LimitKind, Array | list[tuple[float, float]]] = {}
    sizes: dict[LimitKind, Array] = {
        "torque": outer * (6.0 + 25.0 * (gravity > 0.0)),
        "velocity": np.full(n, 2.5),
        "acceleration": np.full(n, 8.0),
        "jerk": np.full(n, 80.0),
    }
    for kind, size in sizes.items():
        if kind in takes.needs or (kind in takes.keeps and generator.random() < 0.6) or generator.random() < 0.01:
            given[kind] = size * generator.uniform(0.3, 1.5, n) * _scaled(generator, 1.0, 0.04)
    if "angle" in takes.keeps and generator.random() < 0.6:
        middle, half = generator.uniform(-1.0, 1.0, n), generator.uniform(0.7, 3.0, n)
        given["angle"] = list(zip(middle - half, middle + half, strict=True))
    radius = float(generator.uniform(0.0, 0.05))
    limits = JointLimits(**given) if given else JointLimits()
    return Arm("fuzz", lengths, masses, limits=limits, gravity=gravity, link_radius=radius)


def _scaled(generator: np.random.Generator, value: float, share: float) -> float:
    """About a value; with a probability ``share`` each tiny or huge."""
    chance = generator.random()
    power = generator.uniform(-6.0, -2.0) if chance < share else generator.uniform(2.0, 6.0)
    return float(value * (10.0**power if chance < 2.0 * share else generator.uniform(0.5, 2.0)))


def _obstacles(generator: np.random.Generator, arm: Arm, q: Array) -> Iterator[Obstacle]:
    """Up to three discs clear of the start, in a third of the problems."""
    for _ in range(int(generator.integers(1, 4)) if generator.random() < 0.33 else 0):
        place = arm.base_array + generator.uniform(-1.3, 1.3, 2) * arm.reach
        moves = generator.random() < 0.5
        velocity = generator.uniform(-0.5, 0.5, 2) * arm.reach if moves else np.zeros(2)
        disc = Obstacle(place, velocity, float(generator.uniform(0.0, 0.15)) * arm.reach)
        if _gaps(arm, q[None], disc, np.zeros(1)).min() > 0.02 or generator.random() < 0.03:
            yield disc


def main() -> int:
    """Run the campaign and print its table; 1 if a promise was broken or an exception was unexpected."""
    options = tyro.cli(Fuzz)
    records = run(options)
    for label, record in records.items():
        counts = ", ".join(f"{count} {outcome}" for outcome, count in record.outcomes.most_common())
        slowest = f"slowest {record.slowest:.2f} s (problem {record.slowest_problem})"
        print(f"{label}: {counts}; {len(record.faults)} faults; {record.seconds:.1f} s, {slowest}")
        for fault in record.faults[:20]:
            print(f"    {fault}")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    print(f"peak memory {peak:.0f} MiB")
    return int(any(record.faults for record in records.values()))


if __name__ == "__main__":
    raise SystemExit(main())
