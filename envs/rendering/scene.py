"""The content of a frame, in physical units."""

from __future__ import annotations

from dataclasses import dataclass

from planners.typing import Array


@dataclass(frozen=True, eq=False)
class Belt:
    """A conveyor belt.

    Attributes:
        start: start of its centre line, ``(2,)``, m.
        end: end of its centre line, in the direction of motion, ``(2,)``, m.
        travel: distance moved so far, m.
        width: m.
    """

    start: Array
    end: Array
    travel: float = 0.0
    width: float = 0.26


@dataclass(frozen=True, eq=False)
class Scene:
    """Content of one frame; parts left at None are not drawn.

    Attributes:
        joints: positions of the joints from the base on, and of the hand, ``(n + 1, 2)``, m.
        torque_ratios: torque over limit of each joint, signed, ``(n,)``.
        time: since the start of the episode, s.
        horizon: length of the episode, s.
        title: headline of the side panel.
        part: position of the part, ``(2,)``, m.
        settled: whether the task is solved: the part turns green and the gripper closes.
        belt: the conveyor.
        trail: past hand positions, newest last, ``(k, 2)``, m.
        target: position to reach, ``(2,)``, m.
        obstacles: discs ``(x, y, radius)``, m.
        second_arm: joints and hand of an arm to avoid, ``(x, y, radius of the link)``, m, from its base on.
        status: lines of (label, value with its unit, whether it is good).
        bucket: fill of the bucket at the end of the arm, 0 to 1; a gripper if None.
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
    second_arm: tuple[tuple[float, float, float], ...] = ()
    status: tuple[tuple[str, str, bool], ...] = ()
    bucket: float | None = None
    ground: float | None = None
    limit_gauges: tuple[tuple[str, float], ...] = ()
