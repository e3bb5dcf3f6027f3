"""Error of the physics: Pymunk arms against independent references, with its defaults and as planarm uses it.

``python -m tools.physics_fidelity`` prints the table.
"""

from __future__ import annotations

import itertools
import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from numba import njit
from scipy.integrate import solve_ivp

from agents.tables import Table
from envs.physics.rigid_bodies import World, advance, arm_constants, arm_fields, model_record, place_arm
from planners import PLANAR_3R, SCARA_1M, Arm
from planners.files import write_text
from planners.typing import Array

CONTROL_PERIOD = 0.01
TRIPLE_PENDULUM = replace(PLANAR_3R, name="triple pendulum", gravity=9.81)


class SimulatedArm:
    """One arm in Pymunk, driven open loop; ``pymunk_defaults`` leaves joints and reading as Pymunk has them."""

    def __init__(self, arm: Arm, physics_step: float, *, pymunk_defaults: bool = False) -> None:
        self.batch = np.zeros(1, np.dtype(arm_fields(arm.n_joints), align=True))
        constants = arm_constants(arm, CONTROL_PERIOD, physics_step, pymunk_defaults=pymunk_defaults)
        self.model = model_record(constants)
        self._world = World(arm, self.batch)

    def place(self, q: Array, qd: Array) -> None:
        """Begin with joint angles (rad) and velocities (rad/s), each ``(n,)``."""
        self.batch["q"], self.batch["qd"] = q, qd
        _place(self.batch, self.model)

    def advance(self, tau: Array) -> tuple[Array, Array]:
        """Hold torques ``(n,)`` N m for one control period; the angles and velocities at its end, each ``(n,)``."""
        _advance(self.batch, self.model, tau)
        return self.batch["q"][0].copy(), self.batch["qd"][0].copy()


def open_loop_torque(t: float) -> Array:
    """The torques of the two-link test, N m: several times what the conveyor task allows."""
    return np.array([2.0 * np.sin(2.0 * t) + 0.5, np.cos(3.0 * t)])


def two_link_reference(duration: float = 3.0) -> Array:
    """Joint angles of the two-link test every control period, ``(samples, 2)`` rad.

    Runge-Kutta 45 at a tolerance of 1e-11 on the Lagrange-Euler equations, restarted wherever the held torque jumps.
    """
    arm, state = SCARA_1M, np.zeros(4)
    angles = [state[:2]]
    for k in range(round(duration / CONTROL_PERIOD)):
        tau = open_loop_torque(k * CONTROL_PERIOD)

        def rates(_t: float, state: Array, tau: Array = tau) -> Array:
            return np.concatenate([state[2:], arm.forward_dynamics(state[:2], state[2:], tau)])

        state = solve_ivp(rates, (0.0, CONTROL_PERIOD), state, rtol=1e-11, atol=1e-11).y[:, -1]
        angles.append(state[:2])
    return np.array(angles)


def two_link_error(physics_step: float, *, pymunk_defaults: bool = False, reference: Array | None = None) -> float:
    """Worst joint-angle error of the two-link arm under strong open-loop torques, rad."""
    reference = two_link_reference() if reference is None else reference
    simulated = SimulatedArm(SCARA_1M, physics_step, pymunk_defaults=pymunk_defaults)
    simulated.place(np.zeros(2), np.zeros(2))
    error = 0.0
    for k, wanted in enumerate(reference[1:]):
        q, _ = simulated.advance(open_loop_torque(k * CONTROL_PERIOD))
        error = max(error, float(np.max(np.abs(q - wanted))))
    return error


def energy_error(physics_step: float, *, pymunk_defaults: bool = False, duration: float = 10.0) -> float:
    """Worst energy error of a triple pendulum released stretched out sideways.

    Relative to the energy it turns from potential into kinetic on its way to hanging straight down.
    """
    arm = TRIPLE_PENDULUM
    simulated = SimulatedArm(arm, physics_step, pymunk_defaults=pymunk_defaults)
    start, still = np.zeros(3), np.zeros(3)
    simulated.place(start, still)
    exchanged = float(arm.energy(start, still) - arm.energy([-np.pi / 2.0, 0.0, 0.0], still))
    error = 0.0
    for _ in range(round(duration / CONTROL_PERIOD)):
        q, qd = simulated.advance(still)
        error = max(error, abs(float(arm.energy(q, qd) - arm.energy(start, still))))
    return error / exchanged


@njit(cache=True, nogil=True)
def _place(batch: Any, model: Any) -> None:
    place_arm(batch[0], model[0])


@njit(cache=True, nogil=True)
def _advance(batch: Any, model: Any, tau: Array) -> None:
    advance(batch[0], model[0], tau)


@dataclass(frozen=True)
class FidelityOptions:
    """Print how far the simulated arms are from independent references (a few seconds)."""

    json: Path | None = None
    """Also write the table to this file."""


def main(options: FidelityOptions) -> None:
    """Print both tests at several physics steps, with Pymunk's defaults and as planarm uses it; write it if asked."""
    reference = two_link_reference()
    records, cells = [], []
    for step, defaults in itertools.product((2e-3, 1e-3, 5e-4), (True, False)):
        angle = two_link_error(step, pymunk_defaults=defaults, reference=reference)
        energy = energy_error(step, pymunk_defaults=defaults)
        setting = "Pymunk's defaults" if defaults else "planarm"
        cells.append((f"{1e3 * step:g} ms", setting, f"{angle:.1e} rad", f"{100.0 * energy:.2g} %"))
        record = {"physics_step": step, "pymunk_defaults": defaults, "two_link_error": angle, "energy_error": energy}
        records.append(record)
    headers = ("physics step", "joints and reading", "two-link arm, 3 s: angle", "triple pendulum, 10 s: energy")
    Table("Pymunk arms against independent references", headers, cells, text_columns=2).show()
    if options.json is not None:
        write_text(options.json, json.dumps(records, indent=2) + "\n")


if __name__ == "__main__":
    main(tyro.cli(FidelityOptions))
