"""A planar robot arm: its links, its joint limits, and its kinematics and dynamics for one state or a batch."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import ArrayLike

from planners.checks import (
    Sign,
    brief,
    float_array,
    floats,
    is_number,
    require_all_finite,
    require_finite,
    require_vector,
)
from planners.robot import clearance, dynamics, kinematics, redundant
from planners.robot.limits import EveryJoint
from planners.robot.limits import JointLimits as JointLimits
from planners.typing import Array

MOST = 1e9
"""Largest length (m), mass (kg), moment of inertia (kg m^2) or gravity of an arm: products of them stay finite."""

FARTHEST = 1e6
"""Largest size of an angle where a search starts, rad: whole turns of larger ones are lost to rounding."""

LONGEST_NAME = 200
"""Largest number of characters of an arm's name, which stands in messages."""


@dataclass(frozen=True, init=False)
class Arm:
    """A planar chain of revolute joints.

    ``q = 0`` is the arm stretched along +x; angles are relative and counter-clockwise. Lengths, masses, coms and
    inertias are one value per link (a list, a tuple or an array) or a number that holds for every link.

    Attributes:
        name: for messages and tables.
        lengths, masses: of the links, m and kg.
        limits: of the joints; none when left out.
        coms: distance of each link's centre of mass from its own joint, m; half the length when left out.
        inertias: moment of inertia about each centre of mass, kg m^2; a uniform rod's (m l^2 / 12) when left out.
        gravity: along -y, m/s^2; 0 in the horizontal plane.
        base: position of the first joint, m.
        link_radius: of every link, a capsule around the line between its joints, m; for clearances only.

    Raises:
        ValueError: for values that are no numbers, not finite or not positive, or not one per link.
    """

    name: str
    lengths: tuple[float, ...]
    masses: tuple[float, ...]
    limits: JointLimits
    coms: tuple[float, ...]
    inertias: tuple[float, ...]
    gravity: float
    base: tuple[float, float]
    link_radius: float

    def __init__(
        self,
        name: str,
        lengths: ArrayLike,
        masses: ArrayLike,
        limits: JointLimits | None = None,
        coms: ArrayLike = (),
        inertias: ArrayLike = (),
        gravity: float = 0.0,
        base: ArrayLike = (0.0, 0.0),
        link_radius: float = 0.0,
    ) -> None:
        if not isinstance(name, str) or len(name) > LONGEST_NAME:
            raise ValueError(
                f"the name of an arm must be a text, not {name!r:.80}, of at most {LONGEST_NAME} characters"
            )
        if limits is not None and not isinstance(limits, JointLimits):
            raise ValueError(
                f"{name}: limits {brief(limits)} are no JointLimits; write JointLimits(torque=..., velocity=...)"
            )
        given = {"lengths": lengths, "masses": masses, "coms": coms, "inertias": inertias}
        links = _per_link(name, given, limits)
        # without inertia about its own joint a link makes the mass matrix singular in some posture
        for link, (com, inertia) in enumerate(zip(links["coms"], links["inertias"], strict=True)):
            if com == inertia == 0.0:
                raise ValueError(f"{name}: link {link} has com 0 and inertia 0; one of them must be positive")
        values = {
            "name": name,
            **links,
            "limits": (limits or JointLimits()).for_joints(len(links["lengths"]), name),
            "gravity": _number(f"{name}: gravity", gravity),
            "base": _numbers(f"{name}: base", base),
            "link_radius": _number(f"{name}: link_radius", link_radius),
        }
        for key, value in values.items():
            object.__setattr__(self, key, value)
        require_finite(f"{name}: gravity", self.gravity, "m/s^2", most=MOST)
        require_vector(f"{name}: base", self.base, 2, MOST)
        require_finite(f"{name}: link_radius", self.link_radius, "m", "not negative", MOST)

    def __reduce__(self) -> tuple[object, ...]:
        return Arm, tuple(getattr(self, spec.name) for spec in fields(self))

    @property
    def n_joints(self) -> int:
        """Number of joints, which is the number of links."""
        return len(self.lengths)

    @property
    def reach(self) -> float:
        """Distance of the hand from the base when stretched, m."""
        return float(sum(self.lengths))

    @property
    def length_array(self) -> Array:
        """Link lengths as a new array, ``(n,)``, m."""
        return np.array(self.lengths)

    @property
    def base_array(self) -> Array:
        """Position of the first joint as a new array, ``(2,)``, m."""
        return np.array(self.base, dtype=float)

    @property
    def chain_constants(self) -> tuple[Array, Array]:
        """Coupling matrix ``(n, n)``, kg m^2, and weight ``(n,)``, N m: see :mod:`planners.robot.dynamics`."""
        coupling, weight = self._chain_constants
        return coupling.copy(), weight.copy()

    @cached_property
    def _chain_constants(self) -> tuple[Array, Array]:
        coupling, static_moments = dynamics.chain_constants(
            self.length_array, np.array(self.masses), np.array(self.coms), np.array(self.inertias)
        )
        return coupling, self.gravity * static_moments

    def with_payload(self, mass: float) -> Arm:
        """The same arm holding a point mass (kg) at its hand; ValueError if it is negative or not finite."""
        require_finite("payload mass", mass, "kg", "not negative", MOST)
        if mass == 0.0:
            return self
        link, com, length = self.masses[-1], self.coms[-1], self.lengths[-1]
        both = link + mass
        new_com = (link * com + mass * length) / both
        inertia = self.inertias[-1] + link * (com - new_com) ** 2 + mass * (length - new_com) ** 2
        return replace(
            self,
            masses=(*self.masses[:-1], both),
            coms=(*self.coms[:-1], new_com),
            inertias=(*self.inertias[:-1], inertia),
        )

    def joint_positions(self, q: ArrayLike) -> Array:
        """Positions of every joint and of the hand, ``(n + 1, 2)`` or ``(batch, n + 1, 2)``, m."""
        return self._over_rows(partial(kinematics.joint_positions, self.length_array, self.base_array), q)

    def forward_kinematics(self, q: ArrayLike) -> Array:
        """Hand position, ``(2,)`` or ``(batch, 2)``, m, for ``q`` of ``(n,)`` or ``(batch, n)``, rad."""
        return self.joint_positions(q)[..., -1, :]

    def jacobian(self, q: ArrayLike) -> Array:
        """Derivative of the hand position by the joint angles, ``(2, n)`` or ``(batch, 2, n)``, m."""
        return self._over_rows(partial(kinematics.jacobian, self.length_array), q)

    def inverse_kinematics(
        self, hand: ArrayLike, orientation: ArrayLike | None = None, near: ArrayLike | None = None
    ) -> Array:
        """Joint postures that put the hand at a position: all of them for one to three links, some for more.

        Args:
            hand: position, ``(2,)`` or ``(batch, 2)``, m. That of a single link must be on its circle.
            orientation: absolute angle of the last link, a number or ``(batch,)``, rad: needed for three links,
                refused for one and two (where the position alone decides), optional for more.
            near: for four links or more, where the search starts, ``(n,)``, rad; the middle of the joint ranges when
                left out.

        Returns:
            ``(k, n)`` or ``(batch, k, n)``, rad. One link: k = 1. Two and three, in closed form, whatever the joint
            ranges: k = 2, first the branch with ``q2 >= 0`` (elbow +), then ``q2 <= 0``; on the rim of the workspace
            the two are equal. Four and more: up to 8 different postures within the joint ranges, found numerically,
            the closest to ``near`` first (see :mod:`planners.robot.redundant`); rows of a batch with fewer than
            others repeat their last one.

        Raises:
            UnreachableTarget: if a target is out of reach; the message names it and the reach. For four links and
                more also if no posture within the joint ranges is found.
            ValueError: if a shape does not fit, or the orientation is missing or superfluous.
        """
        target = floats("hand position", hand)
        if target.ndim not in (1, 2) or target.shape[-1] != 2:
            raise ValueError(f"hand position has shape {target.shape}; give (2,) or (batch, 2)")
        n, rows = self.n_joints, np.atleast_2d(target)
        if n < 3 and orientation is not None:
            raise ValueError(f"{n} link{'s'[: n - 1]} cannot choose the orientation of the hand; leave it out")
        if n == 3 and orientation is None:
            raise ValueError("three links reach a position in infinitely many ways; give the hand's orientation")
        angles = None if orientation is None else floats("orientation", orientation)
        if angles is not None and angles.shape not in ((), target.shape[:-1]):
            raise ValueError(f"orientation has shape {angles.shape}; give one number, or one per hand position")
        angles = None if angles is None else np.broadcast_to(angles, len(rows))
        start = self._search_start(near)
        if n > 3:
            q = redundant.postures_of_rows(self.length_array, self.base_array, rows, angles, self.limits, start)
        elif angles is not None:
            q = kinematics.three_link_inverse(self.length_array, self.base_array, rows, angles)
        else:
            inverse = kinematics.one_link_inverse if n == 1 else kinematics.two_link_inverse
            q = inverse(self.length_array, self.base_array, rows)
        return q[0] if target.ndim == 1 else q

    def _search_start(self, near: ArrayLike | None) -> Array:
        """The posture where a search starts, ``(n,)``, rad."""
        start = floats("near", self.limits.angle_middle if near is None else near)
        if start.shape != (self.n_joints,):
            raise ValueError(f"near {start} has shape {start.shape}; {self.name} wants ({self.n_joints},)")
        require_all_finite("near", start, most=FARTHEST)
        return start

    def clearance(self, q: ArrayLike, position: ArrayLike, radius: float) -> Array:
        """Distance between the surfaces of the arm and of a disc, m; negative by how deep they overlap.

        A number, or ``(batch,)`` for ``q`` of ``(batch, n)``. The centre of the disc is ``(2,)`` or ``(batch, 2)``, m.
        NaN where an angle or the centre is not finite.
        """
        center = floats("centre of the disc", position)
        require_finite("disc radius", radius, "m", "not negative")
        if center.ndim not in (1, 2) or center.shape[-1] != 2:
            raise ValueError(f"the centre of the disc has shape {center.shape}; give (2,) or (batch, 2)")
        batch = np.shape(q)[:-1]
        if center.ndim == 2 and center.shape[:-1] != batch:
            raise ValueError(
                f"{len(center)} centres of the disc for postures of {batch or 'a single row'}; give one each"
            )
        radius = float(radius)

        def gaps(rows: Array) -> Array:
            centers = np.ascontiguousarray(np.broadcast_to(center, (len(rows), 2)))
            found = clearance.clearance(self.length_array, self.base_array, self.link_radius, rows, centers, radius)
            known = np.isfinite(rows).all(axis=1) & np.isfinite(centers).all(axis=1)
            return np.where(known, found, np.nan)

        return self._over_rows(gaps, q)

    def mass_matrix(self, q: ArrayLike) -> Array:
        """Mass matrix, ``(n, n)`` or ``(batch, n, n)``, kg m^2."""
        return self._over_rows(partial(dynamics.mass_matrix, self.chain_constants[0]), q)

    def bias(self, q: ArrayLike, qd: ArrayLike) -> Array:
        """Coriolis, centrifugal and gravity torques, ``(n,)`` or ``(batch, n)``, N m."""
        return self.inverse_dynamics(q, qd, np.zeros_like(floats("q", q)))

    def inverse_dynamics(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> Array:
        """Joint torques ``M(q) qdd + h(q, qd)``, N m, for arguments all of ``(n,)`` or all of ``(batch, n)``."""
        return self._over_rows(partial(dynamics.inverse_dynamics, *self.chain_constants), q, qd, qdd)

    def forward_dynamics(self, q: ArrayLike, qd: ArrayLike, tau: ArrayLike) -> Array:
        """Joint accelerations ``M(q)^-1 (tau - h(q, qd))``, rad/s^2, for arguments all ``(n,)`` or ``(batch, n)``."""
        return self._over_rows(partial(dynamics.forward_dynamics, *self.chain_constants), q, qd, tau)

    def energy(self, q: ArrayLike, qd: ArrayLike) -> Array:
        """Kinetic plus potential energy (zero at the height of the base), a number or ``(batch,)``, J."""
        return self._over_rows(partial(dynamics.energy, *self.chain_constants), q, qd)

    def _over_rows(self, function: Callable[..., Array], *arrays: ArrayLike) -> Array:
        """A function of contiguous ``(batch, n)`` arrays, for arguments all ``(n,)`` or all ``(batch, n)``."""
        given = [floats("joint values", array) for array in arrays]
        shape = given[0].shape
        if len(shape) not in (1, 2) or any(array.shape != shape for array in given) or shape[-1] != self.n_joints:
            shapes = ", ".join(str(array.shape) for array in given)
            raise ValueError(
                f"got shapes {shapes}; {self.name} wants ({self.n_joints},) or (batch, {self.n_joints}) for all"
            )
        rows = [np.ascontiguousarray(np.atleast_2d(array)) for array in given]
        # for arrays that are read-only the function would be compiled once more
        result = function(*(array if array.flags.writeable else array.copy() for array in rows))
        return result[0] if len(shape) == 1 else result


def _per_link(name: str, given: dict[str, ArrayLike], limits: JointLimits | None) -> dict[str, tuple[float, ...]]:
    """Lengths, masses, coms and inertias as one number per link, checked; numbers that hold for every link repeated."""
    links = {kind: _numbers(f"{name}: {kind}", values) for kind, values in given.items()}
    every = {kind for kind, values in given.items() if is_number(values)}
    counts = [len(links[kind]) for kind in links if kind not in every and (links[kind] or kind == "lengths")]
    if limits is not None and not isinstance(limits.torque, EveryJoint):
        counts.append(len(limits.torque))
    n = counts[0] if counts else 1
    if n == 0:
        raise ValueError(f"{name}: lengths are empty; an arm needs at least one link")
    links |= {kind: n * links[kind] for kind in every}
    links["coms"] = links["coms"] or tuple(length / 2.0 for length in links["lengths"])
    rods = zip(links["masses"], links["lengths"], strict=False)
    links["inertias"] = links["inertias"] or tuple(mass * (length * length) / 12.0 for mass, length in rods)
    for kind, values in links.items():
        if len(values) != n:
            raise ValueError(
                f"{name}: {len(values)} {kind} for {n} links; give one per link, or a number that holds for every link"
            )
        sign: Sign = "not negative" if kind in ("coms", "inertias") else "positive"
        require_all_finite(f"{name}: {kind}", values, sign, MOST)
    return links


def _numbers(what: str, given: ArrayLike) -> tuple[float, ...]:
    """A number or a one-dimensional sequence of numbers as floats."""
    array = float_array(what, given)
    if array.ndim > 1:
        raise ValueError(f"{what} has shape {array.shape}; give one number per link, as in (0.4, 0.3)")
    return tuple(np.atleast_1d(array).tolist())


def _number(what: str, given: float) -> float:
    """A single number as a float."""
    if not is_number(given):
        raise ValueError(f"{what} {given!r:.80} must be a number")
    return float(given)
