"""The best known settling time of an episode of ConveyorTrack-v0."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from envs.best_known import best_known, true_problem
from envs.conveyor_track.experts import settle_early
from planners import Infeasible, MovingHand, Trajectory, dpct
from planners.dpct.settling import hand_errors


def settling_time(env: Any, env_index: int, seed: int) -> float:
    """Best known settling time for an environment at its start, s.

    It is that of the stored motion, or the earlier one of the motion that the expert `dpct` plans and the best motion
    with the hand on the belt's line.

    Args:
        env: a vector environment.
        env_index: of the environment in it.
        seed: not used; for `envs.card.Bound`.

    Raises:
        Infeasible: if no motion is found.
    """
    stored, config = best_known(env, env_index), env.task.config
    if math.isfinite(stored):
        return stored
    part = [env.task.batch[env_index][name].copy() for name in ("part_position", "part_velocity", "part_acceleration")]
    problem = replace(true_problem(env, env_index), target=MovingHand(*part))
    tolerances = config.position_tolerance, config.velocity_tolerance
    times = []
    with suppress(Infeasible):
        times.append(_settled(settle_early(env.task)(problem), tolerances, config.control_period))
    with suppress(Infeasible):  # the hand need not start on the line
        times.append(dpct.settling_bound(problem, *tolerances, config.limit_tolerance))
    return min(times, default=math.inf)


def _settled(plan: Trajectory, tolerances: tuple[float, float], period: float) -> float:
    """Time from which on the hand is within both tolerances at the ends of control periods, s; inf if it is not."""
    t = period * np.arange(1, round(plan.problem.horizon / period) + 1, dtype=np.float64)
    outside = np.flatnonzero((hand_errors(plan, t) > tolerances).any(axis=1))
    return float(np.append(t, math.inf)[outside[-1] + 1 if len(outside) else 0])
