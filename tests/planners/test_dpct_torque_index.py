from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from envs.min_torque_move.moves import random_moves
from planners import (
    PLANAR_3R,
    SCARA_1M,
    Arm,
    FixedHand,
    FixedJoints,
    Infeasible,
    JointLimits,
    MotionProblem,
    MovingHand,
    Trajectory,
    dpct,
    quintic,
)
from planners.typing import Array

UPRIGHT = replace(PLANAR_3R, gravity=9.81, limits=replace(PLANAR_3R.limits, torque=(40.0, 20.0, 10.0)))
ROD = Arm("rod", lengths=(1.0,), masses=(3.0,), limits=JointLimits(torque=(2.0,)))
"""Inertia about its joint: m l^2 / 3 = 1 kg m^2."""

WEAK = replace(ROD, gravity=9.81, limits=JointLimits(torque=(10.0,)))
"""Its weight takes up to 14.7 N m."""


def move(arm: Arm, start: list[float], goal: list[float], horizon: float, **options: Any) -> MotionProblem:
    return MotionProblem(arm, np.array(start), FixedJoints(np.array(goal)), horizon, **options)


def plan(problem: MotionProblem, **options: Any) -> Trajectory:
    return dpct.plan(problem, variant="torque", **options)


def plan_or_refusal(problem: MotionProblem) -> Trajectory | Infeasible:
    try:
        return plan(problem)
    except Infeasible as refusal:
        return refusal


def assert_sound(problem: MotionProblem, motion: Trajectory) -> None:
    """Starts and ends where it should, when it should, within its limits, and its samples belong together."""
    assert motion.t[0] == 0.0
    assert (np.diff(motion.t) >= 0.0).all()
    assert motion.duration == problem.horizon
    np.testing.assert_allclose(motion.q[0], problem.q, atol=1e-12)
    np.testing.assert_allclose(motion.qd[0], problem.start[1], rtol=6e-4, atol=1e-5)
    np.testing.assert_array_equal(motion.qd[-1], 0.0)
    if isinstance(problem.target, FixedJoints):
        np.testing.assert_array_equal(motion.q[-1], problem.target.q)
    assert motion.limit_ratio <= 1.0
    arm, limits = problem.loaded_arm, problem.joint_limits
    apart = np.diff(motion.t) > 0.0
    h = np.diff(motion.t)[apart, None]
    q, rate, acceleration = 0.5 * (motion.q[1:] + motion.q[:-1]), np.diff(motion.q, axis=0), np.diff(motion.qd, axis=0)
    q, rate, acceleration = q[apart], rate[apart] / h, acceleration[apart] / h
    mean = 0.5 * (motion.qd[1:] + motion.qd[:-1])[apart]
    np.testing.assert_allclose(rate, mean, atol=1e-5 + 1e-4 * np.abs(rate).max())
    tau = arm.inverse_dynamics(q, rate, acceleration)
    assert (np.abs(tau) <= 1.0002 * np.array(limits.torque)).all()
    assert (np.abs(rate) <= 1.0001 * np.array(limits.velocity)).all()
    assert (np.abs(acceleration) <= 1.0001 * np.array(limits.acceleration)).all()
    spent = np.sum(np.abs(tau) * h)  # by midpoints, where the samples' trapezoids count a change of sign otherwise
    assert spent == pytest.approx(np.trapezoid(np.abs(motion.tau).sum(axis=1), motion.t), rel=5e-3)


# against closed forms


@pytest.mark.parametrize("horizon", [1.5, 2.0, 5.0])
def test_one_joint_goes_bang_coast_bang(horizon: float) -> None:
    """Torque 2 N m for t with 2 t (T - t) = 1 rad, none, and the same again: PI1 = 4 t."""
    pulse = 0.5 * (horizon - math.sqrt(horizon**2 - 2.0))
    problem = move(ROD, [0.3], [1.3], horizon)
    motion = plan(problem)
    assert_sound(problem, motion)
    assert 0.9999 <= motion.cost / (4.0 * pulse) <= 1.002
    assert motion.limit_ratio > 0.999


def test_one_joint_has_a_cubic_for_the_least_squared_torque() -> None:
    """PI2 of the cubic from rest to rest: 12 I^2 D^2 / T^3."""
    problem = move(ROD, [0.3], [1.3], 3.0)
    assert plan(problem, objective="PI2").cost == pytest.approx(12.0 / 27.0, rel=1e-3)


def test_one_joint_needs_the_time_of_bang_bang() -> None:
    with pytest.raises(Infeasible, match=r"late: the straight path takes 1\.4143 s; .*raise it") as refusal:
        plan(move(ROD, [0.3], [1.3], 1.4))
    assert refusal.value.reason == "late"
    assert math.sqrt(2.0) <= refusal.value.details["minimum_time"] <= 1.0002 * math.sqrt(2.0)  # type: ignore[operator]


def test_a_moving_start_coasts() -> None:
    """At the speed that brings it there in time it only has to brake; a torque of 2 N m stops 1 rad/s in 0.5 s."""
    problem = move(ROD, [0.0], [1.0], 1.25, qd=np.array([1.0]))
    motion = plan(problem)
    assert_sound(problem, motion)
    assert motion.cost == pytest.approx(1.0, rel=1e-3)


@pytest.mark.parametrize(
    "problem",
    [
        move(ROD, [0.0], [1.0], 2.5, qd=np.array([-0.5])),
        move(PLANAR_3R, [0.0, 0.5, 0.5], [1.0, 0.2, 0.0], 1.0, qd=np.array([0.3, 0.2, -0.2])),
        move(PLANAR_3R, [0.0, 0.5, 0.5], [0.0, 0.5, 0.5], 1.0, qd=np.array([0.1, -0.1, 0.1])),
    ],
    ids=["away from the target", "across the path", "at the target"],
)
def test_a_start_that_moves_off_the_path_is_brought_back(problem: MotionProblem) -> None:
    motion = plan(problem)
    assert_sound(problem, motion)
    assert motion.limit_ratio <= 1.0


def test_time_left_over_is_spent_where_holding_costs_least() -> None:
    """From hanging down to stretched out and a long time: it hangs as long as it can."""
    rod = replace(ROD, gravity=9.81, limits=JointLimits(torque=(40.0,)))
    problem = move(rod, [-math.pi / 2.0], [0.0], 10.0)
    motion = plan(problem)
    assert_sound(problem, motion)
    assert motion.cost < 0.1 * 10.0 * 3.0 * 9.81 * 0.5
    np.testing.assert_allclose(motion.at(np.linspace(0.0, 8.0, 9))[0][:, 0], -math.pi / 2.0, atol=0.02)
    assert plan(replace(problem, horizon=20.0)).cost == pytest.approx(motion.cost, rel=0.01)


def test_an_arm_too_weak_to_hold_itself_falls_and_rests_below() -> None:
    problem = move(WEAK, [0.0], [-math.pi / 2.0], 9.0)
    motion = plan(problem)
    assert_sound(problem, motion)
    assert (motion.at(np.linspace(1.5, 9.0, 9))[0] < -math.acos(10.0 / 14.715)).all()


# against an independent optimisation of the same path


