"""Geometric paths ``r -> q``, along which the motion of an arm is that of one scalar.

Along a path ``q = f(r)`` the joint motion follows from ``r`` and its derivatives (eq 9-11 of "Motion Planning of a
Robot Manipulator for Conveyor Tracking"; the jerk is one derivative more):

    q' = f' r',   q'' = f'' r'^2 + f' r'',   q''' = f''' r'^3 + 3 f'' r' r'' + f' r'''

and so does the torque (eq 12): ``tau = A r'' + B r'^2 + G`` with ``A = M f'``, ``B = M f'' + h(q, f')`` and the
weight ``G``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from planners.problem import Infeasible
from planners.robot import dynamics
from planners.robot.arm import Arm
from planners.typing import Array

SINGULAR_SINE = 0.05
"""Smallest |sin q2| a hand line may pass: the joints' derivatives by ``r`` grow like powers of its inverse."""


class Path(Protocol):
    """Joint angles and their derivatives along a parameter ``r``."""

    @property
    def span(self) -> tuple[float, float]:
        """The interval of ``r``, around the start ``r = 0``, on which the path exists."""
        ...

    def derivatives(self, r: ArrayLike) -> Array:
        """``q, f', f'', f'''`` at ``r`` of ``(samples,)``: ``(samples, 4, n)``, rad per powers of the unit of ``r``."""
        ...


@dataclass(frozen=True)
class JointLine:
    """The straight joint path ``q = start + r direction`` (radians per unit of ``r``)."""

    start: Array
    direction: Array

    @property
    def span(self) -> tuple[float, float]:
        """A joint line has no ends."""
        return -math.inf, math.inf

    def derivatives(self, r: ArrayLike) -> Array:
        """``q, f', f'', f'''`` at ``r``: see :class:`Path`."""
        samples = np.asarray(r, dtype=float)
        out = np.zeros((len(samples), 4, len(self.start)))
        out[:, 0] = self.start + samples[:, None] * self.direction
        out[:, 1] = self.direction
        return out


@dataclass(frozen=True)
class HandLine:
    """The straight hand path ``X = origin + r direction`` (eq 7): one elbow and, for three links, one orientation.

    Attributes:
        arm: two or three links.
        origin: hand position at ``r = 0``, ``(2,)``, m.
        direction: hand displacement per unit of ``r``, ``(2,)``, m.
        near: joint angles at ``r = 0`` up to rounding, ``(n,)``, rad: they determine the elbow, the whole turns and
            (three links) the constant orientation of the hand.
    """

    arm: Arm
    origin: Array
    direction: Array
    near: Array

    def __post_init__(self) -> None:
        if self.arm.n_joints not in (2, 3):
            raise ValueError(f"a hand line needs two or three links; {self.arm.name} has {self.arm.n_joints}")
        if not np.linalg.norm(self.direction) > 0.0:
            raise ValueError("a hand line needs a direction; got the zero vector")
        low, high = self.span
        if not low < 0.0 < high:
            raise Infeasible(
                "start",
                f"the hand starts at ({self.origin[0]:.4g}, {self.origin[1]:.4g}) m, where the elbow is straight or "
                f"folded, or out of the reach of {self.arm.name}; start with |sin q2| above {SINGULAR_SINE}",
            )

    @property
    def elbow(self) -> int:
        """+1 or -1: the sign of ``q2``."""
        return 1 if math.sin(self.near[1]) >= 0.0 else -1

    @property
    def wrist(self) -> Array:
        """End of the second link at ``r = 0``, relative to the base, ``(2,)``, m."""
        offset = self.origin - self.arm.base_array
        if self.arm.n_joints == 3:
            angle = float(np.sum(self.near))
            offset = offset - self.arm.lengths[2] * np.array([math.cos(angle), math.sin(angle)])
        return offset

    @property
    def span(self) -> tuple[float, float]:
        """The interval around ``r = 0`` on which the wrist is within reach and the elbow bent; empty (0, 0) if none."""
        l1, l2 = self.arm.lengths[:2]
        bend = math.sqrt(1.0 - SINGULAR_SINE**2)
        nearest, farthest = (math.sqrt(l1**2 + l2**2 + sign * 2.0 * l1 * l2 * bend) for sign in (-1.0, 1.0))
        wrist, direction = self.wrist, self.direction
        scale = float(direction @ direction)
        foot = -float(wrist @ direction) / scale
        miss = abs(float(wrist[0] * direction[1] - wrist[1] * direction[0])) / math.sqrt(scale)
        if not nearest < math.hypot(*wrist) < farthest:
            return 0.0, 0.0
        half = math.sqrt((farthest**2 - miss**2) / scale)
        low, high = foot - half, foot + half
        if miss < nearest:  # the line meets the hole around the base
            hole = math.sqrt((nearest**2 - miss**2) / scale)
            low, high = (low, foot - hole) if foot > 0.0 else (foot + hole, high)
        return low, high

    def derivatives(self, r: ArrayLike) -> Array:
        """``q, f', f'', f'''`` at ``r`` inside ``span``, exact, by implicit differentiation: see :class:`Path`.

        The angles are continuous along the line, with the whole turns of ``near`` at ``r = 0``. At a straight elbow, on
        the border of the span, it raises Infeasible.
        """
        samples = np.append(np.asarray(r, dtype=float), 0.0)
        n, wrist = self.arm.n_joints, self.wrist
        out = _hand_line(self.arm.length_array, wrist, self.direction, self.elbow, n, samples)
        if not np.isfinite(out[:, 1]).all():
            raise Infeasible("unreachable", "the straight path of the hand passes a straight elbow")
        q = out[:, 0]
        # the direction of the wrist, seen from the base, turns by less than half a turn along a straight line
        x, y = (wrist + samples[:, None] * self.direction).T
        turned = np.arctan2(wrist[0] * y - wrist[1] * x, wrist[0] * x + wrist[1] * y)
        turns = np.round((math.atan2(wrist[1], wrist[0]) + turned - np.arctan2(y, x)) / (2.0 * np.pi))
        q[:, 0] += 2.0 * np.pi * (turns + np.round((self.near[0] - q[-1, 0]) / (2.0 * np.pi)))
        q[:, 1] += 2.0 * np.pi * np.round((self.near[1] - q[-1, 1]) / (2.0 * np.pi))
        if n == 3:
            q[:, 2] = float(np.sum(self.near)) - q[:, 0] - q[:, 1]
        return out[:-1]


