"""`planarm paper-dpct`: the conveyor-tracking paper's results, published against regenerated.

"Motion Planning of a Robot Manipulator for Conveyor Tracking" (T. H. Park, B. H. Lee, M. S. Ko): the paper's planner
(:mod:`planners.dpct.paper`) as it plans on its own clock and as the arm moves in real time, beside the optimal planner.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

from agents.papers.dpct.equations import TABLE_1_CAPTION, TABLE_1_COLUMNS, facts, table_1_records
from agents.papers.dpct.figures import figures
from agents.papers.dpct.runs import (
    CASES,
    MAIN_GRID,
    SLIP,
    belt_records,
    clock_records,
    figure_records,
    plan_records,
)
from agents.papers.report import Columns, Record, Report, ReportOptions, joined, publish, tabulate
from agents.tables import Table

PLAN_CAPTION = (
    "t_a (s), peak torques (N m) and J (s) by the planner's clock, then of the motion in real time. Ratio: worst "
    "torque, velocity or acceleration over its limit; / least: real J over the least J within the limits; lag: delay "
    "of the hand at the end of the line."
)
PLAN_COLUMNS: Columns = {
    "case": "{case}",
    "planner": "{planner}",
    "grid": lambda plan: "x".join(map(str, plan["grid"] or ())),
    "t_a": "{rendezvous_time:.3f}",
    "paper's t_a": lambda plan: f"{time:.2f}" if (time := plan["published_rendezvous_time"]) else "",
    "peak torques": lambda plan: joined(plan["peak_torque"], 3),
    "paper's": lambda plan: joined(plan["published_peak_torque"] or (), 3),
    "J": "{cost:.4f}",
    "real peak torques": lambda plan: joined(plan["real_peak_torque"], 3),
    "ratio": lambda plan: f"{ratio:.2f}" if (ratio := _worst_ratio(plan)) else "",
    "real J": "{real_cost:.4f}",
    "/ least": "{cost_ratio:.2f}",
    "lag": lambda plan: f"{1e3 * lag:.0f} ms" if (lag := plan["lag"]) else "",
}
FIGURE_CAPTION = f"By the planner's clock, {MAIN_GRID[0]}x{MAIN_GRID[1]}; published: what the paper prints."
FIGURE_COLUMNS: Columns = {
    "figure": "{figure}",
    "quantity": "{quantity}",
    "published": lambda row: "" if row["published"] is None else f"{row['published']:.3f}",
    "literal": "{literal:.3f}",
    SLIP.name: "{slip:.3f}",
}
BELT_CAPTION = (
    "Case 3, at rest at t_0, on a belt that moves at 0.2 m/s then. Ratio: worst value over its limit; rides until: "
    "when following the part would break a limit."
)
BELT_COLUMNS: Columns = {
    "belt (m/s^2)": "{acceleration:+.2f}",
    "t_a (s)": lambda row: row["reason"].replace("_", " ") or f"{row['rendezvous_time']:.3f}",
    "peak torques (N m)": lambda row: joined(row["peak_torque"] if row["peak_torque"] is not None else (), 3),
    "ratio": lambda row: "" if row["limit_ratio"] is None else f"{row['limit_ratio']:.4f}",
    "rides until (s)": lambda row: "" if row["rides_until"] is None else f"{row['rides_until']:.2f}",
}


def run(options: ReportOptions) -> None:
    """Regenerate the paper's results: the entry point of the command."""
    records = {
        "plans": list(plan_records()),
        "start_clocks": list(clock_records()),
        "figures": sorted(figure_records(), key=lambda row: row["figure"]),
        "table_1": list(table_1_records()),
        "belts": list(belt_records()),
    }
    tables = [
        tabulate("Published, regenerated, and moved in real time", records["plans"], PLAN_COLUMNS, PLAN_CAPTION, 3),
        _clock_table(records["start_clocks"]),
        tabulate("Figures 4 to 8 in numbers", records["figures"], FIGURE_COLUMNS, FIGURE_CAPTION, 2),
        tabulate("Table 1 as printed", records["table_1"], TABLE_1_COLUMNS, TABLE_1_CAPTION),
        tabulate("An accelerating belt", records["belts"], BELT_COLUMNS, BELT_CAPTION),
    ]
    publish(Report("dpct", tables, list(facts()), records, figures), options)


def _worst_ratio(plan: Record) -> float:
    ratio: float = max(plan["limit_ratios"][kind] for kind in ("torque", "velocity", "acceleration"))
    return ratio


def _clock_table(rows: Sequence[Record]) -> Table:
    headers = ["D (m)", *(f"case {case}: {column}" for case in CASES for column in ("own", "real", "belt"))]
    lines = []
    for headway, group in groupby(rows, key=lambda row: row["headway"]):
        lines.append([f"{headway:+.2f}"])
        for row in group:
            lines[-1] += ["{own_start:+.3f}".format_map(row), "{real_start:+.3f}".format_map(row)]
            lines[-1].append(format(1e3 * row["belt_travel"], ".0f"))
    return Table(
        f"When the hand must start (literal, {MAIN_GRID[0]}x{MAIN_GRID[1]})",
        headers,
        lines,
        "Own and real time (s), below 0: before t_0. Belt (mm): its travel in the time missing by the own clock.",
    )
