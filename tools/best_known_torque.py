"""Least joint torques found by other means: what the Lagrange planner is measured against.

``python -m tools.best_known_torque`` (needs the ``tools`` extra) solves the paper's move, 200 random ones, and 24 in a
vertical plane, also in 3 s, and writes ``data/best_known_torque.json``. Nothing of the planner is used: the torques are
derived by CasADi from the arm's energies, the motion is a direct collocation with constant acceleration on every stage,
and IPOPT solves it from bent quintics, on few stages first. A result counts on a dense grid by the arm's own inverse
dynamics, and only if the limits are kept there; a stored value stays where it is the better one, and ``source`` says
which each is.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from envs.min_torque_move.moves import random_moves
from planners.problem import FixedJoints, MotionProblem
from planners.robot.arm import Arm
from planners.robot.presets import PLANAR_3R
from planners.typing import Array
from tools.best_known.dynamics import torques

FILE = Path(__file__).parent / "data" / "best_known_torque.json"
PROBLEMS, UPRIGHT_PROBLEMS, SEED = 200, 24, 2015
UPRIGHT, SLOW = replace(PLANAR_3R, gravity=9.81), 3.0
"""The arm in a vertical plane, and the time of its slow moves, s."""

COARSE, FINE, DENSE = 30, 200, 10
"""Stages for every start and for the best ones, and samples per stage on the dense grid."""

STARTS, FINISHED = 16, 3
"""Random starts beside the quintic, and how many of the minima they lead to are solved on the fine mesh."""

SPREAD = np.array([1.5, 2.6, 2.6])  # largest random detour of every joint halfway, rad

NEARLY_KEPT = 1.1  # load up to which a coarse minimum counts as one that keeps the limits

SHARES = (0.9999, 0.999, 0.99)
"""Shares of the limits that the solver uses, one after the other until the dense grid shows no excess."""

IPOPT = {"print_level": 0, "sb": "yes", "max_iter": 400, "tol": 1e-6, "mu_strategy": "adaptive"}


@lru_cache
def collocation(arm: Arm, stages: int, power: int) -> ca.Function:
    """Solver over q, qd ``(n, stages + 1)``, qdd ``(n, stages)`` and bounds of |tau| (power 1); parameter: horizon."""
    n, step = arm.n_joints, ca.MX.sym("horizon") / stages
    q, qd = ca.MX.sym("q", n, stages + 1), ca.MX.sym("qd", n, stages + 1)
    qdd, bound = ca.MX.sym("qdd", n, stages), ca.MX.sym("bound", n, 2 * stages)
    tau = torques(arm).map(2 * stages)(
        ca.horzcat(q[:, :-1], q[:, 1:]), ca.horzcat(qd[:, :-1], qd[:, 1:]), ca.horzcat(qdd, qdd)
    )
    gaps = [q[:, :-1] + step * (qd[:, :-1] + step / 2 * qdd) - q[:, 1:], qd[:, :-1] + step * qdd - qd[:, 1:]]
    index = ca.sumsqr(tau) if power == 2 else ca.sum1(ca.vec(bound))
    variables = [q, qd, qdd] if power == 2 else [q, qd, qdd, bound]
    kept = [tau] if power == 2 else [tau, bound - tau, bound + tau]
    x = ca.vertcat(*map(ca.vec, variables))
    nlp: dict[str, Any] = {
        "x": x,
        "p": ca.symvar(step)[0],
        "f": index * step / 2,
        "g": ca.vertcat(*map(ca.vec, gaps + kept)),
    }
    options: dict[str, Any] = {"ipopt": IPOPT, "print_time": False, "expand": True}
    return ca.nlpsol("solver", "ipopt", nlp, options)


def minimise(problem: MotionProblem, stages: int, power: int, q: Array, share: float = SHARES[0]) -> Array:
    """Joint angles ``(stages + 1, n)``, velocities and accelerations of the local minimum that angles ``q`` lead to."""
    arm, n, step = problem.arm, problem.arm.n_joints, problem.horizon / stages
    assert isinstance(problem.target, FixedJoints)
    q = np.array([np.interp(np.linspace(0.0, 1.0, stages + 1), np.linspace(0.0, 1.0, len(q)), c) for c in q.T]).T
    qd = np.gradient(q, step, axis=0)
    qd[[0, -1]] = 0.0
    qdd = np.diff(qd, axis=0) / step
    tau = arm.inverse_dynamics(np.vstack([q[:-1], q[1:]]), np.vstack([qd[:-1], qd[1:]]), np.vstack([qdd, qdd]))
    limits = problem.joint_limits
    torque, angle = share * limits.array("torque"), share * limits.angle_half
    high = [np.tile(angle, (stages + 1, 1)), np.full((stages + 1, n), np.inf), np.full((stages, n), np.inf)]
    low = [-bound for bound in high]
    low[0], high[0] = limits.angle_middle + low[0], limits.angle_middle + high[0]
    low[0][[0, -1]] = high[0][[0, -1]] = problem.q, problem.target.q
    low[1][[0, -1]] = high[1][[0, -1]] = 0.0
    guess, limit = [q, qd, qdd], np.tile(torque, 2 * stages)
    g_low, g_high = [np.zeros(2 * n * stages), -limit], [np.zeros(2 * n * stages), limit]
    if power == 1:
        guess, low, high = [*guess, np.abs(tau)], [*low, 0.0 * tau], [*high, np.full_like(tau, np.inf)]
        g_low, g_high = [*g_low, np.zeros(2 * tau.size)], [*g_high, np.full(2 * tau.size, np.inf)]
    flat = [np.concatenate([part.ravel() for part in parts]) for parts in (guess, low, high, g_low, g_high)]
    found = collocation(arm, stages, power)(
        x0=flat[0], lbx=flat[1], ubx=flat[2], lbg=flat[3], ubg=flat[4], p=problem.horizon
    )
    return np.asarray(found["x"]).ravel()[: (3 * stages + 2) * n].reshape(-1, n)


def assess(problem: MotionProblem, motion: Array, stages: int, power: int) -> tuple[float, float]:
    """Index (N m s or N^2 m^2 s) and worst load on the dense grid, by the arm's own inverse dynamics."""
    q, qd, qdd = motion[:stages], motion[stages + 1 : 2 * stages + 1], motion[2 * stages + 2 :]
    s = np.linspace(0.0, problem.horizon / stages, DENSE + 1)[:, None, None]
    q, qd, qdd = q + s * (qd + s / 2.0 * qdd), qd + s * qdd, np.broadcast_to(qdd, (DENSE + 1, *qdd.shape))
    tau = problem.arm.inverse_dynamics(*(np.ascontiguousarray(v.reshape(-1, q.shape[2])) for v in (q, qd, qdd)))
    rate = np.sum(np.abs(tau) ** power, axis=1).reshape(DENSE + 1, -1)
    limits = problem.joint_limits
    loads = [np.abs(tau) / limits.array("torque"), np.abs(q - limits.angle_middle) / limits.angle_half]
    return float(np.trapezoid(rate, s[:, 0], axis=0).sum()), max(float(load.max()) for load in loads)


