"""Starts of ObstacleDodge-v0: posture, goal and the paths of the discs, drawn or given."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field

from envs.arms import require_observed
from envs.batch.generators import WORDS, addresses_of, uniform
from envs.batch.pool import BATCH, COUNT, Words, job_of, work_on_all
from envs.batch.records import Records, address_of_first
from envs.obstacle_dodge.paths import FASTEST, KINDS, PATH_KERNELS, Kind, draw_kind, follow_points, path_kernel
from envs.obstacle_dodge.scale import Scale
from envs.obstacle_dodge.second_arm import DISCS, DRAW_SECOND_ARM
from envs.physics.rigid_bodies import model_record
from envs.settings import Settings
from planners import Arm, JointLimits
from planners.compiled.calls import Kernel, call, inlined, private
from planners.motion.time_laws import trapezoid
from planners.robot.kinematics import turned_towards
from planners.typing import Array

Pair = tuple[float, float]

LEAST_ELBOW, LEAST_DISTANCE = 0.3, 0.4
"""Least drawn magnitude of the elbow angle, rad, and distance from the hand to its goal, m, for the task's own
arm."""


FASTEST_GIVEN, LARGEST_GIVEN = 5.0, 0.3
"""Highest speed, m/s, and largest radius, m, that may be given for discs around the task's own arm."""


class ObstacleDodgeOptions(Settings):
    """Options of ``reset``: what is left out is drawn (``"random"``) or a fixed crossing (``"paper"``).

    Attributes:
        scenario: ``"random"``, or ``"paper"``: one disc crosses the path of the hand, as in the paper's figure 3.
        start: joint angles at the start, rad.
        goal: position of the hand to reach, m from the base.
        obstacle_kind: ``"waypoints"``, ``"passes"`` or ``"wander"``, for every disc.
        obstacle_speed: speed of every disc, m/s; at most 5 m/s, scaled as the task for another arm.
        obstacle_radius: radius of every disc, m; at most 0.3 m, scaled as the task for another arm.
        obstacle_paths: for each disc the points, m from the base, between which it moves at constant speed; it stays
            at the last one.
    """

    scenario: Literal["random", "paper"] = "random"
    start: Pair | None = None
    goal: Pair | None = None
    obstacle_kind: Kind | None = None
    obstacle_speed: float | None = Field(None, gt=0.0)
    obstacle_radius: float | None = Field(None, gt=0.0)
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
        goal: of the hand, ``(2,)``, m.
        radius: of the discs, m.
        path: of the discs, those along the second arm last, ``(samples, discs, 2)``, m, as the bytes of float64.
        second_base: base of the second arm, ``(2,)``, m; 0 without one.
    """

    start: Array
    goal: Array
    radius: float
    path: bytes
    second_base: Array


OBSTACLE_RADIUS = 0.10
"""Radius of a disc for the task's own arm, m."""


_TRIES = 10_000
_DRAWN, _NO_POSTURE, _NO_PAIR, _NO_SECOND_ARM = range(4)


_DRAW = np.dtype(
    [
        ("generator", "i8", (WORDS,)),
        ("table", "i8"),
        ("kind", "i8"),
        ("found", "i8"),
        ("disc", "i8"),
        ("path_kind", "i8"),
        ("speed", "f8"),
        ("radius", "f8"),
        ("start", "f8", (2,)),
        ("end", "f8", (2,)),
        ("goal", "f8", (2,)),
        ("at", "f8", (2,)),
        ("change", "f8", (2,)),
        ("top", "f8"),
        ("ramp", "f8"),
        ("second_base", "f8", (2,)),
    ],
    align=True,
)
"""A start that is drawn, and from what.

`generator` and `table` are the addresses of the random numbers and of the path, 0 if the path is given; `kind` that of
the discs, or -1; `found` says whether there is a start. `disc` is the disc whose path comes next, -1 before the ends
are drawn, and `path_kind` its kind, or -1 if it has not been drawn. `speed` of the discs, or NaN, and `radius` are in
the units of the arm. `start` and `end` are the postures at the start and with the hand at the `goal`, rad and m, drawn
where they are NaN. The discs are aimed at a straight move: its `change` of the posture, `top` speed, `ramp` time, and
the hand `at` its end, in the units of the arm. The base of the second arm is in m.
"""


