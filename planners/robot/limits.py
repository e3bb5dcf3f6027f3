"""Limits of the joints of an arm: of torque, velocity, acceleration, jerk, and the ranges of the angles."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Set
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planners.checks import (
    LARGEST,
    brief,
    checked_count,
    floats,
    is_number,
    refuse_unknown,
    require_all_finite,
    require_finite,
)
from planners.typing import Array

LimitKind = Literal["torque", "velocity", "acceleration", "jerk", "angle"]
LIMIT_KINDS: tuple[LimitKind, ...] = get_args(LimitKind)
UNITS = dict(zip(LIMIT_KINDS, ("N m", "rad/s", "rad/s^2", "rad/s^3", "rad"), strict=True))

Range = float | tuple[float, float]
"""Range of a joint's angle, rad: plus and minus a number, or from a lower to an upper end."""


class EveryJoint(tuple[Range, ...]):
    """A single value that holds for every joint, while the number of joints is not known."""

    def __repr__(self) -> str:
        return repr(self[0])


@dataclass(frozen=True, init=False)
class JointLimits:
    """Limits of every joint in N m, rad/s, rad/s^2, rad/s^3 and rad; ``inf``, or leaving a kind out, means no limit.

    A kind is given as one value per joint (a list, a tuple or an array) or as a number that holds for every joint.
    Torques, velocities, accelerations and jerks are limited by plus and minus their value. So is an angle given as a
    number; an angle given as a pair stays between ``(lower, upper)``, both finite. ``angle`` holds a number for a range
    around 0 and a pair for another one; `angle_lower`, `angle_upper`, `angle_middle` and `angle_half` are arrays for
    all.

    Raises:
        ValueError: for a limit that is not positive or no number, a range without width, or numbers of values that
            differ between the kinds; the message says how to write it.
    """

    torque: tuple[float, ...]
    velocity: tuple[float, ...]
    acceleration: tuple[float, ...]
    jerk: tuple[float, ...]
    angle: tuple[Range, ...]

    def __init__(
        self,
        torque: ArrayLike = (),
        velocity: ArrayLike = (),
        acceleration: ArrayLike = (),
        jerk: ArrayLike = (),
        angle: ArrayLike = (),
    ) -> None:
        kinds: dict[LimitKind, tuple[Range, ...]] = {
            "torque": _limits("torque", torque),
            "velocity": _limits("velocity", velocity),
            "acceleration": _limits("acceleration", acceleration),
            "jerk": _limits("jerk", jerk),
            "angle": _limits("angle", angle),
        }
        counts = {kind: len(values) for kind, values in kinds.items() if not isinstance(values, EveryJoint)}
        for kind, count in counts.items():
            first, n = next(iter(counts.items()))
            if count != n:
                raise ValueError(
                    f"{kind} limits: {count} values for {n} joints ({n} {first} limits are given); give one per joint, "
                    "or a number that holds for every joint"
                )
        for kind, values in kinds.items():
            if counts and isinstance(values, EveryJoint):
                values = next(iter(counts.values())) * tuple(values)
            object.__setattr__(self, kind, values)

    def __reduce__(self) -> tuple[object, ...]:
        return JointLimits, (self.torque, self.velocity, self.acceleration, self.jerk, self.angle)

    @classmethod
    def unlimited(cls, n_joints: int) -> JointLimits:
        """No limit on any of ``n_joints`` joints; ValueError for fewer than one."""
        checked_count("n_joints", n_joints)
        return cls(torque=(math.inf,) * n_joints)

    def for_joints(self, n_joints: int, owner: str = "the arm") -> JointLimits:
        """The limits of ``n_joints`` joints; numbers that hold for every joint are repeated.

        Raises:
            ValueError: if limits of another number of joints are given.
        """
        checked_count("n_joints", n_joints)
        kinds = [getattr(self, kind) for kind in LIMIT_KINDS]
        if isinstance(self.torque, EveryJoint):
            return JointLimits(*(n_joints * tuple(values) for values in kinds))
        if len(self.torque) != n_joints:
            raise ValueError(
                f"limits are given for {len(self.torque)} joints, {owner} has {n_joints}; give one value per joint, "
                "or a number that holds for every joint"
            )
        return self

    def scaled(self, factor: float) -> JointLimits:
        """Torque, velocity, acceleration and jerk limits times ``factor``; joint angles keep theirs.

        Raises:
            ValueError: for a factor that is not finite and positive.
        """
        require_finite("factor", factor, "", "positive")
        kinds = (self.torque, self.velocity, self.acceleration, self.jerk)
        torque, velocity, acceleration, jerk = (type(values)(factor * value for value in values) for values in kinds)
        return JointLimits(torque, velocity, acceleration, jerk, self.angle)

    def array(self, kind: LimitKind) -> Array:
        """Limits of a kind, ``(n,)``, read-only; of the angles half of the width of their ranges."""
        if kind not in self._arrays:
            refuse_unknown([kind], LIMIT_KINDS, "kind of limit")
        return self._arrays[kind]

    @cached_property
    def angle_lower(self) -> Array:
        """Lower end of each joint's range, ``(n,)``, rad, read-only; -inf where there is none."""
        return _frozen([-item if isinstance(item, float) else item[0] for item in self.angle])

    @cached_property
    def angle_upper(self) -> Array:
        """Upper end of each joint's range, ``(n,)``, rad, read-only; inf where there is none."""
        return _frozen([item if isinstance(item, float) else item[1] for item in self.angle])

    @cached_property
    def angle_middle(self) -> Array:
        """Middle of each joint's range, ``(n,)``, rad, read-only; 0 where there is none."""
        return _frozen([0.0 if isinstance(item, float) else 0.5 * (item[0] + item[1]) for item in self.angle])

    @cached_property
    def angle_half(self) -> Array:
        """Half of the width of each joint's range, ``(n,)``, rad, read-only; inf where there is none.

        Neither end is further from the middle, to the bit.
        """
        pairs = zip(self.angle, self.angle_middle.tolist(), strict=True)
        return _frozen([item if isinstance(item, float) else max(item[1] - m, m - item[0]) for item, m in pairs])

    def within(self, q: ArrayLike) -> NDArray[np.bool_]:
        """Whether all joint angles are within their ranges, ``(...)`` for ``q`` of ``(..., n)``, rad; NaN is not."""
        angles: Array = floats("q", q)
        if angles.shape[-1:] != self.angle_lower.shape:
            raise ValueError(f"q has shape {angles.shape}; give (..., {len(self.angle_lower)})")
        return np.asarray(((angles >= self.angle_lower) & (angles <= self.angle_upper)).all(axis=-1))

    @property
    def angle_text(self) -> str:
        """The ranges of the angles for messages, as in "+-2.88, any, -1 to 2.5 rad"."""
        ranges = [
            f"{low:.4g} to {high:.4g}" if low != -high else f"+-{high:.4g}" if math.isfinite(high) else "any"
            for low, high in zip(self.angle_lower.tolist(), self.angle_upper.tolist(), strict=True)
        ]
        return f"{', '.join(ranges)} rad"

    @cached_property
    def _arrays(self) -> dict[LimitKind, Array]:
        return {kind: self.angle_half if kind == "angle" else _frozen(getattr(self, kind)) for kind in LIMIT_KINDS}


