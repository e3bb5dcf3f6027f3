"""The attachment in one plane: boom, arm and bucket alone move, joints 2 to 4.

The slew stands still and the roll is held at 90 deg (bucket down), so that link 5 is part of link 4. The drives have no
inertia of their own here: that of rigid bodies is all that a planar simulator knows.
"""

from __future__ import annotations

import math

import numpy as np

from planners.excavator.dynamics import ChainDynamics, PayloadModel, payload, payload_basis
from planners.excavator.kinematics import frames
from planners.excavator.machine import EXCAVATOR, Excavator
from planners.typing import Array

JOINTS = slice(1, 4)
"""Those of the five that move."""

HELD_ROLL = math.radians(90.0)


def planar_dynamics(machine: Excavator = EXCAVATOR) -> ChainDynamics:
    """Equations of motion of boom, arm and bucket; the base is frame 1, x forward and y up."""
    whole = ChainDynamics.of_excavator(machine)
    inertia = whole.inertia[JOINTS].copy()
    inertia[-1] += on_bucket(whole.inertia[-1:], machine)[0]
    return ChainDynamics(
        frames=whole.frames[JOINTS],
        gravity=np.array([0.0, -machine.gravity, 0.0]),
        inertia=inertia,
        drives=whole.drives[JOINTS] * [0.0, 1.0],
    )


def planar_model(machine: Excavator = EXCAVATOR, moments: bool = False) -> PayloadModel:
    """What a controller knows: the mass of the payload and, when asked for, its two first moments."""
    basis = on_bucket(payload_basis(machine, moments), machine)
    # x of frame 5 lies along the axes of the joints: a first moment there moves nothing in the plane
    return PayloadModel(planar_dynamics(machine), basis[[0, 2, 3]] if moments else basis)


def planar_payload(mass: float, machine: Excavator = EXCAVATOR) -> Array:
    """The ball of a mass (kg) as a load of the bucket, ``(10,)``.

    Raises:
        ValueError: if the mass is negative or not finite.
    """
    load: Array = on_bucket(payload(mass, machine)[None], machine)[0]
    return load


def on_bucket(parameters: Array, machine: Excavator = EXCAVATOR) -> Array:
    """Inertial parameters ``(k, 10)`` of bodies in frame 5, in frame 4.

    The matrix of a body's second, first and zeroth moments of mass turns and shifts as one: ``A J A^T``.
    """
    chain = frames(np.array([0.0, 0.0, 0.0, 0.0, HELD_ROLL]), machine)
    transform = np.linalg.solve(chain[4], chain[5])
    upper = np.triu_indices(3)
    moved = np.empty_like(parameters)
    for row, body in zip(moved, parameters, strict=True):
        inertia, mass_moments = np.zeros((3, 3)), np.empty((4, 4))
        inertia[upper] = body[4:]
        inertia += np.triu(inertia, 1).T
        mass_moments[:3, :3] = 0.5 * np.trace(inertia) * np.eye(3) - inertia
        mass_moments[:3, 3] = mass_moments[3, :3] = body[1:4]
        mass_moments[3, 3] = body[0]
        turned = transform @ mass_moments @ transform.T
        second = turned[:3, :3]
        row[0], row[1:4], row[4:] = turned[3, 3], turned[:3, 3], (np.trace(second) * np.eye(3) - second)[upper]
    return moved
