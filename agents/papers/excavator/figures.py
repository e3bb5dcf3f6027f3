"""The excavator paper's figures 4 to 8, and beside them errors and estimated masses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from agents.figures.sheet import Figure, name_axes, new_sheet
from agents.papers.excavator.runs import DEFAULT, FIXED, NOMINAL, PAPER, Trial

FIGURES = {2.0: "Figure 4: ", 4.0: "Figure 5: ", 6.0: "Figure 6: ", 8.0: "Figure 7: ", 10.0: "Figure 8: "}
"""Of the paper, by payload, %."""

_SHOWN = ((FIXED, "C3"), (PAPER, "C1"), (DEFAULT, "C0"))
_SMALLEST = 1e-5  # deg; smaller errors are drawn here


def figure(trial: Trial, percents: Sequence[float]) -> Figure:
    """Angles and velocities of joints 1 and 2 in the first cycle, errors and estimated masses in all cycles.

    There is a row for each payload, ``percents`` of the rated load.
    """
    sheet = new_sheet(24.0, 3.0 * len(percents))
    panels = sheet.subplots(len(percents), 6, squeeze=False)
    for entry, color in _SHOWN:
        run = trial.follow(entry, [(percent, NOMINAL) for percent in percents])
        first = slice(0, len(run.t) // trial.cycles)
        look: dict[str, Any] = {"color": color, "label": entry.title, "linewidth": 1.2}
        for env_index, row in enumerate(panels):
            for joint in range(2):
                row[2 * joint].plot(run.t[first], np.degrees(run.q[first, env_index, joint]), **look)
                row[2 * joint + 1].plot(run.t[first], np.degrees(run.qd[first, env_index, joint]), **look)
            error = np.sqrt(np.square(np.degrees(run.q[:, env_index] - run.q_d)).mean(axis=-1))
            row[4].semilogy(run.t, np.maximum(error, _SMALLEST), **look)
            if entry is not FIXED:
                row[5].plot(run.t, run.mass[:, env_index], **look)
    wanted: dict[str, Any] = {"color": "k", "linestyle": ":", "linewidth": 1.2, "label": "wanted"}
    for percent, row in zip(percents, panels, strict=True):
        number = FIGURES.get(percent, "")
        for joint in range(2):
            row[2 * joint].plot(run.t[first], np.degrees(run.q_d[first, joint]), **wanted)
            row[2 * joint + 1].plot(run.t[first], np.degrees(run.qd_d[first, joint]), **wanted)
            _name(row[2 * joint], f"{number}angle of joint {joint + 1}, {percent:g} %", "angle (deg)")
            _name(row[2 * joint + 1], f"{number}velocity of joint {joint + 1}, {percent:g} %", "velocity (deg/s)")
        row[5].axhline(trial.machine.payload.mass(percent), color="k", linestyle=":", linewidth=1.2, label="true")
        _name(row[4], f"RMS error of the five joints, {percent:g} %", "error (deg)")
        _name(row[5], f"estimated mass, {percent:g} %", "mass (kg)")
    return sheet


def _name(axes: Any, title: str, y: str) -> None:
    name_axes(axes, title, "t (s)", y)
