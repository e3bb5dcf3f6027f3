"""The speed profile of least torque that takes exactly the time given: a dynamic program in the phase plane, refined.

The duration is a constraint with a Lagrange multiplier ``rate``: the program minimises index + rate x duration, and
the rate is found at which the duration is met. On a grid the duration jumps with the rate, past the one wanted. The
two profiles on either side are then mixed in ``x = v^2``: torque and joint acceleration are linear in x and its
derivative, so a mixture of two profiles within the limits is within them too, at every r, and one mixture takes
exactly the time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from planners.dpct.torque.speed_profile import Track, best_states, price_steps, profile_index
from planners.typing import Array

STATES = 32
"""Speeds at a stage in the first search: the slowest, and a geometric series from far below the mean to the fastest."""

LEAST_SPEED = 0.03
"""First of the series, as a fraction of the mean speed of the motion (of the fastest speed where that is less)."""

WINDOW_STATES = 13
FIRST_WINDOW, LAST_WINDOW, SHRINKING = 0.3, 2e-4, 0.7
"""Around a profile that is refined: speeds at a stage, largest change of a speed in the first and in the last round (as
a fraction of it), and how much less it becomes from round to round."""

LEAST_WINDOW = 0.1
"""Speed, as a fraction of the mean, below which the change is no longer a fraction of the speed."""

SHORTEST_REST = 1e-3
"""As a fraction of the horizon; a shorter one is left to the speeds, and samples in it would be too close together."""

EXPANSIONS, HULL_STEPS = 15, 40
"""Most rates that are tried to get to the other side of the horizon, and to close in on it from both."""


class Profile(NamedTuple):
    """Speeds at the stages, ``(N + 1,)``, and how long (s) to rest at which stage."""

    speeds: Array
    rest: float = 0.0
    rest_stage: int = 0


@dataclass(frozen=True)
class Corridor:
    """The feasible speeds along a path, and the required duration and index.

    Attributes:
        track: the path and its limits.
        slowest, fastest: least and largest speeds at the stages, ``(N + 1,)``.
        horizon: time the motion is to take, s.
        squared: whether torque counts squared.
    """

    track: Track
    slowest: Array
    fastest: Array
    horizon: float
    squared: bool

    def duration(self, speeds: Array) -> float:
        """How long a profile takes without its rest, s; inf if it stays somewhere for good."""
        sums = speeds[:-1] + speeds[1:]
        return float(np.sum(2.0 * self.track.widths / sums)) if (sums > 0.0).all() else np.inf

    def index(self, profile: Profile) -> float:
        """Torque index of a profile with its rest."""
        moving = profile_index(self.track, profile.speeds, self.squared)
        resting = profile.rest * float(self.rest_rates[profile.rest_stage]) if profile.rest > 0.0 else 0.0
        return moving + resting

    @property
    def rest_rates(self) -> Array:
        """Torque index of a second's rest at each stage, ``(N + 1,)``; inf where the motion cannot stop."""
        static = np.abs(self.track.static[::2])
        rates: Array = np.sum(static**2 if self.squared else static, axis=1)
        return np.where((self.slowest > 0.0) | (static > self.track.limits[0]).any(axis=1), np.inf, rates)


class _Steps(NamedTuple):
    """The grid ``(N + 1, states)`` of speeds, and what its steps cost and take."""

    speeds: Array
    effort: Array
    duration: Array

    @classmethod
    def between(cls, corridor: Corridor, speeds: Array) -> _Steps:
        return cls(speeds, *price_steps(corridor.track, speeds, corridor.squared))

    def best(self, rate: float, gate: int = -1) -> _GridPath:
        states, effort, duration = best_states(self.effort, self.duration, rate, gate)
        return _GridPath(self.speeds[np.arange(len(states)), states], effort, duration)


class _GridPath(NamedTuple):
    """A profile through a grid."""

    speeds: Array
    effort: float
    duration: float


def least_torque(corridor: Corridor) -> Profile:
    """The best profile found that takes exactly the horizon, which must not be less than the fastest one takes."""
    steps = _Steps.between(corridor, _first_grid(corridor))
    found = (_without_rest(corridor, steps), _with_rest(corridor, steps))
    profiles = [profile for profile in found if profile is not None]
    if not profiles:  # the grid is too coarse for the narrow feasible set
        spare = corridor.horizon - corridor.duration(corridor.slowest)
        at_goal = Profile(corridor.slowest, spare, len(corridor.slowest) - 1)
        profiles = [at_goal if spare > 0.0 else mix(corridor, corridor.fastest, corridor.slowest)]
    return min((_refine(corridor, profile) for profile in profiles), key=corridor.index)


