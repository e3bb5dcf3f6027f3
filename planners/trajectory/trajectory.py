"""`Trajectory`: a planned motion with its measured loads, and how one is made from samples."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from planners.checks import LARGEST, brief, float_array, floats, is_number, require_shape
from planners.problem import ByValue, MotionProblem
from planners.robot.limits import LIMIT_KINDS
from planners.trajectory.interpolate import insert_turning_points, interpolate
from planners.trajectory.measure import Measure, measure
from planners.trajectory.plot import plot, write_plot
from planners.typing import Array

ANIMATE = "planarm.animate"
"""Group of the entry point that draws motions: drawing is on a floor above this one."""

SAME_TIME = 1e-12
"""Difference of the times of two samples, as a fraction of the duration, that is rounding: they have the same time."""

MOST_TURNS = 4
"""Most turning points of a value between two samples: one is found at a time."""

FALL = 1e-9
"""Fall of the time between two samples, as a fraction of the duration, that is rounding."""


@dataclass(frozen=True, eq=False)
class Trajectory(ByValue):
    """A planned motion, sampled on a dense grid of times.

    Where the acceleration jumps, two samples have the same time: before and after the jump.

    Attributes:
        problem: what was planned.
        t: sample times from 0, ``(samples,)``, s.
        q, qd, qdd: joint angles, velocities and accelerations, ``(samples, n)``.
        tau: joint torques by inverse dynamics of the loaded arm, ``(samples, n)``, N m.
        measured: worst loads and least clearance of the continuous motion.
        cost: the planner's index of the motion.
        rendezvous_time: when a moving target is met, or rest at a fixed one reached, s.
        planner: name of the planner and its variant.
        rides_until: until when a moving target could be followed within the limits, s.

    Raises:
        ValueError: if a shape does not fit.
    """

    problem: MotionProblem
    t: Array
    q: Array
    qd: Array
    qdd: Array
    tau: Array
    measured: Measure
    cost: float
    rendezvous_time: float
    planner: str
    rides_until: float = math.inf

    def __post_init__(self) -> None:
        for name in ("t", "q", "qd", "qdd", "tau"):
            object.__setattr__(self, name, floats(name, getattr(self, name)))
        shape = len(self.t), self.problem.arm.n_joints
        require_shape("t", self.t, shape[:1])
        for name in ("q", "qd", "qdd", "tau"):
            require_shape(name, getattr(self, name), shape)
        if len(self.t) < 2 or not (self.t[0] == 0.0 and (np.diff(self.t) >= 0.0).all()):
            raise NoMotion("the times of the samples must begin at 0 and never fall; two are the fewest")
        for name in ("cost", "rendezvous_time", "rides_until"):
            if not is_number(value := getattr(self, name)):
                raise ValueError(f"{name} {brief(value)} must be a number")
            object.__setattr__(self, name, float(value))
        if not isinstance(self.planner, str):
            raise ValueError(f"planner {brief(self.planner)} must be a name")

    @property
    def duration(self) -> float:
        """Time of the last sample, s."""
        return float(self.t[-1])

    @property
    def limit_ratios(self) -> Mapping[str, float]:
        """Worst magnitude / limit over the continuous motion and all joints, for each kind of limit.

        The kinds are ``torque``, ``velocity``, ``acceleration``, ``jerk`` and ``angle`` (from the middle of the range).
        The ratio is 0 where there is no limit, and that of jerk inf where the acceleration jumps in spite of one.
        """
        return dict(zip(LIMIT_KINDS, self.measured.ratios.tolist(), strict=True))

    @property
    def limit_ratio(self) -> float:
        """Worst of all limit ratios: at most 1 when every limit is kept."""
        return float(self.measured.ratios.max())

    @property
    def clearance(self) -> float:
        """Least distance between the surfaces of the arm and an obstacle, to 2 micrometres or 0.1 %, m; inf without."""
        return float(self.measured.clearance)

    def at(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Joint angles, velocities and accelerations at times ``t``, each ``t.shape + (n,)``.

        Between two samples a quintic that matches both, kept between their values; at a jump the values after it;
        outside ``[0, duration]`` the nearest end sample.

        Raises:
            ValueError: if a time is NaN or no number.
        """
        times = float_array("t", t)
        if np.isnan(times).any():
            raise ValueError("t must be times in s; some are NaN")
        found = interpolate(self.t, self.q, self.qd, self.qdd, times.ravel())
        q, qd, qdd = found.reshape(3, *times.shape, self.q.shape[1])
        return q, qd, qdd

    def to_csv(self, path: str | Path) -> None:
        """Write the samples as CSV, units in the names of the columns; the file appears whole or not at all."""
        from planners.trajectory import files

        files.write_csv(self, Path(path))

    def save(self, path: str | Path) -> None:
        """Write samples and problem as NPZ, units in the names; `load` gives the same trajectory back."""
        from planners.trajectory import files

        files.write_npz(self, Path(path))

    @classmethod
    def load(cls, path: str | Path) -> Trajectory:
        """The trajectory that `save` wrote, to the bit. No code in a file is run.

        Raises:
            ValueError: if the file holds no trajectory.
            OSError: if it cannot be read.
        """
        from planners.trajectory import files

        try:
            return sampled_trajectory(**files.read_npz(Path(path)))
        except ValueError as error:
            raise ValueError(str(error) if str(path) in str(error) else f"cannot read {path}: {error}") from None

    def plot(self, path: str | Path | None = None) -> Any:
        """A matplotlib figure: angles, velocities, accelerations and torques, with their limits.

        Args:
            path: write it there too, in the format of the suffix.

        Raises:
            ValueError: if matplotlib writes no file with this suffix.
            ModuleNotFoundError: if matplotlib is not installed; it comes with the extra ``viz``.
        """
        figure = plot(self)
        if path is not None:
            write_plot(figure, Path(path))
        return figure

    def animate(self, path: str | Path, *, fps: int = 25, width: int = 720) -> None:
        """Write the motion, drawn as environments are, to a ``.gif`` or ``.mp4`` file, or its last frame as ``.png``.

        Args:
            path: of the file.
            fps: frames a second.
            width: of the picture, pixels.

        Raises:
            ValueError: if the format or a number is not allowed.
            gymnasium.error.DependencyNotInstalled: if drawing or writing needs an extra.
        """
        (animate,) = metadata.entry_points(group=ANIMATE)
        animate.load()(self, Path(path), fps=fps, width=width)

    def __repr__(self) -> str:
        """One line: planner, duration, worst limit and least clearance."""
        limits, ratios = self.problem.joint_limits, self.limit_ratios
        limited = [kind for kind in LIMIT_KINDS if np.isfinite(limits.array(kind)).any()]
        worst = max(limited, key=ratios.__getitem__, default=None)
        parts = [f"{self.duration:.4g} s", "no limits"]
        if worst is not None:
            parts[1] = f"{worst} at {100.0 * ratios[worst]:.4g} % of its limit"
        if math.isfinite(self.clearance):
            parts.append(f"clearance {1e3 * self.clearance:.4g} mm")
        return f"<Trajectory by {self.planner}: {', '.join(parts)}, {len(self.t)} samples>"


