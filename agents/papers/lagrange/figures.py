"""The minimal-torque paper's figures 2 to 9 from its printed motions, and Runge's phenomenon."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from scipy.integrate import cumulative_trapezoid

from agents.figures.sheet import Axes, name_axes
from agents.papers.lagrange.interpolation import COUNTS, FAMILIES, interpolated, node_polynomial, runge
from agents.papers.lagrange.runs import ALGORITHMS, ANGLE_READINGS, MODELS, paper_problem, reading_torques
from agents.papers.report import Part, Parts, Sheet
from planners import Trajectory
from planners.lagrange.paper import PUBLISHED_ANGLES, PUBLISHED_TIMES, Method, published_motion

_COLORS = dict(zip(ALGORITHMS, ("C0", "C1"), strict=True))
_STYLES = dict(zip(MODELS, ("-", "--"), strict=True))
_MANY = 13  # nodes with which Runge's phenomenon is drawn


def figures() -> Parts:
    """Figures 2 to 9; PI under other readings of the angles; and what equidistant nodes do."""
    trajectories = {f"figure_{2 + place}": method for place, method in enumerate(ALGORITHMS)}
    return {
        **{name: Part(partial(_draw_trajectory, method=method), 6.0, 3.8) for name, method in trajectories.items()},
        **{f"figure_{4 + joint}": Part(partial(_draw_joint, joint=joint), 10.0, 3.2) for joint in range(3)},
        "figure_7": Part(_draw_torques, 10.0, 3.6),
        "figure_8": Part(_draw_sum, 6.0, 3.8),
        "figure_9": Part(_draw_index, 9.0, 3.8),
        "readings": Part(_draw_readings, 9.0, 3.8),
        "runge": Part(_draw_runge, 10.0, 3.6),
    }


def _printed_motions() -> Iterator[tuple[str, str, Trajectory, dict[str, Any]]]:
    """The model, the algorithm, its printed motion in the model, and how to draw it."""
    for model, style in _STYLES.items():
        for method, algorithm in ALGORITHMS.items():
            found = published_motion(paper_problem(model), method)
            look = {"color": _COLORS[method], "linestyle": style, "label": f"{algorithm}, {model}"}
            yield model, algorithm, found, look


def _draw_trajectory(sheet: Sheet, method: Method) -> None:
    found = published_motion(paper_problem("gravity off"), method)
    axes = sheet.subplots()
    for joint in range(3):
        axes.plot(found.t, found.q[:, joint], color=f"C{joint}", label=f"joint {joint + 1}")
        if method == "lagrange":
            axes.plot(PUBLISHED_TIMES, np.radians(PUBLISHED_ANGLES[joint]), "o", color=f"C{joint}", markersize=5)
    place = list(ALGORITHMS).index(method)
    name_axes(axes, f"Figure {2 + place}: Algorithm {ALGORITHMS[method]}", "t (s)", "angle (rad)")


def _draw_joint(sheet: Sheet, joint: int) -> None:
    panels = sheet.subplots(1, 3)
    units = {"angle": "rad", "velocity": "rad/s", "acceleration": "rad/s$^2$"}
    for model, algorithm, found, look in _printed_motions():
        if model == "gravity off":  # the motion is the same in both
            for axes, values in zip(panels, (found.q, found.qd, found.qdd), strict=True):
                axes.plot(found.t, values[:, joint], **{**look, "label": algorithm})
    for axes, (name, unit) in zip(panels, units.items(), strict=True):
        name_axes(axes, f"Figure {4 + joint}: {name} of joint {joint + 1}", "t (s)", f"{name} ({unit})")


def _draw_torques(sheet: Sheet) -> None:
    panels = sheet.subplots(1, 3)
    for _, _, found, look in _printed_motions():
        for joint, axes in enumerate(panels):
            axes.plot(found.t, found.tau[:, joint], **look)
    for joint, axes in enumerate(panels):
        _leave_room(axes)
        name_axes(axes, f"Figure 7: torque of joint {joint + 1}", "t (s)", "torque (N m)")


def _draw_sum(sheet: Sheet) -> None:
    axes = sheet.subplots()
    for _, _, found, look in _printed_motions():
        axes.plot(found.t, found.tau.sum(axis=1), **look)
    name_axes(axes, "Figure 8: sum of the torques", "t (s)", "torque (N m)")


def _draw_index(sheet: Sheet) -> None:
    instant, so_far = sheet.subplots(1, 2)
    for _, _, found, look in _printed_motions():
        pi = np.abs(found.tau).sum(axis=1)
        instant.plot(100.0 * found.t, pi, **look)
        so_far.plot(found.t, cumulative_trapezoid(pi, found.t, initial=0), **look)
    _leave_room(instant)
    name_axes(instant, "Figure 9: PI at each step (eq 6)", "step of 100", "PI (N m)")
    name_axes(so_far, "Not in the paper: PI up to t", "t (s)", "PI1 (N m s)")


def _draw_readings(sheet: Sheet) -> None:
    for axes, reading in zip(sheet.subplots(1, 2), ANGLE_READINGS[1:], strict=True):
        for model, style in _STYLES.items():
            for method, color in _COLORS.items():
                t, tau = reading_torques(model, method, reading)
                look: dict[str, Any] = {"color": color, "linestyle": style, "label": f"{ALGORITHMS[method]}, {model}"}
                axes.plot(100.0 * t, np.abs(tau).sum(axis=1), **look)
        _leave_room(axes)
        name_axes(axes, f"PI: {reading.title}", "step of 100", "PI (N m)")


def _leave_room(axes: Axes) -> None:
    """Leave room for a legend above the curves."""
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.4 * (high - low))


def _draw_runge(sheet: Sheet) -> None:
    curves, errors, products = sheet.subplots(1, 3)
    t = np.linspace(0.0, 1.0, 2001)
    curves.plot(t, runge(t), "k:", label="Runge's function")
    for place, (name, family) in enumerate(FAMILIES.items()):
        color = f"C{place}"
        worst = [np.abs(interpolated(runge, family(count), t) - runge(t)).max() for count in COUNTS]
        errors.semilogy(COUNTS, worst, color=color, marker="o", markersize=4, label=name)
        if name in ("equidistant", "eq 7"):
            curves.plot(t, interpolated(runge, family(_MANY), t), color=color, label=name)
            curves.plot(family(_MANY), runge(family(_MANY)), color=color, marker="o", markersize=4, linestyle="")
            products.plot(t, 1e3 * node_polynomial(family(5), t), color=color, label=name)
    products.plot(t, 1e3 * node_polynomial(np.array(PUBLISHED_TIMES), t), color="C4", label="Table 2")
    curves.set(ylim=(-1.0, 1.5))
    name_axes(curves, f"{_MANY} nodes", "t (s)", "angle (rad)")
    name_axes(errors, "Largest error", "N", "error (rad)")
    errors.set(xticks=COUNTS)
    name_axes(products, r"$\omega(t)$ of 5 nodes (eq 11)", "t (s)", r"$10^{-3}$ s$^5$")
