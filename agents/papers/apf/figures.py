"""The potential-field paper's figures 2 and 3, and beside them clearances and the distance table."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from agents.figures.sheet import Axes, name_axes
from agents.papers.apf.runs import DISTANCES, NORMS, WALLS, paper_motion, paper_problem
from agents.papers.report import Part, Parts, Sheet
from planners import Arm, MotionProblem
from planners.apf.distance_table import DistanceTable
from planners.apf.hand_field import LOOK_AHEAD, Distance, make_field
from planners.apf.khatib import Gains, potential
from planners.apf.paper import FieldMotion, hand_goal
from planners.typing import Array

INSTANTS = (0.0, 0.4, 0.8, 1.2, 1.6, 2.5)  # s: figure 3
SURFACE_TIME = 1.0  # s: figure 2
_GRID = 121  # points a side of a surface
_LINK = 13.0  # points: the links as thick as they are, at the scale of figure 3
_HIGHEST = 1.0  # m^2/s; higher values of the wall are cut off


def figures() -> Parts:
    """The paper's figures 2 and 3, clearances over time, the distance table and the p-norm."""
    return {
        "figure_2": Part(_draw_figure_2, 10.0, 3.4),
        "figure_3": Part(_draw_figure_3, 10.0, 3.9),
        "clearances": Part(_draw_curves, 10.0, 3.4),
        "norms": Part(_draw_norms, 9.0, 4.0),
    }


def _draw_figure_2(sheet: Sheet) -> None:
    draw_potentials(sheet, paper_problem(), make_field().gains, time=SURFACE_TIME)


def _draw_figure_3(sheet: Sheet) -> None:
    shown: tuple[tuple[str, Distance], ...] = (("crossing", "static"), ("crossing", "table"), ("elbow", "table"))
    for axes, (scene, distance) in zip(sheet.subplots(1, 3), shown, strict=True):
        title = f"Figure 3: {scene}, {distance} distance"
        draw_motion(axes, paper_problem(scene), paper_motion(scene, distance), title, INSTANTS)


def _draw_curves(sheet: Sheet) -> None:
    crossing, other, table = sheet.subplots(1, 3)
    for axes, scene in ((crossing, "crossing"), (other, "crossing, other elbow")):
        motions = {
            f"{distance}, {WALLS[square]}": paper_motion(scene, distance, square)
            for distance, square in itertools.product(DISTANCES, WALLS)
        }
        draw_clearances(axes, motions, scene.capitalize(), INSTANTS[-1])
    draw_table(table, DistanceTable.looking_ahead(LOOK_AHEAD), (0.25, 0.5, 1.0, 2.0))


def _draw_norms(sheet: Sheet) -> None:
    walls, clearances = sheet.subplots(1, 2)
    problem = paper_problem()
    (disc,), gains = problem.obstacles, make_field().gains
    center, radius = disc.position + SURFACE_TIME * disc.velocity, disc.radius + problem.arm.link_radius
    x, y = np.meshgrid(np.linspace(-0.35, 1.05, _GRID), np.linspace(-0.1, 1.0, _GRID))
    for place, norm in enumerate(NORMS):
        color, label = f"C{place}", f"p = {norm:g}"
        motion = paper_motion("crossing", "static", norm=norm)
        distance = np.linalg.norm([x - center[0], y - center[1]], norm, axis=0) - radius
        walls.contour(x, y, distance, levels=[0.0, gains.influence], colors=color, linewidths=1.0)
        until = int(np.searchsorted(motion.t, INSTANTS[-1])) + 1
        walls.plot(*problem.arm.forward_kinematics(motion.q[:until]).T, color=color, linestyle="--", label=label)
        clearances.plot(motion.t[:until], motion.hand_clearance[:until], color=color, label=label)
    _draw_disc(walls, center, radius, (0.5, 0.5, 0.5))
    name_axes(walls, r"$\rho$ = 0 and $\rho_0$ by eq 19; paths of the hand", "x (m)", "y (m)")
    walls.set(aspect="equal")
    name_axes(clearances, "Crossing, static distance", "t (s)", "clearance of the hand (m)")
    clearances.set(xlim=(0.3, 2.0), ylim=(0.0, 0.6))