class DodgeStarts:
    """Draws the starts of episodes.

    Args:
        arm: a two-link arm.
        limits: limits of the straight move at which the discs are aimed.
        samples: number of samples of a disc's path, `Scale.path_step` apart.
        discs: number of discs.
        scale: units in which lengths and times are drawn.
        second_arm: whether there is a second arm.
    """

    def __init__(
        self, arm: Arm, limits: JointLimits, samples: int, discs: int, scale: Scale, second_arm: bool = False
    ) -> None:
        self._arm, self._samples, self._discs, self._scale = arm, samples, discs, scale
        self._second_arm, self._points = second_arm, discs + (DISCS if second_arm else 0)
        self._jobs: dict[Kernel, Words] = {}
        middle, reach = arm.limits.angle_middle, np.minimum(arm.limits.angle_half, np.pi)
        self._numbers = model_record(
            {
                "lengths": arm.lengths,
                "base": arm.base,
                "lowest": middle - reach,
                "highest": middle + reach,
                "lower": arm.limits.angle_lower,
                "upper": arm.limits.angle_upper,
                "velocity": limits.velocity,
                "acceleration": limits.acceleration,
                "length": scale.length,
                "time": scale.time,
                "unit_lengths": arm.length_array / scale.length,
                "unit_link_radius": arm.link_radius / scale.length,
                "origin": (0.0, 0.0),
                "samples": samples,
                "discs": discs,
                "points": self._points,
                **dict.fromkeys(PATH_KERNELS, 0),
            }
        )

    def draw(self, generators: Sequence[np.random.Generator], options: ObstacleDodgeOptions) -> list[Episode]:
        """Draw an episode for each generator, or take what the options give of it.

        Raises:
            ValueError: for options out of reach or range, in contact, or with paths for another number of discs.
        """
        length, given = self._scale.length, options.obstacle_paths
        if given is not None and len(given) != self._discs:
            what = "the paper's scenario" if options.scenario == "paper" else "obstacle_paths"
            raise ValueError(
                f"{what} holds {len(given)} paths for {self._discs} discs; give obstacle_paths, one per disc"
            )
        if given is not None and options.obstacle_kind is not None:
            raise ValueError("obstacle_kind is of discs that are drawn, and their paths are given; leave one out")
        for name, most, unit in (
            ("obstacle_speed", FASTEST_GIVEN * length / self._scale.time, "m/s"),
            ("obstacle_radius", LARGEST_GIVEN * length, "m"),
        ):
            value = getattr(options, name)
            if value is not None and not value <= most:
                raise ValueError(f"{name} {value:g} {unit} must be at most {most:.4g} {unit} with {self._arm.name}")
        if options.start is not None:
            require_observed(self._arm, "start", np.array(options.start))
        radius = length * OBSTACLE_RADIUS if options.obstacle_radius is None else options.obstacle_radius
        speed = math.nan if options.obstacle_speed is None else options.obstacle_speed / (length / self._scale.time)
        draws = np.zeros(len(generators), _DRAW)
        draws["kind"] = KINDS.index(options.obstacle_kind) if options.obstacle_kind else -1
        draws["disc"] = draws["path_kind"] = -1
        draws["speed"], draws["radius"] = speed, radius / length
        draws["start"], draws["end"] = math.nan if options.start is None else options.start, math.nan
        draws["generator"] = [addresses_of(generator) for generator in generators]
        if options.goal is not None:
            self._work(draws, _DRAW_POSTURE)
            for draw in draws:
                draw["end"] = self._posture_at(options.goal, draw["start"])
        size, paths = 8 * 2 * self._samples * self._points, [b""] * len(draws)
        if given is None or self._second_arm:
            paths = [bytes(size) for _ in draws]  # nobody else has them yet: they are written once, here
            draws["table"] = [address_of_first(path) for path in paths]
        self._work(draws, _DRAW_EPISODE)
        while (draws["disc"] < self._discs).any():
            self._compile_paths(draws)
            self._work(draws, _DRAW_EPISODE)
        if self._second_arm:
            self._work(draws, DRAW_SECOND_ARM)
        if given is not None:  # what is drawn begins clear of the arm
            pace = 0.5 * FASTEST if math.isnan(speed) else speed
            lines = [follow_points(np.array(points) / length, pace, self._samples) for points in given]
            path = length * np.stack(lines, axis=1) + self._arm.base_array
            for draw in draws:
                self._require_clear(draw["start"], path[0], radius)
            paths = [self._with_discs(drawn, path) for drawn in paths]
        every = zip(draws["start"], draws["goal"], paths, draws["second_base"], strict=True)
        return [Episode(start, goal, radius, path, base) for start, goal, path, base in every]

    def _with_discs(self, drawn: bytes, discs: Array) -> bytes:
        """Given paths of the discs, ``(samples, discs, 2)``, m, beside what is drawn of the second arm."""
        if not self._second_arm:
            return discs.tobytes()
        columns = np.frombuffer(drawn).reshape(self._samples, self._points, 2)[:, self._discs :]
        return np.concatenate([discs, columns], axis=1).tobytes()

    def _work(self, draws: Records, kernel: Kernel) -> None:
        """Let a kernel fill in what is to be drawn; a ValueError if nothing is found."""
        if kernel not in self._jobs:
            self._jobs[kernel] = job_of(kernel, draws, self._numbers)
        job = self._jobs[kernel]
        job[BATCH], job[COUNT] = address_of_first(draws), len(draws)
        work_on_all(job, len(draws), envs_per_thread=1)
        if draws["found"].any():
            self._require(int(draws["found"].max()))

    def _compile_paths(self, draws: Records) -> None:
        """Compile what the paths of the discs wait for: the kernel of one draw, or those of all kinds for several."""
        wanders = draws["path_kind"] == KINDS.index("wander")
        needed = {"wander_kernel": wanders.any(), "legs_kernel": not wanders.all()}
        for name, kernel in PATH_KERNELS.items():
            if needed[name] or len(draws) > 1:
                self._numbers[name] = kernel.address(draws.dtype, self._numbers.dtype)

    def _require(self, found: int) -> None:
        """Raise a ValueError if no start has been found."""
        ranges = f"{self._arm.name} within its joint ranges, {self._arm.limits.angle_text}"
        if found == _NO_POSTURE:
            raise ValueError(
                f"hardly any posture of {ranges}, has an elbow bent by {LEAST_ELBOW} rad; widen the ranges"
            )
        if found == _NO_PAIR:
            raise ValueError(
                f"hardly any two postures of {ranges}, have hands {self._scale.length * LEAST_DISTANCE:.3g} m apart "
                "with the elbow on one side; widen the ranges"
            )
        if found == _NO_SECOND_ARM:
            raise ValueError(
                "hardly any posture of a second arm is clear of the first one at its start and its goal; draw another "
                "start or goal, or leave second_arm out"
            )

    def _posture_at(self, goal: Pair, start: Array) -> Array:
        """The posture with the hand at a goal: on the start's side of the elbow, if the ranges allow it."""
        limits = self._arm.limits
        branches = self._arm.inverse_kinematics(np.array(goal) + self._arm.base_array)
        allowed = [q for q in turned_towards(branches, limits.angle_middle) if limits.within(q)]
        if not allowed:
            raise ValueError(f"goal {goal} m: every posture with the hand there leaves a joint's range")
        return min(allowed, key=lambda q: float(q[1] * start[1] < 0.0))

    def _require_clear(self, start: Array, discs: Array, radius: float) -> None:
        for disc in discs:
            gap = self._arm.clearance(start, disc, radius)
            if gap <= 0.0:
                x, y = disc - self._arm.base_array
                raise ValueError(f"the disc at ({x:.4g}, {y:.4g}) m touches the arm at the start; begin further away")


