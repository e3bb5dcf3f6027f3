"""What a spectator may change of ExcavatorPayload while it runs: the payload, and the friction of the joints."""

from __future__ import annotations

from typing import Any

from envs.card import Control
from envs.excavator_payload.hidden import FRICTION_SCALE, payload_inertia
from envs.excavator_payload.reference import HEAVIEST


def _set_payload(task: Any, record: Any, mass: float) -> bool:
    record["payload"], record["payload_inertia"] = mass, payload_inertia(mass)
    if record["step"] >= record["pick_step"]:  # otherwise it is picked up when that was due
        record["pick_step"] = max(1, record["step"])
    return True


def _set_friction(task: Any, record: Any, scale: float) -> bool:
    record["friction_scale"] = scale
    return True


CONTROLS = (
    Control(
        "payload",
        "payload (kg)",
        lambda task, record: float(record["payload"]),
        _set_payload,
        span=(0.0, HEAVIEST),
        replans=False,
    ),
    Control(
        "friction",
        "friction (share of the nominal)",
        lambda task, record: float(record["friction_scale"]),
        _set_friction,
        span=(0.0, 2.0 * FRICTION_SCALE[1]),
        replans=False,
    ),
)
"""The controls of ExcavatorPayload-v0."""
