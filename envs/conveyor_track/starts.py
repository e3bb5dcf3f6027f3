"""The start distribution of ConveyorTrack: starts from which DPCT has a motion within all limits.

``python -m tools.conveyor_starts`` stores the rendezvous times of DPCT, within 97 % of all limits, on a grid over belt
speed, offset, line height, hand position and elbow. An episode starts inside a cell of that grid all of whose corners
are solved in time; the 3 % are the margin for starts between the corners.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from importlib import resources
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from planners import SCARA_1M, Infeasible, MotionProblem, MovingHand, UnreachableTarget, dpct
from planners.typing import Array

TABLE = "starts.npz"
MARGIN = 0.97
"""Share of every limit within which the corners of a cell are solved."""

AXES: dict[str, Array] = {
    "belt_speed": np.linspace(0.05, 0.25, 9),
    "offset": np.linspace(-0.2, 0.2, 9),
    "line_height": np.linspace(1.5, 1.8, 4),
    "hand_x": np.linspace(-0.8, -0.3, 6),
}
"""Nodes of the grid, SI units; the elbow is a fifth axis with the values + and -."""

ELBOWS = (1.0, -1.0)
_TRIES = 100


class Start(NamedTuple):
    """Start of an episode: belt speed (m/s), D of eq 2 (m), y of the line (m), x of the hand (m), sign of the elbow."""

    belt_speed: float
    offset: float
    line_height: float
    hand_x: float
    elbow: float


PAPER_START = Start(belt_speed=0.2, offset=0.1, line_height=1.732, hand_x=-0.8, elbow=1.0)
"""Section 5.1 of the paper: hand at (-0.8, 1.732) m, part at (-0.9, 1.732) m, belt 0.2 m/s."""


class Demands(NamedTuple):
    """The environment of a start, which must be settled ``hold_time`` before ``horizon``; SI units."""

    horizon: float
    hold_time: float
    belt_acceleration: float = 0.0
    payload: float = 0.0

    @property
    def in_table(self) -> bool:
        """Whether the stored table holds for this environment."""
        return self.belt_acceleration == 0.0 and self.payload == 0.0


def problem_of(start: Start, demands: Demands) -> MotionProblem:
    """The planning problem that a start poses.

    Raises:
        UnreachableTarget: if the hand cannot reach its start.
    """
    hand = np.array([start.hand_x, start.line_height])
    branch = 0 if start.elbow > 0.0 else 1
    return MotionProblem(
        arm=SCARA_1M,
        q=SCARA_1M.inverse_kinematics(hand)[branch],
        target=MovingHand(
            position=hand - [start.offset, 0.0],
            velocity=np.array([start.belt_speed, 0.0]),
            acceleration=np.array([demands.belt_acceleration, 0.0]),
        ),
        horizon=demands.horizon,
        payload=demands.payload,
    )


@lru_cache(maxsize=1024)
def why_unsolvable(start: Start, demands: Demands) -> str | None:
    """DPCT's reason why a start cannot be solved within all limits in time, or None if it can."""
    if not all(math.isfinite(value) for value in start):
        return f"{start} is not finite"
    try:
        plan = dpct.plan(problem_of(start, demands))
    except (Infeasible, UnreachableTarget) as error:
        return str(error)
    latest = demands.horizon - demands.hold_time
    if plan.rendezvous_time > latest:
        return (
            f"late: the part can be met after {plan.rendezvous_time:.3f} s at the earliest, but must be met within "
            f"{latest:g} s of the episode's {demands.horizon:g} s; raise horizon, or choose another offset"
        )
    if plan.rides_until < demands.horizon:
        return (
            f"late: within the limits the hand can follow the part until {plan.rides_until:.3f} s only, but the "
            f"episode lasts {demands.horizon:g} s; lower horizon or belt_speed, or move hand_x against the belt"
        )
    return None


def require_solvable(start: Start, demands: Demands) -> None:
    """Raise a ValueError with DPCT's reason if a start cannot be solved."""
    reason = why_unsolvable(start, demands)
    if reason is not None:
        raise ValueError(f"no motion within the joint limits solves {start._asdict()}: {reason}")


def draw_starts(generators: Sequence[np.random.Generator], given: Mapping[str, float], demands: Demands) -> list[Start]:
    """One solvable start per generator.

    Args:
        generators: one per environment; the start of one does not depend on the others.
        given: values of `Start` that are fixed; the others are drawn.
        demands: the environment.

    Raises:
        ValueError: if no drawn start with the given values can be solved, with DPCT's reason.
    """
    if not given and demands.in_table:
        return [_draw(generator, demands) for generator in generators]
    return [_draw_with(generator, given, demands) for generator in generators]


def _draw_with(generator: np.random.Generator, given: Mapping[str, float], demands: Demands) -> Start:
    tries = 1 if len(given) == len(Start._fields) else _TRIES
    for _ in range(tries):
        start = _draw(generator, demands)._replace(**given)
        reason = why_unsolvable(start, demands)
        if reason is None:
            return start
    raise ValueError(f"no motion within the joint limits solves {start._asdict()} (one of {tries} tried): {reason}")


def _draw(generator: np.random.Generator, demands: Demands) -> Start:
    """A start from the table, uniform over its feasible cells."""
    cells = _feasible_cells(demands.horizon, demands.hold_time)
    if len(cells) == 0:
        raise ValueError(
            f"no start is known that settles within horizon {demands.horizon:g} s minus hold_time "
            f"{demands.hold_time:g} s; the defaults are 3 s and 0.5 s"
        )
    which, *within = generator.random(1 + len(AXES)).tolist()
    *corner, elbow = cells[int(which * len(cells))].tolist()
    values = [
        nodes[index] + share * (nodes[index + 1] - nodes[index])
        for nodes, index, share in zip(_AXIS_LISTS, corner, within, strict=True)
    ]
    return Start._make([*values, ELBOWS[elbow]])


_AXIS_LISTS: list[list[float]] = [nodes.tolist() for nodes in AXES.values()]


@lru_cache(maxsize=16)
def _feasible_cells(horizon: float, hold_time: float) -> NDArray[np.int64]:
    """Lowest corners and elbow, ``(cells, 5)``, of cells with all corners met in time and followed to the end."""
    with resources.as_file(resources.files("envs.conveyor_track") / TABLE) as path, np.load(path) as table:
        solved = (table["rendezvous_time"] <= horizon - hold_time) & (table["rides_until"] >= horizon)
    cells = np.ones([size - 1 for size in solved.shape[:-1]] + [solved.shape[-1]], dtype=bool)
    for corner in itertools.product((0, 1), repeat=len(AXES)):
        cells &= solved[tuple(slice(bit, bit + size) for bit, size in zip(corner, cells.shape[:-1], strict=True))]
    return np.argwhere(cells)
