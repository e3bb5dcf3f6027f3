"""Inverse kinematics of arms with more joints than the hand has coordinates: damped least squares from many starts.

Each iteration moves the joints by ``dq = J^T (J J^T + mu I)^-1 e``, with the error ``e`` of the hand and a damping
``mu`` proportional to ``|e|``: N. Yamashita and M. Fukushima, "On the Rate of Convergence of the Levenberg-Marquardt
Method" (2001), quadratic also where the Jacobian loses rank. Joints at an end of their range that would leave it are
held.
"""

from __future__ import annotations

import math

import numpy as np

from planners.robot import kinematics
from planners.robot.limits import JointLimits
from planners.typing import Array

STARTS = 64, 1024
"""Numbers of start postures, from a Halton sequence within the joint ranges: the second if the first find nothing."""

ITERATIONS = 120
DAMPING = 1e-3
ROUNDING = 1e-13
"""Least damping, as a share of the square of the arm's length, so that no equation is singular."""

LONGEST_STEP = 0.5
"""Largest change of a joint in an iteration, rad."""

EXACT = 1e-12
"""Error of the hand up to which a posture is a solution, as a share of the arm's length; of its orientation, rad."""

MOST, APART = 8, 0.2
"""Number of postures that are returned at most, and the least difference of a joint between two of them, rad."""


def postures(
    lengths: Array, base: Array, hand: Array, orientation: float | None, limits: JointLimits, near: Array
) -> Array:
    """Postures with the hand at a position, and the last link along ``orientation`` (rad) if it is given.

    They are solutions among infinitely many: each the one that a start posture leads to. The same arguments give the
    same postures, to the bit.

    Args:
        lengths, base: of the arm, ``(n,)`` and ``(2,)``, m.
        hand: position, ``(2,)``, m.
        orientation: absolute angle of the last link, rad; None for any.
        limits: of the joints, of which the ranges are kept.
        near: the first start, ``(n,)``, rad. Joints without a range are turned to within half a turn of it.

    Returns:
        ``(k, n)``, rad, k from 1 to `MOST`, the closest to ``near`` (in the sum of the joints' changes) first.

    Raises:
        UnreachableTarget: if the position is out of reach, or no posture within the joint ranges is found.
    """
    kinematics.require_reach(lengths, base, hand[None])
    lower, upper = limits.angle_lower, limits.angle_upper
    for starts in STARTS if orientation is None or math.isfinite(orientation) else ():
        q = _starts(starts, lengths, hand - base, lower, upper, near)
        q = _solve(lengths, base, hand, orientation, lower, upper, q)
        if len(q):
            q = np.where(np.isinf(lower), near + kinematics.wrap(q - near), q)
            return _distinct(q, near)
    along = "" if orientation is None else f" and the last link along {orientation:.4g} rad"
    raise kinematics.UnreachableTarget(
        f"no posture with the hand at ({hand[0]:.4g}, {hand[1]:.4g}) m{along} was found within the joint ranges, "
        f"{limits.angle_text}",
        (0,),
    )


def postures_of_rows(
    lengths: Array, base: Array, hands: Array, orientations: Array | None, limits: JointLimits, near: Array
) -> Array:
    """`postures` of each hand position ``(batch, 2)``, with ``orientations`` ``(batch,)``: ``(batch, k, n)``, rad.

    Rows with fewer postures than others repeat their last one.

    Raises:
        UnreachableTarget: for all positions without a posture.
    """
    found, failures = [], {}
    for row, hand in enumerate(hands):
        along = None if orientations is None else float(orientations[row])
        try:
            found.append(postures(lengths, base, hand, along, limits, near))
        except kinematics.UnreachableTarget as failure:
            failures[row] = str(failure)
    if failures:
        raise kinematics.UnreachableTarget.of_rows(next(iter(failures.values())), tuple(failures))
    most = max((len(each) for each in found), default=0)
    repeated = [each[np.minimum(np.arange(most), len(each) - 1)] for each in found]
    return np.array(repeated).reshape(len(hands), most, len(lengths))


