"""The minimal-torque paper as published: a direct search for the interpolated motion of least joint torque.

"Trajectory Planning for Torque Minimization of Robot Manipulators Using the Lagrange Interpolation Method" (L.-P. Luo,
S.-W. Hwang, C.-S. Han). The joints move between given angles in a given time. The paper's equations:

    (5)   M q'' + V + G = tau
    (6)   PI = sum over the joints of sqrt(tau_j^2), at an instant; integrated over the motion here, N m s
    (7)   t_i = (t_N + t_1) / 2 + (t_N - t_1) / 2 cos((2 i - 1) pi / (2 N)),  i = 1 ... N
    (8)   q_j(t) = sum_i q_j(t_i) l_i(t),     (9)  l_i(t) = product over k != i of (t - t_k) / (t_i - t_k)
    (12)  q_j(t) = sum_k a_jk t^k
    (13)  t_1 = 0, t_N = 1 s;  q(t_1) = (0, 0, 0), q(t_N) = (1, 0, 0) rad;  velocities are not given

Algorithm 1 tries every combination of angles at the interior nodes of (8); Algorithm 2 every combination of the
coefficients of (12) that (13) leaves free. Both keep the one of least PI. This module reproduces the paper, faults
included, and adds ``clamped`` moves from rest to rest.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike

from planners.capabilities import Takes, variant
from planners.checks import require_choice
from planners.lagrange.grid_search import least_torque
from planners.problem import FixedJoints, MotionProblem
from planners.trajectory import Trajectory, sampled_trajectory
from planners.typing import Array

Method = Literal["lagrange", "polynomial"]

PUBLISHED_TIMES = (0.0, 0.2588, 0.5, 0.7071, 0.9898)
"""Table 2: the node times, s. They are not those of eq 7."""
PUBLISHED_ANGLES = (
    (0.0, 11.4592, 34.3775, 45.8366, 57.2958),
    (0.0, 57.2958, 42.9718, 28.6479, 0.0),
    (0.0, 14.3239, 42.9718, 28.6479, 0.0),
)
"""Table 3: each joint's angles at those times, degrees; fifths of a radian for joint 1, quarters for the others."""
PUBLISHED_COEFFICIENTS = ((-9.5608, 10.5608, 0.0), (15.3390, -15.3390, 0.0), (-0.5487, 0.5487, 0.0))
"""Table 4: a_j2, a_j1 and a_j0 of each joint, rad/s^2, rad/s and rad."""

_MOTION_STEPS = 2000  # of the trajectory
_VISITING_STRIDE = 0.382  # of the samples: PI exceeds the least one sooner if successive samples are far apart
_MOST_STEPS, _MOST_NODES = 10_000, 20
_MOST_POINTS, _MOST_CURVES = 100_000_000, 20_000  # of a grid; of a joint
_AT_GOAL = 1e-6  # rad, rad/s


