"""`planarm paper-apf`: the potential-field paper's simulation and figures again, with numbers.

"Collision-Free Trajectory Planning for SCARA robot" (T. H. Kim, M. S. Park, S. Y. Song, S. K. Hong) prints one number,
its sampling period of 0.1 ms. Arm, gains and obstacles are stated here; the planner is :mod:`planners.apf.paper`, with
the plain distance (eq 10) and with the paper's table (eq 20), with Khatib's wall and with the one that eq 8 prints.
"""

from __future__ import annotations

import itertools
import timeit
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from rich.table import Table

from agents.papers.apf.facts import facts
from agents.papers.apf.figures import draw_clearances, draw_motion, draw_potentials, draw_table
from agents.papers.report import ReportOptions, image_bytes, new_sheet, report_console, write_report
from planners import SCARA_50CM, FixedHand, MotionProblem, Obstacle
from planners.apf.distance_table import DistanceTable
from planners.apf.hand_field import LOOK_AHEAD, Distance, hand_rates, make_field
from planners.apf.paper import PERIOD, FieldMotion, Outcome, follow_field
from planners.typing import Array

START, GOAL, HORIZON = (-0.25, 0.9), (0.65, 0.1), 8.0  # of the hand, m; s
RADIUS = 0.1  # of every disc, m
RANDOM_PROBLEMS, RANDOM_SEED, RANDOM_PERIOD = 1000, 0, 1e-3
CURVE_STEP = 0.02  # s
INSTANTS = (0.0, 0.4, 0.8, 1.2, 1.6, 2.5)  # s: figure 3
SURFACE_TIME = 1.0  # s: figure 2
DISTANCES: tuple[Distance, ...] = ("static", "table")
WALLS = {True: "Khatib", False: "printed"}


@dataclass(frozen=True)
class Scene:
    """A move from START to GOAL: the branch of the elbow it starts in, and discs (position, velocity), m and m/s."""

    title: str
    elbow: int
    discs: tuple[tuple[tuple[float, float], tuple[float, float]], ...]


SCENES = {
    "crossing": Scene("a disc crosses the hand's way", 1, (((1.2, 0.0), (-0.75, 0.45)),)),
    "crossing, other elbow": Scene("the same, elbow on the other side", -1, (((1.2, 0.0), (-0.75, 0.45)),)),
    "elbow": Scene("a disc comes at the elbow", 1, (((1.0, -0.3), (-0.5, 0.2)),)),
    "gate": Scene("two discs at rest", -1, (((0.51, 0.49), (0.0, 0.0)), ((0.25, 0.19), (0.0, 0.0)))),
}


@dataclass(frozen=True)
class PaperApfOptions(ReportOptions):
    """Where to write the potential-field paper's results, its figures 2 and 3 among them."""


@dataclass(frozen=True)
class SceneRow:
    """One motion. Lengths in m, times in s.

    Attributes:
        scene, distance, wall: what was planned and how.
        outcome: of :class:`planners.apf.paper.FieldMotion`.
        time: when it came.
        goal_distance: of the hand from the goal then.
        hand_clearance, arm_clearance: least of the motion, of the hand alone and of the whole arm.
    """

    scene: str
    distance: str
    wall: str
    outcome: Outcome
    time: float
    goal_distance: float
    hand_clearance: float
    arm_clearance: float


@dataclass(frozen=True)
class Clearances:
    """Clearance over time in one motion, m: ``t`` in s, of the ``hand`` alone and of the whole ``arm``."""

    scene: str
    distance: str
    wall: str
    t: Array
    hand: Array
    arm: Array


@dataclass(frozen=True)
class RandomRow:
    """What became of moves past a disc from a random direction; all shares of the problems.

    Attributes:
        distance, wall: of the field.
        reached, local_minimum, late: see :class:`planners.apf.paper.FieldMotion`.
        in_range: reached, and no joint angle was beyond its limit on the way.
        gained, lost: reached here and not with the plain distance and the same wall, and the other way round.
        hand_hit: a disc touched the hand.
        link_hit: a disc touched a link, the hand being clear of it.
    """

    distance: str
    wall: str
    reached: float
    in_range: float
    gained: float
    lost: float
    hand_hit: float
    link_hit: float
    local_minimum: float
    late: float


@dataclass(frozen=True)
class StepTime:
    """Time that one sample takes, s: the whole loop of the planner, and the field alone for many arms at once."""

    planner: float
    field_per_arm: float
    arms: int
    published_budget: float = PERIOD