def reference(problem: MotionProblem, cells: int = 160, rounds: int = 25) -> float:
    """PI1 by sequential linear programming in the speeds ``v(r)``, started from the quintic, with a trust region.

    Over a cell of constant acceleration the integral of the torque over time is A dv + B (integral of v dr) + G dt.
    """
    assert isinstance(problem.target, FixedJoints)
    arm, change = problem.loaded_arm, np.asarray(problem.target.q - problem.q)
    s = np.linspace(0.0, 1.0, cells + 1)
    r = s**2 * (3.0 - 2.0 * s)
    dr, middle = np.diff(r), 0.5 * (r[1:] + r[:-1])
    n, horizon = arm.n_joints, problem.horizon
    q = problem.q + middle[:, None] * change
    zero, ones = np.zeros_like(q), np.broadcast_to(change, q.shape)
    static = arm.inverse_dynamics(q, zero, zero)
    inertia = arm.inverse_dynamics(q, zero, ones.copy()) - static
    centripetal = arm.inverse_dynamics(q, ones.copy(), zero) - static
    limit = np.array(problem.joint_limits.torque)

    def motion(v: Array) -> tuple[Array, Array, Array]:
        """Durations, torque impulses and torques of the cells."""
        dt = 2.0 * dr / (v[1:] + v[:-1])
        impulse = inertia * np.diff(v)[:, None] + centripetal * (0.5 * dr * (v[1:] + v[:-1]))[:, None]
        impulse = impulse + static * dt[:, None]
        return dt, impulse, impulse / dt[:, None]

    def merit(v: Array) -> float:
        dt, impulse, tau = motion(v)
        over = np.maximum(np.abs(tau) / limit - 1.0, 0.0).sum() + abs(dt.sum() / horizon - 1.0) * 100.0
        return float(np.abs(impulse).sum() * (1.0 + over))

    time = np.linspace(0.0, 1.0, 2001)
    quintic_r = time**3 * (10.0 - 15.0 * time + 6.0 * time**2)
    v = np.interp(r, quintic_r, 30.0 * (time * (1.0 - time)) ** 2 / horizon)
    v[1:-1] = np.maximum(v[1:-1], 0.05 / horizon)
    reach, best, best_v = 0.3, math.inf, v
    inner = cells - 1
    for _ in range(rounds):
        dt, impulse, tau = motion(v)
        jacobians = []  # of dt and, joint by joint, of impulse and torque by the inner speeds
        by_dt = np.zeros((cells, cells + 1))
        for side in (0, 1):
            by_dt[np.arange(cells), np.arange(cells) + side] = -(dt**2) / (2.0 * dr)
        for i in range(n):
            by_impulse = static[:, i, None] * by_dt
            for side, sign in ((0, -1.0), (1, 1.0)):
                by_impulse[np.arange(cells), np.arange(cells) + side] += (
                    sign * inertia[:, i] + 0.5 * dr * centripetal[:, i]
                )
            by_tau = by_impulse / dt[:, None] - (tau[:, i] / dt)[:, None] * by_dt
            jacobians.append((by_impulse[:, 1:-1], by_tau[:, 1:-1]))
        eye, none = np.eye(cells), np.zeros((cells, cells))
        rows, bounds = [], []
        for i, (by_impulse, by_tau) in enumerate(jacobians):
            slack = np.hstack([-eye if j == i else none for j in range(n)])
            for sign in (1.0, -1.0):
                rows += [np.hstack([sign * by_impulse, slack]), np.hstack([sign * by_tau, 0.0 * slack])]
                bounds += [-sign * impulse[:, i], limit[i] - sign * tau[:, i]]
        step = reach * np.maximum(v[1:-1], 0.2 / horizon)
        box = np.column_stack([np.maximum(-step, 0.005 / horizon - v[1:-1]), step])
        solution = linprog(
            np.concatenate([np.zeros(inner), np.ones(n * cells)]),
            A_ub=np.vstack(rows),
            b_ub=np.concatenate(bounds),
            A_eq=np.concatenate([by_dt.sum(axis=0)[1:-1], np.zeros(n * cells)])[None],
            b_eq=[horizon - dt.sum()],
            bounds=[*box.tolist(), *[(0.0, None)] * (n * cells)],
        )
        if solution.status != 0:
            reach *= 0.5
            continue
        v = v + np.concatenate([[0.0], np.asarray(solution.x)[:inner], [0.0]])
        value = merit(v)
        if value < best:
            best, best_v = value, v
        else:
            v, reach = best_v, 0.5 * reach
    return best