@variant("lagrange", "paper", {"joints": Takes(links=(1, 2, 3), arrives="on time")}, promises=False)
def plan_paper(
    problem: MotionProblem,
    *,
    method: Method = "lagrange",
    nodes: int | Sequence[float] | Array = 5,
    degree: int = 2,
    grid: Sequence[ArrayLike] | None = None,
    clamped: bool = False,
    steps: int = 100,
) -> Trajectory:
    """Plan as the paper does.

    Args:
        problem: an arm and a :class:`FixedJoints` target, to be reached at the horizon. Limits and obstacles are
            ignored.
        method: ``"lagrange"`` is Algorithm 1, ``"polynomial"`` Algorithm 2.
        nodes: for Algorithm 1, the number of nodes, or their times as fractions of the horizon. For a number the
            interior ones are those of eq 7, the first and the last the ends, as in eq 13.
        degree: for Algorithm 2, n of eq 12.
        grid: for each joint the values to try: angles (rad) at the interior nodes, or coefficients a_jk (rad/s^k). By
            default those of Table 3 (`planners.lagrange.paper.node_angles`), or -16 to 16 by halves.
        clamped: start with the problem's velocity, and end at rest; the degree of the Lagrange motion grows by 2, and
            the first and last nodes are at the ends. The paper fixes no velocity.
        steps: of the trapezoidal rule for PI in the search.

    Returns:
        The motion of least PI on the grid, the first one of equals. Its ``limit_ratios`` may be above 1, and its
        ``rendezvous_time`` is inf unless it ends at rest at the target. ``cost`` is PI, N m s.

    Raises:
        ValueError: if the problem or an option is not of this kind, or the grid is too large to be searched.
    """
    require_choice("method", method, get_args(Method))
    if not 2 <= steps <= _MOST_STEPS:
        raise ValueError(f"steps {steps} must be from 2 to {_MOST_STEPS}")
    if method == "lagrange":
        family = lagrange_family(problem, nodes, clamped=clamped)
        candidates = node_angles(problem) if grid is None else grid
    else:
        family = polynomial_family(problem, degree, clamped=clamped)
        candidates = [np.arange(-16.0, 16.5, 0.5)] * problem.arm.n_joints if grid is None else grid
    best = _search(problem, family, _checked_grid(candidates, problem.arm.n_joints, len(family.basis)), steps)
    name = f"Algorithm {1 if method == 'lagrange' else 2}{', rest to rest' if clamped else ''}"
    return motion(problem, family.member(best), name)


def published_motion(problem: MotionProblem, method: Method) -> Trajectory:
    """The motion the paper prints: Tables 2 and 3 through eq 8, or Table 4 through eq 12, from 0 to 1 s.

    Args:
        problem: an arm of three joints, with the limits and the target for the ratios and the arrival.
        method: ``"lagrange"`` or ``"polynomial"``.

    Raises:
        ValueError: if the method is unknown, or the arm does not have three joints.
    """
    require_choice("method", method, get_args(Method))
    if problem.arm.n_joints != 3:
        raise ValueError(f"the printed motions are of 3 joints; {problem.arm.name} has {problem.arm.n_joints}")
    if method == "lagrange":
        basis = lagrange_basis(PUBLISHED_TIMES)
        curves, source = [_combine(np.radians(angles), basis) for angles in PUBLISHED_ANGLES], "Tables 2 and 3"
    else:
        curves, source = [Polynomial(coefficients[::-1]) for coefficients in PUBLISHED_COEFFICIENTS], "Table 4"
    return motion(replace(problem, horizon=1.0), curves, source)


def chebyshev_nodes(count: int) -> Array:
    """Eq 7 between 0 and 1, ascending, ``(count,)``. The ends are not among them."""
    i = np.arange(count, 0, -1)
    return np.asarray(0.5 + 0.5 * np.cos((2 * i - 1) * np.pi / (2 * count)), dtype=float)


def node_angles(problem: MotionProblem) -> list[Array]:
    """Angles to try at a node, for each joint, rad: the grid of Table 3, for any start and goal.

    Six from start to goal for a joint that moves; for one that does not, five from its angle to 1 rad beyond.
    """
    goal = _goal(problem)
    return [
        np.linspace(start, end, 6) if start != end else start + np.linspace(0.0, 1.0, 5)
        for start, end in zip(problem.q.tolist(), goal.tolist(), strict=True)
    ]


def lagrange_basis(nodes: Sequence[float]) -> list[Polynomial]:
    """Eq 9: for each node the polynomial that is 1 there and 0 at the others."""
    basis = []
    for i, node in enumerate(nodes):
        others = [float(other) for k, other in enumerate(nodes) if k != i]
        product = Polynomial.fromroots(others) if others else Polynomial([1.0])
        basis.append(product / product(node))
    return basis


@dataclass(frozen=True)
class Family:
    """Motions ``q_j(t) = base_j(t) + sum_k x_jk basis_k(t)`` (rad, t in s) with free numbers x."""

    base: tuple[Polynomial, ...]
    basis: tuple[Polynomial, ...]

    def member(self, free: Sequence[Sequence[float]]) -> list[Polynomial]:
        """The motion with ``free`` numbers, one row for each joint."""
        return [base + _combine(row, self.basis) for base, row in zip(self.base, free, strict=True)]