def run(options: PaperApfOptions) -> None:
    """Regenerate the paper's results and, when asked for, its figures.

    Raises:
        ModuleNotFoundError: if a plot is asked for and matplotlib is missing.
    """
    scenes, step, known = list(scene_rows()), step_time(), list(facts(paper_problem()))
    randoms = list(random_rows(list(random_problems(RANDOM_PROBLEMS, RANDOM_SEED))))
    console = report_console()
    console.print(_scene_table(scenes), _random_table(randoms))
    console.print(
        f"- A sample takes {1e6 * step.planner:.2f} us in the planner, clearances included, and "
        f"{1e6 * step.field_per_arm:.2f} us an arm for the field alone with {step.arms} arms at once; the paper's "
        f"budget is {1e6 * step.published_budget:.0f} us.",
        highlight=False,
    )
    for fact in known:
        console.print(f"- {fact.statement}", highlight=False)
    document = {
        "scenes": [asdict(row) for row in scenes],
        "clearances": [asdict(curves) for curves in clearances()],
        "random": [asdict(row) for row in randoms],
        "step_time": asdict(step),
        "facts": [asdict(fact) for fact in known],
    }
    write_report(options, document, figure)


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

    Its course meets the straight way of the hand between a fifth and four fifths of it, after 0.5 to 2 s, and stays
    0.32 m off the base, where no arm could let it pass. It starts at least 0.3 m clear of the arm.
    """
    arm, rng = SCARA_50CM, np.random.default_rng(seed)
    widest = np.array([2.5, 2.4])
    while count:
        q, q_goal = rng.uniform(-widest, widest), rng.uniform(-widest, widest)
        start, goal = arm.forward_kinematics(np.stack([q, q_goal]))
        heading, speed = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.2, 1.0)
        velocity = speed * np.array([np.cos(heading), np.sin(heading)])
        position = start + rng.uniform(0.2, 0.8) * (goal - start) - rng.uniform(0.5, 2.0) * velocity
        course = position + np.linspace(0.0, HORIZON, 401)[:, None] * velocity
        bent = min(abs(q[1]), abs(q_goal[1])) >= 0.3 and q[1] * q_goal[1] > 0.0
        fair = np.hypot(*course.T).min() >= 0.32 and arm.clearance(q, position, RADIUS) >= 0.3
        if bent and fair and np.hypot(*(goal - start)) >= 0.4:
            disc = Obstacle(position, velocity, RADIUS)
            yield MotionProblem(arm=arm, q=q, target=FixedHand(goal), horizon=HORIZON, obstacles=(disc,))
            count -= 1


def paper_motion(scene: str, distance: Distance = "table", square: bool = True) -> FieldMotion:
    """Where the paper's field takes the arm in one of the scenes."""
    return follow_field(paper_problem(scene), make_field(square=square, distance=distance))


def scene_rows() -> Iterator[SceneRow]:
    """Every scene with either distance and either wall."""
    for scene, distance, square in itertools.product(SCENES, DISTANCES, WALLS):
        problem, motion = paper_problem(scene), paper_motion(scene, distance, square)
        hand = problem.arm.forward_kinematics(motion.q[-1])
        yield SceneRow(
            scene=scene,
            distance=distance,
            wall=WALLS[square],
            outcome=motion.outcome,
            time=float(motion.t[-1]),
            goal_distance=float(np.hypot(*(hand - np.array(GOAL)))),
            hand_clearance=float(motion.hand_clearance.min()),
            arm_clearance=float(motion.clearance.min()),
        )


def clearances() -> Iterator[Clearances]:
    """The crossing with either distance and either wall, every 0.02 s."""
    for distance, square in itertools.product(DISTANCES, WALLS):
        motion = paper_motion("crossing", distance, square)
        shown = slice(None, None, round(CURVE_STEP / PERIOD))
        yield Clearances(
            scene="crossing",
            distance=distance,
            wall=WALLS[square],
            t=motion.t[shown],
            hand=motion.hand_clearance[shown],
            arm=motion.clearance[shown],
        )


def random_rows(problems: Sequence[MotionProblem]) -> Iterator[RandomRow]:
    """The same problems with either distance and either wall."""
    plain: dict[bool, set[int]] = {}
    for distance, square in itertools.product(DISTANCES, WALLS):
        field = make_field(square=square, distance=distance)
        ends = [_ending(problem, follow_field(problem, field, period=RANDOM_PERIOD)) for problem in problems]
        endings = [ending for ending, _ in ends]
        reached = {i for i, ending in enumerate(endings) if ending == "reached"}
        before = plain.setdefault(square, reached)  # the plain distance comes first
        yield RandomRow(
            distance=distance,
            wall=WALLS[square],
            reached=len(reached) / len(problems),
            in_range=ends.count(("reached", True)) / len(problems),
            gained=len(reached - before) / len(problems),
            lost=len(before - reached) / len(problems),
            hand_hit=endings.count("hand") / len(problems),
            link_hit=endings.count("collision") / len(problems),
            local_minimum=endings.count("local_minimum") / len(problems),
            late=endings.count("late") / len(problems),
        )


