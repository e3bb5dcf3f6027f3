"""Control: from a reference motion to joint torques.

:mod:`planners.control.tracking` tracks a sampled reference with a known arm; :mod:`planners.control.joint_limits` keeps
its accelerations within the joint limits. The controllers of :mod:`planners.control.laws` track
with an unknown payload: batched, over any `ArmModel`.
"""

from planners.control.controller import Controller, ControlSettings, PayloadPrior
from planners.control.joint_limits import within_torque
from planners.control.laws import (
    AdaptiveComputedTorque,
    AdaptiveController,
    ComputedTorque,
    IntegralComputedTorque,
    IntegralSlotineLi,
    PDGravity,
    SlotineLi,
)
from planners.control.model import ArmModel, PlanarArmModel
from planners.control.observer import ArmObserver, Estimate
from planners.control.observer_settings import ObserverSettings
from planners.control.payload_estimation import LeastSquaresSums, PayloadEstimator
from planners.control.tracking import Gains, held_torque, tracking_acceleration

__all__ = [
    "AdaptiveComputedTorque",
    "AdaptiveController",
    "ArmModel",
    "ArmObserver",
    "ComputedTorque",
    "ControlSettings",
    "Controller",
    "Estimate",
    "Gains",
    "IntegralComputedTorque",
    "IntegralSlotineLi",
    "LeastSquaresSums",
    "ObserverSettings",
    "PDGravity",
    "PayloadEstimator",
    "PayloadPrior",
    "PlanarArmModel",
    "SlotineLi",
    "held_torque",
    "tracking_acceleration",
    "within_torque",
]
