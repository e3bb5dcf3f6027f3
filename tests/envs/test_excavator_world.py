"""Boom, arm and bucket in Pymunk against the equations of motion, integrated by Runge-Kutta 4."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import envs  # noqa: F401  (registers the ids)
from planners.excavator import forward_kinematics
from planners.excavator.controllers import make_controller
from planners.excavator.plane import planar_bodies, planar_dynamics, planar_payload
from planners.excavator.simulation import Plant
from planners.typing import Array

ENV_ID = "ExcavatorPayload-v0"
OFFSET = (0.08, -0.06)
FRICTION = 1.4
TORQUE_LIMITS = np.array([45e3, 22e3, 10e3])
LAG = 0.03


def make(payload: float, **config: Any) -> Any:
    env = gym.make(ENV_ID, encoder_noise=0.0, **config).unwrapped
    env.reset(seed=3, options={"payload": payload, "payload_offset": OFFSET, "friction_scale": FRICTION})
    return env


def reference(env: Any) -> tuple[Array, Array, Array]:
    seen = env.task.layout.parse(env.task.batch["observation"])
    return seen["joint_position"] + seen["reference_error"], seen["reference_velocity"], seen["reference_acceleration"]


def simulated(env: Any, law: str) -> tuple[Array, list[tuple[Array, Array, Array]]]:
    """Joint angles of an episode under a controller, ``(steps + 1, 3)``, and its reference at every step."""
    controller = make_controller(law, planar=True)
    angles, wanted = [env.joint_state()[0]], []
    for _ in range(env.task.horizon_steps):
        wanted.append(reference(env))
        q, qd = (state[None] for state in env.joint_state())
        env.step((controller.torque(q, qd, *wanted[-1])[0] / TORQUE_LIMITS).astype(np.float32))
        angles.append(env.joint_state()[0])
    return np.array(angles), wanted


def integrated(
    wanted: list[tuple[Array, Array, Array]], law: str, loads: dict[int, float], lag: float, held: Array
) -> Array:
    """The same by Runge-Kutta 4, with loads from given steps on and what the drives hold at first."""
    controller = make_controller(law, planar=True)
    q, qd, applied = wanted[0][0].copy(), np.zeros((1, 3)), held[None].copy()
    angles, plant = [q[0].copy()], None
    for step, now in enumerate(wanted):
        if step in loads:
            load = planar_payload(loads[step], offset=OFFSET)[None]
            plant = Plant.loaded(planar_dynamics(), load, friction_scale=FRICTION, lag=lag)
        assert plant is not None
        plant.advance(q, qd, applied, controller.torque(q, qd, *now), 0.02)
        angles.append(q[0].copy())
    return np.array(angles)


def assert_same_errors(one: Array, other: Array, wanted: list[tuple[Array, Array, Array]]) -> None:
    """Tracking errors: root mean square and peak of every joint within 1 %, each sample within 2 % of the peak."""
    goal = np.array([now[0][0] for now in wanted])
    ours, theirs = one[:-1] - goal, other[:-1] - goal
    np.testing.assert_allclose(np.sqrt(np.mean(ours**2, axis=0)), np.sqrt(np.mean(theirs**2, axis=0)), rtol=0.01)
    np.testing.assert_allclose(np.abs(ours).max(axis=0), np.abs(theirs).max(axis=0), rtol=0.01)
    assert np.abs(ours - theirs).max() < 0.02 * np.abs(theirs).max()


@pytest.mark.parametrize("payload", [0.0, 120.0, 350.0])
@pytest.mark.parametrize("law", ["integral-computed-torque", "slotine-li"])
def test_a_closed_loop_is_that_of_the_equations(payload: float, law: str) -> None:
    env = make(payload)
    held = env.task.batch["drive_torque"][0].copy()
    angles, wanted = simulated(env, law)
    assert_same_errors(angles, integrated(wanted, law, {0: payload}, 0.0, held), wanted)


@pytest.mark.parametrize("payload", [150.0, 350.0])
def test_a_load_changes_hands_as_in_the_equations(payload: float) -> None:
    env = make(payload, level=2)
    held = env.task.batch["drive_torque"][0].copy()
    loads = {0: 0.0, int(env.task.batch["pick_step"][0]): payload, int(env.task.batch["drop_step"][0]): 0.0}
    assert len(loads) == 3
    angles, wanted = simulated(env, "slotine-li")
    assert_same_errors(angles, integrated(wanted, "slotine-li", loads, LAG, held), wanted)


@pytest.mark.parametrize("level", [1, 2])
def test_closed_form_physics_is_the_equations(level: int) -> None:
    env = make(350.0, level=level, horizon=4.8, physics="closed_form")
    held = env.task.batch["drive_torque"][0].copy()
    loads = {0: 350.0}
    if level == 2:
        loads = {0: 0.0, int(env.task.batch["pick_step"][0]): 350.0, int(env.task.batch["drop_step"][0]): 0.0}
    angles, wanted = simulated(env, "slotine-li")
    expected = integrated(wanted, "slotine-li", loads, LAG if level == 2 else 0.0, held)
    assert np.abs(angles - expected).max() < 1e-7 * np.ptp(angles)


def test_physics_converges_to_the_equations() -> None:
    errors = []
    for step in (0.005, 0.0025, 0.00125):
        env = make(350.0, physics_step=step, horizon=1.2)
        held = env.task.batch["drive_torque"][0].copy()
        angles, wanted = simulated(env, "slotine-li")
        errors.append(np.abs(angles - integrated(wanted, "slotine-li", {0: 350.0}, 0.0, held)).max())
    assert errors[1] < 0.6 * errors[0]
    assert errors[2] < 0.6 * errors[1]


@pytest.mark.parametrize("level", [1, 2])
def test_joints_do_not_come_apart(level: int) -> None:
    env = make(350.0, level=level)
    joints = env.task._batch.world._spaces[0].constraints
    worst = 0.0
    controller = make_controller(planar=True)
    for _ in range(env.task.horizon_steps):
        q, qd = (state[None] for state in env.joint_state())
        env.step((controller.torque(q, qd, *reference(env))[0] / TORQUE_LIMITS).astype(np.float32))
        for joint in joints:
            gap = joint.a.local_to_world(joint.anchor_a) - joint.b.local_to_world(joint.anchor_b)
            worst = max(worst, gap.length)
    assert 0.0 < worst < 5e-6


def test_the_tip_is_where_the_whole_attachment_has_it() -> None:
    env = make(0.0)
    machine_angles = np.array([0.0, *env.joint_state()[0], np.pi / 2.0])
    tip, _ = forward_kinematics(machine_angles)
    np.testing.assert_allclose(env.task.hand_position(0), tip[[0, 2]], atol=1e-12)


def test_the_bodies_weigh_what_the_links_do() -> None:
    bodies, dynamics = planar_bodies(), planar_dynamics()
    q = np.radians([[30.0, -70.0, 20.0]])
    still = np.zeros_like(q)
    phi = np.cumsum(q[0])
    pins = np.concatenate([[0.0], np.cumsum(bodies.lengths * np.cos(phi[:-1]))])
    across = pins + bodies.coms[:, 0] * np.cos(phi) - bodies.coms[:, 1] * np.sin(phi)
    held = [9.81 * np.sum(bodies.masses[i:] * (across[i:] - pins[i])) for i in range(3)]
    np.testing.assert_allclose(dynamics.torque(q, still, still, still)[0], held, rtol=1e-12)
    turned = bodies.inertias[2] + bodies.masses[2] * np.sum(bodies.coms[2] ** 2)
    assert dynamics.mass_matrix(q)[0, 2, 2] == pytest.approx(turned, rel=1e-12)


def test_an_offset_moves_the_payload() -> None:
    bodies, q, still = planar_bodies(), np.zeros((1, 3)), np.zeros((1, 3))
    for offset in ((0.0, 0.0), (0.1, 0.0), (0.0, 0.1)):
        load = planar_payload(100.0, offset=offset)[None]
        torque = planar_dynamics().torque(q, still, still, still, load) - planar_dynamics().torque(
            q, still, still, still
        )
        assert torque[0, 2] == pytest.approx(981.0 * (bodies.payload_com[0] + offset[0]), rel=1e-9)
        upright = np.array([[0.0, 0.0, np.pi / 2.0]])
        torque = planar_dynamics().torque(upright, still, still, still, load)
        torque -= planar_dynamics().torque(upright, still, still, still)
        assert torque[0, 2] == pytest.approx(-981.0 * (bodies.payload_com[1] + offset[1]), rel=1e-9)
