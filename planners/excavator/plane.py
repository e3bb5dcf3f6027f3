"""The attachment in a plane: only boom, arm and bucket (joints 2 to 4) move.

The slew is fixed and the roll is held at 90 deg (bucket down), so that link 5 is part of link 4. The drives have no
inertia, as in the planar simulator.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from planners.excavator.dynamics import ChainDynamics, PayloadModel, payload, payload_basis
from planners.excavator.kinematics import frames
from planners.excavator.machine import EXCAVATOR, Excavator
from planners.robot.arm import Arm, JointLimits
from planners.typing import Array

JOINTS = slice(1, 4)
"""The moving joints."""

HELD_ROLL = math.radians(90.0)
NO_LENGTH = 1e-3
"""Length of the bucket in `planar_arm`, m; an `Arm` refuses 0."""


@dataclass(frozen=True)
class PlanarBodies:
    """The links as bodies in the plane. A link's frame sits at its joint; x points along boom and arm to the next one.

    Attributes:
        masses, inertias: ``(3,)``, kg and, about the centres of mass, kg m^2.
        coms: centres of mass in the links' frames, ``(3, 2)``, m.
        lengths: of boom and arm, ``(2,)``, m.
        tip, payload_com: tip of the tool and nominal centre of a payload in the frame of the bucket, ``(2,)``, m.
    """

    masses: Array
    coms: Array
    inertias: Array
    lengths: Array
    tip: Array
    payload_com: Array


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
    """The controllers' model: parameters are the payload's mass and, with ``moments``, its two first moments."""
    basis = on_bucket(payload_basis(machine, moments), machine)
    # x of frame 5 lies along the axes of the joints: a first moment there moves nothing in the plane
    return PayloadModel(planar_dynamics(machine), basis[[0, 2, 3]] if moments else basis)


def planar_bodies(machine: Excavator = EXCAVATOR) -> PlanarBodies:
    """Boom, arm and bucket of `planar_dynamics` as bodies."""
    dynamics = planar_dynamics(machine)
    masses = dynamics.inertia[:, 0].copy()
    sin_twist, cos_twist = dynamics.frames[:, 2], dynamics.frames[:, 3]
    centres = dynamics.inertia[:, 1:4] / masses[:, None]
    coms = np.stack([centres[:, 0], cos_twist * centres[:, 1] - sin_twist * centres[:, 2]], axis=1)
    about_frames = (
        sin_twist**2 * dynamics.inertia[:, 7]
        + 2.0 * sin_twist * cos_twist * dynamics.inertia[:, 8]
        + cos_twist**2 * dynamics.inertia[:, 9]
    )
    inertias = about_frames - masses * np.einsum("ij,ij->i", coms, coms)
    coms[:, 0] += dynamics.frames[:, 0]
    tool = _on_bucket_frame(machine)
    tip, ball = tool @ [0.0, 0.0, machine.geometry.d6, 1.0], tool @ [*machine.payload.com, 1.0]
    lengths = dynamics.frames[:-1, 0].copy()
    return PlanarBodies(masses, coms, inertias, lengths, tip[[0, 2]] * [1.0, -1.0], ball[[0, 2]] * [1.0, -1.0])


def planar_arm(machine: Excavator = EXCAVATOR) -> Arm:
    """Boom, arm and bucket approximated by an `Arm`, in the same joint angles.

    The hand is the joint of the bucket. The bucket has its inertia about that joint but its centre in it, like a
    payload at the hand; boom and arm have their centres on the line between their joints. At work the torque errors are
    up to 10, 11 and 22 % of the three limits with a known payload of 175 kg, and up to 14, 17 and 33 % with 350 kg.
    """
    bodies, limits = planar_bodies(machine), machine.limits
    coms = np.array([*bodies.coms[:-1, 0], 0.0])
    about_joints = bodies.inertias + bodies.masses * np.einsum("ij,ij->i", bodies.coms, bodies.coms)
    return Arm(
        name=f"{machine.name}_PLANAR",
        lengths=(*bodies.lengths.tolist(), NO_LENGTH),
        masses=tuple(bodies.masses.tolist()),
        limits=JointLimits(torque=limits.torque[JOINTS], velocity=limits.velocity[JOINTS], angle=limits.angle[JOINTS]),
        coms=tuple(coms.tolist()),
        inertias=tuple((about_joints - bodies.masses * coms**2).tolist()),
        gravity=machine.gravity,
        base=(0.0, machine.geometry.d1),
    )


def planar_payload(mass: float, machine: Excavator = EXCAVATOR, offset: tuple[float, float] = (0.0, 0.0)) -> Array:
    """A payload of ``mass`` kg as a load of the bucket, ``(10,)``.

    ``offset`` is that of its centre from the nominal one, in the frame of the bucket, m. A mass that is negative or not
    finite raises ValueError.
    """
    x, y, z = _on_bucket_frame(machine)[:3, :3].T @ [offset[0], 0.0, -offset[1]]
    load: Array = on_bucket(payload(mass, machine, (x, y, z))[None], machine)[0]
    return load


def on_bucket(parameters: Array, machine: Excavator = EXCAVATOR) -> Array:
    """Transform inertial parameters ``(k, 10)`` of bodies from frame 5 to frame 4.

    The 4 x 4 matrix J of a body's second, first and zeroth moments of mass transforms as ``A J A^T``.
    """
    transform = _on_bucket_frame(machine)
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


def _on_bucket_frame(machine: Excavator) -> Array:
    """Frame 5 in frame 4, whose x and -z span the plane, ``(4, 4)``."""
    chain = frames(np.array([0.0, 0.0, 0.0, 0.0, HELD_ROLL]), machine)
    transform: Array = np.linalg.solve(chain[4], chain[5])
    return transform