def _solve(
    lengths: Array, base: Array, hand: Array, orientation: float | None, lower: Array, upper: Array, q: Array
) -> Array:
    """The postures that solve it, ``(k, n)``, of those that the starts ``q`` ``(starts, n)`` lead to."""
    scale = float(lengths.sum())
    for _ in range(ITERATIONS):
        error, jacobian = _errors(lengths, base, hand, orientation, q)
        size = np.linalg.norm(error, axis=1)
        moving = size > EXACT * scale
        if not moving.any():
            break
        damping = DAMPING * scale * size + ROUNDING * scale**2
        step = _step(error, jacobian, damping)
        held = ((q <= lower) & (step < 0.0)) | ((q >= upper) & (step > 0.0))
        step = _step(error, np.where(held[:, None], 0.0, jacobian), damping)
        step *= np.minimum(1.0, LONGEST_STEP / np.maximum(np.abs(step).max(axis=1), LONGEST_STEP))[:, None]
        q = np.where(moving[:, None], np.clip(q + step, lower, upper), q)
    size = np.linalg.norm(_errors(lengths, base, hand, orientation, q)[0], axis=1)
    solved: Array = q[size <= 10.0 * EXACT * scale]
    return solved


def _starts(number: int, lengths: Array, hand: Array, lower: Array, upper: Array, near: Array) -> Array:
    """Start postures ``(starts, n)``: near, the arm stretched and folded towards the hand, and a Halton sequence."""
    from scipy.stats import qmc  # slow to import

    n, direction = len(lengths), float(np.arctan2(hand[1], hand[0]))
    free = np.isinf(lower)
    low, high = np.where(free, near - np.pi, lower), np.where(free, near + np.pi, upper)
    spread = low + (high - low) * qmc.Halton(n, scramble=False).random(number + 1)[1:]
    stretched, folded = np.full(n, direction), np.full(n, direction + np.pi)
    folded[np.argmax(lengths)] = direction
    along = np.diff(np.stack([stretched, folded]), axis=1, prepend=0.0)
    bent = along + 0.1 * (-1.0) ** np.arange(n)
    turned = kinematics.turned_towards(np.concatenate([along, bent]), (low + high) / 2.0)
    starts: Array = np.clip(np.concatenate([near[None], turned, spread]), low, high)
    return starts


def _errors(lengths: Array, base: Array, hand: Array, orientation: float | None, q: Array) -> tuple[Array, Array]:
    """Error of the hand, ``(batch, m)``, and its derivative by the joints, ``(batch, m, n)``, in m.

    With an orientation m is 3, otherwise 2; an angle counts with the length of the arm.
    """
    q = np.ascontiguousarray(q)
    error = hand - kinematics.joint_positions(lengths, base, q)[:, -1]
    jacobian = kinematics.jacobian(lengths, q)
    if orientation is None:
        return error, jacobian
    scale = float(lengths.sum())
    turn = scale * kinematics.wrap(orientation - q.sum(axis=1))
    return np.column_stack([error, turn]), np.concatenate([jacobian, np.full((len(q), 1, q.shape[1]), scale)], axis=1)


def _step(error: Array, jacobian: Array, damping: Array) -> Array:
    """Damped least squares, ``(batch, n)``, rad."""
    square = jacobian @ jacobian.transpose(0, 2, 1)
    square += damping[:, None, None] * np.eye(square.shape[1])
    step: Array = np.einsum("bmn,bm->bn", jacobian, np.linalg.solve(square, error[..., None])[..., 0])
    return step


def _distinct(postures: Array, near: Array) -> Array:
    """The postures closest to ``near``, at most `MOST`, none close to another."""
    order = np.argsort(np.abs(postures - near).sum(axis=1), kind="stable")
    kept: list[Array] = []
    for posture in postures[order]:
        if len(kept) < MOST and all(np.abs(posture - other).max() > APART for other in kept):
            kept.append(posture)
    return np.array(kept).reshape(-1, postures.shape[1])
