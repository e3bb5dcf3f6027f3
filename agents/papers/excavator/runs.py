"""The runs of the excavator paper: every controller with every payload, and on arms that differ from its model."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from agents.papers.report import Record
from planners.excavator import EXCAVATOR, Excavator, forward_kinematics
from planners.excavator.controllers import make_controller
from planners.excavator.dynamics import ChainDynamics, payload
from planners.excavator.kinematics import jacobian
from planners.excavator.motion import WORK_CYCLE
from planners.excavator.simulation import Plant, Run, simulate
from planners.typing import Array

Progress = Callable[[], object]  # called after every simulated cycle
MISMATCHED_PAYLOADS = (2.0, 10.0)  # % of the rated load, in the runs on arms that differ from the controller's model


@dataclass(frozen=True)
class NamedController:
    """A controller and what it estimates: see :func:`planners.excavator.controllers.make_controller`."""

    title: str
    controller: str
    moments: bool = False


CONTROLLERS = (
    NamedController("PD + gravity", "pd-gravity"),
    NamedController("computed torque", "computed-torque"),
    NamedController("computed torque + I", "integral-computed-torque"),
    NamedController("the paper's, mass", "adaptive-computed-torque"),
    NamedController("the paper's, mass + moments", "adaptive-computed-torque", moments=True),
    NamedController("Slotine-Li, mass", "slotine-li"),
    NamedController("Slotine-Li, mass + moments", "slotine-li", moments=True),
    NamedController("Slotine-Li + I, mass", "integral-slotine-li"),
    NamedController("Slotine-Li + I, mass + moments", "integral-slotine-li", moments=True),
)
FIXED, INTEGRAL, PAPER, DEFAULT = CONTROLLERS[1], CONTROLLERS[2], CONTROLLERS[3], CONTROLLERS[-1]


@dataclass(frozen=True)
class Case:
    """How the simulated arm differs from the controller's model."""

    title: str
    lag: float = 0.0  # of the actuators, s
    noise: tuple[float, float] = (0.0, 0.0)  # standard deviations of measured angle and velocity, rad and rad/s
    friction: float = 1.0  # factor
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)  # of the payload's centre, in the frame of link 5, m
    links: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0, 1.0)  # factors on masses and inertias
    force: tuple[float, float, float] = (0.0, 0.0, 0.0)  # on the tip from outside, in the frame of the base, N
    acting: tuple[float, float] = (0.0, math.inf)  # when in a cycle, s


NOISE, LINKS = (1e-4, 5e-3), (1.05, 0.95, 1.05, 0.95, 1.05)
NOMINAL = Case("nominal")
CENTRE_OFF = Case("centre off", offset=(0.10, 0.15, 0.0))
ALL_TOGETHER = Case("all together", lag=0.03, noise=NOISE, friction=1.5, offset=(0.05, 0.08, 0.03), links=LINKS)
PUSH = Case("push", force=(0.0, 500.0, 0.0), acting=(0.5, 1.5))
PULL = Case("pull", force=(-300.0, 0.0, -300.0))
CASES = (
    NOMINAL,
    Case("lag 30 ms", lag=0.03),
    Case("lag 100 ms", lag=0.1),
    Case("noise", noise=NOISE),
    Case("friction +50 %", friction=1.5),
    CENTRE_OFF,
    Case("links +-5 %", links=LINKS),
    ALL_TOGETHER,
    PUSH,
    PULL,
)


Conditions = Sequence[tuple[float, Case]]  # payload, % of the rated load, and case of each environment
MISMATCHED_CONDITIONS = [(percent, case) for percent in MISMATCHED_PAYLOADS for case in CASES]


@dataclass(frozen=True)
class Trial:
    """What all runs share: the machine, the number of cycles and the control period (s)."""

    machine: Excavator = EXCAVATOR
    cycles: int = 3
    period: float = 0.005

    def follow(self, entry: NamedController, conditions: Conditions, progress: Progress = lambda: None) -> Run:
        """Simulate one controller, in an environment for each payload (%) and case."""
        shape, cases = self.machine.payload, [case for _, case in conditions]
        plant = Plant.loaded(
            ChainDynamics.of_excavator(self.machine),
            np.array([payload(shape.mass(percent), self.machine, case.offset) for percent, case in conditions]),
            link_scale=np.array([case.links for case in cases]),
            friction_scale=np.array([case.friction for case in cases]),
            lag=np.array([case.lag for case in cases]),
            noise=np.array([case.noise for case in cases]),
        )
        controller = make_controller(
            entry.controller, moments=entry.moments, rows=plant.rows, period=self.period, machine=self.machine
        )
        outside = self._outside(cases) if any(any(case.force) for case in cases) else None
        return simulate(controller, plant, WORK_CYCLE, self.cycles, outside=outside, progress=progress)

    def _outside(self, cases: Sequence[Case]) -> Callable[[float, Array], Array]:
        """Joint torques of the cases' forces on the tip, at a time and joint angles."""
        forces = np.array([case.force for case in cases])
        begin, end = np.array([case.acting for case in cases]).T

        def torques(t: float, q: Array) -> Array:
            since = t % WORK_CYCLE.period
            acting = (begin <= since) & (since < end) & forces.any(axis=1)
            tau = np.zeros_like(q)
            if acting.any():
                tau[acting] = np.einsum("rij,ri->rj", jacobian(q[acting], self.machine)[:, :3], forces[acting])
            return tau

        return torques

    def records(self, conditions: Conditions, progress: Progress = lambda: None) -> Iterator[Record]:
        """Errors of every controller under every condition."""
        for entry in CONTROLLERS:
            run = self.follow(entry, conditions, progress)
            tip = forward_kinematics(run.q, self.machine)[0] - forward_kinematics(run.q_d, self.machine)[0][:, None]
            distance = np.linalg.norm(tip, axis=-1)
            for env_index, (percent, case) in enumerate(conditions):
                mass = self.machine.payload.mass(percent)
                torque_ratio = (np.abs(run.tau[:, env_index]) / np.array(self.machine.limits.torque)).max()
                yield {
                    "controller": entry.title,
                    "case": case.title,
                    "percent": percent,  # the payload, % of the rated load
                    "mass": mass,  # the payload, kg
                    "first": self._errors(run, distance, env_index, mass, 0),  # of the first cycle
                    "last": self._errors(run, distance, env_index, mass, self.cycles - 1),
                    "torque_ratio": torque_ratio,  # largest torque over its limit
                }

    def _errors(self, run: Run, distance: Array, env_index: int, mass: float, cycle: int) -> Record:
        """Errors over one cycle, root mean square of its samples where nothing else is said."""
        length = len(run.t) // self.cycles
        span = slice(cycle * length, (cycle + 1) * length)
        position = run.q[span, env_index] - run.q_d[span]
        return {
            "position": _rms(position),  # of each joint, rad
            "velocity": _rms(run.qd[span, env_index] - run.qd_d[span]),  # of each joint, rad/s
            "joints": float(np.sqrt(np.square(position).mean())),  # of all five angles together, rad
            "tip": float(np.sqrt(np.square(distance[span, env_index]).mean())),  # distance from the reference, m
            "tip_peak": distance[span, env_index].max(),  # the largest, m
            "mass_error": np.abs(run.mass[span, env_index] - mass).max(),  # the largest, kg
            "mass_estimate": run.mass[span, env_index][-1],  # at the end of the cycle, kg
        }


def _rms(errors: Array) -> Array:
    """Root mean square over the first axis."""
    mean: Array = np.square(errors).mean(axis=0)
    return np.sqrt(mean)
