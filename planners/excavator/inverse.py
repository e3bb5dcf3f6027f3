"""Inverse kinematics of the excavator attachment in closed form, with every branch.

Source: "A Study on Motion Control and Kinematics Analysis of Articulated Manipulator Attachment for Excavator" (2019),
equations (2-3) to (2-16). Corrected here:

- (2-6): with the arc cosine for ``Phi2``, ``theta1 = Phi1 +- Phi2 + pi/2``; the quarter turn is missing in print.
- (2-14): the second line is ``(a3 s3) c2 + (a2 + a3 c3) s2 = 1ry``; the printed minus sign fits no direction of y.
- (2-8) and (2-13): arc cosines, which lose half the digits near a singularity, are replaced by arc tangents.
- (2-11): ``theta6`` comes from the axes of frame 5, which are known there, without the division by ``sin(theta5)``.

The tool is fixed, so a target is five numbers: position of the tip and direction of the tool. It has up to eight
branches; a whole orientation leaves one or two of them (``full_pose=True``).
"""

from __future__ import annotations

import enum
import itertools
import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from planners.checks import float_vector
from planners.compiled.calls import private
from planners.excavator.kinematics import vectors
from planners.excavator.machine import EXCAVATOR, JOINT_NAMES, N_JOINTS, Excavator
from planners.excavator.newton_euler import Vector
from planners.robot.kinematics import two_link_branch
from planners.typing import Array

_SIDES = ("facing", "over the back"), ("bucket down", "bucket up"), ("elbow down", "elbow up")
BRANCH_NAMES = tuple(", ".join(names) for names in itertools.product(*_SIDES))
"""Names of the eight branches, in the order of the results.

Shoulder: wrist in front of the slewing axis or behind it; bucket: sign of ``theta5``; elbow: sign of ``theta3``.
"""


class IKStatus(enum.IntFlag):
    """Flags of a branch; 0 is a regular posture within the ranges.

    With SHOULDER, ELBOW or TOOL there is no posture (NaN); with BUCKET and RANGE alone there is one.
    """

    SHOULDER = 1
    """The wrist would be closer to the slewing axis than its lateral offset ``d4``."""
    BUCKET = 2
    """``sin(theta5) = 0``: the axis leaves ``theta2 + theta3 + theta4`` free; the sum closest to that of ``near`` is
    taken or, for a full pose, the one of its orientation."""
    ELBOW = 4
    """The wrist is out of reach of boom and arm."""
    RANGE = 8
    """A joint angle is outside its range."""
    TOOL = 16
    """The tool would have to be mounted at another sixth angle (only with ``full_pose``)."""


Target = tuple[Array, Array, Array]
"""Position of the tip, direction of the tool and its x axis, ``(3,)`` each."""

# numba takes plain integers
_SHOULDER, _BUCKET, _ELBOW, _RANGE, _TOOL = (int(flag) for flag in IKStatus)

# Use of the target's sixth angle: none, reported, or required.
_AXIS_ONLY, _REPORT_TOOL, _DEMAND_TOOL = range(3)

_ROUNDING = 1e-9  # rad or relative: a posture on the very limit of a joint is inside
_SINGULAR = 5e-13  # rad, error of the tool's axis up to which a singular posture is accepted
_TOOL_TOLERANCE = 1e-6  # rad, of the sixth angle of a full pose


