"""The conveyor-tracking paper's plans: its cases by its own search in several readings, and by the optimal planner."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from agents.papers.report import Record
from planners import SCARA_1M, Infeasible, JointLimits, MotionProblem, MovingHand, Trajectory, dpct
from planners.dpct.paper import (
    LITERAL,
    MASS_SLIPS,
    REPAIRED,
    PhasePath,
    Reading,
    execute,
    search_phase_plane,
    signed_peak,
)

BELT_SPEED, HEADWAY, START, HEIGHT, LINE = 0.2, 0.1, -0.8, 1.732, 0.5  # m/s; m: section 5.1 of the paper
GRIDS = ((30, 50), (50, 100), (100, 200))
MAIN_GRID = (50, 100)
HEADWAYS = (0.2, 0.1, 0.05, 0.0, -0.05)
BELT_ACCELERATIONS = (-0.04, -0.02, 0.0, 0.01, 0.02)  # m/s^2
SLIP = MASS_SLIPS[0]
"""The reading that gives every published t_a."""


@dataclass(frozen=True)
class Case:
    """One of the paper's three cases (section 5.3): its limits and what was published for the 50 x 100 grid."""

    title: str
    limits: JointLimits
    rendezvous_time: float
    peak_torque: tuple[float, float] | None


_PAPER_LIMITS = SCARA_1M.limits
CASES = {
    1: Case("no limits", JointLimits.unlimited(2), 0.65, (-1.342, -0.406)),
    2: Case("torque limits", JointLimits(torque=_PAPER_LIMITS.torque), 0.80, (-0.499, -0.14)),
    3: Case("all limits", _PAPER_LIMITS, 1.10, None),
}


def paper_problem(case: int, headway: float = HEADWAY) -> MotionProblem:
    """The paper's simulation (section 5.1), the hand ``headway`` m ahead of the part, under the limits of a case."""
    return MotionProblem(
        arm=SCARA_1M,
        q=SCARA_1M.inverse_kinematics([START, HEIGHT])[0],
        target=MovingHand(position=np.array([START - headway, HEIGHT]), velocity=np.array([BELT_SPEED, 0.0])),
        horizon=(LINE + headway) / BELT_SPEED,
        limits=CASES[case].limits,
    )


def plan_records() -> Iterator[Record]:
    """Every case by the readings of the paper and by the optimal planner."""
    for case in CASES:
        least = least_cost(case)
        for reading in (LITERAL, REPAIRED):
            for grid in GRIDS:
                yield _paper_plan(case, reading, grid, least)
        for slip in MASS_SLIPS:
            yield _paper_plan(case, slip, MAIN_GRID, least)
        if case != 1:  # without limits the earliest rendezvous is an impulse when the part comes by
            for free in (True, False):
                yield _optimal_plan(case, least, free_initial_acceleration=free)


def least_cost(case: int) -> float:
    """The least J (eq 18) within a case's limits, by the optimal planner when it need not be early, s.

    The acceleration at t_0 is free, as in the paper. Without limits the least J is that of a hand that starts at speed,
    ``(D / L)^2 coth t_f``, which no motion from rest reaches.
    """
    problem = paper_problem(case)
    if case == 1:
        return (HEADWAY / LINE) ** 2 / math.tanh(problem.horizon)
    motion = dpct.plan(problem, rendezvous_time=problem.horizon, free_initial_acceleration=True)
    return tracking_cost(motion)


def _paper_plan(case: int, reading: Reading, grid: tuple[int, int], least: float) -> Record:
    problem = paper_problem(case)
    path = search_phase_plane(problem, grid=grid, reading=reading)
    motion = execute(problem, path)
    return _record(case, reading.name, motion, motion.cost, least, grid, path)


def _optimal_plan(case: int, least: float, *, free_initial_acceleration: bool) -> Record:
    motion = dpct.plan(paper_problem(case), free_initial_acceleration=free_initial_acceleration)
    name = "optimal, a(t0) free" if free_initial_acceleration else "optimal"
    return _record(case, name, motion, tracking_cost(motion), least)


def _record(
    case: int,
    planner: str,
    motion: Trajectory,
    cost: float,
    least: float,
    grid: tuple[int, int] | None = None,
    path: PhasePath | None = None,
) -> Record:
    """One plan: times in s, torques in N m (signed, the largest of each joint); None where there is no value."""
    published, peak = CASES[case], signed_peak(motion.tau)
    own = (motion.rendezvous_time, peak, cost) if path is None else (path.rendezvous_time, path.peak_torque, path.cost)
    return {
        "case": case,
        "planner": planner,
        "grid": grid,
        "published_rendezvous_time": published.rendezvous_time if grid in (None, MAIN_GRID) else None,
        "published_peak_torque": published.peak_torque if grid == MAIN_GRID else None,
        # by the planner's clock: t_a, peak torque and J (s)
        **dict(zip(("rendezvous_time", "peak_torque", "cost"), own, strict=True)),
        # of the motion in real time
        "real_peak_torque": peak,
        "real_cost": cost,
        "cost_ratio": cost / least,  # over the least J of any motion within the case's limits
        "limit_ratios": dict(motion.limit_ratios),  # worst |value| / limit
        "lag": 0.0 if path is None else path.lag,  # delay of the hand at the end of the line
    }


