"""DPCT as published: dynamic programming over the phase plane of the hand's progress along a line.

"Motion Planning of a Robot Manipulator for Conveyor Tracking" (T. H. Park, B. H. Lee, M. S. Ko). The hand is to catch
up with a part that moves at constant speed along the line the hand is on. Equation numbers below are the paper's:

    (7)   X_h = X_h(t_0) + r (X_h(t_f) - X_h(t_0)),  r from 0 to 1;  state x1 = r, x2 = dr/dt
    (10)  dq/dt = f' x2,        (11)  d2q/dt2 = f'' x2^2 + f' dx2/dt,     f' = dq/dr, f'' = d2q/dr2
    (12)  U = M f' dx2/dt + (M f'' + h(q, f')) x2^2
    (17)  the part: x~1 = (V t - D) / L,  x~2 = V / L;   D: how far the hand starts ahead of it, L: length of the line
    (18)  J = integral of (x1 - x~1)^2 + (x2 - x~2)^2
    (23)  grid: x1[0] = x2[0] = 0, x1[N1] = 1, x2[Nt] = x~2; Nt is 80 % of N2, the states above leave room to overshoot
    (26)  a step from (i, j) to (i + 1, l) takes dt = dx1 / x2[j]
    (27)  k(i, j) = k(i + 1, l) - dt with k(N1, Nt) = t_f: every node keeps the clock of its best successor
          (printed as ``t_f - dt - k(i + 1, l)``, which does not run backwards from t_f)
    (28)  a step costs dt ((x1[i] - x~1(k))^2 + (x2[j] - x~2)^2)
    (30)  J*(i, j) = min over l of the step's cost + J*(i + 1, l), over the steps within the limits (3) to (6)

This module reproduces that, faults included, and also executes the result in real time: use it to study the
paper, and :mod:`planners.dpct` to plan. Where the paper leaves a choice, :class:`Reading` names it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from planners.capabilities import Takes, variant
from planners.dpct.phase_plane import Tables, search, tabulate
from planners.motion.line import OFF_LINE, reduce_to_line
from planners.motion.path import Path
from planners.problem import Infeasible, MotionProblem, MovingHand
from planners.trajectory import Trajectory, sampled_trajectory
from planners.typing import Array

_SAMPLES_PER_STEP = 10
MOST_CELLS = 2000
_CLOCK_TOLERANCE = 1e-9  # s: a start this close to t_0 is at t_0


@dataclass(frozen=True)
class Reading:
    """How the points that the paper leaves open are read.

    Attributes:
        name: what tables call it.
        step: duration of a step. ``"euler"`` is eq 26, with the next state's speed where the hand is at rest and eq 26
            divides by zero; ``"exact"`` is ``2 dx1 / (x2[j] + x2[l])``, the time constant acceleration takes.
        price_wait: whether the rest at (0, 0) before the first step counts in J.
        target_fraction: Nt / N2, in (0, 1].
        line: length of the line, m: where r = 1 lies ahead of the start.
        m11_slip: ``(a, b)``, kg m^2: error a + b cos(q2) added to the mass matrix element M11, to test for errors in
        the original program.

    Raises:
        ValueError: if a value is out of its range.
    """

    name: str = "literal"
    step: Literal["euler", "exact"] = "euler"
    price_wait: bool = True
    target_fraction: float = 0.8
    line: float = 0.5
    m11_slip: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        if self.step not in ("euler", "exact"):
            raise ValueError(f"step {self.step!r} is unknown; give 'euler' or 'exact'")
        if not 0.0 < self.target_fraction <= 1.0:
            raise ValueError(f"target_fraction {self.target_fraction} must be in (0, 1]")
        if not (math.isfinite(self.line) and self.line > 0.0):
            raise ValueError(f"line length {self.line} m must be finite and positive")


LITERAL = Reading()
REPAIRED = Reading(name="exact step", step="exact")
MASS_SLIPS = (
    Reading(name="M11 = 5/3 + c2/2", m11_slip=(0.0, -1.0 / 2.0)),
    Reading(name="M11 = 4/3 + c2", m11_slip=(-1.0 / 3.0, 0.0)),
    Reading(name="M11 = (5/3) c2", m11_slip=(-5.0 / 3.0, 2.0 / 3.0)),
)
"""Wrong mass matrices for the paper's arm, whose Table 1 prints the right 5/3 + c2: two that give the published t_a,
and the one with which a(x1) and d(x1) of that table are written out."""


@dataclass(frozen=True)
class PhasePath:
    """What the search finds: one state per stage of the phase plane, on the search's own clock.

    Attributes:
        reading: how the paper was read.
        r: progress x1 at the stages, ``(N1 + 1,)``.
        rate: dr/dt, x2 at the stages, ``(N1 + 1,)``, 1/s.
        clock: the search's own clock at the stages, ``(N1 + 1,)``, s; its first entry is the start time of the motion.
        qd: joint velocities at the stages (eq 10), ``(N1 + 1, n)``, rad/s.
        tau: joint torques by the search's own clock, constant between stages, ``(N1, n)``, N m.
        cost: J* of the start node (eq 30), s.
    """

    reading: Reading
    r: Array
    rate: Array
    clock: Array
    qd: Array
    tau: Array
    cost: float

    @property
    def rendezvous_time(self) -> float:
        """t_a on the search's own clock, s: from here the hand rides with the part to the end of the line."""
        off_target = np.flatnonzero(self.rate != self.rate[-1])
        return float(self.clock[off_target[-1] + 1])

    @property
    def peak_torque(self) -> Array:
        """Torque of largest magnitude of each joint, signed, ``(n,)``, N m."""
        return signed_peak(self.tau)

    @property
    def clock_error(self) -> float:
        """Time by which the search's start precedes t_0, s; 0 if the start is at or after t_0."""
        return max(0.0, -float(self.clock[0]))

    @cached_property
    def real_clock(self) -> Array:
        """When the hand really passes the stages if it is to end with the part at t_f, ``(N1 + 1,)``, s.

        Between two stages the acceleration dx2/dt is constant. A first entry below 0 would have it leave early.
        """
        durations = 2.0 * np.diff(self.r) / (self.rate[:-1] + self.rate[1:])
        remaining: Array = np.append(np.cumsum(durations[::-1])[::-1], 0.0)
        return np.asarray(self.clock[-1] - remaining, dtype=float)

    @property
    def lag(self) -> float:
        """How late the hand really is at the end of the line when it leaves at t_0 at the earliest, s."""
        late = -float(self.real_clock[0])
        return late if late > _CLOCK_TOLERANCE else 0.0

    def sample(self) -> tuple[Array, Array, Array, Array]:
        """Time (from 0), r, dr/dt and d2r/dt2 of the real motion, each ``(samples,)``: the rest, then the steps.

        Two samples where a step ends, before and after the jump of d2r/dt2.
        """
        times = self.real_clock + self.lag
        durations = np.diff(times)
        acceleration = np.diff(self.rate) / durations
        since = np.arange(_SAMPLES_PER_STEP + 1) / _SAMPLES_PER_STEP * durations[:, None]
        rate = self.rate[:-1, None] + since * acceleration[:, None]
        r = self.r[:-1, None] + since * (self.rate[:-1, None] + rate) / 2.0
        steps = np.stack([times[:-1, None] + since, r, rate, np.broadcast_to(acceleration[:, None], r.shape)])
        rest = np.zeros((4, _SAMPLES_PER_STEP + 1 if times[0] > _CLOCK_TOLERANCE else 0))
        rest[0] = np.linspace(0.0, times[0], rest.shape[1])
        t, r, rate, acceleration = np.concatenate([rest, steps.reshape(4, -1)], axis=1)
        return t, r, rate, acceleration


