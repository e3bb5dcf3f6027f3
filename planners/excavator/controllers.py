"""The controllers of :mod:`planners.control` with gains for the excavator attachment, whole or in one plane."""

from __future__ import annotations

import numpy as np

from planners.checks import require_choice
from planners.control import (
    AdaptiveComputedTorque,
    AdaptiveController,
    ComputedTorque,
    Controller,
    ControlSettings,
    IntegralComputedTorque,
    IntegralSlotineLi,
    PayloadPrior,
    PDGravity,
    SlotineLi,
)
from planners.excavator.dynamics import ChainDynamics, PayloadModel, payload_basis
from planners.excavator.machine import EXCAVATOR, Excavator
from planners.excavator.motion import WORK_CYCLE
from planners.excavator.plane import JOINTS, planar_model

FIXED: dict[str, type[Controller]] = {
    "pd-gravity": PDGravity,
    "computed-torque": ComputedTorque,
    "integral-computed-torque": IntegralComputedTorque,
}
"""Controllers that assume an empty tool."""

ADAPTIVE: dict[str, tuple[type[AdaptiveController], float]] = {
    "adaptive-computed-torque": (AdaptiveComputedTorque, 1e5),
    "slotine-li": (SlotineLi, 100.0),
    "integral-slotine-li": (IntegralSlotineLi, 100.0),
}
"""Controllers that estimate the payload, and the gain of its mass."""

DEFAULT = "integral-slotine-li"

BANDWIDTH = (6.0, 6.0, 6.0, 8.0, 8.0)
"""Of the joints, 1/s."""
HEAVIEST, FARTHEST = 500.0, 0.2
"""Bounds of the estimate: mass, kg, and shift of its centre, m."""
MOMENT_GAIN = 0.1
"""Gain of the first moments, as a share of that of the mass, 1/m^2."""

PLANAR_GAIN_SHARE = {"adaptive-computed-torque": 0.1}
"""Factors on the gains of laws in the plane: without the inertia of drives the loop through ``M^-1`` is faster."""

TYPICAL_PAYLOAD = 175.0
"""Payload for which motions are planned and the planar gains are scaled, kg; it quadruples the bucket's inertia."""
TYPICAL_POSTURE = (20.0, -75.0, 25.0)
"""Posture of boom, arm and bucket for which the planar gains are scaled, deg."""


def make_controller(
    name: str = DEFAULT,
    *,
    planar: bool = False,
    moments: bool = True,
    rows: int = 1,
    period: float | None = None,
    machine: Excavator = EXCAVATOR,
) -> Controller:
    """A controller of the attachment that starts with an empty tool.

    Args:
        name: of `FIXED` or `ADAPTIVE`; another raises ValueError.
        planar: control boom, arm and bucket alone, see :mod:`planners.excavator.plane`.
        moments: also estimate the shift of the payload's centre; ignored by a fixed controller.
        rows: size of the batch.
        period: between two samples, s; 5 ms when left out, in the plane 20 ms.
        machine: the attachment as the controller knows it.
    """
    require_choice("controller", name, [*FIXED, *ADAPTIVE])
    moments = moments and name in ADAPTIVE
    if planar:
        joints, posture, typical = JOINTS, np.radians([TYPICAL_POSTURE]), TYPICAL_PAYLOAD
        model = planar_model(machine, moments=moments)
    else:
        joints, posture, typical = slice(None), WORK_CYCLE.postures.mean(axis=0, keepdims=True), 0.0
        model = PayloadModel(ChainDynamics.of_excavator(machine), payload_basis(machine, moments=moments))
    n_moments = model.n_parameters - 1
    settings = ControlSettings(
        period=(0.02 if planar else 0.005) if period is None else period,
        bandwidth=np.array(BANDWIDTH[joints]),
        inertia=np.diag(model.mass_matrix(posture, np.array([[typical, *n_moments * [0.0]]]))[0]).copy(),
        torque_limit=np.array(machine.limits.torque[joints]),
    )
    upper = np.array([HEAVIEST, *n_moments * [HEAVIEST * FARTHEST]])
    prior = PayloadPrior(initial=np.zeros_like(upper), lower=np.array([0.0, *-upper[1:]]), upper=upper)
    if name in FIXED:
        return FIXED[name](model, settings, prior, rows)
    kind, gain = ADAPTIVE[name]
    share = PLANAR_GAIN_SHARE.get(name, 1.0) if planar else 1.0
    return kind(model, settings, prior, share * gain * np.array([1.0, *n_moments * [MOMENT_GAIN]]), rows)
