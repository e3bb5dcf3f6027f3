"""From stages of constant jerk to dense samples: what is checked, and what is returned."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from planners.dpct.constraints import Course, roll_out
from planners.dpct.interior_point import Solution
from planners.motion.line import Line
from planners.motion.rides import KINDS, Window, joint_motion, limit_table
from planners.problem import Trajectory
from planners.typing import Array

DENSE_STEP, RIDE_STEP = 0.002, 0.005
"""Largest sampling step before and after the rendezvous, s."""


class Motion(NamedTuple):
    """Samples of a motion along the line, by exact kinematics and inverse dynamics, ``(samples, n)`` each but ``t``.

    At an instant at which the jerk jumps there are two samples, one for either side.
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
        """The largest loads, ``(4, n)``, with the peaks between samples by parabolas through three neighbours."""
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


def sample_manoeuvre(line: Line, course: Course, solution: Solution) -> Motion:
    """The motion up to the rendezvous."""
    durations = course.durations * solution.time
    parts = np.maximum(np.ceil(durations / DENSE_STEP).astype(int), 2)
    stage = np.repeat(np.arange(len(durations)), parts + 1)
    part = np.arange(len(stage)) - (np.cumsum(parts + 1) - (parts + 1))[stage]
    s = durations[stage] * (part / parts[stage])
    z = roll_out(course, solution.time, solution.acceleration, solution.jerk * solution.time**3)
    e, ed, edd = (z[stage, i] / solution.time**i for i in range(3))
    j = solution.jerk[stage]
    t = (np.cumsum(durations) - durations)[stage] + s
    r, v, a = line.target_at(t)
    r += e + s * (ed + s * (edd / 2.0 + s * j / 6.0))
    v += ed + s * (edd + s * j / 2.0)
    a += edd + s * j
    return Motion(t, *joint_motion(line, r, v, a, j))


def sample_ride(line: Line, begin: float, end: float) -> Motion:
    """The motion with the target from ``begin`` to ``end``, both included, or to where riding on breaks a limit."""
    t = np.linspace(begin, end, math.ceil((end - begin) / RIDE_STEP) + 1)
    motion = Motion(t, *joint_motion(line, *line.target_at(t), np.zeros_like(t)))
    excess = np.flatnonzero(motion.load(line).max(axis=(1, 2)) > 1.0)
    kept = int(excess[0]) if len(excess) else len(t)
    return Motion(*(values[:kept] for values in motion))


def to_trajectory(line: Line, motions: list[Motion], window: Window, rendezvous: float, cost: float) -> Trajectory:
    """Motions that follow each other, as one trajectory with its worst loads."""
    load = np.max([motion.peak_load(line) for motion in motions], axis=(0, 2))
    joined = Motion(*(np.concatenate(values) for values in zip(*motions, strict=True)))
    last_of_instant = np.append(np.diff(joined.t) > 1e-12, True)
    t, q, tau, qd, qdd, _ = (values[last_of_instant] for values in joined)
    angle = float(np.max(np.abs(q) / np.array(line.problem.joint_limits.angle)))
    cut = t[-1] < min(line.problem.horizon, window.closes) - 1e-9
    return Trajectory(
        t=t,
        q=q,
        qd=qd,
        qdd=qdd,
        tau=tau,
        limit_ratios={**dict(zip(KINDS, load.tolist(), strict=True)), "angle": angle},
        cost=cost,
        rendezvous_time=rendezvous,
        planner="dpct (optimal)",
        rides_until=float(t[-1]) if cut else window.closes,
    )