@pytest.mark.parametrize("arm", [PLANAR_3R, UPRIGHT], ids=["horizontal", "vertical"])
def test_torque_is_that_of_an_independent_optimum_on_the_same_path(arm: Arm) -> None:
    for problem in random_moves(4, 21, arm):
        least = reference(problem)
        assert 0.995 * least <= plan(problem).cost <= 1.01 * least < quintic.plan(problem).cost


# random problems


@pytest.mark.parametrize("arm", [PLANAR_3R, UPRIGHT], ids=["horizontal", "vertical"])
def test_no_random_move_takes_more_torque_than_the_quintic(arm: Arm) -> None:
    ratios = []
    for problem in random_moves(40, 4, arm):
        motion = plan(problem)
        assert_sound(problem, motion)
        ratios.append(motion.cost / quintic.plan(problem).cost)
    assert max(ratios) <= 1.0
    assert np.median(ratios) < 0.8


angles = st.floats(-2.6, 2.6)
postures = st.tuples(angles, angles, angles)


@settings(max_examples=60, deadline=None)
@given(postures, postures, st.floats(0.2, 6.0), st.sampled_from([0.0, 9.81]), st.booleans())
def test_limits_are_kept_or_the_least_time_that_does_is_named(
    start: tuple[float, ...], goal: tuple[float, ...], horizon: float, gravity: float, slow_joints: bool
) -> None:
    rates = {"velocity": (3.0, 4.0, 5.0), "acceleration": (20.0, 30.0, 40.0)} if slow_joints else {}
    arm = replace(UPRIGHT, gravity=gravity, limits=replace(UPRIGHT.limits, **rates))
    problem = move(arm, list(start), list(goal), horizon)
    answer = plan_or_refusal(problem)
    if isinstance(answer, Infeasible):
        least = answer.details["minimum_time"]
        assert isinstance(least, float)
        assert least > horizon
        problem = replace(problem, horizon=least)
        answer = plan(problem)
    assert_sound(problem, answer)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.05, 0.9), st.sampled_from([PLANAR_3R, UPRIGHT]))
def test_a_plan_made_on_the_way_takes_no_more_torque_than_the_rest_of_the_first(
    seed: int, share: float, arm: Arm
) -> None:
    problem = random_moves(1, seed, arm)[0]
    first = plan(problem)
    now = share * problem.horizon
    q, qd, qdd = first.at(now)
    onward = replace(problem, q=q, qd=qd, qdd=qdd, horizon=problem.horizon - now)
    second = plan(onward)
    assert_sound(onward, second)
    t = np.union1d(first.t[first.t > now], [now])
    left = np.abs(arm.inverse_dynamics(*first.at(t))).sum(axis=1)
    assert second.cost <= np.trapezoid(left, t) + 0.02 * first.cost


def test_a_longer_time_takes_less_torque_without_gravity() -> None:
    costs = [plan(move(PLANAR_3R, [0.0, 1.0, -2.0], [1.0, -1.0, 2.0], T)).cost for T in (1.0, 1.1, 1.5, 3.0, 10.0)]
    assert (np.diff(costs) < 0.0).all()


# the hand's way, payload, and the same twice


def test_the_hand_goes_straight_to_a_fixed_point() -> None:
    problem = MotionProblem(
        SCARA_1M,
        np.array([0.3, 1.2]),
        FixedHand(np.array([0.2, 1.2])),
        3.0,
        limits=JointLimits(torque=(2.0, 1.0), velocity=(1.0, 1.0), acceleration=(4.0, 4.0)),
    )
    motion = plan(problem)
    assert_sound(problem, motion)
    hand = SCARA_1M.forward_kinematics(motion.q)
    along = np.array([0.2, 1.2]) - hand[0]
    np.testing.assert_allclose(hand[-1], [0.2, 1.2], atol=1e-12)
    offset = hand - hand[0]
    np.testing.assert_allclose(offset[:, 0] * along[1] - offset[:, 1] * along[0], 0.0, atol=1e-12)


