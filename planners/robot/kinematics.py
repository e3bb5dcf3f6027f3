"""Kinematics of a planar chain of revolute joints: forward, Jacobian, and the closed-form inverse.

Angles are relative: link i points along ``phi_i = q_0 + ... + q_i``. Arrays are ``(batch, n)``;
:class:`planners.robot.arm.Arm` offers the same for a single ``(n,)``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numba.extending import register_jitable
from numpy.typing import NDArray

from planners.compiled.calls import private
from planners.typing import Array


class UnreachableTarget(ValueError):
    """A hand position that no joint angles reach; ``rows`` are the indices of such targets."""

    def __init__(self, message: str, rows: tuple[int, ...]) -> None:
        super().__init__(message)
        self.rows = rows

    @classmethod
    def of_rows(cls, first: str, rows: tuple[int, ...]) -> UnreachableTarget:
        """With the message of the first target, and how many more there are."""
        return cls(first + (f" (and {len(rows) - 1} more targets)" if len(rows) > 1 else ""), rows)

    def __reduce__(self) -> tuple[object, ...]:
        return UnreachableTarget, (str(self), self.rows)


@njit(cache=True, nogil=True)
def joint_positions(lengths: Array, base: Array, q: Array) -> Array:
    """Positions of every joint and of the hand, ``(batch, n + 1, 2)`` in metres, for ``q`` of ``(batch, n)``."""
    rows, n = q.shape
    points = np.empty((rows, n + 1, 2))
    for row in range(rows):
        x, y, phi = base[0], base[1], 0.0
        points[row, 0, 0], points[row, 0, 1] = x, y
        for i in range(n):
            phi += q[row, i]
            x += lengths[i] * np.cos(phi)
            y += lengths[i] * np.sin(phi)
            points[row, i + 1, 0], points[row, i + 1, 1] = x, y
    return points


@njit(cache=True, nogil=True)
def jacobian(lengths: Array, q: Array) -> Array:
    """Derivative of the hand position by the joint angles, ``(batch, 2, n)`` in metres, for ``q`` of ``(batch, n)``."""
    rows, n = q.shape
    columns = np.zeros((rows, 2, n))
    for row in range(rows):
        phi = 0.0
        for i in range(n):
            phi += q[row, i]
            dx = -lengths[i] * np.sin(phi)
            dy = lengths[i] * np.cos(phi)
            for j in range(i + 1):
                columns[row, 0, j] += dx
                columns[row, 1, j] += dy
    return columns


@private
def hand_state_single(lengths: Array, base: Array, q: Array, qd: Array, hand: Array, velocity: Array) -> None:
    """Position (m) and velocity (m/s) of one row's hand, written to ``hand`` and ``velocity``, each ``(2,)``."""
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


@private
def two_link_branch(l1: float, l2: float, dx: float, dy: float, elbow: float) -> tuple[float, float]:
    """The posture of a two-link arm that puts the hand at ``(dx, dy)`` m from the base; NaN where none does.

    ``tan^2(q2 / 2) = ((l1 + l2)^2 - d^2) / (d^2 - (l1 - l2)^2)``, the law of cosines in the form that stays exact close
    to a folded elbow; ``q1 = atan2(d_y, d_x) - atan2(l2 sin q2, l1 + l2 cos q2)``; ``q2`` has the sign of ``elbow``.
    """
    square, outer, inner = dx * dx + dy * dy, l1 + l2, l1 - l2
    from_outer_rim, from_inner_rim = outer * outer - square, square - inner * inner
    if not min(from_outer_rim, from_inner_rim) >= -(2e-12 * l1 * l2 + 1e-15 * outer * outer):  # rounding on the rim
        return np.nan, np.nan
    q2 = np.copysign(2.0 * np.arctan2(np.sqrt(max(from_outer_rim, 0.0)), np.sqrt(max(from_inner_rim, 0.0))), elbow)
    q1 = np.arctan2(dy, dx) - np.arctan2(l2 * np.sin(q2), l1 + l2 * np.cos(q2))
    return (q1 + np.pi) % (2.0 * np.pi) - np.pi, q2


@njit(cache=True, nogil=True)
def _two_link_branches(lengths: Array, base: Array, hand: Array) -> Array:
    q = np.empty((hand.shape[0], 2, 2))
    for row in range(hand.shape[0]):
        dx, dy = hand[row, 0] - base[0], hand[row, 1] - base[1]
        distance, rounding = np.hypot(dx, dy), ROUNDING * (np.abs(hand[row]).sum() + np.abs(base).sum())
        beyond = distance - min(lengths[0] + lengths[1], max(abs(lengths[0] - lengths[1]), distance))
        if 0.0 < abs(beyond) <= rounding and distance > rounding:
            dx, dy = dx - dx * beyond / distance, dy - dy * beyond / distance
        for branch in range(2):
            q[row, branch, 0], q[row, branch, 1] = two_link_branch(lengths[0], lengths[1], dx, dy, 1.0 - 2.0 * branch)
    return q


