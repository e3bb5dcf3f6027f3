"""The physics against independent references, with margins below what docs/physics.md states."""

import re
from pathlib import Path

import numpy as np
import pytest

from planners import SCARA_1M
from tools import physics_fidelity as fidelity
from tools.physics_fidelity import SimulatedArm


def test_two_link_arm_follows_the_lagrange_euler_equations() -> None:
    assert fidelity.two_link_error(1e-3) <= 5e-4


def test_two_link_error_is_second_order_in_the_physics_step() -> None:
    reference = fidelity.two_link_reference()
    coarse, fine = (fidelity.two_link_error(step, reference=reference) for step in (2e-3, 1e-3))
    assert 3.0 <= coarse / fine <= 5.0


def test_triple_pendulum_keeps_its_energy() -> None:
    assert fidelity.energy_error(1e-3) <= 0.01


def test_pymunk_defaults_do_not() -> None:
    assert fidelity.two_link_error(1e-3, pymunk_defaults=True) >= 5e-2
    assert fidelity.energy_error(1e-3, pymunk_defaults=True) >= 0.3


def test_a_used_space_gives_the_same_bits_as_a_fresh_one() -> None:
    def roll_out(simulated: SimulatedArm) -> list[bytes]:
        simulated.place(np.array([0.3, -0.8]), np.array([0.5, 1.0]))
        return [b"".join(part.tobytes() for part in simulated.advance(np.array([1.0, -0.5]))) for _ in range(100)]

    fresh, used = SimulatedArm(SCARA_1M, 1e-3), SimulatedArm(SCARA_1M, 1e-3)
    used.place(np.array([2.0, 0.1]), np.array([-3.0, 7.0]))
    for k in range(137):
        used.advance(fidelity.open_loop_torque(0.02 * k))
    assert roll_out(used) == roll_out(fresh)


def test_placing_and_reading_agree() -> None:
    simulated = SimulatedArm(SCARA_1M, 1e-3)
    q, qd = np.array([0.7, -1.1]), np.array([0.4, -0.9])
    simulated.place(q, qd)
    expected = q + fidelity.CONTROL_PERIOD * qd
    moved, _ = simulated.advance(np.zeros(2))
    assert moved == pytest.approx(expected, abs=1e-3)


def test_the_page_states_the_errors() -> None:
    text = (Path(__file__).parents[2] / "docs" / "physics.md").read_text()
    rows = re.findall(r"^\| (\S+) ms \| (.*) \| (\S+) rad \| (\S+) % \|$", text, flags=re.MULTILINE)
    assert len(rows) == 6
    for step, simulation, angle, energy in rows:
        defaults = simulation != "planarm"
        error = fidelity.two_link_error(1e-3 * float(step), pymunk_defaults=defaults)
        assert error == pytest.approx(float(angle), rel=0.05)
        share = fidelity.energy_error(1e-3 * float(step), pymunk_defaults=defaults)
        assert 100.0 * share == pytest.approx(float(energy), rel=0.05)
