"""The card of ExcavatorPayload-v0."""

from __future__ import annotations

import math
from functools import partial

from envs.card import Bound, Info, Metric, Picture, TaskCard
from envs.excavator_payload.bound import known_payload_tip_rms
from envs.excavator_payload.controls import CONTROLS
from envs.excavator_payload.experts import KALMAN, PayloadExpert
from envs.excavator_payload.levels import LEVELS


def _outcome(info: Info, duration: float) -> str:
    if math.isfinite(info["tip_rms"]):
        return f"tip error {1e3 * info['tip_rms']:.1f} mm RMS,\n{1e3 * info['tip_max']:.1f} mm at worst"
    return f"ended at {duration:.1f} s: a joint out of range or too fast"


CARD = TaskCard(
    metrics=(
        Metric("success_easy", "easy (%)", lower_is_better=False),
        Metric("tip_rms", "tip RMS (mm)", 1e3, primary=True),
        Metric("tip_max", "tip worst (mm)", 1e3),
        Metric("waypoint_error", "at waypoints (mm)", 1e3),
    ),
    experts={
        # No planners: the reference is given, and any other motion fails the task.
        "kalman": partial(PayloadExpert, controller=KALMAN),
        "adaptive": PayloadExpert,
        "adaptive_computed_torque": partial(PayloadExpert, controller="adaptive-computed-torque", moments=False),
        "integral_computed_torque": partial(PayloadExpert, controller="integral-computed-torque"),
        "computed_torque": partial(PayloadExpert, controller="computed-torque"),
    },
    control_modes=("torque", "residual", "estimated"),
    bound=Bound(
        "tip_rms",
        "kalman's controller with payload and friction given: what noise and period leave",
        known_payload_tip_rms,
        of_motions=False,
    ),
    recipe="ppo/ExcavatorPayload-v0",
    picture=Picture(
        "distance from tip to reference (mm)",
        measure=lambda record: 1e3 * float(record["tip_error"]),
        outcome=_outcome,
        target=lambda task, record: record["wanted_tip"].copy(),
        logarithmic=True,
    ),
    controls=CONTROLS,
    levels=LEVELS,
)
"""What other packages need to know of ExcavatorPayload-v0."""