def lagrange_family(
    problem: MotionProblem, nodes: int | Sequence[float] | Array = 5, *, clamped: bool = False
) -> Family:
    """Eq 8 with the start and goal angles at the first and last node; free are the angles at the nodes between.

    Clamped, it is Hermite's interpolation: the ends are double nodes, where angle and velocity are given.
    """
    times = _node_times(nodes, problem.horizon, clamped)
    goal, inner = _goal(problem), times[1:-1]
    if not clamped:
        first, *between, last = lagrange_basis(times)
        base = [start * first + end * last for start, end in zip(problem.q, goal, strict=True)]
        return Family(tuple(base), tuple(between))
    ends = Polynomial.fromroots([0.0, 0.0, problem.horizon, problem.horizon])
    basis = [ends / ends(node) * lagrange for node, lagrange in zip(inner, lagrange_basis(inner), strict=True)]
    base = [cubic - _combine([cubic(node) for node in inner], basis) for cubic in _clamped_cubics(problem)]
    return Family(tuple(base), tuple(basis))


def polynomial_family(problem: MotionProblem, degree: int = 2, *, clamped: bool = False) -> Family:
    """Eq 12 with the low coefficients given by the start and goal; free are the others, a_jk from k = 2 (clamped 4)."""
    lowest = 3 if clamped else 1
    if not lowest <= degree <= _MOST_NODES:
        raise ValueError(
            f"degree {degree} must be from {lowest}, to meet the {lowest + 1} conditions at the ends, to {_MOST_NODES}"
        )
    time = problem.horizon
    if clamped:
        base = _clamped_cubics(problem)
        # t^k less the cubic that has its angle and velocity at the end, and none at the start
        vanishing = [
            {k: 1.0, 3: -(k - 2) * time ** (k - 3), 2: (k - 3) * time ** (k - 2)} for k in range(4, degree + 1)
        ]
    else:
        goal = _goal(problem)
        base = [Polynomial([start, (end - start) / time]) for start, end in zip(problem.q, goal, strict=True)]
        vanishing = [{k: 1.0, 1: -(time ** (k - 1))} for k in range(2, degree + 1)]
    basis = [Polynomial([terms.get(k, 0.0) for k in range(degree + 1)]) for terms in vanishing]
    return Family(tuple(base), tuple(basis))


def motion(problem: MotionProblem, curves: Sequence[Polynomial], planner: str) -> Trajectory:
    """Polynomial joint angles of time (rad, s) from 0 to the horizon, with torques by inverse dynamics (eq 5)."""
    t = np.linspace(0.0, problem.horizon, _MOTION_STEPS + 1)
    q, qd, qdd = (np.stack([curve.deriv(order)(t) for curve in curves], axis=1) for order in range(3))
    trajectory = sampled_trajectory(problem, t, q, qd, qdd, planner=f"Lagrange paper, {planner}")
    arrives = max(np.abs(q[-1] - _goal(problem)).max(), np.abs(qd[-1]).max()) < _AT_GOAL
    rendezvous = problem.horizon if arrives else math.inf
    return replace(trajectory, cost=torque_integral(trajectory.t, trajectory.tau), rendezvous_time=rendezvous)


def torque_integral(t: Array, tau: Array, power: int = 1) -> float:
    """Integral of the sum of abs(tau)^power, ``tau`` ``(samples, n)``; with power 1 it is PI (eq 6), N m s."""
    return float(np.trapezoid((np.abs(tau) ** power).sum(axis=1), t))


def _goal(problem: MotionProblem) -> Array:
    if not isinstance(problem.target, FixedJoints):
        raise ValueError(
            f"the paper's search goes to given joint angles: give a FixedJoints target, not {problem.target}; "
            "Arm.inverse_kinematics turns a hand position into joint angles"
        )
    return problem.target.q