def _draw_episodes(draws: Any, arms: Any, first: int, last: int) -> None:
    """Draw the ends of the moves and the paths of the discs."""
    for index in range(first, last):
        draw, arm = draws[index], arms[0]
        generator = draw.generator
        if draw.disc < 0:
            draw.found, draw.disc = _DRAWN, 0
            if math.isnan(draw.end[0]):
                draw.found = _draw_ends(generator, draw, arm)
            if draw.found == _DRAWN:
                _aim_at(draw, arm)
        if draw.found == _DRAWN:
            _draw_discs(generator, draw, arm)


@inlined
def _draw_ends(generator: Any, draw: Any, arm: Any) -> int:
    """Draw two postures with the elbow on one side and the hands apart, the first only if it is not given."""
    anywhere, before, after, end = math.isnan(draw.start[0]), draw.at, draw.change, draw.end
    for _ in range(_TRIES):
        if anywhere and not _draw_posture(generator, arm, draw.start):
            return _NO_POSTURE
        if not _draw_posture(generator, arm, end):
            return _NO_POSTURE
        end[1] = math.copysign(end[1], draw.start[1])
        _hand(arm, draw.start, before)
        _hand(arm, end, after)
        apart = math.hypot(after[0] - before[0], after[1] - before[1])
        if apart >= arm.length * LEAST_DISTANCE and _within(arm, end):
            return _DRAWN
    return _NO_PAIR


