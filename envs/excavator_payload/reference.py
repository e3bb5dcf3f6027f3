"""The reference motion of ExcavatorPayload: quintics from rest to rest through waypoints, drawn or given.

The machine can follow every segment between two waypoints with the heaviest payload: inverse dynamics along it say so.
A segment that fails is drawn again; when the numbers drawn for an episode are used up, the reference stands still for
the rest of it, so drawing always ends.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numba import njit, types
from numpy.typing import NDArray

from envs.batch.records import Records
from envs.excavator_payload.world import N_JOINTS
from planners.checks import brief
from planners.compiled.calls import Kernel, call, inlined, new_array, private
from planners.excavator.machine import EXCAVATOR
from planners.excavator.motion import WORK_CYCLE
from planners.excavator.plane import JOINTS, planar_dynamics
from planners.typing import Array

LOWEST = np.radians([-10.0, -110.0, -20.0])
HIGHEST = np.radians([55.0, -40.0, 70.0])
"""Where waypoints are drawn: angles of boom, arm and bucket, rad."""

HEAVIEST = 350.0
"""Payload with which every segment must be possible, kg."""

LONGEST_LEG = 10.0
"""Longest time from one waypoint to the next, s: that which an observation holds."""

TORQUE_SHARE, SPEED_SHARE = 0.85, 0.85
"""Of the limits, used by what is drawn."""
LEAST_TIME = 1.2
"""Least duration of a segment between two waypoints, s."""
LONGEST_STRETCH = 1.5
"""Largest drawn duration of a segment over the least one."""

QUINTIC_PEAK = 1.875
"""Peak speed of a quintic from rest to rest over its mean speed."""

LOOKAHEAD = (0.1, 0.2, 0.4)
"""Times ahead at which the reference is observed, s."""

_SAMPLES = 16
_TRIES_PER_SEGMENT = 5

LONGEST_HORIZON = 60.0
"""Longest episode, s."""
MOST_WAYPOINTS = math.ceil((LONGEST_HORIZON + max(LOOKAHEAD)) / LEAST_TIME) + 2

ENV_FIELDS: list[tuple[Any, ...]] = [
    ("waypoints", "f8", (MOST_WAYPOINTS, N_JOINTS)),
    ("due", "i8", (MOST_WAYPOINTS,)),
    ("n_waypoints", "i8"),
]
"""Fields of an environment's record for its reference: waypoints, and the control periods at which they are due."""


def numbers_needed(horizon: float) -> tuple[int, int]:
    """Shape of the random numbers from which a reference of ``horizon`` s is drawn."""
    return _TRIES_PER_SEGMENT * math.ceil(1.0 + horizon / LEAST_TIME), N_JOINTS + 1


def dynamics_constants() -> dict[str, Any]:
    """What the kernels read from the model record: the empty machine for its controller, and the heaviest payload."""
    dynamics = planar_dynamics(EXCAVATOR)
    return {
        "chain_frames": dynamics.frames,
        "chain_gravity": dynamics.gravity,
        "chain_inertia": dynamics.inertia,
        "chain_drives": dynamics.drives,
        "heaviest_inertia": HEAVIEST * EXCAVATOR.payload.gyration_square(HEAVIEST),
        "torque_kernel": 0,
    }


def _torque(model: Any, loaded: int, motion: Array, tau: Array) -> None:
    """Torques of a ``motion`` ``(3, n)``, with the heaviest payload or with none, written to ``tau`` ``(n,)``, N m.

    The equations of Newton and Euler for links in a plane, outwards and inwards.
    """
    lever, force, moment = new_array(N_JOINTS, 2), new_array(N_JOINTS, 2), new_array(N_JOINTS)
    phi = w = spin = 0.0
    ax, ay = 0.0, model.gravity  # of a link's joint; gravity as an upward acceleration of the base
    for i in range(N_JOINTS):
        phi, w, spin = phi + motion[0, i], w + motion[1, i], spin + motion[2, i]
        com_x, com_y, mass = model.body_coms[i, 0], model.body_coms[i, 1], model.body_masses[i]
        along, across = mass * com_x, mass * com_y
        inertia = model.body_inertias[i] + along * com_x + across * com_y  # about the joint
        if loaded and i == N_JOINTS - 1:
            com_x, com_y = model.load_com[0], model.load_com[1]
            mass, along, across = mass + HEAVIEST, along + HEAVIEST * com_x, across + HEAVIEST * com_y
            inertia += model.heaviest_inertia + HEAVIEST * (com_x * com_x + com_y * com_y)
        cos_phi, sin_phi = math.cos(phi), math.sin(phi)
        x, y = along * cos_phi - across * sin_phi, along * sin_phi + across * cos_phi
        force[i, 0] = mass * ax - spin * y - w * w * x
        force[i, 1] = mass * ay + spin * x - w * w * y
        moment[i] = inertia * spin + x * ay - y * ax
        lever[i, 0], lever[i, 1] = model.lengths[i] * cos_phi, model.lengths[i] * sin_phi
        ax -= spin * lever[i, 1] + w * w * lever[i, 0]
        ay += spin * lever[i, 0] - w * w * lever[i, 1]
    turning = pull_x = pull_y = 0.0
    for k in range(N_JOINTS):
        i = N_JOINTS - 1 - k
        turning += moment[i] + lever[i, 0] * pull_y - lever[i, 1] * pull_x
        pull_x, pull_y = pull_x + force[i, 0], pull_y + force[i, 1]
        tau[i] = turning + model.friction[i] * motion[1, i]


