"""`planarm paper-lagrange`: the minimal-torque paper's results, published against regenerated.

"Trajectory Planning for Torque Minimization of Robot Manipulators Using the Lagrange Interpolation Method" (L.-P. Luo,
S.-W. Hwang, C.-S. Han): its printed motions in two stated models, its searches (:mod:`planners.lagrange.paper`), and
the move from rest to rest, beside the optimal planner. In both models the links are uniform rods and the joint angles
relative; with gravity, angle 0 is horizontal.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial
from scipy.integrate import cumulative_trapezoid

from agents.figures.sheet import name_axes
from agents.papers.report import (
    Columns,
    Fact,
    Part,
    Parts,
    Record,
    Report,
    ReportOptions,
    Sheet,
    joined,
    publish,
    tabulate,
)
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

MODELS = {"gravity off": 0.0, "gravity on": 9.81}  # m/s^2
PUBLISHED_PI: dict[Method, float] = {"lagrange": 69.6216, "polynomial": 145.4126}
ALGORITHMS: dict[Method, str] = {"lagrange": "1, Lagrange", "polynomial": "2, polynomial"}


def run(options: ReportOptions) -> None:
    """Regenerate the paper's results: the entry point of the command."""
    published, searches, moves = list(published_records()), list(search_records()), list(move_records())
    least = "Least PI on the paper's grids; no velocity is fixed at the ends"
    same = "The same move from rest to rest; gravity off: horizontal, on: vertical"
    tables = [
        tabulate("The printed motions (Tables 2 to 4)", published, PUBLISHED_COLUMNS, PUBLISHED_CAPTION, 2),
        tabulate(least, searches, PLAN_COLUMNS, PLAN_CAPTION, 2),
        tabulate(same, moves, PLAN_COLUMNS, PLAN_CAPTION, 2),
    ]
    records: dict[str, Sequence[Record]] = {"published": published, "searches": searches, "moves": moves}
    publish(Report("lagrange", tables, list(facts(published, searches)), records, figures), options)


def paper_problem(model: str = "gravity off") -> MotionProblem:
    """The paper's simulation (Table 1 and eq 13) in one of the models; its velocities at the ends are left open."""
    arm = replace(PLANAR_3R, gravity=MODELS[model])
    return MotionProblem(arm=arm, q=np.zeros(3), target=FixedJoints(np.array([1.0, 0.0, 0.0])), horizon=1.0)


def published_records() -> Iterator[Record]:
    """The motions of Tables 2 to 4 in every model."""
    for model in MODELS:
        for method, algorithm in ALGORITHMS.items():
            found = published_motion(paper_problem(model), method)
            yield {
                "model": model,
                "algorithm": algorithm,
                "published_pi": PUBLISHED_PI[method],  # its unit is not stated
                "pi1": found.cost,  # integral of the sum of abs(tau), N m s
                "pi2": torque_integral(found.t, found.tau, 2),  # integral of the sum of tau^2, N^2 m^2 s
                "peak_torque": np.abs(found.tau).max(axis=0),  # of each joint, N m
                "start_velocity": found.qd[0],  # of each joint, rad/s
                "end_velocity": found.qd[-1],
                "end_angle": found.q[-1],  # of each joint, rad
            }


def search_records() -> Iterator[Record]:
    """The paper's searches, as stated."""
    for model in MODELS:
        problem = paper_problem(model)
        yield _record(model, "1: Table 2's nodes", plan_paper(problem, nodes=PUBLISHED_TIMES))
        yield _record(model, "1: 5 nodes (degree 4)", plan_paper(problem))
        yield _record(model, "1: 3 nodes (degree 2)", plan_paper(problem, nodes=3))
        yield _record(model, "2: degree 2", plan_paper(problem, method="polynomial"))


