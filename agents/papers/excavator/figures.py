"""Drawings for the excavator paper: its figures 4 to 8, and beside them what they do not show."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from agents.papers.excavator.runs import DEFAULT, FIXED, NOMINAL, PAPER, Trial
from agents.papers.report import image_bytes, name_axes, new_sheet

FIGURES = {2.0: "Figure 4: ", 4.0: "Figure 5: ", 6.0: "Figure 6: ", 8.0: "Figure 7: ", 10.0: "Figure 8: "}
"""Of the paper, by payload, %."""

_SHOWN = ((FIXED, "C3"), (PAPER, "C1"), (DEFAULT, "C0"))
_SMALLEST = 1e-5  # deg; what is less is drawn there


def draw(trial: Trial, percents: Sequence[float], file_format: str, dpi: int) -> bytes:
    """Angles and velocities of joints 1 and 2 in the first cycle, errors and estimated masses in all, as an image file.

    Args:
        trial: machine, cycles and rate.
        percents: the payloads, a row each, % of the rated load.
        file_format, dpi: of the image.

    Raises:
        ModuleNotFoundError: if matplotlib is missing; the message says how to install it.
        ValueError: if matplotlib does not know the file format.
    """
    sheet = new_sheet(24.0, 3.0 * len(percents))
    panels = sheet.subplots(len(percents), 6, squeeze=False)
    for entry, colour in _SHOWN:
        run = trial.follow(entry, percents, [NOMINAL] * len(percents))
        first = slice(0, len(run.t) // trial.cycles)
        look: dict[str, Any] = {"color": colour, "label": entry.title, "linewidth": 1.2}
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
    return image_bytes(sheet, file_format, dpi)


def _name(axes: Any, title: str, y: str) -> None:
    name_axes(axes, title, "t (s)", y, fontsize="x-small")
