"""Forward kinematics of the excavator attachment against products of matrices, sympy and differences."""

from __future__ import annotations

import re

import numpy as np
import pytest
import sympy
from excavator_cases import (
    every_machine,
    random_postures,
)

from planners.excavator import (
    EXCAVATOR,
    ChainGeometry,
    Excavator,
    forward_kinematics,
    frames,
    jacobian,
    jacobian_determinant,
)


def dh_step(theta: object, d: object, a: object, turn: object) -> sympy.Matrix:
    """``T(z, d) T(z, theta) T(x, a) T(x, alpha)`` as four elementary matrices; ``turn`` is alpha in quarter turns."""
    c, s = sympy.cos(theta), sympy.sin(theta)
    ca, sa = sympy.cos(turn * sympy.pi / 2), sympy.sin(turn * sympy.pi / 2)
    shift_z = sympy.Matrix([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, d], [0, 0, 0, 1]])
    turn_z = sympy.Matrix([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    shift_x = sympy.Matrix([[1, 0, 0, a], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    turn_x = sympy.Matrix([[1, 0, 0, 0], [0, ca, -sa, 0], [0, sa, ca, 0], [0, 0, 0, 1]])
    return shift_z * turn_z * shift_x * turn_x


def symbolic_chain(geometry: ChainGeometry) -> tuple[tuple[sympy.Symbol, ...], list[sympy.Matrix]]:
    """Symbols of the joint angles and the seven frames."""
    q = sympy.symbols("q1:6", real=True)
    g = geometry
    table = [(q[0], g.d1, 0, 1), (q[1], 0, g.a2, 0), (q[2], 0, g.a3, 0), (q[3], g.d4, 0, 1), (q[4], g.d5, 0, -1)]
    chain = [sympy.eye(4)]
    for row in [*table, (g.theta6, g.d6, 0, 0)]:
        chain.append(chain[-1] * dh_step(*row))
    return q, chain


@every_machine
def test_frames_and_pose_are_the_product_of_the_elementary_matrices(machine: Excavator) -> None:
    symbols, chain = symbolic_chain(machine.geometry)
    reference = sympy.lambdify(symbols, chain)
    q = random_postures(50)
    expected = np.array([reference(*posture) for posture in q])
    np.testing.assert_allclose(frames(q, machine), expected, rtol=0.0, atol=1e-14)
    tip, axis = forward_kinematics(q, machine)
    np.testing.assert_allclose(tip, expected[:, 6, :3, 3], rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(axis, expected[:, 6, :3, 2], rtol=0.0, atol=1e-14)


def test_bucket_down_points_back_to_the_machine_and_bucket_up_away() -> None:
    for q5, front in ((90.0, -1.0), (-90.0, 1.0)):
        tip, axis = forward_kinematics(np.radians([0.0, 0.0, 0.0, 0.0, q5]))
        np.testing.assert_allclose(axis, [front, 0.0, 0.0], atol=1e-15)
        # house 0.9 up, boom and arm 3.85 along x, wrist 0.2 to the right, roll joint 0.35 down
        np.testing.assert_allclose(tip, [3.85 + 0.55 * front, -0.2, 0.9 - 0.35], atol=1e-15)


@every_machine
def test_jacobian_is_the_slope_of_the_pose(machine: Excavator) -> None:
    q = random_postures(30, seed=1)
    step = 1e-6
    ahead, behind = (frames(q[:, None] + sign * step * np.eye(5), machine)[..., 6, :, :] for sign in (1.0, -1.0))
    slope = (ahead - behind) / (2.0 * step)
    rotation = frames(q, machine)[:, None, 6, :3, :3]
    spin = slope[..., :3, :3] @ np.swapaxes(rotation, -1, -2)  # skew matrix of the angular velocity
    angular = np.stack([spin[..., 2, 1], spin[..., 0, 2], spin[..., 1, 0]], axis=-1)
    expected = np.swapaxes(np.concatenate([slope[..., :3, 3], angular], axis=-1), -1, -2)
    np.testing.assert_allclose(jacobian(q, machine), expected, rtol=0.0, atol=2e-9)


def test_jacobian_of_the_tip_is_the_symbolic_derivative() -> None:
    symbols, chain = symbolic_chain(EXCAVATOR.geometry)
    derivative = sympy.lambdify(symbols, chain[6][:3, 3].jacobian(symbols))
    q = random_postures(30, seed=2)
    expected = np.array([derivative(*posture) for posture in q])
    np.testing.assert_allclose(jacobian(q)[:, :3], expected, rtol=0.0, atol=1e-14)


@every_machine
def test_determinant_of_the_jacobian_with_the_tool_joint_has_the_closed_form(machine: Excavator) -> None:
    q = random_postures(2000, seed=3)
    with_tool = jacobian(q, machine, tool_joint=True)
    assert with_tool.shape == (2000, 6, 6)
    np.testing.assert_array_equal(with_tool[..., :5], jacobian(q, machine))
    np.testing.assert_allclose(with_tool[:, 3:, 5], forward_kinematics(q, machine)[1], rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(jacobian_determinant(q, machine), np.linalg.det(with_tool), rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("posture", [(0.3, 0.4, 0.0, 0.5, 0.6), (0.3, 0.4, 0.5, 0.6, 0.0)], ids=["elbow", "bucket"])
def test_the_five_columns_lose_rank_at_the_elbow_but_not_at_the_bucket(posture: tuple[float, ...]) -> None:
    assert jacobian_determinant(posture) == 0.0
    assert np.linalg.matrix_rank(jacobian(posture, tool_joint=True), tol=1e-12) == 5
    assert np.linalg.matrix_rank(jacobian(posture), tol=1e-12) == (4 if posture[2] == 0.0 else 5)


def test_forward_kinematics_wants_five_angles() -> None:
    for function in (forward_kinematics, frames, jacobian, jacobian_determinant):
        with pytest.raises(ValueError, match=re.escape("q has shape (4,); give (..., 5)")):
            function(np.zeros(4))
