"""How ObstacleDodge grows with an arm: lengths with its reach, times with how slowly it turns.

The task of another arm is that of its own arm in other units: of length for all positions, radii and distances, and of
time, for slower arms, for the motion of the discs and the horizon. So an agent sees it in the same numbers.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from envs.arms import angle_bound, quickness, require_limits, scale_of
from envs.observation import Entry, Layout
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


def layout_of(arm: Arm, discs: int) -> Layout:
    """What an observation of ObstacleDodge-v0 holds with an arm and room for some discs; scales follow from the arm."""
    length, time = scale_of_task(arm)
    pace = length / time
    turning, urging = (scale_of(arm, kind, SCARA_50CM) for kind in ("velocity", "acceleration"))
    return Layout(
        (
            Entry("joint_position", (2,), math.pi, angle_bound(arm), "rad", "angles of the joints"),
            Entry("joint_velocity", (2,), 2.4 * turning, 10.0, "rad/s", "their velocities"),
            Entry(
                "joint_acceleration",
                (2,),
                10.0 * urging,
                20.0,
                "rad/s^2",
                "their mean accelerations over the last period",
            ),
            Entry("hand", (2,), length, 2.0, "m", "position of the hand, from the base"),
            Entry("goal", (2,), length, 2.0, "m", "position to reach, from the base"),
            Entry("goal_error", (2,), length, 4.0, "m", "from the hand to the goal"),
            Entry("obstacle", (discs, 2), length, 10.0, "m", "position of each disc, from the base"),
            Entry("obstacle_velocity", (discs, 2), pace, 10.0, "m/s", "velocity of each disc"),
            Entry("obstacle_radius", (discs,), 0.1 * length, 10.0, "m", "radius of each disc"),
            Entry(
                "posture_error", (2, 2), 1.0, 8.0, "rad", "from the joints to both postures with the hand at the goal"
            ),
            Entry(
                "obstacle_in_link",
                (discs, 2, 2),
                length,
                10.0,
                "m",
                "position of each disc, in the frame of each link",
            ),
            Entry(
                "obstacle_velocity_in_link", (discs, 2, 2), pace, 10.0, "m/s", "velocity along the axes of each link"
            ),
            Entry(
                "obstacle_acceleration",
                (discs, 2),
                10.0 * pace / time,
                2.0,
                "m/s^2",
                "of each disc, along the axes of link 1",
            ),
            Entry(
                "link_clearance",
                (discs, 2),
                0.5 * length,
                10.0,
                "m",
                "between the surfaces of each link and each disc",
            ),
            Entry("clearance", (), 0.5 * length, 10.0, "m", "between the surfaces of the arm and the nearest disc"),
            Entry("time_left", (), 8.0 * time, 10.0, "s", "until the episode ends"),
            Entry("held", (), 1.0, 1.0, "-", "share of the hold time for which the hand has been at the goal"),
        )
    )