def draw_potentials(sheet: Sheet, problem: MotionProblem, gains: Gains, time: float) -> None:
    """Figure 2: attractive, repulsive and total potential over the workspace, with the discs of a time (s)."""
    reach = problem.arm.reach
    x, y = np.meshgrid(np.linspace(-reach, reach, _GRID), np.linspace(-reach, reach, _GRID))
    positions = np.array([disc.position + time * disc.velocity for disc in problem.obstacles])
    radii = np.array([disc.radius + problem.arm.link_radius for disc in problem.obstacles])
    hands = np.stack([x.ravel(), y.ravel()], axis=-1)
    bowl, wall = (part.reshape(x.shape) for part in potential(gains, hands, hand_goal(problem), positions, radii))
    parts = {"attractive (eq 6)": bowl, "repulsive (Khatib's eq 8)": wall, "total (eq 3)": bowl + wall}
    for column, (name, values) in enumerate(parts.items(), start=1):
        axes: Any = sheet.add_subplot(1, 3, column, projection="3d")
        highest = float(bowl.max()) if column != 2 else _HIGHEST
        heights = np.minimum(values, highest)
        axes.plot_surface(
            x, y, heights, cmap="viridis", rstride=1, cstride=1, linewidth=0.0, antialiased=False, rasterized=True
        )
        axes.view_init(elev=34.0, azim=-125.0)
        axes.set(title=f"Figure 2: {name}, m$^2$/s", xlabel="x (m)", ylabel="y (m)", zlim=(0.0, highest))
        axes.set(xticks=(-1, 0, 1), yticks=(-1, 0, 1))
        axes.set_box_aspect((1.0, 1.0, 0.6), zoom=1.1)


def draw_motion(axes: Axes, problem: MotionProblem, motion: FieldMotion, title: str, instants: Sequence[float]) -> None:
    """Figure 3: the arm and the discs at some times (s), and the paths of hand and discs until the last of them."""
    from matplotlib import colormaps

    last = min(instants[-1], float(motion.t[-1]))
    times = [time for time in instants if time < last] + [last]
    until = int(np.searchsorted(motion.t, last)) + 1
    hand = problem.arm.forward_kinematics(motion.q[:until])
    axes.plot(*hand.T, color="k", linewidth=1.2, zorder=4)
    for rank, time in enumerate(times):
        color = colormaps["viridis"](0.85 * (1.0 - rank / (len(times) - 1)))
        index = min(int(np.searchsorted(motion.t, time)), len(motion.t) - 1)
        _draw_arm(axes, problem.arm, motion.q[index], color, f"{time:.2g} s")
        for disc in problem.obstacles:
            _draw_disc(axes, disc.position + time * disc.velocity, disc.radius, color)
    for disc in problem.obstacles:
        ends = np.stack([disc.position, disc.position + last * disc.velocity])
        axes.plot(*ends.T, color="k", linestyle=":", linewidth=1.0)
    axes.plot(*hand_goal(problem), marker="*", color="C3", markersize=12, linestyle="", zorder=5)
    name_axes(axes, title, "x (m)", "y (m)")
    for line in axes.legend(fontsize="x-small", loc="lower left").get_lines():
        line.set_linewidth(5.0)
    axes.set(aspect="equal", xlim=(-0.6, 1.25), ylim=(-0.65, 1.05))


def _draw_arm(axes: Axes, arm: Arm, q: Array, color: Any, label: str) -> None:
    joints = arm.joint_positions(q)
    axes.plot(*joints.T, color=color, alpha=0.45, label=label, linewidth=_LINK, solid_capstyle="round", zorder=2)
    axes.plot(*joints[:-1].T, color=color, marker="o", markersize=3.5, linestyle="", zorder=3)


def _draw_disc(axes: Axes, center: Array, radius: float, color: Any) -> None:
    from matplotlib.patches import Circle

    axes.add_patch(Circle((center[0], center[1]), radius, facecolor=(*color[:3], 0.35), edgecolor=color, zorder=3))


def draw_clearances(axes: Axes, motions: Mapping[str, FieldMotion], title: str, until: float) -> None:
    """Clearance of the whole arm over time (s); a motion that ends in a collision ends in a cross."""
    styles = [("C0", "-"), ("C0", "--"), ("C1", "-"), ("C1", "--")]
    for (name, motion), (color, style) in zip(motions.items(), styles, strict=True):
        shown = motion.t <= until
        axes.plot(motion.t[shown], motion.clearance[shown], color=color, linestyle=style, label=name)
        if motion.outcome == "collision":
            cross: dict[str, Any] = {"marker": "x", "markersize": 9, "markeredgewidth": 2.0, "clip_on": False}
            axes.plot(motion.t[-1], motion.clearance[-1], color=color, **cross)
    name_axes(axes, title, "t (s)", "clearance of the arm (m)")
    axes.set(ylim=(0.0, None), xlim=(0.0, until))


def draw_table(axes: Axes, table: DistanceTable, speeds: Sequence[float]) -> None:
    """Eq 20: how much nearer or farther a disc counts by its direction, at some speeds (m/s)."""
    directions = np.linspace(0.0, np.pi, 91)
    for speed in speeds:
        shifts = [table.shift(speed, direction) for direction in directions]
        axes.plot(np.degrees(directions), shifts, label=f"{speed:g} m/s")
    name_axes(axes, "Eq 20: the table adds", "direction (deg)", "shift (m)")
    axes.set(xticks=range(0, 181, 45))
