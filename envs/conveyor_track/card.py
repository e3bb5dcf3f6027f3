"""The card of ConveyorTrack-v0."""

from __future__ import annotations

import math

from envs.best_known import lower_bound
from envs.card import Bound, Info, Metric, Picture, TaskCard
from envs.conveyor_track.bound import settling_time
from envs.conveyor_track.controls import CONTROLS
from envs.conveyor_track.experts import settle_early
from envs.conveyor_track.levels import LEVELS
from envs.experts.planning import PlanningExpert
from envs.experts.reactive import FollowerExpert, MovingTargetExpert
from envs.physics.actuation import CONTROL_MODES
from planners import lagrange


def _outcome(info: Info, duration: float) -> str:
    if math.isfinite(info["settling_time"]):
        late = "" if info.get("is_success", True) else ", too late to be held"
        return f"settled at {info['settling_time']:.2f} s{late}"
    return f"not settled after {duration:.1f} s"


CARD = TaskCard(
    metrics=(
        Metric("settling_time", "settled (s)", primary=True),
        Metric("steady_state_error", "error (mm)", 1e3),
    ),
    experts={
        "dpct": lambda task: PlanningExpert(task, settle_early(task)),
        "lagrange": lambda task: PlanningExpert(task, lagrange.plan),
        "apf": lambda task: MovingTargetExpert(task, task.hand_goal),
        "follower": lambda task: FollowerExpert(task, task.hand_goal),
    },
    control_modes=CONTROL_MODES,
    bound=Bound(
        "settling_time",
        "settling time of the best motion found, played in the environment; for other starts and settings than the "
        "stored ones, of dpct's plan or of the best motion with the hand on the belt's line",
        settling_time,
        lower_bound,
    ),
    links=(2, 3),
    recipe="ppo/ConveyorTrack-v0",
    # The belt's acceleration is 0 unless configured; nothing is settled until the part is met.
    constant_entries=frozenset({"part_acceleration", "settled"}),
    picture=Picture(
        "distance from hand to part (mm)",
        measure=lambda record: 1e3 * float(record["error"]),
        outcome=_outcome,
        target=lambda task, record: record["part_position"].copy(),
        arrival="settling_time",
        logarithmic=True,
        tolerance="position_tolerance",
        belt=True,
    ),
    controls=CONTROLS,
    levels=LEVELS,
)
"""What other packages need to know of ConveyorTrack-v0."""
