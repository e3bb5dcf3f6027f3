"""How ObstacleDodge grows with an arm: lengths with its reach, times with how slowly it turns.

The task of another arm is that of its own arm in other units: of length for all positions, radii and distances, and of
time, for slower arms, for the motion of the discs and the horizon.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from envs.arms import quickness, require_limits
from envs.obstacle_dodge.paths import PATH_STEP
from planners import SCARA_50CM, Arm

THICKEST = 0.18
"""Largest radius of the links, as a share of the reach: thicker ones leave no room for discs."""

SLOWEST = 7.5
"""Largest unit of time: episodes last up to 60 s."""


class Scale(NamedTuple):
    """Units of an arm: 1 for the task's own arm.

    Attributes:
        length: in units of m.
        time: in units of s; a multiple of 1/2.
    """

    length: float
    time: float

    @property
    def path_step(self) -> float:
        """Time between two samples of the path of a disc, s."""
        return PATH_STEP * self.time


def scale_of_task(arm: Arm) -> Scale:
    """The units of an arm.

    Raises:
        ValueError: if the task cannot bear the arm, with the reason.
    """
    require_limits(arm, ["torque", "velocity", "acceleration"], "ObstacleDodge-v0")
    if arm.link_radius > THICKEST * arm.reach:
        raise ValueError(
            f"the links of {arm.name} have a radius of {arm.link_radius:g} m, more than {THICKEST:g} of its reach of "
            f"{arm.reach:g} m; ObstacleDodge-v0 needs room between arm and discs"
        )
    time = 0.5 * math.ceil(2.0 / quickness(arm, SCARA_50CM) - 0.5)
    if time > SLOWEST:
        raise ValueError(
            f"{arm.name} turns {time:.0f} times more slowly than {SCARA_50CM.name}; ObstacleDodge-v0 needs larger "
            "limits of velocity, acceleration and torque"
        )
    return Scale(arm.reach / SCARA_50CM.reach, max(1.0, time))
