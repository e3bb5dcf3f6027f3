"""The published DPCT algorithm: known results, its recursion against brute force, and what its plans really do."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Literal

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planners import PLANAR_3R, SCARA_1M, FixedHand, Infeasible, JointLimits, MotionProblem, MovingHand
from planners.dpct.paper import (
    LITERAL,
    MASS_SLIPS,
    REPAIRED,
    PhasePath,
    Reading,
    execute,
    plan_paper,
    search_phase_plane,
)
from planners.typing import Array

GRIDS = ((30, 50), (50, 100), (100, 200))
LIMITS = {1: JointLimits.unlimited(2), 2: JointLimits(torque=(0.5, 0.2)), 3: SCARA_1M.limits}


def paper_problem(case: int = 1, headway: float = 0.1) -> MotionProblem:
    """Section 5.1 of the paper."""
    return MotionProblem(
        arm=SCARA_1M,
        q=SCARA_1M.inverse_kinematics([-0.8, 1.732])[0],
        target=MovingHand([-0.8 - headway, 1.732], [0.2, 0.0]),
        horizon=3.0,
        limits=LIMITS[case],
    )


@pytest.mark.parametrize(
    ("case", "times"), [(1, (0.75, 0.65, 0.575)), (2, (11 / 12, 0.85, 0.875)), (3, (7 / 6, 1.1, 1.125))]
)
def test_rendezvous_times_of_the_literal_reading(case: int, times: tuple[float, ...]) -> None:
    found = [search_phase_plane(paper_problem(case), grid=grid).rendezvous_time for grid in GRIDS]
    assert_allclose(found, times, atol=1e-12)


@pytest.mark.parametrize("reading", MASS_SLIPS[:2], ids=lambda reading: reading.name)
@pytest.mark.parametrize(("case", "published"), [(1, 0.65), (2, 0.80), (3, 1.10)])
def test_some_slips_in_the_mass_matrix_give_every_published_time(case: int, published: float, reading: Reading) -> None:
    found = search_phase_plane(paper_problem(case), reading=reading)
    assert found.rendezvous_time == pytest.approx(published, abs=1e-12)


@pytest.mark.parametrize(
    ("reading", "m11"),
    [
        (MASS_SLIPS[0], lambda c2: 5 / 3 + c2 / 2),
        (MASS_SLIPS[1], lambda c2: 4 / 3 + c2),
        (MASS_SLIPS[2], lambda c2: 5 / 3 * c2),
    ],
    ids=[reading.name for reading in MASS_SLIPS],
)
def test_slips_are_those_of_the_printed_equations(reading: Reading, m11: Callable[[Array], Array]) -> None:
    path = search_phase_plane(paper_problem(2), reading=reading)
    q, qd, qdd = stage_motion(path)
    c2, s2 = np.cos(q[:, 1]), np.sin(q[:, 1])
    tau1 = m11(c2) * qdd[:, 0] + (1 / 3 + c2 / 2) * qdd[:, 1] - s2 * (qd[:, 1] ** 2 / 2 + qd[:, 0] * qd[:, 1])
    tau2 = (1 / 3 + c2 / 2) * qdd[:, 0] + qdd[:, 1] / 3 + s2 * qd[:, 0] ** 2 / 2
    assert_allclose(path.tau, np.stack([tau1, tau2], axis=1), atol=1e-6)


def stage_motion(path: PhasePath) -> tuple[Array, Array, Array]:
    """Joint motion at the stages by the search's own clock; derivatives by r from differences."""
    step = 1e-4
    hands = np.stack(
        [-0.8 + 0.5 * (path.r[:-1, None] + step * np.arange(-1, 2)), np.full((len(path.r) - 1, 3), 1.732)], -1
    )
    before, q, after = (SCARA_1M.inverse_kinematics(hands[:, k])[:, 0] for k in range(3))
    slope, curvature = (after - before) / (2 * step), (after - 2 * q + before) / step**2
    rate_change = np.diff(path.rate) / np.diff(path.clock)
    rate = path.rate[:-1, None]
    return q, slope * rate, curvature * rate**2 + slope * rate_change[:, None]


