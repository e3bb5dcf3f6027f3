"""The minimal-torque paper's motions: printed, searched for again, and from rest to rest.

In both models the links are uniform rods; with gravity, angle 0 is horizontal. Joint angles are relative where nothing
else is said.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import Polynomial

from agents.papers.report import Record
from planners import PLANAR_3R, FixedJoints, MotionProblem, Trajectory, lagrange
from planners.lagrange.interpolation import lobatto_nodes
from planners.lagrange.paper import (
    PUBLISHED_TIMES,
    Method,
    motion,
    plan_paper,
    published_motion,
    torque_integral,
)
from planners.typing import Array

MODELS = {"gravity off": 0.0, "gravity on": 9.81}  # m/s^2
PUBLISHED_PI: dict[Method, float] = {"lagrange": 69.6216, "polynomial": 145.4126}
ALGORITHMS: dict[Method, str] = {"lagrange": "1, Lagrange", "polynomial": "2, polynomial"}


def paper_problem(model: str = "gravity off") -> MotionProblem:
    """The paper's simulation (Table 1 and eq 13) in one of the models; its velocities at the ends are left open."""
    arm = replace(PLANAR_3R, gravity=MODELS[model])
    return MotionProblem(arm=arm, q=np.zeros(3), target=FixedJoints(np.array([1.0, 0.0, 0.0])), horizon=1.0)


def published_records() -> Iterator[Record]:
    """The motions of Tables 2 to 4 in every model."""
    for model in MODELS:
        for method, algorithm in ALGORITHMS.items():
            found = published_motion(paper_problem(model), method)
            yield {
                "model": model,
                "algorithm": algorithm,
                "published_pi": PUBLISHED_PI[method],  # its unit is not stated
                "pi1": found.cost,  # integral of the sum of abs(tau), N m s
                "pi2": torque_integral(found.t, found.tau, 2),  # integral of the sum of tau^2, N^2 m^2 s
                "peak_torque": np.abs(found.tau).max(axis=0),  # of each joint, N m
                "start_velocity": found.qd[0],  # of each joint, rad/s
                "end_velocity": found.qd[-1],
                "end_angle": found.q[-1],  # of each joint, rad
            }


def search_records() -> Iterator[Record]:
    """The paper's searches, as stated."""
    for model in MODELS:
        problem = paper_problem(model)
        yield _record(model, "1: Table 2's nodes", plan_paper(problem, nodes=PUBLISHED_TIMES))
        yield _record(model, "1: 5 nodes (degree 4)", plan_paper(problem))
        yield _record(model, "1: 3 nodes (degree 2)", plan_paper(problem, nodes=3))
        yield _record(model, "2: degree 2", plan_paper(problem, method="polynomial"))


def move_records() -> Iterator[Record]:
    """The move from rest to rest, by the paper's searches and by others."""
    for model in MODELS:
        problem = paper_problem(model)
        still = Polynomial([0.0])
        quintic = motion(problem, [Polynomial([0.0, 0.0, 0.0, 10.0, -15.0, 6.0]), still, still], "quintic")
        yield _record(model, "cubic", plan_paper(problem, method="polynomial", degree=3, clamped=True))
        yield _record(model, "quintic", quintic)
        yield _record(model, "2: degree 4", plan_paper(problem, method="polynomial", degree=4, clamped=True))
        yield _record(model, "1: 5 nodes, eq 7", plan_paper(problem, clamped=True))
        yield _record(model, "1: 5 nodes, Lobatto", plan_paper(problem, nodes=lobatto_nodes(4), clamped=True))
        for objective in ("PI1", "PI2"):
            yield _record(model, f"optimal, {objective}", lagrange.plan(problem, objective=objective))


def _record(model: str, plan: str, found: Trajectory) -> Record:
    """The result of a search or a planner."""
    return {
        "model": model,
        "plan": plan,
        "pi1": torque_integral(found.t, found.tau),
        "pi2": torque_integral(found.t, found.tau, 2),
        "start_speed": np.abs(found.qd[0]).max(),  # of the fastest joint, rad/s
        "torque_ratio": found.limit_ratios["torque"],  # worst value over the limit of planners.PLANAR_3R
        "angle_ratio": found.limit_ratios["angle"],
    }