@njit(cache=True, nogil=True, error_model="numpy")
def _hand_line(lengths: Array, wrist: Array, direction: Array, elbow: int, n: int, r: Array) -> Array:
    """Angles (not unwrapped; the third one left open) and their first three derivatives, ``(samples, 4, n)``.

    With absolute link angles ``phi`` and unit vectors ``e``, ``l1 e1 + l2 e2`` is the wrist. Each derivative of this by
    ``r`` has the form ``i (l1 phi1^(k) e1 + l2 phi2^(k) e2) = w``, and its parts along ``e2`` and ``e1`` are
    ``l1 phi1^(k) sin q2`` and ``-l2 phi2^(k) sin q2``. With a straight elbow they are not finite.
    """
    l1, l2 = lengths[0], lengths[1]
    out = np.empty((r.shape[0], 4, n))
    for m in range(r.shape[0]):
        x, y = wrist[0] + r[m] * direction[0], wrist[1] + r[m] * direction[1]
        cosine = min(1.0, max(-1.0, (x * x + y * y - l1 * l1 - l2 * l2) / (2.0 * l1 * l2)))
        sine = elbow * np.sqrt(1.0 - cosine * cosine)
        q1 = np.arctan2(y, x) - np.arctan2(l2 * sine, l1 + l2 * cosine)
        c1, s1 = np.cos(q1), np.sin(q1)
        c2, s2 = c1 * cosine - s1 * sine, s1 * cosine + c1 * sine  # the second link's absolute direction
        out[m, 0, 0], out[m, 0, 1] = q1, elbow * np.arccos(cosine)
        # derivatives: w of order k from those below, then phi^(k) by projection
        wx, wy = direction[0], direction[1]
        p1 = p2 = 0.0  # first derivatives of phi
        a1 = a2 = 0.0  # second derivatives of phi
        for k in range(1, 4):
            if k == 2:
                wx = l1 * p1 * p1 * c1 + l2 * p2 * p2 * c2
                wy = l1 * p1 * p1 * s1 + l2 * p2 * p2 * s2
            elif k == 3:
                b1, b2 = 3.0 * l1 * p1 * a1, 3.0 * l2 * p2 * a2
                g1, g2 = l1 * p1**3, l2 * p2**3
                wx = b1 * c1 + b2 * c2 - g1 * s1 - g2 * s2
                wy = b1 * s1 + b2 * s2 + g1 * c1 + g2 * c2
            phi1 = (wx * c2 + wy * s2) / (l1 * sine)
            phi2 = -(wx * c1 + wy * s1) / (l2 * sine)
            if k == 1:
                p1, p2 = phi1, phi2
            elif k == 2:
                a1, a2 = phi1, phi2
            out[m, k, 0], out[m, k, 1] = phi1, phi2 - phi1
            if n == 3:
                out[m, k, 2] = -phi2
    return out


