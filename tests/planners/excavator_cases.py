"""Machines and postures that the tests of the excavator share, and how far postures miss their targets."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from planners.excavator import (
    EXCAVATOR,
    ChainGeometry,
    Excavator,
    forward_kinematics,
)
from planners.excavator.dynamics import ChainDynamics, inertial_parameters
from planners.robot.arm import Arm
from planners.typing import Array

LIMIT = math.radians(150.0)
POSTURE = np.radians([-30.0, 40.0, -70.0, 30.0, 90.0])
ODD_GEOMETRIES = [
    ChainGeometry(d1=0.3, a2=1.1, a3=1.7, d4=-0.4, d5=0.2, d6=0.8, theta6=0.7),
    ChainGeometry(d1=-0.5, a2=2.0, a3=2.0, d4=0.0, d5=0.0, d6=0.1, theta6=-2.9),
    ChainGeometry(d1=0.0, a2=0.9, a3=0.4, d4=0.05, d5=-0.6, d6=0.3),
]


def planar_chain(arm: Arm) -> ChainDynamics:
    """A planar arm as a spatial chain: every joint axis parallel, gravity along -y, no friction."""
    n = arm.n_joints
    bodies = zip(arm.masses, arm.coms, arm.lengths, arm.inertias, strict=True)
    return ChainDynamics(
        frames=np.stack([arm.length_array, np.zeros(n), np.zeros(n), np.ones(n)], axis=1),
        gravity=np.array([0.0, -arm.gravity, 0.0]),
        inertia=np.array(
            [
                inertial_parameters(mass, np.array([com - length, 0.0, 0.0]), np.diag([0.0, inertia, inertia]))
                for mass, com, length, inertia in bodies
            ]
        ),
        drives=np.zeros((n, 2)),
    )


def acceleration(dynamics: ChainDynamics, q: Array, qd: Array, tau: Array, load: Array) -> Array:
    """Joint accelerations ``(batch, n)`` under torques, by the mass matrix and the bias."""
    bias = dynamics.torque(q, qd, qd, np.zeros_like(q), load)
    qdd: Array = np.linalg.solve(dynamics.mass_matrix(q, load), (tau - bias)[..., None])[..., 0]
    return qdd


def with_geometry(geometry: ChainGeometry) -> Excavator:
    return dataclasses.replace(EXCAVATOR, name="test machine", geometry=geometry)


MACHINES = [EXCAVATOR, *map(with_geometry, ODD_GEOMETRIES)]
every_machine = pytest.mark.parametrize("machine", MACHINES, ids=["excavator", "odd-1", "odd-2", "odd-3"])


def random_postures(count: int, seed: int = 0) -> Array:
    return np.random.default_rng(seed).uniform(-LIMIT, LIMIT, (count, 5))


def pose_error(q: Array, tip: Array, axis: Array, machine: Excavator = EXCAVATOR) -> tuple[float, float]:
    """Largest distance of the tips (m) and of the axes from the targets, over every branch that exists."""
    reached_tip, reached_axis = forward_kinematics(q, machine)
    there = np.isfinite(q).all(axis=-1)
    return (
        float(np.linalg.norm(reached_tip - tip[..., None, :], axis=-1)[there].max()),
        float(np.linalg.norm(reached_axis - axis[..., None, :], axis=-1)[there].max()),
    )


def seed_error(branches: Array, seed: Array) -> float:
    """How far the branch closest to the posture that made the target is from it, at worst, rad."""
    distance = np.abs(branches - seed[..., None, :]).max(axis=-1)
    return float(np.where(np.isnan(distance), np.inf, distance).min(axis=-1).max())