@variant("dpct", "paper", {"moving hand": Takes(links=(2, 3), accelerating=False)}, promises=False)
def plan_paper(problem: MotionProblem, *, grid: tuple[int, int] = (50, 100), reading: Reading = LITERAL) -> Trajectory:
    """Plan as the paper does, and return the motion that results in real time.

    Args:
        problem: an arm of two or three links at rest, and a :class:`MovingHand` target of constant velocity on whose
            line the hand is. Its horizon, obstacles and joint angle limits play no part: the motion ends with the line.
        grid: stages N1 and states N2.
        reading: how open points of the paper are read.

    Returns:
        The phase path executed with constant dx2/dt between stages, so that it ends with the part where it can; see
        :func:`planners.dpct.paper.execute`. Nothing is scaled to fit: its ``limit_ratios`` may be above 1.

    Raises:
        ValueError: if the problem is not of this kind.
        Infeasible: if the line is out of reach, or no path through the grid keeps the limits.
    """
    return execute(problem, search_phase_plane(problem, grid=grid, reading=reading))


def search_phase_plane(
    problem: MotionProblem, *, grid: tuple[int, int] = (50, 100), reading: Reading = LITERAL
) -> PhasePath:
    """The DPCT search itself (sections 4.2 and 4.3); arguments and errors as :func:`plan_paper`."""
    stages, states = grid
    target_state = round(reading.target_fraction * states)
    if not (2 <= stages <= MOST_CELLS and 1 <= target_state <= states <= MOST_CELLS):
        raise ValueError(f"grid {grid} must be of 2 to {MOST_CELLS} stages and as many states")
    line = _BeltLine.of(problem, reading.line)
    if line.end_time <= 0.0:
        raise Infeasible("late", f"the part passed the end of the {reading.line:.4g} m line {-line.end_time:.3g} s ago")
    tables = tabulate(problem.loaded_arm, reading.m11_slip, *line.joints(np.linspace(0.0, 1.0, stages + 1)))
    rates = np.asarray(line.rate / target_state * np.arange(states + 1), dtype=float)  # eq 24
    limits = problem.joint_limits
    bounds = np.array([limits.torque, limits.velocity, limits.acceleration, limits.jerk])
    exact = reading.step == "exact"
    cost, clock, following = search(
        tables, bounds, rates, target_state, line.offset, line.end_time, exact, reading.price_wait
    )
    if not math.isfinite(cost[0, 0]):
        raise Infeasible(
            "limits",
            f"no path through the {stages} x {states} phase plane keeps the limits; try a finer grid or wider limits",
            grid=grid,
        )
    return _trace(reading, tables, rates, cost, clock, following)


