"""The start distribution of ConveyorTrack: starts from which DPCT has a motion within all limits.

An episode starts inside a cell of a grid over belt speed, offset, line height, hand position and elbow, all of whose
corners DPCT solves in time within 97 % of all limits (`envs.conveyor_track.table`); the 3 % are the margin for starts
between the corners.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from envs.conveyor_track.belt import Demands, Start, require_solvable, why_unsolvable
from envs.conveyor_track.table import ELBOWS, Table, own_table, shipped
from planners import SCARA_1M

DRAWN = {"belt_speed", "offset", "line_height", "hand_x", "elbow"}
"""What of a start is drawn where it is not given; the hand is on the line then."""

_TRIES = 100

_ACCEPTED, _TRIED = 0.25, 8
"""Least share of starts of the shipped table that can be solved with a payload or a belt that accelerates, and how many
are tried; with less the environment gets a table of its own."""


class Distribution(NamedTuple):
    """Starts to draw from.

    Attributes:
        axes: nodes of the grid, SI units.
        cells: lowest corners and elbow, ``(cells, 5)``.
        certain: whether every start can be solved; otherwise each has to be tried.
    """

    axes: list[list[float]]
    cells: NDArray[np.int64]
    certain: bool

    def draw(self, generator: np.random.Generator) -> Start:
        """A start, uniform over the cells."""
        which, *within = generator.random(1 + len(self.axes)).tolist()
        *corner, elbow = self.cells[int(which * len(self.cells))].tolist()
        values = [
            nodes[index] + share * (nodes[index + 1] - nodes[index])
            for nodes, index, share in zip(self.axes, corner, within, strict=True)
        ]
        return Start._make([*values, ELBOWS[elbow], 0.0])


@lru_cache(maxsize=64)
def distribution_of(demands: Demands) -> Distribution:
    """The start distribution of an environment; it depends on nothing else.

    Raises:
        ValueError: if no start is known that can be solved.
    """
    if demands.arm == SCARA_1M:
        common = _from_table(shipped(), demands, demands.in_table)
        if len(common.cells) and (demands.in_table or _mostly_solvable(common, demands)):
            return common
    return _from_table(own_table(demands), demands, True)


def _from_table(table: Table, demands: Demands, certain: bool) -> Distribution:
    axes = [nodes.tolist() for nodes in table.axes.values()]
    return Distribution(axes, table.cells(demands.horizon, demands.hold_time), certain)


def _mostly_solvable(distribution: Distribution, demands: Demands) -> bool:
    generator = np.random.default_rng(0)
    drawn = [distribution.draw(generator) for _ in range(_TRIED)]
    return sum(why_unsolvable(start, demands) is None for start in drawn) >= _ACCEPTED * _TRIED


def draw_starts(
    generators: Sequence[np.random.Generator], given: Mapping[str, float | tuple[float, float]], demands: Demands
) -> list[Start]:
    """One solvable start per generator.

    Args:
        generators: one per environment; the start of one does not depend on the others.
        given: values of `Start` that are fixed, or ranges that they are drawn from; the others are drawn.
        demands: the environment.

    Raises:
        ValueError: if no drawn start with the given values can be solved, with DPCT's reason.
    """
    fixed = {name: value for name, value in given.items() if not isinstance(value, tuple)}
    if fixed.keys() == given.keys() and fixed.keys() >= DRAWN:
        start = Start(**fixed)
        for generator in generators:
            generator.random(len(DRAWN))  # the same random numbers as a drawn start
        require_solvable(start, demands)
        return [start] * len(generators)
    distribution = distribution_of(demands)
    if not given and distribution.certain:
        return [distribution.draw(generator) for generator in generators]
    return [_draw_with(generator, given, distribution, demands) for generator in generators]


def _draw_with(
    generator: np.random.Generator,
    given: Mapping[str, float | tuple[float, float]],
    distribution: Distribution,
    demands: Demands,
) -> Start:
    for _ in range(_TRIES):
        drawn = distribution.draw(generator)
        values = {
            name: generator.uniform(*value) if isinstance(value, tuple) else value for name, value in given.items()
        }
        start = drawn._replace(**values)
        reason = why_unsolvable(start, demands)
        if reason is None:
            return start
    raise ValueError(f"no motion within the joint limits solves {start._asdict()} (one of {_TRIES} tried): {reason}")