class NoMotion(ValueError):
    """Samples that are no motion: their times fall, or their numbers are not finite."""


def sampled_trajectory(
    problem: MotionProblem,
    t: ArrayLike,
    q: ArrayLike,
    qd: ArrayLike,
    qdd: ArrayLike,
    *,
    planner: str,
    cost: float = math.nan,
    rendezvous_time: float = math.inf,
    rides_until: float = math.inf,
) -> Trajectory:
    """A motion from its samples, with the torques of the loaded arm, and measured between the samples too.

    Args:
        problem: what was planned.
        t: times of the samples from 0, ``(samples,)``, s, never falling; the same time twice where ``qdd`` jumps.
        q, qd, qdd: joint angles, velocities and accelerations, ``(samples, n)``.
        planner, cost, rendezvous_time, rides_until: see `Trajectory`.

    Raises:
        ValueError: if shapes do not fit, there are fewer than two samples, times fall, or a number is not finite.
    """
    n = problem.arm.n_joints
    given = {"t": t, "q": q, "qd": qd, "qdd": qdd}
    times, *motion = (np.ascontiguousarray(float_array(name, values)) for name, values in given.items())
    if times.ndim != 1 or len(times) < 2 or any(values.shape != (len(times), n) for values in motion):
        shapes = ", ".join(str(values.shape) for values in (times, *motion))
        raise ValueError(f"t, q, qd and qdd have shapes {shapes}; give (samples,) and three of (samples, {n})")
    if not all((np.abs(values) <= LARGEST).all() for values in (times, *motion)):
        raise NoMotion(f"t, q, qd and qdd must be finite, at most {LARGEST:g} in size; some are NaN, inf or larger")
    rising = np.maximum.accumulate(times)
    if times[0] != 0.0 or (rising - times > FALL * times[-1]).any() or not times[-1] >= 1.0 / LARGEST:
        raise NoMotion(
            f"the times of the samples must begin at 0, never fall, and end after {1.0 / LARGEST:g} s or more"
        )
    samples = _same_times(rising), motion[0], motion[1], motion[2]
    for _ in range(MOST_TURNS):
        count = len(samples[0])
        samples = insert_turning_points(*samples)
        if len(samples[0]) == count:
            break
    tau = problem.loaded_arm.inverse_dynamics(*samples[1:])
    measured = measure(problem, *samples, tau)
    return Trajectory(problem, *samples, tau, measured, cost, rendezvous_time, planner, rides_until)


def _same_times(t: Array) -> Array:
    """Rising times, with those that differ by rounding made equal: the first of them, at the end the last."""
    apart = np.append(True, np.diff(t) > SAME_TIME * t[-1])
    if apart.all():
        return t
    first: Array = t[np.maximum.accumulate(np.where(apart, np.arange(len(t)), 0))]
    first[first >= t[-1] * (1.0 - SAME_TIME)] = t[-1]
    return first
