"""The card of MinTorqueMove-v0."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

from envs.best_known import best_known, true_problem
from envs.card import Bound, Info, Metric, Picture, TaskCard
from envs.experts.planning import PlanningExpert
from envs.experts.reactive import JointFieldExpert
from envs.min_torque_move.controls import CONTROLS
from envs.min_torque_move.levels import LEVELS
from planners import dpct, lagrange, quintic


def _bound(env: Any, env_index: int, seed: int) -> float:
    """Best known torque over the quintic's: of the stored motion, or of a plan that is searched thoroughly."""
    stored = best_known(env, env_index)
    if math.isfinite(stored):
        return stored
    problem = true_problem(env, env_index)
    return lagrange.plan(problem, thorough=True).cost / quintic.plan(problem).cost


def _outcome(info: Info, duration: float) -> str:
    if info["is_success"]:
        return f"torque {100.0 * info['quintic_ratio']:.0f} % of the quintic's"
    return f"missed the goal by {info['angle_error']:.2g} rad"


CARD = TaskCard(
    metrics=(
        Metric("quintic_ratio", "torque / quintic's", primary=True),
        Metric("torque_l1", "PI1 (N m s)"),
        Metric("angle_error", "error (mrad)", 1e3),
    ),
    experts={
        "dpct": lambda task: PlanningExpert(task, partial(dpct.plan, variant="torque")),
        "lagrange": lambda task: PlanningExpert(task, lagrange.plan),
        "apf": JointFieldExpert,
        "follower": lambda task: PlanningExpert(task, quintic.plan),
    },
    bound=Bound(
        "quintic_ratio",
        "torque of the best motion found, played in the environment, over the quintic's; for other starts and settings "
        "than the stored ones, that of a plan of lagrange with thorough=True",
        _bound,
    ),
    links=(1, 2, 3, 4, 5, 6),
    recipe="ppo/MinTorqueMove-v0",
    constant_entries=frozenset({"torque_limit"}),  # the arm's
    picture=Picture(
        "sum of the joints' |torque| (N m)",
        measure=lambda record: float(record["torque_l1"]),
        outcome=_outcome,
        target=lambda task, record: task.arm.forward_kinematics(record["goal"]),
        rate=True,
    ),
    controls=CONTROLS,
    levels=LEVELS,
)
"""What other packages need to know of MinTorqueMove-v0."""
