"""ObstacleDodge-v0: the earliest arrival of any motion that knows the discs' whole paths, as the environment scores it.

The motion is free: joint accelerations held over control periods, within all of the arm's limits as the environment
measures them, both elbows. From a given period on the hand must be within the tolerance of the goal, for the hold time;
until then the arm keeps clear of the discs. IPOPT makes the largest distance from the goal as small as it can; the
number of periods before is lowered as long as that succeeds and the environment, in which every motion is played,
agrees. It starts from a search in space and time, from the experts' motions and from those of the shipped agent.
"""

from __future__ import annotations

import math
from contextlib import closing
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import gymnasium as gym
import numpy as np

from agents.policies.lookup import SHIPPED, name_policies
from envs.obstacle_dodge.bound import solve
from planners.motion.spacetime import Answer
from planners.robot.arm import Arm
from planners.typing import Array
from tools.best_known.conveyor import earlier
from tools.best_known.dynamics import torques
from tools.best_known.lower import earliest, joints_of, with_hand_at
from tools.best_known.playback import (
    Motion,
    Played,
    begin,
    options_of,
    play_actions,
    play_expert,
    play_motion,
    play_policy,
)

ENV_ID, METRIC = "ObstacleDodge-v0", "time_to_goal"
METHOD = "transcription on control periods (IPOPT), earliest arrival, from space-time searches and policies' motions"

EXPERTS = ("apf", "dpct", "lagrange", "follower")
"""Whose motions the search starts from, beside the agent's and that of the search in space and time."""

STARTS = 5
"""How many of these motions, the earliest, are shortened."""

MARGIN = 0.0005
"""Part of the limits that the solver leaves for the difference between its model and the physics."""

CLEARANCES = (0.0005, 0.003)
"""Clearances at the ends and middles of control periods, m, one after the other until no disc is touched between."""

TARGETS = 0.9, 0.999
"""Distances from the goal, in tolerances, that the solver need not go below, and that are tried in the environment."""

STEPS = (8, 2, 1)
"""By how many periods the arrival is moved forward: the next number after a failure."""

FINE: dict[str, Any] = {"time_steps": (0.1, 0.05), "acceleration": 0.75, "margin": 0.001}
"""Settings of the search in space and time where nothing else has succeeded."""

ROUND = 25
"""Control periods of a motion are a multiple of this number, so that few solvers are built."""

IPOPT = {"print_level": 0, "sb": "yes", "max_iter": 120, "tol": 1e-4, "acceptable_tol": 1e-3, "mu_strategy": "adaptive"}


class Episode(NamedTuple):
    """What the solver needs to know of an episode.

    ``path`` ``(discs, 2, 2 periods + 1)``, m: the discs' centres at the ends and middles of control periods.
    """

    arm: Arm
    goal: Array
    radii: Array
    path: Array
    period: float
    hold: int
    tolerance: float
    limit_tolerance: float


@lru_cache
def transcription(arm: Arm, periods: int, period: float, tolerance: float, discs: int) -> ca.Function:
    """Solver over q, qd ``(n, periods + 1)``, qdd ``(n, periods)`` and the largest distance, in tolerances.

    To minimise: that distance. Parameters: the goal; the discs' centres. Constraints: steps of q and qd, torques, the
    squared distances of hand and goal less the square of the largest, and those of discs and links.
    """
    n, half = arm.n_joints, period / 2
    q, qd, qdd = ca.SX.sym("q", n, periods + 1), ca.SX.sym("qd", n, periods + 1), ca.SX.sym("qdd", n, periods)
    worst, goal, path = ca.SX.sym("worst"), ca.SX.sym("goal", 2), ca.SX.sym("path", 2 * discs, 2 * periods + 1)
    steps = [q[:, :-1] + period * (qd[:, :-1] + half * qdd) - q[:, 1:], qd[:, :-1] + period * qdd - qd[:, 1:]]
    middle = q[:, :-1] + half * (qd[:, :-1] + half / 2 * qdd)
    tau = torques(arm).map(periods)(middle, qd[:, :-1] + half * qdd, qdd)
    posture, disc = ca.SX.sym("posture", n), ca.SX.sym("disc", 2)
    links = hand_and_distances(arm, posture, disc)
    measure = ca.Function("measure", [posture, disc], links)
    hand = measure.map(periods + 1)(q, ca.SX(2, periods + 1))[0]
    away = ca.sum1((hand - goal) ** 2) / tolerance**2 - worst**2
    apart = [
        measure.map(count)(at, path[2 * k : 2 * k + 2, first::2])[1]
        for k in range(discs)
        for at, count, first in ((q, periods + 1, 0), (middle, periods, 1))
    ]
    nlp = {
        "x": ca.vertcat(*map(ca.vec, (q, qd, qdd, worst))),
        "p": ca.vertcat(goal, ca.vec(path)),
        "f": worst,
        "g": ca.vertcat(*map(ca.vec, [*steps, tau, away, *apart])),
    }
    options: dict[str, Any] = {"ipopt": IPOPT, "print_time": False}
    return ca.nlpsol("solver", "ipopt", nlp, options)