def _frozen(values: Iterable[float]) -> Array:
    array = np.array(tuple(values), dtype=float)
    array.setflags(write=False)
    return array


_NO_SEQUENCES = (str, bytes, bytearray, Mapping, Set, np.ma.MaskedArray)
"""What can be iterated over and yet is no sequence of limits."""


def _limits(kind: LimitKind, given: Any) -> tuple[Any, ...]:
    """The limits of a kind as floats (angles also as pairs of floats), checked."""
    every = is_number(given) or isinstance(given, EveryJoint)
    if not every and (isinstance(given, _NO_SEQUENCES) or not isinstance(given, Iterable)):
        raise ValueError(f"{kind} limits {brief(given)} are no numbers; {_how(kind)}")
    items = (given,) if is_number(given) else tuple(given)
    values = tuple(_limit(kind, item, items) for item in items)
    return EveryJoint(values) if every else values or EveryJoint((math.inf,))


def _limit(kind: LimitKind, item: Any, items: tuple[Any, ...]) -> Range:
    """One limit as a float, or a pair of floats that is not symmetric."""
    shown = brief(tuple(float(one) if is_number(one) else one for one in items))
    if is_number(item):
        if not float(item) > 0.0:
            raise ValueError(f"{kind} limits {shown} must be positive; use inf for no limit. {_how(kind)}")
        if LARGEST < float(item) < math.inf:
            raise ValueError(f"{kind} limits {shown} must be at most {LARGEST:g} {UNITS[kind]}; use inf for no limit")
        return float(item)
    if kind != "angle" or isinstance(item, _NO_SEQUENCES) or not isinstance(item, Iterable):
        raise ValueError(f"{kind} limits {shown}: {brief(item)} is no number; {_how(kind)}")
    pair = tuple(item)
    if len(pair) != 2 or not all(map(is_number, pair)):
        raise ValueError(f"angle limits: {brief(item)} is no pair of numbers; {_how(kind)}")
    lower, upper = map(float, pair)
    if (lower, upper) == (-math.inf, math.inf):
        return math.inf
    if not (math.isfinite(lower) and math.isfinite(upper) and lower < upper):
        raise ValueError(
            f"angle limits: ({lower}, {upper}) rad must be two finite numbers, the lower end first; "
            "use inf for a joint without a range"
        )
    require_all_finite("angle limits:", pair)
    return upper if lower == -upper else (lower, upper)


def _how(kind: LimitKind) -> str:
    """How limits are written."""
    pairs = "; the range of an angle may be a pair (lower, upper), as in ((-1.0, 2.5), 2.6)" if kind == "angle" else ""
    return f"Write one positive number per joint, or one for every joint, in {UNITS[kind]}{pairs}"
