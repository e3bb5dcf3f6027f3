"""The excavator paper's figures 4 to 8, and beside them errors, estimated masses and forces from outside."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from agents.figures.sheet import Axes, name_axes
from agents.papers.excavator.runs import (
    DEFAULT,
    FIXED,
    INTEGRAL,
    NOMINAL,
    PAPER,
    PULL,
    PUSH,
    NamedController,
    Trial,
)
from agents.papers.report import Part, Parts, Sheet
from planners.excavator import forward_kinematics
from planners.excavator.simulation import Run
from planners.typing import Array

FIGURES = {2.0: "Figure 4: ", 4.0: "Figure 5: ", 6.0: "Figure 6: ", 8.0: "Figure 7: ", 10.0: "Figure 8: "}
"""Of the paper, by payload, %."""

_SHOWN = ((FIXED, "C3"), (PAPER, "C1"), (DEFAULT, "C0"))
_FORCED = ((INTEGRAL, "C2"), (PAPER, "C1"), (DEFAULT, "C0"))
_SMALLEST = 1e-5  # deg; smaller errors are drawn here


def figures(trial: Trial, percents: Sequence[float]) -> Parts:
    """Angles and velocities of joints 1 and 2 in the first cycle, and in all cycles errors, estimates and disturbances.

    There is a figure for each payload, ``percents`` of the rated load, that has one in the paper; for each if none has.
    """
    percents = [percent for percent in percents if percent in FIGURES] or percents
    runs = {entry: trial.follow(entry, [(percent, NOMINAL) for percent in percents]) for entry, _ in _SHOWN}
    names = [_number(percent).lower().replace(" ", "_") or f"payload_{percent:g}" for percent in percents]
    return {
        **{
            name: Part(partial(_draw, trial=trial, runs=runs, index=index, percent=percent), 9.0, 5.6)
            for index, (name, percent) in enumerate(zip(names, percents, strict=True))
        },
        "errors": Part(partial(_draw_errors, trial=trial, runs=runs, percents=percents), 9.0, 4.0),
        "forces": Part(partial(_draw_forces, trial=trial, percent=percents[0]), 9.0, 4.0),
    }


def _number(percent: float) -> str:
    return FIGURES.get(percent, "").removesuffix(": ")


def _draw(sheet: Sheet, trial: Trial, runs: Mapping[NamedController, Run], index: int, percent: float) -> None:
    angles, speeds = sheet.subplots(2, 2)
    for entry, color in _SHOWN:
        run = runs[entry]
        first = slice(0, len(run.t) // trial.cycles)
        look: dict[str, Any] = {"color": color, "label": entry.title, "linewidth": 1.2}
        for joint in range(2):
            angles[joint].plot(run.t[first], np.degrees(run.q[first, index, joint]), **look)
            speeds[joint].plot(run.t[first], np.degrees(run.qd[first, index, joint]), **look)
    wanted: dict[str, Any] = {"color": "k", "linestyle": ":", "linewidth": 1.2, "label": "wanted"}
    number = FIGURES.get(percent, "")
    for joint in range(2):
        angles[joint].plot(run.t[first], np.degrees(run.q_d[first, joint]), **wanted)
        speeds[joint].plot(run.t[first], np.degrees(run.qd_d[first, joint]), **wanted)
        _name(angles[joint], f"{number}angle of joint {joint + 1}, {percent:g} %", "angle (deg)")
        _name(speeds[joint], f"{number}velocity of joint {joint + 1}, {percent:g} %", "velocity (deg/s)")


def _draw_errors(sheet: Sheet, trial: Trial, runs: Mapping[NamedController, Run], percents: Sequence[float]) -> None:
    error, mass = sheet.subplots(1, 2)
    ends = dict(zip((0, len(percents) - 1), ("--", "-"), strict=True)) if len(percents) > 1 else {0: "-"}
    for index, style in ends.items():
        for entry, color in _SHOWN:
            run, label = runs[entry], f"{entry.title}, {percents[index]:g} %"
            look: dict[str, Any] = {"color": color, "linestyle": style, "label": label, "linewidth": 1.2}
            apart = np.sqrt(np.square(np.degrees(run.q[:, index] - run.q_d)).mean(axis=-1))
            error.semilogy(run.t, np.maximum(apart, _SMALLEST), **look)
            if entry is not FIXED:
                mass.plot(run.t, run.mass[:, index], **look)
        mass.axhline(trial.machine.payload.mass(percents[index]), color="k", linestyle=":", linewidth=1.0)
    _name(error, "RMS error of the five joints", "error (deg)")
    _name(mass, "Estimated mass; dotted: true", "mass (kg)")


def _draw_forces(sheet: Sheet, trial: Trial, percent: float) -> None:
    panels = sheet.subplots(1, 2)
    for entry, color in _FORCED:
        run = trial.follow(entry, [(percent, PUSH), (percent, PULL)])
        for row, axes in enumerate(panels):
            axes.semilogy(run.t, np.maximum(_tip_error(trial, run, row), 1e-2), color=color, label=entry.title)
    for axes, case in zip(panels, (PUSH, PULL), strict=True):
        _name(axes, f"{case.title.capitalize()} on the tip, {percent:g} %", "error of the tip (mm)")


def _tip_error(trial: Trial, run: Run, row: int) -> Array:
    """Distance of the tip from its reference over time, mm."""
    tip, wanted = (forward_kinematics(q, trial.machine)[0] for q in (run.q[:, row], run.q_d))
    distance: Array = 1e3 * np.linalg.norm(tip - wanted, axis=-1)
    return distance


def _name(axes: Axes, title: str, y: str) -> None:
    name_axes(axes, title, "t (s)", y)
