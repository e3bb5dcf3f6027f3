"""MinTorqueMove-v0: the least torque of any motion, in the environment's own terms.

The motion is free: joint accelerations held over stages, torque limits and joint ranges as the environment measures
them, and at the end its tolerances of angles and velocities. IPOPT minimises the summed absolute torques from planners'
motions, the quintic and random swings, on few stages; the best of them again with a stage a control period. Every
result is played in the environment, which holds torques over control periods, and counts as it is scored there.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import gymnasium as gym
import numpy as np
from scipy.interpolate import CubicHermiteSpline

from planners.motion.time_laws import quintic
from planners.robot.arm import Arm
from planners.typing import Array
from tools.best_known.dynamics import torques
from tools.best_known.playback import Motion, Played, begin, play_expert, play_motion

ENV_ID, METRIC = "MinTorqueMove-v0", "quintic_ratio"
METHOD = "transcription on control periods with the tolerances at the end (IPOPT), from planners' motions and swings"

EXPERTS = ("lagrange", "dpct")
"""Whose motions the search starts from."""

COARSE = 30
"""Stages of the first solves."""

SWINGS, WAVES, SPREAD = 16, 4, 5.0
"""Random starts beside the quintic; the sine waves that they are sums of, and the spread of the first's height, rad."""

FINISHED = 2
"""How many of the coarse minima are solved on control periods."""

ATTEMPTS = 4
"""Solves of a motion, each aimed off by the miss of the last one as played, until the environment agrees."""

SHARE = 0.998
"""Share of the tolerances at the end that the solver uses."""

MARGIN = 0.001
"""Part of the torque limits that the solver leaves for the difference between its model and the physics."""

STIFFNESS = 400.0
"""Acceleration for an error of the angles when a motion is played, 1/s^2."""

IPOPT = {"print_level": 0, "sb": "yes", "max_iter": 200, "tol": 1e-5, "acceptable_tol": 1e-4}
COLD = IPOPT | {"mu_strategy": "adaptive"}
WARM = IPOPT | {
    "mu_init": 1e-2,
    "warm_start_init_point": "yes",
    **{
        f"warm_start_{kind}": 1e-5
        for kind in ("bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac", "mult_bound_push")
    },
}
"""Options of solves on few stages, which explore, and of those on control periods, which stay near their start."""


class Move(NamedTuple):
    """An episode: the arm, its start and goal ``(n,)``, duration (s), and the tolerances of angle and velocity."""

    arm: Arm
    start: Array
    goal: Array
    duration: float
    tolerances: tuple[float, float]


Duals = tuple[Any, Any]
"""Multipliers of the bounds and of the constraints."""


@lru_cache(maxsize=4)
def transcription(arm: Arm, stages: int) -> ca.Function:
    """Solver over q, qd ``(n, stages + 1)``, qdd ``(n, stages)`` and torque bounds; parameter: a stage's length, s.

    Constraints: steps of q and qd, the torques in the middle of the stages, and their bounds.
    """
    n, step = arm.n_joints, ca.SX.sym("step")
    q, qd = ca.SX.sym("q", n, stages + 1), ca.SX.sym("qd", n, stages + 1)
    qdd, bound = ca.SX.sym("qdd", n, stages), ca.SX.sym("bound", n, stages)
    half = step / 2
    steps = [q[:, :-1] + step * (qd[:, :-1] + half * qdd) - q[:, 1:], qd[:, :-1] + step * qdd - qd[:, 1:]]
    tau = torques(arm).map(stages)(q[:, :-1] + half * (qd[:, :-1] + half / 2 * qdd), qd[:, :-1] + half * qdd, qdd)
    nlp = {
        "x": ca.vertcat(*map(ca.vec, (q, qd, qdd, bound))),
        "p": step,
        "f": ca.sum1(ca.vec(bound)) * step,
        "g": ca.vertcat(*map(ca.vec, [*steps, bound - tau, bound + tau])),
    }
    options: dict[str, Any] = {"ipopt": COLD if stages == COARSE else WARM, "print_time": False}
    return ca.nlpsol("solver", "ipopt", nlp, options)