@inlined
def _aim_at(draw: Any, arm: Any) -> None:
    """Write the goal, and the straight move to it."""
    _hand(arm, draw.end, draw.goal)
    for axis in range(2):
        goal = draw.goal[axis] - arm.base[axis]
        draw.at[axis] = goal / arm.length
        draw.goal[axis] = goal + arm.base[axis]
        draw.change[axis] = draw.end[axis] - draw.start[axis]
    top, ramp = trapezoid(draw.change, arm.velocity, arm.acceleration)
    draw.top, draw.ramp = top * arm.time, ramp / arm.time


@inlined
def _draw_discs(generator: Any, draw: Any, arm: Any) -> None:
    """Write the paths of the discs up to one whose kernel is missing; no more than kinds where the paths are given."""
    while draw.disc < arm.discs:
        if draw.path_kind < 0:
            draw.path_kind = draw.kind if draw.kind >= 0 else draw_kind(generator)
        if draw.table != 0:
            kernel = path_kernel(draw.path_kind, arm)
            if kernel == 0:
                break
            call(kernel, draw, arm)
        draw.path_kind = -1
        draw.disc += 1


def _draw_postures(draws: Any, arms: Any, first: int, last: int) -> None:
    """Draw the postures at the start that are not given."""
    for index in range(first, last):
        draw = draws[index]
        if math.isnan(draw.start[0]) and not _draw_posture(draw.generator, arms[0], draw.start):
            draw.found = _NO_POSTURE


_DRAW_EPISODE, _DRAW_POSTURE = Kernel(_draw_episodes, error_model="numpy"), Kernel(_draw_postures)


@private
def _draw_posture(generator: Any, arm: Any, q: Array) -> bool:
    """Draw joint angles ``(2,)`` with a bent elbow; whether one has been found."""
    for _ in range(_TRIES):
        for i in range(2):
            q[i] = arm.lowest[i] + (arm.highest[i] - arm.lowest[i]) * uniform(generator)
        if abs(q[1]) >= LEAST_ELBOW:
            return True
    return False


@inlined
def _within(arm: Any, q: Array) -> bool:
    """Whether joint angles are within their ranges."""
    return bool(arm.lower[0] <= q[0] <= arm.upper[0] and arm.lower[1] <= q[1] <= arm.upper[1])


@private
def _hand(arm: Any, q: Array, hand: Array) -> None:
    """Write the position of the hand, ``(2,)``, m."""
    hand[0], hand[1], phi = arm.base[0], arm.base[1], 0.0
    for i in range(2):
        phi += q[i]
        hand[0] += arm.lengths[i] * math.cos(phi)
        hand[1] += arm.lengths[i] * math.sin(phi)
