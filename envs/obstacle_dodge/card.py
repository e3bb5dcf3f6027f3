"""The card of ObstacleDodge-v0."""

from __future__ import annotations

from functools import partial
from typing import Any

from envs.best_known import lower_bound
from envs.card import Bound, Info, Metric, Picture, TaskCard
from envs.experts.planning import PlanningExpert
from envs.obstacle_dodge.bound import time_to_goal
from envs.obstacle_dodge.controls import CONTROLS
from envs.obstacle_dodge.experts import REPLAN_EVERY, DodgingExpert, pass_via_nodes, time_along_line
from envs.obstacle_dodge.levels import LEVELS
from planners import trapezoid
from planners.typing import Array


def _outcome(info: Info, duration: float) -> str:
    if info["collision"]:
        return f"collided at {duration:.2f} s"
    clearance = f"least clearance {1e3 * info['min_clearance']:.0f} mm"
    if info["is_success"]:
        return f"at the goal after {info['time_to_goal']:.2f} s,\n{clearance}"
    return f"not at the goal after {duration:.1f} s,\n{clearance}"


def _discs(task: Any, record: Any) -> tuple[Array, Array]:
    free = task.config.num_obstacles
    return record["discs"][:free].copy(), record["radii"][:free].copy()


CARD = TaskCard(
    metrics=(
        Metric("collision", "collided (%)"),
        Metric("time_to_goal", "to goal (s)", primary=True),
        Metric("min_clearance", "clearance (mm)", 1e3, lower_is_better=False),
    ),
    experts={
        "dpct": lambda task: PlanningExpert(task, time_along_line, REPLAN_EVERY),
        "lagrange": lambda task: PlanningExpert(task, pass_via_nodes, REPLAN_EVERY),
        "apf": DodgingExpert,
        "follower": lambda task: PlanningExpert(task, partial(trapezoid.plan, contact="delay")),
    },
    control_modes=("torque", "acceleration", "velocity"),
    replan_every=REPLAN_EVERY,
    bound=Bound(
        "time_to_goal",
        "the best motion found that knows the whole paths of the discs, played in the environment; for other starts "
        "and settings than the stored ones, that of a search with half of the acceleration",
        time_to_goal,
        lower_bound,
    ),
    links=(2,),
    recipe="ppo/ObstacleDodge-v0",
    # The radius is the same unless chosen; nothing is held until the goal is reached.
    constant_entries=frozenset({"obstacle_radius", "held"}),
    picture=Picture(
        "clearance between arm and disc (mm)",
        measure=lambda record: 1e3 * float(record["clearance"]),
        outcome=_outcome,
        target=lambda task, record: record["goal"].copy(),
        discs=_discs,
        second_arm=lambda task, record: task.second_arm(record),
        arrival="time_to_goal",
    ),
    controls=CONTROLS,
    levels=LEVELS,
)
"""What other packages need to know of ObstacleDodge-v0."""
