"""The earliest meeting off the line: what it keeps, and that no motion of the joints is earlier."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog

from planners import SCARA_1M, Arm, FixedJoints, Infeasible, JointLimits, MotionProblem, MovingHand, Trajectory, dpct
from planners.typing import Array
from tests.planners.dpct_cases import HAND, conveyor

TOLERANCES = {"position_tolerance": 1e-3, "velocity_tolerance": 2e-3}
THREE = Arm("three", (1.0, 1.0, 0.2), (1.0, 1.0, 0.2), JointLimits((0.8, 0.4, 0.1), 0.4, 0.4, 2.0))


def plan(problem: MotionProblem, **options: Any) -> Trajectory:
    return dpct.plan(problem, variant="free", **options)


def errors(motion: Trajectory, t: Array) -> tuple[Array, Array]:
    """Distance of the hand from the target and difference of their velocities, ``(samples,)`` each."""
    q, qd, _ = motion.at(t)
    place, velocity = motion.problem.target.at(t)  # type: ignore[union-attr]
    moving = np.einsum("lij,lj->li", SCARA_1M.jacobian(q) if q.shape[1] == 2 else THREE.jacobian(q), qd)
    hand = motion.problem.arm.forward_kinematics(q)
    return np.hypot(*(hand - place).T), np.hypot(*(moving - velocity).T)


def beside(**changes: Any) -> MotionProblem:
    """A belt that runs 0.06 m beside the hand at the start, slanted and accelerating."""
    target = MovingHand(HAND + np.array([0.02, 0.06]), np.array([0.08, -0.02]), np.array([0.02, -0.005]))
    return replace(conveyor(), target=target, **changes)


def three_links() -> MotionProblem:
    q = np.array([2.2, -1.2, 0.4])
    hand = THREE.forward_kinematics(q)
    return MotionProblem(THREE, q, MovingHand(hand - (0.1, 0.05), np.array([0.1, 0.0])), 4.0)


MOVING = {"qd": np.array([0.05, -0.08]), "qdd": np.array([0.1, 0.1])}
CURVED = MovingHand(HAND - np.array([0.05, 0.02]), np.array([0.1, 0.0]), np.array([0.0, -0.02]))
PROBLEMS = {
    "on the line": conveyor(),
    "other elbow": conveyor(elbow=1, lead=-0.15),
    "beside it": beside(),
    "in motion": beside(**MOVING),
    "on a curve": replace(conveyor(), target=CURVED),
    "with a payload": beside(payload=0.2),
    "three links": three_links(),
    "without limits of jerk": replace(beside(), limits=replace(SCARA_1M.limits, jerk=(math.inf, math.inf))),
}


@pytest.mark.parametrize("name", PROBLEMS)
@pytest.mark.parametrize("options", [{}, TOLERANCES], ids=["exact", "within tolerances"])
def test_it_starts_as_given_keeps_the_limits_and_rides_with_the_target(name: str, options: dict[str, float]) -> None:
    problem = PROBLEMS[name]
    motion = plan(problem, **options)
    for first, given in zip((motion.q, motion.qd, motion.qdd), problem.start, strict=True):
        np.testing.assert_allclose(first[0], given, atol=1e-9)
    assert motion.limit_ratio <= 1.0
    assert motion.rendezvous_time < problem.horizon
    away, faster = errors(motion, np.linspace(motion.rendezvous_time, motion.duration, 300))
    assert away.max() < 1e-6
    assert faster.max() < 1e-5
    if problem.arm.n_joints == 3:
        np.testing.assert_allclose(motion.q[-1].sum(), problem.q.sum(), atol=1e-6)


@pytest.mark.parametrize("lead", [0.1, 0.05, 0.2])
def test_it_meets_the_part_earlier_than_on_the_line_and_settles_earlier_still(lead: float) -> None:
    problem = conveyor(lead=lead)
    line, free = dpct.plan(problem, allow_reverse=True).rendezvous_time, plan(problem).rendezvous_time
    motion = plan(problem, **TOLERANCES)
    t = np.arange(0.0, motion.duration, 1e-3)
    away, faster = errors(motion, t)
    settled = t[np.flatnonzero((away > 1e-3) | (faster > 2e-3))[-1]]
    assert settled + 0.02 < free < line + 1e-3


def reachable(problem: MotionProblem, joint: int, time: float, stages: int = 150) -> bool:
    """Whether one joint can be with the ride at a time within its limits of velocity, acceleration and jerk.

    A linear program over pieces of constant jerk, with the ride by inverse kinematics and differences.
    """
    target, h = problem.target, time / stages
    assert isinstance(target, MovingHand)
    step = 1e-3
    around = [SCARA_1M.inverse_kinematics(target.at(time + k * step)[0])[0][joint] for k in (-1, 0, 1)]
    goal = around[1], (around[2] - around[0]) / (2.0 * step), (around[2] - 2.0 * around[1] + around[0]) / step**2
    start = [float(values[joint]) for values in problem.start]
    left = h * np.arange(stages, 0, -1)
    effect = np.stack([(left**3 - (left - h) ** 3) / 6.0, (left**2 - (left - h) ** 2) / 2.0, np.full(stages, h)])
    drift = start[0] + time * (start[1] + 0.5 * time * start[2]), start[1] + time * start[2], start[2]
    past = np.tril(np.ones((stages, stages)))
    steps = np.arange(1, stages + 1)
    after = np.maximum(0.0, h * (steps[:, None] - steps[None] + 1))
    speed = past * (after**2 - np.maximum(0.0, after - h) ** 2) / 2.0
    limits = problem.joint_limits
    rows = np.vstack([h * past, -h * past, speed, -speed])
    acceleration, velocity = limits.acceleration[joint], limits.velocity[joint]
    coast = start[1] + h * steps * start[2]
    spare = [np.full(stages, acceleration - start[2]), np.full(stages, acceleration + start[2])]
    bounds = np.concatenate([*spare, velocity - coast, velocity + coast])
    jerk = limits.jerk[joint]
    found = linprog(np.zeros(stages), rows, bounds, effect, np.subtract(goal, drift), (-jerk, jerk), method="highs")
    return bool(found.status == 0)


@pytest.mark.parametrize("problem", [conveyor(), beside()], ids=["on the line", "beside it"])
def test_without_torque_limits_no_motion_of_the_joints_is_earlier(problem: MotionProblem) -> None:
    limits = replace(SCARA_1M.limits, torque=(math.inf, math.inf))
    problem = replace(problem, limits=limits)
    earliest = plan(problem, stages=80).rendezvous_time
    assert all(reachable(problem, joint, 1.001 * earliest) for joint in (0, 1))
    assert not all(reachable(problem, joint, 0.985 * earliest) for joint in (0, 1))


def test_a_hand_that_rides_already_goes_on() -> None:
    met = plan(conveyor())
    t = met.rendezvous_time + 0.3
    q, qd, qdd = met.at(t)
    place, velocity = met.problem.target.at(t)  # type: ignore[union-attr]
    motion = plan(replace(conveyor(), q=q, qd=qd, qdd=qdd, target=MovingHand(place, velocity), horizon=1.0))
    assert motion.rendezvous_time == 0.0
    assert errors(motion, motion.t)[0].max() < 1e-5


def test_the_same_problem_has_the_same_plan_whatever_came_before() -> None:
    first = plan(beside(), **TOLERANCES)
    plan(conveyor())
    np.testing.assert_array_equal(plan(beside(), **TOLERANCES).q, first.q)


@pytest.mark.parametrize(
    ("problem", "message"),
    [
        (conveyor(qd=np.array([0.3, 0.0])), "start: joint 1 starts at 1.5 times its velocity limit"),
        (replace(conveyor(), target=MovingHand([5.0, 0.0], [0.1, 0.0])), "unreachable: within 3 s the target never is"),
        (conveyor(speed=0.9), "no_window: joint . follows the target only at .* times its"),
        (conveyor(horizon=1.2), r"late: no motion within the limits found that meets the target by 1\.2 s"),
    ],
    ids=["start", "reach", "too fast", "too late"],
)
def test_refusals_say_what_is_wrong(problem: MotionProblem, message: str) -> None:
    with pytest.raises(Infeasible, match=message):
        plan(problem)


def test_options_are_checked() -> None:
    with pytest.raises(ValueError, match=r"velocity_tolerance 0\.0 m/s must both be positive, or both 0"):
        plan(conveyor(), position_tolerance=1e-3)
    with pytest.raises(ValueError, match="stages 5 must be from 10"):
        plan(conveyor(), stages=5)
    with pytest.raises(ValueError, match="goes to a target of kind moving hand, not joints"):
        plan(replace(conveyor(), target=FixedJoints([0.0, 1.0])))