@dataclass(frozen=True)
class AngleReading:
    """What the paper's joint angles may be, and of what its torques may be.

    ``absolute`` angles are measured from the x axis, relative ones from the link before. The torques are those of the
    joints' motors, or (``generalised``) those of eq 1 in absolute angles, which act between a link and the ground.
    """

    title: str
    absolute: bool
    generalised: bool


ANGLE_READINGS = (
    AngleReading("relative angles", absolute=False, generalised=False),
    AngleReading("absolute angles, torques of the motors", absolute=True, generalised=False),
    AngleReading("absolute angles, torques of eq 1", absolute=True, generalised=True),
)
_TO_RELATIVE = np.array([[1.0, 0.0, 0.0], [-1.0, 1.0, 0.0], [0.0, -1.0, 1.0]])


def reading_torques(model: str, method: Method, reading: AngleReading) -> tuple[Array, Array]:
    """Time, s, and torques ``(samples, 3)``, N m, of a printed motion under a reading of its angles."""
    problem = paper_problem(model)
    found = published_motion(problem, method)
    if not reading.absolute:
        return found.t, found.tau
    tau = problem.arm.inverse_dynamics(*(angles @ _TO_RELATIVE.T for angles in (found.q, found.qd, found.qdd)))
    return found.t, tau @ _TO_RELATIVE if reading.generalised else tau


def reading_records() -> Iterator[Record]:
    """PI1 of both printed motions under every reading of the angles, and their ratio beside the published one."""
    published = PUBLISHED_PI["polynomial"] / PUBLISHED_PI["lagrange"]
    for model in MODELS:
        for reading in ANGLE_READINGS:
            pi = [torque_integral(*reading_torques(model, method, reading)) for method in ALGORITHMS]
            yield {
                "model": model,
                "reading": reading.title,
                "pi1": pi,  # of Algorithm 1 and 2, N m s
                "ratio": pi[1] / pi[0],
                "published_ratio": published,
            }


def figure_records() -> Iterator[Record]:
    """What figures 2 to 9 show in numbers, for Algorithms 1 and 2: largest values over the motion, of each joint."""
    motions = {model: [published_motion(paper_problem(model), method) for method in ALGORITHMS] for model in MODELS}
    kinematic, quantities = motions["gravity off"], ("angle, rad", "velocity, rad/s", "acceleration, rad/s^2")
    for joint in range(3):
        for quantity in range(3):
            values = [abs((one.q, one.qd, one.qdd)[quantity][:, joint]).max() for one in kinematic]
            figure = f"2, 3, {4 + joint}" if quantity == 0 else f"{4 + joint}"
            yield _figure_record(figure, f"joint {joint + 1}: {quantities[quantity]}", values)
    for model, pair in motions.items():
        for joint in range(3):
            yield _figure_record(
                "7", f"joint {joint + 1}: torque, {model}, N m", [abs(one.tau[:, joint]).max() for one in pair]
            )
        yield _figure_record("8", f"sum of the torques, {model}, N m", [abs(one.tau.sum(1)).max() for one in pair])
        instants = [abs(one.tau).sum(axis=1) for one in pair]
        yield _figure_record("9", f"PI at an instant, {model}, N m", [instant.max() for instant in instants])
        yield _figure_record("9", f"PI1, {model}, N m s", [one.cost for one in pair], tuple(PUBLISHED_PI.values()))
        steps = np.linspace(0.0, 1.0, 1001)
        first, second = (np.interp(steps, one.t, instant) for one, instant in zip(pair, instants, strict=True))
        less = float((first < second).mean())
        yield _figure_record("9", f"share of the time with the lower PI, {model}", [less, 1.0 - less])


def _figure_record(figure: str, quantity: str, values: list[float], published: tuple[float, ...] = ()) -> Record:
    return {"figure": figure, "quantity": quantity, "published": published, "values": values}