@pytest.mark.parametrize("reading", [LITERAL, REPAIRED])
def test_own_torques_are_inverse_dynamics_on_the_own_clock(reading: Reading) -> None:
    path = search_phase_plane(paper_problem(2), reading=reading)
    q, qd, qdd = stage_motion(path)
    assert_allclose(path.qd[:-1], qd, atol=1e-7)
    assert_allclose(path.tau, SCARA_1M.inverse_dynamics(q, qd, qdd), atol=1e-6)
    assert (np.abs(path.tau) <= [0.5, 0.2]).all()


def test_path_runs_from_rest_to_the_part() -> None:
    path = search_phase_plane(paper_problem(3))
    assert (path.r[0], path.rate[0], path.r[-1], path.rate[-1]) == (0.0, 0.0, 1.0, pytest.approx(0.4))
    riding = path.clock >= path.rendezvous_time
    assert_allclose(path.r[riding], 0.4 * path.clock[riding] - 0.2, atol=1e-12)
    assert path.r[~riding][-1] != pytest.approx(0.4 * path.clock[~riding][-1] - 0.2)


class BruteForce:
    """Eq 25 to 35 once more, by definition: node by node, without tables, for the paper's scenario."""

    def __init__(self, problem: MotionProblem, grid: tuple[int, int], reading: Reading) -> None:
        self.limits, self.reading = problem.joint_limits, reading
        self.stages, self.states = grid
        self.target_state = round(0.8 * self.states)
        self.offset = (problem.target.position[0] + 0.8) / 0.5  # type: ignore[union-attr]
        self.end = (1.0 - self.offset) / 0.4
        self.slope, self.curvature, self.best = cache(self._slope), cache(self._curvature), cache(self._best)

    def q(self, r: float) -> Array:
        return SCARA_1M.inverse_kinematics([-0.8 + 0.5 * r, 1.732])[0]

    def _slope(self, i: int) -> Array:
        r, step = i / self.stages, 1e-5
        return (self.q(r + step) - self.q(r - step)) / (2 * step)

    def _curvature(self, i: int) -> Array:
        r, step = i / self.stages, 1e-4
        return (self.q(r + step) - 2 * self.q(r) + self.q(r - step)) / step**2

    def rate(self, j: int) -> float:
        return 0.4 * j / self.target_state

    def duration(self, i: int, j: int, k: int) -> float:
        if self.reading.step == "exact":
            return 2 / self.stages / (self.rate(j) + self.rate(k)) if j + k else math.inf
        if i == 0:
            return 1 / self.stages / self.rate(k) if k else math.inf
        return 1 / self.stages / self.rate(j) if j else math.inf

    def step_cost(self, i: int, j: int, dt: float, now: float) -> float:
        cost = dt * ((i / self.stages - self.offset - 0.4 * now) ** 2 + (self.rate(j) - 0.4) ** 2)
        if i == 0 and self.reading.price_wait and now > 0:
            t = np.linspace(0, now, 2001)
            cost += float(np.trapezoid((self.offset + 0.4 * t) ** 2 + 0.16, t))
        return cost

    def step_acceleration(self, i: int, j: int, k: int, dt: float) -> Array:
        return (self.slope(i + 1) * self.rate(k) - self.slope(i) * self.rate(j)) / dt

    def allowed(self, i: int, j: int, k: int, dt: float, after: Array) -> bool:
        rate, change = self.rate(j), (self.rate(k) - self.rate(j)) / dt
        qd = self.slope(i) * rate
        qdd = self.curvature(i) * rate**2 + self.slope(i) * change
        tau = SCARA_1M.inverse_dynamics(self.q(i / self.stages), qd, qdd)
        mean = self.step_acceleration(i, j, k, dt)
        checks = (tau, self.limits.torque), (qd, self.limits.velocity), (mean, self.limits.acceleration)
        return all(
            (np.abs(value) <= limit).all() for value, limit in (*checks, ((after - mean) / dt, self.limits.jerk))
        )

    def _best(self, i: int, j: int) -> tuple[float, float, Array, tuple[int, ...]]:
        """J*, clock, joint acceleration and states to the end of the best way from a node."""
        if i == self.stages:
            riding = self.curvature(i) * 0.16
            return (0.0 if j == self.target_state else math.inf), self.end, riding, ()
        ways = []
        for k in range(self.states + 1):
            dt = self.duration(i, j, k)
            cost, clock, after, tail = self.best(i + 1, k)
            if math.isfinite(dt) and math.isfinite(cost) and self.allowed(i, j, k, dt, after):
                now = clock - dt
                total = cost + self.step_cost(i, j, dt, now)
                ways.append((total, now, self.step_acceleration(i, j, k, dt), (k, *tail)))
        return min(ways, key=lambda way: way[0], default=(math.inf, math.nan, np.zeros(2), ()))

    def cost_of(self, states: tuple[int, ...]) -> float:
        """J of a whole path whose clock runs back from t_f."""
        cost, clock = 0.0, self.end
        for i in reversed(range(self.stages)):
            dt = self.duration(i, states[i], states[i + 1])
            clock -= dt
            cost += self.step_cost(i, states[i], dt, clock)
        return cost


