"""Least joint torques found by other means: what the Lagrange planner is measured against.

``python -m tools.best_known_torque`` solves the paper's move and 200 random ones, and writes
``data/best_known.json`` with the recipe. Nothing of the planner is used: the torques are those of
:mod:`tools.lagrange_equations`, derived by SymPy; the motion is a direct collocation with piecewise constant
acceleration on 200 stages; the limits are in relaxed logarithmic barriers (C. Feller and C. Ebenbauer, "Relaxed
Logarithmic Barrier Function Based Model Predictive Control of Linear Systems", IEEE Trans. Autom. Control 62 (2017));
and a damped Newton method with SciPy's banded solver goes from many random starts, on few stages first. The index
counts on a grid ten times as dense, and only if the limits are kept there.
"""

from __future__ import annotations

import json
import os
import platform
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.linalg import solveh_banded

from envs.min_torque_move.moves import random_moves
from planners.problem import FixedJoints, MotionProblem
from planners.robot.arm import PLANAR_3R
from planners.typing import Array
from tools.lagrange_equations import derive

FILE = Path(__file__).parent / "data" / "best_known_torque.json"
PROBLEMS, SEED = 200, 2015
COARSE, FINE = 40, 200
"""Stages on which every start is tried, and on which the best are brought to an end."""

STARTS, FINISHED = 24, 3
"""Random starts of each problem, beside the quintic, and how many of the minima they lead to are refined."""

RIVALS = 8
"""How many of the smooth index' minima, and of the starts, lead to sketches of the other index."""

NEARLY_KEPT = 1.05
"""Load up to which a sketch counts."""

MOST_STEPS = 30
"""Newton steps for one width and weight."""

SPREAD = (1.5, 2.6, 2.6)
"""Largest random detour of every joint half way, rad."""

TIGHTER, ATTEMPTS = 1e-4, 5
"""How much more than the excess on the dense grid the limits are tightened by, and how often that is tried."""

SCHEDULE = tuple((0.3 * 0.4**i, 0.03 * 0.4**i) for i in range(7))
FINE_SCHEDULE = tuple((0.03 * 0.55**i, 1e-3 * 0.55**i) for i in range(9))
"""Widths of the smoothed |tau|, as fractions of its mean on the quintic, and weights of the barriers."""

EXCESS = 1e-4
"""Share of the limits by which a barrier may give way where a limit matters most."""

Power = Literal[1, 2]


@dataclass(frozen=True)
class Mesh:
    """Quadratic B-splines, whose acceleration is constant on every stage, seen at instants of every stage.

    Attributes:
        values: of the three functions that act at each instant, with two derivatives, ``(instants, 3, 3)``.
        first: number of the first of them, ``(instants,)``.
        knots: of the splines.
        weight: of every instant; one for all.
    """

    values: Array
    first: NDArray[np.int64]
    knots: Array
    weight: float


@lru_cache(maxsize=8)
def make_mesh(stages: int, inside: tuple[float, ...]) -> Mesh:
    """A mesh with instants at given fractions of every stage, for a motion that lasts 1 s."""
    knots = np.concatenate([np.zeros(2), np.linspace(0.0, 1.0, stages + 1), np.ones(2)])
    s = ((np.arange(stages)[:, None] + np.array(inside)) / stages).ravel()
    spline = BSpline(knots, np.eye(stages + 2), 2)
    stage = np.repeat(np.arange(stages), len(inside))
    values = np.stack([spline.derivative(d)(s) if d else spline(s) for d in range(3)], axis=1)
    local = np.take_along_axis(values, (stage[:, None] + np.arange(3))[:, None, :], axis=2)
    return Mesh(local.transpose(0, 2, 1), stage, knots, 1.0 / len(s))


BORDERS = (1e-9, 1.0 - 1e-9)
DENSE = tuple(np.linspace(1e-9, 1.0 - 1e-9, 11))


