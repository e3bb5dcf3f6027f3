"""The straight path of a problem, along which DPCT looks for the least torque."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from planners.dpct.torque.speed_profile import Track
from planners.motion.line import OFF_LINE, reduce_to_line
from planners.motion.path import Path
from planners.problem import FixedJoints, Infeasible, MotionProblem, limit_broken
from planners.robot.limits import LimitKind
from planners.typing import Array

KINDS: tuple[LimitKind, ...] = ("torque", "velocity", "acceleration")


@dataclass(frozen=True)
class Way:
    """The straight path of a problem, ``r`` from 0 to 1: its path, the path's length (0 where the start is the
    target), the stages ``r`` ``(N + 1,)``, the rate of r at time 0, 1/s, and the joint velocities that the start has
    in addition, ``(n,)``, rad/s; None if it has none.
    """

    problem: MotionProblem
    path: Path
    length: float
    r: Array
    speed: float
    across: Array | None

    def joints(self, r: Array) -> tuple[Array, Array, Array]:
        """Joint angles f (eq 9), f' and f'' at ``r``, each ``(samples, n)``."""
        derivatives = self.path.derivatives(self.length * r)
        return derivatives[:, 0], self.length * derivatives[:, 1], self.length**2 * derivatives[:, 2]

    @cached_property
    def track(self) -> Track:
        """The path for the kernels, with the limits of the problem."""
        arm, limits = self.problem.loaded_arm, self.problem.joint_limits
        middles = 0.5 * (self.r[:-1] + self.r[1:])
        q, slope, curvature = self.joints(np.insert(self.r, np.arange(1, len(self.r)), middles))
        still = np.zeros_like(q)
        static = arm.inverse_dynamics(q, still, still)
        inertia = arm.inverse_dynamics(q, still, slope) - static
        centripetal = arm.inverse_dynamics(q, slope, curvature) - static
        table = np.array([limits.array(kind) for kind in KINDS])
        return Track(np.diff(self.r), slope, curvature, inertia, centripetal, static, table)


def way_of(problem: MotionProblem, stages: int) -> Way:
    """The way, after checking that its start, the joint ranges and the hold at its end allow it."""
    along, across = _split_start(problem)
    line = reduce_to_line(replace(problem, qd=along))
    length = float(line.target[0])
    slope = float(np.abs(line.path.derivatives(np.zeros(1))[0, 1]).max())
    speed = 0.0 if abs(line.start[1]) * slope <= OFF_LINE else float(line.start[1])
    if speed < 0.0 or (speed > 0.0 and length == 0.0):
        raise Infeasible("start", "the arm moves away from the target; start at rest, or moving straight towards it")
    r = 0.5 - 0.5 * np.cos(np.pi * np.linspace(0.0, 1.0, stages + 1))
    way = Way(problem, line.path, length, r, speed / length if length > 0.0 else 0.0, across)
    q = way.joints(np.linspace(0.0, 1.0, 4 * stages + 1))[0]
    limits = problem.joint_limits
    outside = np.argwhere(np.abs(q - limits.angle_middle) > limits.angle_half + 1e-9)
    if len(outside):
        sample, joint = outside[0]
        message = f"joint {joint + 1} leaves its range of angles after {sample / (4 * stages):.0%} of the straight path"
        raise Infeasible("limits", message, kind="angle", joint=int(joint))
    still = np.zeros(problem.arm.n_joints)
    held = np.abs(problem.loaded_arm.bias(q[-1], still)) / np.array(problem.joint_limits.torque)
    if (held > 1.0).any():
        raise limit_broken("limits", "holds the arm at the target only with", held[None], KINDS)
    return way


def _split_start(problem: MotionProblem) -> tuple[Array, Array | None]:
    """The start's joint velocities along the straight joint path towards the target, and what is left of them.

    ``(n,)`` each, rad/s; None is left where the path is the hand's, or the difference is rounding.
    """
    q, qd, _ = problem.start
    if not isinstance(problem.target, FixedJoints):
        return qd, None
    direction = problem.target.q - q
    square = float(direction @ direction)
    along = max(0.0, float(qd @ direction)) / square * direction if square > 0.0 else np.zeros_like(qd)
    return (along, qd - along) if np.abs(qd - along).max() > OFF_LINE else (qd, None)