LOOSE = {
    "none": JointLimits.unlimited(2),
    "torque": JointLimits(torque=(0.35, 0.2)),
    "all": JointLimits(torque=(0.6, 0.2), velocity=(0.22, 0.25), acceleration=(0.35, 0.35), jerk=(1.0, 1.0)),
}


@pytest.mark.parametrize("step", ["euler", "exact"])
@pytest.mark.parametrize("limits", LOOSE)
@pytest.mark.parametrize("price_wait", [True, False])
def test_search_agrees_with_the_recursion_written_out(
    step: Literal["euler", "exact"], limits: str, price_wait: bool
) -> None:
    problem, grid = replace(paper_problem(), limits=LOOSE[limits]), (7, 6)
    reading = Reading(step=step, price_wait=price_wait)
    found = search_phase_plane(problem, grid=grid, reading=reading)
    cost, clock, _, states = BruteForce(problem, grid, reading).best(0, 0)
    assert found.cost == pytest.approx(cost, rel=1e-6)
    assert found.clock[0] == pytest.approx(clock, abs=1e-9)
    assert_allclose(found.rate[1:], 0.4 / 5 * np.array(states), atol=1e-12)


@pytest.mark.parametrize("reading", [LITERAL, REPAIRED])
def test_search_misses_cheaper_paths_because_time_is_no_state(reading: Reading) -> None:
    """One clock per node: the best way from a node by its own clock is not the best for those who come through it."""
    grid = (5, 5)
    found = search_phase_plane(paper_problem(), grid=grid, reading=reading)
    brute = BruteForce(paper_problem(), grid, reading)
    states = tuple(int(state) for state in np.round(found.rate / brute.rate(1)))
    assert found.cost == pytest.approx(brute.cost_of(states), rel=1e-6)
    between = itertools.product(range(1, grid[1] + 1), repeat=grid[0] - 1)
    cheapest = min(brute.cost_of((0, *some, brute.target_state)) for some in between)
    assert cheapest < 0.98 * found.cost


def test_waiting_that_is_not_priced_is_used() -> None:
    priced = search_phase_plane(paper_problem(1))
    free = search_phase_plane(paper_problem(1), reading=Reading(price_wait=False))
    assert free.clock[0] > priced.clock[0] + 0.1


@pytest.mark.parametrize("case", [1, 2, 3])
def test_the_own_clock_of_an_euler_step_is_not_the_real_one(case: int) -> None:
    literal = search_phase_plane(paper_problem(case))
    assert literal.clock[0] - literal.real_clock[0] > 0.05
    exact = search_phase_plane(paper_problem(case), reading=REPAIRED)
    assert_allclose(exact.real_clock, exact.clock, atol=1e-12)


@pytest.mark.parametrize("case", [2, 3])
def test_a_small_headway_starts_before_t0_without_a_word(case: int) -> None:
    assert search_phase_plane(paper_problem(case, 0.1)).clock_error == 0.0
    missing = [search_phase_plane(paper_problem(case, headway)).clock_error for headway in (0.05, 0.0)]
    assert missing[0] > 0.15
    # the same path, shifted: 50 mm of headway are 0.25 s of belt
    assert missing[1] == pytest.approx(missing[0] + 0.25)