def move_records() -> Iterator[Record]:
    """The move from rest to rest, by the paper's searches and by others."""
    for model in MODELS:
        problem = paper_problem(model)
        still = Polynomial([0.0])
        quintic = motion(problem, [Polynomial([0.0, 0.0, 0.0, 10.0, -15.0, 6.0]), still, still], "quintic")
        yield _record(model, "cubic", plan_paper(problem, method="polynomial", degree=3, clamped=True))
        yield _record(model, "quintic", quintic)
        yield _record(model, "2: degree 4", plan_paper(problem, method="polynomial", degree=4, clamped=True))
        yield _record(model, "1: 5 nodes, eq 7", plan_paper(problem, clamped=True))
        yield _record(model, "1: 5 nodes, Lobatto", plan_paper(problem, nodes=lobatto_nodes(4), clamped=True))
        for objective in ("PI1", "PI2"):
            yield _record(model, f"optimal, {objective}", lagrange.plan(problem, objective=objective))


def _record(model: str, plan: str, found: Trajectory) -> Record:
    """The result of a search or a planner."""
    return {
        "model": model,
        "plan": plan,
        "pi1": torque_integral(found.t, found.tau),
        "pi2": torque_integral(found.t, found.tau, 2),
        "start_speed": np.abs(found.qd[0]).max(),  # of the fastest joint, rad/s
        "torque_ratio": found.limit_ratios["torque"],  # worst value over the limit of planners.PLANAR_3R
        "angle_ratio": found.limit_ratios["angle"],
    }


def facts(published: Sequence[Record], searches: Sequence[Record]) -> Iterator[Fact]:
    """Results that do not reproduce, or conclusions that do not follow, with the numbers that show it."""
    pi = {(row["model"], row["algorithm"]): row["pi1"] for row in published}
    least = {(row["model"], row["plan"]): row["pi1"] for row in searches}
    algorithm1, algorithm2 = ALGORITHMS.values()
    end_angle = published[0]["end_angle"]  # of algorithm 1 with gravity off

    ratios = {model: pi[model, algorithm2] / pi[model, algorithm1] for model in MODELS}
    ratio = PUBLISHED_PI["polynomial"] / PUBLISHED_PI["lagrange"]
    yield Fact(
        f"The published PI, {PUBLISHED_PI['lagrange']} and {PUBLISHED_PI['polynomial']} (ratio {ratio:.3f}), are "
        "not reproduced by the printed motions; only their order is: the ratio is "
        + ", ".join(f"{value:.3f} with {model}" for model, value in ratios.items())
        + ".",
        {"published_ratio": ratio, "ratios": ratios},
    )

    sines = np.sin(np.radians([0.0, 15.0, 30.0, 45.0]))
    yield Fact(
        f"Table 2 is not eq 7, which gives {joined(chebyshev_nodes(5), 4)}; its first four times are sin(0, 15, 30, 45 "
        f"deg) = {joined(sines, 4)}, its last is {PUBLISHED_TIMES[-1]}.",
        {"equation_7": chebyshev_nodes(5), "sines": sines, "table_2": PUBLISHED_TIMES},
    )

    yield Fact(
        f"With the last node at {PUBLISHED_TIMES[-1]} s, Table 3's motion is at {joined(end_angle, 4)} rad "
        "at 1 s, not at the goal.",
        {"end_angle": end_angle},
    )

    speeds = {row["algorithm"]: float(np.abs(row["start_velocity"]).max()) for row in published[:2]}
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


PUBLISHED_CAPTION = "PI1 (N m s), PI2 (N^2 m^2 s), peak torques (N m), velocities (rad/s) and angles (rad) at 0 and 1 s"
PUBLISHED_COLUMNS: Columns = {
    "model": "{model}",
    "algorithm": "{algorithm}",
    "PI, paper": "{published_pi:.4f}",
    "PI1": "{pi1:.3f}",
    "PI2": "{pi2:.2f}",
    "peak torques": lambda row: joined(row["peak_torque"], 2),
    "start velocity": lambda row: joined(row["start_velocity"], 2),
    "end velocity": lambda row: joined(row["end_velocity"], 2),
    "end angle": lambda row: joined(row["end_angle"], 3),
}
PLAN_CAPTION = "1, 2: the paper's algorithms; ratio: worst value over the arm's limit"
PLAN_COLUMNS: Columns = {
    "model": "{model}",
    "plan": "{plan}",
    "PI1": "{pi1:.3f}",
    "PI2": "{pi2:.3f}",
    "start speed": "{start_speed:.2f}",
    "torque ratio": "{torque_ratio:.2f}",
    "angle ratio": "{angle_ratio:.2f}",
}


