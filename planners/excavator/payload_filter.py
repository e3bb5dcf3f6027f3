"""An extended Kalman filter of the attachment in its plane: payload, friction and the joints' true state, compiled.

The state vector ``x`` ``(10,)`` holds mass of the payload (kg), shift of its centre in the bucket (m, two axes),
logarithm of the factor on the joints' friction, angles (rad) and velocities (rad/s) of boom, arm and bucket. From one
sample to the next the equations of motion move the joints under the torques of the last command; payload and friction
stay. A sample measures angles and velocities with noise. See D. Simon, "Optimal State Estimation" (2006): section 13.2
for the filter, 6.1 for one measured number after the other.

A payload may change at any time. A sample that the estimate cannot explain (`FilterSettings.surprise`) makes the filter
forget the payload, but nothing else, and follow the last period again.
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
"""Where the state vector holds the friction, the angles and the velocities, and its length."""

SETTINGS = np.dtype(
    [
        ("period", "f8"),
        ("noise", "f8", (2,)),
        ("mean", "f8", (N_LOAD + 1,)),
        ("deviation", "f8", (N_LOAD + 1,)),
        ("most", "f8", (N_LOAD,)),
        ("lag", "f8"),
        ("unmodelled", "f8"),
        ("surprise", "f8"),
        ("ball", "f8", (4,)),
        ("bandwidth", "f8", (N_JOINTS,)),
        ("ahead", "f8"),
    ]
)
"""What the compiled functions know: see `planners.excavator.kalman.FilterSettings`.

``mean`` and ``deviation`` are those of payload and friction before the first sample, ``most`` the largest absolute
numbers of a payload, ``ball`` the centre of a payload without shift in the frame of the bucket, and for 1 kg the square
of the radius of gyration.
"""


@private
def load_of(settings: Any, x: Array, load: Array) -> None:
    """Inertial parameters of the payload of ``x`` as a load of the bucket, written to ``load`` ``(10,)``."""
    ball = settings.ball
    mass, cx, cy, cz = x[0], ball[0] + x[1], ball[1], ball[2] - x[2]
    gyration = ball[3] * mass ** (2.0 / 3.0)
    load[0], load[1], load[2], load[3] = mass, mass * cx, mass * cy, mass * cz
    load[4], load[5], load[6] = mass * (gyration + cy * cy + cz * cz), -mass * cx * cy, -mass * cx * cz
    load[7], load[8] = mass * (gyration + cx * cx + cz * cz), -mass * cy * cz
    load[9] = mass * (gyration + cx * cx + cy * cy)


@private
def begin_filter(settings: Any, chain: Chain, q: Array, qd: Array, x: Array, cov: Array, drive: Array) -> None:
    """Begin at the first sample: what is known beforehand, and drives that hold the empty machine."""
    for k in range(SIZE):
        for m in range(SIZE):
            cov[k, m] = 0.0
    for k in range(N_LOAD + 1):
        x[k], cov[k, k] = settings.mean[k], settings.deviation[k] ** 2
    for i in range(N_JOINTS):
        x[ANGLES + i], cov[ANGLES + i, ANGLES + i] = q[i], settings.noise[0] ** 2
        x[VELOCITIES + i], cov[VELOCITIES + i, VELOCITIES + i] = qd[i], settings.noise[1] ** 2
    still = np.zeros(N_JOINTS)
    torque_single(chain, np.zeros(10), x[ANGLES:VELOCITIES], still, still, still, drive)


@private
def follow(
    settings: Any, chain: Chain, command: Array, q: Array, qd: Array, x: Array, cov: Array, drive: Array
) -> None:
    """Follow one period under ``command``, and correct by the sample ``q, qd`` at its end.

    A surprise is followed again with the payload forgotten: first around the old payload, then around the mean one.
    """
    before, cov_before, drive_before = x.copy(), cov.copy(), drive.copy()
    for attempt in range(3):
        if attempt > 0:
            for k in range(SIZE):
                x[k] = before[k]
                for m in range(SIZE):
                    cov[k, m] = 0.0 if k < N_LOAD or m < N_LOAD else cov_before[k, m]
            for k in range(N_LOAD):
                cov[k, k] = settings.deviation[k] ** 2
                if attempt == 2:
                    x[k] = settings.mean[k]
            for i in range(N_JOINTS):
                drive[i] = drive_before[i]
        _predict(settings, chain, command, x, cov, drive)
        if _correct(settings, q, qd, x, cov) < settings.surprise:
            break


@private
def _predict(settings: Any, chain: Chain, command: Array, x: Array, cov: Array, drive: Array) -> None:
    """Move state and covariance on by one period; ``drive`` becomes the torque at its end."""
    period = settings.period
    # Torques of the drives at the beginning, in the middle and at the end.
    torques, mean = np.empty((3, N_JOINTS)), np.empty(N_JOINTS)
    for i in range(N_JOINTS):
        short = drive[i] - command[i] if settings.lag > 0.0 else 0.0
        for k in range(3):
            left = math.exp(-0.5 * k * period / settings.lag) if settings.lag > 0.0 else 0.0
            torques[k, i] = command[i] + left * short
        mean[i] = (torques[0, i] + 4.0 * torques[1, i] + torques[2, i]) / 6.0
        drive[i] = torques[2, i]
    # Derivative of the acceleration by the state, by differences.
    at, slope = np.empty(N_JOINTS), np.empty((SIZE, N_JOINTS))
    _accelerate(settings, chain, x, mean, at)
    for k in range(SIZE):
        step = 1e-3 * settings.deviation[k] if k < N_LOAD else 1e-6
        kept = x[k]
        x[k] += step
        _accelerate(settings, chain, x, mean, slope[k])
        x[k] = kept
        for i in range(N_JOINTS):
            slope[k, i] = (slope[k, i] - at[i]) / step
    _move_covariance(settings, slope, cov)
    _move_state(settings, chain, torques, x)


@private
def _move_state(settings: Any, chain: Chain, torques: Array, x: Array) -> None:
    """One step of Runge and Kutta's method of fourth order."""
    period = settings.period
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
        _accelerate(settings, chain, x, torques[(stage + 1) // 2], rates[stage])
    for i in range(N_JOINTS):
        early = rates[0, i] + rates[1, i] + rates[2, i]
        x[ANGLES + i] = begin[ANGLES + i] + period * begin[VELOCITIES + i] + period**2 / 6.0 * early
        late = rates[1, i] + rates[2, i] + rates[3, i]
        x[VELOCITIES + i] = begin[VELOCITIES + i] + period / 6.0 * (early + late)


@private
def _move_covariance(settings: Any, slope: Array, cov: Array) -> None:
    """``F cov F^T`` and the noise of what the model leaves out; F is exact to second order in the period."""
    period = settings.period
    f = np.zeros((SIZE, SIZE))
    for k in range(SIZE):
        f[k, k] = 1.0
    for i in range(N_JOINTS):
        f[ANGLES + i, VELOCITIES + i] = period
        for k in range(SIZE):
            f[ANGLES + i, k] += 0.5 * period**2 * slope[k, i]
            f[VELOCITIES + i, k] += period * slope[k, i]
    half = np.zeros((SIZE, SIZE))
    for k in range(SIZE):
        for j in range(SIZE):
            for m in range(SIZE):
                half[k, m] += f[k, j] * cov[j, m]
    for k in range(SIZE):
        for m in range(SIZE):
            cov[k, m] = 0.0
            for j in range(SIZE):
                cov[k, m] += half[k, j] * f[m, j]
    for i in range(N_JOINTS):
        cov[ANGLES + i, ANGLES + i] += (0.5 * settings.unmodelled * period**2) ** 2
        cov[VELOCITIES + i, VELOCITIES + i] += (settings.unmodelled * period) ** 2


@private
def _correct(settings: Any, q: Array, qd: Array, x: Array, cov: Array) -> float:
    """Correct by the measured numbers, one after the other; returns the sum of their squared normalised innovations."""
    surprise = 0.0
    gain, row = np.empty(SIZE), np.empty(SIZE)
    for measured in range(2 * N_JOINTS):
        j, angle = ANGLES + measured, measured < N_JOINTS
        seen = q[measured] if angle else qd[measured - N_JOINTS]
        spread = cov[j, j] + settings.noise[0 if angle else 1] ** 2
        innovation = seen - x[j]
        surprise += innovation * innovation / spread
        for k in range(SIZE):
            gain[k], row[k] = cov[k, j] / spread, cov[j, k]
        for k in range(SIZE):
            x[k] += gain[k] * innovation
            for m in range(SIZE):
                cov[k, m] -= gain[k] * row[m]
    for k in range(N_LOAD):
        x[k] = min(settings.most[k], max(0.0 if k == 0 else -settings.most[k], x[k]))
    return surprise


@private
def _accelerate(settings: Any, chain: Chain, x: Array, torque: Array, qdd: Array) -> None:
    """Accelerations of the joints (rad/s^2) in the state ``x`` under drives' torques (N m), written to ``qdd``."""
    q, qd = x[ANGLES:VELOCITIES], x[VELOCITIES:]
    load, bias, m = np.empty(10), np.empty(N_JOINTS), np.empty((N_JOINTS, N_JOINTS))
    load_of(settings, x, load)
    torque_single(chain, load, q, qd, qd, np.zeros(N_JOINTS), bias)
    mass_matrix_single(chain, load, q, m)
    friction = math.exp(x[FRICTION]) - 1.0
    for i in range(N_JOINTS):
        qdd[i] = torque[i] - bias[i] - friction * chain[3][i, 1] * qd[i]
    solve_mass_matrix(m, qdd)
