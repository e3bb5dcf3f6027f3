"""`planarm paper-dpct`: the conveyor-tracking paper's results, published against regenerated.

"Motion Planning of a Robot Manipulator for Conveyor Tracking" (T. H. Park, B. H. Lee, M. S. Ko): the paper's planner
(:mod:`planners.dpct.paper`) as it plans on its own clock and as the arm moves in real time, beside the optimal planner.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import groupby
from typing import Literal

import numpy as np

from agents.figures.sheet import name_axes
from agents.papers.report import Columns, Part, Parts, Record, Report, ReportOptions, Sheet, joined, publish, tabulate
from agents.tables import Table
from planners import SCARA_1M, JointLimits, MotionProblem, MovingHand, Trajectory, dpct
from planners.dpct.paper import (
    LITERAL,
    MASS_SLIPS,
    REPAIRED,
    PhasePath,
    Reading,
    execute,
    search_phase_plane,
    signed_peak,
)
from planners.typing import Array

BELT_SPEED, HEADWAY, START, HEIGHT, LINE = 0.2, 0.1, -0.8, 1.732, 0.5  # m/s; m: section 5.1 of the paper
GRIDS = ((30, 50), (50, 100), (100, 200))
MAIN_GRID = (50, 100)
HEADWAYS = (0.2, 0.1, 0.05, 0.0, -0.05)


@dataclass(frozen=True)
class Case:
    """One of the paper's three cases (section 5.3): its limits and what was published for the 50 x 100 grid."""

    title: str
    limits: JointLimits
    rendezvous_time: float
    peak_torque: tuple[float, float] | None


_PAPER_LIMITS = SCARA_1M.limits
CASES = {
    1: Case("no limits", JointLimits.unlimited(2), 0.65, (-1.342, -0.406)),
    2: Case("torque limits", JointLimits(torque=_PAPER_LIMITS.torque), 0.80, (-0.499, -0.14)),
    3: Case("all limits", _PAPER_LIMITS, 1.10, None),
}


def run(options: ReportOptions) -> None:
    """Regenerate the paper's results: the entry point of the command."""
    plans, clocks = list(plan_records()), list(clock_records())
    table = tabulate("Published, regenerated, and moved in real time", plans, PLAN_COLUMNS, PLAN_CAPTION, 3)
    publish(
        Report("dpct", [table, _clock_table(clocks)], [], {"plans": plans, "start_clocks": clocks}, figures), options
    )


def paper_problem(case: int, headway: float = HEADWAY) -> MotionProblem:
    """The paper's simulation (section 5.1), the hand ``headway`` m ahead of the part, under the limits of a case."""
    return MotionProblem(
        arm=SCARA_1M,
        q=SCARA_1M.inverse_kinematics([START, HEIGHT])[0],
        target=MovingHand(position=np.array([START - headway, HEIGHT]), velocity=np.array([BELT_SPEED, 0.0])),
        horizon=(LINE + headway) / BELT_SPEED,
        limits=CASES[case].limits,
    )


def plan_records() -> Iterator[Record]:
    """Every case by the readings of the paper and by the optimal planner."""
    for case in CASES:
        least = least_cost(case)
        for reading in (LITERAL, REPAIRED):
            for grid in GRIDS:
                yield _paper_plan(case, reading, grid, least)
        for slip in MASS_SLIPS:
            yield _paper_plan(case, slip, MAIN_GRID, least)
        if case != 1:  # without limits the earliest rendezvous is an impulse when the part comes by
            for free in (True, False):
                yield _optimal_plan(case, least, free_initial_acceleration=free)


def least_cost(case: int) -> float:
    """The least J (eq 18) within a case's limits, by the optimal planner when it need not be early, s.

    The acceleration at t_0 is free, as in the paper. Without limits the least J is that of a hand that starts at speed,
    ``(D / L)^2 coth t_f``, which no motion from rest reaches.
    """
    problem = paper_problem(case)
    if case == 1:
        return (HEADWAY / LINE) ** 2 / math.tanh(problem.horizon)
    motion = dpct.plan(problem, rendezvous_time=problem.horizon, free_initial_acceleration=True)
    return tracking_cost(motion)


def _paper_plan(case: int, reading: Reading, grid: tuple[int, int], least: float) -> Record:
    problem = paper_problem(case)
    path = search_phase_plane(problem, grid=grid, reading=reading)
    motion = execute(problem, path)
    return _record(case, reading.name, motion, motion.cost, least, grid, path)


def _optimal_plan(case: int, least: float, *, free_initial_acceleration: bool) -> Record:
    motion = dpct.plan(paper_problem(case), free_initial_acceleration=free_initial_acceleration)
    name = "optimal, a(t0) free" if free_initial_acceleration else "optimal"
    return _record(case, name, motion, tracking_cost(motion), least)


def _record(
    case: int,
    planner: str,
    motion: Trajectory,
    cost: float,
    least: float,
    grid: tuple[int, int] | None = None,
    path: PhasePath | None = None,
) -> Record:
    """One plan: times in s, torques in N m (signed, the largest of each joint); None where there is no value."""
    published, peak = CASES[case], signed_peak(motion.tau)
    own = (motion.rendezvous_time, peak, cost) if path is None else (path.rendezvous_time, path.peak_torque, path.cost)
    return {
        "case": case,
        "planner": planner,
        "grid": grid,
        "published_rendezvous_time": published.rendezvous_time if grid in (None, MAIN_GRID) else None,
        "published_peak_torque": published.peak_torque if grid == MAIN_GRID else None,
        # by the planner's clock: t_a, peak torque and J (s)
        **dict(zip(("rendezvous_time", "peak_torque", "cost"), own, strict=True)),
        # of the motion in real time
        "real_peak_torque": peak,
        "real_cost": cost,
        "cost_ratio": cost / least,  # over the least J of any motion within the case's limits
        "limit_ratios": dict(motion.limit_ratios),  # worst |value| / limit
        "lag": 0.0 if path is None else path.lag,  # delay of the hand at the end of the line
    }


