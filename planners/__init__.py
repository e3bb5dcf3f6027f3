"""Robots and mathematics: arms, kinematics, dynamics, control and the classical motion planners.

Independent of Gymnasium. SI units and radians; joint angles are relative and counter-clockwise. ``hand`` is the end
effector of an arm, ``q, qd, qdd, tau`` are joint angles, velocities, accelerations and torques.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

import planners.compile_cache
import planners.compiled.faster  # noqa: F401  (both before any compiled function)
from planners.capabilities import plan, register
from planners.problem import FixedHand, FixedJoints, Infeasible, MotionProblem, MovingHand, Obstacle
from planners.robot.arm import Arm, JointLimits
from planners.robot.arm_files import arm_document, arm_names, load_arm
from planners.robot.kinematics import UnreachableTarget
from planners.robot.presets import PLANAR_3R, SCARA_1M, SCARA_50CM
from planners.trajectory import Trajectory, sampled_trajectory

if TYPE_CHECKING:
    from planners import apf, control, dpct, lagrange, quintic, trapezoid

__all__ = [
    "PLANAR_3R",
    "SCARA_1M",
    "SCARA_50CM",
    "Arm",
    "FixedHand",
    "FixedJoints",
    "Infeasible",
    "JointLimits",
    "MotionProblem",
    "MovingHand",
    "Obstacle",
    "Trajectory",
    "UnreachableTarget",
    "apf",
    "arm_document",
    "arm_names",
    "control",
    "dpct",
    "lagrange",
    "load_arm",
    "plan",
    "quintic",
    "register",
    "sampled_trajectory",
    "trapezoid",
]


def __dir__() -> list[str]:
    return [*globals(), *__all__]


def __getattr__(name: str) -> Any:
    if name in ("apf", "control", "dpct", "lagrange", "quintic", "trapezoid"):  # an environment needs one of them
        return import_module(f"planners.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
