"""The interface of tasks and planners: a `MotionProblem` is solved by a `Trajectory`, or `Infeasible` is raised."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from planners.checks import float_array, floats, require_all_finite, require_finite
from planners.robot.arm import MOST, Arm, JointLimits
from planners.typing import Array


class Infeasible(ValueError):
    """No motion solves the problem within its limits.

    Attributes:
        reason: a word for programs: ``unreachable``, ``no_window``, ``late``, ``start``, ``limits``,
            ``collision`` or ``local_minimum``.
        details: numbers of the message, by name.
    """

    def __init__(self, reason: str, message: str, **details: object) -> None:
        super().__init__(f"{reason}: {message}")
        self.reason = reason
        self.message = message
        self.details = details

    def __reduce__(self) -> tuple[object, ...]:
        return partial(Infeasible, self.reason, self.message, **self.details), ()


def limit_broken(reason: str, what: str, ratios: Array, kinds: Sequence[str]) -> Infeasible:
    """The refusal that names the worst of ``ratios`` to the limits, ``(kinds, n)``: "joint 2 starts at 3 times ..."."""
    kind, joint = np.unravel_index(int(ratios.argmax()), ratios.shape)
    ratio, name = float(ratios[kind, joint]), kinds[int(kind)]
    message = f"joint {joint + 1} {what} {ratio:.4g} times its {name} limit"
    return Infeasible(reason, message, joint=int(joint), kind=name, ratio=ratio)


class ByValue:
    """Equality and hash of frozen dataclasses that hold arrays: of the same type, with the same values."""

    def __eq__(self, other: object) -> bool:
        """Whether all fields have the same values; NaN counts as the same as NaN."""
        return type(other) is type(self) and _same(_values(self), _values(other))

    def __hash__(self) -> int:
        return hash(_hashable(_values(self)))

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), _values(self)  # a copy is checked, and read-only, as what it is of


def _values(instance: Any) -> tuple[Any, ...]:
    return tuple(getattr(instance, item.name) for item in fields(instance))


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray):
        return np.array_equal(one, other, equal_nan=True)
    if isinstance(one, tuple):
        return isinstance(other, tuple) and len(one) == len(other) and all(map(_same, one, other))
    return bool(one == other or (one != one and other != other))


def _hashable(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.shape, (value + 0.0).tobytes()  # 0.0 is the same as -0.0
    if isinstance(value, tuple):
        return tuple(map(_hashable, value))
    return None if value != value else value


@dataclass(frozen=True, eq=False)
class FixedJoints(ByValue):
    """Come to rest at joint angles ``q``, ``(n,)``, rad."""

    q: Array

    def __post_init__(self) -> None:
        _freeze(self, q=None)


@dataclass(frozen=True, eq=False)
class FixedHand(ByValue):
    """Come to rest with the hand at ``position``, ``(2,)``, m, and the last link at ``orientation``, rad, if given."""

    position: Array
    orientation: float | None = None

    def __post_init__(self) -> None:
        _freeze(self, position=2)
        if self.orientation is not None:
            require_finite("orientation", self.orientation, "rad")
            object.__setattr__(self, "orientation", float(self.orientation))


@dataclass(frozen=True, eq=False)
class MovingHand(ByValue):
    """Meet and follow a point that moves with constant acceleration.

    ``position`` (m) and ``velocity`` (m/s) are those at time 0; ``acceleration`` is in m/s^2; each ``(2,)``.
    """

    position: Array
    velocity: Array
    acceleration: Array = field(default_factory=lambda: np.zeros(2))

    def __post_init__(self) -> None:
        _freeze(self, position=2, velocity=2, acceleration=2)

    def at(self, t: ArrayLike) -> tuple[Array, Array]:
        """Position and velocity at times ``t``, each ``t.shape + (2,)``."""
        time = floats("t", t)[..., None]
        position = self.position + time * self.velocity + 0.5 * time**2 * self.acceleration
        return position, self.velocity + time * self.acceleration


Target = FixedJoints | FixedHand | MovingHand


@dataclass(frozen=True, eq=False)
class Obstacle(ByValue):
    """A disc: ``position`` ``(2,)`` m, ``velocity`` ``(2,)`` m/s, ``radius`` m."""

    position: Array
    velocity: Array
    radius: float

    def __post_init__(self) -> None:
        _freeze(self, position=2, velocity=2)
        require_finite("obstacle radius", self.radius, "m", "not negative")
        object.__setattr__(self, "radius", float(self.radius))


@dataclass(frozen=True, eq=False)
class MotionProblem(ByValue):
    """A motion planning problem.

    Attributes:
        arm: the robot, without its payload.
        q, qd, qdd: joint angles, velocities and accelerations at time 0, ``(n,)``; at rest when left out.
        target: to reach, within ``horizon`` s.
        limits: of the joints; the arm's own when left out.
        obstacles: discs to avoid: a tuple, a list, or a single `Obstacle`.
        payload: estimated point mass at the hand, kg.
    """

    arm: Arm
    q: Array
    target: Target
    horizon: float
    qd: Array | None = None
    qdd: Array | None = None
    limits: JointLimits | None = None
    obstacles: tuple[Obstacle, ...] = ()
    payload: float = 0.0

    def __post_init__(self) -> None:
        _require_kinds(self)
        n = self.arm.n_joints
        for name, default in {"qd": np.zeros(n), "qdd": np.zeros(n), "limits": self.arm.limits}.items():
            if getattr(self, name) is None:
                object.__setattr__(self, name, default)
        _freeze(self, f" for the joints of the arm {self.arm.name}", q=n, qd=n, qdd=n)
        require_finite("horizon", self.horizon, "s", "positive")
        require_finite("payload mass", self.payload, "kg", "not negative", MOST)
        object.__setattr__(self, "horizon", float(self.horizon))
        object.__setattr__(self, "payload", float(self.payload))
        object.__setattr__(self, "limits", self.joint_limits.for_joints(n))
        if isinstance(self.target, FixedJoints) and len(self.target.q) != n:
            raise ValueError(f"target has {len(self.target.q)} joint angles, the arm {n} joints")

    @property
    def start(self) -> tuple[Array, Array, Array]:
        """Joint angles, velocities and accelerations at time 0, each ``(n,)``."""
        assert self.qd is not None  # filled in by __post_init__
        assert self.qdd is not None
        return self.q, self.qd, self.qdd

    @property
    def joint_limits(self) -> JointLimits:
        """The limits that apply: the problem's own, or the arm's."""
        return self.limits or self.arm.limits

    @property
    def loaded_arm(self) -> Arm:
        """The arm with the payload estimate at its hand."""
        return self.arm.with_payload(self.payload)


def _require_kinds(problem: MotionProblem) -> None:
    """Raise ValueError for what is of another kind than a problem needs; make a tuple of the obstacles."""
    if not isinstance(problem.arm, Arm):
        raise ValueError(f"arm {problem.arm!r:.80} is no Arm; planners.load_arm makes one of a name or a file")
    if type(problem.target) not in (FixedJoints, FixedHand, MovingHand):  # also what is derived from them
        raise ValueError(
            f"target {problem.target!r:.80} is no target; give FixedJoints(q), FixedHand(position) or "
            "MovingHand(position, velocity)"
        )
    if not isinstance(problem.limits, JointLimits | None):
        raise ValueError(f"limits {problem.limits!r:.80} are no JointLimits; write JointLimits(torque=...)")
    given = problem.obstacles
    obstacles = (given,) if isinstance(given, Obstacle) else tuple(given) if isinstance(given, Iterable) else None
    if obstacles is None or not all(isinstance(item, Obstacle) for item in obstacles):
        raise ValueError(f"obstacles {given!r:.80} must be Obstacle(position, velocity, radius), or several in a tuple")
    object.__setattr__(problem, "obstacles", obstacles)


def _freeze(instance: object, purpose: str = "", **lengths: int | None) -> None:
    """Turn the named fields into read-only float arrays of the given lengths (None: any); ``purpose`` is for errors."""
    for name, length in lengths.items():
        array = float_array(name, getattr(instance, name))
        if array.ndim != 1 or (length is not None and len(array) != length):
            wanted = "one dimension" if length is None else f"shape ({length},)"
            raise ValueError(f"{name} has shape {array.shape}; it must have {wanted}{purpose}")
        require_all_finite(name, array)
        array.setflags(write=False)
        object.__setattr__(instance, name, array)