@dataclass(frozen=True, eq=False)
class Branches:
    """The postures that reach a target, in the order of `BRANCH_NAMES`.

    Attributes:
        q: joint angles, ``(..., 8, 5)``, rad, in [-pi, pi]; NaN where there is no posture.
        theta6: sixth angle at which the mounted tool would have the target's orientation, ``(..., 8)``, rad; without an
            orientation its actual angle. NaN where there is no posture.
        status: `IKStatus` of each branch, ``(..., 8)``.
        nearest: index of the usable branch closest to the posture ``near``, ``(...)``; -1 where none is usable.
        machine: the attachment.
    """

    q: Array
    theta6: Array
    status: NDArray[np.int64]
    nearest: NDArray[np.intp]
    machine: Excavator

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Mask of the branches with a posture within the joint ranges, ``(..., 8)``."""
        fine: NDArray[np.bool_] = (self.status & ~_BUCKET) == 0
        return fine

    def explain(self, target: int | tuple[int, ...] = ()) -> str:
        """One line for each branch of a target: its name, flags and joints out of range.

        Args:
            target: index of the target in ``(...)``; left out for a single one.

        Raises:
            ValueError: if that is no single target.
        """
        if np.shape(self.nearest[target]) != ():
            raise ValueError(f"target {target!r:.80} must be the index of one target among {np.shape(self.nearest)}")
        limits = self.machine.limits
        ranges = list(zip(np.degrees(limits.angle_lower), np.degrees(limits.angle_upper), strict=True))
        lines = []
        for name, code, q in zip(BRANCH_NAMES, self.status[target], self.q[target], strict=True):
            flags = IKStatus(int(code))
            text = ", ".join(str(flag.name) for flag in flags) or "fine"
            beyond = [
                f"{joint} at {angle:.1f} deg of " + (f"+-{up:.0f}" if low == -up else f"{low:.0f} to {up:.0f}")
                for joint, angle, (low, up) in zip(JOINT_NAMES, np.degrees(q), ranges, strict=True)
                if IKStatus.RANGE in flags and not low <= angle <= up
            ]
            lines.append(f"{name}: {text}" + (f" ({', '.join(beyond)})" if beyond else ""))
        return "\n".join(lines)


def inverse_kinematics(
    tip: ArrayLike,
    axis: ArrayLike,
    *,
    tool_x: ArrayLike | None = None,
    full_pose: bool = False,
    near: ArrayLike | None = None,
    weights: ArrayLike | None = None,
    machine: Excavator = EXCAVATOR,
) -> Branches:
    """Every posture with the tip at a position and the tool along a direction.

    Branches of unreachable targets are NaN, with the reason in their status. Leading axes broadcast.

    Args:
        tip: position of the tip, ``(..., 3)``, m.
        axis: direction of the tool (z axis of frame 6), ``(..., 3)``, of any length but 0.
        tool_x: x axis of the tool, ``(..., 3)``, perpendicular to ``axis``: completes the orientation, for which
            `Branches.theta6` is solved.
        full_pose: keep only the branches with the orientation of the mounted tool (``theta6`` within 1e-6 rad); needs
            ``tool_x``.
        near: current posture, ``(..., 5)``, rad, for `Branches.nearest` and a free ``theta2 + theta3 + theta4``
            (`IKStatus.BUCKET`); the zero posture when left out.
        weights: of the joints in the distance ``sqrt(sum((w_i dq_i)^2))``, ``(5,)``, all 1 when left out.
        machine: the attachment.

    Raises:
        ValueError: if an argument has a wrong shape or value, or ``full_pose`` comes without ``tool_x``.
    """
    if full_pose and tool_x is None:
        raise ValueError("full_pose needs the whole orientation of the tool: give tool_x beside the axis")
    mode = _AXIS_ONLY if tool_x is None else _DEMAND_TOOL if full_pose else _REPORT_TOOL
    scale = float_vector("weights", [1.0] * N_JOINTS if weights is None else weights, N_JOINTS, "not negative")
    tips = _finite("tip", tip, 3)
    directions = _directions("axis", axis)
    sideways = directions if tool_x is None else _directions("tool_x", tool_x)
    posture = np.zeros(N_JOINTS) if near is None else _finite("near", near, N_JOINTS)
    shape = np.broadcast_shapes(tips.shape[:-1], directions.shape[:-1], sideways.shape[:-1], posture.shape[:-1])
    if tool_x is not None and np.abs(np.sum(directions * sideways, axis=-1)).max(initial=0.0) > _TOOL_TOLERANCE:
        raise ValueError("tool_x must be at a right angle to the axis: both belong to one rotation matrix")

    tips, directions, sideways, posture = (_rows(values, shape) for values in (tips, directions, sideways, posture))
    ranges = np.stack([machine.limits.angle_lower, machine.limits.angle_upper])
    q, theta6, status = _solve(machine.geometry.kernel_array, ranges, tips, directions, sideways, posture, mode)
    distance = np.linalg.norm(scale * (q - posture[:, None, :]), axis=-1)
    distance[(status & ~_BUCKET) != 0] = np.inf
    nearest = np.where(np.isfinite(distance).any(axis=-1), np.argmin(distance, axis=-1), -1)
    q, theta6, status = q.reshape(*shape, 8, N_JOINTS), theta6.reshape(*shape, 8), status.reshape(*shape, 8)
    return Branches(q, theta6, status, nearest.reshape(shape), machine)


def _finite(name: str, given: ArrayLike, size: int) -> Array:
    values = vectors(name, given, size)
    bad = values[~np.isfinite(values)]
    if bad.size:
        raise ValueError(f"{name} must be finite; got {float(bad[0])}")
    return values


def _directions(name: str, given: ArrayLike) -> Array:
    values = _finite(name, given, 3)
    largest = np.abs(values).max(axis=-1, keepdims=True)
    if not (largest > 0.0).all():
        raise ValueError(f"{name} has length 0; give a direction")
    values = np.ldexp(values, -np.frexp(largest)[1])  # squares of huge and of tiny numbers are no numbers
    units: Array = values / np.linalg.norm(values, axis=-1, keepdims=True)
    return units


def _rows(values: Array, shape: tuple[int, ...]) -> Array:
    """``values`` broadcast to ``shape`` before its last axis, as contiguous ``(batch, n)``."""
    n = values.shape[-1]
    return np.ascontiguousarray(np.broadcast_to(values, (*shape, n)).reshape(-1, n))


@njit(cache=True, nogil=True)
def _solve(
    geometry: Array, ranges: Array, tip: Array, axis: Array, tool_x: Array, near: Array, mode: int
) -> tuple[Array, Array, NDArray[np.int64]]:
    """All branches of all targets: joint angles ``(batch, 8, 5)``, sixth angles and status ``(batch, 8)``."""
    rows = tip.shape[0]
    q = np.full((rows, 8, 5), np.nan)
    theta6 = np.full((rows, 8), np.nan)
    status = np.empty((rows, 8), dtype=np.int64)
    for row in range(rows):
        target = (tip[row], axis[row], tool_x[row])
        pitch = near[row, 1] + near[row, 2] + near[row, 3]
        for pair in range(4):
            status[row, 2 * pair : 2 * pair + 2] = _solve_pair(geometry, target, pitch, mode, pair, q[row], theta6[row])
        for branch in range(8):
            for joint in range(5):
                lower, upper = ranges[0, joint] - _ROUNDING, ranges[1, joint] + _ROUNDING
                for turn in (2.0 * math.pi, -2.0 * math.pi):
                    if lower <= q[row, branch, joint] + turn <= upper and not lower <= q[row, branch, joint] <= upper:
                        q[row, branch, joint] += turn
                if q[row, branch, joint] < lower or q[row, branch, joint] > upper:
                    status[row, branch] |= _RANGE
    return q, theta6, status


@private
def _solve_pair(
    geometry: Array,
    target: tuple[Array, Array, Array],
    free_pitch: float,
    mode: int,
    pair: int,
    q: Array,
    theta6: Array,
) -> int:
    """Write the two elbow branches of a shoulder and bucket branch; returns their status.

    They are rows ``2 pair`` and ``2 pair + 1`` of ``q`` ``(8, 5)`` and ``theta6`` ``(8,)``.
    """
    d1, a2, a3, d4, d5, d6, mounted = geometry
    tip, axis, tool_x = target
    shoulder, bucket = 1.0 - 2.0 * (pair >> 1), 1.0 - 2.0 * (pair & 1)
    px, py, pz = tip[0] - d6 * axis[0], tip[1] - d6 * axis[1], tip[2] - d6 * axis[2]  # (2-3)

    # (2-4) to (2-6): the wrist is d4 beside the plane of the boom, `front` along it
    r = np.hypot(px, py)
    if r < abs(d4) - 1e-13 * (a2 + a3):  # room for rounding
        return _SHOULDER
    front = shoulder * np.sqrt(max((r - d4) * (r + d4), 0.0))
    theta1 = _wrap(np.arctan2(py, px) + np.arctan2(d4, front))
    s1, c1 = np.sin(theta1), np.cos(theta1)

    # frame 1, where the chain is planar: x4 = (cos(pitch), sin(pitch), 0)
    w = (c1 * axis[0] + s1 * axis[1], axis[2], s1 * axis[0] - c1 * axis[1])
    x6 = (c1 * tool_x[0] + s1 * tool_x[1], tool_x[2], s1 * tool_x[0] - c1 * tool_x[1])
    height = pz - d1
    theta5, asked_pitch, code = _roll_and_pitch(w, x6, mounted, bucket, free_pitch, mode)
    if code & _TOOL:
        return code
    s5, c5 = np.sin(theta5), np.cos(theta5)
    pitch = _reachable_pitch(asked_pitch, front, height, a2, a3, d5)
    turn = abs(pitch - asked_pitch) * (1.0 if mode == _DEMAND_TOOL else abs(s5))  # error of the target, rad
    if turn > _SINGULAR:
        return code | _ELBOW

    # the sixth angle, of x6 against x5 and y5
    sp, cp = np.sin(pitch), np.cos(pitch)
    sixth = mounted
    if mode != _AXIS_ONLY:
        sixth = np.arctan2(cp * x6[1] - sp * x6[0], c5 * (cp * x6[0] + sp * x6[1]) + s5 * x6[2])
    if mode == _DEMAND_TOOL and abs(_wrap(sixth - mounted)) > _TOOL_TOLERANCE:
        return code | _TOOL

    # (2-12) to (2-16): boom and arm are a planar arm of two links
    for elbow in range(2):
        theta2, theta3 = two_link_branch(a2, a3, front - d5 * sp, height + d5 * cp, 1.0 - 2.0 * elbow)
        if np.isnan(theta3):
            return code | _ELBOW
        theta6[2 * pair + elbow] = sixth
        posture = q[2 * pair + elbow]
        posture[0], posture[1], posture[2], posture[4] = theta1, theta2, theta3, theta5
        posture[3] = _wrap(pitch - theta2 - theta3)
    return code


@private
def _roll_and_pitch(
    w: Vector, x6: Vector, mounted: float, bucket: float, free_pitch: float, mode: int
) -> tuple[float, float, int]:
    """``theta5``, ``theta234`` and the status, from the axes of the tool in frame 1.

    ``w = c5 z1 - s5 x4`` gives both, (2-7), (2-8) and (2-16), unless ``s5`` vanishes. Then ``x5 = c5 x4 + s5 z1`` gives
    them for a whole orientation; without one ``theta234`` is free.
    """
    s5, c5 = np.hypot(w[0], w[1]), w[2]
    if s5 > (_TOOL_TOLERANCE if mode == _DEMAND_TOOL else _SINGULAR):
        return bucket * np.arctan2(s5, c5), np.arctan2(-bucket * w[1], -bucket * w[0]), 0
    if mode != _DEMAND_TOOL:
        return bucket * (0.0 if c5 > 0.0 else math.pi), free_pitch, _BUCKET
    sine, cosine = np.sin(mounted), np.cos(mounted)
    y6 = (w[1] * x6[2] - w[2] * x6[1], w[2] * x6[0] - w[0] * x6[2], w[0] * x6[1] - w[1] * x6[0])
    x5 = (cosine * x6[0] - sine * y6[0], cosine * x6[1] - sine * y6[1], cosine * x6[2] - sine * y6[2])
    if bucket * x5[2] < 0.0:
        return np.nan, np.nan, _BUCKET | _TOOL
    toward = np.copysign(1.0, c5)
    return np.arctan2(x5[2], c5), np.arctan2(toward * x5[1], toward * x5[0]), _BUCKET


@private
def _reachable_pitch(wanted: float, front: float, height: float, a2: float, a3: float, d5: float) -> float:
    """The ``theta234`` closest to ``wanted`` for which boom and arm reach the wrist, rad.

    The squared distance to span is ``R^2 + d5^2 - 2 d5 R cos(theta234 - centre)``, with ``R`` the distance of the roll
    joint from the boom's joint.
    """
    distance = np.hypot(front, height)
    scale = 2.0 * d5 * distance
    if scale == 0.0:
        return wanted
    centre = np.arctan2(front, -height)
    away = _wrap(wanted - centre)
    square = distance**2 + d5**2
    bounds = (square - (a2 + a3) ** 2) / scale, (square - (a2 - a3) ** 2) / scale
    cosine = min(max(np.cos(away), min(bounds)), max(bounds))
    if cosine == np.cos(away) or abs(cosine) > 1.0:
        return wanted
    closest: float = wanted + (np.copysign(np.arccos(cosine), away) - away)
    return closest


@private
def _wrap(angle: float) -> float:
    """An angle brought into [-pi, pi), rad."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi
