"""Parameters of the excavator attachment: five revolute joints and a tool.

Joints, in order: slew, boom, arm, wrist, roll. Frames follow the standard Denavit-Hartenberg convention, base z up;
``q2`` is the elevation of the boom; ``q5 = 90 deg`` puts the tool into the plane of the arm, pointing back to the
machine ("bucket down"), ``-90 deg`` puts it forward ("bucket up").

The chain is that of "A Study on Motion Control and Kinematics Analysis of Articulated Manipulator Attachment for
Excavator" (2019), section 2. Its table of link parameters (Table 1) is not available, so `EXCAVATOR` is a typical 3.5 t
machine: lengths and masses scaled from published models of smaller ones, electric servo drives as in section 3.5.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields

import numpy as np

from planners.checks import brief, float_vector, require_finite
from planners.robot.arm import JointLimits
from planners.typing import Array

N_JOINTS = 5
JOINT_NAMES = ("slew", "boom", "arm", "wrist", "roll")


@dataclass(frozen=True)
class ChainGeometry:
    """Denavit-Hartenberg parameters, named as in the paper (section 2).

    Frame ``i`` is ``T(z, d) T(z, theta) T(x, a) T(x, alpha)`` from frame ``i - 1``.

    Attributes:
        d1: height of the boom's joint above the base, m.
        a2, a3: length of the boom and of the arm, m.
        d4: lateral offset of the wrist from the plane of the boom, m.
        d5, d6: from the wrist's joint axis to the centre of the roll joint, and from there to the tip of the tool, m.
        theta6: constant angle of the tool about its own axis, rad.
    """

    d1: float
    a2: float
    a3: float
    d4: float
    d5: float
    d6: float
    theta6: float = 0.0

    def __post_init__(self) -> None:
        for spec in fields(self):
            value = getattr(self, spec.name)
            require_finite(spec.name, value, sign="positive" if spec.name in ("a2", "a3", "d6") else "")
            object.__setattr__(self, spec.name, float(value))

    @property
    def table(self) -> tuple[Array, Array, Array]:
        """``a`` (m), ``d`` (m) and ``alpha`` (rad) of the six frames, each ``(6,)``."""
        a = np.array([0.0, self.a2, self.a3, 0.0, 0.0, 0.0])
        d = np.array([self.d1, 0.0, 0.0, self.d4, self.d5, self.d6])
        return a, d, np.radians([90.0, 0.0, 0.0, 90.0, -90.0, 0.0])

    @property
    def kernel_array(self) -> Array:
        """``(d1, a2, a3, d4, d5, d6, theta6)``, for the compiled functions, ``(7,)``."""
        return np.array([self.d1, self.a2, self.a3, self.d4, self.d5, self.d6, self.theta6])


@dataclass(frozen=True)
class Link:
    """A rigid link and the drive of the joint that moves it.

    Attributes:
        mass, com: kg; centre of mass in the link's own frame (the one behind its joint), m.
        inertia: moments xx, yy, zz about the centre of mass, axes of the own frame, kg m^2; products are 0.
        actuator_inertia: of motor and gear at the joint, kg m^2 (``Ia`` in the paper).
        friction: viscous friction of the joint, N m s/rad.
    """

    mass: float
    com: tuple[float, float, float]
    inertia: tuple[float, float, float]
    actuator_inertia: float
    friction: float

    def __post_init__(self) -> None:
        for name in ("mass", "actuator_inertia", "friction"):
            require_finite(f"{name} of a link", getattr(self, name), sign="not negative")
        for name in ("com", "inertia"):
            values = float_vector(f"{name} of a link", getattr(self, name), 3)
            object.__setattr__(self, name, tuple(values.tolist()))
        if min(self.inertia) < 0.0 or 2.0 * max(self.inertia) > sum(self.inertia) * (1.0 + 1e-12):
            raise ValueError(f"no rigid body has moments {self.inertia} kg m^2: each is at most the sum of the others")


@dataclass(frozen=True)
class PayloadShape:
    """The payload, a ball of earth: its centre in the frame of link 5, m, density, kg/m^3, and mass at 100 %, kg."""

    com: tuple[float, float, float] = (0.0, 0.0, 0.30)
    density: float = 1800.0
    rated_load: float = 3500.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "com", tuple(float_vector("com of a payload", self.com, 3).tolist()))
        require_finite("density", self.density, "kg/m^3", "positive")
        require_finite("rated_load", self.rated_load, "kg", "positive")

    def mass(self, percent: float) -> float:
        """Mass of a payload of ``percent`` of the rated load, kg."""
        require_finite("percent", percent, "%", "not negative")
        return self.rated_load * percent / 100.0

    def gyration_square(self, mass: float) -> float:
        """Moment of inertia per kg about the centre of a ball of ``mass`` kg, ``2 r^2 / 5``, m^2."""
        require_finite("payload mass", mass, "kg", "not negative")
        radius = math.cbrt(3.0 * mass / (4.0 * math.pi * self.density))
        return 0.4 * radius**2


@dataclass(frozen=True)
class Excavator:
    """An attachment of five joints and a tool; gravity acts along -z, m/s^2.

    The links go from the slewing house to the rolling bucket; limits are those of torque, speed and angle.
    """

    name: str
    geometry: ChainGeometry
    links: tuple[Link, ...]
    limits: JointLimits
    payload: PayloadShape = field(default_factory=PayloadShape)
    gravity: float = 9.81

    def __post_init__(self) -> None:
        object.__setattr__(self, "links", tuple(self.links))
        for what, value, kind in (
            ("geometry", self.geometry, ChainGeometry),
            ("payload", self.payload, PayloadShape),
            ("limits", self.limits, JointLimits),
            *(("link", link, Link) for link in self.links),
        ):
            if not isinstance(value, kind):
                raise ValueError(f"{self.name}: {what} {brief(value)} is no {kind.__name__}")
        if len(self.links) != N_JOINTS:
            raise ValueError(f"{self.name}: {len(self.links)} links; the chain has {N_JOINTS}")
        object.__setattr__(self, "limits", self.limits.for_joints(N_JOINTS, self.name))
        require_finite(f"{self.name}: gravity", self.gravity)

    @property
    def drives(self) -> Array:
        """Inertia (kg m^2) and viscous friction (N m s/rad) of each joint's drive, ``(5, 2)``."""
        return np.array([(link.actuator_inertia, link.friction) for link in self.links])


