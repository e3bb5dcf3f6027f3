"""The arms of the papers, by name."""

from __future__ import annotations

import math

from planners.robot.arm import Arm, JointLimits

SCARA_1M = Arm(
    name="SCARA_1M",
    lengths=(1.0, 1.0),
    masses=(1.0, 1.0),
    limits=JointLimits(torque=(0.5, 0.2), velocity=(0.2, 0.2), acceleration=(0.3, 0.3), jerk=(2.3, 2.0)),
)
"""Two uniform rods of 1 m and 1 kg in the horizontal plane, limits of the conveyor-tracking paper (eq 36, 37)."""

PLANAR_3R = Arm(
    name="PLANAR_3R",
    lengths=(0.2, 0.4, 0.2),
    masses=(1.0, 2.0, 1.0),
    limits=JointLimits(torque=(20.0, 10.0, 5.0), angle=(math.inf, math.radians(150.0), math.radians(150.0))),
)
"""Three uniform rods of 0.2, 0.4 and 0.2 m, 1, 2 and 1 kg: the arm of the minimal-torque paper."""

SCARA_50CM = Arm(
    name="SCARA_50CM",
    lengths=(0.5, 0.5),
    masses=(2.0, 2.0),
    limits=JointLimits(torque=(10.0, 4.0), velocity=(2.4, 2.4), acceleration=(9.0, 16.0), angle=(2.88, 2.62)),
    link_radius=0.045,
)
"""Two uniform rods of 0.5 m and 2 kg in the horizontal plane: the arm of ObstacleDodge. Its planners
use half of the acceleration limits; the other half is left for evading."""

PRESETS = {arm.name: arm for arm in (SCARA_1M, PLANAR_3R, SCARA_50CM)}
"""The arms of the papers by their names."""