def _node_times(nodes: int | Sequence[float] | Array, horizon: float, clamped: bool) -> list[float]:
    """Node times in s; see :func:`plan_paper`."""
    try:
        given = nodes if not isinstance(nodes, int) else chebyshev_nodes(nodes) if nodes <= _MOST_NODES else ()
        fractions = np.array(given, dtype=float)
    except (TypeError, ValueError, OverflowError):
        fractions = np.empty(0)
    rising = fractions.ndim == 1 and len(fractions) >= 2 and bool((np.diff(fractions) > 0.0).all())
    if not (rising and fractions[0] >= 0.0 and fractions[-1] <= 1.0):
        raise ValueError(
            f"nodes {nodes!r:.80}: give a number from 2 to {_MOST_NODES}, or at least 2 rising fractions of the horizon"
        )
    if clamped or isinstance(nodes, int):
        fractions[[0, -1]] = 0.0, 1.0
    return [float(time) for time in horizon * fractions]


def _clamped_cubics(problem: MotionProblem) -> list[Polynomial]:
    """For each joint the cubic from the problem's angle and velocity to rest at the goal."""
    time, (start, velocity, _) = problem.horizon, problem.start
    gap = _goal(problem) - start
    square, cube = 3.0 * gap / time**2 - 2.0 * velocity / time, velocity / time**2 - 2.0 * gap / time**3
    return [Polynomial(row) for row in np.stack([start, velocity, square, cube], axis=1)]


def _combine(numbers: ArrayLike, basis: Sequence[Polynomial]) -> Polynomial:
    return sum((float(x) * p for x, p in zip(np.asarray(numbers), basis, strict=True)), Polynomial([0.0]))


def _checked_grid(grid: Sequence[ArrayLike], n_joints: int, free: int) -> list[list[tuple[float, ...]]]:
    """For each joint every combination of values of its ``free`` numbers, the last number changing fastest."""
    try:
        values = [np.asarray(joint, dtype=float) for joint in grid]
    except (TypeError, ValueError, OverflowError):
        values = []
    if len(values) != n_joints or not all(v.ndim == 1 and len(v) and np.isfinite(v).all() for v in values):
        raise ValueError(f"grid must give each of the {n_joints} joints a row of finite values to try")
    curves = [len(joint) ** free for joint in values]
    if math.prod(curves) > _MOST_POINTS or max(curves) > _MOST_CURVES:
        raise ValueError(
            f"the grid has {math.prod(curves):.3g} points, {max(curves):.3g} for one joint; the search takes up to "
            f"{_MOST_POINTS:.0e} and {_MOST_CURVES:.0e}: give fewer values, or fewer nodes or coefficients"
        )
    return [list(itertools.product(joint.tolist(), repeat=free)) for joint in values]


def _search(
    problem: MotionProblem, family: Family, grid: list[list[tuple[float, ...]]], steps: int
) -> list[tuple[float, ...]]:
    """The free numbers of each joint with the least PI."""
    order = np.argsort(np.arange(steps + 1) * _VISITING_STRIDE % 1.0, kind="stable")
    t = np.linspace(0.0, problem.horizon, steps + 1)[order]
    weights = np.where((order == 0) | (order == steps), 0.5, 1.0) * problem.horizon / steps
    basis = np.array([[p.deriv(d)(t) for d in range(3)] for p in family.basis]).reshape(-1, 3, steps + 1)
    curves = np.concatenate(
        [
            [base.deriv(d)(t) for d in range(3)] + np.tensordot(np.array(rows), basis, axes=1)
            for base, rows in zip(family.base, grid, strict=True)
        ]
    )
    first = np.cumsum([0, *(len(rows) for rows in grid)])
    coupling, weight = problem.loaded_arm.chain_constants
    angle, speed, acceleration = curves.swapaxes(0, 1)
    best = least_torque(coupling, weight, angle, speed, acceleration, first, weights)
    return [rows[index] for rows, index in zip(grid, best.tolist(), strict=True)]
