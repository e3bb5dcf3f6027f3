"""Results of the minimal-torque paper that do not reproduce, with the numbers that show it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.polynomial import Polynomial

from agents.papers.lagrange.runs import ALGORITHMS, MODELS, PUBLISHED_PI, paper_problem
from agents.papers.report import Fact, Record, joined
from planners.lagrange.paper import PUBLISHED_TIMES, chebyshev_nodes, motion


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
