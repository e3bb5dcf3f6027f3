"""Starts of ObstacleDodge-v0: posture, goal and the paths of the discs, drawn or given."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from envs.obstacle_dodge.paths import FASTEST, KINDS, Kind, draw_path, follow_points, straight_move
from envs.obstacle_dodge.scale import Scale
from envs.settings import Settings
from planners import Arm, JointLimits
from planners.robot.kinematics import turned_towards
from planners.typing import Array

Pair = tuple[float, float]

LEAST_ELBOW, LEAST_DISTANCE = 0.3, 0.4
"""Least drawn magnitude of the elbow angle, rad, and distance from the hand to its goal, m, for the task's own
arm."""


class ObstacleDodgeOptions(Settings):
    """Options of ``reset``: what is left out is drawn (``"random"``) or a fixed crossing (``"paper"``).

    Attributes:
        scenario: ``"random"``, or ``"paper"``: one disc crosses the path of the hand, as in the paper's figure 3.
        start: joint angles at the start, rad.
        goal: position of the hand to reach, m from the base.
        obstacle_kind: ``"waypoints"``, ``"passes"`` or ``"wander"``, for every disc.
        obstacle_speed: speed of every disc, m/s.
        obstacle_radius: radius of every disc, m.
        obstacle_paths: for each disc the points, m from the base, between which it moves at constant speed; it stays
            at the last one.
    """

    scenario: Literal["random", "paper"] = "random"
    start: Pair | None = None
    goal: Pair | None = None
    obstacle_kind: Kind | None = None
    obstacle_speed: float | None = Field(None, gt=0.0, le=5.0)
    obstacle_radius: float | None = Field(None, gt=0.0, le=0.3)
    obstacle_paths: tuple[Annotated[tuple[Pair, ...], Field(min_length=1)], ...] | None = None


def paper_scenario(scale: Scale) -> dict[str, Any]:
    """A disc that crosses the path of the hand. The paper shows one such episode and gives no numbers."""
    length = scale.length
    return {
        "start": (-0.5, 1.0),
        "goal": (-0.2 * length, 0.8 * length),
        "obstacle_speed": 0.6 * length / scale.time,
        "obstacle_paths": (((0.9 * length, 0.75 * length), (-1.2 * length, 0.15 * length)),),
    }


class Episode(NamedTuple):
    """Start of an episode.

    Attributes:
        start: joint angles, ``(2,)``, rad.
        goal: of the hand, ``(2,)``, m from the base.
        radius: of the discs, m.
        path: of the discs, ``(samples, discs, 2)``, m from the base.
    """

    start: Array
    goal: Array
    radius: float
    path: Array


OBSTACLE_RADIUS = 0.10
"""Radius of a disc for the task's own arm, m."""


_TRIES = 10_000


class DodgeStarts:
    """Draws the starts of episodes.

    Args:
        arm: a two-link arm.
        limits: limits of the straight move at which the discs are aimed.
        samples: number of samples of a disc's path, `Scale.path_step` apart.
        discs: number of discs.
        scale: units in which lengths and times are drawn.
    """

    def __init__(self, arm: Arm, limits: JointLimits, samples: int, discs: int, scale: Scale) -> None:
        self._arm, self._limits, self._samples, self._discs, self._scale = arm, limits, samples, discs, scale
        reach = np.minimum(arm.limits.angle_half, np.pi)
        self._lowest, self._highest = arm.limits.angle_middle - reach, arm.limits.angle_middle + reach

    def draw(self, generator: np.random.Generator, options: ObstacleDodgeOptions) -> Episode:
        """Draw an episode, or take what the options give of it.

        Raises:
            ValueError: for options out of reach or range, in contact, or with paths for another number of discs.
        """
        start, end = self._draw_move(generator, options)
        length, speed_unit = self._scale.length, self._scale.length / self._scale.time
        radius = length * OBSTACLE_RADIUS if options.obstacle_radius is None else options.obstacle_radius
        speed = None if options.obstacle_speed is None else options.obstacle_speed / speed_unit
        move = straight_move(self._arm, self._limits, start, end).in_units(length, self._scale.time)
        samples, discs = self._samples, self._discs
        path = np.empty((samples, discs, 2))
        given = options.obstacle_paths
        if given is not None and len(given) != discs:
            raise ValueError(f"obstacle_paths holds {len(given)} paths for {discs} discs; give one per disc")
        for disc in range(discs):
            kind = KINDS.index(options.obstacle_kind) if options.obstacle_kind else int(generator.integers(len(KINDS)))
            if given is None:
                one = np.empty((samples, 2))
                draw_path(generator, kind, math.nan if speed is None else speed, radius / length, move, one)
                path[:, disc] = one
            else:
                path[:, disc] = follow_points(np.array(given[disc]) / length, speed or 0.5 * FASTEST, samples)
        path *= length
        if given is not None:  # what is drawn begins clear of the arm
            self._require_clear(start, path[0], radius)
        return Episode(start, length * move.goal, radius, path)

    def _draw_move(self, generator: np.random.Generator, options: ObstacleDodgeOptions) -> tuple[Array, Array]:
        """The posture at the start, and one with the hand at the goal, on the same side of the elbow if possible."""
        if options.start is not None:
            self._require_in_range(options.start)
        for _ in range(_TRIES):
            start = self._draw_posture(generator) if options.start is None else np.array(options.start)
            if options.goal is not None:
                return start, self._posture_at(options.goal, start)
            end = self._draw_posture(generator)
            end[1] = math.copysign(end[1], start[1])
            apart = np.hypot(*(self._arm.forward_kinematics(end) - self._arm.forward_kinematics(start)))
            if apart >= self._scale.length * LEAST_DISTANCE and self._arm.limits.within(end):
                return start, end
        raise ValueError(
            f"hardly any two postures of {self._arm.name} within its joint ranges, {self._arm.limits.angle_text}, have "
            f"hands {self._scale.length * LEAST_DISTANCE:.3g} m apart with the elbow on one side; widen the ranges"
        )

    def _draw_posture(self, generator: np.random.Generator) -> Array:
        for _ in range(_TRIES):
            q = generator.uniform(self._lowest, self._highest)
            if abs(q[1]) >= LEAST_ELBOW:
                return q
        raise ValueError(
            f"hardly any posture of {self._arm.name} within its joint ranges, {self._arm.limits.angle_text}, has an "
            f"elbow bent by {LEAST_ELBOW} rad; widen the ranges"
        )

    def _posture_at(self, goal: Pair, start: Array) -> Array:
        """The posture with the hand at a goal: on the start's side of the elbow, if the ranges allow it."""
        limits = self._arm.limits
        branches = self._arm.inverse_kinematics(np.array(goal) + self._arm.base_array)
        allowed = [q for q in turned_towards(branches, limits.angle_middle) if limits.within(q)]
        if not allowed:
            raise ValueError(f"goal {goal} m: every posture with the hand there leaves a joint's range")
        return min(allowed, key=lambda q: float(q[1] * start[1] < 0.0))

    def _require_in_range(self, start: Pair) -> None:
        if not self._arm.limits.within(start):
            raise ValueError(f"start {list(start)} rad leaves the joint ranges, {self._arm.limits.angle_text}")

    def _require_clear(self, start: Array, discs: NDArray[np.float64], radius: float) -> None:
        for disc in discs:
            gap = self._arm.clearance(start, disc + self._arm.base_array, radius)
            if gap <= 0.0:
                x, y = disc
                raise ValueError(f"the disc at ({x:.4g}, {y:.4g}) m touches the arm at the start; begin further away")
