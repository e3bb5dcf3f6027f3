"""Why there is no plan, in numbers: the `Infeasible` answers of the DPCT planner."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from planners.dpct.constraints import Course
from planners.dpct.search import Aim, find_rendezvous, meets_at
from planners.motion.line import Line, reduce_to_line
from planners.motion.path import HandLine
from planners.motion.rides import KINDS, Window, limit_table, ride_windows
from planners.problem import Infeasible
from planners.typing import Array

BISECTIONS = 10
RELIEF = 1.5
"""How much higher a limit is set to find out whether it is the one that makes the hand late."""


def no_window(line: Line, windows: list[Window], rendezvous_time: float | None) -> Infeasible:
    """The hand cannot ride with the target at any time within the horizon, or not at the time asked for."""
    horizon = line.problem.horizon
    spans = ", ".join(f"{window.opens:.4g} to {window.closes:.4g} s" for window in windows)
    if windows and rendezvous_time is not None and windows[0].opens < horizon:
        return Infeasible(
            "no_window",
            f"the target cannot be ridden at {rendezvous_time:.4g} s, only from {spans}; choose a time inside",
            windows=windows,
        )
    if windows:
        return Infeasible(
            "no_window",
            f"the target can be ridden only from {spans}; the horizon ends at {horizon:.4g} s",
            windows=windows,
        )
    r = line.target_at(np.linspace(0.0, horizon, 201))[0]
    on_line = r[(r >= line.low) & (r <= line.high)]
    if len(on_line) == 0:
        return Infeasible(
            "unreachable",
            f"the target is never on the part of the line that {line.arm.name} reaches within {horizon:.4g} s",
            low=line.low,
            high=line.high,
        )
    if not line.moving:
        return Infeasible(
            "limits", "holding still at the target breaks a limit: its weight is more than the joints can carry"
        )
    return _too_fast(line, on_line)


def _too_fast(line: Line, passed: Array) -> Infeasible:
    """The target is too fast for a joint limit wherever it passes."""
    speed = float(np.abs(line.target_at(np.linspace(0.0, line.problem.horizon, 11))[1]).mean())
    allowed = allowed_speeds(line, np.unique(passed))
    per_place = allowed.min(axis=(1, 2))
    best = int(per_place.argmax())
    kind, joint = np.unravel_index(int(allowed[best].argmin()), allowed[best].shape)
    r = np.linspace(line.low, line.high, 401)
    fit = r[allowed_speeds(line, r).min(axis=(1, 2)) >= speed]
    stretch = (_place(line, fit[0]), _place(line, fit[-1])) if len(fit) else None
    other = _other_elbow_rides(line)
    where = (
        "nowhere on the line within reach"
        if stretch is None
        else f"from ({stretch[0][0]:.3g}, {stretch[0][1]:.3g}) to ({stretch[1][0]:.3g}, {stretch[1][1]:.3g}) m"
    )
    return Infeasible(
        "no_window",
        f"at {speed:.3g} m/s the target breaks the {KINDS[kind]} limit of joint {joint + 1} all along the stretch it "
        f"passes; there it may move at up to {per_place[best]:.3g} m/s. This speed works {where}; the other elbow "
        f"{'could ride with it' if other else 'could not ride with it either'}",
        joint=int(joint),
        kind=KINDS[kind],
        speed=speed,
        largest_speed=float(per_place[best]),
        stretch=stretch,
        other_elbow=other,
    )


def allowed_speeds(line: Line, r: Array) -> Array:
    """Largest constant speed along the line that each limit of each joint allows at ``r``, ``(samples, 4, n)``."""
    torque, velocity, acceleration, jerk = limit_table(line)
    f = line.path.derivatives(r)
    q = np.ascontiguousarray(f[:, 0])
    weight = line.arm.bias(q, np.zeros_like(q))
    bias = line.arm.inverse_dynamics(q, f[:, 1], f[:, 2]) - weight
    with np.errstate(divide="ignore"):
        return np.stack(
            [
                np.sqrt(np.maximum(torque - np.abs(weight), 0.0) / np.abs(bias)),
                velocity / np.abs(f[:, 1]),
                np.sqrt(acceleration / np.abs(f[:, 2])),
                np.cbrt(jerk / np.abs(f[:, 3])),
            ],
            axis=1,
        )


def late(line: Line, course: Course, windows: list[Window]) -> Infeasible:
    """The target can be ridden, but the hand cannot be with it before that ends."""
    window = [window for window in windows if window.opens < line.problem.horizon][-1]
    horizon = line.problem.horizon
    if window.closes > horizon:
        earliest = _earliest_ever(line, course, windows)
        if earliest is not None:
            return Infeasible(
                "late",
                f"the target cannot be met within the horizon of {horizon:.4g} s; it takes at least {earliest:.4g} s",
                earliest=earliest,
            )
    close = window.closes
    lag = _least(lambda shift: meets_at(_behind(course, shift), close) is not None, line.high - line.low)
    lead = _least(lambda shift: _meets_before_closing(line, course, shift), line.high - line.low)
    helping = [
        kind
        for index, kind in enumerate(KINDS)
        if np.isfinite(limit_table(line)[index]).any() and meets_at(_relieved(course, index), close) is not None
    ]
    advice = (
        "no head start of the hand is enough: start it further upstream or slow the target down"
        if lead is None
        else f"the target would have to start {lead:.3g} m further back"
    )
    behind = "it cannot even reach the target's speed" if lag is None else f"it would still be {lag:.3g} m behind"
    relief = f"; a higher {' or '.join(helping)} limit would do" if helping else ""
    return Infeasible(
        "late",
        f"the hand cannot catch up before riding ends at {close:.4g} s, when {behind}; {advice}{relief}",
        closes=close,
        lag=lag,
        lead=lead,
        relieved_by=tuple(helping),
    )


def _earliest_ever(line: Line, course: Course, windows: list[Window]) -> float | None:
    """When the target could be met if the horizon were much longer, s."""
    longer = replace(line, problem=replace(line.problem, horizon=20.0 * line.problem.horizon))
    found = find_rendezvous(longer, course, windows, Aim())
    return None if found is None else found[1].time


def not_at(line: Line, course: Course, windows: list[Window], rendezvous_time: float) -> Infeasible:
    """No motion within the limits meets the target at the time asked for."""
    found = find_rendezvous(line, course, windows, Aim())
    earliest = None if found is None else found[1].time
    answer = "nor at any other time within the horizon" if earliest is None else f"the earliest is {earliest:.4g} s"
    return Infeasible(
        "late", f"no motion within the limits meets the target at {rendezvous_time:.4g} s; {answer}", earliest=earliest
    )


def _least(works: Callable[[float], bool], largest: float) -> float | None:
    """The least shift that works, to a thousandth of the largest, None if the largest does not."""
    low, high = 0.0, math.inf
    for trial in (largest / 64.0, largest / 16.0, largest / 4.0, largest):
        if works(trial):
            high = trial
            break
        low = trial
    if math.isinf(high):
        return None
    for _ in range(BISECTIONS):
        if high - low < 1e-3 * largest:
            break
        middle = 0.5 * (low + high)
        low, high = (low, middle) if works(middle) else (middle, high)
    return high


def _behind(course: Course, shift: float) -> Course:
    """The course with the target further back."""
    return course._replace(target=course.target - np.array([shift, 0.0, 0.0]))


def _relieved(course: Course, kind: int) -> Course:
    """The course with one kind of limit higher."""
    inverse_limits = course.inverse_limits.copy()
    inverse_limits[kind] /= RELIEF
    return course._replace(inverse_limits=inverse_limits)


def _meets_before_closing(line: Line, course: Course, shift: float) -> bool:
    """Whether a target further back can be met before its own window closes: there is most time at the very end."""
    course = _behind(course, shift)
    windows = ride_windows(replace(line, target=course.target))
    return bool(windows) and math.isfinite(windows[-1].closes) and meets_at(course, windows[-1].closes) is not None


def _other_elbow_rides(line: Line) -> bool:
    """Whether the target could be ridden with the elbow on the other side."""
    assert isinstance(line.path, HandLine)  # moving targets are followed by hand
    try:
        other = reduce_to_line(line.problem, "-" if line.path.elbow > 0 else "+")
    except Infeasible:
        return False
    windows = ride_windows(other)
    return bool(windows) and windows[0].opens < line.problem.horizon


def _place(line: Line, r: float) -> tuple[float, float]:
    """Hand position at ``r``, m."""
    x, y = line.problem.arm.forward_kinematics(line.path.derivatives([r])[0, 0])
    return float(x), float(y)
