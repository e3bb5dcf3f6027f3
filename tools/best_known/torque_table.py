"""How far the plans of ``lagrange`` are above the least torques known: the table of docs/planners/lagrange.md.

``python -m tools.best_known.torque_table`` plans the stored moves of ``tools.best_known_torque``, and as many others of
which no best known torque is stored, with both searches (6 minutes), and writes the table between the page's marks
``<!-- least torques -->`` and ``<!-- end of least torques -->``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from agents.console import note
from envs.min_torque_move.moves import random_moves
from planners import lagrange
from planners.files import write_text
from planners.problem import MotionProblem
from planners.typing import Array
from tools.best_known_torque import PROBLEMS, SEED, SLOW, UPRIGHT, UPRIGHT_PROBLEMS, load, upright_moves
from tools.site.marks import replaced

PAGE = Path(__file__).parents[2] / "docs" / "planners" / "lagrange.md"
MARK = "least torques"
OTHERS = SEED + 1
"""Seed of the moves of which no best known torque is stored."""

MUCH = 0.05
"""Excess that is counted."""


def costs(moves: Sequence[MotionProblem], *, thorough: bool) -> Array:
    """PI1 of a plan for every move, N m s."""
    return np.array([lagrange.plan(move, thorough=thorough).cost for move in moves])


def rows() -> Iterator[str]:
    """The lines of the table below its head."""
    known = load()
    yield from _above_stored("horizontal", random_moves(PROBLEMS, SEED), known["random_PI1"])
    yield from _above_stored("vertical", upright_moves(), known["vertical_PI1"])
    yield from _above_stored("vertical, in 3 s", upright_moves(SLOW), known["vertical_slow_PI1"])
    upright = random_moves(UPRIGHT_PROBLEMS, OTHERS, UPRIGHT)
    yield _above_thorough("horizontal", random_moves(PROBLEMS, OTHERS))
    yield _above_thorough("vertical", upright)
    yield _above_thorough("vertical, in 3 s", [replace(move, horizon=SLOW) for move in upright])


def _above_stored(plane: str, moves: Sequence[MotionProblem], known: Sequence[float]) -> Iterator[str]:
    for search in ("usual", "thorough"):
        yield _row(plane, search, "the stored ones", costs(moves, thorough=search == "thorough") / np.array(known))


def _above_thorough(plane: str, moves: Sequence[MotionProblem]) -> str:
    """A row of other moves."""
    return _row(plane, "usual", "thorough", costs(moves, thorough=False) / costs(moves, thorough=True))


def _row(plane: str, search: str, least: str, ratios: Array) -> str:
    percent = (f"{100.0 * (ratio - 1.0):.1f}" for ratio in (*np.quantile(ratios, (0.5, 0.95)), ratios.max()))
    cells = (f"{len(ratios)}, {plane}", search, least, *percent, str(np.count_nonzero(ratios > 1.0 + MUCH)))
    row = f"| {' | '.join(cells)} |"
    note(row)
    return row


def table() -> str:
    """The table."""
    head = "| moves | search | above | median (%) | 95 % of the moves (%) | worst (%) | moves above 5 % |"
    return "\n".join([head, "|---|---|---|---|---|---|---|", *rows()]) + "\n"


if __name__ == "__main__":
    lines = table()
    write_text(PAGE, replaced(PAGE.read_text(encoding="utf-8"), MARK, lines))
