"""Tables of the starts of ConveyorTrack that DPCT can solve, on a grid: the shipped one, and those of other arms.

The table of another arm, payload, belt acceleration or horizon is solved when it is first needed, with a progress bar,
and kept in the user's cache (`envs.user_cache`).
"""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from importlib import resources
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track

from envs.conveyor_track.belt import RANGES, Demands, Start, axes_of, pace_of, problem_of
from envs.user_cache import load_arrays, store_arrays
from planners import Infeasible, UnreachableTarget, dpct
from planners.typing import Array

TABLE = "starts.npz"
MARGIN = 0.97
"""Share of every limit within which the corners of a cell are solved."""

ELBOWS = (1.0, -1.0)

NODES = (5, 5, 3, 4)
"""Nodes of the grids of other arms, by axis."""

PACES = (1.0, 0.5, 0.25, 0.125)
"""Shares of the pace of the belt to try, fastest first, until `PROBED` of the probes can be solved."""

PROBES, PROBED = 12, 0.25

FORMAT = 1
"""Changes with anything that changes the tables."""


class Table(NamedTuple):
    """Solutions of DPCT on a grid.

    Attributes:
        axes: nodes by name, as the fields of `Start`; the elbow is a fifth axis with the values of `ELBOWS`.
        rendezvous_time: inf without a solution, ``(*nodes, 2)``, s.
        rides_until: until when the part can be followed, s.
    """

    axes: Mapping[str, Array]
    rendezvous_time: Array
    rides_until: Array

    def cells(self, horizon: float, hold_time: float) -> NDArray[np.int64]:
        """Lowest corners and elbow, ``(cells, 5)``, of cells with all corners met in time and followed to the end."""
        solved = (self.rendezvous_time <= horizon - hold_time) & (self.rides_until >= horizon)
        cells = np.ones([size - 1 for size in solved.shape[:-1]] + [solved.shape[-1]], dtype=bool)
        for corner in itertools.product((0, 1), repeat=len(self.axes)):
            cells &= solved[tuple(slice(bit, bit + size) for bit, size in zip(corner, cells.shape[:-1], strict=True))]
        return np.argwhere(cells)


def solve(axes: Mapping[str, Array], demands: Demands) -> Table:
    """Solve the grid with these nodes within `MARGIN` of all limits, with a progress bar on a terminal."""
    shape = (*(len(nodes) for nodes in axes.values()), len(ELBOWS))
    rendezvous, rides = np.full(shape, np.inf), np.zeros(shape)
    console = Console(stderr=True)
    what = f"solving the starts of ConveyorTrack-v0 for {demands.arm.name} (once)"
    if not console.is_terminal:
        console.print(f"{what}, {np.prod(shape)} problems", soft_wrap=True, markup=False, highlight=False)
    for index in track(list(np.ndindex(shape)), what, console=console, transient=True, disable=not console.is_terminal):
        values = [nodes[i] for nodes, i in zip(axes.values(), index[:-1], strict=True)]
        rendezvous[index], rides[index] = _solved(Start._make([*values, ELBOWS[index[-1]], 0.0]), demands)
    return Table(axes, rendezvous, rides)


def _solved(start: Start, demands: Demands) -> tuple[float, float]:
    """Rendezvous time, and until when the part can be followed, s; (inf, 0) without a solution."""
    try:
        problem = problem_of(start, demands)
        plan = dpct.plan(replace(problem, limits=problem.joint_limits.scaled(MARGIN)))
    except (Infeasible, UnreachableTarget):
        return np.inf, 0.0
    return plan.rendezvous_time, min(plan.rides_until, demands.horizon)


@lru_cache(maxsize=1)
def shipped() -> Table:
    """The table of the paper's arm without payload, for horizons up to 6 s (``python -m tools.conveyor_starts``)."""
    with resources.as_file(resources.files("envs.conveyor_track") / TABLE) as path, np.load(path) as stored:
        arrays = {name: stored[name] for name in stored.files}
    return _table(arrays)


def _table(arrays: Mapping[str, NDArray[np.float64]]) -> Table:
    """A table from its arrays by name."""
    axes = {name: arrays[name] for name in RANGES}
    return Table(axes, arrays["rendezvous_time"], arrays["rides_until"])


def own_table(demands: Demands) -> Table:
    """The table of an environment for which the shipped one does not hold: from the cache, or solved.

    Raises:
        ValueError: if DPCT solves hardly any start, however slow the belt.
    """
    anonymous = demands._replace(arm=replace(demands.arm, name=""))
    key = hashlib.sha256(repr((FORMAT, NODES, PACES, PROBES, PROBED, MARGIN, anonymous)).encode()).hexdigest()
    name = f"conveyor-track-{key[:32]}.npz"
    stored = load_arrays(name)
    shape = (*NODES, len(ELBOWS))
    if stored is not None and {"rendezvous_time", "rides_until", *RANGES} <= stored.keys():
        table = _table(stored)
        if table.rendezvous_time.shape == table.rides_until.shape == shape:
            return table
    for share in PACES:
        axes = axes_of(demands, share * pace_of(demands), NODES)
        if _probably_solvable(axes, demands):
            table = solve(axes, demands)
            if len(table.cells(demands.horizon, demands.hold_time)):
                store_arrays(
                    name, {"rendezvous_time": table.rendezvous_time, "rides_until": table.rides_until, **table.axes}
                )
                return table
    raise ValueError(
        f"no start is known that settles within horizon {demands.horizon:g} s minus hold_time {demands.hold_time:g} s "
        f"(the defaults are 3 s and 0.5 s) with {demands.arm.name}, gravity {demands.arm.gravity:g} m/s^2, payload "
        f"{demands.payload:g} kg and belt acceleration {demands.belt_acceleration:g} m/s^2: DPCT solves hardly any, "
        "also on a slow belt"
    )


def _probably_solvable(axes: Mapping[str, Array], demands: Demands) -> bool:
    """Whether DPCT solves enough of some starts within the grid in time."""
    generator, solved = np.random.default_rng(0), 0
    for probe in range(PROBES):
        values = [nodes[0] + generator.random() * (nodes[-1] - nodes[0]) for nodes in axes.values()]
        met, ridden = _solved(Start._make([*values, ELBOWS[probe % 2], 0.0]), demands)
        solved += met <= demands.horizon - demands.hold_time and ridden >= demands.horizon
    return solved >= PROBED * PROBES