_TORQUE = Kernel(_torque)


def write_kernels(model: Records) -> None:
    """Write the address of the machine's inverse dynamics into the model record."""
    model["torque_kernel"] = _TORQUE.address(model.dtype, types.intp, types.float64[:, ::1], types.float64[::1])


class Waypoints(NamedTuple):
    """Joint angles ``(k, 3)``, rad, and the control periods after which each is due, ``(k,)``."""

    angles: Array
    due: NDArray[np.int64]

    def write(self, record: Any) -> None:
        """Write them into an environment's record."""
        count = len(self.due)
        record["waypoints"][:count], record["due"][:count], record["n_waypoints"] = self.angles, self.due, count


def work_cycle(model: Records, horizon: float) -> Waypoints:
    """Boom, arm and bucket of `planners.excavator.motion.WORK_CYCLE`, repeated for ``horizon`` s."""
    rounds = math.ceil((horizon + max(LOOKAHEAD)) / WORK_CYCLE.period)
    angles = np.tile(WORK_CYCLE.postures[:, JOINTS], (rounds, 1))
    times = np.cumsum(np.tile(WORK_CYCLE.durations, rounds))
    due = np.concatenate([[0], np.rint(times / model["control_period"][0])]).astype(np.int64)
    return Waypoints(np.vstack([angles, angles[:1]]), due)


def given_waypoints(model: Records, angles: Array, times: Sequence[float] | None) -> Waypoints:
    """Given waypoints, checked to be feasible with the heaviest payload.

    Args:
        model: the model record.
        angles: joint angles of the waypoints, ``(k, 3)``, rad; the episode starts at the first.
        times: when the others are due, s; None for as early as `SPEED_SHARE` of the speed limits allows.

    Raises:
        ValueError: if a waypoint is out of its range, a time is not a multiple of the control period or not later than
            the one before, or a segment needs more than the limits allow.
    """
    period = float(model["control_period"][0])
    if not 2 <= len(angles) <= MOST_WAYPOINTS:
        raise ValueError(f"{len(angles)} waypoints; give 2 to {MOST_WAYPOINTS}; the episode starts at the first")
    for number, posture in enumerate(angles):
        if not ((posture >= LOWEST - 1e-9) & (posture <= HIGHEST + 1e-9)).all():
            ranges = ", ".join(f"[{low:.4g}, {high:.4g}]" for low, high in zip(LOWEST, HIGHEST, strict=True))
            raise ValueError(f"waypoint {number} {posture.tolist()} rad is outside the ranges {ranges} rad")
    segments = list(pairwise(angles))
    if times is None:
        durations = [math.ceil(least_duration(model[0], *segment) / period - 1e-9) for segment in segments]
    else:
        durations = _whole_durations(times, len(segments), period)
    for number, (segment, steps) in enumerate(zip(segments, durations, strict=True), start=1):
        torque, speed = segment_ratios(model[0], *segment, steps * period)
        if max(torque, speed) > 1.0 + 1e-9:
            raise ValueError(
                f"the segment to waypoint {number} in {steps * period:g} s needs {torque:.2f} of a torque limit with "
                f"{HEAVIEST:g} kg and {speed:.2f} of a speed limit; give it more time"
            )
    return Waypoints(angles, np.concatenate([[0], np.cumsum(durations)]).astype(np.int64))


