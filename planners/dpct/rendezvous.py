"""The search for the rendezvous time: weights and first guesses of the compiled solver, and bisection if it fails."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from planners.dpct.constraints import Tracking, roll_out
from planners.dpct.interior_point import Solution, guess_time, quintic_index, solve
from planners.motion.line import Line
from planners.motion.line_motion import Motion, joint_motion, limit_table
from planners.motion.path import tabulate
from planners.motion.rides import Window
from planners.typing import Array

SHORT_ENDS = (0.1, 0.5)
"""Lengths of the outermost stages against the inner ones: where the jerk is free the acceleration jumps at the ends,
and a jump costs half a stage."""

SHORTEST = 0.01
"""Least rendezvous time looked for, s, where the hand does not ride with the target from the start: below this,
times are within interpolation error."""

SECOND = 1e-2
"""Weight of the tracking index against the rendezvous time where the time comes first."""

DENSE_STEP, MOST_PARTS = 0.002, 400
"""Sampling step before the rendezvous, s, unless a stage has more than so many."""

BOLD, CAREFUL = 0.3, 0.1
"""Largest change of T in one step of the first and of the second attempt, as a fraction of it."""

WIDE, EARLY = 1000.0, 0.05
"""Range of rendezvous times, s, above which the search begins with its early part, and the share of the range up to
which a first guess leads there: guesses are spread over the whole range.
"""

PROBES = 13
"""Given rendezvous times that are tried where a free one fails."""


@dataclass(frozen=True)
class Aim:
    """What to minimise.

    Attributes:
        rendezvous_time: a given one, s; free when None.
        time_weight: of the rendezvous time against the tracking index, 1/s; the time first when None.
    """

    rendezvous_time: float | None = None
    time_weight: float | None = None


def tracking_problem(line: Line, durations: Array, free_acceleration: bool, allow_reverse: bool) -> Tracking:
    """The line's problem for the compiled solver, with stages of the given ``durations``, in any unit, ``(N,)``.

    ``allow_reverse`` lets the hand move against the line; it always may where its start or the target does.
    """
    horizon = line.problem.horizon
    where, speeds, _ = line.target_at(np.linspace(0.0, horizon, 17))
    places = np.append(where, 0.0)
    spread = float(np.ptp(places))
    margin = 0.5 * spread + 0.1 * (line.arm.reach if line.moving else line.unit)
    low, high = max(line.low, float(places.min()) - margin), min(line.high, float(places.max()) + margin)
    table = tabulate(line.path, line.arm, low, high)
    forced_back = line.start[1] < -1e-6 or (line.start[2] < -1e-6 and not free_acceleration) or speeds.min() < 0.0
    return Tracking(
        target=line.target,
        start=line.start,
        free_acceleration=free_acceleration,
        table_start=table.start,
        table_step=table.step,
        table=table.nodes,
        inverse_limits=1.0 / limit_table(line),
        low=low,
        high=high,
        slowest=-math.inf if allow_reverse or forced_back else 0.0,
        speed=spread / horizon or 1.0,
        durations=durations / durations.sum(),
        error_bounds=np.full((len(durations), 2), math.inf),
    )


def graded_stages(stages: int) -> Array:
    """Durations of stages that are short at both ends, ``(stages,)``."""
    durations = np.ones(stages)
    durations[: len(SHORT_ENDS)] = SHORT_ENDS
    durations[-len(SHORT_ENDS) :] = SHORT_ENDS[::-1]
    return durations


def find_rendezvous(
    line: Line, tracking: Tracking, windows: list[Window], aim: Aim, guess: float | None = None
) -> tuple[Window, Solution] | None:
    """The best rendezvous in the first window that has one before the horizon; None if none has."""
    for window in windows:
        low, high = max(window.opens, SHORTEST), min(window.closes, line.problem.horizon)
        if aim.rendezvous_time is not None:
            low = high = aim.rendezvous_time
        if low <= high:
            solution = _early(line, tracking, low, high, aim) or _optimum(line, tracking, low, high, aim, guess)
            if solution is not None:
                return window, solution
    return None


def _early(line: Line, tracking: Tracking, low: float, high: float, aim: Aim) -> Solution | None:
    """The optimum in the part of a very wide range before a quintic that meets the target; None in other ranges."""
    end = high
    while end - low > WIDE and (first := guess_time(tracking, low, end)) - low < EARLY * (end - low):
        tracking = tracking._replace(speed=tracking.speed * (end / first))  # a scale that is right for the part
        end = first
    return _optimum(line, tracking, low, end, aim, None) if end < high else None


def meets_at(tracking: Tracking, time: float) -> Solution | None:
    """The motion of least tracking index to a rendezvous at a given time, s; None if there is none."""
    solution = Solution(*solve(tracking, time, time, time, 0.0, 1.0 / _quintic_index(tracking, time), 1.0))
    return solution if solution.converged else None


def _optimum(line: Line, tracking: Tracking, low: float, high: float, aim: Aim, guess: float | None) -> Solution | None:
    """The optimum over ``[low, high]``; with more care where the first attempt fails."""
    if low == high:
        return meets_at(tracking, low)
    if guess is None:  # start from a late (feasible) time: the solver converges poorly from an infeasible one
        first = guess_time(tracking, low, high)
        guess = min(1.5 * first, 0.5 * (first + high))
    for time, largest_change in ((guess, BOLD), (0.5 * (low + high), CAREFUL)):
        weights = _weights(line, aim, time, _quintic_index(tracking, time))
        solution = Solution(*solve(tracking, time, low, high, *weights, largest_change))
        # a solution at the upper bound is suspect: the steps in T may have stalled before the optimum
        doubtful = aim.time_weight is None and solution.time > 0.999 * high
        if solution.converged and not doubtful:
            return solution
    return _bisect(tracking, low, high)


def _weights(line: Line, aim: Aim, time: float, index: float) -> tuple[float, float]:
    """Weights of T and J that make what is minimised about 1 at a first guess with these two."""
    if aim.time_weight is None:
        return 1.0 / time, SECOND / index
    scale = aim.time_weight * time + index / line.unit**2
    return aim.time_weight / scale, 1.0 / (line.unit**2 * scale)


def _quintic_index(tracking: Tracking, time: float) -> float:
    """The tracking index of a quintic that meets the target at a time; 1 where it is 0."""
    return quintic_index(tracking, time) or 1.0


def _bisect(tracking: Tracking, low: float, high: float) -> Solution | None:
    """The earliest rendezvous among given times: probes of the interval, then halves of what is left."""
    best = None
    for time in low + (high - low) * np.linspace(0.0, 1.0, PROBES) ** 2:
        best = meets_at(tracking, float(time))
        if best is not None:
            break
        low = float(time)
    while best is not None and best.time - low > 1e-4 * best.time:
        middle = 0.5 * (low + best.time)
        earlier = meets_at(tracking, middle)
        low, best = (middle, best) if earlier is None else (low, earlier)
    return best


def sample_manoeuvre(line: Line, tracking: Tracking, solution: Solution) -> Motion:
    """Dense samples of a solution's stages of constant jerk: the motion up to the rendezvous."""
    durations = tracking.durations * solution.time
    parts = np.clip(np.ceil(durations / DENSE_STEP), 2, MOST_PARTS).astype(int)
    stage = np.repeat(np.arange(len(durations)), parts + 1)
    part = np.arange(len(stage)) - (np.cumsum(parts + 1) - (parts + 1))[stage]
    s = durations[stage] * (part / parts[stage])
    control = _met_exactly(tracking, solution)
    z = roll_out(tracking, solution.time, solution.acceleration, control)
    e, ed, edd = (z[stage, i] / solution.time**i for i in range(3))
    j = control[stage] / solution.time**3
    t = np.minimum((np.cumsum(durations) - durations)[stage] + s, solution.time)
    t[-1] = solution.time
    r, v, a = line.target_at(t)
    r += e + s * (ed + s * (edd / 2.0 + s * j / 6.0))
    v += ed + s * (edd + s * j / 2.0)
    a += edd + s * j
    return Motion(t, *joint_motion(line, r, v, a, j))


def _met_exactly(tracking: Tracking, solution: Solution) -> Array:
    """Scaled controls ``(N,)`` of a solution, with the least change that leaves no rest of the error at the end."""
    h, control = tracking.durations, solution.jerk * solution.time**3
    after = 1.0 - np.cumsum(h)
    before = after + h
    effect = np.stack([(before**3 - after**3) / 6.0, (before**2 - after**2) / 2.0, h])
    rest = roll_out(tracking, solution.time, solution.acceleration, control)[-1]
    exact: Array = control - np.linalg.lstsq(effect, rest, rcond=None)[0]
    return exact