def _ending(problem: MotionProblem, motion: FieldMotion) -> tuple[str, bool]:
    """The outcome, or ``hand`` if it is the hand that was hit; and whether the joint angles kept their limits."""
    touched = motion.outcome == "collision" and motion.hand_clearance[-1] < 0.0
    in_range = bool((np.abs(motion.q) <= problem.joint_limits.angle).all())
    return "hand" if touched else motion.outcome, in_range


def step_time(arms: int = 256) -> StepTime:
    """Time a sample takes: the least of several measurements."""
    arm, problem, field = SCARA_50CM, paper_problem(), make_field()
    samples = len(follow_field(problem, field).t)
    q = np.tile(problem.q, (arms, 1))
    goals, radii = np.tile(GOAL, (arms, 1)), np.full((arms, 1), RADIUS + arm.link_radius)
    discs = np.tile(problem.obstacles[0].position, (arms, 1, 1)), np.tile(problem.obstacles[0].velocity, (arms, 1, 1))
    free = np.full(2, np.inf)

    def rates() -> Array:
        return hand_rates(arm.length_array, arm.base_array, field, free, q, 0.0 * q, goals, *discs, radii)

    rates()  # compiled, or read from the cache, before the clock starts
    return StepTime(
        planner=min(timeit.repeat(lambda: follow_field(problem, field), number=1, repeat=20)) / samples,
        field_per_arm=min(timeit.repeat(rates, number=10, repeat=20)) / (10 * arms),
        arms=arms,
    )


def figure(file_format: str, dpi: int) -> bytes:
    """The paper's figures 2 and 3, as the bytes of an image file.

    Raises:
        ModuleNotFoundError: if matplotlib is missing; the message says how to install it.
        ValueError: if matplotlib does not know the file format.
    """
    sheet = new_sheet(13.5, 13.0)
    panels: Any = sheet.subfigures(3, 1, height_ratios=(1.0, 1.1, 0.8))
    surfaces, scenes, curves = panels
    draw_potentials(surfaces, paper_problem(), make_field().gains, time=SURFACE_TIME)
    shown: tuple[tuple[str, Distance], ...] = (("crossing", "static"), ("crossing", "table"), ("elbow", "table"))
    for axes, (scene, distance) in zip(scenes.subplots(1, 3), shown, strict=True):
        title = f"Figure 3: {SCENES[scene].title}, {distance}"
        draw_motion(axes, paper_problem(scene), paper_motion(scene, distance), title, INSTANTS)
    crossing, other, table = curves.subplots(1, 3)
    for axes, scene in ((crossing, "crossing"), (other, "crossing, other elbow")):
        motions = {
            f"{distance}, {WALLS[square]}": paper_motion(scene, distance, square)
            for distance, square in itertools.product(DISTANCES, WALLS)
        }
        draw_clearances(axes, motions, scene.capitalize(), INSTANTS[-1])
    draw_table(table, DistanceTable.looking_ahead(LOOK_AHEAD), (0.25, 0.5, 1.0, 2.0))
    return image_bytes(sheet, file_format, dpi)


def _scene_table(rows: Sequence[SceneRow]) -> Table:
    table = Table(
        title=f"From {START} to {GOAL} m past moving discs",
        caption="Time (s) of the end, distance from the goal then, least clearances of hand and arm (mm)",
    )
    for column in ("scene", "distance", "wall", "outcome"):
        table.add_column(column)
    for column in ("time", "from goal", "hand", "arm"):
        table.add_column(column, justify="right")
    for _, group in itertools.groupby(rows, key=lambda row: row.scene):
        for row in group:
            lengths = (f"{1e3 * value:.0f}" for value in (row.goal_distance, row.hand_clearance, row.arm_clearance))
            outcome = row.outcome.replace("_", " ")
            table.add_row(row.scene, row.distance, row.wall, outcome, f"{row.time:.2f}", *lengths)
        table.add_section()
    return table


def _random_table(rows: Sequence[RandomRow]) -> Table:
    table = Table(
        title=f"{RANDOM_PROBLEMS} moves past a disc from a random direction (seed {RANDOM_SEED}), % of them",
        caption="In range: of the joint angles, all the way. Gained: reached here and not with the static distance and "
        "the same wall; lost: the other way round",
    )
    for column in ("distance", "wall"):
        table.add_column(column)
    for column in ("reached", "in range", "gained", "lost", "hand hit", "link hit", "local minimum", "late"):
        table.add_column(column, justify="right")
    for row in rows:
        shares = (
            row.reached,
            row.in_range,
            row.gained,
            row.lost,
            row.hand_hit,
            row.link_hit,
            row.local_minimum,
            row.late,
        )
        table.add_row(row.distance, row.wall, *(f"{100.0 * share:.1f}" for share in shares))
    return table
