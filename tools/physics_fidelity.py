"""Error of the physics: Pymunk arms against independent references, with its defaults and as planarm uses it.

``python -m tools.physics_fidelity`` prints the tables: the errors, and how far environments with ``physics="pymunk"``
and ``physics="closed_form"`` are apart, under the same actions and under the same policies.
"""

from __future__ import annotations

import itertools
import json
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from numba import njit
from scipy.integrate import solve_ivp

import envs
from agents.environments import make_batch
from agents.evaluation.evaluate import evaluate
from agents.evaluation.summarise import summarise
from agents.policies.lookup import SHIPPED, find_policy
from agents.policies.policy import as_policy
from agents.tables import Table, number_text
from envs.card import Metric
from envs.physics.rigid_bodies import World, advance, arm_constants, arm_fields, model_record, place_arm
from planners import PLANAR_3R, SCARA_1M, Arm
from planners.files import write_text
from planners.typing import Array
from tools.stored_scores import FIRST_SEED, scored_policies

PHYSICS = ("pymunk", "closed_form")
SEEDS = range(FIRST_SEED, FIRST_SEED + 10)
"""The episodes in which both kinds of physics are compared."""

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
        self.batch["delayed"] = tau
        _advance(self.batch, self.model)
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


def primary_metric(env_id: str) -> Metric:
    """The metric by which policies of a task are compared."""
    return next(metric for metric in envs.task_card(env_id).metrics if metric.primary)


def scores(env_id: str, physics: str) -> dict[str, tuple[float, Array]]:
    """Of every expert and the shipped agent: the median of the primary metric, and its values in all episodes."""
    found = {}
    for name in (name for task, name in scored_policies() if task == env_id):
        named = find_policy(name, env_id)
        settings = named.settings({"physics": physics})
        evaluation = evaluate(named.policy, env_id, SEEDS, env_config=settings, num_envs=len(SEEDS))
        key = primary_metric(env_id).key
        found[name] = summarise(evaluation, bootstrap=False)[key].value, evaluation.metrics[key]
    return found


def angles_apart(env_id: str) -> Array:
    """Largest difference of a joint angle in each episode, ``(episodes,)`` rad, under the same actions.

    They are those of the shipped agent with Pymunk; an episode counts until it ends with one of both.
    """
    count, named = len(SEEDS), find_policy(SHIPPED, env_id)
    one, other = (make_batch(env_id, count, named.settings({"physics": physics})) for physics in PHYSICS)
    with closing(one), closing(other):
        policy: Any = as_policy(named.policy, one)
        seen, _ = one.reset(seed=SEEDS[0])
        other.reset(seed=SEEDS[0])
        apart, running, state, begins = np.zeros(count), np.ones(count, bool), None, np.ones(count, bool)
        while running.any():
            actions, state = policy.predict(seen, state, begins, True)
            seen, _, terminated, truncated, _ = one.step(actions)
            _, _, *ends, _ = other.step(actions)
            begins = terminated | truncated
            running &= ~(begins | ends[0] | ends[1])
            (q, _), (twin, _) = (env.unwrapped.joint_state() for env in (one, other))  # type: ignore[attr-defined]
            apart[running] = np.maximum(apart, np.abs(q - twin).max(axis=1))[running]
    return apart


def divergence() -> tuple[Table, Table]:
    """How far environments with the two kinds of physics are apart, and what policies score in both."""
    motions, cells = [], []
    for env_id in envs.env_ids():
        apart, metric = angles_apart(env_id), primary_metric(env_id)
        motions.append((env_id, f"{np.median(apart):.1e} rad", f"{apart.max():.1e} rad"))
        ours, exact = (scores(env_id, physics) for physics in PHYSICS)
        for name, (value, values) in ours.items():
            known = np.isfinite(values) & np.isfinite(exact[name][1])
            most = np.abs(values[known] - exact[name][1][known]).max(initial=0.0)
            numbers = [number_text(metric.factor * number) for number in (value, exact[name][0], most)]
            cells.append((env_id, name, metric.title, *numbers))
    headers = "environment", "joint angles: median of the episodes", "largest"
    apart_table = Table("The same actions with Pymunk and in closed form", headers, motions)
    headers_of_scores = "environment", "policy", "metric", "Pymunk", "closed form", "largest difference of an episode"
    return apart_table, Table("The same policies", headers_of_scores, cells, text_columns=3)


@njit(cache=True, nogil=True)
def _place(batch: Any, model: Any) -> None:
    place_arm(batch[0], model[0])


@njit(cache=True, nogil=True)
def _advance(batch: Any, model: Any) -> None:
    advance(batch[0], model[0], batch[0].delayed)


@dataclass(frozen=True)
class FidelityOptions:
    """Print how far the simulated arms are from independent references, and from closed form (half a minute)."""

    json: Path | None = None
    """Also write the first table to this file."""


def main(options: FidelityOptions) -> None:
    """Print both tests at several physics steps, with Pymunk's defaults and as planarm uses it, and the divergence."""
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
    for table in divergence():
        table.show()
    if options.json is not None:
        write_text(options.json, json.dumps(records, indent=2) + "\n")


if __name__ == "__main__":
    main(tyro.cli(FidelityOptions))