class Collocation:
    """One problem on one mesh; unknowns are all spline coefficients but two at either end, ``(stages - 2, n)``."""

    def __init__(self, problem: MotionProblem, stages: int, power: Power) -> None:
        assert isinstance(problem.target, FixedJoints)
        self.problem, self.stages, self.power = problem, stages, power
        self.share = 1.0 - TIGHTER
        self.mesh = make_mesh(stages, BORDERS)
        self.equations = derive(problem.arm)
        self.rates = problem.horizon ** -np.arange(3.0)
        self.start, self.goal = problem.q, problem.target.q
        self.torque_limit = np.array(problem.joint_limits.torque)
        self.angle_limit = np.array(problem.joint_limits.angle)
        # constant motion of the ends: two equal coefficients make angle and rest
        n, size = len(self.start), (stages + 2) * len(self.start)
        indices = ((self.mesh.first[:, None] + np.arange(3))[:, :, None] * n + np.arange(n)).reshape(
            len(self.mesh.first), -1
        )
        rows, columns = np.broadcast_arrays(indices[:, :, None], indices[:, None, :])
        below = rows >= columns
        self.indices, self.below, self.size = indices, below, size
        self.slots = ((rows - columns) * size + columns)[below]
        quintic = self.motion(self.coefficients_of(self.quintic()), make_mesh(stages, DENSE))
        tau = self.torques(quintic)
        self.unit = float(np.mean(np.sum(np.abs(tau), axis=1)))

    def quintic(self, detour: Array | float = 0.0, lean: Array | float = 0.0) -> Array:
        """Coefficients of the quintic with a detour half way and one that leans to a side, ``(stages + 2, n)``."""
        knots = self.mesh.knots
        s = (0.5 * (knots[1:-2] + knots[2:-1]))[:, None]
        curve = self.start + (self.goal - self.start) * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        half_way = 16.0 * (s * (1.0 - s)) ** 2
        angles: Array = curve + half_way * detour + half_way * (1.0 - 2.0 * s) * lean
        return np.clip(angles, -0.98 * self.angle_limit, 0.98 * self.angle_limit)

    def coefficients_of(self, angles: Array) -> Array:
        """Coefficients, the ends set to rest at start and goal."""
        coefficients = angles.copy()
        coefficients[:2], coefficients[-2:] = self.start, self.goal
        return coefficients

    def motion(self, coefficients: Array, mesh: Mesh) -> Array:
        """Joint angles, velocities and accelerations at the instants of a mesh, ``(3, instants, n)``."""
        acting = coefficients[mesh.first[:, None] + np.arange(3)]
        values: Array = np.einsum("kfd,kfj->dkj", mesh.values, acting) * self.rates[:, None, None]
        return values

    def torques(self, motion: Array) -> Array:
        """Joint torques, ``(instants, n)``, N m."""
        return np.stack(np.broadcast_arrays(*self.equations.torque(*motion.transpose(0, 2, 1))), axis=1)

    def value(self, coefficients: Array, width: float, weight: float) -> float:
        """Mean smoothed index, in units, with the barriers."""
        motion = self.motion(coefficients, self.mesh)
        loads = self._loads(motion, self.torques(motion))
        index = np.mean(np.sum(self._index(self.torques(motion) / self.unit, width)[0], axis=1))
        return float(index + weight * np.mean(np.sum(barrier(loads, weight)[0], axis=1)))

    def model(self, coefficients: Array, width: float, weight: float) -> tuple[Array, Array]:
        """Gradient ``(size,)`` and lower bands of the Hessian ``(9, size)`` of `value`."""
        motion = self.motion(coefficients, self.mesh)
        tau = self.torques(motion)
        points, n = tau.shape
        arguments = motion.transpose(0, 2, 1)
        jacobian = _stack(self.equations.jacobian(*arguments), points)
        _, slope, bend = self._index(tau / self.unit, width)
        _, push, stiff = barrier(self._loads(motion, tau), weight)
        inverse = 1.0 / (self.share * self.torque_limit)
        force = slope / self.unit + weight * push[:, :n] * inverse
        stiffness = bend / self.unit**2 + weight * stiff[:, :n] * inverse**2
        pull = np.einsum("kj,kja->ka", force, jacobian)
        curvature = _stack(self.equations.curvature(*arguments, force.T), points)
        curvature += np.einsum("kja,kj,kjb->kab", jacobian, stiffness, jacobian)
        inverse = 1.0 / (self.share * self.angle_limit)
        pull[:, :n] += weight * push[:, n:] * inverse
        curvature[:, np.arange(n), np.arange(n)] += weight * stiff[:, n:] * inverse**2
        functions = self.mesh.values * self.rates
        local = np.einsum("kfd,kdj->kfj", functions, pull.reshape(points, 3, n)).reshape(points, -1)
        matrix = np.einsum(
            "kfd,kdjei,kge->kfjgi", functions, curvature.reshape(points, 3, n, 3, n), functions, optimize=True
        )
        matrix = matrix.reshape(points, 3 * n, 3 * n)
        gradient = np.asarray(np.bincount(self.indices.ravel(), local.ravel(), self.size), dtype=float)
        bands = np.asarray(np.bincount(self.slots, matrix[self.below], 3 * n * self.size), dtype=float)
        return self.mesh.weight * gradient, self.mesh.weight * bands.reshape(3 * n, self.size)

    def minimise(self, coefficients: Array, width: float, weight: float, most: int) -> Array:
        """Damped Newton method to a local minimum of `value`."""
        n = coefficients.shape[1]
        free = slice(2 * n, self.size - 2 * n)
        value, shift = self.value(coefficients, width, weight), 0.0
        for _ in range(most):
            gradient, bands = self.model(coefficients, width, weight)
            step = np.zeros(self.size)
            while True:
                shifted = bands[:, free].copy()
                shifted[0] += shift / self.stages
                try:
                    step[free] = -solveh_banded(shifted, gradient[free], lower=True)
                    break
                except np.linalg.LinAlgError:
                    shift = max(1e-3, 4.0 * shift)
            promised = -float(gradient @ step)
            length = min(1.0, 1.0 / max(float(np.abs(step).max()), 1e-12))
            new = value
            while length > 1e-6:
                trial = coefficients + length * step.reshape(-1, n)
                new = self.value(trial, width, weight)
                if new < value - 1e-4 * length * promised:
                    break
                length *= 0.5
            else:
                break
            done = value - new < 1e-7 * abs(value) and length == 1.0
            coefficients, value = trial, new
            shift = 0.25 * shift if length > 0.9 and shift > 1e-4 else 0.0 if length > 0.9 else max(1e-3, 4.0 * shift)
            if done:
                break
        return coefficients

    def anneal(self, angles: Array, schedule: Sequence[tuple[float, float]]) -> Array:
        """Coefficients of the local minimum that angles lead to as smoothing and barriers vanish."""
        coefficients = self.coefficients_of(angles)
        for width, weight in schedule:
            coefficients = self.minimise(coefficients, width, weight, MOST_STEPS)
        return coefficients

    def assess(self, coefficients: Array, power: Power) -> tuple[float, float]:
        """Index (N m s or N^2 m^2 s) and worst load on the dense mesh, torques by the arm's own inverse dynamics."""
        motion = np.ascontiguousarray(self.motion(coefficients, make_mesh(self.stages, DENSE)))
        tau = self.problem.arm.inverse_dynamics(*motion)
        rates = np.sum(np.abs(tau) ** power, axis=1).reshape(self.stages, -1)
        index = np.sum(np.trapezoid(rates, dx=1.0 / (len(DENSE) - 1), axis=1)) * self.problem.horizon / self.stages
        return float(index), float(
            max(np.max(np.abs(tau) / self.torque_limit), np.max(np.abs(motion[0]) / self.angle_limit))
        )

    def _loads(self, motion: Array, tau: Array) -> Array:
        return np.concatenate(
            [tau / (self.share * self.torque_limit), motion[0] / (self.share * self.angle_limit)], axis=1
        )

    def _index(self, tau: Array, width: float) -> tuple[Array, Array, Array]:
        """Integrand of every joint with its first and second derivatives by the torque, in units."""
        if self.power == 2:
            return tau**2, 2.0 * tau, np.full_like(tau, 2.0)
        root = np.sqrt(tau**2 + width**2)
        return root, tau / root, width**2 / root**3