def test_a_payload_takes_more_torque() -> None:
    problem = move(PLANAR_3R, [0.0, 0.5, 0.0], [1.0, 0.0, 0.5], 1.5)
    loaded = replace(problem, payload=1.0)
    motion = plan(loaded)
    assert_sound(loaded, motion)
    assert motion.cost > 1.1 * plan(problem).cost


def test_staying_takes_what_holding_takes() -> None:
    problem = move(UPRIGHT, [0.3, 0.2, 0.1], [0.3, 0.2, 0.1], 2.0)
    motion = plan(problem)
    assert_sound(problem, motion)
    assert motion.cost == pytest.approx(2.0 * np.abs(UPRIGHT.bias(problem.q, np.zeros(3))).sum())


def test_the_same_problem_has_the_same_plan() -> None:
    problem = random_moves(1, 5, UPRIGHT)[0]
    first, second = plan(problem), plan(problem)
    np.testing.assert_array_equal(first.tau, second.tau)
    np.testing.assert_array_equal(first.t, second.t)


def test_a_limit_of_jerk_is_refused() -> None:
    with pytest.raises(ValueError, match=r"dpct .torque. keeps no jerk limits; .*dpct .optimal"):
        plan(move(SCARA_1M, [0.0, 1.0], [0.5, 1.0], 10.0))


def test_time_and_torque_index_are_the_planners_own() -> None:
    motion = plan(move(PLANAR_3R, [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], 1.0))
    assert motion.planner == "dpct (torque)"
    assert motion.rendezvous_time == motion.duration == 1.0
    assert motion.cost == pytest.approx(np.trapezoid(np.abs(motion.tau).sum(axis=1), motion.t))
    assert motion.cost < 3.12  # the quintic's is 5.50


# refusals


@pytest.mark.parametrize(
    ("problem", "message"),
    [
        (move(ROD, [0.0], [1.0], 2.0, qd=np.array([3.0])), r"start: the start speed is 1\.5 times the largest"),
        (move(PLANAR_3R, [0.0] * 3, [1.0, 0.0, 0.0], 0.7, qd=-5.0 * np.ones(3)), "start: beside the straight path"),
        (move(PLANAR_3R, [0.0] * 3, [0.0, 2.7, 0.0], 1.0), "limits: the target has joint 2 at 2.7 rad"),
        (move(UPRIGHT, [-1.6, 0.0, 0.0], [0.0] * 3, 2.0, payload=5.0), "limits: joint . holds the arm at the target"),
        (move(WEAK, [-math.pi / 2], [math.pi / 2], 2.0), "limits: the limits require a start at"),
        (move(UPRIGHT, [0.0] * 3, [-math.pi / 2, 0.0, 0.0], 9.0, payload=5.0), "limits: at .* no speed leads to rest"),
    ],
    ids=["too fast", "across", "range", "hold", "climb", "brake"],
)
def test_refusals_say_what_is_wrong(problem: MotionProblem, message: str) -> None:
    with pytest.raises(Infeasible, match=message):
        plan(problem)


def test_options_are_checked() -> None:
    problem = move(ROD, [0.0], [1.0], 2.0)
    with pytest.raises(ValueError, match="'PI3' must be one of 'PI1', 'PI2'"):
        plan(problem, objective="PI3")
    with pytest.raises(ValueError, match="stages 5 must be from 10"):
        plan(problem, stages=5)
    with pytest.raises(ValueError, match=r"goes to a target of kind joints or hand, not moving hand; .*dpct .optimal"):
        plan(MotionProblem(SCARA_1M, np.array([0.0, 1.0]), MovingHand(np.ones(2), np.ones(2)), 2.0))