def _first_grid(corridor: Corridor) -> Array:
    """Speeds for the first search, ``(N + 1, STATES)``."""
    slowest, fastest = corridor.slowest[:, None], corridor.fastest[:, None]
    least = np.maximum(slowest, LEAST_SPEED * np.minimum(fastest, 1.0 / corridor.horizon))
    series = np.linspace(0.0, 1.0, STATES - 1)
    grid: Array = np.hstack([slowest, least ** (1.0 - series) * fastest**series])
    return grid


def _window(corridor: Corridor, profile: Profile, share: float) -> Array:
    """Speeds around a profile, itself among them, ``(N + 1, WINDOW_STATES)``."""
    least = LEAST_WINDOW / (corridor.horizon - profile.rest)
    speeds = profile.speeds[:, None]
    reach = share * np.maximum(speeds, least)
    below = np.minimum(reach, speeds - corridor.slowest[:, None])
    above = np.minimum(reach, corridor.fastest[:, None] - speeds)
    steps = np.linspace(0.0, 1.0, WINDOW_STATES // 2 + 1)
    grid: Array = np.hstack([speeds - below * steps[:0:-1], speeds + above * steps])
    return grid


def _refine(corridor: Corridor, profile: Profile) -> Profile:
    """Search again and again in ever closer surroundings of the best profile."""
    share, best = FIRST_WINDOW, corridor.index(profile)
    while share > LAST_WINDOW:
        steps = _Steps.between(corridor, _window(corridor, profile, share))
        candidate = _with_rest(corridor, steps) if profile.rest > 0.0 else _without_rest(corridor, steps)
        if candidate is not None and (index := corridor.index(candidate)) < best:
            profile, best = candidate, index
        share *= SHRINKING
    return profile


def _with_rest(corridor: Corridor, steps: _Steps) -> Profile | None:
    """Rest where that costs least for the time left over; None if there is none left, or no stop.

    The time multiplier is then the torque index per second of rest, and the duration of the moving part is free.
    """
    rates = corridor.rest_rates
    stage = int(rates.argmin())
    if not np.isfinite(rates[stage]):
        return None
    path = steps.best(-float(rates[stage]), stage)
    rest = corridor.horizon - path.duration
    return Profile(path.speeds, rest, stage) if rest >= SHORTEST_REST * corridor.horizon else None


def _without_rest(corridor: Corridor, steps: _Steps) -> Profile | None:
    """The best motion through a grid that takes the whole horizon; None if the grid has none so slow."""
    fast, slow = _bracket(steps, corridor.horizon)
    if slow is None:
        return None
    return mix(corridor, corridor.fastest if fast is None else fast.speeds, slow.speeds)


def _bracket(steps: _Steps, horizon: float) -> tuple[_GridPath | None, _GridPath | None]:
    """Neighbours on the lower convex hull of all (duration, index), not slower and slower than the horizon."""
    rate = 0.0
    path = steps.best(rate)
    if not np.isfinite(path.effort):
        return None, None
    sides: list[_GridPath | None] = [None, None]
    slower = int(path.duration > horizon)
    sides[slower] = path
    change = path.effort / path.duration + 1e-12
    for _ in range(EXPANSIONS):
        rate += change if slower else -change
        change *= 3.0
        path = steps.best(rate)
        side = int(path.duration > horizon)
        sides[side] = path
        if side != slower:
            break
    fast, slow = sides
    if fast is None or slow is None:
        return fast, slow
    for _ in range(HULL_STEPS):
        rate = (fast.effort - slow.effort) / (slow.duration - fast.duration)
        path = steps.best(rate)
        if path.effort + rate * path.duration >= fast.effort + rate * fast.duration - 1e-12 * abs(fast.effort):
            break
        if path.duration > horizon:
            slow = path
        else:
            fast = path
    return fast, slow


def mix(corridor: Corridor, fast: Array, slow: Array) -> Profile:
    """The mixture of two profiles in x that takes the horizon."""

    def mixed(share: float) -> Array:
        speeds: Array = np.sqrt((1.0 - share) * fast**2 + share * slow**2)
        return speeds

    def excess(share: float) -> float:
        return corridor.duration(mixed(share)) - corridor.horizon

    for end, speeds in ((0.0, fast), (1.0, slow)):
        if (excess(end) < 0.0) == (end == 1.0):  # no change of sign between the two but for rounding
            return Profile(speeds)
    from scipy.optimize import brentq  # slow to import

    return Profile(mixed(float(brentq(excess, 0.0, 1.0, xtol=1e-15))))