def test_literal_plans_break_the_torque_limit_they_were_checked_against() -> None:
    assert plan_paper(paper_problem(2)).limit_ratios["torque"] > 1.4
    assert plan_paper(paper_problem(2), reading=REPAIRED).limit_ratios["torque"] < 1.0


@pytest.mark.parametrize("reading", [LITERAL, REPAIRED])
@pytest.mark.parametrize("case", [1, 2, 3])
def test_executed_motion_is_one_the_arm_can_do(case: int, reading: Reading) -> None:
    problem = paper_problem(case)
    motion = plan_paper(problem, reading=reading)
    assert motion.t[0] == 0.0
    assert (np.diff(motion.t) >= 0.0).all()
    assert_allclose(motion.q[0], problem.q, atol=1e-12)
    assert_allclose(motion.qd[0], 0.0, atol=1e-12)
    assert_allclose(SCARA_1M.forward_kinematics(motion.q)[:, 1], 1.732, atol=1e-12)
    assert_allclose(SCARA_1M.forward_dynamics(motion.q, motion.qd, motion.tau), motion.qdd, atol=1e-9)
    # between samples of a smooth stretch the angle follows from velocity and acceleration at its two ends
    h = np.diff(motion.t)[:, None]
    hermite = h * (motion.qd[1:] + motion.qd[:-1]) / 2.0 + h**2 * (motion.qdd[:-1] - motion.qdd[1:]) / 12.0
    jumps = np.abs(np.diff(motion.qdd, axis=0)).max(axis=1) > 0.02
    assert jumps.sum() < 60
    assert_allclose(np.diff(motion.q, axis=0)[~jumps], hermite[~jumps], atol=1e-6)


def test_cost_is_the_index_of_the_executed_motion() -> None:
    problem = paper_problem(2)
    path = search_phase_plane(problem, reading=REPAIRED)
    start, durations = path.real_clock[0], np.diff(path.real_clock)
    total = (0.4**3 * start**3 / 3 - 0.2 * 0.4**2 * start**2 + 0.2**2 * 0.4 * start) / 0.4 + 0.4**2 * start
    for i, duration in enumerate(durations):  # error and its rate are polynomials of time on every step
        change = (path.rate[i + 1] - path.rate[i]) / duration
        e = np.polynomial.Polynomial([path.r[i] - (0.4 * path.real_clock[i] - 0.2), path.rate[i] - 0.4, change / 2.0])
        total += (e**2 + e.deriv() ** 2).integ()(duration)
    assert execute(problem, path).cost == pytest.approx(total, rel=1e-3)


def test_rendezvous_time_is_kept_when_the_hand_can_leave_in_time() -> None:
    motion = plan_paper(paper_problem(2, 0.2))
    riding = motion.t >= motion.rendezvous_time
    hand = SCARA_1M.forward_kinematics(motion.q)[:, 0]
    assert_allclose(hand[riding], -1.0 + 0.2 * motion.t[riding], atol=1e-12)
    assert motion.rendezvous_time == pytest.approx(1.35)


def test_a_late_hand_stays_behind_and_says_so() -> None:
    problem = paper_problem(3, 0.05)
    path = search_phase_plane(problem)
    motion = execute(problem, path)
    assert motion.rendezvous_time == math.inf
    assert path.lag > 0.3
    behind = -0.85 + 0.2 * motion.duration - SCARA_1M.forward_kinematics(motion.q[-1])[0]
    assert behind == pytest.approx(0.2 * path.lag, abs=1e-12)


@pytest.mark.parametrize("elbow", [0, 1])
def test_the_direction_of_the_belt_does_not_matter(elbow: int) -> None:
    turn = 0.7
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    hand, part, velocity = np.array([-0.8, 1.5]), np.array([-0.9, 1.5]), np.array([0.2, 0.0])
    q = SCARA_1M.inverse_kinematics(hand)[elbow]
    straight = MotionProblem(SCARA_1M, q, MovingHand(part, velocity), 3.0, limits=LIMITS[2])
    turned = replace(straight, q=q + np.array([turn, 0.0]), target=MovingHand(rotation @ part, rotation @ velocity))
    first, second = plan_paper(straight), plan_paper(turned)
    assert_allclose(first.t, second.t, atol=1e-12)
    assert_allclose(first.tau, second.tau, atol=1e-9)
    assert_allclose(np.sign(first.q[:, 1]), 1.0 if elbow == 0 else -1.0)