def solve(problem: MotionProblem, power: int, generator: np.random.Generator, starts: int = STARTS) -> float:
    """Least index found within the limits, N m s or N^2 m^2 s; inf if no motion found keeps them."""
    assert isinstance(problem.target, FixedJoints)
    s = np.linspace(0.0, 1.0, COARSE + 1)[:, None]
    quintic = problem.q + (problem.target.q - problem.q) * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    middle, reach = problem.joint_limits.angle_middle, 0.98 * problem.joint_limits.angle_half
    sketches = []
    for start in range(starts + 1):
        detour, lean = generator.uniform(-1.0, 1.0, (2, problem.arm.n_joints)) * SPREAD * (start > 0)
        bent = quintic + 16.0 * (s * (1.0 - s)) ** 2 * (detour + (1.0 - 2.0 * s) * lean)
        q = middle + np.clip(bent - middle, -reach, reach)
        for exponent in (2, power):
            sketch = minimise(problem, COARSE, exponent, q)
            q = sketch[: COARSE + 1]
        sketches.append((*assess(problem, sketch, COARSE, power), q))
    distinct: dict[str, Array] = {}
    for index, _, q in sorted(sketches, key=lambda sketch: (sketch[1] > NEARLY_KEPT, sketch[0])):
        distinct.setdefault(f"{index:.2e}", q)
    best = np.inf
    for q in list(distinct.values())[:FINISHED]:
        for share in SHARES:
            index, load = assess(problem, minimise(problem, FINE, power, q, share), FINE, power)
            if load <= 1.0:
                best = min(best, index)
                break
    return best


def paper_move() -> MotionProblem:
    """The paper's move, from rest to rest, in the horizontal plane: (0, 0, 0) to (1, 0, 0) rad in 1 s."""
    return MotionProblem(PLANAR_3R, np.zeros(3), FixedJoints(np.array([1.0, 0.0, 0.0])), 1.0)


def load() -> dict[str, Any]:
    """The stored results: see `main`."""
    stored: dict[str, Any] = json.loads(FILE.read_text())
    return stored


def upright_moves(duration: float | None = None) -> list[MotionProblem]:
    """The random moves in a vertical plane, in their own time or in a given one, s."""
    moves = random_moves(UPRIGHT_PROBLEMS, SEED, UPRIGHT)
    return moves if duration is None else [replace(move, horizon=duration) for move in moves]


def main(problems: int = PROBLEMS) -> None:
    """Solve the paper's move, the first random ones and those in a vertical plane, and store what is better."""
    stored = load()
    moves: list[tuple[str, str | int, MotionProblem, int]]
    moves = [("paper", "PI1", paper_move(), 1), ("paper", "PI2", paper_move(), 2)]
    tables: dict[str, Sequence[MotionProblem]] = {
        "random_PI1": random_moves(problems, SEED),
        "vertical_PI1": upright_moves(),
        "vertical_slow_PI1": upright_moves(SLOW),
    }
    moves += [(table, i, problem, 1) for table, them in tables.items() for i, problem in enumerate(them)]
    for table, key, problem, power in moves:
        index = solve(problem, power, np.random.default_rng([SEED, key if isinstance(key, int) else 0]))
        known = stored.setdefault(table, [])
        if isinstance(key, int) and key == len(known):  # not solved before
            known.append(math.inf)
            stored["source"].setdefault(table, []).append("")
        if math.isinf(min(index, known[key])):
            raise RuntimeError(f"{table} {key}: no motion found within the limits")
        print(f"{table} {key}: {index:.6g} found, {known[key]:.6g} stored", flush=True)
        if index < known[key]:
            known[key], stored["source"][table][key] = index, "ipopt"
            FILE.write_text(json.dumps(stored, indent=1) + "\n")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
