"""ConveyorTrack-v0: the earliest settling of any motion, in the environment's own terms.

The motion is free: joint accelerations held over control periods, within the limits on velocity, acceleration, jerk and
torque as the environment measures them, with its tolerance. From a given period on the hand must be within the
tolerances of the part, to the end of the episode. IPOPT makes these errors as small as it can; the number of periods
before is lowered as long as they are small enough and the environment, in which every motion is played, agrees.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import casadi as ca
import gymnasium as gym
import numpy as np

from planners.robot.arm import Arm
from planners.typing import Array
from tools.best_known.dynamics import torques
from tools.best_known.lower import Ranges, earliest, joints_of, with_hand_at
from tools.best_known.playback import Motion, Played, begin, play_expert, play_motion

ENV_ID, METRIC = "ConveyorTrack-v0", "settling_time"
METHOD = "free-path transcription on control periods (IPOPT), earliest feasible settling period, from planners' motions"

EXPERTS = ("dpct", "apf", "lagrange")
"""Whose motions the search starts from."""

MARGIN = 0.0003
"""Part of the limits that the solver leaves for the difference between its model and the physics."""

TARGETS = 0.85, 0.99
"""Errors, in tolerances, that the solver need not go below, and that are tried in the environment."""

STEPS = (8, 4, 2, 1)
"""By how many periods the settling is moved forward: the next number after a failure."""

CHECKED = 10
"""Ends of control periods at which the joints must be where the part is, for the lower bound."""

IPOPT = {"print_level": 0, "sb": "yes", "max_iter": 150, "tol": 1e-5, "acceptable_tol": 1e-3, "mu_strategy": "adaptive"}


@lru_cache
def transcription(arm: Arm, periods: int, period: float, tolerances: tuple[float, float]) -> ca.Function:
    """Solver over q, qd ``(n, periods + 1)``, qdd ``(n, periods)`` and the largest error in tolerances, to minimise.

    Parameters: position and velocity of the part at the start. Constraints: steps of q and qd, torques, jerks, and
    squared errors of position and velocity less the square of the largest.
    """
    n, half = arm.n_joints, period / 2
    q, qd, qdd = ca.SX.sym("q", n, periods + 1), ca.SX.sym("qd", n, periods + 1), ca.SX.sym("qdd", n, periods)
    worst, part = ca.SX.sym("worst"), ca.SX.sym("part", 4)
    steps = [q[:, :-1] + period * (qd[:, :-1] + half * qdd) - q[:, 1:], qd[:, :-1] + period * qdd - qd[:, 1:]]
    tau = torques(arm).map(periods)(q[:, :-1] + half * (qd[:, :-1] + half / 2 * qdd), qd[:, :-1] + half * qdd, qdd)
    jerk = ca.diff(ca.horzcat(ca.SX(n, 1), qdd), 1, 1) / period
    angle, rate, lengths = ca.cumsum(q, 0), ca.cumsum(qd, 0), ca.DM(arm.lengths).T
    time = ca.DM(period * np.arange(periods + 1)).T
    x = lengths @ ca.cos(angle) + arm.base[0] - part[0] - part[2] * time
    y = lengths @ ca.sin(angle) + arm.base[1] - part[1] - part[3] * time
    vx, vy = -lengths @ (ca.sin(angle) * rate) - part[2], lengths @ (ca.cos(angle) * rate) - part[3]
    errors = [(x**2 + y**2) / tolerances[0] ** 2 - worst**2, (vx**2 + vy**2) / tolerances[1] ** 2 - worst**2]
    nlp = {
        "x": ca.vertcat(*map(ca.vec, (q, qd, qdd, worst))),
        "p": part,
        "f": worst,
        "g": ca.vertcat(*map(ca.vec, [*steps, tau, jerk, *errors])),
    }
    options: dict[str, Any] = {"ipopt": IPOPT, "print_time": False}
    return ca.nlpsol("solver", "ipopt", nlp, options)


def settle(env: gym.Env[Any, Any], start: Motion, settled: int, part: Array) -> tuple[float, Motion]:
    """The largest error, in tolerances, from period ``settled`` on, and the motion, from the start ``start``."""
    task: Any = env.unwrapped
    config, arm, n = task.task.config, task.task.arm, task.task.arm.n_joints
    periods, period = len(start.q) - 1, config.control_period
    share = 1.0 + config.limit_tolerance - MARGIN
    velocity, hardest, jerk = (share * arm.limits.array(kind) for kind in ("velocity", "acceleration", "jerk"))
    torque = (1.0 - MARGIN) * arm.limits.array("torque")
    states, kept = n * (periods + 1), np.zeros(2 * n * periods)
    high = np.concatenate(
        [np.full(states, np.inf), np.tile(velocity, periods + 1), np.tile(hardest, periods), [np.inf]]
    )
    low = -high
    low[-1] = TARGETS[0]
    low[:n] = high[:n] = start.q[0]
    low[states : states + n] = high[states : states + n] = 0.0
    bounded = np.concatenate([np.tile(torque, periods), np.tile(jerk, periods)])
    error = np.where(np.arange(periods + 1) >= settled, 0.0, np.inf)
    guess = np.concatenate([start.q.ravel(), start.qd.ravel(), np.diff(start.qd, axis=0).ravel() / period, [5.0]])
    found = transcription(arm, periods, period, (config.position_tolerance, config.velocity_tolerance))(
        x0=guess,
        p=part,
        lbx=low,
        ubx=high,
        lbg=np.concatenate([kept, -bounded, np.full(2 * (periods + 1), -np.inf)]),
        ubg=np.concatenate([kept, bounded, error, error]),
    )
    x = np.asarray(found["x"]).ravel()
    rows = x[: 2 * states].reshape(2, -1, n)
    return float(x[-1]), Motion(rows[0], rows[1])


def earlier(motion: Motion, settled: int, before: int) -> Motion:
    """A motion that settles in period ``settled``, quickened to do so ``before`` periods sooner."""
    periods = np.arange(len(motion.q), dtype=float)
    ends = [0.0, settled - before, len(motion.q) - 1.0]
    times = np.interp(periods, ends, [0.0, settled, len(motion.q) - 1.0])
    pace = np.where(periods < settled - before, settled / max(1, settled - before), 1.0)
    q = np.column_stack([np.interp(times, periods, column) for column in motion.q.T])
    qd = np.column_stack([pace * np.interp(times, periods, column) for column in motion.qd.T])
    return Motion(q, qd)


def search(env: gym.Env[Any, Any], key: int, known: Played | None = None) -> Played:
    """The earliest settling found from the experts' motions, or from a known one too, as the environment scores it."""
    task: Any = env.unwrapped
    begin(env, key)
    target = task.motion_problem().target
    part, config = np.concatenate([target.position, target.velocity]), task.task.config
    candidates = [play_expert(env, key, name) for name in EXPERTS] + ([known] if known else [])

    def score(played: Played) -> float:
        return played.score(METRIC, config.limit_tolerance)

    best = min(candidates, key=score)
    for step in STEPS:
        while True:
            settled = round(score(best) / config.control_period)
            if settled <= step:
                break
            for motion in [best.motion, earlier(best.motion, settled, step)]:
                error, found = settle(env, motion, settled - step, part)
                if error <= TARGETS[1]:
                    played = play_motion(env, key, found)
                    if score(played) < score(best):
                        best = played
                        break
            else:
                break
    return best


def lower(env: gym.Env[Any, Any], key: int) -> float:
    """A time before which no motion within the limits is settled, s."""
    begin(env, key)
    task: Any = env.unwrapped
    target, config, arm, q = task.motion_problem().target, task.task.config, task.task.arm, task.joint_state()[0]

    def alternatives(first: int) -> list[list[Ranges]]:
        times = config.control_period * np.arange(first, first + CHECKED)[:, None]
        places = target.position + times * target.velocity
        return with_hand_at(arm, q, places, config.position_tolerance, target.velocity, config.velocity_tolerance)

    joints = joints_of(arm, q, config.limit_tolerance, config.control_period)
    first = earliest(joints, alternatives, round(config.horizon / config.control_period))
    return math.inf if first is None else first * config.control_period
