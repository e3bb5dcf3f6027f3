"""The paper's state equation (eq 13 to 15), and the formulas in which its Table 1 writes it out.

Eq 12 gives n torques for one acceleration, ``U = M f' x2' + (M f'' + h) x2^2``. The paper multiplies it by the row
``[M f']^T``:

    (13)  [M f']^T U = a x2' - b x2^2 - c
    (14)  x1' = x2,  x2' = (b x2^2 + c) / a + d^T U
    (15)  x1' = x2,  x2' = m(x1, x2) + d^T U

with ``a = |M f'|^2``, ``b = -[M f']^T M f''``, ``c = -[M f']^T h(x1, x2)`` and ``d = M f' / a``.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from agents.papers.dpct.runs import BELT_SPEED, HEIGHT, LINE, START, paper_problem
from agents.papers.report import Columns, Fact, Record
from planners import Arm
from planners.motion.line import reduce_to_line
from planners.typing import Array

_POINTS = 501  # along the line
_ROUNDING = 1e-9  # smaller shares are rounding


class PathState(NamedTuple):
    """Joint angles f(r) of the line (eq 9), f' and f'', each ``(points, n)``, rad."""

    q: Array
    slope: Array
    curvature: Array


class StateEquation(NamedTuple):
    """The coefficients of eq 14: a, b ``(points,)``, c at x2 = 1 1/s ``(points,)``, and d ``(points, n)``.

    On a horizontal arm c is proportional to the square of x2. a, b and c are in N^2 m^2 s^4, d in 1 / (N m s^2).
    """

    a: Array
    b: Array
    c: Array
    d: Array

    def acceleration(self, rate: Array, torque: Array) -> Array:
        """x2' of eq 15, ``(points,)``, 1/s^2, at x2 ``(points,)``, 1/s, under torques ``(points, n)``, N m."""
        drift = (self.b + self.c) * rate**2 / self.a
        driven: Array = drift + np.einsum("pj,pj->p", self.d, torque)
        return driven


def line_states(points: int = _POINTS) -> PathState:
    """The paper's line at evenly spaced r from 0 to 1."""
    derivatives = reduce_to_line(paper_problem(1)).path.derivatives(LINE * np.linspace(0.0, 1.0, points))
    return PathState(derivatives[:, 0], LINE * derivatives[:, 1], LINE**2 * derivatives[:, 2])


def state_equation(arm: Arm, line: PathState) -> StateEquation:
    """Eq 14 for an arm along a line."""
    inertia = arm.mass_matrix(line.q)
    row = np.einsum("pij,pj->pi", inertia, line.slope)
    a = np.einsum("pj,pj->p", row, row)
    b = -np.einsum("pi,pij,pj->p", row, inertia, line.curvature)
    c = -np.einsum("pj,pj->p", row, arm.bias(line.q, line.slope))
    return StateEquation(a, b, c, row / a[:, None])


