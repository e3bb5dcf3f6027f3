"""Kinematics of a planar chain of revolute joints: forward, Jacobian, and the closed-form inverse.

Angles are relative: link i points along ``phi_i = q_0 + ... + q_i``. Everything is batched over lanes,
arrays of shape ``(lanes, n)``; :class:`planners.robot.arm.Arm` offers the same for a single ``(n,)``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from planners.typing import Array


class UnreachableTarget(ValueError):
    """A hand position that no joint angles reach.

    Attributes:
        lanes: indices of the targets that cannot be reached.
    """

    def __init__(self, message: str, lanes: tuple[int, ...]) -> None:
        super().__init__(message)
        self.lanes = lanes

    def __reduce__(self) -> tuple[object, ...]:
        return UnreachableTarget, (str(self), self.lanes)


@njit(cache=True, nogil=True)
def joint_positions(lengths: Array, base: Array, q: Array) -> Array:
    """Positions of every joint and of the hand, ``(lanes, n + 1, 2)`` in metres, for ``q`` of ``(lanes, n)``."""
    lanes, n = q.shape
    points = np.empty((lanes, n + 1, 2))
    for lane in range(lanes):
        x, y, phi = base[0], base[1], 0.0
        points[lane, 0, 0], points[lane, 0, 1] = x, y
        for i in range(n):
            phi += q[lane, i]
            x += lengths[i] * np.cos(phi)
            y += lengths[i] * np.sin(phi)
            points[lane, i + 1, 0], points[lane, i + 1, 1] = x, y
    return points


@njit(cache=True, nogil=True)
def jacobian(lengths: Array, q: Array) -> Array:
    """Derivative of the hand position by the joint angles, ``(lanes, 2, n)`` in metres, for ``q`` of ``(lanes, n)``."""
    lanes, n = q.shape
    columns = np.zeros((lanes, 2, n))
    for lane in range(lanes):
        phi = 0.0
        for i in range(n):
            phi += q[lane, i]
            dx = -lengths[i] * np.sin(phi)
            dy = lengths[i] * np.cos(phi)
            for j in range(i + 1):
                columns[lane, 0, j] += dx
                columns[lane, 1, j] += dy
    return columns


@njit(cache=True, nogil=True)
def hand_state_lane(lengths: Array, base: Array, q: Array, qd: Array, hand: Array, velocity: Array) -> None:
    """Position (m) and velocity (m/s) of one lane's hand, written to ``hand`` and ``velocity``, each ``(2,)``."""
    hand[0], hand[1] = base[0], base[1]
    velocity[0] = velocity[1] = 0.0
    phi = w = 0.0
    for i in range(q.shape[0]):
        phi += q[i]
        w += qd[i]
        dx, dy = lengths[i] * np.cos(phi), lengths[i] * np.sin(phi)
        hand[0] += dx
        hand[1] += dy
        velocity[0] -= dy * w
        velocity[1] += dx * w


@njit(cache=True, nogil=True)
def two_link_branch(l1: float, l2: float, dx: float, dy: float, elbow: float) -> tuple[float, float]:
    """The posture of a two-link arm that puts the hand at ``(dx, dy)`` m from the base; NaN where none does.

    ``tan^2(q2 / 2) = ((l1 + l2)^2 - d^2) / (d^2 - (l1 - l2)^2)``, the law of cosines in the form that stays exact close
    to a folded elbow; ``q1 = atan2(d_y, d_x) - atan2(l2 sin q2, l1 + l2 cos q2)``; ``q2`` has the sign of ``elbow``.
    """
    square = dx * dx + dy * dy
    from_outer_rim, from_inner_rim = (l1 + l2) ** 2 - square, square - (l1 - l2) ** 2
    if not min(from_outer_rim, from_inner_rim) >= -2e-12 * l1 * l2:  # a target on the rim must not fail by rounding
        return np.nan, np.nan
    q2 = np.copysign(2.0 * np.arctan2(np.sqrt(max(from_outer_rim, 0.0)), np.sqrt(max(from_inner_rim, 0.0))), elbow)
    q1 = np.arctan2(dy, dx) - np.arctan2(l2 * np.sin(q2), l1 + l2 * np.cos(q2))
    return (q1 + np.pi) % (2.0 * np.pi) - np.pi, q2


@njit(cache=True, nogil=True)
def _two_link_branches(lengths: Array, base: Array, hand: Array) -> Array:
    q = np.empty((hand.shape[0], 2, 2))
    for lane in range(hand.shape[0]):
        dx, dy = hand[lane, 0] - base[0], hand[lane, 1] - base[1]
        for branch in range(2):
            q[lane, branch, 0], q[lane, branch, 1] = two_link_branch(lengths[0], lengths[1], dx, dy, 1.0 - 2.0 * branch)
    return q


def two_link_inverse(lengths: Array, base: Array, hand: Array) -> Array:
    """Both elbow branches of a two-link arm (see `two_link_branch`).

    Args:
        lengths: link lengths, ``(2,)``, m.
        base: position of the first joint, ``(2,)``, m.
        hand: wanted hand positions, ``(lanes, 2)``, m.

    Returns:
        Joint angles ``(lanes, 2, 2)``: branch 0 has ``q2 >= 0`` (elbow +), branch 1 has ``q2 <= 0`` (elbow -).

    Raises:
        UnreachableTarget: if a target lies outside the annulus the arm reaches.
    """
    q = _two_link_branches(lengths, base, hand)
    out = np.isnan(q[:, 0, 0])
    if out.any():
        lanes = tuple(int(lane) for lane in np.flatnonzero(out))
        x, y = hand[lanes[0]]
        distance = np.hypot(*(hand[lanes[0]] - base))
        raise UnreachableTarget(
            f"position ({x:.4g}, {y:.4g}) m is {distance:.4g} m from the base; links of {lengths[0]:.4g} m and "
            f"{lengths[1]:.4g} m reach from {abs(lengths[0] - lengths[1]):.4g} m to {lengths.sum():.4g} m"
            + (f" (and {len(lanes) - 1} more targets)" if len(lanes) > 1 else ""),
            lanes,
        )
    return q


def three_link_inverse(lengths: Array, base: Array, hand: Array, orientation: Array) -> Array:
    """Both elbow branches of a three-link arm whose last link points along ``orientation``.

    Args:
        lengths: link lengths, ``(3,)``, m.
        base: position of the first joint, ``(2,)``, m.
        hand: wanted hand positions, ``(lanes, 2)``, m.
        orientation: wanted absolute angle of the last link, ``(lanes,)``, rad.

    Returns:
        Joint angles ``(lanes, 2, 3)``: branch 0 has ``q2 >= 0``, branch 1 has ``q2 <= 0``.

    Raises:
        UnreachableTarget: if the wrist this asks for lies outside the reach of the first two links.
    """
    last = lengths[2] * np.stack([np.cos(orientation), np.sin(orientation)], axis=-1)
    try:
        first_two = two_link_inverse(lengths[:2], base, hand - last)
    except UnreachableTarget as error:
        lane = error.lanes[0]
        raise UnreachableTarget(
            f"hand position ({hand[lane, 0]:.4g}, {hand[lane, 1]:.4g}) m with the last link along "
            f"{orientation[lane]:.4g} rad is out of reach: the wrist {error}",
            error.lanes,
        ) from None
    q3 = wrap(orientation[:, None] - first_two.sum(axis=-1))
    return np.concatenate([first_two, q3[..., None]], axis=-1)


def wrap(angle: Array) -> Array:
    """Angles brought into [-pi, pi), rad."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi
