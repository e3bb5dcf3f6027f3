"""An extended Kalman filter of the attachment in its plane: payload, friction and the joints' true state, compiled.

The state vector ``x`` holds mass of the payload (kg), shift of its centre in the bucket (m, two axes), logarithm of the
factor on the joints' friction, angles (rad) and velocities (rad/s) of boom, arm and bucket. From one sample to the next
the equations of motion move the joints under the torques of the commands that arrive; the other numbers stay. A sample
measures angles and velocities with noise. See D. Simon, "Optimal State Estimation" (2006), section 13.2.

Where link masses or the latency are uncertain, the state vector goes on with the shares by which the three links are
heavier than the nominal ones, and the time by which a command comes late (s). Then masses, payload and latency hardly
show one by one, and a filter that trusts its derivatives too much learns what no sample has said. So the first moments
of the payload (kg m), in which the torques are linear, stand in place of the shift, and derivatives by these numbers
are differences over what is likely, with noise for the bend between (M. Norgaard, N. Poulsen and O. Ravn, "New
developments in state estimation for nonlinear systems", 2000).

A payload may change at any time. A sample that the estimate cannot explain (`FilterSettings.surprise`) makes the filter
forget the payload, but nothing else, and follow the last period again.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from planners.compiled.calls import private
from planners.control.filtering import correct_by, move_covariance
from planners.excavator.filter_model import (
    ANGLES,
    FULL_SIZE,
    LATENCY,
    MASSES,
    N_JOINTS,
    N_LOAD,
    VELOCITIES,
    accelerate,
    arriving,
    machine_of,
    move_state,
)
from planners.excavator.newton_euler import Chain, torque_single
from planners.typing import Array

LEAST_SHARE = -0.9
"""Least share by which a link is heavier than the nominal one."""
REACH = 3.0
"""Square of the standard deviations either way that count as likely."""
FORGOTTEN = 0.2
"""Share of its first standard deviation by which the latency becomes less certain with a surprise."""


@private
def begin_filter(
    settings: Any, chain: Chain, q: Array, qd: Array, x: Array, cov: Array, drive: Array, commands: Array
) -> None:
    """Begin at the first sample: what is known beforehand, and commands and drives that hold the empty machine."""
    cov[:, :] = 0.0
    for k in range(N_LOAD + 1):
        x[k], cov[k, k] = settings.mean[k], settings.deviation[k] ** 2
    for i in range(N_JOINTS):
        x[ANGLES + i], cov[ANGLES + i, ANGLES + i] = q[i], settings.noise[0] ** 2
        x[VELOCITIES + i], cov[VELOCITIES + i, VELOCITIES + i] = qd[i], settings.noise[1] ** 2
    if x.shape[0] == FULL_SIZE:
        for i in range(N_JOINTS):
            x[MASSES + i], cov[MASSES + i, MASSES + i] = 0.0, settings.masses**2
        x[LATENCY], cov[LATENCY, LATENCY] = settings.latency[0], settings.latency[1] ** 2
    still = np.zeros(N_JOINTS)
    torque_single(chain, np.zeros(10), x[ANGLES:VELOCITIES], still, still, still, drive)
    for age in range(commands.shape[0]):
        for i in range(N_JOINTS):
            commands[age, i] = drive[i]


@private
def follow(
    settings: Any, chain: Chain, commands: Array, q: Array, qd: Array, x: Array, cov: Array, drive: Array
) -> None:
    """Follow one period under the ``commands``, and correct by the sample ``q, qd`` at its end.

    ``commands[k]`` was sent ``k + 1`` periods before the sample. A surprise is followed again with the payload
    forgotten: first around the old payload, then around the mean one.
    """
    size = x.shape[0]
    before, cov_before, drive_before = x.copy(), cov.copy(), drive.copy()
    for attempt in range(3):
        if attempt > 0:
            for k in range(size):
                x[k] = before[k]
                for m in range(size):
                    cov[k, m] = 0.0 if k < N_LOAD or m < N_LOAD else cov_before[k, m]
            if size == FULL_SIZE:
                cov[LATENCY, LATENCY] += (FORGOTTEN * settings.latency[1]) ** 2
            for k in range(N_LOAD):
                cov[k, k] = settings.deviation[k] ** 2
                if attempt == 2:
                    x[k] = settings.mean[k]
            for i in range(N_JOINTS):
                drive[i] = drive_before[i]
        _predict(settings, chain, commands, x, cov, drive)
        if _correct(settings, q, qd, x, cov) < settings.surprise:
            break


@private
def _predict(settings: Any, chain: Chain, commands: Array, x: Array, cov: Array, drive: Array) -> None:
    """Move state and covariance on by one period; ``drive`` becomes the torque at its end."""
    size, period, begin = x.shape[0], settings.period, drive.copy()
    machine, torques, mean = machine_of(chain, x), np.empty((2, 3, N_JOINTS)), np.empty(N_JOINTS)
    part = arriving(settings, commands, x, drive, torques, mean)
    # Derivative of the mean acceleration by the state, by differences; F is exact to second order in the period.
    at, slope, spread, f = np.empty(N_JOINTS), np.empty(N_JOINTS), np.zeros(N_JOINTS), np.eye(size)
    accelerate(settings, machine, x, mean, at)
    for i in range(N_JOINTS):
        f[ANGLES + i, VELOCITIES + i] = period
    for k in range(size):
        if cov[k, k] <= 0.0:
            continue
        if size == FULL_SIZE and (k < ANGLES or k >= MASSES):
            _by_likely(settings, chain, commands, x, cov, begin, mean, at, k, slope, spread)
        else:
            kept, step = x[k], 1e-3 * settings.deviation[k] if k < N_LOAD else 1e-6
            x[k] += step
            accelerate(settings, machine, x, mean, slope)
            x[k] = kept
            for i in range(N_JOINTS):
                slope[i] = (slope[i] - at[i]) / step
        for i in range(N_JOINTS):
            f[ANGLES + i, k] += 0.5 * period**2 * slope[i]
            f[VELOCITIES + i, k] += period * slope[i]
    move_covariance(f, cov)
    for i in range(N_JOINTS):
        cov[ANGLES + i, ANGLES + i] += (0.5 * settings.unmodelled * period**2) ** 2
        cov[VELOCITIES + i, VELOCITIES + i] += (settings.unmodelled * period) ** 2 + spread[i] * period**2
    for later in range(2):
        duration = period - part if later else part
        if duration > 0.0:
            move_state(settings, machine, torques[later], duration, x)


@private
def _by_likely(
    settings: Any,
    chain: Chain,
    commands: Array,
    x: Array,
    cov: Array,
    drive: Array,
    mean: Array,
    at: Array,
    k: int,
    slope: Array,
    spread: Array,
) -> None:
    """Derivative of the mean acceleration by number ``k`` of ``x``, to ``slope``; adds a variance to ``spread``."""
    kept, reach = x[k], math.sqrt(REACH * cov[k, k])
    low, high = kept - reach, kept + reach
    if k == LATENCY:
        low, high = max(0.0, low), min(settings.latency[2], high)
    elif k == 0:
        low, high = max(settings.least, low), min(settings.most[0], high)
    elif k >= MASSES:
        low = max(LEAST_SHARE, low)
    ends, torques, other = np.empty((2, N_JOINTS)), np.empty((2, 3, N_JOINTS)), mean.copy()
    for end in range(2):
        x[k] = high if end else low
        if k == LATENCY:
            arriving(settings, commands, x, drive.copy(), torques, other)
        accelerate(settings, machine_of(chain, x), x, other, ends[end])
    x[k] = kept
    for i in range(N_JOINTS):
        slope[i] = (ends[1, i] - ends[0, i]) / (high - low)
        spread[i] += (at[i] - ends[0, i] - slope[i] * (kept - low)) ** 2


@private
def _correct(settings: Any, q: Array, qd: Array, x: Array, cov: Array) -> float:
    """Correct by the measured numbers, one after the other; returns the sum of their squared normalised innovations."""
    surprise = 0.0
    for measured in range(2 * N_JOINTS):
        angle = measured < N_JOINTS
        seen = q[measured] if angle else qd[measured - N_JOINTS]
        surprise += correct_by(seen, ANGLES + measured, settings.noise[0 if angle else 1] ** 2, x, cov)
    for k in range(N_LOAD):
        x[k] = min(settings.most[k], max(settings.least if k == 0 else -settings.most[k], x[k]))
    if x.shape[0] == FULL_SIZE:
        for k in range(MASSES, LATENCY):
            x[k] = max(LEAST_SHARE, x[k])
        x[LATENCY] = min(settings.latency[2], max(0.0, x[LATENCY]))
    return surprise
