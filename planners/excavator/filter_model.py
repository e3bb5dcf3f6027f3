"""The attachment as `planners.excavator.payload_filter` knows it: the state vector, and how it moves, compiled.

Payload, friction, link masses and latency of a state vector ``x`` belong to one machine among many. The time by which
commands come late divides a period: until then the drives follow one command, afterwards the next.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from planners.compiled.calls import private
from planners.excavator.newton_euler import Chain, mass_matrix_single, torque_single
from planners.robot.dynamics import solve_mass_matrix
from planners.typing import Array

N_JOINTS = 3
N_LOAD = 3
"""Numbers of the payload: mass, and two of the shift of its centre."""
FRICTION, ANGLES, VELOCITIES, SIZE = N_LOAD, N_LOAD + 1, N_LOAD + 1 + N_JOINTS, N_LOAD + 1 + 2 * N_JOINTS
"""Where the state vector holds the friction, the angles and the velocities, and its length for the nominal machine."""
MASSES, LATENCY, FULL_SIZE = SIZE, SIZE + N_JOINTS, SIZE + N_JOINTS + 1
"""Where it holds the shares of the links' masses and the latency, and its length with them."""

LEAST_CENTRED = 20.0
"""Mass of a payload below which its centre is taken to be less shifted than its first moments say, kg."""

SETTINGS = np.dtype(
    [
        ("size", "i8"),
        ("waiting", "i8"),
        ("period", "f8"),
        ("noise", "f8", (2,)),
        ("mean", "f8", (N_LOAD + 1,)),
        ("deviation", "f8", (N_LOAD + 1,)),
        ("least", "f8"),
        ("most", "f8", (N_LOAD,)),
        ("lag", "f8"),
        ("unmodelled", "f8"),
        ("surprise", "f8"),
        ("ball", "f8", (4,)),
        ("bandwidth", "f8", (N_JOINTS,)),
        ("ahead", "f8"),
        ("masses", "f8"),
        ("latency", "f8", (3,)),
    ]
)
"""What the compiled functions know: see `planners.excavator.kalman.FilterSettings`.

``size`` is the length of the state vector and ``waiting`` the number of commands that are remembered. ``mean`` and
``deviation`` are those of payload and friction before the first sample, ``least`` the least mass of a payload and
``most`` the largest absolute numbers of one, ``ball`` the centre of a payload without shift in the frame of the bucket,
and for 1 kg the square of the radius of gyration. ``latency`` has mean, standard deviation and largest value.
"""


@private
def load_of(settings: Any, x: Array, load: Array) -> None:
    """Inertial parameters of the payload of ``x`` as a load of the bucket, written to ``load`` ``(10,)``."""
    ball, mass, shift_x, shift_z = settings.ball, x[0], x[1], x[2]
    if x.shape[0] == FULL_SIZE:
        heavy = max(LEAST_CENTRED, mass)
        shift_x, shift_z = shift_x / heavy, shift_z / heavy
    cx, cy, cz = ball[0] + shift_x, ball[1], ball[2] - shift_z
    gyration = ball[3] * abs(mass) ** (2.0 / 3.0)
    load[0], load[1], load[2], load[3] = mass, mass * cx, mass * cy, mass * cz
    load[4], load[5], load[6] = mass * (gyration + cy * cy + cz * cz), -mass * cx * cy, -mass * cx * cz
    load[7], load[8] = mass * (gyration + cx * cx + cz * cz), -mass * cy * cz
    load[9] = mass * (gyration + cx * cx + cy * cy)


@private
def machine_of(chain: Chain, x: Array) -> Chain:
    """The machine with the links' masses of ``x``."""
    frames, gravity, inertia, drives = chain
    if x.shape[0] == FULL_SIZE:
        inertia = inertia.copy()
        for i in range(N_JOINTS):
            for parameter in range(10):
                inertia[i, parameter] *= 1.0 + x[MASSES + i]
    return frames, gravity, inertia, drives


@private
def accelerate(settings: Any, machine: Chain, x: Array, torque: Array, qdd: Array) -> None:
    """Accelerations of the joints (rad/s^2) of a `machine_of` ``x`` under drives' torques (N m), written to ``qdd``."""
    q, qd = x[ANGLES:VELOCITIES], x[VELOCITIES:SIZE]
    load, bias, m = np.empty(10), np.empty(N_JOINTS), np.empty((N_JOINTS, N_JOINTS))
    load_of(settings, x, load)
    torque_single(machine, load, q, qd, qd, np.zeros(N_JOINTS), bias)
    mass_matrix_single(machine, load, q, m)
    friction = math.exp(x[FRICTION]) - 1.0
    for i in range(N_JOINTS):
        qdd[i] = torque[i] - bias[i] - friction * machine[3][i, 1] * qd[i]
    solve_mass_matrix(m, qdd)


@private
def move_state(settings: Any, machine: Chain, torques: Array, period: float, x: Array) -> None:
    """One step of Runge and Kutta's method of fourth order."""
    begin, rates = x.copy(), np.empty((4, N_JOINTS))
    for stage in range(4):
        if stage > 0:
            time = period if stage == 3 else 0.5 * period
            for i in range(N_JOINTS):
                speed = begin[VELOCITIES + i]
                if stage > 1:
                    speed += 0.5 * period * rates[stage - 2, i]
                x[ANGLES + i] = begin[ANGLES + i] + time * speed
                x[VELOCITIES + i] = begin[VELOCITIES + i] + time * rates[stage - 1, i]
        accelerate(settings, machine, x, torques[(stage + 1) // 2], rates[stage])
    for i in range(N_JOINTS):
        early = rates[0, i] + rates[1, i] + rates[2, i]
        x[ANGLES + i] = begin[ANGLES + i] + period * begin[VELOCITIES + i] + period**2 / 6.0 * early
        late = rates[1, i] + rates[2, i] + rates[3, i]
        x[VELOCITIES + i] = begin[VELOCITIES + i] + period / 6.0 * (early + late)


@private
def _drive(settings: Any, command: Array, duration: float, drive: Array, torques: Array) -> None:
    """Torques of the drives at the beginning, in the middle and at the end, ``(3, n)``, N m; ``drive`` moves on."""
    for k in range(3):
        left = math.exp(-0.5 * k * duration / settings.lag) if settings.lag > 0.0 else 0.0
        for i in range(N_JOINTS):
            short = drive[i] - command[i] if settings.lag > 0.0 else 0.0
            torques[k, i] = command[i] + left * short
    for i in range(N_JOINTS):
        drive[i] = torques[2, i]


@private
def _waiting(settings: Any, commands: Array, x: Array) -> tuple[int, float]:
    """The latency as whole periods and the rest of it, s."""
    if x.shape[0] < FULL_SIZE:
        return 0, 0.0
    whole = min(int(x[LATENCY] / settings.period), commands.shape[0] - 2)
    return whole, x[LATENCY] - whole * settings.period


@private
def arriving(settings: Any, commands: Array, x: Array, drive: Array, torques: Array, mean: Array) -> float:
    """Torques of the drives in the last period, and their ``mean`` ``(n,)``, N m; ``drive`` moves on.

    Until the time that is returned, s, the torques are ``torques[0]``, from then on ``torques[1]``, ``(2, 3, n)``.
    """
    period, (whole, part) = settings.period, _waiting(settings, commands, x)
    for i in range(N_JOINTS):
        mean[i] = 0.0
    for later in range(2):
        duration = period - part if later else part
        if duration > 0.0:
            _drive(settings, commands[whole + 1 - later], duration, drive, torques[later])
            for i in range(N_JOINTS):
                simpson = (torques[later, 0, i] + 4.0 * torques[later, 1, i] + torques[later, 2, i]) / 6.0
                mean[i] += duration / period * simpson
    return part


@private
def look_ahead(settings: Any, chain: Chain, commands: Array, x: Array, drive: Array) -> float:
    """Move the state ``x`` on to the time at which the next command arrives, and return how far that is off, s."""
    machine, torques = machine_of(chain, x), np.empty((3, N_JOINTS))
    whole, part = _waiting(settings, commands, x)
    for age in range(whole, -1, -1):
        duration = part if age == whole else settings.period
        if duration > 0.0:
            _drive(settings, commands[age], duration, drive, torques)
            move_state(settings, machine, torques, duration, x)
    late: float = whole * settings.period + part
    return late
