"""From a reference motion to joint torques.

:mod:`planners.control.tracking` follows with a model that is right: computed torque, in continuous and in sampled form.
The controllers of :mod:`planners.control.fixed` and :mod:`planners.control.adaptive` follow with a payload that is not
known; all have the interface of `Controller`, over any `ArmModel`, for many rows at once.
"""

from planners.control.adaptive import AdaptiveComputedTorque, AdaptiveController, IntegralSlotineLi, SlotineLi
from planners.control.controller import Controller, ControlSettings, PayloadPrior, Sample
from planners.control.fixed import ComputedTorque, IntegralComputedTorque, PDGravity
from planners.control.model import ArmModel
from planners.control.payload_estimation import PayloadScale, Weighing
from planners.control.planar import PlanarArmModel
from planners.control.tracking import (
    Gains,
    computed_torque,
    held_torque,
    held_torque_single,
    share_within,
    tracking_acceleration,
    within_torque,
)

__all__ = [
    "AdaptiveComputedTorque",
    "AdaptiveController",
    "ArmModel",
    "ComputedTorque",
    "ControlSettings",
    "Controller",
    "Gains",
    "IntegralComputedTorque",
    "IntegralSlotineLi",
    "PDGravity",
    "PayloadPrior",
    "PayloadScale",
    "PlanarArmModel",
    "Sample",
    "SlotineLi",
    "Weighing",
    "computed_torque",
    "held_torque",
    "held_torque_single",
    "share_within",
    "tracking_acceleration",
    "within_torque",
]
