"""The conveyor-tracking paper's figures 4 to 8 on its own axes, with t_a, limits and what it prints marked."""

from __future__ import annotations

from functools import partial
from typing import Any, Literal

import numpy as np

from agents.figures.sheet import Axes, name_axes
from agents.papers.dpct.runs import (
    BELT_ACCELERATIONS,
    BELT_SPEED,
    CASES,
    GRIDS,
    HEADWAY,
    LINE,
    MAIN_GRID,
    SLIP,
    START,
    belt_problem,
    literal_path,
    paper_problem,
)
from agents.papers.report import Part, Parts, Sheet
from planners import Infeasible, dpct
from planners.dpct.paper import LITERAL, PhasePath, Reading, execute
from planners.typing import Array

READINGS: tuple[tuple[Reading, str], ...] = ((LITERAL, "-"), (SLIP, "--"))
_LIMITS = CASES[3].limits
_END = 3.0  # s: of the paper's time axes
_THIN: dict[str, Any] = {"color": "k", "linestyle": ":", "linewidth": 1.0}


def figures() -> Parts:
    """Figures 4 to 8 from plans of the paper's search, on its own clock; and what the paper does not show."""
    return {
        "figure_4": Part(_draw_grids, 6.0, 4.0),
        "figure_5": Part(_draw_phases, 6.0, 4.0),
        "figure_6": Part(_draw_hand, 9.0, 4.0),
        "figure_7": Part(partial(_draw_joints, kind="velocity"), 9.0, 4.0),
        "figure_8": Part(partial(_draw_joints, kind="torque"), 9.0, 4.0),
        "real_torque": Part(_draw_real_torque, 6.0, 4.0),
        "belts": Part(_draw_belts, 9.0, 4.0),
    }


def _color(case: int) -> str:
    return f"C{case - 1}"


def _title(case: int) -> str:
    return f"case {case}: {CASES[case].title}"


def _look(case: int, reading: Reading, style: str) -> dict[str, Any]:
    """How to draw a case; only the paper as written is in the legend, `_legend` explains the dashes."""
    label = _title(case) if reading is LITERAL else "_"
    return {"color": _color(case), "linestyle": style, "label": label, "linewidth": 1.4}


def _legend(axes: Axes) -> None:
    axes.plot([], [], color="0.4", linestyle="--", label=SLIP.name)


def _draw_grids(sheet: Sheet) -> None:
    axes = sheet.subplots()
    for grid in GRIDS:
        path = literal_path(3, grid)
        axes.plot(path.r, path.rate, label=f"{grid[0]}x{grid[1]}")
    _draw_part_speed(axes)
    name_axes(axes, "Figure 4: grids, case 3", "$x_1$", "$x_2$ (1/s)")


def _draw_phases(sheet: Sheet) -> None:
    axes = sheet.subplots()
    for case in CASES:
        for reading, style in READINGS:
            path = literal_path(case, MAIN_GRID, reading)
            axes.plot(path.r, path.rate, **_look(case, reading, style))
            met = np.interp(path.rendezvous_time, path.clock, path.r)
            axes.plot(met, path.rate[-1], marker="o" if reading is LITERAL else "D", color=_color(case), markersize=5)
    _draw_part_speed(axes)
    _legend(axes)
    name_axes(axes, "Figure 5: cases; marks at $t_a$", "$x_1$", "$x_2$ (1/s)")


def _draw_part_speed(axes: Axes) -> None:
    axes.axhline(BELT_SPEED / LINE, **_THIN, label="part")
    axes.set(xlim=(-0.02, 1.0), ylim=(0.0, None))


def _draw_hand(sheet: Sheet) -> None:
    whole, near = sheet.subplots(1, 2)
    for axes in (whole, near):
        for case, published in CASES.items():
            for reading, style in READINGS:
                path = literal_path(case, MAIN_GRID, reading)
                clock, r, _, _ = _from_rest(path)
                axes.plot(clock, START + LINE * r, **_look(case, reading, style))
                met = path.rendezvous_time
                marker = "o" if reading is LITERAL else "D"
                axes.plot(met, _part(met), marker=marker, color=_color(case), markersize=5)
            axes.axvline(published.rendezvous_time, color=_color(case), linestyle=":", linewidth=1.0)
        axes.plot([0.0, _END], [_part(0.0), _part(_END)], "k:", label="part")
        axes.plot([], [], color="0.4", linestyle=":", label="published $t_a$")
        _legend(axes)
    name_axes(whole, "Figure 6: hand and part", "t (s)", "x (m)")
    whole.set(xlim=(0.0, _END))
    name_axes(near, "Figure 6, enlarged; marks at $t_a$", "t (s)", "x (m)")
    near.set(xlim=(0.0, 1.3), ylim=(-0.83, _part(1.3)))


