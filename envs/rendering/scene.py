"""What a frame shows, in physical units, without a word about pixels."""

from __future__ import annotations

from dataclasses import dataclass

from planners.typing import Array


@dataclass(frozen=True, eq=False)
class Belt:
    """A conveyor belt.

    Attributes:
        start: where its centre line begins, ``(2,)``, m.
        end: where it ends, in the direction the belt moves, ``(2,)``, m.
        travel: how far the belt has moved so far, m.
        width: m.
    """

    start: Array
    end: Array
    travel: float = 0.0
    width: float = 0.26


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything one frame shows; what is left out is not drawn.

    Attributes:
        joints: positions of the joints from the base on, and of the hand, ``(n + 1, 2)``, m.
        torque_ratios: torque over limit of each joint, signed, ``(n,)``.
        time: since the start of the episode, s.
        horizon: when the episode ends, s.
        title: headline of the side panel.
        part: position of the part, ``(2,)``, m.
        settled: whether the task is fulfilled: the part turns green and the gripper closes.
        belt: the conveyor.
        trail: past hand positions, newest last, ``(k, 2)``, m.
        target: position to reach, ``(2,)``, m.
        obstacles: discs ``(x, y, radius)``, m.
        status: lines of (label, value with its unit, whether it is good).
        bucket: how full the bucket is that the arm ends in, 0 to 1; a gripper when left out.
        ground: height of the ground, for an arm that moves in a vertical plane, m.
        limit_gauges: bars of (label, value over limit); red past 1.
    """

    joints: Array
    torque_ratios: Array
    time: float
    horizon: float
    title: str = ""
    part: Array | None = None
    settled: bool = False
    belt: Belt | None = None
    trail: Array | None = None
    target: Array | None = None
    obstacles: tuple[tuple[float, float, float], ...] = ()
    status: tuple[tuple[str, str, bool], ...] = ()
    bucket: float | None = None
    ground: float | None = None
    limit_gauges: tuple[tuple[str, float], ...] = ()