EXCAVATOR = Excavator(
    name="EXCAVATOR",
    geometry=ChainGeometry(d1=0.90, a2=2.45, a3=1.40, d4=0.20, d5=0.35, d6=0.55),
    links=(
        Link(1900.0, com=(-0.35, -0.25, 0.0), inertia=(900.0, 1500.0, 1100.0), actuator_inertia=300.0, friction=400.0),
        Link(270.0, com=(-1.23, 0.36, 0.0), inertia=(8.0, 115.0, 118.0), actuator_inertia=300.0, friction=1200.0),
        Link(165.0, com=(-0.85, 0.12, 0.0), inertia=(3.0, 30.0, 31.0), actuator_inertia=150.0, friction=700.0),
        Link(60.0, com=(0.0, 0.0, 0.12), inertia=(1.2, 1.2, 0.9), actuator_inertia=80.0, friction=250.0),
        Link(120.0, com=(0.0, 0.0, 0.25), inertia=(7.0, 7.5, 4.5), actuator_inertia=40.0, friction=80.0),
    ),
    limits=JointLimits(
        torque=(8e3, 45e3, 22e3, 10e3, 4e3),
        velocity=(0.94, 0.70, 0.80, 1.60, 1.60),
        angle=(math.radians(150.0),) * N_JOINTS,
    ),
)
"""A typical 3.5 t machine: reach 4.2 m, slew 9 rpm, joints within +-150 deg (the paper's "within 150 degrees")."""
