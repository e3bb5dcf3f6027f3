"""The excavator attachment: its parameters, its kinematics and its dynamics.

The five-joint chain of "A Study on Motion Control and Kinematics Analysis of Articulated Manipulator Attachment for
Excavator" (2019). SI units and radians throughout.
"""

from planners.excavator.inverse import BRANCH_NAMES, Branches, IKStatus, inverse_kinematics
from planners.excavator.kinematics import forward_kinematics, frames, jacobian, jacobian_determinant
from planners.excavator.machine import EXCAVATOR, ChainGeometry, Excavator, Link, PayloadShape

__all__ = [
    "BRANCH_NAMES",
    "EXCAVATOR",
    "Branches",
    "ChainGeometry",
    "Excavator",
    "IKStatus",
    "Link",
    "PayloadShape",
    "forward_kinematics",
    "frames",
    "inverse_kinematics",
    "jacobian",
    "jacobian_determinant",
]