def figures() -> Parts:
    """The paper's figures 2 to 9 from its printed motions."""
    trajectories = {f"figure_{2 + place}": method for place, method in enumerate(ALGORITHMS)}
    return {
        **{name: Part(partial(_draw_trajectory, method=method), 5.5, 3.4) for name, method in trajectories.items()},
        **{f"figure_{4 + joint}": Part(partial(_draw_joint, joint=joint), 11.0, 3.0) for joint in range(3)},
        "figure_7": Part(_draw_torques, 11.0, 3.2),
        "figures_8_9": Part(_draw_sums, 11.0, 3.2),
    }


def _printed_motions() -> Iterator[tuple[str, str, Trajectory, dict[str, Any]]]:
    """The model, the algorithm, its printed motion in the model, and how to draw it."""
    for model, style in zip(MODELS, ("-", "--"), strict=True):
        for (method, algorithm), color in zip(ALGORITHMS.items(), ("C0", "C1"), strict=True):
            found = published_motion(paper_problem(model), method)
            yield model, algorithm, found, {"color": color, "linestyle": style, "label": f"{algorithm}, {model}"}


def _draw_trajectory(sheet: Sheet, method: Method) -> None:
    found = published_motion(paper_problem("gravity off"), method)
    axes = sheet.subplots()
    for joint in range(3):
        axes.plot(found.t, found.q[:, joint], label=f"joint {joint + 1}")
    place = list(ALGORITHMS).index(method)
    name_axes(axes, f"Figure {2 + place}: Algorithm {ALGORITHMS[method]}", "t (s)", "angle (rad)")


def _draw_joint(sheet: Sheet, joint: int) -> None:
    panels = sheet.subplots(1, 3)
    units = {"angle": "rad", "velocity": "rad/s", "acceleration": "rad/s$^2$"}
    for model, algorithm, found, look in _printed_motions():
        if model == "gravity off":  # the motion is the same in both
            for axes, values in zip(panels, (found.q, found.qd, found.qdd), strict=True):
                axes.plot(found.t, values[:, joint], **{**look, "label": algorithm})
    for axes, (name, unit) in zip(panels, units.items(), strict=True):
        name_axes(axes, f"Figure {4 + joint}: {name} of joint {joint + 1}", "t (s)", f"{name} ({unit})")


def _draw_torques(sheet: Sheet) -> None:
    panels = sheet.subplots(1, 3)
    for _, _, found, look in _printed_motions():
        for joint, axes in enumerate(panels):
            axes.plot(found.t, found.tau[:, joint], **look)
    for joint, axes in enumerate(panels):
        name_axes(axes, f"Figure 7: torque of joint {joint + 1}", "t (s)", "torque (N m)")


def _draw_sums(sheet: Sheet) -> None:
    total, instant, so_far = sheet.subplots(1, 3)
    for _, _, found, look in _printed_motions():
        pi = np.abs(found.tau).sum(axis=1)
        total.plot(found.t, found.tau.sum(axis=1), **look)
        instant.plot(found.t, pi, **look)
        so_far.plot(found.t, cumulative_trapezoid(pi, found.t, initial=0), **look)
    name_axes(total, "Figure 8: sum of the torques", "t (s)", "torque (N m)")
    name_axes(instant, "Figure 9: PI at an instant (eq 6)", "t (s)", "PI (N m)")
    name_axes(so_far, "Not in the paper: PI up to t", "t (s)", "PI1 (N m s)")