def tracking_cost(motion: Trajectory, headway: float = HEADWAY) -> float:
    """J (eq 18) of a motion of the paper's arm along the paper's line, by the trapezoidal rule on its samples, s."""
    r = (SCARA_1M.forward_kinematics(motion.q)[:, 0] - START) / LINE
    rate = np.einsum("sj,sj->s", SCARA_1M.jacobian(motion.q)[:, 0], motion.qd) / LINE
    part = (BELT_SPEED * motion.t - headway) / LINE
    return float(np.trapezoid((r - part) ** 2 + (rate - BELT_SPEED / LINE) ** 2, motion.t))


def clock_records() -> Iterator[Record]:
    """When the hand must start in literal plans on the main grid for several headways D (m), s; below 0: before t_0."""
    for headway in HEADWAYS:
        for case in CASES:
            path = search_phase_plane(paper_problem(case, headway), grid=MAIN_GRID)
            yield {
                "headway": headway,
                "case": case,
                "own_start": path.clock[0],  # by the planner's clock
                "real_start": path.real_clock[0],
                "belt_travel": BELT_SPEED * path.clock_error,  # of the part in the time missing by that clock, m
            }


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


def figures() -> Parts:
    """The paper's figures 4 to 8 from literal plans, on the search's own clock, and the torque really needed."""
    return {
        "figure_4": Part(_draw_grids, 5.5, 3.6),
        "figure_5": Part(_draw_phases, 5.5, 3.6),
        "figure_6": Part(_draw_hand, 5.5, 3.6),
        "figure_7": Part(partial(_draw_joints, kind="velocity"), 9.0, 3.4),
        "figure_8": Part(partial(_draw_joints, kind="torque"), 9.0, 3.4),
        "real_torque": Part(_draw_real_torque, 5.5, 3.6),
    }


def _literal(case: int, grid: tuple[int, int] = MAIN_GRID) -> PhasePath:
    return search_phase_plane(paper_problem(case), grid=grid)


def _title(case: int) -> str:
    return f"case {case}: {CASES[case].title}"


def _draw_grids(sheet: Sheet) -> None:
    axes = sheet.subplots()
    for grid in GRIDS:
        path = _literal(3, grid)
        axes.plot(path.r, path.rate, label=f"{grid[0]}x{grid[1]}")
    name_axes(axes, "Figure 4: grids, case 3", "$x_1$", "$x_2$ (1/s)")


def _draw_phases(sheet: Sheet) -> None:
    axes = sheet.subplots()
    for case in CASES:
        path = _literal(case)
        axes.plot(path.r, path.rate, label=_title(case))
    name_axes(axes, "Figure 5: cases", "$x_1$", "$x_2$ (1/s)")


def _draw_hand(sheet: Sheet) -> None:
    axes = sheet.subplots()
    for case in CASES:
        clock, r, _, _ = _from_rest(_literal(case))
        axes.plot(clock, START + LINE * r, label=_title(case))
    axes.plot([0.0, 3.0], [START - HEADWAY, START - HEADWAY + 3.0 * BELT_SPEED], "k:", label="part")
    name_axes(axes, "Figure 6: hand and part", "t (s)", "x (m)")
    axes.set(xlim=(0.0, 3.0))


def _draw_joints(sheet: Sheet, kind: Literal["velocity", "torque"]) -> None:
    number, unit = (7, "rad/s") if kind == "velocity" else (8, "N m")
    panels = sheet.subplots(1, 2)
    for joint, axes in enumerate(panels):
        for case in CASES:
            clock, _, qd, tau = _from_rest(_literal(case))
            if kind == "velocity":
                axes.plot(clock, qd[:, joint], label=_title(case))
            else:
                axes.step(clock, tau[:, joint], where="post", label=_title(case))
        title = f"Figure {number}({'ab'[joint]}): {kind} of joint {joint + 1}"
        name_axes(axes, title, "t (s)", f"{kind} ({unit})")
        axes.set(xlim=(0.0, 3.0))


def _draw_real_torque(sheet: Sheet) -> None:
    axes = sheet.subplots()
    for case in CASES:
        motion = execute(paper_problem(case), _literal(case))
        axes.plot(motion.t, motion.tau[:, 0], label=_title(case))
    for limit in (-_PAPER_LIMITS.torque[0], _PAPER_LIMITS.torque[0]):
        axes.axhline(limit, color="k", linestyle=":")
    name_axes(axes, "Not in the paper: the torque joint 1 really needs", "t (s)", "torque (N m)")
    axes.set(xlim=(0.0, 3.0))


def _from_rest(path: PhasePath) -> tuple[Array, Array, Array, Array]:
    """Clock, r, joint velocities and torques at the stages; a rest before the start is put in front."""
    tau = np.concatenate([path.tau, path.tau[-1:]])
    curves = (path.clock, path.r, path.qd, tau)
    if path.clock[0] <= 0.0:
        return curves
    clock, r, qd, tau = (np.concatenate([np.zeros_like(curve[:1]), curve]) for curve in curves)
    return clock, r, qd, tau