def test_weight_and_payload_count() -> None:
    problem = paper_problem(2)
    loaded = search_phase_plane(replace(problem, payload=1.0))
    assert loaded.rendezvous_time > search_phase_plane(problem).rendezvous_time
    assert (np.abs(loaded.tau) <= [0.5, 0.2]).all()
    hanging = replace(problem, arm=replace(SCARA_1M, gravity=9.81))
    with pytest.raises(Infeasible, match="limits: no path"):
        search_phase_plane(hanging)


def test_three_links_keep_their_orientation() -> None:
    q = PLANAR_3R.inverse_kinematics([0.2, 0.4], 0.5)[0]
    hand = PLANAR_3R.forward_kinematics(q)
    problem = MotionProblem(PLANAR_3R, q, MovingHand(hand - [0.03, 0.0], [0.1, 0.0]), 3.0)
    motion = plan_paper(problem, reading=Reading(line=0.2))
    assert_allclose(motion.q.sum(axis=1), 0.5, atol=1e-12)
    riding = motion.t >= motion.rendezvous_time
    assert_allclose(PLANAR_3R.forward_kinematics(motion.q[riding])[:, 0], 0.17 + 0.1 * motion.t[riding], atol=1e-12)


def test_plans_repeat_bit_for_bit() -> None:
    first, second = plan_paper(paper_problem(3)), plan_paper(paper_problem(3))
    assert first.tau.tobytes() == second.tau.tobytes()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"target": FixedHand([0.0, 1.0])}, "MovingHand target of constant velocity|kind moving hand, not hand"),
        ({"target": MovingHand([-0.9, 1.732], [0.2, 0.0], [0.1, 0.0])}, "constant velocity"),
        ({"target": MovingHand([-0.9, 1.732], [0.0, 0.0])}, "constant velocity"),
        ({"target": MovingHand([-0.9, 1.7], [0.2, 0.0])}, "hand is 0.032 m beside the target's line"),
        ({"qd": np.linalg.solve(SCARA_1M.jacobian(paper_problem().q), [0.1, 0.0])}, "starts from rest; .* 0.1 m/s"),
    ],
)
def test_problems_of_another_kind_are_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        plan_paper(replace(paper_problem(), **change))  # type: ignore[arg-type]


def test_infeasible_problems_say_why() -> None:
    moving = np.linalg.solve(SCARA_1M.jacobian(paper_problem().q), [0.1, 0.0])
    with pytest.raises(Infeasible, match="starts from rest") as error:
        plan_paper(replace(paper_problem(), qd=moving))
    assert error.value.reason == "start"
    with pytest.raises(Infeasible, match="constant velocity, not 0") as error:
        plan_paper(replace(paper_problem(), target=MovingHand([-0.9, 1.732], [0.0, 0.0])))
    assert error.value.reason == "unreachable"
    tight = replace(paper_problem(), limits=JointLimits(torque=(1e-3, 1e-3)))
    with pytest.raises(Infeasible, match="no path through the 50 x 100 phase plane") as error:
        plan_paper(tight)
    assert error.value.reason == "limits"
    with pytest.raises(Infeasible, match="leaves the workspace") as error:
        plan_paper(paper_problem(), reading=Reading(line=2.5))
    assert error.value.reason == "unreachable"
    with pytest.raises(Infeasible, match="passed the end") as error:
        plan_paper(paper_problem(headway=-0.7))
    assert error.value.reason == "late"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [({"step": "rk4"}, "'rk4'"), ({"target_fraction": 1.2}, "in \\(0, 1\\]"), ({"line": -0.5}, "line length -0.5 m")],
)
def test_readings_are_checked(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Reading(**arguments)  # type: ignore[arg-type]


def test_a_grid_must_have_stages_and_states() -> None:
    with pytest.raises(ValueError, match=r"grid \(1, 100\) must be of 2 to 2000 stages"):
        plan_paper(paper_problem(), grid=(1, 100))
