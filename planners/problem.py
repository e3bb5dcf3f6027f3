"""The interface of tasks and planners: a `MotionProblem` is solved by a `Trajectory` or raises `Infeasible`."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from planners.checks import require_finite
from planners.robot.arm import Arm, JointLimits
from planners.robot.limits import LimitKind
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


@dataclass(frozen=True)
class FixedJoints:
    """Come to rest at joint angles ``q``, ``(n,)``, rad."""

    q: Array

    def __post_init__(self) -> None:
        _freeze(self, q=None)


@dataclass(frozen=True)
class FixedHand:
    """Come to rest with the hand at ``position``, ``(2,)``, m; three links also need ``orientation``, rad."""

    position: Array
    orientation: float | None = None

    def __post_init__(self) -> None:
        _freeze(self, position=2)


@dataclass(frozen=True)
class MovingHand:
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
        time = np.asarray(t, dtype=float)[..., None]
        position = self.position + time * self.velocity + 0.5 * time**2 * self.acceleration
        return position, self.velocity + time * self.acceleration


Target = FixedJoints | FixedHand | MovingHand


@dataclass(frozen=True)
class Obstacle:
    """A disc: ``position`` ``(2,)`` m, ``velocity`` ``(2,)`` m/s, ``radius`` m."""

    position: Array
    velocity: Array
    radius: float

    def __post_init__(self) -> None:
        _freeze(self, position=2, velocity=2)
        require_finite("obstacle radius", self.radius, "m", "not negative")


@dataclass(frozen=True)
class MotionProblem:
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
        _freeze(self, q=n, qd=n, qdd=n)
        require_finite("horizon", self.horizon, "s", "positive")
        require_finite("payload mass", self.payload, "kg", "not negative")
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


@dataclass(frozen=True)
class Trajectory:
    """A planned motion, sampled on a dense grid of times.

    Attributes:
        t: sample times from 0, ``(samples,)``, s.
        q, qd, qdd: joint angles, velocities and accelerations, ``(samples, n)``.
        tau: joint torques by inverse dynamics of the loaded arm, ``(samples, n)``, N m.
        limit_ratios: worst |value| / limit over all samples and joints, for each kind of limit.
        cost: the planner's index of the motion.
        rendezvous_time: when a moving target is met, or rest at a fixed one reached, s.
        planner: name of the planner and its variant.
        rides_until: until when a moving target could be followed within the limits, s.
    """

    t: Array
    q: Array
    qd: Array
    qdd: Array
    tau: Array
    limit_ratios: Mapping[str, float]
    cost: float
    rendezvous_time: float
    planner: str
    rides_until: float = math.inf

    @property
    def duration(self) -> float:
        """Time of the last sample, s."""
        return float(self.t[-1])

    @property
    def limit_ratio(self) -> float:
        """Worst of all limit ratios: at most 1 when every limit is kept."""
        return max(self.limit_ratios.values())

    def at(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Joint angles, velocities and accelerations at times ``t``, each ``t.shape + (n,)``.

        Between samples a quintic that matches angle, velocity and acceleration at both neighbours; outside
        ``[0, duration]`` the nearest end sample.
        """
        time = np.clip(np.asarray(t, dtype=float), self.t[0], self.t[-1])
        left = np.clip(np.searchsorted(self.t, time, side="right") - 1, 0, len(self.t) - 2)
        h = (self.t[left + 1] - self.t[left])[..., None]
        s = (time - self.t[left])[..., None] / h
        q0, v0, a0 = self.q[left], h * self.qd[left], h**2 * self.qdd[left]
        q1, v1, a1 = self.q[left + 1], h * self.qd[left + 1], h**2 * self.qdd[left + 1]
        rest, dv, da = q1 - q0 - v0 - a0 / 2.0, v1 - v0 - a0, a1 - a0
        c3 = 10.0 * rest - 4.0 * dv + 0.5 * da
        c4 = -15.0 * rest + 7.0 * dv - da
        c5 = 6.0 * rest - 3.0 * dv + 0.5 * da
        q = q0 + s * (v0 + s * (a0 / 2.0 + s * (c3 + s * (c4 + s * c5))))
        qd = (v0 + s * (a0 + s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5)))) / h
        qdd = (a0 + s * (6.0 * c3 + s * (12.0 * c4 + s * 20.0 * c5))) / h**2
        return q, qd, qdd


def sampled_trajectory(
    problem: MotionProblem,
    t: Array,
    q: Array,
    qd: Array,
    qdd: Array,
    *,
    planner: str,
    cost: float = math.nan,
    rendezvous_time: float = math.inf,
    rides_until: float = math.inf,
    jerk_jumps: bool = False,
) -> Trajectory:
    """A sampled joint motion as a `Trajectory`, with the torques of the loaded arm and the limit ratios.

    With ``jerk_jumps`` the acceleration jumps, so that the ratio to a finite jerk limit is infinite.
    """
    tau = problem.loaded_arm.inverse_dynamics(q, qd, qdd)
    ratios = limit_ratios(problem.joint_limits, t, q, qd, qdd, tau)
    if jerk_jumps and ratios["jerk"] > 0.0:
        ratios["jerk"] = math.inf
    return Trajectory(t, q, qd, qdd, tau, ratios, cost, rendezvous_time, planner, rides_until)


def limit_ratios(limits: JointLimits, t: Array, q: Array, qd: Array, qdd: Array, tau: Array) -> dict[str, float]:
    """Worst |value| / limit of each kind over samples and joints.

    The samples are at times ``t`` ``(samples,)``, s, and ``(samples, n)``. Jerk is the difference of the sampled
    accelerations: sample where it jumps. The kinds are ``torque``, ``velocity``, ``acceleration``, ``jerk`` and
    ``angle``; the ratio is 0 where there is no limit.
    """
    jerk = np.diff(qdd, axis=0) / np.diff(t)[:, None]
    samples: dict[LimitKind, Array] = {
        "torque": tau,
        "velocity": qd,
        "acceleration": qdd,
        "jerk": jerk,
        "angle": q - limits.angle_middle,
    }
    return {kind: float(np.max(np.abs(values) / limits.array(kind))) for kind, values in samples.items()}


def _require_kinds(problem: MotionProblem) -> None:
    """Raise ValueError for what is of another kind than a problem needs; make a tuple of the obstacles."""
    if not isinstance(problem.arm, Arm):
        raise ValueError(f"arm {problem.arm!r:.80} is no Arm; planners.load_arm makes one of a name or a file")
    if not isinstance(problem.target, FixedJoints | FixedHand | MovingHand):
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


def _freeze(instance: object, **lengths: int | None) -> None:
    """Turn the named fields into read-only float arrays of the given lengths (None: any)."""
    for name, length in lengths.items():
        try:
            array = np.array(getattr(instance, name), dtype=float)
        except (TypeError, ValueError, OverflowError):
            raise ValueError(f"{name} {getattr(instance, name)!r:.80} must be numbers") from None
        if array.ndim != 1 or (length is not None and len(array) != length):
            wanted = "one dimension" if length is None else f"shape ({length},)"
            raise ValueError(f"{name} has shape {array.shape}; it must have {wanted}")
        if not np.isfinite(array).all():
            raise ValueError(f"{name} {array} must be finite")
        array.setflags(write=False)
        object.__setattr__(instance, name, array)
