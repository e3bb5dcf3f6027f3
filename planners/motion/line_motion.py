"""Joint motion of an arm along its line: dense samples, their loads on the limits, and the `Trajectory` they make."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from planners.motion.line import Line
from planners.robot.limits import LimitKind
from planners.trajectory import Trajectory, sampled_trajectory
from planners.typing import Array

KINDS: tuple[LimitKind, ...] = ("torque", "velocity", "acceleration", "jerk")

RIDE_STEP, MOST_RIDE = 0.005, 4000
"""Sampling step after the rendezvous, s, unless that is more than so many."""

LONGEST_RIDE = 1e6
"""Longest time with the target in a motion, s: in a longer one the times before it would differ by rounding only."""


class Motion(NamedTuple):
    """Samples of a motion along the line by exact kinematics and inverse dynamics, ``(samples, n)`` each, ``t`` 1D.

    Where the jerk jumps there are two samples, one for either side.
    """

    t: Array
    q: Array
    tau: Array
    qd: Array
    qdd: Array
    jerk: Array

    def load(self, line: Line) -> Array:
        """|value| / limit of torque, velocity, acceleration and jerk, ``(samples, 4, n)``."""
        return np.abs(np.stack([self.tau, self.qd, self.qdd, self.jerk], axis=1)) / limit_table(line)

    def peak_load(self, line: Line) -> Array:
        """The largest loads, ``(4, n)``; parabolas through three neighbours give the peaks between samples."""
        load = self.load(line)
        peak: Array = load.max(axis=0)
        steps = np.diff(self.t)
        triples = np.flatnonzero(np.abs(np.diff(steps)) < 1e-6 * steps[1:])  # of one stage
        left, middle, right = load[triples], load[triples + 1], load[triples + 2]
        curvature, slope = 2.0 * middle - left - right, right - left
        vertex = np.abs(slope) <= 2.0 * curvature  # a maximum within the three
        rise = np.divide(slope**2, 8.0 * curvature, out=np.zeros_like(middle), where=vertex & (curvature > 0.0))
        np.maximum(peak, (middle + rise).max(axis=0, initial=0.0), out=peak)
        return peak


def limit_table(line: Line) -> Array:
    """Limits of torque, velocity, acceleration and jerk, ``(4, n)``."""
    return np.array([line.problem.joint_limits.array(kind) for kind in KINDS])


def joint_motion(line: Line, r: Array, v: Array, a: Array, j: Array) -> tuple[Array, Array, Array, Array, Array]:
    """``q``, torque (eq 8), ``qd``, ``qdd`` and joint jerk (eq 9-11), exactly, each ``(samples, n)``."""
    f = line.path.derivatives(r)
    v, a, j = v[:, None], a[:, None], j[:, None]
    qd = f[:, 1] * v
    qdd = f[:, 2] * v**2 + f[:, 1] * a
    jerk = f[:, 3] * v**3 + 3.0 * f[:, 2] * v * a + f[:, 1] * j
    q = np.ascontiguousarray(f[:, 0])
    return q, line.arm.inverse_dynamics(q, qd, qdd), qd, qdd, jerk


def sample_ride(line: Line, begin: float, end: float) -> Motion:
    """The motion with the target from ``begin`` to ``end`` (s, both included), cut where riding breaks a limit.

    It lasts `LONGEST_RIDE` at most.
    """
    end = min(end, begin + LONGEST_RIDE)
    steps = min(math.ceil((end - begin) / RIDE_STEP), MOST_RIDE)
    t = np.linspace(begin, end, steps + 1)
    motion = Motion(t, *joint_motion(line, *line.target_at(t), np.zeros_like(t)))
    excess = np.flatnonzero(motion.load(line).max(axis=(1, 2)) > 1.0)
    kept = int(excess[0]) if len(excess) else len(t)
    return Motion(*(values[:kept] for values in motion))


def to_trajectory(
    line: Line, motions: list[Motion], window_closes: float, rendezvous: float, cost: float, planner: str
) -> Trajectory:
    """Consecutive motions as one trajectory with its worst loads.

    Args:
        line: of the motions.
        motions: in order.
        window_closes: until when the target can be ridden, s.
        rendezvous, cost, planner: see `Trajectory`.
    """
    t, q, _, qd, qdd, _ = Motion(*(np.concatenate(values) for values in zip(*motions, strict=True)))
    cut = t[-1] < min(line.problem.horizon, window_closes) - 1e-9
    until = float(t[-1]) if cut else window_closes
    return sampled_trajectory(
        line.problem, t, q, qd, qdd, planner=planner, cost=cost, rendezvous_time=rendezvous, rides_until=until
    )
