"""Planned motions as films: `animate` is what `planners.Trajectory.animate` calls."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from agents.figures.film import Film, require_recordable
from envs.rendering import Renderer, Scene
from planners import FixedHand, FixedJoints, MotionProblem, Trajectory
from planners.typing import Array

ROOM = 1.1
"""Half of the side of the visible square, as a multiple of the arm's reach."""


def animate(trajectory: Trajectory, path: Path, *, fps: int, width: int) -> None:
    """Write a motion as a film at its own speed; see `planners.Trajectory.animate`."""
    require_recordable(path, fps=fps, width=width)
    problem, film = trajectory.problem, Film(fps, width)
    x, y = problem.arm.base
    room = ROOM * problem.arm.reach
    renderer = Renderer((x - room, x + room, y - room, y + room), size=(width, 2 * width // 3))
    times = np.append(np.arange(0.0, trajectory.duration, 1.0 / fps), trajectory.duration)
    joints = problem.arm.joint_positions(trajectory.at(times)[0])
    torques = np.stack([np.interp(times, trajectory.t, tau) for tau in trajectory.tau.T], axis=1)
    for index, time in enumerate(times.tolist()):
        scene = _scene(trajectory, time, joints[: index + 1], torques[index])
        film.take(time, partial(renderer.draw, scene), last=index == len(times) - 1)
    renderer.close()
    film.write(path)


def _scene(trajectory: Trajectory, time: float, joints: Array, torque: Array) -> Scene:
    """A frame: the arm at the last of its postures so far ``(samples, n + 1, 2)``, target, discs and loads."""
    problem = trajectory.problem
    loads = [(kind, ratio) for kind, ratio in trajectory.limit_ratios.items() if ratio > 0.0]
    return Scene(
        joints=joints[-1],
        torque_ratios=torque / problem.joint_limits.array("torque"),
        time=time,
        horizon=trajectory.duration,
        title=trajectory.planner,
        trail=joints[:, -1],
        target=_target(problem, time),
        obstacles=tuple((*(disc.position + time * disc.velocity).tolist(), disc.radius) for disc in problem.obstacles),
        limit_gauges=tuple(("joint range" if kind == "angle" else kind, ratio) for kind, ratio in loads),
        settled=time >= trajectory.rendezvous_time,
    )


def _target(problem: MotionProblem, time: float) -> Array:
    """Where the hand should be, ``(2,)``, m."""
    target = problem.target
    if isinstance(target, FixedJoints):
        return problem.arm.forward_kinematics(target.q)
    return target.position if isinstance(target, FixedHand) else target.at(time)[0]