def hand_and_distances(arm: Arm, q: ca.SX, disc: ca.SX) -> list[ca.SX]:
    """The hand, m, and the squared distances of a disc's centre from the middle lines of the links, m^2."""
    at, angle, distances = ca.SX(ca.DM(arm.base)), ca.cumsum(q), []
    for i, length in enumerate(arm.lengths):
        along = ca.vertcat(ca.cos(angle[i]), ca.sin(angle[i]))
        share = ca.fmin(length, ca.fmax(0.0, ca.dot(disc - at, along)))
        distances.append(ca.sumsqr(disc - at - share * along))
        at = at + length * along
    return [at, ca.vertcat(*distances)]


def arrive(episode: Episode, start: Motion, arrival: int, clearance: float) -> tuple[float, Motion]:
    """The largest distance from the goal, in tolerances, from period ``arrival`` on, and the motion."""
    arm, n = episode.arm, episode.arm.n_joints
    last = arrival + episode.hold
    periods = -(-last // ROUND) * ROUND
    q, qd = (np.vstack([part, np.repeat(part[-1:], max(0, periods + 1 - len(part)), 0)]) for part in start)
    q, qd = q[: periods + 1], qd[: periods + 1]
    share = 1.0 + episode.limit_tolerance - MARGIN
    velocity, hardest = (share * arm.limits.array(kind) for kind in ("velocity", "acceleration"))
    torque = np.tile((1.0 - MARGIN) * arm.limits.array("torque"), periods)
    states, kept = n * (periods + 1), np.zeros(2 * n * periods)
    middle, reach = arm.limits.angle_middle, arm.limits.angle_half
    angle = [np.tile(middle - reach, periods + 1), np.tile(middle + reach, periods + 1)]
    rates = np.concatenate([np.tile(velocity, periods + 1), np.tile(hardest, periods)])
    low, high = np.concatenate([angle[0], -rates, TARGETS[:1]]), np.concatenate([angle[1], rates, [np.inf]])
    low[:n] = high[:n] = start.q[0]
    low[states : states + n] = high[states : states + n] = 0.0
    nodes = np.arange(periods + 1)
    there = np.where((nodes >= arrival) & (nodes <= last), 0.0, np.inf)
    path = np.concatenate([episode.path, np.repeat(episode.path[:, :, -1:], 2 * periods, axis=2)], axis=2)
    apart = []
    for radius in episode.radii:
        least = (radius + arm.link_radius + clearance) ** 2
        apart += [np.repeat(np.where(at <= last, least, -np.inf), n) for at in (nodes, nodes[:-1])]
    solver = transcription(arm, periods, episode.period, episode.tolerance, len(episode.radii))
    found = solver(
        x0=np.concatenate([q.ravel(), qd.ravel(), np.diff(qd, axis=0).ravel() / episode.period, [2.0]]),
        p=np.concatenate([episode.goal, path[:, :, : 2 * periods + 1].reshape(-1, 2 * periods + 1).T.ravel()]),
        lbx=low,
        ubx=high,
        lbg=np.concatenate([kept, -torque, np.full(periods + 1, -np.inf), *apart]),
        ubg=np.concatenate([kept, torque, there, np.full(sum(map(len, apart)), np.inf)]),
    )
    x = np.asarray(found["x"]).ravel()
    rows = x[: 2 * states].reshape(2, -1, n)
    return float(x[-1]), Motion(rows[0], rows[1])


def search(env: gym.Env[Any, Any], key: int, known: Played | None = None) -> Played:
    """The earliest arrival found from all starts, or from a known motion too, as the environment scores it."""
    task: Any = env.unwrapped
    begin(env, key)
    config = task.task.config
    episode = describe(task.task)

    def score(played: Played) -> float:
        return played.score(METRIC, config.limit_tolerance)

    starts = sorted(candidates(env, key) + ([known] if known else []), key=score)
    best, least = starts[0], round(lower(env, key) / episode.period)
    if np.isfinite(score(best)):
        best = shortened(env, key, episode, best, least)
    for start in [each for each in starts[1:STARTS] if np.isfinite(score(each))]:
        arrival, wanted = (round(score(each) / episode.period) for each in (start, best))
        if wanted <= least:
            break
        found = attempt(env, key, episode, start, arrival, arrival - wanted + 1)
        if found is not None and score(found) < score(best):
            best = shortened(env, key, episode, found, least)
    return best


def shortened(env: gym.Env[Any, Any], key: int, episode: Episode, best: Played, least: int) -> Played:
    """The earliest arrival that a motion leads to; ``least``: the lower bound, in control periods."""

    def score(played: Played) -> float:
        return played.score(METRIC, episode.limit_tolerance)

    for step in (round(score(best) / episode.period) - least, *STEPS):
        while (arrival := round(score(best) / episode.period)) - least >= step > 0:
            found = attempt(env, key, episode, best, arrival, step)
            if found is None or score(found) >= score(best):
                break
            best = found
    return best


def attempt(env: gym.Env[Any, Any], key: int, episode: Episode, best: Played, arrival: int, step: int) -> Played | None:
    """A motion that arrives so many periods sooner, as played; None if none is found."""
    for start in (earlier(best.motion, arrival, step), best.motion):
        for clearance in CLEARANCES:
            distance, found = arrive(episode, start, arrival - step, clearance)
            if distance > TARGETS[1]:
                break
            played = play_motion(env, key, found)
            if np.isfinite(played.score(METRIC, episode.limit_tolerance)):
                return played
    return None


def describe(task: Any) -> Episode:
    """What the solver needs to know, from the task at the start of an episode."""
    record, config, step = task.batch[0], task.config, task.scale.path_step
    centers = task.obstacle_path(0)
    times = np.arange(0.0, config.horizon + 1e-9, config.control_period / 2)
    at = step * np.arange(len(centers))
    path = np.array(
        [[np.interp(times, at, centers[:, disc, axis]) for axis in range(2)] for disc in range(centers.shape[1])]
    )
    hold = round(config.hold_time / config.control_period)
    goal, radii = record["goal"].copy(), record["radii"].copy()
    return Episode(task.arm, goal, radii, path, config.control_period, hold, config.tolerance, config.limit_tolerance)


def candidates(env: gym.Env[Any, Any], key: int) -> list[Played]:
    """Motions of the experts, of the shipped agent and of searches in space and time, each as played."""
    found = [play_expert(env, key, name) for name in EXPERTS]
    agent_env, agent = with_agent()
    found.append(play_actions(env, key, play_policy(agent_env, key, agent).actions))
    with closing(gym.make_vec(ENV_ID, num_envs=1)) as batch:
        batch.reset(seed=max(key, 0), options=options_of(key))
        found += searched(env, key, solve(batch.unwrapped, 0))
        if not any(played.info["is_success"] for played in found):
            found += searched(env, key, solve(batch.unwrapped, 0, **FINE))
    return found


def searched(env: gym.Env[Any, Any], key: int, answer: Answer) -> list[Played]:
    """The motion of a search as played, if it has found one."""
    if answer.trajectory is None:
        return []
    task: Any = env.unwrapped
    times = np.arange(0.0, answer.trajectory.duration, task.task.config.control_period)
    return [play_motion(env, key, Motion(*answer.trajectory.at(times)[:2]))]


@lru_cache
def with_agent() -> tuple[gym.Env[Any, Any], Any]:
    """The shipped agent, and an environment with its control mode."""
    (named,) = name_policies([SHIPPED], ENV_ID)
    return gym.make(ENV_ID, **named.settings({})), named.policy


def lower(env: gym.Env[Any, Any], key: int) -> float:
    """A time before which no motion within the limits is at the goal to stay, s."""
    begin(env, key)
    task: Any = env.unwrapped
    episode, q = describe(task.task), task.joint_state()[0]
    ranges = with_hand_at(
        episode.arm, episode.arm.limits.angle_middle, np.tile(episode.goal, (episode.hold, 1)), episode.tolerance
    )
    joints = joints_of(episode.arm, q, episode.limit_tolerance, episode.period)
    first = earliest(joints, lambda period: ranges, round(task.task.config.horizon / episode.period))
    return math.inf if first is None else first * episode.period
