"""The controllers of :mod:`planners.control` with gains for the excavator attachment, whole or in one plane."""

from __future__ import annotations

import numpy as np

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
"""Controllers that take the tool for empty."""

ADAPTIVE: dict[str, tuple[type[AdaptiveController], float]] = {
    "adaptive-computed-torque": (AdaptiveComputedTorque, 1e5),
    "slotine-li": (SlotineLi, 100.0),
    "integral-slotine-li": (IntegralSlotineLi, 100.0),
}
"""Controllers that learn the payload, and the gain of its mass."""

DEFAULT = "integral-slotine-li"

BANDWIDTH = (6.0, 6.0, 6.0, 8.0, 8.0)
"""Of the joints, 1/s."""
HEAVIEST, FARTHEST = 500.0, 0.2
"""Bounds of the estimate: mass, kg, and shift of its centre, m."""
MOMENT_GAIN = 0.1
"""Gain of the first moments, as a share of that of the mass, 1/m^2."""

PLANAR_GAIN_SHARE = {"adaptive-computed-torque": 0.1}
"""Factor on the gain of a law, where it is not 1: with no inertia of drives the loop through ``M^-1`` is faster."""

TYPICAL_PAYLOAD = 175.0
"""For which motions are planned, and the gains of boom, arm and bucket scaled, kg: it makes the bucket four times as
hard to turn."""
TYPICAL_POSTURE = (20.0, -75.0, 25.0)
"""Of boom, arm and bucket, for the same purpose, deg."""


def make_controller(
    name: str = DEFAULT,
    *,
    moments: bool = True,
    rows: int = 1,
    period: float = 0.005,
    machine: Excavator = EXCAVATOR,
) -> Controller:
    """A controller of the attachment that begins with an empty tool.

    Args:
        name: of `FIXED` or `ADAPTIVE`.
        moments: learn how far the payload's centre is off, too, not the mass alone; nothing to a fixed controller.
        rows: how many arms.
        period: between two samples, s.
        machine: the attachment as the controller knows it.

    Raises:
        ValueError: if the name is unknown.
    """
    dynamics = ChainDynamics.of_excavator(machine)
    model = PayloadModel(dynamics, payload_basis(machine, moments=moments and name in ADAPTIVE))
    posture = WORK_CYCLE.postures.mean(axis=0, keepdims=True)
    settings = ControlSettings(
        period=period,
        bandwidth=np.array(BANDWIDTH),
        inertia=np.diag(dynamics.mass_matrix(posture)[0]).copy(),
        torque_limit=machine.torque_limit_array,
    )
    return _make(name, model, settings, rows)


def make_planar_controller(
    name: str = DEFAULT,
    *,
    moments: bool = True,
    rows: int = 1,
    period: float = 0.02,
    machine: Excavator = EXCAVATOR,
) -> Controller:
    """A controller of boom, arm and bucket alone; arguments and errors are those of `make_controller`."""
    model = planar_model(machine, moments=moments and name in ADAPTIVE)
    load = np.zeros((1, model.n_parameters))
    load[:, 0] = TYPICAL_PAYLOAD
    settings = ControlSettings(
        period=period,
        bandwidth=np.array(BANDWIDTH[JOINTS]),
        inertia=np.diag(model.mass_matrix(np.radians([TYPICAL_POSTURE]), load)[0]).copy(),
        torque_limit=machine.torque_limit_array[JOINTS],
    )
    return _make(name, model, settings, rows, PLANAR_GAIN_SHARE.get(name, 1.0))


def _make(name: str, model: PayloadModel, settings: ControlSettings, rows: int, gain_share: float = 1.0) -> Controller:
    upper = np.array([HEAVIEST, *(model.n_parameters - 1) * [HEAVIEST * FARTHEST]])
    prior = PayloadPrior(initial=np.zeros_like(upper), lower=np.array([0.0, *-upper[1:]]), upper=upper)
    if name in FIXED:
        return FIXED[name](model, settings, prior, rows)
    if name not in ADAPTIVE:
        raise ValueError(f"controller {name!r} must be one of {', '.join(map(repr, [*FIXED, *ADAPTIVE]))}")
    kind, gain = ADAPTIVE[name]
    gains = gain_share * gain * np.array([1.0, *(model.n_parameters - 1) * [MOMENT_GAIN]])
    return kind(model, settings, prior, gains, rows)