def minimise(
    move: Move, start: Motion, stages: int, miss: Array | float = 0.0, duals: Duals = (0, 0)
) -> tuple[float, Motion, Duals]:
    """PI1 (N m s; inf without a solution), motion and multipliers of the local minimum that a motion leads to.

    Args:
        move: the episode.
        start: a motion of any number of stages.
        stages: of the result.
        miss: by how much angles (rad) and velocities (rad/s) at the end will be above the solver's, ``(2, n)``.
        duals: multipliers of a motion of as many stages.
    """
    arm, n, step = move.arm, move.arm.n_joints, move.duration / stages
    q, qd = resampled(start, stages, move.duration)
    qdd = np.diff(qd, axis=0) / step
    tau = arm.inverse_dynamics(q[:-1] + step / 2 * (qd[:-1] + step / 4 * qdd), qd[:-1] + step / 2 * qdd, qdd)
    middle, reach = arm.limits.angle_middle, arm.limits.angle_half
    low, high = np.tile(middle - reach, (stages + 1, 1)), np.tile(middle + reach, (stages + 1, 1))
    low_rate, high_rate = np.full_like(low, -np.inf), np.full_like(low, np.inf)
    low[0] = high[0] = move.start
    low_rate[0] = high_rate[0] = 0.0
    aim, slack = np.array([move.goal, 0.0 * move.goal]) - miss, SHARE * np.array(move.tolerances)
    low[-1], high[-1] = np.maximum(low[-1], aim[0] - slack[0]), np.minimum(high[-1], aim[0] + slack[0])
    low_rate[-1], high_rate[-1] = aim[1] - slack[1], aim[1] + slack[1]
    torque = np.tile((1.0 - MARGIN) * arm.limits.array("torque"), (stages, 1))
    free, steps = np.full_like(torque, np.inf), np.zeros(2 * n * stages)
    solver = transcription(arm, stages)
    found = solver(
        x0=np.concatenate([part.ravel() for part in (q, qd, qdd, np.abs(tau) + (0.1 if stages == COARSE else 0.0))]),
        p=step,
        lbx=np.concatenate([part.ravel() for part in (low, low_rate, -free, 0.0 * torque)]),
        ubx=np.concatenate([part.ravel() for part in (high, high_rate, free, torque)]),
        lbg=np.concatenate([steps, steps]),
        ubg=np.concatenate([steps, np.full_like(steps, np.inf)]),
        lam_x0=duals[0],
        lam_g0=duals[1],
    )
    rows = np.asarray(found["x"]).ravel()[: 2 * n * (stages + 1)].reshape(2, -1, n)
    kept = solver.stats()["success"]
    return float(found["f"]) if kept else np.inf, Motion(rows[0], rows[1]), (found["lam_x"], found["lam_g"])


def resampled(motion: Motion, stages: int, duration: float) -> Motion:
    """The motion at the ends of so many stages, by cubic splines."""
    spline = CubicHermiteSpline(np.linspace(0.0, duration, len(motion.q)), motion.q, motion.qd)
    times = np.linspace(0.0, duration, stages + 1)
    return Motion(spline(times), spline(times, 1))


def sketches(move: Move, generator: np.random.Generator) -> list[Motion]:
    """The quintic, and random swings around it, of `COARSE` stages."""
    s = np.linspace(0.0, 1.0, COARSE + 1)[:, None]
    straight = move.start + (move.goal - move.start) * quintic(s)[0]
    middle, reach = move.arm.limits.angle_middle, 0.98 * move.arm.limits.angle_half
    bent, waves = [straight], np.arange(1, WAVES + 1)
    for _ in range(SWINGS):
        heights = generator.normal(0.0, SPREAD / waves[:, None], (WAVES, move.arm.n_joints))
        swing = straight + np.sin(np.pi * s) * (np.sin(np.pi * s * waves) @ heights)
        bent.append(middle + np.clip(swing - middle, -reach, reach))
    return [Motion(q, np.gradient(q, move.duration / COARSE, axis=0)) for q in bent]


def search(env: gym.Env[Any, Any], key: int, known: Played | None = None) -> Played:
    """The least torque found from all starts, or from a known motion too, as the environment scores it."""
    task: Any = env.unwrapped
    begin(env, key)
    problem, config = task.motion_problem(), task.task.config
    tolerances = config.angle_tolerance, config.velocity_tolerance
    move = Move(task.task.arm, problem.q, problem.target.q, problem.horizon, tolerances)
    candidates = [play_expert(env, key, name) for name in EXPERTS] + ([known] if known else [])
    starts = [played.motion for played in candidates if played.info["is_success"]]
    starts += sketches(move, np.random.default_rng(max(key, 0)))
    coarse = [minimise(move, start, COARSE) for start in starts]
    distinct: dict[str, Motion] = {}
    for index, motion, _ in sorted(coarse, key=lambda each: each[0]):
        distinct.setdefault(f"{index:.3g}", motion)
    for motion in list(distinct.values())[:FINISHED]:
        candidates += finish(env, key, move, motion)
    return min(candidates, key=lambda played: played.score(METRIC, config.limit_tolerance))


def finish(env: gym.Env[Any, Any], key: int, move: Move, motion: Motion) -> list[Played]:
    """A motion solved with a stage a control period and played, until the environment counts it as a success."""
    task: Any = env.unwrapped
    periods = round(move.duration / task.task.config.control_period)
    miss, tries = np.zeros((2, move.arm.n_joints)), list[Played]()
    duals: Duals = (0, 0)
    for _ in range(ATTEMPTS):
        index, motion, duals = minimise(move, motion, periods, miss, duals)
        if not np.isfinite(index):
            break
        tries.append(play_motion(env, key, motion, STIFFNESS))
        if tries[-1].info["is_success"]:
            break
        miss = np.array([tries[-1].motion.q[-1] - motion.q[-1], tries[-1].motion.qd[-1] - motion.qd[-1]])
    return tries
