"""The picture of a trajectory: angles, velocities, accelerations and torques of every joint, with their limits."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from planners.checks import refuse_unknown
from planners.files import write_bytes
from planners.robot.limits import LimitKind

if TYPE_CHECKING:
    from planners.trajectory.trajectory import Trajectory

PANELS: tuple[tuple[str, LimitKind, str], ...] = (
    ("q", "angle", "angle (rad)"),
    ("qd", "velocity", "velocity (rad/s)"),
    ("qdd", "acceleration", "acceleration (rad/s$^2$)"),
    ("tau", "torque", "torque (N m)"),
)
"""Of each panel: the samples, their kind of limit, and the label of its axis."""

SIZE = (7.0, 9.0)
"""Of the picture, inches."""


def plot(trajectory: Trajectory) -> Any:
    """A matplotlib figure of a trajectory; dashed lines are the limits of the joint in the same colour.

    Raises:
        ModuleNotFoundError: if matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError('plots need matplotlib: pip install "planarm[viz]"') from error
    figure = Figure(figsize=SIZE, layout="constrained")
    limits = trajectory.problem.joint_limits
    panels = figure.subplots(len(PANELS), 1, sharex=True)
    for axes, (name, kind, label) in zip(panels, PANELS, strict=True):
        values = getattr(trajectory, name)
        middle = limits.angle_middle if kind == "angle" else np.zeros(values.shape[1])
        for joint, (curve, center, bound) in enumerate(zip(values.T, middle, limits.array(kind), strict=True)):
            (line,) = axes.plot(trajectory.t, curve, label=f"joint {joint + 1}")
            for edge in (center - bound, center + bound) if np.isfinite(bound) else ():
                axes.axhline(edge, color=line.get_color(), linestyle="--", linewidth=0.8, alpha=0.6)
        axes.set_ylabel(label)
        axes.grid(alpha=0.3)
        if np.isfinite(trajectory.rendezvous_time):
            axes.axvline(trajectory.rendezvous_time, color="0.5", linestyle=":", linewidth=0.8)
    panels[0].legend(fontsize="small", ncols=values.shape[1])
    panels[0].set_title(repr(trajectory).strip("<>"), fontsize="small", wrap=True)
    panels[-1].set_xlabel("time (s)")
    return figure


def write_plot(figure: Any, path: Path) -> None:
    """Write a matplotlib figure in the format of the suffix of ``path``.

    Raises:
        ValueError: if matplotlib writes no file with this suffix.
    """
    suffix = path.suffix.lower()
    formats = [f".{name}" for name in figure.canvas.get_supported_filetypes()]
    refuse_unknown([suffix], formats, f"file format of {path}:")
    content = io.BytesIO()
    figure.savefig(content, dpi=150, format=suffix[1:])
    write_bytes(path, content.getvalue())
