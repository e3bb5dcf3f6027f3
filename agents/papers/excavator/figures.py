"""The excavator paper's figures 4 to 8, and beside them errors and estimated masses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from agents.figures.sheet import name_axes
from agents.papers.excavator.runs import DEFAULT, FIXED, NOMINAL, PAPER, NamedController, Trial
from agents.papers.report import Part, Parts, Sheet
from planners.excavator.simulation import Run

FIGURES = {2.0: "Figure 4: ", 4.0: "Figure 5: ", 6.0: "Figure 6: ", 8.0: "Figure 7: ", 10.0: "Figure 8: "}
"""Of the paper, by payload, %."""

_SHOWN = ((FIXED, "C3"), (PAPER, "C1"), (DEFAULT, "C0"))
_SMALLEST = 1e-5  # deg; smaller errors are drawn here


def figures(trial: Trial, percents: Sequence[float]) -> Parts:
    """Angles and velocities of joints 1 and 2 in the first cycle, and errors and estimated masses in all cycles.

    There is a figure for each payload, ``percents`` of the rated load, that has one in the paper; for each if none has.
    """
    percents = [percent for percent in percents if percent in FIGURES] or percents
    runs = {entry: trial.follow(entry, [(percent, NOMINAL) for percent in percents]) for entry, _ in _SHOWN}
    names = [_number(percent).lower().replace(" ", "_") or f"payload_{percent:g}" for percent in percents]
    return {
        name: Part(partial(_draw, trial=trial, runs=runs, index=index, percent=percent), 13.0, 5.2)
        for index, (name, percent) in enumerate(zip(names, percents, strict=True))
    }


def _number(percent: float) -> str:
    return FIGURES.get(percent, "").removesuffix(": ")


def _draw(sheet: Sheet, trial: Trial, runs: Mapping[NamedController, Run], index: int, percent: float) -> None:
    upper, lower = sheet.subplots(2, 3)
    angles, speeds, (error, mass) = (upper[0], upper[1]), (lower[0], lower[1]), (upper[2], lower[2])
    for entry, color in _SHOWN:
        run = runs[entry]
        first = slice(0, len(run.t) // trial.cycles)
        look: dict[str, Any] = {"color": color, "label": entry.title, "linewidth": 1.2}
        for joint in range(2):
            angles[joint].plot(run.t[first], np.degrees(run.q[first, index, joint]), **look)
            speeds[joint].plot(run.t[first], np.degrees(run.qd[first, index, joint]), **look)
        apart = np.sqrt(np.square(np.degrees(run.q[:, index] - run.q_d)).mean(axis=-1))
        error.semilogy(run.t, np.maximum(apart, _SMALLEST), **look)
        if entry is not FIXED:
            mass.plot(run.t, run.mass[:, index], **look)
    wanted: dict[str, Any] = {"color": "k", "linestyle": ":", "linewidth": 1.2, "label": "wanted"}
    number = FIGURES.get(percent, "")
    for joint in range(2):
        angles[joint].plot(run.t[first], np.degrees(run.q_d[first, joint]), **wanted)
        speeds[joint].plot(run.t[first], np.degrees(run.qd_d[first, joint]), **wanted)
        _name(angles[joint], f"{number}angle of joint {joint + 1}, {percent:g} %", "angle (deg)")
        _name(speeds[joint], f"{number}velocity of joint {joint + 1}, {percent:g} %", "velocity (deg/s)")
    mass.axhline(trial.machine.payload.mass(percent), color="k", linestyle=":", linewidth=1.2, label="true")
    _name(error, f"RMS error of the five joints, {percent:g} %", "error (deg)")
    _name(mass, f"estimated mass, {percent:g} %", "mass (kg)")


def _name(axes: Any, title: str, y: str) -> None:
    name_axes(axes, title, "t (s)", y)