def barrier(load: Array, weight: float) -> tuple[Array, Array, Array]:
    """Relaxed logarithmic barrier of both sides of a limit, with two derivatives by the load.

    The less it weighs the steeper it goes on, as a parabola, close to the limit and beyond.
    """
    edge = np.sqrt(EXCESS * weight)
    total, slope, bend = np.zeros_like(load), np.zeros_like(load), np.zeros_like(load)
    for sign in (1.0, -1.0):
        room = 1.0 - sign * load
        near = room < edge
        safe = np.where(near, edge, room)
        bent = (room - 2.0 * edge) / edge
        total += np.where(near, 0.5 * (bent**2 - 1.0) - np.log(edge), -np.log(safe))
        slope += np.where(near, -sign * bent / edge, sign / safe)
        bend += np.where(near, 1.0 / edge**2, 1.0 / safe**2)
    return total, slope, bend


def _stack(rows: Sequence[Sequence[Any]], points: int) -> Array:
    """A matrix of expressions, some of them plain numbers, as an array ``(points, rows, columns)``."""
    return np.stack([np.stack([np.broadcast_to(entry, points) for entry in row], axis=1) for row in rows], axis=1)


def solve(problem: MotionProblem, power: Power, generator: np.random.Generator, starts: int = STARTS) -> float | None:
    """Least index found within the limits, N m s or N^2 m^2 s; None if no motion found keeps them.

    The sketches are minima of the smooth index (power 2) and what of the wanted one they, and the starts, lead to.
    """
    fine, n = Collocation(problem, FINE, power), problem.arm.n_joints
    smooth, coarse = (Collocation(problem, COARSE, exponent) for exponent in (2, power))
    begins = [coarse.quintic()]
    for _ in range(starts):
        detour, lean = (generator.uniform(-1.0, 1.0, n) * np.array(SPREAD[:n]) for _ in range(2))
        begins.append(coarse.quintic(detour, lean))
    sketches = [smooth.anneal(begin, SCHEDULE) for begin in begins]
    if power == 1:
        rivals = _distinct(smooth, sketches, power, RIVALS)
        sketches = [coarse.anneal(begin, SCHEDULE) for begin in begins[:RIVALS]]
        sketches += [coarse.anneal(rival, SCHEDULE[2:]) for rival in rivals]
    knots = fine.mesh.knots
    results = []
    for sketch in _distinct(coarse, sketches, power, FINISHED):
        angles = BSpline(coarse.mesh.knots, sketch, 2)(0.5 * (knots[1:-2] + knots[2:-1]))
        index = _finish(fine, angles)
        results += [] if index is None else [index]
    return min(results, default=None)