class PathTable(NamedTuple):
    """A path sampled on a uniform grid for compiled planners; cubic Hermite between the nodes.

    Attributes:
        start: first ``r``.
        step: distance of the nodes.
        nodes: ``(nodes, 2, 6, n)``: value and derivative by ``r`` of ``f', f'', f''', A, B, G``.
    """

    start: float
    step: float
    nodes: Array

    @property
    def stop(self) -> float:
        """Last ``r``."""
        return self.start + self.step * (len(self.nodes) - 1)


def tabulate(path: Path, arm: Arm, low: float, high: float, nodes: int = 401) -> PathTable:
    """Table of a path and of the torques of ``arm`` on it, over ``[low, high]`` inside the path's span.

    Raises:
        ValueError: if the interval is empty or leaves the span.
    """
    first, last = path.span
    if not first <= low < high <= last:
        raise ValueError(
            f"the interval [{low:.6g}, {high:.6g}] must be inside the path's span [{first:.6g}, {last:.6g}]"
        )
    r = np.linspace(low, high, nodes)
    step = (high - low) / (nodes - 1)
    derivatives = path.derivatives(r)
    coupling, weight = arm.chain_constants
    return PathTable(low, step, _tabulate(coupling, weight, derivatives, step))


@njit(cache=True, nogil=True)
def _tabulate(coupling: Array, weight: Array, derivatives: Array, step: float) -> Array:
    """Nodes of a `PathTable`; slopes of f''', A, B and G by fourth-order differences."""
    count, _, n = derivatives.shape
    nodes = np.empty((count, 2, 6, n))
    still, weightless = np.zeros(n), np.zeros(n)
    # values; A, B and G (eq 12) by inverse dynamics of partial motions
    for m in range(count):
        q, f1, f2, f3 = derivatives[m, 0], derivatives[m, 1], derivatives[m, 2], derivatives[m, 3]
        for i in range(n):
            nodes[m, 0, 0, i], nodes[m, 0, 1, i], nodes[m, 0, 2, i] = f1[i], f2[i], f3[i]
            nodes[m, 1, 0, i], nodes[m, 1, 1, i] = f2[i], f3[i]
        dynamics.inverse_dynamics_single(coupling, weightless, q, still, f1, nodes[m, 0, 3])
        dynamics.inverse_dynamics_single(coupling, weightless, q, f1, f2, nodes[m, 0, 4])
        dynamics.inverse_dynamics_single(coupling, weight, q, still, still, nodes[m, 0, 5])
    # slopes: central differences, one-sided at the ends
    scale = 1.0 / (12.0 * step)
    for m in range(count):
        for kind in range(2, 6):
            for i in range(n):
                if 2 <= m < count - 2:
                    slope = (
                        nodes[m - 2, 0, kind, i]
                        - 8.0 * nodes[m - 1, 0, kind, i]
                        + 8.0 * nodes[m + 1, 0, kind, i]
                        - nodes[m + 2, 0, kind, i]
                    ) * scale
                else:
                    side = 1 if m < 2 else -1
                    slope = (
                        -25.0 * nodes[m, 0, kind, i]
                        + 48.0 * nodes[m + side, 0, kind, i]
                        - 36.0 * nodes[m + 2 * side, 0, kind, i]
                        + 16.0 * nodes[m + 3 * side, 0, kind, i]
                        - 3.0 * nodes[m + 4 * side, 0, kind, i]
                    ) * (side * scale)
                nodes[m, 1, kind, i] = slope
    return nodes


@njit(cache=True, nogil=True)
def look_up(start: float, step: float, nodes: Array, r: float, value: Array, slope: Array) -> None:
    """Values and slopes by ``r`` of the six tabulated quantities, written as ``(6, n)``; constant beyond the ends."""
    count, _, kinds, n = nodes.shape
    position = (r - start) / step
    inside = 0.0 <= position <= count - 1
    position = min(max(position, 0.0), count - 1.0)
    cell = min(int(position), count - 2)
    # Hermite basis of values and slopes in the cell
    s = position - cell
    rest = 1.0 - s
    h00, h01 = (1.0 + 2.0 * s) * rest * rest, s * s * (3.0 - 2.0 * s)
    h10, h11 = s * rest * rest * step, -s * s * rest * step
    g00 = -6.0 * s * rest / step
    g10, g11 = rest * (1.0 - 3.0 * s), s * (3.0 * s - 2.0)
    for kind in range(kinds):
        for i in range(n):
            y0, y1 = nodes[cell, 0, kind, i], nodes[cell + 1, 0, kind, i]
            d0, d1 = nodes[cell, 1, kind, i], nodes[cell + 1, 1, kind, i]
            value[kind, i] = h00 * y0 + h01 * y1 + h10 * d0 + h11 * d1
            slope[kind, i] = g00 * (y0 - y1) + g10 * d0 + g11 * d1 if inside else 0.0
