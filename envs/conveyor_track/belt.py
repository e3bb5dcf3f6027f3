"""Where the belt of ConveyorTrack runs for an arm, the starts of episodes there, and whether DPCT can solve one."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from envs.arms import quickness
from planners import SCARA_1M, Arm, Infeasible, MotionProblem, MovingHand, UnreachableTarget, dpct
from planners.robot.kinematics import turned_towards
from planners.typing import Array


class Start(NamedTuple):
    """Start of an episode: belt speed (m/s), D of eq 2 (m), y of the line (m), x of the hand (m), sign of the elbow.

    Positions are from the base of the arm; ``beside`` is y of the hand less that of the line, m.
    """

    belt_speed: float
    offset: float
    line_height: float
    hand_x: float
    elbow: float
    beside: float = 0.0

    @property
    def hand(self) -> Array:
        """Position of the hand from the base, ``(2,)``, m."""
        return np.array([self.hand_x, self.line_height + self.beside])


PAPER_START = Start(belt_speed=0.2, offset=0.1, line_height=1.732, hand_x=-0.8, elbow=1.0)
"""Section 5.1 of the paper: hand at (-0.8, 1.732) m, part at (-0.9, 1.732) m, belt 0.2 m/s."""

RANGES = {"belt_speed": (0.05, 0.25), "offset": (-0.2, 0.2), "line_height": (1.5, 1.8), "hand_x": (-0.8, -0.3)}
"""Ranges of random starts for the paper's arm, SI units."""

FARTHEST_RIDE = 1.2
"""Longest way of the belt during an episode, m, for the paper's arm."""

SLOWEST_PACE = 1.0 / 16.0


class Demands(NamedTuple):
    """The environment of a start, which must be settled ``hold_time`` before ``horizon``; SI units."""

    horizon: float
    hold_time: float
    belt_acceleration: float = 0.0
    payload: float = 0.0
    arm: Arm = SCARA_1M

    @property
    def in_table(self) -> bool:
        """Whether the stored table holds for this environment."""
        return self.belt_acceleration == 0.0 and self.payload == 0.0 and self.arm == SCARA_1M


def unit(arm: Arm) -> float:
    """What is 1 m for the paper's arm: half of the reach of the first two links, m."""
    return 0.5 * (arm.lengths[0] + arm.lengths[1])


def side(arm: Arm) -> float:
    """1 where the belt runs above the base, -1 below: the side to which joint 1 can turn further."""
    return math.copysign(1.0, float(arm.limits.angle_middle[0]) + 0.0)


def orientation(arm: Arm) -> float | None:
    """Angle of the third link, rad: across the belt, away from the base. DPCT keeps it on its way."""
    return side(arm) * 0.5 * math.pi if arm.n_joints == 3 else None


def placed(arm: Arm, start: Start, pace: float = 1.0) -> Start:
    """A start of the paper's arm for another one: lengths in its `unit`, the line as far beyond the third link."""
    length, lift = unit(arm), arm.lengths[2] if arm.n_joints == 3 else 0.0
    height = side(arm) * (length * start.line_height + lift)
    return Start(pace * length * start.belt_speed, length * start.offset, height, length * start.hand_x, start.elbow)


def pace_of(demands: Demands) -> float:
    """How fast the belt is for an arm, compared with the paper's, so that the arm can catch up and ride to the end."""
    farthest = FARTHEST_RIDE / (RANGES["belt_speed"][1] * demands.horizon)
    return max(SLOWEST_PACE, min(quickness(demands.arm.with_payload(demands.payload), SCARA_1M), farthest))


def axes_of(demands: Demands, pace: float, nodes: tuple[int, int, int, int]) -> dict[str, Array]:
    """Nodes of a grid of starts; offsets shrink with the pace too where it is below 1."""
    ends = zip(*RANGES.values(), strict=True)
    low, high = (placed(demands.arm, Start._make([*end, 1.0, 0.0]), pace) for end in ends)
    near = min(1.0, pace)
    low, high = (one._replace(offset=near * one.offset) for one in (low, high))
    return {
        name: np.linspace(getattr(low, name), getattr(high, name), count)
        for name, count in zip(RANGES, nodes, strict=True)
    }


def posture(arm: Arm, start: Start) -> Array:
    """Joint angles at a start, ``(n,)``, rad, in whole turns closest to the middle of the joint ranges.

    Raises:
        UnreachableTarget: if the hand cannot reach its start.
    """
    hand = start.hand + arm.base_array
    q = arm.inverse_kinematics(hand, orientation(arm))[0 if start.elbow > 0.0 else 1]
    turned: Array = turned_towards(q, arm.limits.angle_middle)
    return turned


def problem_of(start: Start, demands: Demands) -> MotionProblem:
    """The planning problem that a start poses.

    Raises:
        UnreachableTarget: if the hand cannot reach its start.
    """
    arm = demands.arm
    ahead = np.array([start.hand_x, start.line_height]) + arm.base_array
    return MotionProblem(
        arm=arm,
        q=posture(arm, start),
        target=MovingHand(
            position=ahead - [start.offset, 0.0],
            velocity=np.array([start.belt_speed, 0.0]),
            acceleration=np.array([demands.belt_acceleration, 0.0]),
        ),
        horizon=demands.horizon,
        payload=demands.payload,
    )


def why_unsolvable(start: Start, demands: Demands) -> str | None:
    """DPCT's reason why a start cannot be solved within all limits in time, or None if it can."""
    return _why_unsolvable(start, demands, "free" if start.beside else "optimal")


@lru_cache(maxsize=1024)
def _why_unsolvable(start: Start, demands: Demands, variant: dpct.Variant) -> str | None:
    if not all(math.isfinite(value) for value in start):
        return f"{start} is not finite"
    try:
        plan = dpct.plan(problem_of(start, demands), variant=variant)
    except (Infeasible, UnreachableTarget) as error:
        return str(error)
    latest = demands.horizon - demands.hold_time
    if plan.rendezvous_time > latest:
        return (
            f"late: the part can be met after {plan.rendezvous_time:.3f} s at the earliest, but must be met within "
            f"{latest:g} s of the episode's {demands.horizon:g} s; raise horizon, or choose another offset"
        )
    if plan.rides_until < demands.horizon:
        return (
            f"late: within the limits the hand can follow the part until {plan.rides_until:.3f} s only, but the "
            f"episode lasts {demands.horizon:g} s; lower horizon or belt_speed, or move hand_x against the belt"
        )
    return None


def require_solvable(start: Start, demands: Demands) -> None:
    """Raise a ValueError with DPCT's reason if a start cannot be solved, on the belt's line or beside it."""
    # the expert's variant comes first, so that no other one has to be compiled
    reason = None if _why_unsolvable(start, demands, "free") is None else why_unsolvable(start, demands)
    if reason is not None:
        raise ValueError(f"no motion within the joint limits solves {start._asdict()}: {reason}")
