"""The potential-field paper's moves: stated scenes, random problems, and the motions that its field makes of them."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from agents.papers.report import Record
from planners import SCARA_50CM, FixedHand, MotionProblem, Obstacle
from planners.apf.hand_field import Distance, make_field
from planners.apf.paper import PERIOD, FieldMotion, follow_field

START, GOAL, HORIZON = (-0.25, 0.9), (0.65, 0.1), 8.0  # of the hand, m; s
RADIUS = 0.1  # of every disc, m
RANDOM_PROBLEMS, RANDOM_SEED, RANDOM_PERIOD = 1000, 0, 1e-3
CURVE_STEP = 0.02  # s
DISTANCES: tuple[Distance, ...] = ("static", "table")
WALLS = {True: "Khatib", False: "printed"}
NORMS = (1.0, 1.5, 2.0, 4.0, np.inf)  # p of eq 19


@dataclass(frozen=True)
class Scene:
    """A move from START to GOAL: the branch of the elbow it starts in, and discs (position, velocity), m and m/s."""

    title: str
    elbow: int
    discs: tuple[tuple[tuple[float, float], tuple[float, float]], ...]


SCENES = {
    "crossing": Scene("a disc crosses the path of the hand", 1, (((1.2, 0.0), (-0.75, 0.45)),)),
    "crossing, other elbow": Scene("the same, elbow on the other side", -1, (((1.2, 0.0), (-0.75, 0.45)),)),
    "elbow": Scene("a disc comes at the elbow", 1, (((1.0, -0.3), (-0.5, 0.2)),)),
    "gate": Scene("two discs at rest", -1, (((0.51, 0.49), (0.0, 0.0)), ((0.25, 0.19), (0.0, 0.0)))),
}


def paper_problem(scene: str = "crossing") -> MotionProblem:
    """One of the scenes, for :data:`planners.SCARA_50CM`."""
    elbow, discs = SCENES[scene].elbow, SCENES[scene].discs
    return MotionProblem(
        arm=SCARA_50CM,
        q=SCARA_50CM.inverse_kinematics(START)[0 if elbow > 0 else 1],
        target=FixedHand(np.array(GOAL)),
        horizon=HORIZON,
        obstacles=tuple(Obstacle(np.array(position), np.array(velocity), RADIUS) for position, velocity in discs),
    )


def random_problems(count: int, seed: int) -> Iterator[MotionProblem]:
    """Moves of at least 0.4 m, and one disc from a random direction at 0.2 to 1 m/s.

    The disc crosses the hand's straight path between a fifth and four fifths of its length, after 0.5 to 2 s. It stays
    0.32 m away from the base, because nearer than that no arm could let it pass, and starts at least 0.3 m clear of the
    arm.
    """
    arm, rng = SCARA_50CM, np.random.default_rng(seed)
    widest = np.array([2.5, 2.4])
    while count:
        q, q_goal = rng.uniform(-widest, widest), rng.uniform(-widest, widest)
        start, goal = arm.forward_kinematics(np.stack([q, q_goal]))
        heading, speed = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.2, 1.0)
        velocity = speed * np.array([np.cos(heading), np.sin(heading)])
        position = start + rng.uniform(0.2, 0.8) * (goal - start) - rng.uniform(0.5, 2.0) * velocity
        way = position + np.linspace(0.0, HORIZON, 401)[:, None] * velocity
        bent = min(abs(q[1]), abs(q_goal[1])) >= 0.3 and q[1] * q_goal[1] > 0.0
        fair = np.hypot(*way.T).min() >= 0.32 and arm.clearance(q, position, RADIUS) >= 0.3
        if bent and fair and np.hypot(*(goal - start)) >= 0.4:
            disc = Obstacle(position, velocity, RADIUS)
            yield MotionProblem(arm=arm, q=q, target=FixedHand(goal), horizon=HORIZON, obstacles=(disc,))
            count -= 1


def paper_motion(scene: str, distance: Distance = "table", square: bool = True, norm: float = 2.0) -> FieldMotion:
    """The motion that the paper's field makes in one of the scenes."""
    return follow_field(paper_problem(scene), make_field(square=square, distance=distance, norm=norm))