def _part(t: float) -> float:
    """x of the part at a time, m."""
    return START - HEADWAY + BELT_SPEED * t


def _draw_joints(sheet: Sheet, kind: Literal["velocity", "torque"]) -> None:
    number, unit = (7, "rad/s") if kind == "velocity" else (8, "N m")
    for joint, axes in enumerate(sheet.subplots(1, 2)):
        for case, published in CASES.items():
            for reading, style in READINGS:
                path = literal_path(case, MAIN_GRID, reading)
                clock, _, qd, tau = _from_rest(path)
                curve = (qd if kind == "velocity" else tau)[:, joint]
                drawstyle = "default" if kind == "velocity" else "steps-post"
                axes.plot(clock, curve, **_look(case, reading, style), drawstyle=drawstyle)
                if reading is LITERAL:
                    met = path.rendezvous_time
                    axes.plot(met, np.interp(met, clock, curve), marker="o", color=_color(case), markersize=5)
            if kind == "torque" and published.peak_torque:
                mark: dict[str, Any] = {"color": _color(case), "marker": "<", "markersize": 7, "clip_on": False}
                axes.plot(_END, published.peak_torque[joint], **mark)
        limit = getattr(_LIMITS, kind)[joint]
        for value in (-limit, limit):
            axes.axhline(value, **_THIN)
        axes.plot([], [], **_THIN, label="limit")
        if kind == "torque":
            axes.plot([], [], color="0.4", marker="<", linestyle="", label="published peak")
        _legend(axes)
        name_axes(axes, f"Figure {number}({'ab'[joint]}): {kind} of joint {joint + 1}", "t (s)", f"{kind} ({unit})")
        axes.set(xlim=(0.0, _END))


def _draw_real_torque(sheet: Sheet) -> None:
    axes = sheet.subplots()
    for case in CASES:
        motion = execute(paper_problem(case), literal_path(case))
        axes.plot(motion.t, motion.tau[:, 0], label=_title(case))
    for limit in (-_LIMITS.torque[0], _LIMITS.torque[0]):
        axes.axhline(limit, **_THIN)
    name_axes(axes, "Not in the paper: the torque joint 1 really needs", "t (s)", "torque (N m)")
    axes.set(xlim=(0.0, _END))


def _draw_belts(sheet: Sheet) -> None:
    speed, torque = sheet.subplots(1, 2)
    for index, acceleration in enumerate(BELT_ACCELERATIONS):
        problem = belt_problem(acceleration)
        try:
            motion = dpct.plan(problem)
        except Infeasible:
            continue
        color, label = f"C{index}", f"{acceleration:+.2f} m/s$^2$"
        hand = np.einsum("sj,sj->s", problem.arm.jacobian(motion.q)[:, 0], motion.qd)
        speed.plot(motion.t, hand, color=color, label=label)
        speed.plot(motion.t, BELT_SPEED + acceleration * motion.t, color=color, linestyle=":", linewidth=1.0)
        met = motion.rendezvous_time
        speed.plot(met, BELT_SPEED + acceleration * met, marker="o", color=color, markersize=5)
        torque.plot(motion.t, motion.tau[:, 0], color=color, label=label)
    speed.plot([], [], color="0.4", linestyle=":", label="part")
    for value in (-_LIMITS.torque[0], _LIMITS.torque[0]):
        torque.axhline(value, **_THIN)
    name_axes(speed, "Accelerating belts: speed of the hand", "t (s)", "speed (m/s)")
    name_axes(torque, "Accelerating belts: torque of joint 1", "t (s)", "torque (N m)")
    for axes in (speed, torque):
        axes.set(xlim=(0.0, _END))


def _from_rest(path: PhasePath) -> tuple[Array, Array, Array, Array]:
    """Clock, r, joint velocities and torques at the stages; a rest before the start is put in front."""
    tau = np.concatenate([path.tau, path.tau[-1:]])
    curves = (path.clock, path.r, path.qd, tau)
    if path.clock[0] <= 0.0:
        return curves
    clock, r, qd, tau = (np.concatenate([np.zeros_like(curve[:1]), curve]) for curve in curves)
    return clock, r, qd, tau