def tracking_cost(motion: Trajectory, headway: float = HEADWAY) -> float:
    """J (eq 18) of a motion of the paper's arm along the paper's line, by the trapezoidal rule on its samples, s."""
    r = (SCARA_1M.forward_kinematics(motion.q)[:, 0] - START) / LINE
    rate = np.einsum("sj,sj->s", SCARA_1M.jacobian(motion.q)[:, 0], motion.qd) / LINE
    part = (BELT_SPEED * motion.t - headway) / LINE
    return float(np.trapezoid((r - part) ** 2 + (rate - BELT_SPEED / LINE) ** 2, motion.t))


def clock_records() -> Iterator[Record]:
    """When the hand must start in literal plans on the main grid for several headways D (m), s; below 0: before t_0."""
    for headway in HEADWAYS:
        for case in CASES:
            path = search_phase_plane(paper_problem(case, headway), grid=MAIN_GRID)
            yield {
                "headway": headway,
                "case": case,
                "own_start": path.clock[0],  # by the planner's clock
                "real_start": path.real_clock[0],
                "belt_travel": BELT_SPEED * path.clock_error,  # of the part in the time missing by that clock, m
            }


def literal_path(case: int, grid: tuple[int, int] = MAIN_GRID, reading: Reading = LITERAL) -> PhasePath:
    """The paper's search on its own grid."""
    return search_phase_plane(paper_problem(case), grid=grid, reading=reading)


def figure_records() -> Iterator[Record]:
    """What figures 4 to 8 show in numbers: published where the paper prints one, as written, and by `SLIP`.

    ``published`` is None where the paper prints no number; ``values`` are those of `LITERAL` and `SLIP`.
    """
    readings = (LITERAL, SLIP)
    paths = {(case, reading): literal_path(case, MAIN_GRID, reading) for case in CASES for reading in readings}
    for coarse, fine in itertools.pairwise(GRIDS):
        apart = [_apart(*(literal_path(3, grid, one) for grid in (coarse, fine))) for one in readings]
        name = f"change of x2, {coarse[0]}x{coarse[1]} to {fine[0]}x{fine[1]}, 1/s"
        yield _figure_record(4, f"largest {name}", None, [largest for largest, _ in apart])
        yield _figure_record(4, f"mean {name}", None, [mean for _, mean in apart])
    for case, published in CASES.items():
        found = [paths[case, reading] for reading in readings]
        yield _figure_record(
            5,
            f"x1 at t_a, case {case}",
            None,
            [float(np.interp(path.rendezvous_time, path.clock, path.r)) for path in found],
        )
        yield _figure_record(
            6, f"t_a, case {case}, s", published.rendezvous_time, [path.rendezvous_time for path in found]
        )
        for joint in range(2):
            name = f"largest velocity of joint {joint + 1}, case {case}, rad/s"
            yield _figure_record(7, name, None, [float(np.abs(path.qd[:, joint]).max()) for path in found])
            name = f"largest torque of joint {joint + 1}, case {case}, N m"
            peak = published.peak_torque[joint] if published.peak_torque else None
            yield _figure_record(8, name, peak, [float(path.peak_torque[joint]) for path in found])


def _figure_record(figure: int, quantity: str, published: float | None, values: list[float]) -> Record:
    return {"figure": figure, "quantity": quantity, "published": published, "literal": values[0], "slip": values[1]}


def _apart(path: PhasePath, other: PhasePath) -> tuple[float, float]:
    """The largest and the mean difference of x2 between two phase plots at the same x1, 1/s."""
    apart = np.abs(np.interp(other.r, path.r, path.rate) - other.rate)
    return float(apart.max()), float(apart.mean())


def belt_problem(acceleration: float) -> MotionProblem:
    """Case 3 on a belt that accelerates (m/s^2), which the paper's conclusion leaves to the future."""
    problem = paper_problem(3)
    assert isinstance(problem.target, MovingHand)
    target = replace(problem.target, acceleration=np.array([acceleration, 0.0]))
    return replace(problem, target=target)


def belt_records() -> Iterator[Record]:
    """The optimal planner, from rest, on belts that accelerate or brake; a refusal gives its reason instead."""
    for acceleration in BELT_ACCELERATIONS:
        record: Record = {"acceleration": acceleration, "reason": "", "rendezvous_time": None, "peak_torque": None}
        try:
            motion = dpct.plan(belt_problem(acceleration))
        except Infeasible as refusal:
            yield {**record, "reason": refusal.reason, "limit_ratio": None, "rides_until": None}
        else:
            yield {
                **record,
                "rendezvous_time": motion.rendezvous_time,
                "peak_torque": signed_peak(motion.tau),
                "limit_ratio": motion.limit_ratio,
                "rides_until": motion.rides_until,
            }
