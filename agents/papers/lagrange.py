"""`planarm paper-lagrange`: the minimal-torque paper's results, published against regenerated.

"Trajectory Planning for Torque Minimization of Robot Manipulators Using the Lagrange Interpolation Method" (L.-P. Luo,
S.-W. Hwang, C.-S. Han): its printed motions in two stated models, its searches as :mod:`planners.lagrange.paper` reads
them, and the move from rest to rest that it is about, beside the optimal planner. In both models the links are uniform
rods and the joint angles relative; with gravity, angle 0 is horizontal.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import groupby
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial
from rich.table import Table
from scipy.integrate import cumulative_trapezoid

from agents.papers.report import Fact, ReportOptions, image_bytes, name_axes, new_sheet, report_console, write_report
from planners import PLANAR_3R, FixedJoints, MotionProblem, Trajectory, lagrange
from planners.lagrange.interpolation import lobatto_nodes
from planners.lagrange.paper import (
    PUBLISHED_TIMES,
    Method,
    chebyshev_nodes,
    motion,
    plan_paper,
    published_motion,
    torque_integral,
)
from planners.typing import Array

MODELS = {"gravity off": 0.0, "gravity on": 9.81}  # m/s^2
PUBLISHED_PI: dict[Method, float] = {"lagrange": 69.6216, "polynomial": 145.4126}
ALGORITHMS: dict[Method, str] = {"lagrange": "1, Lagrange", "polynomial": "2, polynomial"}


@dataclass(frozen=True)
class PaperLagrangeOptions(ReportOptions):
    """Where to write the minimal-torque paper's results, its figures 2 to 9 among them."""


@dataclass(frozen=True)
class PublishedRow:
    """A motion the paper prints, in a stated model.

    Attributes:
        model, algorithm: which.
        published_pi: what the paper prints; its unit is not stated.
        pi1, pi2: integrals of the sum of abs(tau), N m s, and of tau^2, N^2 m^2 s.
        peak_torque: of each joint, N m.
        start_velocity, end_velocity: of each joint at 0 and 1 s, rad/s.
        end_angle: of each joint at 1 s, rad.
    """

    model: str
    algorithm: str
    published_pi: float
    pi1: float
    pi2: float
    peak_torque: Array
    start_velocity: Array
    end_velocity: Array
    end_angle: Array


@dataclass(frozen=True)
class PlanRow:
    """The result of a search or a planner.

    Attributes:
        model, plan: what was planned and how.
        pi1, pi2: as in :class:`PublishedRow`.
        start_speed: the fastest joint's at time 0, rad/s.
        torque_ratio, angle_ratio: worst value over the limit of :data:`planners.PLANAR_3R`.
    """

    model: str
    plan: str
    pi1: float
    pi2: float
    start_speed: float
    torque_ratio: float
    angle_ratio: float


def run(options: PaperLagrangeOptions) -> None:
    """Regenerate the paper's tables and, when asked for, its figures.

    Raises:
        ModuleNotFoundError: if a plot is asked for and matplotlib is missing.
    """
    published, searches, moves = list(published_rows()), list(search_rows()), list(move_rows())
    known = list(facts(published, searches))
    console = report_console()
    console.print(_published_table(published))
    console.print(_plan_table("Least PI on the paper's grids; no velocity is fixed at the ends", searches))
    console.print(_plan_table("The same move from rest to rest; gravity off: horizontal, on: vertical", moves))
    for fact in known:
        console.print(f"- {fact.statement}", highlight=False)
    tables: dict[str, Sequence[Any]] = {"published": published, "searches": searches, "moves": moves, "facts": known}
    write_report(options, {name: [asdict(row) for row in rows] for name, rows in tables.items()}, figure)


def paper_problem(model: str = "gravity off") -> MotionProblem:
    """The paper's simulation (Table 1 and eq 13) in one of the models; its velocities at the ends are left open."""
    arm = replace(PLANAR_3R, gravity=MODELS[model])
    return MotionProblem(arm=arm, q=np.zeros(3), target=FixedJoints(np.array([1.0, 0.0, 0.0])), horizon=1.0)


def published_rows() -> Iterator[PublishedRow]:
    """The motions of Tables 2 to 4 in every model."""
    for model in MODELS:
        for method, algorithm in ALGORITHMS.items():
            found = published_motion(paper_problem(model), method)
            yield PublishedRow(
                model=model,
                algorithm=algorithm,
                published_pi=PUBLISHED_PI[method],
                pi1=found.cost,
                pi2=torque_integral(found.t, found.tau, 2),
                peak_torque=np.abs(found.tau).max(axis=0),
                start_velocity=found.qd[0],
                end_velocity=found.qd[-1],
                end_angle=found.q[-1],
            )


