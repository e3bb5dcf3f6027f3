"""Forward kinematics of the excavator attachment, frames, Jacobian and its singularities.

Source: "A Study on Motion Control and Kinematics Analysis of Articulated Manipulator Attachment for Excavator" (2019),
section 2. The pose is that of frame 6 at the tip of the tool in frame 0: origin ``tip`` and z axis ``axis``. Joint
angles ``q`` are ``(..., 5)``, rad; another number of angles raises ValueError.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from planners.checks import floats
from planners.excavator.machine import EXCAVATOR, N_JOINTS, Excavator
from planners.typing import Array


def forward_kinematics(q: ArrayLike, machine: Excavator = EXCAVATOR) -> tuple[Array, Array]:
    """Position of the tip, m, and unit vector along the tool, ``(..., 3)`` each, for ``q`` of ``(..., 5)``, rad.

    The product (2-1) of the paper, multiplied out as in (2-2). Another number of angles raises ValueError.
    """
    angles = vectors("q", q, N_JOINTS)
    rows = np.ascontiguousarray(angles.reshape(-1, N_JOINTS))
    tip, axis = _tip_and_axis(machine.geometry.kernel_array, rows)
    shape = (*angles.shape[:-1], 3)
    return tip.reshape(shape), axis.reshape(shape)


def frames(q: ArrayLike, machine: Excavator = EXCAVATOR) -> Array:
    """Every frame of the chain in frame 0, ``(..., 7, 4, 4)``: the base, those behind the five joints, and the tip."""
    angles = vectors("q", q, N_JOINTS)
    tool = np.full((*angles.shape[:-1], 1), machine.geometry.theta6)
    theta = np.concatenate([angles, tool], axis=-1)
    a, d, alpha = machine.geometry.table
    sin_alpha, cos_alpha = np.sin(alpha), np.cos(alpha)
    steps = np.zeros((*theta.shape, 4, 4))  # T(z, d) T(z, theta) T(x, a) T(x, alpha)
    steps[..., 0, 0], steps[..., 1, 0] = np.cos(theta), np.sin(theta)
    steps[..., 0, 1], steps[..., 1, 1] = -np.sin(theta) * cos_alpha, np.cos(theta) * cos_alpha
    steps[..., 0, 2], steps[..., 1, 2] = np.sin(theta) * sin_alpha, -np.cos(theta) * sin_alpha
    steps[..., 2, 1], steps[..., 2, 2] = sin_alpha, cos_alpha
    steps[..., 0, 3], steps[..., 1, 3] = a * np.cos(theta), a * np.sin(theta)
    steps[..., 2, 3] = d
    steps[..., 3, 3] = 1.0
    chain = [np.broadcast_to(np.eye(4), (*angles.shape[:-1], 4, 4))]
    for joint in range(theta.shape[-1]):
        chain.append(chain[-1] @ steps[..., joint, :, :])
    return np.stack(chain, axis=-3)


def jacobian(q: ArrayLike, machine: Excavator = EXCAVATOR, *, tool_joint: bool = False) -> Array:
    """Geometric Jacobian of the tip in frame 0, ``(..., 6, 5)``; column i is ``(z x (tip - o), z)`` of frame ``i - 1``.

    The first three rows are the velocity of the tip, m, the last three the angular velocity of the tool. With
    ``tool_joint`` a sixth column is the turn about the tool's own axis, the sixth angle of the paper.
    """
    chain = frames(q, machine)
    before = chain[..., : N_JOINTS + tool_joint, :, :]
    axes, origins = before[..., :3, 2], before[..., :3, 3]
    linear = np.cross(axes, chain[..., -1:, :3, 3] - origins)
    return np.swapaxes(np.concatenate([linear, axes], axis=-1), -1, -2)


def jacobian_determinant(q: ArrayLike, machine: Excavator = EXCAVATOR) -> Array:
    """Determinant of the 6 x 6 Jacobian, ``a2 a3 sin(th3) sin(th5) (x1 . p)``, ``(...)``, m^3.

    ``x1 . p`` is the distance of the wrist in front of the slewing axis. Singular are the elbow straight or folded, the
    tool along the wrist's joint axis, and the wrist beside the slewing axis.
    """
    angles = vectors("q", q, N_JOINTS)
    geometry = machine.geometry
    boom, arm, wrist = np.moveaxis(np.cumsum(angles[..., 1:4], axis=-1), -1, 0)
    front = geometry.a2 * np.cos(boom) + geometry.a3 * np.cos(arm) + geometry.d5 * np.sin(wrist)
    determinant: Array = geometry.a2 * geometry.a3 * np.sin(angles[..., 2]) * np.sin(angles[..., 4]) * front
    return determinant


def vectors(name: str, given: ArrayLike, size: int) -> Array:
    """``given`` as an array ``(..., size)``; ValueError if it has another shape."""
    values = floats(name, given)
    if values.ndim == 0 or values.shape[-1] != size:
        raise ValueError(f"{name} has shape {values.shape}; give (..., {size})")
    return values


@njit(cache=True, nogil=True)
def _tip_and_axis(geometry: Array, q: Array) -> tuple[Array, Array]:
    """`forward_kinematics` over rows.

    With ``x1 = (c1, s1, 0)``, ``z1 = (s1, -c1, 0)``, ``z = (0, 0, 1)``: the tool points along
    ``w = c5 z1 - s5 (c234 x1 + s234 z)``, and the tip is ``d1 z + d4 z1 + d6 w + (a2 c2 + a3 c23 + d5 s234) x1
    + (a2 s2 + a3 s23 - d5 c234) z``.
    """
    d1, a2, a3, d4, d5, d6, _ = geometry
    tip, axis = np.empty((q.shape[0], 3)), np.empty((q.shape[0], 3))
    for row in range(q.shape[0]):
        s1, c1 = np.sin(q[row, 0]), np.cos(q[row, 0])
        boom = q[row, 1]
        arm = boom + q[row, 2]
        wrist = arm + q[row, 3]
        s5, c5 = np.sin(q[row, 4]), np.cos(q[row, 4])
        front = a2 * np.cos(boom) + a3 * np.cos(arm) + d5 * np.sin(wrist)
        up = a2 * np.sin(boom) + a3 * np.sin(arm) - d5 * np.cos(wrist)
        axis[row, 0] = c5 * s1 - s5 * np.cos(wrist) * c1
        axis[row, 1] = -c5 * c1 - s5 * np.cos(wrist) * s1
        axis[row, 2] = -s5 * np.sin(wrist)
        tip[row, 0] = front * c1 + d4 * s1 + d6 * axis[row, 0]
        tip[row, 1] = front * s1 - d4 * c1 + d6 * axis[row, 1]
        tip[row, 2] = d1 + up + d6 * axis[row, 2]
    return tip, axis