def _finish(mesh: Collocation, angles: Array) -> float | None:
    """Index of the minimum that angles lead to, the limits tightened until they are kept on the dense grid."""
    mesh.share = 1.0 - TIGHTER
    found = mesh.anneal(angles, FINE_SCHEDULE)
    for _ in range(ATTEMPTS):
        index, load = mesh.assess(found, mesh.power)
        if load <= 1.0:
            return index
        mesh.share *= (1.0 - TIGHTER) / load
        found = mesh.anneal(found, FINE_SCHEDULE[-2:])
    return None


def _distinct(mesh: Collocation, sketches: Sequence[Array], power: Power, most: int) -> list[Array]:
    """The best sketches that come close to keeping the limits, no two of the same index, best first."""
    assessed = [mesh.assess(sketch, power) for sketch in sketches]
    order = sorted((index, i) for i, (index, load) in enumerate(assessed) if load < NEARLY_KEPT)
    chosen: list[tuple[float, int]] = []
    for index, i in order:
        if len(chosen) < most and not (chosen and index - chosen[-1][0] < 1e-3 * index):
            chosen.append((index, i))
    return [sketches[i] for _, i in chosen]


def paper_move() -> MotionProblem:
    """The paper's move, from rest to rest, in the horizontal plane: (0, 0, 0) to (1, 0, 0) rad in 1 s."""
    return MotionProblem(PLANAR_3R, np.zeros(3), FixedJoints(np.array([1.0, 0.0, 0.0])), 1.0)


def load() -> dict[str, Any]:
    """The stored results: see `main`."""
    stored: dict[str, Any] = json.loads(FILE.read_text())
    return stored


def main(problems: int = PROBLEMS) -> None:
    """Solve the paper's move and the random ones, and store the least indices found."""
    begun = time.perf_counter()
    paper = {f"PI{power}": solve(paper_move(), power, np.random.default_rng(SEED)) for power in (1, 2)}
    print(f"paper's move: {paper}", flush=True)
    indices = []
    for number, problem in enumerate(random_moves(problems, SEED)):
        indices.append(solve(problem, 1, np.random.default_rng([SEED, number])))
        print(f"{number + 1}/{problems}: PI1 {indices[-1]}, {time.perf_counter() - begun:.0f} s", flush=True)
    recipe = {
        "command": "python -m tools.best_known_torque",
        "method": "collocation with piecewise constant acceleration, relaxed barriers, damped Newton, random starts",
        "arm": asdict(PLANAR_3R),
        "moves": f"envs.min_torque_move.moves.random_moves({problems}, seed={SEED})",
        "stages": FINE,
        "starts": STARTS + 1,
        "refined": FINISHED,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
    }
    document = {"recipe": recipe, "units": {"PI1": "N m s", "PI2": "N^2 m^2 s"}, "paper": paper, "random_PI1": indices}
    path = FILE
    path.parent.mkdir(exist_ok=True)
    draft = path.with_name(f".{path.name}.{os.getpid()}")
    # JSON has no infinity: joints without a range become null
    text = json.dumps(document, indent=1, default=str).replace("Infinity", "null")
    draft.write_text(text + "\n")
    os.replace(draft, path)


if __name__ == "__main__":
    main()
