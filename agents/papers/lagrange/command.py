"""`planarm paper-lagrange`: the minimal-torque paper's results, published against regenerated.

"Trajectory Planning for Torque Minimization of Robot Manipulators Using the Lagrange Interpolation Method" (L.-P. Luo,
S.-W. Hwang, C.-S. Han): its printed motions in two stated models, its searches (:mod:`planners.lagrange.paper`), and
the move from rest to rest, beside the optimal planner.
"""

from __future__ import annotations

from agents.papers.lagrange.facts import facts
from agents.papers.lagrange.figures import figures
from agents.papers.lagrange.interpolation import (
    NODE_CAPTION,
    NODE_COLUMNS,
    node_records,
)
from agents.papers.lagrange.runs import (
    figure_records,
    move_records,
    published_records,
    reading_records,
    search_records,
)
from agents.papers.report import Columns, Report, ReportOptions, joined, publish, tabulate

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
READING_CAPTION = (
    "PI1 (N m s) of the printed motions under readings of their angles and torques; the published PI have no unit"
)
READING_COLUMNS: Columns = {
    "model": "{model}",
    "reading": "{reading}",
    "Algorithm 1": lambda row: f"{row['pi1'][0]:.3f}",
    "Algorithm 2": lambda row: f"{row['pi1'][1]:.3f}",
    "ratio": "{ratio:.3f}",
    "published": "{published_ratio:.3f}",
}
FIGURE_CAPTION = "Largest absolute values over the printed motions, but for PI1 and shares"
FIGURE_COLUMNS: Columns = {
    "figure": "{figure}",
    "quantity": "{quantity}",
    "published": lambda row: joined(row["published"], 4),
    "Algorithm 1": lambda row: f"{row['values'][0]:.3f}",
    "Algorithm 2": lambda row: f"{row['values'][1]:.3f}",
}


def run(options: ReportOptions) -> None:
    """Regenerate the paper's results: the entry point of the command."""
    records = {
        "published": list(published_records()),
        "searches": list(search_records()),
        "moves": list(move_records()),
        "figures": sorted(figure_records(), key=lambda row: str(row["figure"])),
        "nodes": list(node_records()),
        "readings": list(reading_records()),
    }
    least = "Least PI on the paper's grids; no velocity is fixed at the ends"
    same = "The same move from rest to rest; gravity off: horizontal, on: vertical"
    printed = "The printed motions (Tables 2 to 4)"
    tables = [
        tabulate(printed, records["published"], PUBLISHED_COLUMNS, PUBLISHED_CAPTION, 2),
        tabulate(least, records["searches"], PLAN_COLUMNS, PLAN_CAPTION, 2),
        tabulate(same, records["moves"], PLAN_COLUMNS, PLAN_CAPTION, 2),
        tabulate("Figures 2 to 9 in numbers", records["figures"], FIGURE_COLUMNS, FIGURE_CAPTION, 2),
        tabulate("Nodes (eq 7 and 11) and errors (eq 10)", records["nodes"], NODE_COLUMNS, NODE_CAPTION, 2),
        tabulate("Readings of the angles", records["readings"], READING_COLUMNS, READING_CAPTION, 2),
    ]
    found = list(facts(records["published"], records["searches"]))
    publish(Report("lagrange", tables, found, records, figures), options)