def _whole_durations(times: Sequence[float], count: int, period: float) -> list[int]:
    """Control periods between one arrival time and the next."""
    if len(times) != count:
        raise ValueError(f"{len(times)} arrival_times for {count + 1} waypoints; give one for each after the first")
    due = np.array(times) / period
    if (np.abs(due - np.rint(due)) > 1e-6).any():
        raise ValueError(f"arrival_times {brief(list(times))} s must be multiples of the control period, {period:g} s")
    durations: list[int] = np.diff(np.rint(due), prepend=0.0).astype(np.int64).tolist()
    if max(durations, default=0) * period > LONGEST_LEG:
        raise ValueError(
            f"arrival_times {brief(list(times))} s: from one to the next, at most {LONGEST_LEG:g} s can be observed"
        )
    if min(durations) < 1:
        raise ValueError(f"arrival_times {brief(list(times))} s must be positive and grow")
    return durations


@njit(cache=True, nogil=True)
def draw_reference(batch: Any, model: Any, index: int, numbers: Array) -> None:
    """Draw the waypoints of one environment from uniform ``numbers``, of `numbers_needed`."""
    env, shared = batch[index], model[0]
    waypoints, due = env.waypoints, env.due
    wanted = shared.horizon_steps + LOOKAHEAD[2] / shared.control_period
    for i in range(N_JOINTS):
        waypoints[0, i] = LOWEST[i] + numbers[0, i] * (HIGHEST[i] - LOWEST[i])
    due[0] = 0
    candidate = new_array(N_JOINTS)
    row = count = 1
    while due[count - 1] < wanted and count < waypoints.shape[0]:
        before = waypoints[count - 1]
        steps = math.ceil(LEAST_TIME / shared.control_period - 1e-9)
        for i in range(N_JOINTS):
            waypoints[count, i] = before[i]
        while row < numbers.shape[0]:
            for i in range(N_JOINTS):
                candidate[i] = LOWEST[i] + numbers[row, i] * (HIGHEST[i] - LOWEST[i])
            stretch = 1.0 + (LONGEST_STRETCH - 1.0) * numbers[row, N_JOINTS]
            row += 1
            drawn = math.ceil(stretch * least_duration(shared, before, candidate) / shared.control_period - 1e-9)
            torque, _ = segment_ratios(shared, before, candidate, drawn * shared.control_period)
            if torque <= TORQUE_SHARE:
                for i in range(N_JOINTS):
                    waypoints[count, i] = candidate[i]
                steps = drawn
                break
        due[count] = due[count - 1] + steps
        count += 1
    env.n_waypoints = count


@inlined
def least_duration(model: Any, start: Array, end: Array) -> float:
    """Duration of a segment at `SPEED_SHARE` of the speed limits, at least `LEAST_TIME`, s."""
    time = LEAST_TIME
    for i in range(start.shape[0]):
        time = max(time, QUINTIC_PEAK * abs(end[i] - start[i]) / (SPEED_SHARE * model.limits[1, i]))
    return time


@inlined
def empty_machine(model: Any) -> tuple[Array, Array, Array, Array]:
    """The dynamics of the empty machine, for `planners.excavator.newton_euler`."""
    return (model.chain_frames, model.chain_gravity, model.chain_inertia, model.chain_drives)


@inlined
def segment_ratios(model: Any, start: Array, end: Array, duration: float) -> tuple[float, float]:
    """Worst torque over limit and worst speed over limit along a segment with the heaviest payload."""
    n = start.shape[0]
    motion, tau = new_array(3, n), new_array(n)
    torque = speed = 0.0
    for sample in range(_SAMPLES + 1):
        segment_motion(start, end, sample / _SAMPLES, duration, motion)
        call(model.torque_kernel, model, 1, motion, tau)
        for i in range(n):
            torque = max(torque, abs(tau[i]) / model.limits[0, i])
            speed = max(speed, abs(motion[1, i]) / model.limits[1, i])
    return torque, speed


@private
def reference_at(env: Any, model: Any, step: float, motion: Array) -> None:
    """Reference after ``step`` control periods, written to ``motion`` ``(3, n)``: angle, velocity, acceleration."""
    due, leg, last = env.due, 1, env.n_waypoints - 1
    while leg < last and step >= due[leg]:
        leg += 1
    steps = due[leg] - due[leg - 1]
    share = min(1.0, (step - due[leg - 1]) / steps)
    segment_motion(env.waypoints[leg - 1], env.waypoints[leg], share, steps * model.control_period, motion)


@inlined
def segment_motion(start: Array, end: Array, share: float, duration: float, motion: Array) -> None:
    """The quintic from rest to rest at a ``share`` of its duration, written to ``motion``."""
    s = share
    for i in range(start.shape[0]):
        change = end[i] - start[i]
        motion[0, i] = start[i] + change * s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)
        motion[1, i] = change / duration * 30.0 * s * s * (1.0 - s) * (1.0 - s)
        motion[2, i] = change / (duration * duration) * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s)