def search_rows() -> Iterator[PlanRow]:
    """The paper's searches as it states them."""
    for model in MODELS:
        problem = paper_problem(model)
        yield _plan_row(model, "1: Table 2's nodes", plan_paper(problem, nodes=PUBLISHED_TIMES))
        yield _plan_row(model, "1: 5 nodes (degree 4)", plan_paper(problem))
        yield _plan_row(model, "1: 3 nodes (degree 2)", plan_paper(problem, nodes=3))
        yield _plan_row(model, "2: degree 2", plan_paper(problem, method="polynomial"))


def move_rows() -> Iterator[PlanRow]:
    """The move from rest to rest, by the paper's searches and by others."""
    for model in MODELS:
        problem = paper_problem(model)
        still = Polynomial([0.0])
        quintic = motion(problem, [Polynomial([0.0, 0.0, 0.0, 10.0, -15.0, 6.0]), still, still], "quintic")
        yield _plan_row(model, "cubic", plan_paper(problem, method="polynomial", degree=3, clamped=True))
        yield _plan_row(model, "quintic", quintic)
        yield _plan_row(model, "2: degree 4", plan_paper(problem, method="polynomial", degree=4, clamped=True))
        yield _plan_row(model, "1: 5 nodes, eq 7", plan_paper(problem, clamped=True))
        yield _plan_row(model, "1: 5 nodes, Lobatto", plan_paper(problem, nodes=lobatto_nodes(4), clamped=True))
        for objective in ("PI1", "PI2"):
            yield _plan_row(model, f"optimal, {objective}", lagrange.plan(problem, objective=objective))


def _plan_row(model: str, plan: str, found: Trajectory) -> PlanRow:
    return PlanRow(
        model=model,
        plan=plan,
        pi1=torque_integral(found.t, found.tau),
        pi2=torque_integral(found.t, found.tau, 2),
        start_speed=float(np.abs(found.qd[0]).max()),
        torque_ratio=found.limit_ratios["torque"],
        angle_ratio=found.limit_ratios["angle"],
    )


def facts(published: Sequence[PublishedRow], searches: Sequence[PlanRow]) -> Iterator[Fact]:
    """What does not reproduce, or does not follow, with the numbers that show it."""
    pi = {(row.model, row.algorithm): row.pi1 for row in published}
    least = {(row.model, row.plan): row.pi1 for row in searches}
    algorithm1, algorithm2 = ALGORITHMS.values()
    lagrange_row = published[0]

    ratios = {model: pi[model, algorithm2] / pi[model, algorithm1] for model in MODELS}
    ratio = PUBLISHED_PI["polynomial"] / PUBLISHED_PI["lagrange"]
    yield Fact(
        f"The published PI, {PUBLISHED_PI['lagrange']} and {PUBLISHED_PI['polynomial']} (ratio {ratio:.3f}), do not "
        "come out of the printed motions. Which of the two is the less does: the ratio is "
        + ", ".join(f"{value:.3f} with {model}" for model, value in ratios.items())
        + ".",
        {"published_ratio": ratio, "ratios": ratios},
    )

    sines = np.sin(np.radians([0.0, 15.0, 30.0, 45.0]))
    yield Fact(
        f"Table 2 is not eq 7, which gives {_row(chebyshev_nodes(5), 4)}; its first four times are sin(0, 15, 30, 45 "
        f"deg) = {_row(sines, 4)}, its last is {PUBLISHED_TIMES[-1]}.",
        {"equation_7": chebyshev_nodes(5), "sines": sines, "table_2": PUBLISHED_TIMES},
    )

    yield Fact(
        f"With the last node at {PUBLISHED_TIMES[-1]} s, Table 3's motion is at {_row(lagrange_row.end_angle, 4)} rad "
        "at 1 s, not at the goal.",
        {"end_angle": lagrange_row.end_angle},
    )

    speeds = {row.algorithm: float(np.abs(row.start_velocity).max()) for row in published[:2]}
    turning = motion(paper_problem(), [Polynomial([0.0, 1.0]), Polynomial([0.0]), Polynomial([0.0])], "theta1 = t")
    yield Fact(
        "No velocity is fixed at the ends: the printed motions start at up to "
        + " and ".join(f"{speed:.1f}" for speed in speeds.values())
        + f" rad/s. With gravity off theta1 = t needs no torque at all (PI = {turning.cost:.3g}), so the problem as "
        "stated has a trivial solution.",
        {"start_speeds": speeds, "turning_pi": turning.cost},
    )

    own = {model: {"table_3": pi[model, algorithm1], "least": least[model, "1: Table 2's nodes"]} for model in MODELS}
    yield Fact(
        "Table 3 is not the least of its own grid (fifths of a radian for joint 1, quarters for the others, Table 2's "
        "nodes): "
        + ", ".join(f"PI {value['table_3']:.3f}, least {value['least']:.3f} with {name}" for name, value in own.items())
        + ".",
        {"own_grid": own},
    )

    heavy = "gravity on"
    degrees = {
        "table_3": pi[heavy, algorithm1],
        "table_4": pi[heavy, algorithm2],
        "degree_2": least[heavy, "2: degree 2"],
        "degree_4": least[heavy, "1: 5 nodes (degree 4)"],
    }
    yield Fact(
        "Interpolation and polynomial are the same functions when the degree is the same; the paper compares degree 4 "
        f"with degree 2. With {heavy}, degree 2 searched on a grid has PI {degrees['degree_2']:.3f}, less than Table 3 "
        f"of degree 4 ({degrees['table_3']:.3f}) and than Table 4 ({degrees['table_4']:.3f}); degree 4 has "
        f"{degrees['degree_4']:.3f}.",
        {"model": heavy, "pi": degrees},
    )


