"""Random planning problems, mostly of a kind that a variant takes, and random options of the variant."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from planners import Arm, FixedHand, FixedJoints, JointLimits, MotionProblem, MovingHand, Obstacle, capabilities
from planners.robot.limits import LimitKind
from planners.typing import Array
from tools.fuzzing.promises import gaps, hands


def draw(generator: np.random.Generator, entry: capabilities.Variant) -> MotionProblem:
    """A random problem, mostly of a kind that the variant takes."""
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
    hand = hands(arm, goal[None])[0]
    target: FixedJoints | FixedHand | MovingHand
    if kind == "joints":
        target = FixedJoints(goal)
    elif kind == "hand":
        if generator.random() < 0.03:  # the rim, or beyond
            hand = arm.base_array + arm.reach * generator.uniform(1.0, 1.02) * (hand - arm.base_array) / arm.reach
        oriented = n > 2 and generator.random() < 0.3
        target = FixedHand(hand, float(goal.sum()) if oriented else None)
    else:
        heading, place = generator.uniform(-math.pi, math.pi), hands(arm, q[None])[0]
        direction = np.array([math.cos(heading), math.sin(heading)])
        offset, speed = generator.uniform(-0.3, 0.3) * arm.reach, generator.uniform(-0.4, 0.4) * arm.reach
        rush = generator.uniform(-0.1, 0.1) * arm.reach if generator.random() < 0.3 else 0.0
        target = MovingHand(place + offset * direction, speed * direction, rush * direction)
    qd, qdd = np.zeros(n), np.zeros(n)
    if generator.random() < 0.15:
        straight = generator.random() < 0.7
        qd = 0.3 * generator.uniform(0.0, 1.0) * (goal - q if straight else generator.uniform(-1.0, 1.0, n))
        qdd = generator.uniform(-1.0, 1.0, n) * float(generator.integers(0, 2))
    payload = float(generator.uniform(0.0, 2.0)) if generator.random() < 0.3 else 0.0
    discs = tuple(_obstacles(generator, arm, q))
    return MotionProblem(arm, q, target, horizon, qd=qd, qdd=qdd, payload=payload, obstacles=discs)


def draw_options(generator: np.random.Generator, entry: capabilities.Variant, problem: MotionProblem) -> dict[str, Any]:
    """Options of a variant that fit a problem: the defaults in half of the problems, of costly searches in a few."""
    if entry.name == "paper":
        return {} if generator.random() < 0.02 else _draw_paper_options(generator, entry.planner, problem)
    if generator.random() < 0.5 or not entry.promises:
        return {}
    joints, several = isinstance(problem.target, FixedJoints), problem.arm.n_joints > 1
    moving = isinstance(problem.target, MovingHand)
    elbow = str(generator.choice(["best", "start", *(["+", "-"] if several and not joints else [])]))
    share, flag = float(generator.uniform(0.0, 1.0)), bool(generator.integers(0, 2))
    objective = str(generator.choice(["PI1", "PI2"]))
    contact = str(generator.choice(["refuse", "delay"]))
    match entry.planner, entry.name:
        case "dpct", "optimal":
            choice = {"time_weight": 10.0 * share} if flag else {"rendezvous_time": (1.0 - share) * problem.horizon}
            given = {"elbow": elbow, "stages": int(generator.integers(10, 60))}
            given |= {"allow_reverse": flag, "free_initial_acceleration": bool(generator.integers(0, 2))}
            return given | (choice if generator.random() < 0.3 else {})
        case "dpct", "free":
            tolerances = {"position_tolerance": 1e-3 * (0.1 + share), "velocity_tolerance": 2e-3 * (0.1 + share)}
            return {"stages": int(generator.integers(10, 60))} | (tolerances if flag else {})
        case "dpct", "timing":
            return {"contact": contact, "margin": 0.005 + 0.1 * share, "prediction": 0.5 + share}
        case "dpct", "torque":
            return {"objective": objective, "stages": int(generator.integers(10, 60))}
        case "lagrange", "optimal":
            given = {"objective": objective, "elbow": elbow, "nodes": int(generator.integers(9, 31))}
            if moving and share < 0.3:
                given["rendezvous_time"] = float(generator.uniform(0.2, 1.0)) * problem.horizon
            return given | {
                "clamp_acceleration": flag,
                "polish": share > 0.95,
                "thorough": share > 0.9 and not problem.arm.gravity,
            }
        case "lagrange", "via":
            given = {"contact": contact, "elbow": elbow, "margin": 0.005 + 0.1 * share}
            return given | {"prediction": 0.5 + share, "hold": share, "keep_out": 0.2 * share * float(flag)}
        case "apf", "field":
            return {"period": 0.01 + 0.03 * share, "tolerance": 1e-3 * (1.0 + share), "hold_time": 0.2 * share}
        case "trapezoid", _:
            return {"contact": contact}
    return {}


def _draw_paper_options(generator: np.random.Generator, planner: str, problem: MotionProblem) -> dict[str, Any]:
    """Options of a paper's method: smaller grids and longer periods than the paper's own, which take longest."""
    flag, share = bool(generator.integers(0, 2)), float(generator.uniform(0.0, 1.0))
    match planner:
        case "dpct":
            return {"grid": (int(generator.integers(10, 60)), int(generator.integers(20, 120)))}
        case "lagrange":
            given: dict[str, Any] = {"clamped": flag, "steps": int(generator.integers(10, 100))}
            if share < 0.7:
                return given | {"nodes": int(generator.integers(2, 5))}
            grid = [generator.uniform(-16.0, 16.0, int(generator.integers(1, 12))) for _ in problem.q]
            return given | {"method": "polynomial", "degree": int(generator.integers(1, 4)) + 2 * flag, "grid": grid}
        case _:
            given = {"square": flag, "distance": str(generator.choice(["table", "static"]))}
            given |= {"period": min(0.02 * (0.05 + share), problem.horizon / 2.0), "tolerance": 1e-3 * (1.0 + share)}
            return given | {"norm": float(generator.choice([1.0, 2.0, 4.0, math.inf]))}


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
    arm = Arm("fuzz", lengths, masses, limits=limits, gravity=gravity, link_radius=radius)
    other = generator.spawn(1)[0]  # its own stream: the other numbers of a problem do not depend on it
    return _unusual(other, arm) if other.random() < 0.15 else arm


def _unusual(generator: np.random.Generator, arm: Arm) -> Arm:
    """The arm at another base, with gravity upwards, or with links that are no uniform rods: of each half the time."""
    chosen = generator.random(3) < 0.5
    given: dict[str, Any] = {}
    if chosen[0]:
        given["base"] = tuple(generator.uniform(-2.0, 2.0, 2).tolist())
    if chosen[1]:
        given["gravity"] = -arm.gravity
    if chosen[2]:
        given["coms"] = tuple(arm.length_array * generator.uniform(0.0, 1.2, arm.n_joints))
        given["inertias"] = tuple(np.array(arm.inertias) * generator.uniform(0.1, 4.0, arm.n_joints))
    return replace(arm, **given)


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
        if gaps(arm, q[None], disc, np.zeros(1)).min() > 0.02 or generator.random() < 0.03:
            yield disc