def table_1_records() -> Iterator[Record]:
    """Every legible row of Table 1 as printed, against the same quantity of the paper's arm.

    ``difference`` is the largest along the line; ``share`` divides it by the largest value of the right one. Exponents
    of s2 cannot be read in the copy used; they are taken as they must be.
    """
    arm, line = paper_problem(1).arm, line_states()
    right = state_equation(arm, line)
    x1 = np.linspace(0.0, 1.0, len(line.q))
    x = START + LINE * x1
    c1, s2, c2, c12 = np.cos(line.q[:, 0]), np.sin(line.q[:, 1]), np.cos(line.q[:, 1]), np.cos(line.q.sum(axis=1))
    scale = LINE / s2
    rates = line.slope
    # M f' s2 / 0.5 as Table 1 writes it into a, b and d
    first = -c1 / 3.0 - c12 / 3.0 - c2 * c1 / 2.0 + 7.0 / 6.0 * c2 * c12
    second = c2 * c12 / 2.0 - c1 / 3.0
    printed_a = scale**2 * (first**2 + second**2)
    bends = (
        5.0 / 6.0 * c2 * c12**2
        + 4.0 / 3.0 * c1**2
        + 0.5 * c2**2 * c12**2
        + c2 * c1**2 / 6.0
        - c12**2 / 3.0
        - 0.5 * c2**2 * c1**2
    )
    second_bend = c2 * c1**2 / 6.0 - c12**2 / 3.0 + 0.5 * c2**2 * c12**2
    rows = {
        "x, m": (x, -0.5 + LINE * x1),
        "q1, rad": (line.q[:, 0], np.arctan(HEIGHT / x) - np.arctan(s2 / (1.0 + c2))),
        "q2, rad": (line.q[:, 1], np.arccos((x**2 + HEIGHT**2 - 2.0) / 2.0)),
        "f', rad": (rates, scale[:, None] * np.stack([c12, -c1 - c12], axis=1)),
        "f'', rad": (
            line.curvature,
            (LINE**2 / s2**3)[:, None] * np.stack([c2 * c12**2 + c1**2, -(1.0 + c2) * (c1**2 + c12**2)], axis=1),
        ),
        "M, kg m^2": (arm.mass_matrix(line.q), _matrix(5.0 / 3.0 + c2, 1.0 / 3.0 + c2 / 2.0, np.full_like(c2, 1 / 3))),
        "h at x2 = 1 1/s, N m": (
            arm.bias(line.q, rates),
            s2[:, None]
            * np.stack([-0.5 * rates[:, 1] ** 2 - rates[:, 0] * rates[:, 1], 0.5 * rates[:, 0] ** 2], axis=1),
        ),
        "a": (right.a, printed_a),
        "b": (right.b, -(LINE**3) / s2**4 * (first * bends + second * second_bend)),
        "d": (right.d, (scale / printed_a)[:, None] * np.stack([first, second], axis=1)),
    }
    for name, (true, printed) in rows.items():
        difference = float(np.abs(printed - true).max())
        yield {"row": name, "difference": difference, "share": difference / float(np.abs(true).max())}


def _matrix(one: Array, off: Array, two: Array) -> Array:
    return np.stack([np.stack([one, off], axis=-1), np.stack([off, two], axis=-1)], axis=-2)


TABLE_1_CAPTION = (
    "Largest difference along the line between a row of Table 1 as printed and the same quantity of the paper's arm, "
    "and that over the largest value of the latter. Exponents of s2 are taken as they must be."
)
TABLE_1_COLUMNS: Columns = {
    "row": "{row}",
    "largest difference": lambda row: f"{row['difference']:.3f}" if row["share"] > _ROUNDING else "none",
    "share (%)": lambda row: f"{100.0 * row['share']:.0f}" if row["share"] > _ROUNDING else "",
}


def facts() -> Iterator[Fact]:
    """What the paper's model cannot say: the part's orientation, and torques that leave the line."""
    arm, line = paper_problem(1).arm, line_states()
    heading = line.q.sum(axis=1)
    turn = float(np.degrees(np.ptp(heading)))
    yield Fact(
        "A two-link arm cannot keep the part's orientation, which section 2 assumes: along the line the last link "
        f"turns by {turn:.1f} deg.",
        {"turn": turn},
    )
    # the least torques that eq 15 accepts at the belt's speed, and the hand's acceleration across the line
    rate = np.full(len(line.q), BELT_SPEED / LINE)
    equation = state_equation(arm, line)
    drift = equation.acceleration(rate, np.zeros_like(line.q))
    least = -equation.d * (drift / np.einsum("pj,pj->p", equation.d, equation.d))[:, None]
    qd = line.slope * rate[:, None]
    qdd = arm.forward_dynamics(line.q, qd, least)
    step = 1e-6
    turning = (arm.jacobian(line.q + step * qd) - arm.jacobian(line.q - step * qd)) / (2.0 * step)
    hand = np.einsum("pij,pj->pi", arm.jacobian(line.q), qdd) + np.einsum("pij,pj->pi", turning, qd)
    across = float(np.abs(hand[:, 1]).max())
    yield Fact(
        "Eq 13 turns the n equations (12) into one, so torques that satisfy eq 15 need not keep the hand on the line: "
        f"the least ones that hold the belt's speed accelerate it across by up to {across:.3f} m/s^2. The n equations "
        "(12) are needed, and the search uses them.",
        {"across": across},
    )