def _published_table(rows: Sequence[PublishedRow]) -> Table:
    caption = "PI1 (N m s), PI2 (N^2 m^2 s), peak torques (N m), velocities (rad/s) and angles (rad) at 0 and 1 s"
    table = Table(title="The printed motions (Tables 2 to 4) in two models", caption=caption)
    for column in ("model", "algorithm"):
        table.add_column(column)
    for column in ("PI, paper", "PI1", "PI2", "peak torques", "start velocity", "end velocity", "end angle"):
        table.add_column(column, justify="right")
    for row in rows:
        numbers = (f"{row.published_pi:.4f}", f"{row.pi1:.3f}", f"{row.pi2:.2f}", _row(row.peak_torque, 2))
        ends = (_row(row.start_velocity, 2), _row(row.end_velocity, 2), _row(row.end_angle, 3))
        table.add_row(row.model, row.algorithm, *numbers, *ends, end_section=row.algorithm != rows[0].algorithm)
    return table


def _plan_table(title: str, rows: Sequence[PlanRow]) -> Table:
    table = Table(title=title, caption="1, 2: the paper's algorithms; ratio: worst value over the arm's limit")
    for column in ("model", "plan"):
        table.add_column(column)
    for column in ("PI1", "PI2", "start speed", "torque ratio", "angle ratio"):
        table.add_column(column, justify="right")
    for _, group in groupby(rows, key=lambda row: row.model):
        for row in group:
            numbers = (f"{row.pi1:.3f}", f"{row.pi2:.3f}", f"{row.start_speed:.2f}")
            table.add_row(row.model, row.plan, *numbers, f"{row.torque_ratio:.2f}", f"{row.angle_ratio:.2f}")
        table.add_section()
    return table


def _row(values: Sequence[float] | Array, digits: int) -> str:
    return " ".join(f"{value:.{digits}f}" for value in values)


def figure(file_format: str, dpi: int) -> bytes:
    """The paper's figures 2 to 9 from its printed motions, as an image file.

    Raises:
        ModuleNotFoundError: if matplotlib is missing; the message says how to install it.
        ValueError: if matplotlib does not know the file format.
    """
    sheet = new_sheet(13.0, 16.0)
    panels = sheet.subplots(5, 3)
    for model, style in zip(MODELS, ("-", "--"), strict=True):
        for (method, algorithm), colour in zip(ALGORITHMS.items(), ("C0", "C1"), strict=True):
            found = published_motion(paper_problem(model), method)
            look: dict[str, Any] = {"color": colour, "linestyle": style, "label": f"{algorithm}, {model}"}
            for joint in range(3):
                if model == "gravity off":  # the motion is the same in both
                    for row, values in enumerate((found.q, found.qd, found.qdd)):
                        panels[row, joint].plot(found.t, values[:, joint], color=colour, label=algorithm)
                panels[3, joint].plot(found.t, found.tau[:, joint], **look)
            instant = np.abs(found.tau).sum(axis=1)
            panels[4, 0].plot(found.t, found.tau.sum(axis=1), **look)
            panels[4, 1].plot(found.t, instant, **look)
            panels[4, 2].plot(found.t, cumulative_trapezoid(instant, found.t, initial=0), **look)
    for joint in range(3):
        for row, (name, unit) in enumerate((("angle", "rad"), ("velocity", "rad/s"), ("acceleration", "rad/s^2"))):
            number = f"{joint + 4}" if row else f"2, 3, {joint + 4}"
            name_axes(
                panels[row, joint],
                f"Figure {number}: {name} of joint {joint + 1}",
                "t (s)",
                f"{name} ({unit})",
                fontsize="x-small",
            )
        name_axes(
            panels[3, joint], f"Figure 7: torque of joint {joint + 1}", "t (s)", "torque (N m)", fontsize="x-small"
        )
    name_axes(panels[4, 0], "Figure 8: sum of the torques", "t (s)", "torque (N m)", fontsize="x-small")
    name_axes(panels[4, 1], "Figure 9: PI at an instant (eq 6)", "t (s)", "PI (N m)", fontsize="x-small")
    name_axes(panels[4, 2], "Not in the paper: PI up to t", "t (s)", "PI1 (N m s)", fontsize="x-small")
    return image_bytes(sheet, file_format, dpi)