def _trace(reading: Reading, tables: Tables, rates: Array, cost: Array, clock: Array, following: Array) -> PhasePath:
    """The path from (0, 0) along the best next states."""
    stages = len(cost) - 1
    state = np.zeros(stages + 1, dtype=int)
    for i in range(stages):
        state[i + 1] = following[i, state[i]]
    rate, times = rates[state], clock[np.arange(stages + 1), state]
    rate_change = np.diff(rate) / np.diff(times)  # eq 20
    driving = tables.inertia[:-1] * rate_change[:, None] + tables.centripetal[:-1] * rate[:-1, None] ** 2
    return PhasePath(
        reading=reading,
        r=np.linspace(0.0, 1.0, stages + 1),
        rate=rate,
        clock=times,
        qd=tables.slope * rate[:, None],
        tau=driving + tables.static[:-1],
        cost=float(cost[0, 0]),
    )


def execute(problem: MotionProblem, path: PhasePath) -> Trajectory:
    """The phase path as a real motion, with torques by the arm's inverse dynamics.

    The hand rests until it has to leave to be with the part at the end of the line, and leaves at time 0 at the
    earliest; when that is too late it stays behind the part by ``path.lag`` and never meets it (``rendezvous_time`` is
    inf). The acceleration jumps at every stage, so no limit of jerk is kept. ``cost`` is J (eq 18) of this motion,
    from 0 to its end.
    """
    line = _BeltLine.of(problem, path.reading.line)
    t, r, rate, rate_change = path.sample()
    q, slope, curvature = line.joints(r)
    qd = slope * rate[:, None]  # eq 10
    qdd = curvature * rate[:, None] ** 2 + slope * rate_change[:, None]  # eq 11
    error = (r - line.offset - line.rate * t) ** 2 + (rate - line.rate) ** 2
    stages = len(path.r) - 1
    return sampled_trajectory(
        problem,
        t,
        q,
        qd,
        qdd,
        cost=float(np.trapezoid(error, t)),
        rendezvous_time=path.rendezvous_time if path.lag == 0.0 else math.inf,
        planner=f"DPCT, paper ({path.reading.name}, {stages} stages)",
        rides_until=float(t[-1]),
    )


def signed_peak(tau: Array) -> Array:
    """Torque of largest magnitude of each joint, signed, ``(n,)``, for ``tau`` of ``(samples, n)``."""
    return np.asarray(tau[np.argmax(np.abs(tau), axis=0), np.arange(tau.shape[1])], dtype=float)


@dataclass(frozen=True)
class _BeltLine:
    """The line the hand is on, ``r`` from 0 at its start to 1 at its end, and the part on it (eq 17): the joint
    angles by metres along the line, its length (m), ``r`` of the part at time 0, and dr/dt of the part (1/s).
    """

    path: Path
    length: float
    offset: float
    rate: float

    @classmethod
    def of(cls, problem: MotionProblem, length: float) -> _BeltLine:
        """The line of a problem, after checking that it is one the paper treats."""
        target = problem.target
        if not isinstance(target, MovingHand) or target.acceleration.any():
            raise ValueError(f"the paper's DPCT follows a MovingHand target of constant velocity; got {target}")
        if not target.velocity.any():
            raise Infeasible(
                "unreachable", f"the paper's DPCT follows a target of constant velocity, not 0; got {target}"
            )
        line = reduce_to_line(problem)
        if abs(line.start[1]) > OFF_LINE:
            speed = float(line.start[1])
            raise Infeasible(
                "start", f"the paper's DPCT starts from rest; the hand moves at {speed:.4g} m/s", speed=speed
            )
        if line.path.span[1] < length:
            raise Infeasible(
                "unreachable",
                f"the line of {length:.4g} m leaves the workspace {line.path.span[1]:.4g} m ahead of the hand; "
                "shorten it, or start elsewhere",
            )
        return cls(line.path, length, offset=line.target[0] / length, rate=line.target[1] / length)

    @property
    def end_time(self) -> float:
        """t_f: when the part is at the end of the line, s."""
        return (1.0 - self.offset) / self.rate

    def joints(self, r: Array) -> tuple[Array, Array, Array]:
        """Joint angles f (eq 9), f' and f'' at ``r``, each ``(samples, n)``."""
        derivatives = self.path.derivatives(self.length * r)
        return derivatives[:, 0], self.length * derivatives[:, 1], self.length**2 * derivatives[:, 2]