def scene_records() -> Iterator[Record]:
    """The end of every scene's motion with either distance and either wall."""
    for scene, distance, square in itertools.product(SCENES, DISTANCES, WALLS):
        problem, motion = paper_problem(scene), paper_motion(scene, distance, square)
        hand = problem.arm.forward_kinematics(motion.q[-1])
        yield {
            "scene": scene,
            "distance": distance,
            "wall": WALLS[square],
            "outcome": motion.outcome,
            "time": motion.t[-1],  # s
            "goal_distance": np.hypot(*(hand - np.array(GOAL))),  # m
            "hand_clearance": motion.hand_clearance.min(),  # m; of the hand alone
            "arm_clearance": motion.clearance.min(),  # m
        }


def clearances() -> Iterator[Record]:
    """Clearance (m) of hand and arm in the crossing with either distance and either wall, every 0.02 s."""
    shown = slice(None, None, round(CURVE_STEP / PERIOD))
    for distance, square in itertools.product(DISTANCES, WALLS):
        motion = paper_motion("crossing", distance, square)
        curves = {"t": motion.t[shown], "hand": motion.hand_clearance[shown], "arm": motion.clearance[shown]}
        yield {"scene": "crossing", "distance": distance, "wall": WALLS[square], **curves}


def norm_records(problems: Sequence[MotionProblem]) -> Iterator[Record]:
    """The crossing, and shares of random moves, with the static distance in several p-norms (eq 19)."""
    for norm in NORMS:
        motion = paper_motion("crossing", "static", norm=norm)
        field = make_field(distance="static", norm=norm)
        endings = [_ending(problem, follow_field(problem, field, period=RANDOM_PERIOD))[0] for problem in problems]
        yield {
            "norm": norm,
            # of the boundary rho = 0 of a disc of radius 1, on the diagonal: where the field sees the disc
            "diagonal": 2.0 ** (0.5 - 1.0 / norm),
            "outcome": motion.outcome,
            "time": motion.t[-1],  # s
            "hand_clearance": motion.hand_clearance.min(),  # m; Euclidean
            "arm_clearance": motion.clearance.min(),  # m
            "reached": endings.count("reached") / len(problems),
            "hand_hit": endings.count("hand") / len(problems),
            "link_hit": endings.count("collision") / len(problems),
        }


def random_records(problems: Sequence[MotionProblem]) -> Iterator[Record]:
    """Shares of the outcomes (see `FieldMotion`) of the same problems with either distance and either wall."""
    plain: dict[bool, set[int]] = {}
    for distance, square in itertools.product(DISTANCES, WALLS):
        field = make_field(square=square, distance=distance)
        ends = [_ending(problem, follow_field(problem, field, period=RANDOM_PERIOD)) for problem in problems]
        endings = [ending for ending, _ in ends]
        reached = {i for i, ending in enumerate(endings) if ending == "reached"}
        before = plain.setdefault(square, reached)  # the plain distance comes first
        counts = {
            "reached": len(reached),
            "in_range": ends.count(("reached", True)),  # with every joint angle within its limits all the way
            "gained": len(reached - before),  # reached here but not with the plain distance and the same wall
            "lost": len(before - reached),  # the other way round
            "hand_hit": endings.count("hand"),
            "link_hit": endings.count("collision"),  # and not the hand
            "local_minimum": endings.count("local_minimum"),
            "late": endings.count("late"),
        }
        shares = {name: count / len(problems) for name, count in counts.items()}
        yield {"distance": distance, "wall": WALLS[square], **shares}


def _ending(problem: MotionProblem, motion: FieldMotion) -> tuple[str, bool]:
    """The outcome, or ``hand`` if a disc hit the hand; and whether the joint angles stayed within their limits."""
    touched = motion.outcome == "collision" and motion.hand_clearance[-1] < 0.0
    in_range = bool(problem.joint_limits.within(motion.q).all())
    return "hand" if touched else motion.outcome, in_range
