"""The joint motion that keeps the hand exactly with a moving target, and its table for the compiled solver."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from planners.goals import nearest_turns
from planners.motion.line_motion import KINDS
from planners.motion.path import SINGULAR_SINE
from planners.problem import Infeasible, MotionProblem, MovingHand, limit_broken
from planners.typing import Array

STEP, MOST_NODES = 0.005, 4000
"""Time between two nodes of the table, s, unless that makes more than so many."""

RIDE_LOAD = 1.0 - 2e-5
"""Largest |value| / limit at which the target counts as rideable: below 1, for the peaks between two nodes."""

FADING, AT_ONCE = 0.05, 1e-9
"""Time constants of a jerk before its window, s."""


class Window(NamedTuple):
    """Nodes of the table, first and last, between which the hand can ride with the target within every limit."""

    first: int
    last: int


@dataclass(frozen=True)
class Ride:
    """How the joints move while the hand is with the target of a problem.

    Attributes:
        problem: with a moving target, for two or three links.
        elbow: 1 or -1, the sign of the elbow angle.
        orientation: absolute angle of the third link, rad; ignored for two links.
    """

    problem: MotionProblem
    elbow: float
    orientation: float

    @cached_property
    def times(self) -> Array:
        """Nodes of the table, from 0 to the horizon, or to when the target leaves the reach for good, s."""
        end = min(self.problem.horizon, _leaving_time(self.problem))
        return np.linspace(0.0, end, min(MOST_NODES, max(8, math.ceil(end / STEP))) + 1)

    def at(self, t: Array) -> Array:
        """Angles and their first three derivatives by time, ``(samples, 4, n)``; NaN where the target is out of reach.

        The angles are within half a turn of 0. The target moves with constant acceleration, so ``l1 e1 + l2 e2 = X``
        with unit vectors ``e`` of the absolute angles gives each derivative by projection; see `HandLine.derivatives`.
        """
        arm, target = self.problem.arm, self.problem.target
        assert isinstance(target, MovingHand)
        n, l1, l2 = arm.n_joints, arm.lengths[0], arm.lengths[1]
        place, velocity = target.at(t)
        x, y = (place - arm.base_array).T
        if n == 3:
            x, y = x - arm.lengths[2] * math.cos(self.orientation), y - arm.lengths[2] * math.sin(self.orientation)
        cosine = (x * x + y * y - l1 * l1 - l2 * l2) / (2.0 * l1 * l2)
        cosine = np.where(np.abs(cosine) < math.sqrt(1.0 - SINGULAR_SINE**2), cosine, np.nan)
        sine = self.elbow * np.sqrt(1.0 - cosine * cosine)
        first = np.arctan2(y, x) - np.arctan2(l2 * sine, l1 + l2 * cosine)
        second = first + self.elbow * np.arccos(cosine)
        e1, e2 = np.exp(1j * first), np.exp(1j * second)

        def rates(w: Array) -> tuple[Array, Array]:
            return (w * e2.conj()).real / (l1 * sine), -(w * e1.conj()).real / (l2 * sine)

        p1, p2 = rates(velocity[:, 0] + 1j * velocity[:, 1])
        a1, a2 = rates(complex(*target.acceleration) + l1 * p1 * p1 * e1 + l2 * p2 * p2 * e2)
        b1, b2 = rates(l1 * e1 * (3.0 * p1 * a1 + 1j * p1**3) + l2 * e2 * (3.0 * p2 * a2 + 1j * p2**3))
        out = np.empty((len(t), 4, n))
        for k, (one, two) in enumerate(((first, second), (p1, p2), (a1, a2), (b1, b2))):
            out[:, k, 0], out[:, k, 1] = one, two - one
            if n == 3:
                out[:, k, 2] = (self.orientation if k == 0 else 0.0) - two
        return out

    @cached_property
    def table(self) -> Array:
        """`at` the nodes, ``(nodes, 4, n)``, with angles continuous wherever the target is within reach."""
        nodes = self.at(self.times)
        reached = np.isfinite(nodes[:, 0, 0])
        nodes[reached, 0] = np.unwrap(nodes[reached, 0], axis=0)
        return nodes

    def windows(self) -> list[Window]:
        """Intervals of nodes in which riding keeps every limit, in order.

        Raises:
            Infeasible: ``unreachable`` if the target is nowhere within reach, ``no_window`` if limits forbid riding.
        """
        load = self.load()
        usable = np.concatenate([[False], load.max(axis=(1, 2)) <= RIDE_LOAD, [False]])
        edges = np.flatnonzero(usable[1:] != usable[:-1])
        found = [Window(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a > 1]
        if found:
            return found
        best = load[load.max(axis=(1, 2)).argmin()]
        if np.isinf(best).any():
            name, horizon = self.problem.arm.name, self.problem.horizon
            raise Infeasible("unreachable", f"within {horizon:.4g} s the target never is in the reach of {name}")
        raise limit_broken("no_window", "follows the target only at", best, (*KINDS, "angle"))

    def load(self) -> Array:
        """|value| / limit of torque, velocity, acceleration, jerk and angle at the nodes, ``(nodes, 5, n)``.

        Infinite out of reach; angles in the whole turns that fit their ranges.
        """
        limits, arm = self.problem.joint_limits, self.problem.loaded_arm
        reached = np.isfinite(self.table[:, 0, 0])
        load = np.full((len(self.table), 5, arm.n_joints), np.inf)
        if reached.any():
            q, *rates = np.moveaxis(self.table[reached], 1, 0)
            turned = nearest_turns(q, self.problem.q, limits)
            tau = arm.inverse_dynamics(*(np.ascontiguousarray(one) for one in (q, *rates[:2])))
            values = np.stack([tau, *rates], axis=1) / np.array([limits.array(kind) for kind in KINDS])
            load[reached, :4] = np.abs(values)
            load[reached, 4] = np.where(np.isfinite(turned), 0.0, np.inf)
        return load

    def reference(self, window: Window) -> Reference:
        """The motion in a window, continued to time 0 where the window opens later."""
        nodes = self.table.copy()
        first = nodes[window.first, 0]
        nodes[:, 0] += nearest_turns(first, self.problem.q, self.problem.joint_limits) - first
        opens = self.times[window.first]
        nodes[: window.first] = _before(nodes[window.first], self.times[: window.first] - opens, self.fading)
        nodes[window.last + 1 :] = nodes[window.last]
        return Reference(self, window, nodes)

    @property
    def fading(self) -> float:
        """Time constant with which the jerk fades before a window, s: none where jerk is not limited."""
        return FADING if np.isfinite(self.problem.joint_limits.array("jerk")).all() else AT_ONCE


@dataclass(frozen=True)
class Reference:
    """The table of a `Ride` in a window, ``(nodes, 4, n)``: continued before it to time 0."""

    ride: Ride
    window: Window
    nodes: Array

    @property
    def step(self) -> float:
        """Time between two nodes, s."""
        return float(self.ride.times[1])

    def at(self, t: Array) -> Array:
        """Angles and their first three derivatives, exactly, ``(samples, 4, n)``."""
        near: Array = self.nodes[np.minimum(np.rint(t / self.step).astype(int), len(self.nodes) - 1)]
        opens = self.ride.times[self.window.first]
        inside = t >= opens
        out = np.empty_like(near)
        out[inside] = self.ride.at(t[inside])
        out[inside, 0] += 2.0 * np.pi * np.round((near[inside, 0] - out[inside, 0]) / (2.0 * np.pi))
        out[~inside] = _before(self.nodes[self.window.first], t[~inside] - opens, self.ride.fading)
        return out

    def jacobians(self) -> Array:
        """Of the hand at the nodes, and their rates of change: ``(nodes, 2, 2, n)``."""
        arm = self.ride.problem.arm
        angle, rate = np.cumsum(self.nodes[:, 0], axis=1), np.cumsum(self.nodes[:, 1], axis=1)
        pull = -arm.length_array * rate * np.stack([np.cos(angle), np.sin(angle)])
        change = np.cumsum(pull[..., ::-1], axis=2)[..., ::-1]
        jacobian = arm.jacobian(np.ascontiguousarray(self.nodes[:, 0]))
        both: Array = np.stack([jacobian, np.moveaxis(change, 0, 1)], axis=1)
        return both


def _leaving_time(problem: MotionProblem) -> float:
    """The last time at which the target crosses the rim of the arm's reach, s; inf if it never does after time 0."""
    target, arm = problem.target, problem.arm
    assert isinstance(target, MovingHand)
    squares = np.zeros(5)
    for place in zip(0.5 * target.acceleration, target.velocity, target.position - arm.base_array, strict=True):
        squares += np.convolve(place, place)
    squares[-1] -= arm.reach**2
    roots = np.roots(np.trim_zeros(squares, "f"))
    times = roots.real[np.abs(roots.imag) < 1e-9 * (1.0 + np.abs(roots))]
    return float(times.max()) if len(times) and times.max() > 0.0 else math.inf


def _before(node: Array, dt: Array, fading: float) -> Array:
    """The motion at times ``dt`` (negative, s) from a node, ``(samples, 4, n)``.

    Its jerk fades with the time constant ``fading``, s, to constant acceleration.
    """
    s, e = dt[:, None], np.exp(dt / fading)[:, None]
    q, qd, qdd, jerk = node
    rest = qdd - fading * jerk
    places = q + s * (qd + 0.5 * s * rest) + fading**2 * jerk * (fading * (e - 1.0) - s)
    return np.stack([places, qd + s * rest + fading**2 * jerk * (e - 1.0), rest + fading * jerk * e, jerk * e], axis=1)
