"""The straight move: all joints along a line in joint space with a trapezoid of speed, as fast as limits allow.

Obstacles play no part in it. The baseline of planners that avoid obstacles. A moving start first brakes to rest.
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

from planners.capabilities import SMOOTHLESS, Takes, variant
from planners.checks import require_choice, rounded_up
from planners.goals import goal_postures
from planners.motion.time_laws import trapezoid, trapezoid_share
from planners.problem import FixedHand, FixedJoints, Infeasible, MotionProblem
from planners.promises import require_within_limits
from planners.trajectory import Trajectory, sampled_trajectory
from planners.typing import Array

SAMPLES = 200
"""Intervals of time into which a motion is divided."""

ATTEMPTS, BACK_OFF = 8, 0.98
"""Attempts with lower accelerations where the torque limits are exceeded, and an extra factor of each."""

SHORTEST_RAMP = 1e7 * float(np.finfo(float).eps)
"""Of a ramp, as a share of the duration: in a shorter one, rounding of times would show as excess of velocity."""

STILL = 1e-3
"""Largest velocity of a joint at the start that counts as rest, rad/s."""

NEEDS = ("velocity", "acceleration")

Contact = Literal["refuse", "delay"]


@variant(
    "trapezoid",
    "",
    {
        "joints": Takes(keeps=SMOOTHLESS, needs=NEEDS),
        "hand": Takes(keeps=SMOOTHLESS, needs=NEEDS),
    },
)
def plan(problem: MotionProblem, *, contact: Contact = "refuse") -> Trajectory:
    """The fastest straight move with limited velocity and acceleration, from rest to rest at the nearest goal posture.

    Where the start moves, all joints brake to rest together before. Where torques do not suffice, all accelerations are
    reduced. Its cost is its duration, s.

    Args:
        problem: with a fixed target.
        contact: ``"refuse"`` a move that touches an obstacle, or, with ``"delay"``, return it.

    Raises:
        Infeasible: with reason ``unreachable`` if the target is out of reach, ``late`` if the horizon is too short,
            ``limits`` if the torques do not suffice, ``collision`` if it touches an obstacle.
        ValueError: if the target moves, or a limit is missing.
    """
    require_choice("contact", contact, get_args(Contact))
    assert isinstance(problem.target, FixedHand | FixedJoints)  # as declared
    q0, qd0, _ = problem.start
    goal = goal_postures(problem, problem.target, "best")[0]
    limits, share = problem.joint_limits, 1.0
    moving = float(np.abs(qd0).max()) > STILL
    for _ in range(ATTEMPTS):
        acceleration = share * limits.array("acceleration")
        braking = float((np.abs(qd0) / acceleration).max()) if moving else 0.0
        change = goal - (q0 + 0.5 * braking * qd0)
        top, ramp = trapezoid(change, limits.array("velocity"), acceleration)
        motion = _sampled(problem, change, top, max(ramp, SHORTEST_RAMP / top), braking)
        excess = motion.limit_ratios["torque"]
        if excess <= 1.0:
            break
        share *= BACK_OFF / excess
    if motion.duration > problem.horizon:
        require_within_limits("trapezoid", motion)  # where weight alone exceeds a limit, no time is enough
        message = f"the straight move takes {rounded_up(motion.duration):.4g} s; allow that much"
        raise Infeasible("late", message, minimum_time=motion.duration)
    return motion


def _sampled(problem: MotionProblem, change: Array, top: float, ramp: float, braking: float) -> Trajectory:
    """The move by ``change``, ``(n,)``, rad, with the top speed (1/s) and the duration of the ramp (s) of its share.

    Before, the start comes to rest in ``braking`` s.
    """
    duration = 1.0 / top + ramp
    edges = [0.0, ramp, duration - ramp, duration]
    t, share, speed, rise = [], [], [], []
    for begin, end, acceleration in zip(edges, edges[1:], (top / ramp, 0.0, -top / ramp), strict=False):
        if end > begin:  # two samples where the acceleration jumps
            times = np.linspace(begin, end, 2 + int(SAMPLES * (end - begin) / duration))
            t.append(times)
            share.append(np.array([trapezoid_share(top, ramp, time) for time in times]))
            speed.append(np.minimum(1.0, np.minimum(times, duration - times) / ramp) * top)
            rise.append(np.full(len(times), acceleration))
    q, qd, qdd = (np.concatenate(values)[:, None] * change for values in (share, speed, rise))
    motion = [np.concatenate(t), problem.q + q, qd, qdd]
    if braking > 0.0:
        q0, qd0, _ = problem.start
        times = np.linspace(0.0, braking, 2 + SAMPLES // 10)
        left = (1.0 - times / braking)[:, None]
        slowing = q0 + 0.5 * braking * (1.0 - left**2) * qd0, left * qd0, np.tile(-qd0 / braking, (len(times), 1))
        later = braking + motion[0], 0.5 * braking * qd0 + motion[1], motion[2], motion[3]
        motion = [np.concatenate(pair) for pair in zip((times, *slowing), later, strict=True)]
    end = braking + duration
    return sampled_trajectory(problem, *motion, planner="trapezoid", cost=end, rendezvous_time=end)