ROUNDING = 4.0 * float(np.finfo(float).eps)
"""Rounding of the difference of two positions, as a share of their sizes."""

ON_CIRCLE = 1e-9
"""Distance from the circle of a single link's hand up to which a position counts as on it, as a share of its length."""


def one_link_inverse(lengths: Array, base: Array, hand: Array) -> Array:
    """The posture of a single link, ``(batch, 1, 1)``, rad, for hand positions ``(batch, 2)`` on its circle, m.

    Raises:
        UnreachableTarget: if a target is not on the circle.
    """
    away = hand - base
    distance = np.hypot(away[:, 0], away[:, 1])
    _require_reach(lengths, base, hand, np.abs(distance - lengths[0]) <= ON_CIRCLE * lengths[0])
    return np.arctan2(away[:, 1], away[:, 0])[:, None, None]


def two_link_inverse(lengths: Array, base: Array, hand: Array) -> Array:
    """Both elbow branches (see `two_link_branch`) of hand positions ``(batch, 2)``, m: ``(batch, 2, 2)``, rad.

    Branch 0 has ``q2 >= 0`` (elbow +), branch 1 has ``q2 <= 0`` (elbow -).

    Raises:
        UnreachableTarget: if a target lies outside the annulus the arm reaches.
    """
    q = _two_link_branches(lengths, base, hand if hand.flags.writeable else hand.copy())  # else compiled twice
    _require_reach(lengths, base, hand, ~np.isnan(q[:, 0, 0]))
    return q


def require_reach(lengths: Array, base: Array, hand: Array) -> None:
    """Raise UnreachableTarget if a hand position, ``(batch, 2)``, m, is out of reach whatever the joint ranges."""
    distance, (nearest, farthest) = np.hypot(*(hand - base).T), reach(lengths)
    rounding = 1e-12 * farthest + ROUNDING * (np.abs(hand).sum(axis=1) + np.abs(base).sum())
    within = np.isfinite(distance) & (distance >= nearest - rounding) & (distance <= farthest + rounding)
    _require_reach(lengths, base, hand, within)


def reach(lengths: Array) -> tuple[float, float]:
    """Least and largest distance of the hand from the base, m."""
    farthest = float(lengths.sum())
    return max(0.0, 2.0 * float(lengths.max()) - farthest), farthest


def _require_reach(lengths: Array, base: Array, hand: Array, reached: NDArray[np.bool_]) -> None:
    """Raise UnreachableTarget if a hand position, ``(batch, 2)``, m, is not reached."""
    if reached.all():
        return
    rows = tuple(int(row) for row in np.flatnonzero(~reached))
    x, y = hand[rows[0]]
    distance, (nearest, farthest) = np.hypot(*(hand[rows[0]] - base)), reach(lengths)
    *first, last = (f"{length:.4g} m" for length in lengths)
    links = f"links of {', '.join(first)} and {last} reach from {nearest:.4g} m to" if first else "one link reaches"
    message = f"position ({x:.4g}, {y:.4g}) m is {distance:.4g} m from the base; {links} {farthest:.4g} m"
    raise UnreachableTarget.of_rows(message, rows)


def three_link_inverse(lengths: Array, base: Array, hand: Array, orientation: Array) -> Array:
    """As `two_link_inverse`, ``(batch, 2, 3)``, for three links, the last at the absolute angles ``(batch,)``, rad.

    Raises:
        UnreachableTarget: if the wrist lies outside the reach of the first two links.
    """
    last = lengths[2] * np.stack([np.cos(orientation), np.sin(orientation)], axis=-1)
    try:
        first_two = two_link_inverse(lengths[:2], base, hand - last)
    except UnreachableTarget as error:
        row = error.rows[0]
        raise UnreachableTarget(
            f"hand position ({hand[row, 0]:.4g}, {hand[row, 1]:.4g}) m with the last link along "
            f"{orientation[row]:.4g} rad is out of reach: the wrist {error}",
            error.rows,
        ) from None
    q3 = wrap(orientation[:, None] - first_two.sum(axis=-1))
    return np.concatenate([first_two, q3[..., None]], axis=-1)


@register_jitable
def turned_towards(angle: Any, near: Any) -> Any:
    """Angles in the whole turns that are closest to others, rad; for numbers and arrays, in compiled code too."""
    return angle + 2.0 * np.pi * np.rint((near - angle) / (2.0 * np.pi))


def wrap(angle: Array) -> Array:
    """Angles brought into [-pi, pi), rad."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi
