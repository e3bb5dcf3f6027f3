"""The arm of an environment: the setting ``arm``, and how the other quantities of a task follow from an arm."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, InstanceOf, PlainSerializer

import planners
from planners import Arm
from planners.robot.dynamics import mass_matrix_single
from planners.robot.limits import LimitKind
from planners.typing import Array

MOST_HALF_TURNS = 64
"""Farthest end of a joint range, in units of pi: observed angles beyond are coarser than 0.02 mrad."""

LEAST_INERTIA = 1e-12
"""Least inertia of a link about its centre of mass in Pymunk, as a share of mass times squared length: NaN without."""


def _loaded(given: Any) -> Arm:
    return planners.load_arm(given)


def _document(arm: Arm) -> Mapping[str, Any]:
    return planners.arm_document(arm)


ArmSetting = Annotated[InstanceOf[Arm], BeforeValidator(_loaded), PlainSerializer(_document)]
"""An `Arm`, from what `planners.load_arm` takes; in JSON a document that it takes, too."""


def arm_of(config: Any, default: Arm) -> Arm:
    """The arm of the settings, or the task's own, under the gravity of the settings."""
    arm: Arm = config.arm or default
    return arm if config.gravity is None else replace(arm, gravity=config.gravity)


def require_links(arm: Arm | None, links: Sequence[int], env_id: str) -> None:
    """ValueError if a task that bears these numbers of links is given an arm with another, or any if it bears none."""
    if not links:
        raise ValueError(f"{env_id} keeps its own machine; leave out arm and gravity")
    if arm is not None and arm.n_joints not in links:
        numbers = " or ".join(map(str, links)) if len(links) < 3 else f"{links[0]} to {links[-1]}"
        raise ValueError(f"{env_id} is a task for arms with {numbers} links; {arm.name} has {arm.n_joints}")


def require_limits(arm: Arm, kinds: Sequence[LimitKind], env_id: str) -> None:
    """ValueError if an arm lacks a limit that a task needs."""
    for kind in kinds:
        if not np.isfinite(arm.limits.array(kind)).all():
            raise ValueError(f"{env_id} needs {kind} limits of every joint; {arm.name} has {getattr(arm.limits, kind)}")


def require_inertia(arm: Arm) -> None:
    """ValueError if a link has too little inertia about its own centre of mass for the bodies of Pymunk."""
    sizes = np.array(arm.masses) * np.square(arm.length_array)
    for link in np.flatnonzero(np.array(arm.inertias) < LEAST_INERTIA * sizes).tolist():
        raise ValueError(
            f"link {link} of {arm.name} has an inertia of {arm.inertias[link]:.3g} kg m^2 about its centre of mass; "
            f'Pymunk needs {LEAST_INERTIA * sizes[link]:.3g} kg m^2; give inertias, or choose physics="closed_form"'
        )


def angular_acceleration(arm: Arm) -> float:
    """Acceleration that every joint can give alone to the outstretched arm, within its limits, rad/s^2; may be inf."""
    inertia = np.empty((arm.n_joints, arm.n_joints))
    mass_matrix_single.py_func(arm.chain_constants[0], np.zeros(arm.n_joints), inertia)  # not worth compiling
    return float(np.minimum(arm.limits.array("torque") / np.diag(inertia), arm.limits.array("acceleration")).min())


def angular_speed(arm: Arm) -> float:
    """Velocity that every joint can reach within half a turn, and its limits allow, rad/s; may be inf."""
    braked = math.sqrt(math.pi * angular_acceleration(arm))
    return float(min(arm.limits.array("velocity").min(), braked))


def quickness(arm: Arm, standard: Arm) -> float:
    """How quickly an arm turns its joints, compared with a standard one: 1 for that one itself."""
    own = angular_speed(arm), math.sqrt(angular_acceleration(arm))
    others = angular_speed(standard), math.sqrt(angular_acceleration(standard))
    return min(one / other for one, other in zip(own, others, strict=True))


def scale_of(arm: Arm, kind: LimitKind, standard: Arm) -> float:
    """Factor on the scale of observed velocities or accelerations, compared with those of a standard arm.

    The ratio of the largest limits, or where an arm lacks one, of what torques and the other limits give.
    """

    def size(one: Arm) -> float:
        limits = one.limits.array(kind)
        if np.isfinite(limits).any():
            return float(limits[np.isfinite(limits)].max())
        own = angular_speed(one) if kind == "velocity" else angular_acceleration(one)
        return own if math.isfinite(own) else math.nan

    ratio = size(arm) / size(standard)
    return ratio if math.isfinite(ratio) else 1.0


def angle_bound(arm: Arm) -> float:
    """Largest observed joint angle in units of pi: 4, or half a turn beyond the joint ranges where they reach further.

    Raises:
        ValueError: if a joint range reaches so far that observations, numbers of seven digits, are too coarse.
    """
    ends = np.abs([arm.limits.angle_lower, arm.limits.angle_upper])
    farthest = float(ends[np.isfinite(ends)].max(initial=0.0)) / math.pi
    if farthest > MOST_HALF_TURNS:
        raise ValueError(
            f"the joint ranges of {arm.name} reach {farthest:.0f} half turns from 0, more than the {MOST_HALF_TURNS} "
            "that an observation resolves; take whole turns away"
        )
    return max(4.0, math.ceil(farthest) + 1.0)


def farthest_angle(arm: Arm) -> float:
    """Joint angle, rad, up to which a motion may begin or end: half a turn before that which observations hold."""
    return (angle_bound(arm) - 1.0) * math.pi


def require_observed(arm: Arm, name: str, angles: Array) -> None:
    """ValueError if joint angles, rad, are outside the joint ranges, or so far that a motion leaves the observation."""
    if not arm.limits.within(angles):
        raise ValueError(f"{name} {np.asarray(angles).tolist()} rad leaves the joint ranges, {arm.limits.angle_text}")
    most = farthest_angle(arm)
    if not float(np.abs(angles).max()) <= most:
        raise ValueError(
            f"{name} {np.asarray(angles).tolist()} rad is beyond the {most:.4g} rad from which observations can follow "
            "a motion; take whole turns away"
        )


def scaled_view(
    view: tuple[float, float, float, float], arm: Arm, standard: Arm, *, mirrored: bool = False
) -> tuple[float, float, float, float]:
    """The part of the plane that a frame shows, from that of the standard arm: in proportion to the reach."""
    size, (x, y) = arm.reach / standard.reach, arm.base
    left, right, bottom, top = view
    bottom, top = (-top, -bottom) if mirrored else (bottom, top)
    return x + size * left, x + size * right, y + size * bottom, y + size * top
